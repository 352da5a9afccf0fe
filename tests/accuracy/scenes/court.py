# SPDX-License-Identifier: GPL-3.0-or-later
"""A courtyard with an arcade, a fountain and cypresses under an afternoon sun and a sky texture."""

from __future__ import annotations

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "sample_scenes"))
import bpy
from building import Shape, box, diffuse, empty_scene, joined, lathe, lattice, mesh_object, smooth, write_when_run
from parts import finish, placed_copy, plank, sun

SIDE, HEIGHT = 12.0, 4.2
SINK = 0.004


def blue_sky(scene: bpy.types.Scene) -> None:
    """The sky texture of a clear day, without its sun."""
    world = bpy.data.worlds.new("World")
    world.use_nodes = True
    texture = world.node_tree.nodes.new("ShaderNodeTexSky")
    texture.sky_type, texture.sun_disc = "NISHITA", False
    texture.sun_elevation, texture.sun_rotation = math.radians(42), math.radians(60)
    background = world.node_tree.nodes["Background"]
    background.inputs["Strength"].default_value = 0.3
    world.node_tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    scene.world = world


def wall_with_openings(count: int) -> Shape:
    """A wall, 0.4 m thick, with windows on its upper half."""
    bay = SIDE / count
    xs = sorted({0.0, SIDE, *(bay * k + share * bay for k in range(count) for share in (0.3, 0.7))})
    zs = [-SINK, 1.7, 3.2, HEIGHT]
    return lattice(xs, zs, 0.4, lambda column, row: column % 2 == 0 or row != 1)


def build() -> object:
    """Make the scene in Blender."""
    scene = empty_scene()
    blue_sky(scene)
    sun(scene, 4.0, 48, 30, (1.0, 0.9, 0.76))
    ochre, white, terracotta = (
        diffuse("Ochre", (0.62, 0.42, 0.2)),
        diffuse("Lime", (0.78, 0.75, 0.68)),
        diffuse("Terracotta", (0.5, 0.2, 0.12)),
    )
    sand = diffuse("Paving", (0.45, 0.4, 0.33))
    mesh_object("Ground", *plank((SIDE + 1, SIDE + 1, 0.2), (SIDE / 2, SIDE / 2, -0.2)), sand)
    walls = [
        ("North", (0, SIDE, 0), 0, ochre),
        ("South", (SIDE, 0, 0), 180, white),
        ("East", (SIDE, SIDE, 0), -90, ochre),
        ("West", (0, 0, 0), 90, terracotta),
    ]
    for name, place, turn, paint in walls:
        shape = wall_with_openings(4 if name in ("North", "South") else 3)
        mesh_object(f"{name} Wall", *shape, paint, place, rotation_euler=(0, 0, math.radians(turn)))
    profile = [(0, -SINK), (0.3, -SINK), (0.3, 0.2), (0.2, 0.26), (0.17, 2.3), (0.28, 2.4), (0.28, 2.504), (0, 2.504)]
    column = smooth(mesh_object("Column 1", *lathe(profile, 24), white, (1.2, 9.6, 0)))
    for number in range(2, 6):
        placed_copy(column, f"Column {number}", (1.2 + 2.4 * (number - 1), 9.6, 0))
    box("Architrave", (SIDE, 0.5, 0.35), white, (SIDE / 2, 9.6, 2.5))
    mesh_object("Arcade Roof", *plank((SIDE, 2.7, 0.12), (SIDE / 2, 10.65, 2.847)), terracotta)
    basin = [
        (0, -SINK),
        (1.1, -SINK),
        (1.2, 0.5),
        (1.05, 0.5),
        (1.0, 0.3),
        (0.12, 0.3),
        (0.09, 1.0),
        (0.5, 1.15),
        (0.48, 1.2),
        (0, 1.08),
    ]
    smooth(mesh_object("Fountain", *lathe(basin, 48), white, (6.0, 5.0, 0)))
    leaf = diffuse("Cypress", (0.04, 0.09, 0.03))
    for number, (x, y) in enumerate(((2.2, 2.4), (9.6, 2.6), (9.9, 7.2)), 1):
        tree = [(0, 0.3), (0.45, 0.5), (0.5, 1.2), (0.3, 2.6), (0.08, 3.6), (0, 3.7)]
        smooth(mesh_object(f"Cypress {number}", *lathe(tree, 20), leaf, (x, y, 0)), 60)
        pot = [(0, -SINK), (0.3, -SINK), (0.4, 0.45), (0.34, 0.45), (0.33, 0.38), (0, 0.38)]
        smooth(mesh_object(f"Pot {number}", *lathe(pot, 28), terracotta, (x, y, 0)))
    steps = [plank((1.6 - 0.4 * k, 1.2 - 0.3 * k, 0.18 * (k + 1) + SINK), (6.0, 0.2 + 0.4, -SINK)) for k in range(3)]
    mesh_object("Steps", *joined(steps[:1]), sand)
    box("Bench", (1.8, 0.5, 0.45), white, (3.6, 7.4, -SINK), 0.02).rotation_euler = (0, 0, math.radians(20))
    return finish(scene, (5.4, 0.9, 1.9), 0, -14, 16.0, -0.6)


if __name__ == "__main__":
    write_when_run(build, __file__)
