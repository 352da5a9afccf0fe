# SPDX-License-Identifier: GPL-3.0-or-later
"""The furniture of the interior scene: sofa, chairs, table, bookcase, pictures, plant."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence

import bpy
from building import (
    RGB,
    Paint,
    Point,
    Shape,
    box,
    box_shape,
    diffuse,
    joined,
    lathe,
    lattice,
    material,
    mesh_object,
    put,
    smooth,
)

SINK = 0.004
"""What stands on or hangs against something reaches this far into it, m: faces in one plane would be ambiguous."""

BACK_WALL = 5.0
"""y, m"""
TABLE = (2.75, 2.75)
SOFA = (2.75, 4.42)
SHELF = (4.3, 5.6)


def glossy(name: str, color: RGB, roughness: float, metallic: float = 0.0) -> Paint:
    """A Principled material of one linear colour."""
    return material(name, "ShaderNodeBsdfPrincipled", Base_Color=color, Roughness=roughness, Metallic=metallic)


def brass() -> Paint:
    """The one brass of all fittings."""
    return bpy.data.materials.get("Brass") or glossy("Brass", (0.62, 0.41, 0.16), 0.3, 1.0)


def walnut() -> Paint:
    """The one dark wood of the furniture."""
    return bpy.data.materials.get("Walnut") or glossy("Walnut", (0.13, 0.065, 0.033), 0.4)


def sphere(radius: float, segments: int, rings: int) -> Shape:
    """A UV sphere."""
    angles = [math.pi * ring / rings - math.pi / 2 for ring in range(1, rings)]
    profile = [(radius * math.cos(angle), radius * math.sin(angle)) for angle in angles]
    return lathe([(0, -radius), *profile, (0, radius)], segments)


def legs(name: str, feet: Sequence[tuple[float, float]], height: float, spread: float = 0.0) -> bpy.types.Object:
    """Tapered round legs that lean outwards, as one object."""
    parts = []
    for x, y in feet:
        points, faces = lathe([(0, -SINK), (0.012, -SINK), (0.02, height), (0, height)], 10)
        lean = [
            (px + x * (1 + spread * (height - pz)), py + y * (1 + spread * (height - pz)), pz) for px, py, pz in points
        ]
        parts.append((lean, faces))
    return smooth(mesh_object(name, *joined(parts), walnut()))


def sofa() -> None:
    """A three-seater: rounded by bevel and subdivision, its cushions repeated by an array."""
    wool = diffuse("Wool Oat", (0.52, 0.44, 0.34))
    x, y = SOFA
    box("Sofa Base", (2.2, 0.86, 0.2), wool, (x, y, 0.14), 0.035, 2)
    box("Sofa Back", (2.2, 0.2, 0.6), wool, (x, y + 0.35, 0.2), 0.06, 2)
    arm = box("Sofa Arm Left", (0.2, 0.84, 0.46), wool, (x - 1.05, y - 0.01, 0.14), 0.06, 2)
    mirrored = put("Sofa Arm Right", arm.data, (x + 1.05, y - 0.01, 0.14), scale=(-1, 1, 1))
    for source in arm.modifiers:
        copy = mirrored.modifiers.new(source.name, source.type)
        if source.type == "BEVEL":
            copy.width, copy.segments = source.width, source.segments
        else:
            copy.levels = copy.render_levels = source.levels
    seat = box("Seat Cushions", (0.63, 0.66, 0.17), wool, (x - 0.635, y - 0.1, 0.325), 0.05, 2)
    repeat = seat.modifiers.new("Array", "ARRAY")
    repeat.count = 3
    repeat.use_relative_offset, repeat.use_constant_offset = False, True
    repeat.constant_offset_displace = (0.635, 0, 0)
    back = [("Cushion Ochre", (0.55, 0.3, 0.06), -0.78, 10), ("Cushion Rust", (0.38, 0.1, 0.045), -0.42, -7)]
    back += [("Cushion Teal", (0.05, 0.2, 0.21), 0.78, -9)]
    for name, color, offset, turn in back:
        pillow = box(name, (0.44, 0.13, 0.4), diffuse(name, color), (x + offset, y + 0.14, 0.475), 0.03, 2)
        pillow.rotation_euler = (math.radians(-14), math.radians(turn / 3), math.radians(turn))
    feet = legs("Sofa Legs", [(-1.0, -0.36), (1.0, -0.36), (-1.0, 0.36), (1.0, 0.36)], 0.16)
    feet.location = (x, y, 0)


def chairs() -> None:
    """Two lounge chairs of the same meshes, the second mirrored."""
    leather = glossy("Leather Cognac", (0.31, 0.115, 0.04), 0.45)
    seat = box("Chair Seat", (0.62, 0.6, 0.13), leather, bevel=0.04, subdivision=2)
    back = box("Chair Back", (0.6, 0.12, 0.52), leather, bevel=0.04, subdivision=2)
    frame = legs("Chair Legs", [(-0.26, -0.24), (0.26, -0.24), (-0.26, 0.24), (0.26, 0.24)], 0.3, 0.4)
    arms = mesh_object(
        "Chair Arms",
        *joined(
            [box_shape((-0.36, -0.3, 0.5), (-0.3, 0.3, 0.53)), box_shape((0.3, -0.3, 0.5), (0.36, 0.3, 0.53))]
            + [
                box_shape((side, end, 0.24), (side + 0.03, end + 0.04, 0.51))
                for side in (-0.345, 0.315)
                for end in (-0.27, 0.2)
            ]
        ),
        walnut(),
    )
    parts = [(seat, (0, 0, 0.29), 4), (back, (0, 0.25, 0.38), -14), (frame, (0, 0, 0), 0), (arms, (0, 0, 0), 0)]
    for side, place, turn in ((1, (1.1, 2.15), 62), (-1, (4.5, 3.05), -70)):
        pivot = put("Chair Left" if side == 1 else "Chair Right", None, (*place, 0))
        pivot.rotation_euler, pivot.scale = (0, 0, math.radians(turn)), (side, 1, 1)
        for part, offset, tilt in parts:
            made = part
            if side == -1:
                made = part.copy()
                bpy.context.scene.collection.objects.link(made)
                made.name = part.name + " Mirrored"
            made.parent, made.location, made.rotation_euler = pivot, offset, (math.radians(tilt), 0, 0)


def table() -> None:
    """A rug, a round coffee table on it, and what lies on the table."""
    cream, wine = diffuse("Rug Cream", (0.62, 0.55, 0.44)), diffuse("Rug Rust", (0.33, 0.12, 0.07))
    x, y = TABLE
    widths = [-1.5, -1.38, -1.3, -1.22, -0.1, -0.04, 0.04, 0.1, 1.22, 1.3, 1.38, 1.5]
    rug = mesh_object("Rug", *lattice(widths, [-1.05, 1.05], 0.018, lambda column, row: True), (cream, wine))
    rug.location, rug.rotation_euler = (x, y - 0.1, 0.002), (math.pi / 2, 0, 0)
    rug.scale = (1, 1, -1)
    for polygon in rug.data.polygons:
        column = sum(polygon.center.x > width for width in widths) - 1
        polygon.material_index = int(column in (1, 4, 6, 9))

    top = [(0, 0), (0.48, 0), (0.5, 0.01), (0.5, 0.03), (0.49, 0.038), (0, 0.038)]
    smooth(mesh_object("Table Top", *lathe(top, 48), walnut(), (x, y, 0.36)))
    feet = [(0.3 * math.cos(angle), 0.3 * math.sin(angle)) for angle in (0.4, 0.4 + 2.094, 0.4 + 4.189)]
    legs("Table Legs", feet, 0.35, 0.5).location = (x, y, 0.015)

    bowl = [
        (0.04, 0.0),
        (0.08, 0.004),
        (0.13, 0.05),
        (0.15, 0.09),
        (0.143, 0.092),
        (0.123, 0.055),
        (0.07, 0.016),
        (0, 0.014),
    ]
    clay = glossy("Clay", (0.5, 0.2, 0.1), 0.6)
    smooth(mesh_object("Bowl", *lathe([(0, 0.0), *bowl], 32), clay, (x - 0.16, y + 0.14, 0.396)), 60)
    for number, (dx, dy, dz) in enumerate(((-0.05, 0.0, 0.05), (0.05, 0.03, 0.05), (0.0, -0.05, 0.055)), 1):
        fruit = sphere(0.042, 20, 12)
        paint = bpy.data.materials.get("Orange") or glossy("Orange", (0.65, 0.24, 0.02), 0.5)
        smooth(mesh_object(f"Orange {number}", *fruit, paint, (x - 0.16 + dx, y + 0.14 + dy, 0.396 + dz)), 180)
    for number, (size, color, turn) in enumerate(
        (((0.3, 0.22, 0.03), (0.08, 0.13, 0.2), 20), ((0.26, 0.2, 0.025), (0.6, 0.55, 0.47), 34)), 1
    ):
        book = box(f"Table Book {number}", size, diffuse(f"Table Book {number}", color))
        book.location, book.rotation_euler = (
            (x + 0.2, y - 0.16, 0.397 + 0.029 * (number - 1)),
            (0, 0, math.radians(turn)),
        )
    mug = [(0, 0), (0.035, 0), (0.04, 0.085), (0.036, 0.085), (0.032, 0.008), (0, 0.008)]
    smooth(mesh_object("Cup", *lathe(mug, 24), glossy("Glaze", (0.7, 0.68, 0.62), 0.2), (x + 0.22, y + 0.22, 0.397)))

    knit = diffuse("Knit", (0.6, 0.36, 0.1))
    pouf = smooth(mesh_object("Pouf", *sphere(0.33, 32, 16), knit, (3.35, 1.6, 0.185)), 180)
    pouf.scale = (1, 1, 0.58)


def shelf() -> None:
    """A bookcase against the green wall, filled."""
    dice = random.Random(11)
    left, right = SHELF
    board, depth = 0.028, 0.32
    levels = [0.06, 0.48, 0.84, 1.2, 1.56, 1.92]
    xs = [0.0, board, (right - left - board) / 2, (right - left + board) / 2, right - left - board, right - left]
    zs = [height + lift for height in levels for lift in (0.0, board)]
    case = lattice(xs, zs, depth, lambda column, row: column % 2 == 0 or row % 2 == 0)
    mesh_object("Bookcase", *case, walnut(), (left, BACK_WALL - depth + SINK, 0))
    covers = [
        (0.45, 0.11, 0.06),
        (0.62, 0.5, 0.33),
        (0.07, 0.16, 0.24),
        (0.6, 0.34, 0.07),
        (0.1, 0.2, 0.13),
        (0.68, 0.66, 0.6),
    ]
    covers += [(0.22, 0.07, 0.09), (0.3, 0.36, 0.38)]
    cloth = [diffuse(f"Cloth {number}", color) for number, color in enumerate(covers, 1)]
    for level, height in enumerate(levels[:-1]):
        for bay in (0, 1):
            if (level, bay) in ((1, 1), (4, 0)):
                continue
            x = left + xs[1 + 2 * bay] + 0.012
            end = left + xs[2 + 2 * bay] - (0.05 if level % 2 else 0.2)
            shapes, paints = [], []
            while x < end:
                thick, tall, deep = dice.uniform(0.018, 0.045), dice.uniform(0.19, 0.29), dice.uniform(0.15, 0.21)
                front = BACK_WALL - depth + dice.uniform(0.015, 0.03)
                shapes.append(
                    box_shape((x, front, height + board - 0.001), (x + thick, front + deep, height + board + tall))
                )
                paints.append(dice.randrange(len(cloth)))
                x += thick + 0.002
            row = mesh_object(f"Books {level + 1}{'AB'[bay]}", *joined(shapes), cloth)
            for polygon in row.data.polygons:
                polygon.material_index = paints[polygon.index // 6]
    globe = glossy("Globe Blue", (0.08, 0.2, 0.32), 0.35)
    middle = BACK_WALL - depth / 2
    high = levels[4] + board
    smooth(mesh_object("Globe", *sphere(0.11, 32, 16), globe, (left + 0.3, middle, high + 0.109)), 180)
    circle = [(0.1 + 0.032 * math.cos(a), 0.032 * math.sin(a)) for a in (2 * math.pi * step / 14 for step in range(14))]
    torus = mesh_object("Ring Sculpture", *lathe(circle, 36, ring=True), glossy("Chalk", (0.7, 0.66, 0.6), 0.7))
    smooth(torus, 180)
    torus.location, torus.rotation_euler = (left + 0.95, middle, levels[1] + board + 0.13), (math.radians(80), 0, 0.5)
    vase((left + 0.3, middle, levels[-1] + board - 0.002))


def vase(place: Point) -> None:
    """A vase as a NURBS surface: rings of a profile, lofted, outside and in again."""
    profile = [
        (0.002, 0.0),
        (0.05, 0.0),
        (0.075, 0.01),
        (0.115, 0.1),
        (0.1, 0.2),
        (0.035, 0.26),
        (0.035, 0.31),
        (0.055, 0.335),
    ]
    profile += [(0.046, 0.335), (0.026, 0.31), (0.026, 0.26), (0.09, 0.2), (0.1, 0.1), (0.06, 0.02), (0.002, 0.012)]
    surface = bpy.data.curves.new("Vase", "SURFACE")
    surface.dimensions = "3D"
    for radius, z in profile:
        ring = surface.splines.new("NURBS")
        ring.points.add(7)
        for step, point in enumerate(ring.points):
            angle = -2 * math.pi * step / 8
            point.co = (1.12 * radius * math.cos(angle), 1.12 * radius * math.sin(angle), z, 1.0)
    surface.materials.append(glossy("Celadon", (0.3, 0.45, 0.38), 0.25))
    vase = put("Vase", surface, place)
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = vase
    for ring in surface.splines:
        for point in ring.points:
            point.select = True
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.curve.make_segment()
    bpy.ops.object.mode_set(mode="OBJECT")
    body = surface.splines[0]
    body.use_cyclic_v, body.use_endpoint_u = True, True  # u along the profile, v around
    body.order_u, body.order_v = 4, 4
    body.resolution_u, body.resolution_v = 4, 5
    body.use_smooth = True


def paintings() -> None:
    """Three pictures over the sofa: layered hills in a frame."""
    dusk = [(0.62, 0.42, 0.25), (0.5, 0.2, 0.1), (0.25, 0.1, 0.09), (0.09, 0.07, 0.1), (0.03, 0.045, 0.06)]
    sea = [(0.66, 0.6, 0.48), (0.42, 0.5, 0.48), (0.16, 0.31, 0.34), (0.06, 0.16, 0.2), (0.03, 0.07, 0.1)]
    moss = [(0.68, 0.58, 0.36), (0.5, 0.44, 0.18), (0.24, 0.28, 0.1), (0.1, 0.16, 0.07), (0.04, 0.08, 0.05)]
    for number, (x, width, height, palette) in enumerate(
        ((-0.78, 0.5, 0.68, sea), (0.0, 0.86, 0.68, dusk), (0.78, 0.5, 0.68, moss)), 1
    ):
        bar = 0.025
        low = 1.16
        left = SOFA[0] + x - width / 2
        xs, zs = [0, bar, width - bar, width], [0, bar, height - bar, height]
        frame = lattice(xs, zs, 0.035 + SINK, lambda column, row: (column, row) != (1, 1))
        mesh_object(
            f"Picture Frame {number}", *frame, brass() if number == 2 else walnut(), (left, BACK_WALL - 0.035, low)
        )
        paints = [diffuse(f"Paint {number}{layer}", color) for layer, color in enumerate(palette, 1)]
        points, faces, layers = hills(width - 2 * bar + 0.004, height - 2 * bar + 0.004, number)
        canvas = mesh_object(
            f"Canvas {number}", points, faces, paints, (left + bar - 0.002, BACK_WALL - 0.015, low + bar - 0.002)
        )
        canvas.data.polygons.foreach_set("material_index", layers)


def hills(width: float, height: float, seed: int) -> tuple[list[Point], list[tuple[int, ...]], list[int]]:
    """A sheet that faces -y: five bands with wavy edges, and the band of each face, 0 on top."""
    dice = random.Random(seed)
    waves = [(dice.uniform(0, 6), dice.uniform(4, 9), dice.uniform(0.02, 0.05)) for _ in range(4)]
    steps, bands = 36, 5
    points: list[Point] = []
    for step in range(steps + 1):
        x = step / steps
        edges = [
            0.17 * (band + 1) + swing * math.sin(phase + speed * x) for band, (phase, speed, swing) in enumerate(waves)
        ]
        points += [(x * width, 0.0, z * height) for z in (0.0, *edges, 1.0)]
    row = bands + 1
    faces = [
        (s * row + b, (s + 1) * row + b, (s + 1) * row + b + 1, s * row + b + 1)
        for s in range(steps)
        for b in range(bands)
    ]
    return points, faces, [bands - 1 - b for _ in range(steps) for b in range(bands)]


def plant() -> None:
    """A pot with arching leaves in the corner by the window."""
    dice = random.Random(7)
    place = (0.62, 4.45)
    pot = [(0, 0), (0.13, 0), (0.17, 0.3), (0.175, 0.32), (0.155, 0.32), (0.15, 0.29), (0, 0.285)]
    smooth(
        mesh_object("Plant Pot", *lathe(pot, 32), glossy("Pot White", (0.7, 0.68, 0.64), 0.4), (*place, -SINK + 0.008))
    )
    shapes = []
    for number in range(26):
        angle = number * 2.39996 + dice.uniform(-0.2, 0.2)
        length, rise, wide = dice.uniform(0.7, 1.25), dice.uniform(1.15, 1.45), dice.uniform(0.026, 0.04)
        outward, side = (math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))
        points: list[Point] = []
        reach, height, steps = 0.02, 0.28, 9
        for step in range(steps + 1):
            along = step / steps
            half = wide * (math.sin(math.pi * (0.12 + 0.86 * along)) ** 0.7)
            for edge in (-1, 0, 1):
                lift = 0.25 * half * abs(edge)
                points.append(
                    (
                        outward[0] * reach + side[0] * half * edge,
                        outward[1] * reach + side[1] * half * edge,
                        height + lift,
                    )
                )
            lean = rise - 1.9 * along
            reach += length / steps * math.cos(lean)
            height += length / steps * math.sin(lean)
        faces = [(3 * s + e, 3 * s + 3 + e, 3 * s + 4 + e, 3 * s + 1 + e) for s in range(steps) for e in (0, 1)]
        shapes.append((points, faces))
    leaves = smooth(mesh_object("Plant Leaves", *joined(shapes), diffuse("Leaf", (0.075, 0.2, 0.05)), (*place, 0)), 180)
    thick = leaves.modifiers.new("Solidify", "SOLIDIFY")
    thick.thickness = 0.003
