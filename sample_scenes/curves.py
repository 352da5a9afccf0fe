# SPDX-License-Identifier: GPL-3.0-or-later
"""A small gallery at night, made of curves: a vase, a torus, a lofted ceiling, and neon that lights it all.

Run it with a Python that has bpy, or in Blender: `python curves.py [OUT.blend]`.

Nothing but the walls, the floor and the plinths is a mesh. The vase, the torus and the ceiling are NURBS surfaces, the
sign is a handful of bevelled Bezier curves, its cable and the lamp's ring are NURBS curves, the skirting carries the
outline of a bevel object, the horn is tapered. The arc over the torus is a bare curve with a tube radius of its own.
Metres; the sign hangs on the wall at y = 4, z is up.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from building import RGB, Paint, Point, box, diffuse, empty_scene, material, mesh_object, put, sky, write_when_run
from furniture import glossy

WIDTH, DEPTH, HEIGHT = 5.2, 4.0, 3.0

CIRCLE = [(1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1)]
CIRCLE_WEIGHTS = [math.sqrt(0.5), 1.0] * 4
"""Control points of the unit circle as a closed Bezier spline of order 3: it runs through every second one."""

SIGN = {
    "g": [(1.0, 0.8), (0.55, 1.0), (0.1, 0.5), (0.52, 0.02), (0.96, 0.45), (1.0, 0.95), (1.0, -0.3), (0.6, -0.85),
          (0.12, -0.6)],
    "l": [(1.3, 0.12), (1.66, 0.75), (1.76, 1.55), (1.58, 1.9), (1.44, 1.4), (1.46, 0.4), (1.68, 0.02), (1.95, 0.2)],
    "o": [(2.98, 0.5), (2.5, 1.0), (2.05, 0.5), (2.5, 0.0)],
    "w": [(3.2, 1.0), (3.26, 0.3), (3.5, 0.02), (3.8, 0.35), (3.9, 0.85), (3.98, 0.35), (4.25, 0.02), (4.55, 0.4),
          (4.6, 1.02)],
}  # fmt: skip
"""Strokes of the letters; the o is closed."""


def lit(name: str, color: RGB, radiance: float) -> Paint:
    """An Emission material."""
    return material(name, "ShaderNodeEmission", Color=color, Strength=radiance)


def bezier(
    name: str, strokes: Sequence[tuple[Sequence[Point], bool]], paint: Paint | None, **settings: object
) -> bpy.types.Object:
    """A curve object of smooth strokes, each with its points and whether it is closed."""
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions = "3D"
    for points, closed in strokes:
        spline = data.splines.new("BEZIER")
        spline.bezier_points.add(len(points) - 1)
        for knot, point in zip(spline.bezier_points, points, strict=True):
            knot.co = point
            knot.handle_left_type = knot.handle_right_type = "AUTO"
        spline.use_cyclic_u = closed
    return finished(data, paint, settings)


def nurbs(
    name: str, points: Sequence[Point], paint: Paint | None, closed: bool = False, **settings: object
) -> bpy.types.Object:
    """A cubic NURBS curve that meets its ends."""
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions = "3D"
    spline = data.splines.new("NURBS")
    spline.points.add(len(points) - 1)
    for knot, point in zip(spline.points, points, strict=True):
        knot.co = (*point, 1.0)
    spline.order_u, spline.use_cyclic_u, spline.use_endpoint_u = 4, closed, not closed
    return finished(data, paint, settings)


def finished(data: bpy.types.Curve, paint: Paint | None, settings: dict[str, object]) -> bpy.types.Object:
    """An object of a curve with these settings."""
    for key, value in settings.items():
        setattr(data, key, value)
    if paint is not None:
        data.materials.append(paint)
    return put(data.name, data)


def surface(
    name: str, points: np.ndarray, weights: np.ndarray, paint: Paint, location: Point, **settings: object
) -> bpy.types.Object:
    """A NURBS surface of control points (V, U, 3); the settings are those of its spline.

    Scripts can't make surfaces of several rows, so the first row is extruded into the others.
    """
    rows, columns = weights.shape
    data = bpy.data.curves.new(name, "SURFACE")
    spline = data.splines.new("NURBS")
    spline.points.add(columns - 1)
    for index, point in enumerate(spline.points):
        point.co = (index, 0, 0, 1)
    made = put(name, data, location)
    bpy.context.view_layer.objects.active = made
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.curve.select_all(action="SELECT")
    for _ in range(rows - 1):
        bpy.ops.curve.extrude(mode="TRANSLATION")
    bpy.ops.object.mode_set(mode="OBJECT")
    spline = data.splines[0]
    spline.points.foreach_set("co", np.concatenate([points, weights[..., None]], axis=2).astype(np.float32).ravel())
    for key, value in settings.items():
        setattr(spline, key, value)
    spline.use_smooth = True
    data.materials.append(paint)
    return made


def turned(
    name: str,
    profile: Sequence[tuple[float, float]],
    weights: Sequence[float],
    paint: Paint,
    location: Point,
    **settings: object,
) -> bpy.types.Object:
    """A profile of (radius, height) turned about z; exactly round."""
    corner = np.array(CIRCLE, float)
    ring = np.array(CIRCLE_WEIGHTS)
    radius, height = np.array(profile, float).T
    points = np.stack(
        [radius[:, None] * corner[:, 0], -radius[:, None] * corner[:, 1], height[:, None] + 0 * ring], axis=2
    )
    return surface(
        name, points, np.array(weights)[:, None] * ring, paint, location,
        order_u=3, use_cyclic_u=True, use_bezier_u=True, **settings,
    )  # fmt: skip


def build_room() -> None:
    """Walls, floor, plinths, and a ceiling that sweeps over them."""
    wall, boards = diffuse("Plaster", (0.55, 0.53, 0.56)), glossy("Boards", (0.24, 0.15, 0.10), 0.4)
    w, d, h = WIDTH / 2, DEPTH, HEIGHT
    mesh_object("Floor", [(-w, 0, 0), (w, 0, 0), (w, d, 0), (-w, d, 0)], [(0, 1, 2, 3)], boards)
    corners = [
        (-w, 0, 0),
        (-w, d, 0),
        (w, d, 0),
        (w, 0, 0),
        (-w, 0, h + 0.6),
        (-w, d, h + 0.6),
        (w, d, h + 0.6),
        (w, 0, h + 0.6),
    ]
    mesh_object("Walls", corners, [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)][:3], wall)
    stone = diffuse("Stone", (0.66, 0.64, 0.6))
    box("Tall Plinth", (0.5, 0.5, 0.95), stone, (-1.35, 2.5, 0), bevel=0.015)
    box("Low Plinth", (0.9, 0.7, 0.45), stone, (1.25, 2.35, 0), bevel=0.015)
    white = diffuse("Ceiling White", (0.8, 0.79, 0.77))
    x, y = np.meshgrid(np.linspace(-w, w, 7), np.linspace(0, d, 6))
    wave = h + 0.28 * np.sin(x * 1.9 + 0.6 * y) + 0.12 * np.cos(1.7 * y)
    surface(
        "Lofted Ceiling", np.stack([x, y, wave], axis=2), np.ones(x.shape), white,
        (0, 0, 0), order_u=4, order_v=4, use_endpoint_u=True, use_endpoint_v=True,
    )  # fmt: skip
    outline = nurbs_outline("Skirting Outline", [(0, 0.1), (0.012, 0.1), (0.025, 0.07), (0.025, 0)])
    inset = 0.001
    along = [(-w + inset, 0.0, 0.0), (-w + inset, d - inset, 0.0), (w - inset, d - inset, 0.0), (w - inset, 0.0, 0.0)]
    poly("Skirting", along, glossy("Skirting White", (0.7, 0.69, 0.67), 0.3), outline)


def nurbs_outline(name: str, points: Sequence[tuple[float, float]]) -> bpy.types.Object:
    """A flat open outline to carry along other curves; hidden, it shows nothing by itself."""
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions = "2D"
    data.fill_mode = "NONE"
    spline = data.splines.new("POLY")
    spline.points.add(len(points) - 1)
    for knot, (x, y) in zip(spline.points, points, strict=True):
        knot.co = (x, y, 0, 1)
    made = put(name, data, (0, -1, 0))
    made.hide_render = True
    return made


def poly(name: str, points: Sequence[Point], paint: Paint, outline: bpy.types.Object) -> bpy.types.Object:
    """A moulding along straight pieces."""
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions = "3D"
    data.twist_mode = "Z_UP"
    data.bevel_mode, data.bevel_object = "OBJECT", outline
    for start, stop in pairwise(points):
        spline = data.splines.new("POLY")
        spline.points.add(1)
        spline.points[0].co, spline.points[1].co = (*start, 1), (*stop, 1)
    data.materials.append(paint)
    return put(name, data)


def build_exhibits() -> None:
    """The vase, the torus under its arc, and a horn on the floor."""
    glaze = glossy("Glaze", (0.05, 0.30, 0.33), 0.25)
    outside = [
        (0.0, 0.0),
        (0.13, 0.0),
        (0.13, 0.02),
        (0.32, 0.16),
        (0.26, 0.40),
        (0.06, 0.46),
        (0.08, 0.58),
        (0.15, 0.62),
    ]
    inside = [(0.135, 0.62), (0.065, 0.575), (0.045, 0.46), (0.24, 0.39), (0.28, 0.18), (0.0, 0.04)]
    profile = outside + inside
    turned("Vase", profile, [1.0] * len(profile), glaze, (-1.35, 2.5, 0.95), order_v=4, use_endpoint_v=True)
    tube = [(0.30 + 0.105 * x, 0.105 * y) for x, y in CIRCLE]
    ring = turned("Torus", tube, CIRCLE_WEIGHTS, glossy("Coral", (0.72, 0.18, 0.08), 0.35), (1.25, 2.35, 0.85),
                  order_v=3, use_cyclic_v=True, use_bezier_v=True)  # fmt: skip
    ring.rotation_euler = (math.radians(78), 0, math.radians(24))
    turns = np.linspace(0, 4.6 * np.pi, 26)
    spiral = [(0.32 * math.cos(t) * (1 - t / 26), 0.32 * math.sin(t) * (1 - t / 26), 0.10 + 0.052 * t) for t in turns]
    taper = nurbs("Horn Taper", [(0, 1.0, 0), (0.3, 0.85, 0), (0.7, 0.5, 0), (1, 0.12, 0)], None)
    taper.hide_render = True
    taper.location = (0, -1, 0)
    horn = nurbs("Horn", spiral, glossy("Brass", (0.70, 0.48, 0.18), 0.3), bevel_depth=0.09, bevel_resolution=4,
                 taper_object=taper, use_fill_caps=True)  # fmt: skip
    horn.location = (-0.25, 1.75, 0)


def build_light() -> None:
    """The sign, the ring above, and the arc: all the light there is, but for a breath of blue night."""
    scale, left, base = 0.46, -1.02, 1.62
    strokes = [
        ([(left + scale * x, 0, base + scale * y) for x, y in points], letter == "o") for letter, points in SIGN.items()
    ]
    sign = bezier(
        "Neon Sign", strokes, lit("Neon Pink", (1.0, 0.16, 0.36), 30.0), bevel_depth=0.018, use_fill_caps=True
    )
    sign.location.y = DEPTH - 0.06
    line = [
        (left - 0.1, 0, base - 0.52),
        (0.0, 0, base - 0.62),
        (0.8, 0, base - 0.5),
        (left + scale * 4.9, 0, base - 0.58),
    ]
    under = bezier(
        "Neon Line", [(line, False)], lit("Neon Blue", (0.12, 0.45, 1.0), 24.0), bevel_depth=0.014, use_fill_caps=True
    )
    under.location.y = DEPTH - 0.05
    cable = [
        (left + scale * 4.9, DEPTH - 0.05, base - 0.58),
        (1.6, DEPTH - 0.05, 0.8),
        (1.5, DEPTH - 0.05, 0.3),
        (2.0, DEPTH - 0.05, 0.02),
        (2.55, DEPTH - 0.06, 0.03),
    ]
    nurbs("Cable", cable, diffuse("Cable Black", (0.02, 0.02, 0.02)), bevel_depth=0.008)
    around = [(0.52 * math.cos(k * math.pi / 4), 0.52 * math.sin(k * math.pi / 4), 0.0) for k in range(8)]
    ring = nurbs("Ring Lamp", around, lit("Warm Tube", (1.0, 0.72, 0.42), 22.0), closed=True, bevel_depth=0.02)
    ring.location, ring.rotation_euler = (0.05, 1.9, 2.42), (math.radians(-14), math.radians(6), 0)
    arc = [(0.56 * math.cos(t), 0.0, 0.56 * math.sin(t)) for t in np.linspace(0.12 * math.pi, 0.88 * math.pi, 7)]
    bare = bezier("Bare Arc", [(arc, False)], lit("Cool Tube", (0.55, 0.85, 1.0), 14.0))
    bare.location, bare.rotation_euler = (1.25, 2.3, 0.86), (0, 0, math.radians(24))
    if hasattr(bare, "radiosity"):
        bare.radiosity.tube_radius = 0.011
    else:  # without the extension its settings are what a file holds of them
        bare["radiosity"] = {"tube_radius": 0.011}


def build() -> bpy.types.Scene:
    """The whole scene."""
    scene = empty_scene()
    sky(scene, (0.10, 0.16, 0.30), 0.12)
    build_room()
    build_exhibits()
    build_light()
    camera = bpy.data.cameras.new("Camera")
    camera.lens = 28
    scene.camera = put("Camera", camera, (0.15, -2.05, 1.55), rotation_euler=(math.radians(88.5), 0, math.radians(1)))
    scene.render.resolution_x, scene.render.resolution_y = 1280, 800
    scene.view_settings.view_transform = "AgX"
    return scene


if __name__ == "__main__":
    write_when_run(build, __file__)
