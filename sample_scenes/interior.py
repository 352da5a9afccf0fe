# SPDX-License-Identifier: GPL-3.0-or-later
"""An architect's living room in late afternoon: low sun through a wide window, sky, and the lamps already on.

Run it with a Python that has bpy, or in Blender: `python interior.py [OUT.blend]`.

It holds what a bake must cope with: modifiers (bevel, subdivision, array, solidify), mirrored and stretched objects,
several materials an object, a NURBS surface, a bevelled curve, Principled, Diffuse and Emission shaders, lamps of all
kinds and two bulbs that are lit meshes. Inside, x runs from the window wall at 0, y towards the green wall at 5, z up;
metres.
"""

from __future__ import annotations

import math
import random
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))
import furniture
from building import (
    RGB,
    Paint,
    Point,
    box,
    box_shape,
    diffuse,
    empty_scene,
    joined,
    lathe,
    lattice,
    material,
    mesh_object,
    put,
    room,
    sky,
    smooth,
    write_when_run,
)
from furniture import SINK, SOFA, TABLE, brass, glossy, legs, sphere, walnut

WIDTH, LENGTH, HEIGHT = 6.0, furniture.BACK_WALL, 2.8
WALL = 0.25
WINDOW = ((1.3, 4.1), (0.45, 2.35))
"""y and z"""


def lit(name: str, color: RGB, radiance: float) -> Paint:
    """An Emission material."""
    return material(name, "ShaderNodeEmission", Color=color, Strength=radiance)


def build_shell() -> None:
    """Walls with the window opening, oak boards, skirting, and the window's frame, sill and curtains."""
    white = diffuse("Wall White", (0.78, 0.76, 0.72))
    green = diffuse("Wall Green", (0.07, 0.165, 0.145))
    shell = mesh_object(
        "Walls",
        *room((LENGTH, WIDTH, HEIGHT), WALL, WINDOW),
        (white, green),
        (WIDTH, 0, 0),
        rotation_euler=(0, 0, math.pi / 2),
    )
    shell.data.polygons[3].material_index = 1
    build_floor()
    joinery = glossy("Joinery White", (0.75, 0.74, 0.71), 0.35)
    skirting = [
        box_shape((-SINK, -SINK, -SINK), (0.016, LENGTH + SINK, 0.09)),
        box_shape((0.008, LENGTH - 0.016, -SINK), (WIDTH - 0.008, LENGTH + SINK, 0.089)),
        box_shape((WIDTH - 0.016, -SINK, -SINK), (WIDTH + SINK, LENGTH + SINK, 0.091)),
        box_shape((0.007, -SINK, -SINK), (WIDTH - 0.007, 0.016, 0.092)),
    ]
    mesh_object("Skirting", *joined(skirting), joinery)

    (south, north), (bottom, top) = WINDOW
    bar = 0.06
    third = (north - south) / 3
    ys = [0.0]
    for pane in range(3):
        ys += [pane * third + bar / (1 if pane == 0 else 2), (pane + 1) * third - bar / (1 if pane == 2 else 2)]
    ys = sorted({round(y, 6) for y in [-SINK, *ys[1:], north - south + SINK]})
    zs = [-SINK, bar, 1.35, 1.35 + bar, top - bottom - bar, top - bottom + SINK]
    frame = lattice(ys, zs, 0.07, lambda column, row: column % 2 == 0 or row % 2 == 0)
    made = mesh_object("Window Frame", *frame, glossy("Frame Dark", (0.035, 0.035, 0.04), 0.4))
    made.location, made.rotation_euler = (-0.08, south, bottom), (0, 0, math.pi / 2)
    box("Window Sill", (0.32, north - south + 0.16, 0.045), joinery, (0.0, (south + north) / 2, bottom - 0.035), 0.008)

    linen = diffuse("Linen", (0.7, 0.63, 0.52))
    curtain = curtain_mesh(0.62, 2.55, linen)
    for name, y, mirror in (("Curtain Left", south + 0.12, 1), ("Curtain Right", north - 0.12, -1)):
        hung = put(name, curtain, (0.17, y, 0.03), scale=(1, mirror, 1))
        thick = hung.modifiers.new("Solidify", "SOLIDIFY")
        thick.thickness = 0.006
    rod = mesh_object("Curtain Rod", *lathe([(0, 0), (0.014, 0), (0.014, 4.0), (0, 4.0)], 12), brass())
    smooth(rod)
    rod.location, rod.rotation_euler = (0.17, LENGTH / 2 + 2.2, 2.62), (math.pi / 2, 0, 0)


def build_floor() -> None:
    """Oak boards of five tones, as one closed slab."""
    dice = random.Random(4)
    tones = [(0.33, 0.185, 0.095), (0.37, 0.21, 0.11), (0.30, 0.165, 0.08), (0.40, 0.235, 0.125), (0.35, 0.19, 0.09)]
    oak = [glossy(f"Oak {number}", tone, 0.45) for number, tone in enumerate(tones, 1)]
    rows, columns = 30, 20
    xs = [-SINK + (WIDTH + 2 * SINK) * step / columns for step in range(columns + 1)]
    ys = [-SINK + (LENGTH + 2 * SINK) * step / rows for step in range(rows + 1)]
    shape = lattice(xs, ys, 0.006, lambda column, row: True)
    boards = mesh_object("Floor Boards", *shape, oak, (0, 0, 0.002), rotation_euler=(math.pi / 2, 0, 0))
    boards.scale = (1, 1, -1)  # the grid lies in x and z: laid flat and turned to face up
    tone = {}
    for row in range(rows):
        column = -dice.randrange(6)
        while column < columns:
            span, paint = dice.choice((5, 6, 7, 8)), dice.randrange(len(oak))
            tone.update(((place, row), paint) for place in range(column, column + span))
            column += span
    for polygon in boards.data.polygons:
        column = min(int((polygon.center.x - xs[0]) / (xs[1] - xs[0])), columns - 1)
        row = min(int((polygon.center.z - ys[0]) / (ys[1] - ys[0])), rows - 1)
        polygon.material_index = tone[column, row]


def curtain_mesh(width: float, height: float, paint: Paint) -> bpy.types.Mesh:
    """A hanging sheet in folds, in the y-z plane."""
    steps = 48
    points: list[Point] = []
    for level, spread in ((0.0, 1.0), (height * 0.5, 0.95), (height, 0.85)):
        for step in range(steps + 1):
            along = step / steps - 0.5
            points.append((0.055 * math.sin(7 * 2 * math.pi * along), along * width * spread, level))
    row = steps + 1
    faces = [
        (level * row + step, level * row + step + 1, (level + 1) * row + step + 1, (level + 1) * row + step)
        for level in range(2)
        for step in range(steps)
    ]
    mesh = bpy.data.meshes.new("Curtain")
    mesh.from_pydata(points, [], faces)
    mesh.materials.append(paint)
    mesh.shade_smooth()
    return mesh


def lamp(name: str, kind: str, place: Point, watts: float, color: RGB, **attributes: object) -> bpy.types.Object:
    """A lamp object; further attributes go to the lamp."""
    data = bpy.data.lights.new(name, kind)
    data.energy, data.color = watts, color
    for key, value in attributes.items():
        setattr(data, key, value)
    return put(name, data, place)


def build_lamps() -> None:
    """Arc lamp with a lit bulb, table lamp, ceiling lamp, picture spots, and a pendant bulb over the plant."""
    warm = (1.0, 0.66, 0.36)
    shade_out = [(0.04, 0.17), (0.1, 0.15), (0.17, 0.09), (0.2, 0.0)]
    shade_in = [(0.194, 0.0), (0.164, 0.086), (0.096, 0.144), (0.0, 0.16)]
    dome = lathe([(0, 0.172), *shade_out, *shade_in], 40)
    x, y = TABLE
    head = (x + 0.25, y + 0.25, 1.72)
    black = glossy("Enamel Black", (0.02, 0.02, 0.022), 0.35)
    shade = mesh_object("Arc Lamp Shade", *dome, black, head)
    shade.data.flip_normals()  # the profile runs from the top down
    smooth(shade, 60)
    bulb = lit("Bulb", warm, 120.0)
    smooth(mesh_object("Arc Lamp Bulb", *sphere(0.045, 16, 10), bulb, (head[0], head[1], head[2] + 0.06)), 180)
    curve = bpy.data.curves.new("Arc Lamp Arm", "CURVE")
    curve.dimensions, curve.bevel_depth, curve.bevel_resolution, curve.resolution_u = "3D", 0.011, 2, 20
    curve.use_fill_caps = True
    path = curve.splines.new("BEZIER")
    foot = (4.12, 4.62)
    knots = [
        ((*foot, 0.03), (*foot, -0.3), (*foot, 0.7)),
        (
            (foot[0] - 0.15, foot[1] - 0.2, 1.75),
            (foot[0] - 0.02, foot[1] - 0.02, 1.35),
            (foot[0] - 0.32, foot[1] - 0.42, 2.2),
        ),
        (
            (head[0], head[1], head[2] + 0.165),
            (head[0] + 0.35, head[1] + 0.5, head[2] + 0.75),
            (head[0], head[1], head[2]),
        ),
    ]
    path.bezier_points.add(len(knots) - 1)
    for point, (at, before, after) in zip(path.bezier_points, knots, strict=True):
        point.co, point.handle_left, point.handle_right = at, before, after
    curve.materials.append(brass())
    put("Arc Lamp Arm", curve)
    disc = [(0, -SINK + 0.008), (0.16, -SINK + 0.008), (0.16, 0.035), (0.15, 0.045), (0, 0.045)]
    smooth(mesh_object("Arc Lamp Foot", *lathe(disc, 36), black, (*foot, 0)))

    side = (1.28, 4.55)
    top = [(0, 0.5), (0.22, 0.5), (0.22, 0.52), (0, 0.52)]
    smooth(mesh_object("Side Table Top", *lathe(top, 36), walnut(), (*side, 0)))
    legs("Side Table Legs", [(0.14, 0), (-0.07, 0.12), (-0.07, -0.12)], 0.502, 0.3).location = (*side, 0.008)
    base = [(0, 0.519), (0.07, 0.519), (0.1, 0.58), (0.085, 0.66), (0.03, 0.73), (0.015, 0.76), (0, 0.76)]
    smooth(
        mesh_object("Table Lamp Base", *lathe(base, 32), glossy("Ink Glaze", (0.03, 0.07, 0.13), 0.2), (*side, 0)), 60
    )
    ring = [(0.16, 0.8), (0.11, 1.02), (0.106, 1.02), (0.156, 0.8)]
    paper = diffuse("Paper", (0.8, 0.74, 0.62))
    smooth(mesh_object("Table Lamp Shade", *lathe(ring, 40, ring=True), paper, (*side, 0)))
    lamp("Table Lamp", "POINT", (*side, 0.88), 9.0, warm, shadow_soft_size=0.035)

    plate = [(0, 2.77), (0.24, 2.77), (0.25, 2.78), (0.25, HEIGHT + SINK), (0, HEIGHT + SINK)]
    white = bpy.data.materials["Joinery White"]
    smooth(mesh_object("Ceiling Plate", *lathe(plate, 48), white, (2.75, 3.0, 0)))
    lamp(
        "Ceiling Lamp", "AREA", (2.75, 3.0, 2.765), 16.0, (1.0, 0.8, 0.58), shape="DISK", size=0.44
    ).visible_camera = True
    for number, offset in enumerate((-0.78, 0.78), 1):
        place = (SOFA[0] + offset, 4.05)
        can = [(0, 2.68), (0.034, 2.68), (0.034, HEIGHT + SINK), (0, HEIGHT + SINK)]
        smooth(mesh_object(f"Spot Can {number}", *lathe(can, 20), black, (*place, 0)))
        spot = lamp(f"Picture Spot {number}", "SPOT", (*place, 2.67), 70.0, warm, shadow_soft_size=0.02)
        spot.data.spot_size, spot.data.spot_blend = math.radians(58), 0.5
        spot.rotation_euler = (math.radians(31), 0, 0)

    cord = [(0, 2.15), (0.004, 2.15), (0.004, HEIGHT + SINK), (0, HEIGHT + SINK)]
    mesh_object("Pendant Cord", *lathe(cord, 8), black, (5.35, 3.6, 0))
    globe = lit("Pendant Globe", (1.0, 0.74, 0.48), 10.0)
    smooth(mesh_object("Pendant Globe", *sphere(0.11, 24, 14), globe, (5.35, 3.6, 2.05)), 180)


def build_daylight(scene: bpy.types.Scene) -> None:
    """Late sun from the window side, and a clear sky."""
    sky(scene, (0.55, 0.76, 1.0), 2.4)
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle, sun.color = 26.0, math.radians(0.6), (1.0, 0.82, 0.6)
    put("Sun", sun, (-3, 1, 4), rotation_euler=(0, math.radians(-57), math.radians(14)))


def build() -> bpy.types.Scene:
    """Make the scene in Blender."""
    scene = empty_scene()
    build_shell()
    furniture.sofa()
    furniture.chairs()
    furniture.table()
    furniture.shelf()
    furniture.paintings()
    furniture.plant()
    build_lamps()
    build_daylight(scene)
    camera = bpy.data.cameras.new("Camera")
    camera.lens = 21.0
    scene.camera = put("Camera", camera, (5.4, 0.25, 1.4), rotation_euler=(math.radians(84.8), 0, math.radians(34)))
    scene.render.resolution_x, scene.render.resolution_y = 1280, 800
    scene.view_settings.view_transform = "AgX"
    scene.view_settings.look = "AgX - Medium High Contrast"
    scene.view_settings.exposure = 0.75
    scene.cycles.samples = 256
    scene.cycles.use_denoising = True
    return scene


if __name__ == "__main__":
    write_when_run(build, __file__)
