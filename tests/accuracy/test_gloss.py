# SPDX-License-Identifier: GPL-3.0-or-later
"""What taking gloss as diffuse costs, in a bar of metals.

Lightmaps hold diffuse light, and surfaces send light on as diffuse ones do, with all that they reflect. How much light
there is comes out nearly right, but not where copper and steel throw it. No roughness changes that: a metal as rough as
can be is no Lambertian either. So the bar is held to limits of its own, and to a copy of itself without
gloss in Cycles.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy", reason="bpy reads the scenes, and is not installed")
import bpy

from radiosity_addon.bake import Baked, bake
from radiosity_addon.blender.reading.cycles_shader import CyclesShader
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.chunks import finish
from radiosity_addon.scene import Scene
from radiosity_addon.settings import BakeSettings
from tests.accuracy.comparison import compare, page_at
from tests.accuracy.cycles_judge import measure
from tests.accuracy.make_references import DARK_SHARE
from tests.accuracy.probes import LUMINANCE, POINTS, Probes, References, extent, footprints, rendered_surfaces

HERE = Path(__file__).resolve().parent
PAGE = 768
SAMPLES = 96
REFERENCES = References.load(HERE / "references" / "bar.npz")


@pytest.fixture(scope="module")
def bar() -> tuple[Baked, Scene]:
    bpy.ops.wm.open_mainfile(filepath=str(HERE / "scenes" / "bar.blend"))
    extraction = extract_scene(bpy.context.scene)
    settings = BakeSettings(page_size=PAGE, quality="medium")
    return finish(bake(extraction.scene, settings, CyclesShader(bpy.context.scene.name, extraction))), extraction.scene


def test_gloss_taken_as_diffuse_keeps_nearly_all_light_and_most_places(bar: tuple[Baked, Scene]) -> None:
    found = compare(*bar, REFERENCES)
    assert abs(found.bias) < 0.025, found
    assert found.beyond(0.1) < 0.06, found


def test_what_a_glossy_scene_is_off_by_is_its_gloss(bar: tuple[Baked, Scene]) -> None:
    baked, scene = bar
    probes = Probes(REFERENCES.object, REFERENCES.position, REFERENCES.normal)
    make_diffuse(scene)
    surfaces = rendered_surfaces()
    squares = footprints(surfaces, probes, REFERENCES.footprint)
    there = squares.there
    names = np.repeat(probes.object[:, None], POINTS, axis=1)[there]
    points = Probes(names, squares.points[there], squares.normals[there])
    measured, _ = measure(points, extent(surfaces), SAMPLES, [1], shading=squares.shading[there])
    values = np.zeros(there.shape)
    values[there] = measured[0] @ LUMINANCE
    lit = there & (values > DARK_SHARE * values[there].mean())  # as the reference has it
    mean = REFERENCES.value.mean(axis=0) @ LUMINANCE
    copy = (values * lit).sum(axis=1) / lit.sum(axis=1)
    error = (page_at(baked, scene, probes) @ LUMINANCE - copy) / mean
    assert abs(error.mean()) < 0.006
    assert np.sqrt(np.mean(error**2)) < 0.05


def make_diffuse(scene: Scene) -> None:
    """Give the open scene's materials diffuse shaders that reflect as much as the bake takes them to."""
    for material in scene.materials:
        if any(material.emission):
            continue
        tree = bpy.data.materials[material.name].node_tree
        tree.nodes.clear()
        diffuse, output = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeOutputMaterial")
        diffuse.inputs["Color"].default_value = (*material.reflectance, 1)
        tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
