# SPDX-License-Identifier: GPL-3.0-or-later
"""An open-plan office without a window: ceiling panels, desk lamps and lit screens; six desks of shared meshes."""

from __future__ import annotations

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "sample_scenes"))
import bpy
from building import Point, box, diffuse, empty_scene, joined, lathe, mesh_object, smooth, write_when_run
from furniture import glossy
from interior import lamp, lit
from parts import finish, placed_copy, plank

WIDTH, LENGTH, HEIGHT = 9.0, 7.0, 2.8
SINK = 0.004


def build_room() -> None:
    """Walls, floor and ceiling as one box that faces inward, skirting, a column, doors, and a whiteboard."""
    white, grey = diffuse("Wall White", (0.8, 0.79, 0.76)), diffuse("Carpet", (0.2, 0.22, 0.25))
    blue = diffuse("Accent Blue", (0.06, 0.19, 0.36))
    room = mesh_object("Room", *plank((WIDTH, LENGTH, HEIGHT), (WIDTH / 2, LENGTH / 2, 0)), (white, grey, blue))
    room.data.flip_normals()
    room.data.polygons[0].material_index, room.data.polygons[5].material_index = 1, 2
    box("Column", (0.45, 0.45, HEIGHT + 2 * SINK), white, (5.4, 3.5, -SINK))
    oak = diffuse("Door Oak", (0.42, 0.27, 0.15))
    for number, x in enumerate((1.2, 7.6), 1):
        box(f"Door {number}", (0.95, 0.06, 2.1), oak, (x, LENGTH - 0.026, -SINK))
    box("Whiteboard", (2.4, 0.03, 1.2), diffuse("Whiteboard", (0.85, 0.85, 0.85)), (4.3, LENGTH - 0.011, 0.9))
    box("Tray", (2.0, 0.08, 0.02), diffuse("Tray", (0.4, 0.4, 0.42)), (4.3, LENGTH - 0.06, 0.87))
    cabinets = [plank((0.8, 0.45, 1.1), (0.6 + 0.81 * number, 0.223, -SINK)) for number in range(4)]
    mesh_object("Cabinets", *joined(cabinets), diffuse("Cabinet", (0.55, 0.56, 0.55)))
    pot = [(0, -SINK), (0.18, -SINK), (0.24, 0.42), (0.21, 0.42), (0.2, 0.36), (0, 0.36)]
    smooth(mesh_object("Planter", *lathe(pot, 32), diffuse("Planter", (0.6, 0.3, 0.2)), (8.5, 6.5, 0)))
    ball = lathe(
        [(0, 0), *((0.4 * math.sin(a), 0.4 - 0.4 * math.cos(a)) for a in (0.5, 1, 1.6, 2.2, 2.7)), (0, 0.8)], 16
    )
    smooth(mesh_object("Bush", *ball, diffuse("Bush", (0.07, 0.18, 0.05)), (8.5, 6.5, 0.33)), 180)


def build_desks() -> None:
    """The first desk with all that stands on it, then five more of the same meshes."""
    beech, steel = diffuse("Beech", (0.58, 0.42, 0.25)), glossy("Steel", (0.5, 0.5, 0.52), 0.5, 0.0)
    black, fabric = diffuse("Plastic", (0.05, 0.05, 0.055)), diffuse("Fabric", (0.5, 0.12, 0.06))
    corners = [(-0.74, -0.34), (0.74, -0.34), (0.74, 0.34), (-0.74, 0.34)]
    feet = [plank((0.05, 0.05, 0.72), (x, y, -SINK)) for x, y in corners]
    star = [plank((0.6, 0.05, 0.05), (0, 0, -SINK)), plank((0.05, 0.6, 0.052), (0, 0, -SINK))]
    parts: list[tuple[bpy.types.Object, Point, float]] = [
        (box("Desk Top", (1.6, 0.8, 0.03), beech), (0, 0, 0.714), 0),
        (mesh_object("Desk Legs", *joined(feet), steel), (0, 0, 0), 0),
        (box("Drawers", (0.4, 0.55, 0.6), beech), (0.5, 0.05, -SINK), 0),
        (box("Monitor", (0.56, 0.03, 0.34), black), (-0.1, 0.22, 0.86), 4),
        (box("Monitor Foot", (0.22, 0.16, 0.14), black), (-0.1, 0.24, 0.74), 0),
        (box("Keyboard", (0.42, 0.14, 0.018), black), (-0.1, -0.14, 0.742), -3),
        (box("Seat", (0.48, 0.46, 0.09), fabric, bevel=0.03, subdivision=1), (-0.1, -0.68, 0.42), 12),
        (box("Backrest", (0.44, 0.07, 0.5), fabric, bevel=0.025, subdivision=1), (-0.05, -0.9, 0.58), 12),
        (
            mesh_object("Chair Foot", *joined([*star, plank((0.06, 0.06, 0.4), (0, 0, 0.04))]), black),
            (-0.1, -0.68, 0),
            30,
        ),
    ]
    screen = mesh_object("Screen", *plank((0.52, 0.01, 0.3), (0, -0.013, 0.02)), lit("Screen", (0.55, 0.75, 1.0), 6.0))
    parts.append((screen, (-0.1, 0.22, 0.86), 4))
    places = [(x, y, turn) for y, turn in ((2.1, 0.0), (4.9, 180.0)) for x in (1.7, 3.9, 7.2)]
    for number, (x, y, turn) in enumerate(places, 1):
        for original, offset, own in parts:
            angle = math.radians(turn)
            place = (
                x + offset[0] * math.cos(angle) - offset[1] * math.sin(angle),
                y + offset[0] * math.sin(angle) + offset[1] * math.cos(angle),
                offset[2],
            )
            if number == 1:
                original.location, original.rotation_euler = place, (0, 0, math.radians(own))
            else:
                made = placed_copy(original, f"{original.name} {number}", place)
                made.rotation_euler = (0, 0, math.radians(turn + own))
    for number, x in enumerate((2.8, 6.6), 1):
        box(f"Partition {number}", (1.6, 0.04, 1.3), diffuse(f"Partition {number}", (0.3, 0.42, 0.3)), (x, 3.5, -SINK))


def build_lamps() -> None:
    """Eight ceiling panels, three downlights narrowed by their spread, two desk lamps."""
    for number in range(8):
        place = (1.3 + 2.1 * (number % 4), 2.0 + 3.0 * (number // 4), HEIGHT - 0.012)
        box(
            f"Panel {number + 1}",
            (1.24, 0.34, 0.03),
            bpy.data.materials["Plastic"],
            (place[0], place[1], HEIGHT - 0.01),
        )
        lamp(
            f"Panel Lamp {number + 1}", "AREA", place, 28.0, (1.0, 0.95, 0.88), shape="RECTANGLE", size=1.2, size_y=0.3
        ).visible_camera = True
    for number, x in enumerate((1.0, 4.3, 7.9), 1):
        warm = (1.0, 0.8, 0.6)
        lamp(f"Downlight {number}", "AREA", (x, 6.6, HEIGHT - 0.005), 12.0, warm, shape="DISK", size=0.2, spread=1.2)
    for number, (x, y) in enumerate(((2.3, 2.35), (6.6, 4.65)), 1):
        hood = lathe([(0.0, 0.085), (0.03, 0.085), (0.08, 0.0), (0.077, 0.0), (0.027, 0.082), (0.0, 0.082)], 24)
        metal = diffuse(f"Desk Lamp {number}", (0.1, 0.3, 0.25))
        made = mesh_object(f"Desk Lamp Hood {number}", *hood, metal, (x, y, 1.14))
        made.data.flip_normals()
        smooth(made, 50)
        stem = [(0, 0.743), (0.08, 0.743), (0.08, 0.757), (0.009, 0.76), (0.009, 1.222), (0, 1.222)]
        smooth(mesh_object(f"Desk Lamp Stem {number}", *lathe(stem, 16), metal, (x + 0.02, y, 0)))
        lamp(f"Desk Bulb {number}", "POINT", (x - 0.02, y, 1.16), 5.0, (1.0, 0.75, 0.5), shadow_soft_size=0.02)


def build() -> object:
    """Make the scene in Blender."""
    scene = empty_scene()
    build_room()
    build_desks()
    build_lamps()
    return finish(scene, (8.7, 0.4, 1.9), -10, 48, 17.0, 0.0)


if __name__ == "__main__":
    write_when_run(build, __file__)
