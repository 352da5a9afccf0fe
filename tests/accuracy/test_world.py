# SPDX-License-Identifier: GPL-3.0-or-later
"""Skies against Cycles: what tilted receivers in the open get from the lamps and the map that the core is handed."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

pytest.importorskip("bpy", reason="bpy renders the skies, and is not installed")
import bpy

from radiosity_addon.blender.reading.subject import Subject
from radiosity_addon.blender.reading.world import HEIGHT, render_sky
from radiosity_addon.chunks import finish
from radiosity_addon.lighting.sky import Sky, sky_of
from radiosity_addon.scene import World
from tests.accuracy.cycles_judge import measure
from tests.accuracy.probes import Probes
from tests.test_sky import light_of, ways

SUNNY = ("NISHITA",) if bpy.app.version < (5, 0) else ("SINGLE_SCATTERING", "MULTIPLE_SCATTERING")
NORMALS = np.array([[0, 0, 1], [0, -1, 0], [0.6, 0, 0.8], [-0.6, 0, -0.8], [0.5**0.5, 0.5**0.5, 0]])
SAMPLES = 32768
SIZE = 100.0
"""m, which the probes take their size from: large enough for exact normals in float32."""


@pytest.fixture
def background() -> bpy.types.Node:
    """The Background node of the world of an empty scene."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    world = bpy.context.scene.world = bpy.data.worlds.new("World")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        world.use_nodes = True
    return next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")


def add(background: bpy.types.Node, kind: str) -> bpy.types.Node:
    """A node whose colour the background shows."""
    node = background.id_data.nodes.new(kind)
    background.id_data.links.new(node.outputs[0], background.inputs["Color"])
    return node


def errors() -> np.ndarray:
    """(5,) of the irradiance on receivers of different tilts, as shares of Cycles' own."""
    place = np.arange(len(NORMALS))[:, None] * [1.0, 0, 0]
    values, _ = measure(Probes(np.repeat("", len(NORMALS)), place, NORMALS), SIZE, SAMPLES, [1], threads=2)
    scene = bpy.context.scene
    tiles, _ = finish(render_sky(Subject.of(scene, {"world": scene.world}), HEIGHT))
    sky = sky_of(World(sky=tiles))
    assert isinstance(sky, Sky)
    found = np.array([light_of(sky, normal) for normal in NORMALS]) / np.pi
    return (found / values[0] - 1).mean(axis=1)


@pytest.mark.parametrize("kind", [*SUNNY, "PREETHAM", "HOSEK_WILKIE"])
def test_sky_textures_light_as_in_cycles(background: bpy.types.Node, kind: str) -> None:
    sky = add(background, "ShaderNodeTexSky")
    sky.sky_type = kind
    if kind in SUNNY:
        sky.sun_elevation, sky.sun_rotation = math.radians(25), 0.7
    assert np.abs(errors()).max() < 0.004  # the noise of the reference is 0.1 %


def test_an_image_with_a_sharp_sun_lights_as_in_cycles(background: bpy.types.Node) -> None:
    way = ways(256)
    light = np.where(way[:, :, 2] > 0, 0.6 + 0.8 * (1 - way[:, :, 2]) ** 4, 0.2)
    light[200, 130] += 3e4
    image = bpy.data.images.new("Sky", 512, 256, float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.repeat(light[:, :, None], 4, axis=2).astype(np.float32).reshape(-1))
    add(background, "ShaderNodeTexEnvironment").image = image
    assert np.abs(errors()).max() < 0.004
