# SPDX-License-Identifier: GPL-3.0-or-later
"""Curve and surface objects with every setting that a test asks for, and what Blender makes of them."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from radiosity_addon.blender.job import Job, bake_scene
from radiosity_addon.files import Transaction
from radiosity_addon.reports.report import Report
from radiosity_addon.settings import BakeSettings

ENDS = ("LINEAR", "CARDINAL", "BSPLINE", "EASE")


@dataclass
class Shown:
    """Blender's evaluated mesh: vertices (V, 3), and by loop the vertex and the texture coordinates."""

    vertices: np.ndarray
    loop_vertex: np.ndarray
    loop_uv: np.ndarray

    @property
    def size(self) -> float:
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0))) if len(self.vertices) else 0.0


def shown(thing: bpy.types.Object) -> Shown:
    thing.data.update_tag()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    evaluated = thing.evaluated_get(depsgraph)
    mesh = evaluated.to_mesh()
    vertices, loops = np.empty(len(mesh.vertices) * 3, np.float32), np.empty(len(mesh.loops), np.int32)
    uv = np.zeros(len(mesh.loops) * 2, np.float32)
    mesh.vertices.foreach_get("co", vertices)
    mesh.loops.foreach_get("vertex_index", loops)
    if mesh.uv_layers:
        mesh.uv_layers[0].uv.foreach_get("vector", uv)
    evaluated.to_mesh_clear()
    return Shown(vertices.reshape(-1, 3), loops, uv.reshape(-1, 2))


def link(name: str, data: bpy.types.ID) -> bpy.types.Object:
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def put(owners: list[bpy.types.bpy_struct], settings: dict[str, object]) -> None:
    for name, value in settings.items():
        setattr(next(owner for owner in owners if hasattr(owner, name)), name, value)


def curve_object(kind: str, points: int = 5, seed: int = 0, **settings: object) -> bpy.types.Object:
    """A wild spline around the origin: weights, radii and tilts differ from point to point."""
    random = np.random.default_rng(seed)
    data = bpy.data.curves.new("Curve", "CURVE")
    data.dimensions = "3D"
    spline = data.splines.new(kind)
    angle = np.arange(points) / points * 2 * np.pi
    places = 2 * np.stack([np.cos(angle), np.sin(angle), 0.3 * random.normal(size=points)], axis=1)
    places += 0.3 * random.normal(size=(points, 3))
    if kind == "BEZIER":
        spline.bezier_points.add(points - 1)
        for point, place in zip(spline.bezier_points, places, strict=True):
            point.handle_left_type = point.handle_right_type = "FREE"
            point.co = place
            point.handle_left = place + random.normal(size=3) * 0.5
            point.handle_right = place + random.normal(size=3) * 0.5
            point.radius, point.tilt = 1 + 0.3 * random.normal(), random.normal()
    else:
        spline.points.add(points - 1)
        for point, place in zip(spline.points, places, strict=True):
            point.co = (*place, 1 + random.random())
            point.radius, point.tilt = 1 + 0.3 * random.normal(), random.normal()
    spline.resolution_u = 4
    put([spline, data], settings)
    return link("Curve", data)


def taper_object(kind: str, **settings: object) -> bpy.types.Object:
    """A curve from left to right whose height is a profile's size."""
    thing = curve_object(kind, 6, **settings)
    spline = thing.data.splines[0]
    for i, point in enumerate(spline.bezier_points if kind == "BEZIER" else spline.points):
        place = (i, 0.7 + 0.5 * np.sin(i), 0)
        point.co = place if kind == "BEZIER" else (*place, 1)
        if kind == "BEZIER":
            point.handle_left, point.handle_right = (i - 0.3, place[1] + 0.2, 0), (i + 0.3, place[1] + 0.1, 0)
    return thing


def surface_object(count_u: int, count_v: int, weighted: bool = True, **settings: object) -> bpy.types.Object:
    """A wavy sheet; its rows are made by extruding, since scripts can't make surfaces."""
    random = np.random.default_rng(count_u * 10 + count_v)
    data = bpy.data.curves.new("Surface", "SURFACE")
    spline = data.splines.new("NURBS")
    spline.points.add(count_u - 1)
    for i, point in enumerate(spline.points):
        point.co = (i, 0, 0, 1)
    thing = link("Surface", data)
    bpy.context.view_layer.objects.active = thing
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.curve.select_all(action="SELECT")
    for _ in range(count_v - 1):
        bpy.ops.curve.extrude(mode="TRANSLATION")
    bpy.ops.object.mode_set(mode="OBJECT")
    spline = data.splines[0]
    x, y = np.meshgrid(np.arange(count_u), np.arange(count_v))
    values = np.stack([x, y, 0 * x, 1 + 0 * x], axis=2).astype(np.float32)
    values[..., :3] += 0.4 * random.normal(size=(count_v, count_u, 3))
    if weighted:
        values[..., 3] += random.random((count_v, count_u))
    spline.points.foreach_set("co", values.ravel())
    put([spline, data], settings)
    return thing


def bake_all(scene: bpy.types.Scene, quality: str = "draft", page_size: int = 128) -> Report:
    """Bake a scene into the open file."""
    settings = BakeSettings(quality=quality, page_size=page_size)
    with Transaction() as files:
        steps = bake_scene(scene, Job(settings, "preview", None, "page"), files)
        while True:
            try:
                next(steps)
            except StopIteration as stop:
                return stop.value
