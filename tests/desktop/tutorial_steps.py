# SPDX-License-Identifier: GPL-3.0-or-later
"""The first steps of docs/tutorial.md, by the operators behind its menus and keys: from the default cube to a room."""

from __future__ import annotations

import math

import bpy
from mathutils import Vector

ROOM_SIZE = 6.0
FRONT = (Vector((1, 0, 0)), Vector((0, -1, 0)))
"""Where the two walls are that stand between the default view and the cube."""


def build_room() -> None:
    """Add > Mesh > Cube, 6 m, at Z = 2 m; then take away the two front walls and turn the others inward."""
    bpy.ops.mesh.primitive_cube_add(size=ROOM_SIZE, location=(0, 0, 2))
    room = bpy.context.object
    room.name = "Room"
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.flip_normals()
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    for face in room.data.polygons:  # two clicks
        face.select = any(face.center.normalized().dot(side) > 0.9 for side in FRONT)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.delete(type="FACE")
    bpy.ops.object.mode_set(mode="OBJECT")


def color_cube() -> None:
    """The cube's Base Color."""
    shader = bpy.data.objects["Cube"].active_material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (0.8, 0.1, 0.03, 1.0)


def place_lamp() -> None:
    """The default light becomes a window in the left wall."""
    light = bpy.data.objects["Light"]
    light.location = (-2.9, 0, 2)
    light.rotation_euler = (0, math.radians(-90), 0)
    light.data.type = "AREA"
    lamp = bpy.data.objects["Light"].data
    lamp.energy, lamp.size = 500, 3


def select_lamp() -> None:
    """Click the light in the outliner."""
    bpy.ops.object.select_all(action="DESELECT")
    light = bpy.data.objects["Light"]
    light.select_set(True)
    bpy.context.view_layer.objects.active = light


def deselect() -> None:
    """Click where nothing is."""
    bpy.ops.object.select_all(action="DESELECT")
