# SPDX-License-Identifier: GPL-3.0-or-later
"""Sheets whose two faces look unlike, in a room that nothing else lights, against Cycles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import pytest

pytest.importorskip("bpy", reason="Cycles is part of bpy, which is not installed")
import bpy

from radiosity_addon.bake import bake
from radiosity_addon.blender.reading.cycles_shader import CyclesShader
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.chunks import finish
from radiosity_addon.settings import BakeSettings
from tests.accuracy.comparison import page_at
from tests.accuracy.cycles_judge import measure
from tests.accuracy.probes import extent, place, rendered_surfaces

Node: TypeAlias = Any
PROBES = 300
SAMPLES = 512


class Sheet:
    """A material for both faces of a sheet."""

    def __init__(self) -> None:
        self.material = bpy.data.materials.new("Sheet")
        if bpy.app.version < (5, 0):
            self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.tree.nodes.clear()

    def node(self, kind: str, *links: Any, **values: object) -> Node:
        """A node, its inputs linked one after the other to what is not None."""
        made = self.tree.nodes.new(f"ShaderNode{kind}")
        for name, value in values.items():
            made.inputs[name].default_value = value
        for link, socket in zip(links, made.inputs, strict=False):
            if link is not None:
                self.tree.links.new(link, socket)
        return made

    @property
    def behind(self) -> Any:
        return self.node("NewGeometry").outputs["Backfacing"]

    def glow(self, *color: float) -> Any:
        return self.node("Emission", Color=(*color, 1), Strength=5.0).outputs[0]

    def paint(self, *color: float) -> Any:
        return self.node("BsdfDiffuse", Color=(*color, 1)).outputs[0]

    def mix(self, share: Any, first: Any, second: Any) -> Any:
        return self.node("MixShader", share, first, second).outputs[0]


def light_panel(sheet: Sheet) -> Any:
    return sheet.mix(sheet.behind, sheet.glow(1, 1, 1), sheet.paint(0.1, 0.7, 0.2))


def two_colours(sheet: Sheet) -> Any:
    return sheet.mix(sheet.behind, sheet.glow(1, 0.1, 0.1), sheet.glow(0.1, 0.1, 0.5))


def computed(sheet: Sheet) -> Any:
    """Strength is 3 in front and nothing behind, by arithmetic on the side."""
    power = sheet.node("Math", None, sheet.behind)
    power.operation, power.inputs[0].default_value = "SUBTRACT", 1.0
    shine = sheet.node("Emission", None, power.outputs[0])
    return sheet.node("AddShader", shine.outputs[0], sheet.paint(0.6, 0.2, 0.2)).outputs[0]


def fresnel(sheet: Sheet) -> Any:
    return sheet.mix(sheet.node("Fresnel", IOR=1.4).outputs[0], sheet.paint(0.5, 0.5, 0.5), sheet.glow(0.2, 1, 0.3))


def one_way(sheet: Sheet) -> Any:
    seen = sheet.node("AddShader", sheet.glow(1, 1, 1), sheet.paint(0.7, 0.6, 0.2)).outputs[0]
    return sheet.mix(sheet.behind, seen, sheet.node("BsdfTransparent").outputs[0])


@pytest.mark.parametrize(
    ("look", "tolerance"),
    [(light_panel, 0.005), (two_colours, 0.005), (computed, 0.005), (one_way, 0.012), (fresnel, 0.03)],
)
def test_both_faces_light_a_room_as_in_cycles(look: Callable[[Sheet], Any], tolerance: float) -> None:
    """On average, on either side of the sheet.

    What Fresnel mixes shines more at some angles, ours at all alike. Light that passes one way is not exchanged between
    patches, but seen by the gather.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    sheet, walls = Sheet(), Sheet()
    for made, shown in ((sheet, look(sheet)), (walls, walls.paint(0.5, 0.5, 0.5))):
        made.node("OutputMaterial", shown)
    bpy.ops.mesh.primitive_cube_add(size=2)
    room = bpy.context.object
    room.data.flip_normals()
    room.data.materials.append(walls.material)
    bpy.ops.mesh.primitive_plane_add(size=0.6, location=(0, 0, 0.1), rotation=(0, 0.6, 0))
    thing = bpy.context.object
    thing.data.materials.append(sheet.material)
    surfaces = rendered_surfaces()
    extraction = extract_scene(bpy.context.scene)
    assert extraction.scene.warnings == ()
    shade = CyclesShader(bpy.context.scene.name, extraction)
    baked = finish(bake(extraction.scene, BakeSettings(page_size=256, quality="medium"), shade))
    probes = place([surface for surface in surfaces if surface.name == room.name], PROBES)
    expected = measure(probes, extent(surfaces), SAMPLES, [1])[0][0]
    found = page_at(baked, extraction.scene, probes)
    way = np.array(thing.matrix_world)[:3, 2]
    before = (probes.position - [0, 0, 0.1]) @ way > 0
    for side in (before, ~before):
        mean = expected[side].mean(0)
        assert found[side].mean(0) == pytest.approx(mean, rel=tolerance, abs=tolerance * mean.max())
