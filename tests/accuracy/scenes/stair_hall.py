# SPDX-License-Identifier: GPL-3.0-or-later
"""A stair hall of two storeys whose walls, floors and treads are single planes, lit and seen from both sides."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "sample_scenes"))
from building import box, diffuse, empty_scene, joined, lathe, mesh_object, smooth, write_when_run
from interior import lamp
from parts import finish, plank, sheet

WIDTH, LENGTH, STOREY = 6.0, 5.0, 2.7
HOLE = (1.6, 5.2, 0.0, 1.5)
"""Lowest and highest x and y of the opening in the upper floor, m."""
SINK = 0.004


def build_shell() -> None:
    """Outer walls that face inward, a floor with an opening, a wall between two rooms with a doorway in it."""
    white, warm, rose = (
        diffuse("White", (0.8, 0.79, 0.76)),
        diffuse("Warm", (0.7, 0.5, 0.3)),
        diffuse("Rose", (0.6, 0.25, 0.22)),
    )
    shell = mesh_object("Shell", *plank((WIDTH, LENGTH, 2 * STOREY), (WIDTH / 2, LENGTH / 2, 0)), (white, warm, rose))
    shell.data.flip_normals()
    shell.data.polygons[0].material_index, shell.data.polygons[5].material_index = 1, 2
    x0, x1, y0, y1 = HOLE
    xs, ys = (0.0, x0, x1, WIDTH), (y0, y1, LENGTH)
    points = [(x, y, STOREY) for y in ys for x in xs]
    faces = [(4 * row + k, 4 * row + k + 1, 4 * row + k + 5, 4 * row + k + 4) for row in (0, 1) for k in range(3)]
    faces.remove((1, 2, 6, 5))
    mesh_object("Upper Floor", points, faces, diffuse("Boards", (0.42, 0.28, 0.16)))
    door = [(3.4, 2.1), (4.3, 2.1)]
    points = [(0, 2.9, 0), (3.4, 2.9, 0), (4.3, 2.9, 0), (WIDTH, 2.9, 0)]
    points += [(0, 2.9, door[0][1]), *((x, 2.9, z) for x, z in door), (WIDTH, 2.9, door[0][1])]
    points += [(x, 2.9, STOREY) for x in (0, 3.4, 4.3, WIDTH)]
    faces = [(0, 1, 5, 4), (2, 3, 7, 6), (4, 5, 9, 8), (5, 6, 10, 9), (6, 7, 11, 10)]
    mesh_object("Dividing Wall", points, faces, diffuse("Sage", (0.35, 0.45, 0.3)))
    sheet(
        "Screen",
        [(1.1, 3.6, STOREY), (1.1, 4.9, STOREY), (1.1, 4.9, STOREY + 1.8), (1.1, 3.6, STOREY + 1.8)],
        diffuse("Paper", (0.75, 0.66, 0.5)),
    )


def build_stair() -> None:
    """Treads and risers as one folded sheet, and a rail of balusters round the opening."""
    x0, x1, _, _ = HOLE
    steps = 14
    points = []
    for step in range(steps):
        x, z = x1 - 0.05 - step * (x1 - x0 - 0.05) / steps, step * STOREY / steps
        points += [(x, 0.25, z), (x, 1.15, z), (x, 0.25, z + STOREY / steps), (x, 1.15, z + STOREY / steps)]
    points += [(x0, 0.25, STOREY), (x0, 1.15, STOREY)]
    faces = [(4 * step, 4 * step + 2, 4 * step + 3, 4 * step + 1) for step in range(steps)]
    faces += [(4 * step + 2, 4 * step + 4, 4 * step + 5, 4 * step + 3) for step in range(steps)]
    mesh_object("Stair", points, faces, diffuse("Stair", (0.55, 0.5, 0.45)))
    dark = diffuse("Rail", (0.12, 0.08, 0.06))
    rods = [plank((0.03, 0.03, 0.9), (x0 + 0.3 * k, 1.56, STOREY - SINK)) for k in range(13)]
    rods.append(plank((3.7, 0.05, 0.04), (x0 + 1.8, 1.56, STOREY + 0.89)))
    mesh_object("Railing", *joined(rods), dark)


def build() -> object:
    """Make the scene in Blender."""
    scene = empty_scene()
    build_shell()
    build_stair()
    box("Console", (1.2, 0.35, 0.8), diffuse("Walnut", (0.2, 0.11, 0.06)), (1.4, 2.66, -SINK), 0.01)
    pot = lathe([(0, 0), (0.08, 0), (0.15, 0.16), (0.09, 0.32), (0.11, 0.36), (0, 0.36)], 32)
    smooth(mesh_object("Vase", *pot, diffuse("Vase", (0.1, 0.25, 0.4)), (1.1, 2.64, 0.795)))
    box("Bench", (0.5, 1.4, 0.45), diffuse("Bench", (0.5, 0.4, 0.28)), (5.6, 4.0, STOREY - SINK), 0.01)
    box("Chest", (0.8, 0.5, 0.6), diffuse("Chest", (0.3, 0.12, 0.1)), (1.4, 4.5, -SINK), 0.01)
    lamp("Upper Lamp", "AREA", (3.6, 2.6, 2 * STOREY - 0.03), 90.0, (1, 0.93, 0.82), shape="SQUARE", size=0.7)
    lamp("Hall Lamp", "POINT", (2.6, 2.2, STOREY - 0.4), 22.0, (1, 0.75, 0.5), shadow_soft_size=0.1)
    back = lamp("Back Lamp", "AREA", (3.4, 4.1, STOREY - 0.03), 20.0, (0.8, 0.9, 1.0), shape="RECTANGLE", size=1.0)
    back.data.size_y = 0.3
    return finish(scene, (0.5, 0.35, 1.5), 8, -52, 16.0, 0.6)


if __name__ == "__main__":
    write_when_run(build, __file__)
