# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps' records against Cycles: what a tiny receiver gets by the record's closed form is what Cycles bakes."""

from __future__ import annotations

from math import pi

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.scene import AreaLight, Light, SunLight

NEW = bpy.app.version >= (4, 5)
FAR = 30.0
"""m; a lamp of 0.3 m is a point from there, within 0.01 %."""

LAMPS = [
    ("POINT", {"energy": 100, "color": (1, 0.5, 0.2), "shadow_soft_size": 0}, (1, 1, 1)),
    ("POINT", {"energy": 100, "shadow_soft_size": 0.5, "use_soft_falloff": True}, (2, 2, 2)),
    ("SPOT", {"energy": 100, "shadow_soft_size": 0, "spot_size": 0.5, "spot_blend": 0.2}, (1, 2, 1)),
    ("SUN", {"energy": 3, "angle": 0.2}, (2, 2, 2)),
    ("AREA", {"energy": 100, "shape": "SQUARE", "size": 0.1}, (2, 3, 1)),
    ("AREA", {"energy": 100, "shape": "RECTANGLE", "size": 0.1, "size_y": 0.2}, (1, 1, 1)),
    ("AREA", {"energy": 100, "shape": "DISK", "size": 0.2}, (1, 1, 1)),
    ("AREA", {"energy": 100, "shape": "ELLIPSE", "size": 0.1, "size_y": 0.2}, (-1, 1, 1)),
    ("AREA", {"energy": 100, "shape": "SQUARE", "size": 0.02, "spread": 1.0}, (1, 1, 1)),
]
NEW_LAMPS = [
    ("POINT", {"energy": 100, "shadow_soft_size": 0.25, "normalize": False}, (1, 1, 1)),
    ("POINT", {"energy": 100, "shadow_soft_size": 0, "normalize": False}, (1, 1, 1)),
    ("POINT", {"energy": 100, "exposure": 1.5, "use_temperature": True, "temperature": 3000}, (1, 1, 1)),
    ("SUN", {"energy": 3, "angle": 0.5, "normalize": False}, (1, 1, 1)),
    ("SUN", {"energy": 3, "angle": 0, "normalize": False}, (1, 1, 1)),
    ("AREA", {"energy": 100, "shape": "DISK", "size": 0.2, "normalize": False}, (1, 1, 1)),
    ("AREA", {"energy": 100, "size": 0.02, "spread": 1.0, "normalize": False}, (1, 1, 1)),
]


def add_receiver() -> bpy.types.Image:
    """A tiny square at the origin that faces up and bakes onto the image."""
    size = 1e-3
    mesh = bpy.data.meshes.new("receiver")
    mesh.from_pydata([(-size, -size, 0), (size, -size, 0), (size, size, 0), (-size, size, 0)], [], [(0, 1, 2, 3)])
    mesh.uv_layers.new().data.foreach_set("uv", [0, 0, 1, 0, 1, 1, 0, 1])
    material = bpy.data.materials.new("receiver")
    if not NEW or material.node_tree is None:
        material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.active = nodes.new("ShaderNodeTexImage")
    nodes.active.image = bpy.data.images.new("receiver", 8, 8, float_buffer=True, is_data=True)
    mesh.materials.append(material)
    receiver = bpy.data.objects.new("receiver", mesh)
    bpy.context.scene.collection.objects.link(receiver)
    receiver.select_set(True)
    bpy.context.view_layer.objects.active = receiver
    return nodes.active.image


def cycles_irradiance(image: bpy.types.Image) -> np.ndarray:
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_adaptive_sampling, scene.cycles.sample_clamp_direct = 64, False, 0
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT"}, margin=0)
    pixels = np.empty(8 * 8 * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pi * pixels.reshape(-1, 4)[:, :3].mean(axis=0)


def irradiance_below(light: Light) -> np.ndarray:
    """W/m2 at the origin, facing up, of a lamp straight above it that points down."""
    if isinstance(light, SunLight):
        return np.array(light.irradiance) * -light.direction[2]
    squared = light.position[2] ** 2
    if isinstance(light, AreaLight):
        area = np.linalg.norm(light.edge_u) * np.linalg.norm(light.edge_v) * (pi / 4 if light.ellipse else 1)
        return np.array(light.radiance) * area / squared
    soft = 1 / (1 + light.radius**2 / squared) if light.soft_falloff else 1
    return np.array(light.intensity) / squared * soft


@pytest.mark.parametrize(("kind", "values", "scale"), [*LAMPS, *(NEW_LAMPS if NEW else ())])
def test_a_receiver_below_the_lamp_gets_what_cycles_gives(kind, values, scale):
    light = bpy.data.lights.new("lamp", kind)
    for key, value in values.items():
        setattr(light, key, value)
    lamp = bpy.data.objects.new("lamp", light)
    lamp.location, lamp.scale = (0, 0, FAR if kind == "AREA" else 2), scale
    bpy.context.scene.collection.objects.link(lamp)
    image = add_receiver()
    (record,) = extract_scene(bpy.context.scene).scene.lights
    assert irradiance_below(record) == pytest.approx(cycles_irradiance(image), rel=0.005)
