# SPDX-License-Identifier: GPL-3.0-or-later
"""A gallery of paintings and sculptures on coloured walls, lit by spots of all kinds, neon and a lit sign."""

from __future__ import annotations

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "sample_scenes"))
import bpy
from building import Point, box, diffuse, empty_scene, lathe, lattice, mesh_object, put, smooth, write_when_run
from furniture import sphere
from interior import lamp, lit
from parts import finish, plank

WIDTH, LENGTH, HEIGHT = 10.0, 6.5, 3.6
SINK = 0.004


def build_room() -> None:
    """A box that faces inward with a different colour a wall, a free-standing wall, benches."""
    colors = {
        "Concrete": (0.4, 0.39, 0.37),
        "Ceiling": (0.75, 0.75, 0.75),
        "Terracotta": (0.52, 0.2, 0.12),
        "Teal": (0.06, 0.25, 0.26),
        "Bone": (0.74, 0.7, 0.6),
        "Aubergine": (0.17, 0.07, 0.14),
    }
    paints = [diffuse(name, color) for name, color in colors.items()]
    room = mesh_object("Gallery", *plank((WIDTH, LENGTH, HEIGHT), (WIDTH / 2, LENGTH / 2, 0)), paints)
    room.data.flip_normals()
    for index, polygon in enumerate(room.data.polygons):
        polygon.material_index = index
    box("Screen Wall", (3.6, 0.22, 2.9), paints[4], (4.6, 3.9, -SINK))
    for number, (x, y) in enumerate(((2.4, 1.9), (7.4, 2.2)), 1):
        box(f"Bench Seat {number}", (1.5, 0.42, 0.07), diffuse(f"Bench {number}", (0.33, 0.2, 0.1)), (x, y, 0.4), 0.01)
        for side in (-0.6, 0.6):
            box(f"Bench Leg {number}{'LR'[side > 0]}", (0.06, 0.36, 0.41), paints[5], (x + side, y, -SINK))


def painting(number: int, place: Point, width: float, height: float, turn: float) -> None:
    """A frame against a wall and a canvas of six colour fields in it; `turn` in degrees, 0 hangs on a wall at +y."""
    bar = 0.03
    xs, zs = [0, bar, width - bar, width], [0, bar, height - bar, height]
    wood = bpy.data.materials.get("Frame") or diffuse("Frame", (0.2, 0.11, 0.05))
    frame = mesh_object(f"Frame {number}", *lattice(xs, zs, 0.05, lambda column, row: (column, row) != (1, 1)), wood)
    hues = [
        (0.7, 0.1, 0.06),
        (0.75, 0.55, 0.12),
        (0.1, 0.2, 0.45),
        (0.8, 0.78, 0.7),
        (0.1, 0.32, 0.15),
        (0.05, 0.05, 0.06),
    ]
    paints = [bpy.data.materials.get(f"Field {k}") or diffuse(f"Field {k}", hue) for k, hue in enumerate(hues)]
    field = [
        (x, 0.03, z)
        for z in (bar / 2, height * (0.3 + 0.05 * number % 0.4), height - bar / 2)
        for x in (bar / 2, width * 0.37, width * 0.71, width - bar / 2)
    ]
    faces = [(row * 4 + k, row * 4 + k + 1, row * 4 + k + 5, row * 4 + k + 4) for row in (0, 1) for k in range(3)]
    canvas = mesh_object(f"Canvas {number}", field, faces, paints)
    for index, polygon in enumerate(canvas.data.polygons):
        polygon.material_index = (index * (number + 1) + number) % 6
    for part in (frame, canvas):
        part.location, part.rotation_euler = place, (0, 0, math.radians(turn))


def build_works() -> None:
    """Paintings on three walls and both sides of the screen wall, sculptures on plinths."""
    for number, x in enumerate((0.7, 2.6, 7.2), 1):
        painting(number, (x, LENGTH - 0.046, 1.1), 1.2 + 0.2 * (number % 2), 1.0 + 0.15 * number, 0)
    painting(4, (WIDTH - 0.046, 5.4, 1.0), 1.6, 1.3, -90)
    painting(5, (WIDTH - 0.046, 2.4, 1.2), 1.0, 1.0, -90)
    painting(6, (3.9, 3.744, 1.1), 1.4, 1.1, 0)
    painting(7, (5.4, 4.056, 1.2), 1.5, 1.0, 180)
    plaster, clay = diffuse("Plaster", (0.78, 0.76, 0.72)), diffuse("Clay", (0.5, 0.22, 0.12))
    for number, (x, y, high) in enumerate(((1.2, 3.6, 0.9), (8.6, 4.4, 1.0), (5.0, 1.4, 0.75)), 1):
        box(f"Plinth {number}", (0.42, 0.42, high), diffuse(f"Plinth {number}", (0.8, 0.8, 0.78)), (x, y, -SINK))
    smooth(mesh_object("Egg", *sphere(0.2, 32, 16), plaster, (1.2, 3.6, 0.89 + 0.26), scale=(0.8, 0.8, 1.35)), 180)
    turns = [2 * math.pi * step / 16 for step in range(16)]
    ring = [(0.2 + 0.06 * math.cos(turn), 0.06 * math.sin(turn)) for turn in turns]
    torus = smooth(mesh_object("Knot", *lathe(ring, 40, ring=True), clay, (8.6, 4.4, 0.99 + 0.255)), 180)
    torus.rotation_euler = (math.radians(78), 0, 0.6)
    bowl = [(0, 0), (0.07, 0), (0.09, 0.05), (0.05, 0.12), (0.2, 0.3), (0.19, 0.3), (0.04, 0.135), (0, 0.13)]
    smooth(mesh_object("Goblet", *lathe(bowl, 36), clay, (5.0, 1.4, 0.743)), 60)


def build_lamps() -> None:
    """Spots with and without blend, radius and soft falloff, one stretched; a softbox; neon, a sign and a globe."""
    kinds = [
        {"spot_size": 0.9, "spot_blend": 0.6, "shadow_soft_size": 0.03},
        {"spot_size": 0.8, "spot_blend": 0.15, "shadow_soft_size": 0.08},
        {"spot_size": 1.1, "spot_blend": 1.0, "shadow_soft_size": 0.05, "use_soft_falloff": False},
        {"spot_size": 0.7, "spot_blend": 0.4, "shadow_soft_size": 0.02},
    ]
    aims = [(1.4, LENGTH), (3.3, LENGTH), (7.9, LENGTH), (WIDTH, 4.6), (WIDTH, 1.9), (4.6, 3.8), (1.2, 3.6), (5.0, 1.4)]
    for number, (x, y) in enumerate(aims):
        lean_x = -1.7 if x == WIDTH else 0.0
        lean_y = 0.0 if x == WIDTH else -1.7
        place = (x + lean_x, y + lean_y, HEIGHT - 0.3)
        made = lamp(f"Spot {number + 1}", "SPOT", place, 160.0, (1.0, 0.86, 0.7), **kinds[number % 4])
        turn = math.radians(-90) if x == WIDTH else 0.0
        made.rotation_euler = (math.radians(41), 0, turn)
        if number == 5:
            made.scale = (1.6, 0.8, 1.0)
        can = lathe([(0, 0.03), (0.06, 0.03), (0.06, 0.25), (0.012, 0.26), (0.012, 0.31), (0, 0.31)], 20)
        black = bpy.data.materials.get("Can") or diffuse("Can", (0.03, 0.03, 0.03))
        smooth(mesh_object(f"Can {number + 1}", *can, black, (place[0], place[1], HEIGHT - 0.305 + 0.1)))
    soft = lamp(
        "Softbox", "AREA", (8.2, 3.2, HEIGHT - 0.02), 40.0, (0.8, 0.9, 1.0), shape="ELLIPSE", size=1.4, size_y=0.5
    )
    soft.data.spread = math.radians(100)
    tube = bpy.data.curves.new("Neon", "CURVE")
    tube.dimensions, tube.bevel_depth, tube.bevel_resolution, tube.resolution_u = "3D", 0.02, 2, 10
    tube.use_fill_caps = True
    path = tube.splines.new("BEZIER")
    path.bezier_points.add(3)
    for index, point in enumerate(path.bezier_points):
        point.co = (0.06, 1.0 + 0.8 * index, 2.4 + 0.35 * (index % 2))
        point.handle_left_type = point.handle_right_type = "AUTO"
    tube.materials.append(lit("Neon", (1.0, 0.12, 0.35), 14.0))
    put("Neon", tube)
    text = bpy.data.curves.new("Sign", "FONT")
    text.body, text.size, text.extrude, text.align_x = "ART", 0.7, 0.03, "CENTER"
    text.materials.append(lit("Sign", (0.3, 1.0, 0.55), 9.0))
    put("Sign", text, (5.6, LENGTH - 0.04, 2.6), rotation_euler=(math.pi / 2, 0, 0))
    smooth(mesh_object("Globe Lamp", *sphere(0.14, 24, 12), lit("Globe", (1.0, 0.8, 0.55), 12.0), (3.2, 0.9, 2.6)), 180)


def build() -> object:
    """Make the scene in Blender."""
    scene = empty_scene()
    build_room()
    build_works()
    build_lamps()
    return finish(scene, (0.5, 0.4, 1.7), 0, -48, 17.0, 0.8)


if __name__ == "__main__":
    write_when_run(build, __file__)
