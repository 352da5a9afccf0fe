# SPDX-License-Identifier: GPL-3.0-or-later
"""Direct light where it grazes coarse smooth-shaded surfaces, against Cycles' own bake of them onto the same page.

A ball and a folded sheet of few facets stand with several values of Shadow Terminator > Geometry Offset between a low
sun and an area lamp; then with several of its Shading Offset, in the light of a lamp and of a room, too.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("bpy", reason="Cycles is part of bpy, which is not installed")
import bpy

from radiosity_addon.bake import Baked, bake
from radiosity_addon.blender.reading.cycles_shader import CyclesShader
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.chunks import finish
from radiosity_addon.settings import BakeSettings
from tests.accuracy.cycles_judge import by_cycles, dark_scene

PAGE = 240
SAMPLES = 48
OFFSETS = (0.0, 0.1, 0.5)
"""None, Cycles' default, and one that reaches farther."""


def stand(
    name: str, mesh: bpy.types.Mesh, place: tuple[float, float, float], offset: float, shading: float = 0.0
) -> None:
    thing = bpy.data.objects.new(name, mesh)
    thing.location = place
    thing.shadow_terminator_geometry_offset = offset
    thing.shadow_terminator_shading_offset = shading
    bpy.context.scene.collection.objects.link(thing)


def sheet() -> bpy.types.Mesh:
    """A sheet of three folds, eight facets each."""
    across = np.linspace(-1, 1, 25)
    points = [(x, y, 0.25 * math.cos(3 * math.pi * x)) for x in across for y in (-0.6, 0.0, 0.6)]
    faces = [(3 * i + j, 3 * i + 3 + j, 3 * i + 4 + j, 3 * i + 1 + j) for i in range(24) for j in range(2)]
    mesh = bpy.data.meshes.new("Sheet")
    mesh.from_pydata(points, [], faces, shade_flat=False)
    return mesh


def ball() -> bpy.types.Mesh:
    bpy.ops.mesh.primitive_uv_sphere_add(segments=12, ring_count=8)
    made = bpy.context.object
    bpy.ops.object.shade_smooth()
    mesh = made.data.copy()
    bpy.data.objects.remove(made)
    return mesh


def shine(kind: str, strength: float, place: tuple[float, float, float], turn: tuple[float, float, float]) -> None:
    lamp = bpy.data.objects.new(kind, bpy.data.lights.new(kind, kind))
    lamp.data.energy, lamp.location, lamp.rotation_euler = strength, place, turn
    bpy.context.scene.collection.objects.link(lamp)


@pytest.fixture(scope="module")
def lit() -> tuple[Baked, Baked, np.ndarray]:
    """Our bake, one that knows of no offsets, and what Cycles says: (PAGE, PAGE), -1 where there is no texel."""
    scene = dark_scene()
    for row, offset in enumerate(OFFSETS):
        stand("Ball", ball(), (0.0, 4.0 * row, 0.0), offset)
        stand("Sheet", sheet(), (0.0, 2.0 + 4.0 * row, 0.0), offset)
    shine("SUN", 3.0, (0.0, 0.0, 0.0), (0.3, math.radians(-65), 0.0))
    shine("AREA", 900.0, (6.0, 5.0, 2.0), (0.0, math.radians(72), 0.0))
    bpy.data.lights["SUN"].angle = 0.02
    extraction = extract_scene(scene)
    settings = BakeSettings(page_size=PAGE, quality="medium", bounces=0)
    found = extraction.scene
    flat = replace(found, meshes=tuple(replace(mesh, terminator=None) for mesh in found.meshes))
    bakes = [finish(bake(each, settings, CyclesShader(scene, extraction))) for each in (found, flat)]
    return bakes[0], bakes[1], by_cycles(bakes[0], found, [mesh.name for mesh in found.meshes], {"DIRECT"}, SAMPLES)


def test_light_that_grazes_smooth_surfaces_is_as_in_cycles_own_bake(lit: tuple[Baked, Baked, np.ndarray]) -> None:
    """At texels within charts: at their edges Cycles' samples stay on this side."""
    found, without, reference = lit[0].pages[0][:, :, 0], lit[1].pages[0][:, :, 0], lit[2]
    within = reference >= 0
    for axis in (0, 1):
        within &= np.roll(within, 1, axis) & np.roll(within, -1, axis)
    mean = reference[within].mean()
    error, more = (found - reference) / mean, (found - without) / mean
    assert abs(error[within].mean()) < 0.002
    grazed = within & (np.abs(more) > 0.02)
    assert grazed.sum() > 500
    assert abs(error[grazed].mean()) < 0.15 * more[grazed].mean()
    assert np.sqrt(np.mean(error[grazed] ** 2)) < 0.3 * np.sqrt(np.mean(more[grazed] ** 2))


SHADINGS = (0.0, 0.3, 1.0)


@pytest.mark.parametrize("kind", ["SUN", "POINT", "AREA"])
def test_a_shading_offset_fades_light_out_before_it_grazes_as_in_cycles_own_bake(kind: str) -> None:
    scene = dark_scene()
    for row, shading in enumerate(SHADINGS):
        stand(f"Ball {row}", ball(), (0.0, 3.0 * row, 0.0), 0.1, shading)
    strength = {"SUN": 3.0, "POINT": 900.0, "AREA": 900.0}[kind]
    shine(kind, strength, (4.0, 3.0, 2.0), (0.3, math.radians(65), 0.0))
    if kind == "AREA":
        bpy.data.lights[kind].size = 2.0
    extraction = extract_scene(scene)
    found = extraction.scene
    baked = finish(
        bake(found, BakeSettings(page_size=PAGE // 2, quality="medium", bounces=0), CyclesShader(scene, extraction))
    )
    reference = by_cycles(baked, found, [mesh.name for mesh in found.meshes], {"DIRECT"}, SAMPLES)
    mean = per_mesh(baked, np.where(reference >= 0, reference, 0)) / per_mesh(baked, reference >= 0)
    ours = per_mesh(baked, np.where(reference >= 0, baked.pages[0][:, :, 0], 0)) / per_mesh(baked, reference >= 0)
    assert ours == pytest.approx(mean, rel=0.01)


def per_mesh(baked: Baked, page: np.ndarray) -> np.ndarray:
    """Sums over the texels of each mesh."""
    texels = baked.elements
    mesh = texels.surfaces.mesh[texels.triangle[:]]
    return np.bincount(mesh, page.reshape(-1)[texels.pixel].astype(float))
