# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole bakes of textured scenes: the light of surfaces cut up into their colours, and nothing left behind."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from radiosity_addon.arrays import Float32
from radiosity_addon.bake import bake
from radiosity_addon.blender.job import Job, bake_scene
from radiosity_addon.blender.reading.cycles_shader import CyclesShader
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.chunks import finish
from radiosity_addon.files import Transaction
from radiosity_addon.settings import BakeSettings
from tests.blender.datablocks import differences, snapshot
from tests.blender.materials import shader

DRAFT = BakeSettings(page_size=64, quality="draft")


def panel(
    name: str, corner: object, edge_u: object, edge_v: object, *materials: bpy.types.Material
) -> bpy.types.Object:
    """A parallelogram of as many equal strips along u as materials, each shown over 0..1 of u and v."""
    corner, edge_u, edge_v = (np.array(part, float) for part in (corner, edge_u, edge_v))
    count = len(materials)
    corners = [corner + k / count * edge_u + side * edge_v for k in range(count + 1) for side in (0, 1)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], [(2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1) for k in range(count)])
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", np.float32([0, 0, 1, 0, 1, 1, 0, 1] * count))
    for index, material in enumerate(materials):
        mesh.materials.append(material)
        mesh.polygons[index].material_index = index
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def striped(name: str, kind: str, colors: list[tuple[float, float, float]]) -> bpy.types.Material:
    """A shader whose Color is an image of vertical stripes."""
    material = shader(name, kind)
    image = bpy.data.images.new(name, len(colors), 1, float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.float32([(*color, 1) for color in colors]).ravel())
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image, node.interpolation = image, "Closest"
    target = next(node for node in material.node_tree.nodes if "Color" in node.inputs)
    material.node_tree.links.new(node.outputs["Color"], target.inputs["Color"])
    return material


def wall_before(*panels: bpy.types.Object) -> Float32:
    """The page of a wall that faces the panels: they only shadow, bounce and shine."""
    wall = panel("Wall", (0, 0, 0), (4, 0, 0), (0, 0, 2), shader("White", "ShaderNodeBsdfDiffuse"))
    for thing in panels:
        thing.radiosity.only_casts = True
    bpy.context.view_layer.update()
    extraction = extract_scene(bpy.context.scene)
    baked = finish(bake(extraction.scene, DRAFT, CyclesShader(bpy.context.scene.name, extraction)))
    assert baked.warnings == ()
    for thing in (wall, *panels):
        bpy.data.objects.remove(thing)
    return baked.pages[0]


COLORS = [(0.8, 0.1, 0.05), (0.1, 0.7, 0.6)]
FLOOR = (0, -2, 0), (4, 0, 0), (0, 2, 0)
SCREEN = (1.5, -1.5, 0.5), (0, 0, 1), (1, 0, 0)


def sun() -> None:
    lamp = bpy.data.lights.new("Sun", "SUN")
    lamp.energy = 5
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Sun", lamp))


def test_a_striped_floor_colours_a_wall_as_two_floors_do():
    sun()
    cut = wall_before(panel("Cut", *FLOOR, *(shader("Half", "ShaderNodeBsdfDiffuse", Color=(*c, 1)) for c in COLORS)))
    whole = wall_before(panel("Whole", *FLOOR, striped("Stripes", "ShaderNodeBsdfDiffuse", COLORS)))
    assert cut[:, :, 0].max() > 0.05
    assert whole.mean((0, 1)) == pytest.approx(cut.mean((0, 1)), rel=0.03)
    assert np.abs(whole - cut).mean() < 0.1 * cut.mean()  # the floor's texels are coarse, and so is where colours meet


def test_a_striped_screen_lights_a_wall_as_two_lamps_do():
    halves = (shader("Half", "ShaderNodeEmission", Color=(*color, 1)) for color in COLORS)
    cut = wall_before(panel("Cut", *SCREEN, *halves))
    whole = wall_before(panel("Whole", *SCREEN, striped("Stripes", "ShaderNodeEmission", COLORS)))
    assert cut.mean() > 0.01
    assert np.abs(whole - cut).mean() < 0.01 * cut.mean()


@pytest.mark.parametrize("last", ["Materials", "Direct light", "Write back"])
def test_a_bake_that_is_closed_leaves_nothing(last: str, tmp_path: Path):
    sun()
    panel("Floor", *FLOOR, striped("Stripes", "ShaderNodeBsdfDiffuse", COLORS))
    before = snapshot()
    with Transaction() as files:
        steps = bake_scene(bpy.context.scene, Job(DRAFT, "preview", tmp_path, "page"), files)
        assert any(progress.stage == last for progress in steps)
        steps.close()
    assert differences(before, snapshot()) == []
