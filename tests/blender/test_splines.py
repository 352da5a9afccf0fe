# SPDX-License-Identifier: GPL-3.0-or-later
"""Our splines are Blender's: sampled where it samples them, every point is where it puts it.

Each test walks through all combinations of some settings and names those that differ.
"""

from __future__ import annotations

from itertools import product

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.data import curves
from radiosity_addon.blender.data.curves import profiles, resolution_of, surface_net, swept, taper_of
from radiosity_addon.blender.data.splines import Degenerate, read_path, read_surface
from radiosity_addon.chunks import finish
from radiosity_addon.curves.patchwork import Net, patchwork
from radiosity_addon.curves.sweep import Profile
from tests.blender.spline_objects import ENDS, Shown, curve_object, shown, surface_object, taper_object

AGREEMENT = 1e-5
"""Share of the object's size: ten times the rounding of Blender's float32 sums."""

FLAGS = list(product((False, True), repeat=3))
"""Endpoint, Bezier, cyclic."""


def surface_nets(thing: bpy.types.Object) -> list[Net]:
    """A surface object's nets at Blender's own parameters."""
    nets = []
    for spline in thing.data.splines:
        surface = read_surface(spline)
        ring = spline.use_cyclic_u, spline.use_cyclic_v
        counts = spline.point_count_u * spline.resolution_u, spline.point_count_v * spline.resolution_v
        lines = [
            np.linspace(*basis.domain, count + closed)
            for basis, count, closed in zip((surface.basis_u, surface.basis_v), counts, ring, strict=True)
        ]
        nets.append(surface_net(surface, *lines, ring, spline.material_index))
    return nets


def curve_nets(thing: bpy.types.Object) -> list[Net]:
    """A curve object's nets at Blender's own parameters."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    data = thing.evaluated_get(depsgraph).data
    nets = []
    for spline in data.splines:
        path = read_path(spline, resolution_of(data, spline, depsgraph))
        line = path.at(path.shown).without_repeats(1e-5 / spline.resolution_u)
        for profile in profiles(data, depsgraph):
            moved = Profile(profile.points + np.array([data.offset, 0]), profile.places)
            nets.append(swept(line, moved, taper_of(data, depsgraph)(path), data.twist_mode, spline.material_index))
    return nets


def difference(theirs: Shown, nets: list[Net]) -> float:
    """Largest distance of corresponding corners, as a share of the size, or of texture coordinates."""
    ours = patchwork(nets)
    corners = [
        np.column_stack([vertices[loops], uv])
        for vertices, loops, uv in (
            (theirs.vertices / theirs.size, theirs.loop_vertex, theirs.loop_uv),
            (ours.vertices / theirs.size, ours.loop_vertex, ours.loop_uv),
        )
    ]
    if corners[0].shape != corners[1].shape:
        return np.inf
    sort = [corner[np.lexsort(corner.round(3).T)] for corner in corners]
    points = np.concatenate([net.points.reshape(-1, 3) for net in nets]) / theirs.size
    return max(float(np.abs(sort[0] - sort[1]).max()), float(np.abs(theirs.vertices / theirs.size - points).max()))


def differing(thing: bpy.types.Object, label: object, make=curve_nets) -> list[object]:
    """The label if we and Blender differ over an object, which is then removed."""
    theirs = shown(thing)
    try:
        nets = make(thing)
        wrong = not theirs.size or difference(theirs, nets) > AGREEMENT
    except Degenerate:
        wrong = theirs.size > 0
    bpy.data.objects.remove(thing)
    return [label] if wrong else []


@pytest.mark.parametrize("points", range(2, 9))
def test_surfaces_of_any_flags_orders_and_point_counts_agree_along_u(points):
    wrong = []
    thing = surface_object(points, 3, resolution_u=3, resolution_v=2, order_v=3)
    spline = thing.data.splines[0]
    for order, (endpoint, bezier, cyclic) in product(range(2, 7), FLAGS):
        spline.order_u = order
        spline.use_endpoint_u, spline.use_bezier_u, spline.use_cyclic_u = endpoint, bezier, cyclic
        theirs = shown(thing)
        try:
            agrees = difference(theirs, surface_nets(thing)) < AGREEMENT
        except Degenerate:
            agrees = not theirs.size
        if not agrees:
            wrong.append((order, endpoint, bezier, cyclic))
    assert not wrong


@pytest.mark.parametrize("weighted", [False, True])
def test_surfaces_of_any_flags_along_both_directions_agree(weighted):
    wrong = []
    thing = surface_object(6, 6, weighted, resolution_u=2, resolution_v=3, order_u=3, order_v=4)
    spline = thing.data.splines[0]
    for u, v in product(FLAGS, FLAGS):
        spline.use_endpoint_u, spline.use_bezier_u, spline.use_cyclic_u = u
        spline.use_endpoint_v, spline.use_bezier_v, spline.use_cyclic_v = v
        if not difference(shown(thing), surface_nets(thing)) < AGREEMENT:
            wrong.append((u, v))
    assert not wrong


@pytest.mark.parametrize("points", range(2, 9))
def test_nurbs_curves_of_any_flags_orders_and_point_counts_agree(points):
    wrong = []
    for order, (endpoint, bezier, cyclic) in product(range(2, 7), FLAGS):
        if points == 2 and cyclic:
            continue  # there and back on one line: Blender's profile has no direction to stand across
        flags = {"use_endpoint_u": endpoint, "use_bezier_u": bezier, "use_cyclic_u": cyclic}
        thing = curve_object("NURBS", points, extrude=0.1, order_u=order, **flags)
        wrong += differing(thing, (order, endpoint, bezier, cyclic))
    assert not wrong


OUTLINES = {
    "round": {"bevel_depth": 0.1, "bevel_resolution": 2},
    "extruded": {"extrude": 0.2},
    "rounded": {"bevel_depth": 0.1, "extrude": 0.2, "bevel_resolution": 1},
    "half": {"bevel_depth": 0.1, "fill_mode": "HALF"},
    "front": {"bevel_depth": 0.1, "fill_mode": "FRONT"},
    "back": {"bevel_depth": 0.1, "fill_mode": "BACK"},
    "extruded half": {"bevel_depth": 0.1, "fill_mode": "HALF", "extrude": 0.1},
    "extruded front": {"bevel_depth": 0.1, "fill_mode": "FRONT", "extrude": 0.1},
    "extruded back": {"bevel_depth": 0.1, "fill_mode": "BACK", "extrude": 0.1},
    "profile": {"bevel_mode": "PROFILE", "bevel_depth": 0.1, "bevel_resolution": 3},
    "offset": {"bevel_depth": 0.1, "offset": 0.3},
    "square": {"bevel_depth": 0.1, "bevel_resolution": 0},
}


@pytest.mark.parametrize("kind", ["NURBS", "BEZIER", "POLY"])
def test_bevels_of_any_outline_fill_and_twist_agree(kind):
    wrong = []
    for cyclic, twist, (name, outline) in product((False, True), ("MINIMUM", "Z_UP"), OUTLINES.items()):
        thing = curve_object(kind, use_cyclic_u=cyclic, twist_mode=twist, **outline)
        wrong += differing(thing, (cyclic, twist, name))
    assert not wrong


@pytest.mark.parametrize("kind", ["NURBS", "BEZIER", "POLY"])
def test_bevel_objects_agree(kind):
    wrong = []
    for cyclic, outline, closed, flat in product(
        (False, True), ("NURBS", "BEZIER", "POLY"), (False, True), (False, True)
    ):
        bevel = curve_object(outline, 4, seed=5, use_cyclic_u=closed, resolution_u=3)
        bevel.scale = (0.1, 0.07, 1)
        if flat:
            bevel.data.dimensions, bevel.data.fill_mode = "2D", "BOTH"
        thing = curve_object(kind, use_cyclic_u=cyclic, bevel_mode="OBJECT", bevel_object=bevel)
        wrong += differing(thing, (cyclic, outline, closed, flat))
        bpy.data.objects.remove(bevel)
    assert not wrong


@pytest.mark.parametrize("kind", ["NURBS", "BEZIER", "POLY"])
def test_tapers_agree(kind):
    wrong = []
    for cyclic, outline, mode, mapped in product(
        (False, True), ("NURBS", "BEZIER", "POLY"), ("OVERRIDE", "MULTIPLY", "ADD"), (False, True)
    ):
        taper = taper_object(outline, resolution_u=5)
        settings = {"bevel_depth": 0.1, "taper_object": taper, "taper_radius_mode": mode, "use_map_taper": mapped}
        wrong += differing(curve_object(kind, use_cyclic_u=cyclic, **settings), (cyclic, outline, mode, mapped))
        bpy.data.objects.remove(taper)
    assert not wrong


def test_radius_and_tilt_of_bezier_splines_run_as_blender_lets_them():
    wrong = []
    for cyclic, radius, tilt in product((False, True), ENDS, ENDS):
        settings = {"radius_interpolation": radius, "tilt_interpolation": tilt, "bevel_depth": 0.1, "extrude": 0.1}
        wrong += differing(curve_object("BEZIER", use_cyclic_u=cyclic, **settings), (cyclic, radius, tilt))
    assert not wrong


@pytest.mark.parametrize("handle", ["VECTOR", "AUTO", "ALIGNED"])
@pytest.mark.parametrize("cyclic", [False, True])
def test_straight_pieces_of_bezier_splines_are_single_steps(handle, cyclic):
    thing = curve_object("BEZIER", use_cyclic_u=cyclic, bevel_depth=0.1, extrude=0.05)
    for i, point in enumerate(thing.data.splines[0].bezier_points):
        point.handle_left_type = point.handle_right_type = handle if i != 2 else "AUTO"
    assert not differing(thing, handle)


@pytest.mark.parametrize("way", [1, -1], ids=["up", "down"])
@pytest.mark.parametrize("points", [2, 4])
def test_vertical_lines_stand_as_in_blender(way, points):
    for twist in ("MINIMUM", "Z_UP"):
        thing = curve_object("POLY", points, bevel_depth=0.1, extrude=0.05, twist_mode=twist)
        for i, point in enumerate(thing.data.splines[0].points):
            point.co = (0, 0, i * way, 1)
        assert not differing(thing, twist)


@pytest.mark.parametrize("kind", ["NURBS", "POLY"])
def test_points_on_one_another_are_one(kind):
    thing = curve_object(kind, 7, bevel_depth=0.1)
    points = thing.data.splines[0].points
    points[2].co = points[3].co = points[4].co
    assert not differing(thing, kind)


def test_few_points_agree_or_show_nothing():
    wrong = []
    for kind, cyclic, points in product(("NURBS", "BEZIER", "POLY"), (False, True), (2, 3)):
        wrong += differing(curve_object(kind, points, use_cyclic_u=cyclic, extrude=0.1), (kind, cyclic, points))
    assert not wrong


@pytest.mark.parametrize("kind", ["NURBS", "BEZIER"])
def test_profiles_sampled_by_curvature_stand_as_blenders_do(kind):
    wrong = []
    for cyclic, twist, resolution, seed in product((False, True), ("MINIMUM", "Z_UP"), (12, 64), range(3)):
        flags = {"use_cyclic_u": cyclic, "twist_mode": twist, "resolution_u": resolution}
        thing = curve_object(kind, 6, seed, extrude=0.1, **flags)
        for point in thing.data.splines[0].bezier_points if kind == "BEZIER" else thing.data.splines[0].points:
            point.tilt, point.radius = 0.0, 1.0
            if kind == "BEZIER":
                point.handle_left_type = point.handle_right_type = "AUTO"
        bpy.context.view_layer.update()
        depsgraph = bpy.context.evaluated_depsgraph_get()
        theirs, ours = (
            curve_nets(thing)[0],
            finish(curves.curve_nets(thing.evaluated_get(depsgraph).data, depsgraph)).nets[0],
        )
        ribbons = [net.points[:, 1] - net.points[:, 0] for net in (theirs, ours)]
        rows = [net.rows[: len(net.points)] for net in (theirs, ours)]
        around = 1.0 if cyclic else None
        there = np.stack([np.interp(*rows, ribbons[1][:, k], period=around) for k in range(3)], axis=1)
        cosine = (there * ribbons[0]).sum(axis=1) / (np.linalg.norm(there, axis=1) * np.linalg.norm(ribbons[0], axis=1))
        if np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() > 3:
            wrong.append((cyclic, twist, resolution, seed))
        bpy.data.objects.remove(thing)
    assert not wrong


def test_weights_of_nothing_are_refused():
    thing = curve_object("NURBS", bevel_depth=0.1)
    thing.data.splines[0].points[1].co[3] = 0
    with pytest.raises(Degenerate, match="weight"):
        read_path(thing.data.splines[0], 4)
