# SPDX-License-Identifier: GPL-3.0-or-later
"""A pavilion of splines: a NURBS vault over NURBS columns, a bevelled rail, text, a metaball, under sun and sky."""

from __future__ import annotations

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "sample_scenes"))
import bpy
from building import Paint, Point, diffuse, empty_scene, mesh_object, put, sky, write_when_run
from parts import finish, plank, sun

SINK = 0.004


def nurbs(name: str, rows: list[list[Point]], paint: Paint, cyclic_u: bool = False) -> bpy.types.Object:
    """A NURBS surface over a grid of control points, clamped where it is not cyclic; v runs along the rows' list."""
    data = bpy.data.curves.new(name, "SURFACE")
    data.dimensions = "3D"
    for row in rows:
        spline = data.splines.new("NURBS")
        spline.points.add(len(row) - 1)
        for point, place in zip(spline.points, row, strict=True):
            point.co = (*place, 1.0)
            point.select = True
    data.materials.append(paint)
    made = put(name, data)
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = made
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.curve.select_all(action="SELECT")
    bpy.ops.curve.make_segment()
    bpy.ops.object.mode_set(mode="OBJECT")
    surface = data.splines[0]
    # after joining, u runs along the rows' list and v along each row
    surface.use_endpoint_u, surface.use_endpoint_v = True, not cyclic_u
    surface.use_cyclic_v = cyclic_u
    surface.order_u = surface.order_v = 4
    surface.resolution_u = surface.resolution_v = 6
    surface.use_smooth = True
    return made


def build() -> object:
    """Make the scene in Blender."""
    scene = empty_scene()
    sky(scene, (0.55, 0.72, 1.0), 1.0)
    sun(scene, 4.0, 50, 40, (1.0, 0.9, 0.75), 1.0)
    stone, clay = diffuse("Stone", (0.6, 0.57, 0.5)), diffuse("Clay", (0.55, 0.27, 0.16))
    mesh_object("Plinth", *plank((6.4, 4.4, 0.3), (3.0, 2.0, -0.3)), stone)
    steps = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    rows = [
        [(x, y, 2.4 + 0.9 * math.sin(math.pi * y / 4.0) + 0.25 * math.cos(x)) for x in steps]
        for y in (0.0, 1.0, 2.0, 3.0, 4.0)
    ]
    vault = nurbs("Vault", rows, diffuse("Vault", (0.7, 0.66, 0.58)))
    thick = vault.modifiers.new("Solidify", "SOLIDIFY")
    thick.thickness = 0.06
    for number, (x, y) in enumerate(((0.5, 0.4), (5.5, 0.4), (0.5, 3.6), (5.5, 3.6)), 1):
        rings = [(0.26, -SINK), (0.2, 0.3), (0.14, 1.1), (0.15, 1.9), (0.3, 2.75)]
        circle = [math.pi * step / 4 for step in range(8)]
        rows = [[(x + 1.1 * r * math.cos(-a), y + 1.1 * r * math.sin(-a), z) for a in circle] for r, z in rings]
        nurbs(f"Column {number}", rows, stone, cyclic_u=True)
    rail = bpy.data.curves.new("Rail", "CURVE")
    rail.dimensions, rail.bevel_depth, rail.bevel_resolution, rail.resolution_u = "3D", 0.04, 3, 12
    rail.use_fill_caps = True
    path = rail.splines.new("BEZIER")
    knots = [(0.3, 0.9, 0.9), (0.25, 2.0, 1.05), (0.3, 3.3, 0.9)]
    path.bezier_points.add(len(knots) - 1)
    for point, place in zip(path.bezier_points, knots, strict=True):
        point.co = place
        point.handle_left_type = point.handle_right_type = "AUTO"
    rail.materials.append(clay)
    put("Rail", rail)
    text = bpy.data.curves.new("Letters", "FONT")
    text.body, text.size, text.extrude, text.align_x = "SPLINE", 0.7, 0.06, "CENTER"
    text.materials.append(clay)
    put("Letters", text, (3.0, 3.2, 0.02), rotation_euler=(math.radians(80), 0, 0))
    ball = bpy.data.metaballs.new("Drop")
    ball.resolution = ball.render_resolution = 0.12
    for place, radius in (((0, 0, 0), 0.6), ((0.35, 0.1, 0.2), 0.45)):
        element = ball.elements.new()
        element.co, element.radius = place, radius
    ball.materials.append(diffuse("Drop", (0.15, 0.3, 0.45)))
    put("Drop", ball, (3.9, 1.4, 0.42))
    return finish(scene, (6.6, -2.2, 1.7), 2, 32, 20.0, 0.0)


if __name__ == "__main__":
    write_when_run(build, __file__)
