# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bent tube that glows throws on itself, against Cycles' own bake of it onto the same page.

Cycles is told not to sample the tube's emission, so that rays find it: sampled, facets of coarse smooth tubes also
light one another from below their horizons, which rays reject.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("bpy", reason="Cycles is part of bpy, which is not installed")
import bpy

from radiosity_addon.bake import bake
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.chunks import finish
from radiosity_addon.settings import BakeSettings
from tests.accuracy.cycles_judge import by_cycles, dark_scene

PAGE = 128
SAMPLES = 256


@pytest.fixture
def tube() -> bpy.types.Object:
    """A ring of 24 x 10 faces, smooth, before a large black wall."""
    dark_scene()
    bpy.ops.mesh.primitive_torus_add(major_segments=24, minor_segments=10, major_radius=0.3, minor_radius=0.1)
    ring = bpy.context.object
    bpy.ops.object.shade_smooth()
    bpy.ops.mesh.primitive_plane_add(size=6, location=(0, 0, -2))
    wall = bpy.context.object
    glow, black = bpy.data.materials.new("Glow"), bpy.data.materials.new("Black")
    for material, color in ((glow, 0.5), (black, 0.0)):
        if bpy.app.version < (5, 0):
            material.use_nodes = True
        nodes, links = material.node_tree.nodes, material.node_tree.links
        nodes.clear()
        diffuse, emission = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeEmission")
        both, output = nodes.new("ShaderNodeAddShader"), nodes.new("ShaderNodeOutputMaterial")
        diffuse.inputs["Color"].default_value = (color, color, color, 1)
        emission.inputs["Color"].default_value = (1, 1, 1, 1)
        emission.inputs["Strength"].default_value = 1.0 if color else 0.0
        links.new(diffuse.outputs[0], both.inputs[0])
        links.new(emission.outputs[0], both.inputs[1])
        links.new(both.outputs[0], output.inputs["Surface"])
    glow.cycles.emission_sampling = "NONE"
    ring.data.materials.append(glow)
    wall.data.materials.append(black)
    return ring


def test_a_ring_that_glows_lights_itself_as_in_cycles(tube: bpy.types.Object) -> None:
    """Where its inner side sees it, and on average; its outer side sees nothing of it."""
    scene = extract_scene(bpy.context.scene).scene
    scene = replace(scene, meshes=tuple(replace(mesh, lightmapped=mesh.name == tube.name) for mesh in scene.meshes))
    baked = finish(bake(scene, BakeSettings(page_size=PAGE, quality="medium", bounces=0)))
    reference = by_cycles(baked, scene, [tube.name], {"DIRECT"}, SAMPLES)
    found = baked.pages[0][:, :, 0]
    there = reference >= 0
    for axis in (0, 1):
        there &= np.roll(there, 1, axis) & np.roll(there, -1, axis)
    assert found[there].mean() == pytest.approx(reference[there].mean(), rel=0.01)
    lit = there & (reference > 0.1)
    assert np.sqrt(np.mean((found[lit] / reference[lit] - 1) ** 2)) < 0.1
    assert found[there & (reference == 0)].mean() < 0.01 * reference[there].mean()
