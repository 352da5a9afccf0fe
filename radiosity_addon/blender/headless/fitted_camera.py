# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera for scenes that have none: sees the objects from outside, through an open side, or from inside a room."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy
from mathutils import Matrix, Vector

VIEW_FROM = Vector((-0.55, -1.0, 0.45))
"""Direction from objects in the open to the camera: in front, from the left, a little from above."""
SIDES = [Vector(side) for side in ((0, -1, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, 0, 1))]
"""Where a room may be open, tried in this order."""
CORNERS = [Vector(corner).normalized() for corner in ((-1, -1, 0.15), (1, -1, 0.15), (-1, 1, 0.15), (1, 1, 0.15))]
"""Where to stand in a closed room, seen from its middle."""
RAYS = 256
ROOM_SHARE = 0.6
"""Objects around their middle are a room if they block at least this share of all directions."""
MAX_BACKS = 8
"""Backs of surfaces that a ray passes through at most."""
OPEN_CONE = math.cos(math.radians(30))
OPEN_SHARE = 0.9
"""A side is open if this share of the directions around it is clear."""
STEP_BACK = 0.85
"""Share of the way to the wall at which a camera in a room stands."""
WIDE_ANGLE = math.radians(85)


@contextmanager
def fitted_camera(scene: bpy.types.Scene, objects: Sequence[bpy.types.Object]) -> Iterator[None]:
    """Within, the scene has a camera that looks at the objects."""
    data = bpy.data.cameras.new("Radiosity")
    camera = bpy.data.objects.new("Radiosity", data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    try:
        _place(camera, scene, [thing.matrix_world @ Vector(corner) for thing in objects for corner in thing.bound_box])
        yield
    finally:
        scene.camera = None
        bpy.data.cameras.remove(data)  # takes its object along


def _place(camera: bpy.types.Object, scene: bpy.types.Scene, corners: Sequence[Vector]) -> None:
    low = Vector([min(corner[axis] for corner in corners) for axis in range(3)])
    high = Vector([max(corner[axis] for corner in corners) for axis in range(3)])
    middle, size = (low + high) / 2, (high - low).length
    camera.data.clip_start, camera.data.clip_end = size * 1e-3, size * 20
    depsgraph = bpy.context.evaluated_depsgraph_get()

    def clear_way(direction: Vector) -> float:
        """Way to the first front of a surface: the middle may lie inside a thing, whose back is no wall."""
        start = middle
        for _ in range(MAX_BACKS):
            hit, start, normal, *_ = scene.ray_cast(depsgraph, start, direction)
            if not hit:
                return math.inf
            if normal @ direction < 0:
                return (start - middle).length
            start = start + direction * (size * 1e-5)
        return math.inf

    ways = [(direction, clear_way(direction)) for direction in _directions()]
    blocked = sum(math.isfinite(way) for _, way in ways) / RAYS
    open_sides = [
        side
        for side in SIDES
        if _share(math.isinf(way) for direction, way in ways if direction @ side > OPEN_CONE) >= OPEN_SHARE
    ]
    if blocked < ROOM_SHARE or open_sides:
        view_from = VIEW_FROM if blocked < ROOM_SHARE else open_sides[0]
        turn = view_from.to_track_quat("Z", "Y").to_matrix().to_4x4()
        camera.matrix_world = Matrix.Translation(middle) @ turn
        depsgraph.update()
        place, _ = camera.camera_fit_coords(depsgraph, [x for corner in corners for x in corner])
    else:
        view_from = max(CORNERS, key=clear_way)
        turn = view_from.to_track_quat("Z", "Y").to_matrix().to_4x4()
        place = middle + view_from * min(clear_way(view_from), size / 2) * STEP_BACK
        camera.data.angle = WIDE_ANGLE
    camera.matrix_world = Matrix.Translation(place) @ turn


def _directions() -> list[Vector]:
    """Directions spread evenly over the sphere (spherical Fibonacci lattice)."""
    turn = math.pi * (3 - math.sqrt(5))
    found = []
    for index in range(RAYS):
        z = 1 - (2 * index + 1) / RAYS
        ring = math.sqrt(1 - z * z)
        found.append(Vector((ring * math.cos(turn * index), ring * math.sin(turn * index), z)))
    return found


def _share(truths: Iterator[bool]) -> float:
    listed = list(truths)
    return sum(listed) / len(listed)
