# SPDX-License-Identifier: GPL-3.0-or-later
"""What the scene scripts share: an empty file, objects from points and faces, plain materials, saving."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import bpy

Point = tuple[float, float, float]
RGB = tuple[float, float, float]


def empty_scene() -> bpy.types.Scene:
    """A factory-fresh scene without objects, rendered by Cycles on the processor."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.unit_settings.system = "METRIC"
    return scene


def sky(scene: bpy.types.Scene, color: RGB, strength: float = 1.0) -> None:
    """Give the scene a world of one colour (linear), radiance color * strength, W/(m2 sr)."""
    world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (*color, 1.0)
    background.inputs["Strength"].default_value = strength
    world.color = color
    scene.world = world


def material(name: str, shader: str, **inputs: float | RGB) -> bpy.types.Material:
    """A material of one shader node: `shader` as in bpy ("ShaderNodeBsdfDiffuse"), inputs by name with _ for space."""
    made = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    node = tree.nodes.new(shader)
    for key, value in inputs.items():
        socket = node.inputs[key.replace("_", " ")]
        socket.default_value = (*value, 1.0) if isinstance(value, tuple) else value
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.location = (300, 0)
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    color = inputs.get("Color", inputs.get("Base_Color", (0.8, 0.8, 0.8)))
    made.diffuse_color = (*color, 1.0)
    return made


def diffuse(name: str, color: RGB) -> bpy.types.Material:
    """A Diffuse BSDF of one linear colour."""
    return material(name, "ShaderNodeBsdfDiffuse", Color=color, Roughness=0.0)


def put(name: str, data: bpy.types.ID | None, location: Point = (0, 0, 0), **attributes: object) -> bpy.types.Object:
    """A new object in the scene's collection, with further object attributes by name."""
    made = bpy.data.objects.new(name, data)
    made.location = location
    for key, value in attributes.items():
        setattr(made, key, value)
    bpy.context.scene.collection.objects.link(made)
    return made


def mesh_object(
    name: str,
    points: Sequence[Point],
    faces: Sequence[Sequence[int]],
    materials: bpy.types.Material | Sequence[bpy.types.Material],
    location: Point = (0, 0, 0),
    **attributes: object,
) -> bpy.types.Object:
    """A mesh object of the given points, m, and faces."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    for each in [materials] if isinstance(materials, bpy.types.Material) else materials:
        mesh.materials.append(each)
    mesh.update()
    return put(name, mesh, location, **attributes)


def write_when_run(build: Callable[[], object], script: str) -> None:
    """Build a scene and save it beside its script, or where the last argument says; compressed, and atomically."""
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    blend = [Path(argument) for argument in arguments if argument.endswith(".blend")]
    target = blend[-1] if blend else Path(script).with_suffix(".blend")
    build()
    with tempfile.TemporaryDirectory() as folder:  # a .blend remembers where it was saved: nowhere in particular
        saved = os.path.join(folder, target.name)
        bpy.context.preferences.filepaths.save_version = 0
        bpy.ops.wm.save_as_mainfile(filepath=saved, compress=True, copy=True)
        shutil.copyfile(saved, target.with_suffix(".blend.new"))
    os.replace(target.with_suffix(".blend.new"), target)
