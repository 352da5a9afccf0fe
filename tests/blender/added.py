# SPDX-License-Identifier: GPL-3.0-or-later
"""What tests of reading a scene add to it and look at."""

from __future__ import annotations

import bpy

from tests.blender.built import add_mesh


def add_cube(name="Cube", **placed) -> bpy.types.Object:
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return add_mesh(name, corners, faces, **placed)


def snapshot() -> dict[str, object]:
    scene = bpy.context.scene
    kinds = ("scenes", "objects", "cameras", "images", "worlds", "collections", "meshes", "materials", "node_groups")
    return {
        "data": {kind: sorted(thing.name for thing in getattr(bpy.data, kind)) for kind in kinds},
        "scene": (scene.render.engine, scene.camera, scene.render.resolution_x, scene.frame_current),
        "hidden": {thing.name: (thing.hide_render, thing.hide_viewport) for thing in scene.objects},
        "selected": sorted(thing.name for thing in bpy.context.selected_objects),
        "active": bpy.context.view_layer.objects.active,
    }
