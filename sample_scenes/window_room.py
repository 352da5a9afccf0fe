# SPDX-License-Identifier: GPL-3.0-or-later
"""A closed room of 4 x 5 x 2.7 m that all its light enters through one window: the hard case for a gather.

Run it with a Python that has bpy, or in Blender: `python window_room.py [OUT.blend]`.

The walls are 0.3 m thick and one closed solid with the window cut through the wall at y = 5; the sky is the world's one
colour, and a low sun throws a patch of light on the floor and a cabinet.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))
from building import Point, diffuse, empty_scene, mesh_object, put, sky, write_when_run

SIZE = (4.0, 5.0, 2.7)
WALL = 0.3
WINDOW = ((1.3, 2.8), (0.9, 2.2))
"""x and z, m"""

BOX_FACES = [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]


def rectangle(x: tuple[float, float], z: tuple[float, float], y: float) -> list[Point]:
    """Four corners, anticlockwise as seen from -y."""
    return [(x[0], y, z[0]), (x[1], y, z[0]), (x[1], y, z[1]), (x[0], y, z[1])]


def walls() -> tuple[list[Point], list[tuple[int, ...]], list[int]]:
    """Corners, faces and material index of each face (0 white, 1 floor) of the room's solid."""
    length = SIZE[1]
    inside, outside = ((0.0, SIZE[0]), (0.0, SIZE[2])), ((-WALL, SIZE[0] + WALL), (-WALL, SIZE[2] + WALL))
    corners = [
        *rectangle(*inside, 0.0),
        *rectangle(*inside, length),
        *rectangle(*WINDOW, length),
        *rectangle(*WINDOW, length + WALL),
        *rectangle(*outside, length + WALL),
        *rectangle(*outside, -WALL),
    ]
    faces: list[tuple[int, ...]] = [(3, 2, 1, 0), (20, 21, 22, 23)]
    for first in range(0, 20, 4):  # from each rectangle to the next: a tube that turns inside out at the window
        for side in range(4):
            after = (side + 1) % 4
            faces.append((first + side, first + after, first + 4 + after, first + 4 + side))
    floor = faces.index((0, 1, 5, 4))
    return corners, faces, [int(index == floor) for index in range(len(faces))]


def box(name: str, size: Point, place: tuple[float, float], turn: float, paint: bpy.types.Material) -> None:
    """A box on the floor, turned about its own vertical axis, degrees."""
    x, y, z = size[0] / 2, size[1] / 2, size[2]
    ring = [(-x, -y), (x, -y), (x, y), (-x, y)]
    corners = [(*corner, height) for height in (0.0, z) for corner in ring]
    mesh_object(name, corners, BOX_FACES, paint, (*place, 0.0), rotation_euler=(0, 0, math.radians(turn)))


def build() -> bpy.types.Scene:
    """Make the scene in Blender."""
    scene = empty_scene()
    sky(scene, (0.55, 0.75, 1.0), 2.0)
    white = diffuse("White", (0.75, 0.74, 0.72))
    wood = diffuse("Wood", (0.42, 0.27, 0.16))
    blue = diffuse("Blue", (0.12, 0.22, 0.45))
    ochre = diffuse("Ochre", (0.65, 0.42, 0.1))
    corners, faces, paint = walls()
    room = mesh_object("Walls", corners, faces, (white, wood))
    room.data.polygons.foreach_set("material_index", paint)
    box("Cabinet", (0.9, 0.45, 1.9), (0.6, 3.2), 0.0, blue)
    box("Table", (1.4, 0.8, 0.72), (2.5, 2.1), 12.0, ochre)
    box("Crate", (0.5, 0.5, 0.5), (3.3, 3.7), 30.0, white)

    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle, sun.color = 12.0, math.radians(0.53), (1.0, 0.9, 0.75)
    put("Sun", sun, (2, 9, 6), rotation_euler=(math.radians(-52), 0, math.radians(22)))

    camera = bpy.data.cameras.new("Camera")
    camera.lens = 18.0
    scene.camera = put("Camera", camera, (3.6, 0.3, 1.6), rotation_euler=(math.radians(84), 0, math.radians(24)))
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.exposure = 1.2
    scene.cycles.samples = 256
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = 64
    scene.cycles.sample_clamp_indirect = 0.0
    return scene


if __name__ == "__main__":
    write_when_run(build, __file__)
