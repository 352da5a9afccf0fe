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
from building import box, diffuse, empty_scene, mesh_object, put, room, sky, write_when_run

SIZE = (4.0, 5.0, 2.7)
WALL = 0.3
WINDOW = ((1.3, 2.8), (0.9, 2.2))
"""x and z, m"""

FLOOR_FACE = 2


def build() -> bpy.types.Scene:
    """Make the scene in Blender."""
    scene = empty_scene()
    sky(scene, (0.55, 0.75, 1.0), 2.0)
    white = diffuse("White", (0.75, 0.74, 0.72))
    wood = diffuse("Wood", (0.42, 0.27, 0.16))
    blue = diffuse("Blue", (0.12, 0.22, 0.45))
    ochre = diffuse("Ochre", (0.65, 0.42, 0.1))
    walls = mesh_object("Walls", *room(SIZE, WALL, WINDOW), (white, wood))
    walls.data.polygons[FLOOR_FACE].material_index = 1
    box("Cabinet", (0.9, 0.45, 1.9), blue, (0.6, 3.2, 0.0))
    box("Table", (1.4, 0.8, 0.72), ochre, (2.5, 2.1, 0.0), rotation_euler=(0, 0, math.radians(12)))
    box("Crate", (0.5, 0.5, 0.5), white, (3.3, 3.7, 0.0), rotation_euler=(0, 0, math.radians(30)))

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
