# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects hidden from some rays, under sun and sky: a floor has the light that Cycles bakes."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from radiosity_addon.blender.reading.extract import extract_scene  # noqa: E402
from tests.bakes import lit  # noqa: E402

SIZE = 8
SAMPLES = 4096
NOISE = 0.025
"""Relative, of four texels: 0.5 % was found in Blender 5.2, 1.95 % in 4.5."""


def stage() -> tuple[bpy.types.Object, bpy.types.Object]:
    """A floor of 4 m, and a cover of 2 m that hangs 1 m above it."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("Sky")
    if scene.world.node_tree is None:
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs[0].default_value = (1, 1, 1, 1)
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy = 3
    scene.collection.objects.link(bpy.data.objects.new("Sun", sun))
    bpy.ops.mesh.primitive_plane_add(size=2, location=(0, 0, 1))
    cover = bpy.context.object
    bpy.ops.mesh.primitive_plane_add(size=4)
    floor = bpy.context.object
    floor.name = "Floor"
    material = bpy.data.materials.new("Floor")
    if material.node_tree is None:
        material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    end = nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(nodes.new("ShaderNodeBsdfDiffuse").outputs[0], end.inputs["Surface"])
    floor.data.materials.append(material)
    return floor, cover


def by_cycles(floor: bpy.types.Object) -> float:
    """H / pi in the middle of the floor."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples = "CYCLES", SAMPLES
    image = bpy.data.images.new("baked", SIZE, SIZE, float_buffer=True, is_data=True)
    nodes = floor.data.materials[0].node_tree.nodes
    nodes.active = nodes.new("ShaderNodeTexImage")
    nodes.active.image = image
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, margin=0)
    nodes.remove(nodes.active)
    half = SIZE // 2
    return float(np.array(image.pixels[:]).reshape(SIZE, SIZE, 4)[half - 1 : half + 1, half - 1 : half + 1, 0].mean())


@pytest.mark.parametrize("diffuse", [True, False], ids=["diffuse", "no diffuse"])
@pytest.mark.parametrize("shadow", [True, False], ids=["shadow", "no shadow"])
def test_a_floor_below_a_cover_has_the_light_of_cycles(diffuse: bool, shadow: bool) -> None:
    floor, cover = stage()
    cover.visible_diffuse, cover.visible_shadow = diffuse, shadow
    wanted = by_cycles(floor)
    scene = extract_scene(bpy.context.scene).scene
    found = lit(scene, quality="medium", page_size=128)
    index = [mesh.name for mesh in scene.meshes].index("Floor")
    middle = (found.mesh == index) & (np.abs(found.position[:, :2]).max(1) < SIZE / 4 / 4)
    assert found.light[middle].mean() == pytest.approx(wanted, rel=NOISE)
