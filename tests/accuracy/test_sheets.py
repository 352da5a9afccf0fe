# SPDX-License-Identifier: GPL-3.0-or-later
"""What comes through a sheet of the Translucent BSDF, against Cycles' own bake of diffuse light onto the same page.

A page holds (rho E + tau E') / (rho + tau) / pi of the light on its side and on the other one, as Cycles' bake without
colour does, and a room lit through a sheet alone has the light that tau tells.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("bpy", reason="Cycles is part of bpy, which is not installed")
import bpy

from radiosity_addon.bake import bake
from radiosity_addon.blender.reading.cycles_shader import CyclesShader
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.chunks import finish
from radiosity_addon.settings import BakeSettings
from tests.accuracy.cycles_judge import by_cycles, dark_scene

PAGE = 96
SAMPLES = 512
BACK, THROUGH = (0.6, 0.6, 0.7), (0.8, 0.5, 0.2)
"""Colours of the closures that a paper is an even mix of."""


def material(name: str, texture: bool = False) -> bpy.types.Material:
    """Paper, the light that comes through it perhaps with a picture; or grey for any other name."""
    made = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    nodes.clear()
    output, diffuse = nodes.new("ShaderNodeOutputMaterial"), nodes.new("ShaderNodeBsdfDiffuse")
    if name != "Paper":
        links.new(diffuse.outputs[0], output.inputs["Surface"])
        return made
    diffuse.inputs["Color"].default_value = (*BACK, 1)
    through, mix = nodes.new("ShaderNodeBsdfTranslucent"), nodes.new("ShaderNodeMixShader")
    through.inputs["Color"].default_value = (*THROUGH, 1)
    if texture:
        checker = nodes.new("ShaderNodeTexChecker")
        checker.inputs["Scale"].default_value = 2.0
        checker.inputs["Color1"].default_value = (*THROUGH, 1)
        checker.inputs["Color2"].default_value = (0.1, 0.1, 0.1, 1)
        links.new(checker.outputs["Color"], through.inputs["Color"])
    links.new(diffuse.outputs[0], mix.inputs[1])
    links.new(through.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], output.inputs["Surface"])
    return made


@pytest.mark.parametrize(
    ("turn", "texture"), [(0.0, False), (math.pi, True)], ids=["towards the lamp", "away from it, textured"]
)
def test_either_side_of_a_sheet_holds_what_cycles_bakes_and_the_floor_what_comes_through(
    turn: float, texture: bool
) -> None:
    """A sheet between a lamp and a floor that it shades wholly. The floor errs by what a gather on small pages does."""
    scene = dark_scene()
    for name, size, height, look in (("Sheet", 2, 1, material("Paper", texture)), ("Floor", 2, 0, material("Grey"))):
        bpy.ops.mesh.primitive_plane_add(size=size, location=(0, 0, height))
        bpy.context.object.name = name
        bpy.context.object.data.materials.append(look)
    bpy.data.objects["Sheet"].rotation_euler = (turn, 0, 0)
    lamp = bpy.data.lights.new("Lamp", "AREA")
    lamp.energy, lamp.size = 100, 0.5
    hung = bpy.data.objects.new("Lamp", lamp)
    hung.location = (0.3, 0, 2)
    scene.collection.objects.link(hung)
    bpy.context.view_layer.update()
    extraction = extract_scene(scene)
    settings = BakeSettings(page_size=PAGE, quality="high")
    baked = finish(bake(extraction.scene, settings, CyclesShader(scene.name, extraction)))
    assert len(baked.pages) == 1
    for name, most in (("Sheet", 0.006), ("Floor", 0.02)):
        reference = by_cycles(baked, extraction.scene, [name], {"DIRECT", "INDIRECT"}, SAMPLES)
        there = reference >= 0
        for axis in (0, 1):
            there &= np.roll(there, 1, axis) & np.roll(there, -1, axis)
        found, wanted = baked.pages[0][:, :, 0][there], reference[there]
        assert found.mean() == pytest.approx(wanted.mean(), rel=most)
