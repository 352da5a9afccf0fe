# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps of every kind against Cycles: probes below them, level and tilted, unshadowed."""

from __future__ import annotations

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from radiosity_addon.blender.extract import extract_scene  # noqa: E402
from radiosity_addon.lights import lamps_of  # noqa: E402
from radiosity_addon.surfaces import flatten  # noqa: E402
from tests.accuracy.probes import LIFT_SHARE, Probes, judge, probe_mesh  # noqa: E402

SAMPLES = 4096
SIZE = 4.0
"""m, of the scene, from which probes take their size."""
TOLERANCE = 0.005

LAMPS = {
    "point": ("POINT", {"shadow_soft_size": 0.0}),
    "soft point": ("POINT", {"shadow_soft_size": 0.5}),
    "sphere": ("POINT", {"shadow_soft_size": 0.5, "use_soft_falloff": False}),
    "low sphere": ("POINT", {"shadow_soft_size": 0.9, "use_soft_falloff": False}),
    "spot": ("SPOT", {"shadow_soft_size": 0.0, "spot_size": 1.4, "spot_blend": 0.6}),
    "hard spot": ("SPOT", {"shadow_soft_size": 0.0, "spot_size": 1.4, "spot_blend": 0.0}),
    "soft spot": ("SPOT", {"shadow_soft_size": 0.3, "spot_size": 1.4, "spot_blend": 0.6}),
    "sphere spot": ("SPOT", {"shadow_soft_size": 0.3, "spot_size": 1.4, "spot_blend": 0.6, "use_soft_falloff": False}),
    "stretched spot": ("SPOT", {"shadow_soft_size": 0.1, "spot_size": 1.4, "spot_blend": 0.5, "scale": (1, 2, 0.7)}),
    "hard wide spot": ("SPOT", {"shadow_soft_size": 0.4, "spot_size": 1.4, "spot_blend": 0.0}),
    "sun": ("SUN", {"angle": 0.0}),
    "wide sun": ("SUN", {"angle": 1.0}),
    "rectangle": ("AREA", {"shape": "RECTANGLE", "size": 1.5, "size_y": 0.7}),
    "scaled square": ("AREA", {"shape": "SQUARE", "size": 0.5, "scale": (2, 3, 1)}),
    "disc": ("AREA", {"shape": "DISK", "size": 1.2}),
    "ellipse": ("AREA", {"shape": "ELLIPSE", "size": 1.5, "size_y": 0.7}),
    "softbox": ("AREA", {"shape": "RECTANGLE", "size": 1.5, "size_y": 0.7, "spread": 1.5}),
    "narrow softbox": ("AREA", {"shape": "RECTANGLE", "size": 1.5, "size_y": 0.7, "spread": 0.3}),
    "round softbox": ("AREA", {"shape": "ELLIPSE", "size": 1.5, "size_y": 0.7, "spread": 1.0}),
    "beam": ("AREA", {"shape": "SQUARE", "size": 1.5, "spread": math.radians(2)}),
}


def probes() -> Probes:
    """A grid of 36 points on the floor, a third of them level, the others tilted to and fro."""
    grid = np.linspace(-1.3, 1.4, 6)
    x, y = (part.ravel() for part in np.meshgrid(grid, grid))
    position = np.stack([x, y, 0 * x], axis=1)
    tilt = np.where(np.arange(36) % 3 == 0, 0, np.where(np.arange(36) % 3 == 1, 0.7, 1.3))
    turn = 2.4 * np.arange(36)
    normal = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=1)
    return Probes(np.array(["probe"] * 36), position, normal)


def add_lamp(kind: str, values: dict) -> None:
    light = bpy.data.lights.new("lamp", kind)
    light.energy = 3 if kind == "SUN" else 100
    values = dict(values)
    lamp = bpy.data.objects.new("lamp", light)
    lamp.scale = values.pop("scale", (1, 1, 1))
    lamp.location, lamp.rotation_euler = (0.1, 0.05, 1.0), (0.3, 0.2, 0.5)
    for key, value in values.items():
        setattr(light, key, value)
    bpy.context.scene.collection.objects.link(lamp)


def add_floor(size: float = 1.0) -> None:
    """Far below the probes, because a scene without a dull face can't be baked."""
    mesh = bpy.data.meshes.new("floor")
    mesh.from_pydata([(-size, -size, -9), (size, -size, -9), (0, size, -9)], [], [(0, 1, 2)])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("floor", mesh))


def cycles_direct(points: Probes) -> np.ndarray:
    """(N, 3) irradiance, W/m2."""
    made, image = probe_mesh(points, SIZE)
    judge(bpy.context.scene, SAMPLES, 1, 2)
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT"}, target="IMAGE_TEXTURES", margin=0, use_clear=True)
    pixels = np.empty(4 * image.size[0] * image.size[1], np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.objects.remove(made)
    return math.pi * pixels.reshape(-1, 4)[: len(points.position), :3].astype(np.float64)


def found_and_expected() -> tuple[np.ndarray, np.ndarray]:
    """Irradiance of the scene's one lamp at the probes (N,), red channel: ours and Cycles'."""
    scene = extract_scene(bpy.context.scene).scene
    surfaces = flatten(scene)
    (lamp,) = lamps_of(scene.moved(-surfaces.origin), surfaces).lamps
    points = probes()
    position = points.position + SIZE * LIFT_SHARE * points.normal - surfaces.origin
    light = lamp.light(position.astype(np.float32), points.normal.astype(np.float32), None)
    return light * lamp.strength[0], cycles_direct(points)[:, 0]


def add_emitter(shape: str) -> None:
    """A glowing mesh where the lamps hang."""
    if shape == "ball":
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, radius=0.4, location=(0.1, 0.05, 1))
    elif shape == "cube":
        bpy.ops.mesh.primitive_cube_add(size=0.6, location=(0.1, 0.05, 1), rotation=(0.3, 0.2, 0.5))
    else:
        bpy.ops.mesh.primitive_plane_add(size=0.8, location=(0.1, 0.05, 1), rotation=(0.3, 0.2, 0.5))
    material = bpy.data.materials.new("glow")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    emission, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    emission.inputs["Strength"].default_value = 10
    material.node_tree.links.new(emission.outputs[0], output.inputs["Surface"])
    bpy.context.object.data.materials.append(material)


@pytest.mark.parametrize("shape", ["ball", "cube", "plane"])
def test_an_emissive_mesh_gives_what_cycles_gives(shape: str) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_emitter(shape)
    add_floor(9.0)
    bpy.context.view_layer.update()
    found, expected = found_and_expected()
    assert np.abs(found - expected).max() < 2 * TOLERANCE * expected.max()
    assert found.sum() == pytest.approx(expected.sum(), rel=TOLERANCE)


@pytest.mark.parametrize("name", LAMPS)
def test_an_unshadowed_lamp_gives_what_cycles_gives(name: str) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_lamp(*LAMPS[name])
    add_floor()
    bpy.context.view_layer.update()
    found, expected = found_and_expected()
    assert np.abs(found - expected).max() < TOLERANCE * expected.max()
    assert found.sum() == pytest.approx(expected.sum(), rel=TOLERANCE)
