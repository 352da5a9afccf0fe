# SPDX-License-Identifier: GPL-3.0-or-later
"""A bar of metal and polish: brushed steel, copper, brass, lacquer, under pendants and an area lamp."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "sample_scenes"))
import bpy
from building import Point, box, diffuse, empty_scene, joined, lathe, mesh_object, smooth, write_when_run
from furniture import glossy, sphere
from interior import lamp, lit
from parts import finish, placed_copy, plank

WIDTH, LENGTH, HEIGHT = 5.0, 4.0, 2.7
SINK = 0.004


def stool(place: Point) -> object:
    """A round seat on one leg."""
    profile = [(0, -SINK), (0.2, -SINK), (0.2, 0.02), (0.03, 0.04), (0.03, 0.68), (0.17, 0.69), (0.18, 0.75), (0, 0.75)]
    return smooth(mesh_object("Stool 1", *lathe(profile, 32), glossy("Copper", (0.75, 0.36, 0.2), 0.45, 1.0), place))


def build() -> object:
    """Make the scene in Blender."""
    scene = empty_scene()
    lacquer, wood = glossy("Lacquer", (0.25, 0.05, 0.04), 0.5), glossy("Parquet", (0.32, 0.19, 0.1), 0.6)
    plaster = diffuse("Plaster", (0.72, 0.7, 0.66))
    room = mesh_object("Room", *plank((WIDTH, LENGTH, HEIGHT), (WIDTH / 2, LENGTH / 2, 0)), (plaster, wood, lacquer))
    room.data.flip_normals()
    room.data.polygons[0].material_index, room.data.polygons[4].material_index = 1, 2
    steel, brass = glossy("Steel", (0.6, 0.6, 0.62), 0.5, 1.0), glossy("Brass", (0.75, 0.55, 0.22), 0.4, 1.0)
    box("Counter", (3.4, 0.6, 1.02), glossy("Counter", (0.05, 0.1, 0.11), 0.5), (2.4, 2.2, -SINK))
    box("Counter Top", (3.6, 0.75, 0.05), steel, (2.4, 2.2, 1.012))
    box("Foot Rail", (3.4, 0.05, 0.05), brass, (2.4, 1.72, 0.2))
    first = stool((1.2, 1.35, 0))
    for number in (2, 3, 4):
        placed_copy(first, f"Stool {number}", (1.2 + 0.8 * (number - 1), 1.35, 0))
    shelves = [plank((3.6, 0.3, 0.03), (2.4, LENGTH - 0.146, z)) for z in (1.2, 1.6, 2.0)]
    mesh_object("Shelves", *joined(shelves), brass)
    bottle = [(0, 0), (0.04, 0), (0.04, 0.17), (0.015, 0.22), (0.015, 0.29), (0, 0.29)]
    hues = [(0.1, 0.3, 0.1), (0.45, 0.2, 0.05), (0.6, 0.6, 0.55), (0.1, 0.12, 0.35)]
    paints = [glossy(f"Bottle {k}", hue, 0.3) for k, hue in enumerate(hues)]
    for number in range(9):
        place = (0.9 + 0.36 * number, LENGTH - 0.15, (1.228, 1.628, 2.028)[number % 3])
        smooth(mesh_object(f"Bottle {number + 1}", *lathe(bottle, 20), paints[number % 4], place), 50)
    box("Fridge", (0.7, 0.65, 1.9), steel, (4.6, 3.67, -SINK))
    smooth(mesh_object("Bowl", *sphere(0.16, 28, 14), brass, (3.4, 2.2, 1.2)), 180)
    for number, x in enumerate((1.2, 2.4, 3.6), 1):
        hood = lathe([(0.0, 0.16), (0.04, 0.16), (0.13, 0.0), (0.126, 0.0), (0.036, 0.155), (0.0, 0.155)], 32)
        made = mesh_object(f"Pendant {number}", *hood, bpy.data.materials["Copper"], (x, 2.15, 1.85))
        made.data.flip_normals()
        smooth(made, 50)
        cord = lathe([(0, 2.005), (0.005, 2.005), (0.005, HEIGHT + SINK), (0, HEIGHT + SINK)], 8)
        mesh_object(f"Cord {number}", *cord, plaster, (x, 2.15, 0))
        bulb = lit(f"Bulb {number}", (1.0, 0.72, 0.45), 60.0)
        smooth(mesh_object(f"Bulb {number}", *sphere(0.035, 16, 8), bulb, (x, 2.15, 1.9)), 180)
    lamp("Cove", "AREA", (2.5, 1.2, HEIGHT - 0.02), 45.0, (1, 0.85, 0.68), shape="RECTANGLE", size=3.0, size_y=0.4)
    return finish(scene, (4.7, 0.3, 1.6), -3, 38, 18.0, 0.8)


if __name__ == "__main__":
    write_when_run(build, __file__)
