# SPDX-License-Identifier: GPL-3.0-or-later
"""A garden under a blue sky and a low sun: a shed, a wall, a bench, trees of trunks and leaf cards, on open ground.

Run it with a Python that has bpy, or in Blender: `python garden.py [OUT.blend]`.

All light is the world's: a Sky Texture with its sun disc. Most surfaces see much of the sky;
under the bench, in the shed and behind the wall little of it, and leaves cast small soft shadows.
"""

from __future__ import annotations

import math
import random
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))
from building import (
    Shape,
    box,
    box_shape,
    diffuse,
    empty_scene,
    joined,
    lathe,
    mesh_object,
    put,
    smooth,
    write_when_run,
)

GROUND = 16.0
"""m, edge of the lawn"""

LEAVES = 160
LEAF = 0.34
"""m, edge of a leaf card"""

SUN_ELEVATION = math.radians(32)
SUN_ROTATION = math.radians(200)
EXPOSURE = 0.05
"""Of the sky, whose sun is about 100 W/m2 at strength 1."""


def sky_texture(scene: bpy.types.Scene) -> None:
    """The world: a clear sky and its sun."""
    world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    tree = world.node_tree
    sky = tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type = "NISHITA" if bpy.app.version < (5, 0) else "SINGLE_SCATTERING"
    sky.sun_elevation, sky.sun_rotation = SUN_ELEVATION, SUN_ROTATION
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    background.inputs["Strength"].default_value = EXPOSURE
    tree.links.new(sky.outputs[0], background.inputs["Color"])
    scene.world = world


def crown(middle: tuple[float, float, float], radius: float, seed: int) -> Shape:
    """Leaf cards, single quads, spread through a ball."""
    dice = random.Random(seed)
    points: list[tuple[float, float, float]] = []
    faces: list[tuple[int, ...]] = []
    for _ in range(LEAVES):
        way = [dice.gauss(0, 1) for _ in range(3)]
        far = radius * dice.random() ** 0.4 / math.hypot(*way)
        centre = [m + far * w for m, w in zip(middle, way, strict=True)]
        turn, tilt = dice.uniform(0, 2 * math.pi), dice.uniform(-0.9, 0.9)
        across = (math.cos(turn), math.sin(turn), 0.0)
        along = (-math.sin(turn) * math.cos(tilt), math.cos(turn) * math.cos(tilt), math.sin(tilt))
        faces.append(tuple(range(len(points), len(points) + 4)))
        for u, v in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)):
            x, y, z = (c + LEAF * (u * a + v * b) for c, a, b in zip(centre, across, along, strict=True))
            points.append((x, y, z))
    return points, faces


def tree(
    name: str, place: tuple[float, float], height: float, bark: bpy.types.Material, leaf: bpy.types.Material
) -> None:
    """A trunk, and a crown of cards that overlaps its top."""
    profile = [(0.0, -0.1), (0.16, -0.1), (0.12, 0.3), (0.09, height * 0.7), (0.0, height * 0.75)]
    smooth(mesh_object(f"{name} trunk", *lathe(profile, 16), bark, (*place, 0.0)))
    mesh_object(f"{name} leaves", *crown((0.0, 0.0, height), 1.1, len(name)), leaf, (*place, 0.0))


def shed_shape() -> Shape:
    """Three walls and a slanted roof, each 0.1 m thick, open to -y."""
    walls = [
        box_shape((-1.5, 0.9, 0.0), (1.5, 1.0, 2.0)),
        box_shape((-1.5, -1.0, 0.0), (-1.4, 0.9, 2.0)),
        box_shape((1.4, -1.0, 0.0), (1.5, 0.9, 2.0)),
    ]
    low, high = 2.02, 2.45
    ring = [(-1.8, 1.2, low), (1.8, 1.2, low), (1.8, -1.5, high), (-1.8, -1.5, high)]
    points, faces = box_shape((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    rings = [(x, y, z + up) for up in (0.0, 0.1) for x, y, z in (ring[3], ring[2], ring[1], ring[0])]
    assert len(points) == len(rings)
    return joined([*walls, (rings, faces)])


def build() -> bpy.types.Scene:
    """Make the scene in Blender."""
    scene = empty_scene()
    sky_texture(scene)
    grass = diffuse("Grass", (0.12, 0.2, 0.06))
    stone = diffuse("Stone", (0.45, 0.43, 0.4))
    plank = diffuse("Plank", (0.4, 0.25, 0.13))
    white = diffuse("White", (0.75, 0.74, 0.72))
    bark = diffuse("Bark", (0.2, 0.14, 0.1))
    leaf = diffuse("Leaf", (0.2, 0.38, 0.08))
    red = diffuse("Red", (0.6, 0.1, 0.06))

    half = GROUND / 2
    mesh_object(
        "Ground", [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [(0, 1, 2, 3)], grass
    )
    mesh_object("Path", *box_shape((-0.6, -7.0, -0.1), (0.6, 1.4, 0.03)), stone)
    mesh_object("Shed", *shed_shape(), plank, (0.0, 2.6, 0.0))
    box("Wall", (6.0, 0.3, 1.4), white, (-3.2, -2.2, 0.0), rotation_euler=(0, 0, math.radians(70)))
    bench = [box_shape((-0.8, -0.2, 0.42), (0.8, 0.2, 0.48))]
    bench += [box_shape((x - 0.05, -0.18, 0.0), (x + 0.05, 0.18, 0.42)) for x in (-0.6, 0.6)]
    mesh_object("Bench", *joined(bench), plank, (1.9, -1.2, 0.0), rotation_euler=(0, 0, math.radians(-35)))
    box("Chest", (0.7, 0.5, 0.45), red, (-0.6, 2.9, 0.0), rotation_euler=(0, 0, math.radians(15)))
    pot = [(0.0, 0.0), (0.2, 0.0), (0.3, 0.5), (0.26, 0.5), (0.2, 0.1), (0.0, 0.1)]
    smooth(mesh_object("Pot", *lathe(pot, 32), red, (1.2, 0.6, 0.0)))
    ball = [(0.35 * math.sin(math.pi * k / 16), 0.35 - 0.35 * math.cos(math.pi * k / 16)) for k in range(17)]
    ball[0], ball[-1] = (0.0, 0.0), (0.0, 0.7)
    smooth(mesh_object("Ball", *lathe(ball, 32), white, (0.3, -3.4, 0.0)), 180.0)
    tree("Apple", (3.6, 1.4), 2.9, bark, leaf)
    tree("Cherry", (-3.4, 2.6), 3.3, bark, leaf)

    camera = bpy.data.cameras.new("Camera")
    camera.lens = 28.0
    scene.camera = put("Camera", camera, (5.6, -7.4, 3.0), rotation_euler=(math.radians(76), 0, math.radians(36)))
    scene.render.resolution_x, scene.render.resolution_y = 800, 500
    scene.view_settings.view_transform = "Standard"
    scene.cycles.samples = 128
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = 64
    scene.cycles.sample_clamp_indirect = 0.0
    return scene


if __name__ == "__main__":
    write_when_run(build, __file__)
