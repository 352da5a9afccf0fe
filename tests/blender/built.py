# SPDX-License-Identifier: GPL-3.0-or-later
"""Small things made with bpy, for the tests that read them."""

from __future__ import annotations

import bpy

from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.blender.reading.extraction import Extraction
from tests.blender.materials import shader

QUAD = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]


def add_mesh(name="Quad", vertices=QUAD, faces=((0, 1, 2, 3),), **placed) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], list(faces))
    return add(bpy.data.objects.new(name, mesh), **placed)


def add_lamp(kind: str, name="Lamp", location=(0, 0, 2), scale=(1, 1, 1), **values) -> bpy.types.Object:
    light = bpy.data.lights.new(name, kind)
    for key, value in values.items():
        setattr(light, key, value)
    return add(bpy.data.objects.new(name, light), location=location, scale=scale)


def add(thing: bpy.types.Object, **placed) -> bpy.types.Object:
    for key, value in placed.items():
        setattr(thing, key, value)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def extract(only=None) -> Extraction:
    return extract_scene(bpy.context.scene, only)


def emission(name: str, strength: float) -> bpy.types.Material:
    return shader(name, "ShaderNodeEmission", Strength=strength)
