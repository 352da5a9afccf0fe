# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds of any nodes: what is rendered of them is what their nodes say, and the scene stays as it was."""

from __future__ import annotations

import math
import warnings

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.reading import light_records
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.lighting.sky import sky_of
from radiosity_addon.scene import Scene, SkyTile, World
from tests.blender.datablocks import snapshot

SKY = "NISHITA" if bpy.app.version < (5, 0) else "MULTIPLE_SCATTERING"


@pytest.fixture(autouse=True)
def coarse(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of fewer pixels, as many as there are things to see."""
    monkeypatch.setattr(light_records, "HEIGHT", 512 if "sun" in request.node.name else 256)


def add_world() -> tuple[bpy.types.NodeTree, bpy.types.Node]:
    """The tree of the scene's new world, and its Background node; a floor to bake."""
    made = bpy.context.scene.world = bpy.data.worlds.new("World")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        made.use_nodes = True
    mesh = bpy.data.meshes.new("Floor")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [], [(0, 1, 2, 3)])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Floor", mesh))
    return made.node_tree, next(node for node in made.node_tree.nodes if node.type == "BACKGROUND")


def extracted() -> Scene:
    return extract_scene(bpy.context.scene).scene


def ways(tile: SkyTile) -> np.ndarray:
    """(H, W, 3) to the middles of a tile's pixels."""
    height, width = tile.radiance.shape[:2]
    latitude = tile.south + (np.arange(height) + 0.5)[:, None] * ((tile.north - tile.south) / height)
    longitude = tile.west + (np.arange(width) + 0.5)[None] * ((tile.east - tile.west) / width)
    x, y = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude)
    return np.stack(np.broadcast_arrays(x, y, np.sin(latitude)), axis=2)


def show_directions(tree: bpy.types.NodeTree, background: bpy.types.Node) -> None:
    """Radiance 2 + the way one looks."""
    coordinates, add = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeVectorMath")
    add.inputs[1].default_value = (2, 2, 2)
    tree.links.new(coordinates.outputs["Generated"], add.inputs[0])
    tree.links.new(add.outputs[0], background.inputs["Color"])


def spotted_image(height: int, row: int, column: int, value: float) -> bpy.types.Image:
    """A grey sky of radiance 0.5 with one bright pixel."""
    pixels = np.full((height, 2 * height, 4), 0.5, np.float32)
    pixels[row, column, :3] = value
    image = bpy.data.images.new("Sky", 2 * height, height, float_buffer=True, is_data=True)
    image.pixels.foreach_set(pixels.reshape(-1))
    return image


def strongest(lit: World) -> tuple[np.ndarray, float]:
    """Direction towards the strongest lamp in the sky, and its irradiance on a plane that faces it."""
    sky = sky_of(lit)
    assert sky is not None
    sun = max(sky.suns, key=lambda sun: sum(sun.irradiance))
    return -np.array(sun.direction), sum(sun.irradiance) / 3


def test_one_colour_is_read_without_a_picture() -> None:
    _, background = add_world()
    background.inputs["Color"].default_value = (0.1, 0.2, 0.4, 1)
    background.inputs["Strength"].default_value = 2
    assert extracted().world == World(tuple(2 * np.array(background.inputs["Color"].default_value, float)[:3]))


def test_a_picture_shows_each_direction_where_the_world_has_it() -> None:
    show_directions(*add_world())
    (tile,) = extracted().world.sky
    np.testing.assert_allclose(tile.radiance, ways(tile) + 2, atol=0.02)


def test_finer_tiles_show_the_sun_where_the_world_has_it() -> None:
    tree, background = add_world()
    image = tree.nodes.new("ShaderNodeTexEnvironment")
    image.image = spotted_image(256, 170, 100, 1e5)
    tree.links.new(image.outputs[0], background.inputs["Color"])
    whole, *finer = extracted().world.sky
    edge = math.pi / len(whole.radiance)
    sides = np.array([(tile.west, tile.south) for tile in finer]) / edge
    np.testing.assert_allclose(sides, np.rint(sides), atol=1e-6)
    turn, height = math.pi - (100.5 / 512) * 2 * math.pi, (170.5 / 256 - 0.5) * math.pi
    towards = np.array([math.cos(height) * math.cos(turn), math.cos(height) * math.sin(turn), math.sin(height)])
    direction, irradiance = strongest(extracted().world)
    np.testing.assert_allclose(direction, towards, atol=1e-3)
    step = math.pi / 256
    assert irradiance == pytest.approx(1e5 * step * step * math.cos(height), rel=0.003)


def test_a_mapping_node_turns_the_sun() -> None:
    tree, background = add_world()
    image = tree.nodes.new("ShaderNodeTexEnvironment")
    image.image = spotted_image(64, 40, 32, 1e4)
    tree.links.new(image.outputs[0], background.inputs["Color"])
    before, power = strongest(extracted().world)
    coordinates, mapping = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeMapping")
    mapping.inputs["Rotation"].default_value = (0, 0, math.radians(50))
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs[0])
    tree.links.new(mapping.outputs[0], image.inputs[0])
    after, same = strongest(extracted().world)
    turned = math.degrees(math.atan2(after[1], after[0]) - math.atan2(before[1], before[0])) % 360
    assert turned == pytest.approx(310, abs=0.05)  # coordinates turn one way, the picture the other
    assert same == pytest.approx(power, rel=0.003)


@pytest.mark.parametrize("degrees", [0.15, 0.545, 2.0])
def test_the_sky_textures_sun_is_one_lamp_of_its_size(degrees: float) -> None:
    tree, background = add_world()
    sky = tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type, sky.sun_size = SKY, math.radians(degrees)
    sky.sun_elevation, sky.sun_rotation = math.radians(40), math.radians(30)
    tree.links.new(sky.outputs[0], background.inputs["Color"])
    found = sky_of(extracted().world)
    assert found is not None
    sun = max(found.suns, key=lambda sun: sum(sun.irradiance))
    assert math.degrees(sun.angle) == pytest.approx(degrees, rel=0.12)  # dimmer at its limb
    assert math.degrees(math.asin(-sun.direction[2])) == pytest.approx(40, abs=0.05)
    assert sum(other.irradiance[0] for other in found.suns) < 1.1 * sun.irradiance[0]


def test_diffuse_rays_see_what_light_path_shows_them_also_inside_groups() -> None:
    """Camera rays see 9, diffuse rays 2."""
    tree, background = add_world()
    group = bpy.data.node_groups.new("Trick", "ShaderNodeTree")
    group.interface.new_socket("Strength", in_out="OUTPUT", socket_type="NodeSocketFloat")
    path, mix = group.nodes.new("ShaderNodeLightPath"), group.nodes.new("ShaderNodeMapRange")
    mix.inputs["To Min"].default_value, mix.inputs["To Max"].default_value = 2, 9
    group.links.new(path.outputs["Is Camera Ray"], mix.inputs[0])
    group.links.new(mix.outputs[0], group.nodes.new("NodeGroupOutput").inputs[0])
    use = tree.nodes.new("ShaderNodeGroup")
    use.node_tree = group
    tree.links.new(use.outputs[0], background.inputs["Strength"])
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    (tile,) = extracted().world.sky
    np.testing.assert_allclose(tile.radiance, 2, rtol=1e-6)


def test_a_world_that_the_camera_does_not_see_still_lights() -> None:
    show_directions(*add_world())
    bpy.context.scene.world.cycles_visibility.camera = False
    (tile,) = extracted().world.sky
    assert tile.radiance.mean() == pytest.approx(2, rel=0.01)


def test_a_world_that_diffuse_rays_do_not_see_is_dark() -> None:
    show_directions(*add_world())
    bpy.context.scene.world.cycles_visibility.diffuse = False
    assert extracted().world == World()


@pytest.mark.skipif(bpy.app.version < (5, 0), reason="worlds always cast shadows before Blender 5.0")
def test_a_world_that_casts_no_shadows_is_named() -> None:
    add_world()
    bpy.context.scene.world.cycles.use_shadows = False
    assert any("World 'World': is set to cast no shadows" in text for text in extracted().warnings)


def test_a_volume_is_named_and_left_out() -> None:
    tree, background = add_world()
    show_directions(tree, background)
    scatter = tree.nodes.new("ShaderNodeVolumeScatter")
    tree.links.new(scatter.outputs[0], tree.get_output_node("CYCLES").inputs["Volume"])
    scene = extracted()
    assert scene.world.sky[0].radiance.mean() == pytest.approx(2, rel=0.01)
    assert any("World 'World': has a volume" in text for text in scene.warnings)


def test_what_cycles_makes_nothing_of_is_no_light() -> None:
    """Cycles leaves samples out that are not finite numbers."""
    tree, background = add_world()
    show_directions(tree, background)
    background.inputs["Strength"].default_value = float("nan")
    scene = extracted()
    assert not scene.world.sky
    assert any("no light" in text for text in scene.warnings)


def test_a_world_without_an_image_is_what_cycles_shows() -> None:
    tree, background = add_world()
    tree.links.new(tree.nodes.new("ShaderNodeTexEnvironment").outputs[0], background.inputs["Color"])
    (tile,) = extracted().world.sky
    np.testing.assert_allclose(tile.radiance[0, 0], (1, 0, 1), atol=1e-6)


def test_the_light_group_of_the_world_is_kept() -> None:
    show_directions(*add_world())
    bpy.ops.scene.view_layer_add_lightgroup(name="Outside")
    bpy.context.scene.world.lightgroup = "Outside"
    scene = extracted()
    assert scene.groups[scene.world.group] == "Outside"
    assert scene.world.sky


def test_nothing_of_the_rendering_stays() -> None:
    show_directions(*add_world())
    bpy.context.scene.frame_set(7)
    before = snapshot()
    extracted()
    assert snapshot() == before
