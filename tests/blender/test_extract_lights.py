# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps, light groups and worlds made with bpy, read into records in watts."""

from __future__ import annotations

from math import pi, tan

import bpy
import numpy as np
import pytest

from tests.blender.built import add_lamp, add_mesh, emission, extract

# lamps


def test_a_point_lamps_intensity_is_its_power_over_the_sphere():
    add_mesh()
    add_lamp("POINT", energy=100, color=(1, 0.5, 0), shadow_soft_size=0.25)
    light = extract().scene.lights[0]
    assert light.intensity == pytest.approx((100 / (4 * pi), 50 / (4 * pi), 0))
    assert (light.position, light.radius, light.soft_falloff, light.shadow) == ((0, 0, 2), 0.25, True, True)


def test_a_spots_axes_are_divided_by_its_objects_scale():
    add_mesh()
    add_lamp("SPOT", energy=100, scale=(2, 3, 4), spot_size=1.0, spot_blend=0.3)
    light = extract().scene.lights[0]
    assert light.intensity == pytest.approx((100 / (4 * pi),) * 3)
    assert np.allclose(light.axes, [(0.5, 0, 0), (0, 1 / 3, 0), (0, 0, -0.25)])
    assert (light.angle, light.blend) == pytest.approx((1.0, 0.3))


def test_a_suns_irradiance_is_its_strength():
    add_mesh()
    add_lamp("SUN", energy=3, angle=0.1, scale=(2, 2, 2))
    light = extract().scene.lights[0]
    assert light.irradiance == pytest.approx((3, 3, 3))
    assert light.direction == pytest.approx((0, 0, -1))
    assert light.angle == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("shape", "area"), [("SQUARE", 0.25), ("RECTANGLE", 1.0), ("DISK", 0.25 * pi / 4), ("ELLIPSE", pi / 4)]
)
def test_an_area_lamps_radiance_is_its_power_over_pi_and_its_scaled_area(shape, area):
    add_mesh()
    add_lamp("AREA", energy=100, shape=shape, size=0.5, size_y=2, scale=(2, 3, 1))
    light = extract().scene.lights[0]
    assert light.radiance == pytest.approx((100 / (pi * 6 * area),) * 3)
    assert np.linalg.norm(light.edge_u) == pytest.approx(1)
    assert light.direction == pytest.approx((0, 0, -1))
    assert light.ellipse == (shape in ("DISK", "ELLIPSE"))


def test_a_narrow_area_lamp_is_brighter_on_its_axis():
    add_mesh()
    add_lamp("AREA", energy=100, size=1, spread=1.0)
    gain = tan(0.5) / (tan(0.5) - 0.5)
    assert extract().scene.lights[0].radiance == pytest.approx((100 / pi * gain,) * 3)


@pytest.mark.skipif(bpy.app.version < (4, 5), reason="lamps have neither exposure nor temperature before 4.5")
def test_exposure_temperature_and_unnormalised_power():
    add_mesh()
    add_lamp("POINT", "exposed", energy=100, exposure=1)
    warm = add_lamp("POINT", "warm", energy=100, use_temperature=True, temperature=3000)
    add_lamp("AREA", "flat", energy=100, size=3, normalize=False)
    add_lamp("SUN", "disc", energy=3, angle=0.5, normalize=False)
    add_lamp("POINT", "ball", energy=100, shadow_soft_size=0.25, normalize=False)
    lights = {light.name: light for light in extract().scene.lights}
    assert lights["exposed"].intensity == pytest.approx((200 / (4 * pi),) * 3)
    assert lights["warm"].intensity == pytest.approx([100 / (4 * pi) * c for c in warm.data.temperature_color])
    assert lights["flat"].radiance == pytest.approx((100 / pi,) * 3)
    assert lights["disc"].irradiance == pytest.approx((3 * pi * np.sin(0.25) ** 2,) * 3)
    assert lights["ball"].intensity == pytest.approx((100 / 16,) * 3)


def test_a_lamps_node_tree_scales_its_power():
    add_mesh()
    lamp = add_lamp("POINT", energy=100)
    if bpy.app.version < (5, 0):
        lamp.data.use_nodes = True
    lamp.data.node_tree.nodes["Emission"].inputs["Strength"].default_value = 3
    assert extract().scene.lights[0].intensity == pytest.approx((300 / (4 * pi),) * 3)


def test_a_lamp_without_shadow_says_so():
    add_mesh()
    add_lamp("POINT", use_shadow=False)
    assert not extract().scene.lights[0].shadow


def collection_of(*things, exclude=False, children=()):
    """A collection for light linking, which includes what it holds or excludes it."""
    group = bpy.data.collections.new("linked")
    for thing in things:
        group.objects.link(thing)
    for child in children:
        group.children.link(child)
    for entry in (*group.collection_objects, *group.collection_children):
        entry.light_linking.link_state = "EXCLUDE" if exclude else "INCLUDE"
    return group


def lit_by_the_lamp(linked):
    add_lamp("POINT").light_linking.receiver_collection = linked
    scene = extract().scene
    return {scene.meshes[index].name for index in scene.receivers[0]}


def test_a_lamp_lights_what_its_collection_includes():
    a, b, _ = add_mesh("a"), add_mesh("b"), add_mesh("c")
    assert lit_by_the_lamp(collection_of(a, b)) == {"a", "b"}


def test_a_lamp_lights_all_but_what_its_collection_excludes():
    a, _, _ = add_mesh("a"), add_mesh("b"), add_mesh("c")
    assert lit_by_the_lamp(collection_of(a, exclude=True)) == {"b", "c"}


def test_collections_within_a_lamps_collection_count_and_an_objects_own_word_goes_first():
    a, b, _ = add_mesh("a"), add_mesh("b"), add_mesh("c")
    linked = collection_of(b, exclude=True)
    inner = collection_of(a, b)
    linked.children.link(inner)
    assert lit_by_the_lamp(linked) == {"a"}


def test_a_lamp_without_a_collection_lights_all_and_shadow_linking_is_warned_about():
    add_mesh()
    add_lamp("POINT").light_linking.blocker_collection = bpy.data.collections.new("few")
    extraction = extract()
    assert extraction.scene.receivers == {}
    assert any("Lamp" in warning and "shadow linking" in warning for warning in extraction.warnings)


def test_lamps_hidden_in_renders_portals_and_those_without_power_are_left_out():
    add_mesh()
    add_lamp("POINT", "hidden").hide_render = True
    add_lamp("POINT", "off", energy=0)
    add_lamp("POINT", "not for diffuse").visible_diffuse = False
    add_lamp("AREA", "portal").data.cycles.is_portal = True
    assert extract().scene.lights == ()


def test_a_lamp_of_negative_power_is_kept_with_a_warning():
    add_mesh()
    add_lamp("SUN", energy=-1)
    extraction = extract()
    assert extraction.scene.lights[0].irradiance == (-1, -1, -1)
    assert any("negative power" in warning for warning in extraction.warnings)


# groups and world


def test_light_groups_are_those_of_the_view_layer_and_the_nameless_one_comes_first():
    add_mesh()
    bpy.context.view_layer.lightgroups.add(name="warm")
    add_lamp("POINT", "a").lightgroup = "warm"
    add_lamp("POINT", "b").lightgroup = "unknown"
    scene = extract().scene
    assert scene.groups == ("", "warm")
    assert [light.group for light in scene.lights] == [1, 0]


def test_one_material_in_two_light_groups_is_two_records():
    bpy.context.view_layer.lightgroups.add(name="warm")
    glow = emission("glow", 2)
    for name in ("a", "b"):
        add_mesh(name).data.materials.append(glow)
    bpy.data.objects["b"].lightgroup = "warm"
    scene = extract().scene
    assert [scene.materials[mesh.material[0]].group for mesh in scene.meshes] == [0, 1]


def test_the_worlds_colour_times_strength():
    add_mesh()
    world = bpy.context.scene.world = bpy.data.worlds.new("World")
    if world.node_tree is None:
        world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (0.1, 0.2, 0.3, 1)
    background.inputs["Strength"].default_value = 2
    assert extract().scene.world.radiance == pytest.approx((0.2, 0.4, 0.6))


def test_no_light_is_warned_about_and_any_light_is_not():
    add_mesh()
    assert any("no light" in warning for warning in extract().warnings)
    add_lamp("POINT")
    assert extract().warnings == ()
