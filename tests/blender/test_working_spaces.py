# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes in Linear Rec.709, Linear Rec.2020 and ACEScg: the numbers differ, the light seen is the same."""

from __future__ import annotations

import math
import warnings

import bpy
import numpy as np
import pytest

from radiosity_addon.bake import bake
from radiosity_addon.blender.data.working_space import blackbody_color, working_space
from radiosity_addon.blender.looks.nodes import image_mean
from radiosity_addon.blender.reading import world
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.chunks import finish
from radiosity_addon.settings import BakeSettings

SPACES = ("Linear Rec.709", "Linear Rec.2020", "ACEScg") if bpy.app.version >= (5, 0) else ("Linear Rec.709",)


def convert(space: str) -> None:
    """Give the file this working space, with all its colours."""
    if space != SPACES[0]:
        bpy.ops.wm.set_working_color_space(working_space=space, convert_colors=True)
    assert working_space().name == space


def tree_of(owner: bpy.types.ID) -> bpy.types.NodeTree:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        owner.use_nodes = True
    return owner.node_tree


def add(name: str, data: bpy.types.ID, **attributes: object) -> bpy.types.Object:
    thing = bpy.data.objects.new(name, data)
    for key, value in attributes.items():
        setattr(thing, key, value)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add_square(name: str, color: tuple[float, float, float], **attributes: object) -> bpy.types.Object:
    """A diffuse square of 2 m that faces its z."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new(name)
    tree = tree_of(material)
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (*color, 1)
    tree.links.new(diffuse.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
    mesh.materials.append(material)
    return add(name, mesh, **attributes)


def add_blackbody_lamp(kelvin: float) -> None:
    lamp = bpy.data.lights.new("Lamp", "POINT")
    lamp.energy = 100
    tree = tree_of(lamp)
    tree.nodes.clear()
    body, emission, output = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Blackbody", "Emission", "OutputLight"))
    body.inputs[0].default_value = kelvin
    tree.links.new(body.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs[0])
    add("Lamp", lamp, location=(0.3, -0.2, 0.8))


def corner_lit_by_everything() -> None:
    """A floor and a wall, a warm lamp, an orange one and a sky with a sun."""
    add_square("Floor", (0.6, 0.55, 0.5))
    add_square("Wall", (0.3, 0.4, 0.55), location=(0, 1, 1), rotation_euler=(math.pi / 2, 0, 0))
    add_blackbody_lamp(2800)
    area = bpy.data.lights.new("Area", "AREA")
    area.energy, area.color = 30, (1.0, 0.6, 0.3)
    add("Area", area, location=(-1, 0, 1.5), rotation_euler=(0, -0.5, 0))
    lit = bpy.context.scene.world = bpy.data.worlds.new("World")
    tree = tree_of(lit)
    sky = tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type = "NISHITA" if bpy.app.version < (5, 0) else "SINGLE_SCATTERING"
    sky.sun_elevation = 0.6
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    background.inputs["Strength"].default_value = 0.03
    tree.links.new(sky.outputs[0], background.inputs["Color"])


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("kelvin", [500.0, 1000.0, 1900.0, 3000.0, 6500.0, 11000.0, 40000.0])
def test_black_bodies_have_blenders_colour(space: str, kelvin: float) -> None:
    convert(space)
    lamp = bpy.data.lights.new("Lamp", "POINT")
    if not hasattr(lamp, "temperature_color"):
        pytest.skip("lamps have a temperature from Blender 4.5 on")
    lamp.use_temperature, lamp.temperature = True, kelvin
    found = np.array(lamp.temperature_color)
    np.testing.assert_allclose(blackbody_color(kelvin), found, atol=0.002 * found.max())


def test_a_lamp_with_a_blackbody_node_has_its_colour() -> None:
    add_square("Floor", (0.5, 0.5, 0.5))
    add_blackbody_lamp(3000)
    scene = extract_scene(bpy.context.scene).scene
    np.testing.assert_allclose(scene.lights[0].intensity, 100 / (4 * math.pi) * blackbody_color(3000), rtol=1e-6)
    assert not scene.warnings


@pytest.mark.parametrize("space", SPACES[1:])
def test_one_scene_in_another_space_is_as_bright(space: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Products of colours, as light is reflected, differ a little between spaces: by 0.25 % here, in Cycles too."""

    def luminance() -> np.ndarray:
        scene = extract_scene(bpy.context.scene).scene
        assert scene.working_space.name == working_space().name
        (page,) = finish(bake(scene, BakeSettings(page_size=96))).pages
        return page @ scene.working_space.luminance_weights

    monkeypatch.setattr(world, "HEIGHT", 256)
    corner_lit_by_everything()
    first = luminance()
    convert(space)
    second = luminance()
    assert np.sqrt(np.mean((second - first) ** 2)) < 0.003 * first.mean()
    assert abs(second.mean() / first.mean() - 1) < 0.002


@pytest.mark.parametrize("space", SPACES)
def test_the_mean_of_an_image_of_bytes_is_in_the_working_space(space: str) -> None:
    convert(space)
    image = bpy.data.images.new("Red", 4, 4)
    image.pixels.foreach_set(np.tile(np.float32([1, 0, 0, 1]), 16))
    mean = image_mean(image)
    assert mean is not None
    np.testing.assert_allclose(working_space().to_xyz @ mean, (0.4124, 0.2126, 0.0193), atol=1e-3)
