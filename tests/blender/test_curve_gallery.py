# SPDX-License-Identifier: GPL-3.0-or-later
"""One of every kind of curve and surface in a row, baked together."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.blender.writing.revert import revert
from tests.blender.spline_objects import bake_all, curve_object, link


def from_operator(operator, **settings: object) -> bpy.types.Object:
    operator()
    thing = bpy.context.object
    for name, value in settings.items():
        setattr(thing.data, name, value)
    return thing


def calm(thing: bpy.types.Object) -> bpy.types.Object:
    """Without the wild tilts and radii that tests of agreement want."""
    spline = thing.data.splines[0]
    for point in spline.bezier_points if spline.type == "BEZIER" else spline.points:
        point.tilt, point.radius = 0.0, 1.0
    return thing


def ring(**settings: object) -> bpy.types.Object:
    return from_operator(bpy.ops.curve.primitive_bezier_circle_add, **settings)


def moulding() -> bpy.types.Object:
    outline = calm(curve_object("POLY", 4, use_cyclic_u=True))
    outline.scale, outline.hide_render = (-0.05, 0.05, 0.05), True  # faces outward
    return from_operator(bpy.ops.curve.primitive_nurbs_circle_add, bevel_mode="OBJECT", bevel_object=outline)


def horn() -> bpy.types.Object:
    taper = calm(curve_object("NURBS", 4))
    for i, point in enumerate(taper.data.splines[0].points):
        point.co = (i, 1 - 0.2 * i, 0, 1)
    taper.hide_render = True
    path = from_operator(bpy.ops.curve.primitive_nurbs_path_add, bevel_depth=0.2, use_fill_caps=True)
    path.data.taper_object = taper
    return path


def text() -> bpy.types.Object:
    thing = link("Text", bpy.data.curves.new("Text", "FONT"))
    thing.data.body, thing.data.extrude = "a", 0.05
    return thing


def flat() -> bpy.types.Object:
    return ring(dimensions="2D", fill_mode="BOTH", extrude=0.1)


def facets() -> bpy.types.Object:
    thing = from_operator(bpy.ops.surface.primitive_nurbs_surface_torus_add)
    thing.data.splines[0].use_smooth = False
    return thing


def wave() -> bpy.types.Object:
    thing = ring(bevel_depth=0.1)
    thing.modifiers.new("Wave", "WAVE")
    return thing


def thread() -> bpy.types.Object:
    thing = from_operator(bpy.ops.curve.primitive_bezier_curve_add)
    thing.radiosity.tube_radius = 0.03
    return thing


KINDS = {
    "sphere": lambda: from_operator(bpy.ops.surface.primitive_nurbs_surface_sphere_add),
    "torus": lambda: from_operator(bpy.ops.surface.primitive_nurbs_surface_torus_add),
    "cylinder": lambda: from_operator(bpy.ops.surface.primitive_nurbs_surface_cylinder_add),
    "sheet": lambda: from_operator(bpy.ops.surface.primitive_nurbs_surface_surface_add),
    "tube": lambda: ring(bevel_depth=0.1),
    "ribbon": lambda: ring(extrude=0.2),
    "rounded ribbon": lambda: ring(extrude=0.2, bevel_depth=0.05, fill_mode="HALF"),
    "moulding": moulding,
    "horn": horn,
    "thread": thread,
    "text": text,
    "flat": flat,
    "facets": facets,
    "wave": wave,
}
BY_BLENDER = {"text", "flat", "facets", "wave"}


@pytest.fixture
def gallery() -> list[bpy.types.Object]:
    bpy.ops.mesh.primitive_plane_add(size=24)
    things = []
    for index, (name, make) in enumerate(KINDS.items()):
        thing = make()
        thing.name = name
        thing.location = (index % 4 * 4 - 6, index // 4 * 4 - 6, 1.2)
        things.append(thing)
    lamp = link("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    lamp.location, lamp.data.energy = (0, 0, 9), 2000
    bpy.context.view_layer.update()
    return things


def test_our_splines_lay_themselves_flat_and_the_others_are_unwrapped(gallery):
    meshes = {mesh.name: mesh.laid_flat() for mesh in extract_scene(bpy.context.scene).scene.meshes}
    assert {name for name in KINDS if meshes[name].chart is None} == BY_BLENDER
    assert max(meshes[name].chart.max() for name in KINDS if name not in BY_BLENDER) < 8


def test_every_kind_is_lit_and_comes_back(gallery):
    scene = bpy.context.scene
    visible = {thing.name: thing.hide_render for thing in scene.objects}
    before = sorted(data.name for data in bpy.data.user_map())
    report = bake_all(scene, page_size=256)
    assert not report.warnings
    assert {row.source for row in report.objects} == {*KINDS, "Plane"}
    assert all(row.texels > 20 for row in report.objects)
    image = next(image for image in bpy.data.images if image.name.startswith("Radiosity"))
    pixels = np.array(image.pixels[:]).reshape(-1, 4)
    assert np.isfinite(pixels).all()
    for name in KINDS:
        stand_in = scene.objects[f"{name} (Radiosity)"]
        uv = np.empty(len(stand_in.data.loops) * 2, np.float32)
        stand_in.data.uv_layers["Radiosity"].uv.foreach_get("vector", uv)
        x, y = np.clip((uv.reshape(-1, 2) * 256).astype(int), 0, 255).T
        assert pixels[y * 256 + x, 0].mean() > 0.01, name
    revert(scene)
    assert {thing.name: thing.hide_render for thing in scene.objects} == visible
    assert sorted(data.name for data in bpy.data.user_map()) == before
