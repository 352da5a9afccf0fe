# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's splines as the core's curves and surfaces, by Blender's rules for knots, cyclic ends and interpolation."""

from __future__ import annotations

import bpy
import numpy as np

from ...arrays import Bools, Float64
from ...curves.bspline import Basis
from ...curves.nurbs import Curve, Surface
from ...curves.sweep import Path

CARDINAL = 0.71
"""Tension of Blender's cardinal interpolation."""

HERMITE_TO_BEZIER = {
    "LINEAR": np.array([[0, 1, 0, 0], [0, 2 / 3, 1 / 3, 0], [0, 1 / 3, 2 / 3, 0], [0, 0, 1, 0]]),
    "EASE": np.array([[0, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 0]], float),
    "CARDINAL": np.array(
        [[0, 1, 0, 0], [-CARDINAL / 3, 1, CARDINAL / 3, 0], [0, CARDINAL / 3, 1, -CARDINAL / 3], [0, 0, 1, 0]]
    ),
    "BSPLINE": np.array([[1, 4, 1, 0], [0, 4, 2, 0], [0, 2, 4, 0], [0, 1, 4, 1]]) / 6,
}
"""Values at the four Bezier points of a segment from those at the points before, at both of its ends, and after."""


class Degenerate(Exception):
    """A spline that Blender shows nothing of; the message says why."""


def blender_knots(points: int, order: int, endpoint: bool, bezier: bool, cyclic: bool) -> Float64:
    """The knots that Blender makes.

    They count up from 0, an inner one repeated `order - 1` times for Bezier. Cyclic splines go on with the widths of
    their beginning, those that meet their end points with the last knot.
    """
    repeat = order - 1 if bezier else 1
    head = order - cyclic if endpoint else min(2, repeat) if bezier else 1
    tail = 2 * order - 1 if cyclic else order if endpoint else 0
    count = points + order + (order - 1 if cyclic else 0)
    knots, left = np.zeros(count), head
    first = int(endpoint and cyclic)
    current = float(first)
    for i in range(first, count - tail):
        knots[i] = current
        left -= 1
        if left == 0:
            current, left = current + 1, repeat
    for i in range(tail):
        knots[count - tail + i] = current + knots[i] - knots[0]
    return knots


def basis_of(points: int, order: int, endpoint: bool, bezier: bool, cyclic: bool) -> Basis:
    """The basis of a direction of a NURBS spline.

    Raises:
        Degenerate: too few points for the order, or knots that span nothing
    """
    if points < 2:
        raise Degenerate("it has a single point")
    if order > points:
        raise Degenerate(f"its order {order} is larger than its {points} points")
    if bezier and cyclic and points % (order - 1):
        raise Degenerate(f"a cyclic Bezier spline of order {order} needs a multiple of {order - 1} points")
    if bezier and not (cyclic or endpoint) and points <= order:
        raise Degenerate(f"a Bezier spline of order {order} that floats needs more than {order} points")
    try:
        return Basis(order - 1, blender_knots(points, order, endpoint, bezier, cyclic), points)
    except ValueError as failure:
        raise Degenerate(f"of its {points} points of order {order} {failure}") from failure


def read_surface(spline: bpy.types.Spline) -> Surface:
    """A spline of a surface object; u goes along its first index.

    Raises:
        Degenerate: it has no surface
    """
    count_u, count_v = spline.point_count_u, spline.point_count_v
    values = _get(spline.points, "co", 4).reshape(count_v, count_u, 4).swapaxes(0, 1)
    basis_u = basis_of(count_u, spline.order_u, spline.use_endpoint_u, spline.use_bezier_u, spline.use_cyclic_u)
    basis_v = basis_of(count_v, spline.order_v, spline.use_endpoint_v, spline.use_bezier_v, spline.use_cyclic_v)
    return Surface(basis_u, basis_v, values[..., :3], _weights(values[..., 3]))


def read_path(spline: bpy.types.Spline, resolution: int, from_last: bool = True) -> Path:
    """A spline of a curve object.

    Args:
        resolution: steps that Blender takes along each segment
        from_last: a cyclic Bezier spline begins at its last point, as Blender has it for what is bevelled

    Raises:
        Degenerate: it has no length
    """
    if spline.type == "BEZIER":
        return _bezier_path(spline, resolution, from_last)
    values = _get(spline.points, "co", 4)
    points = np.column_stack([values[:, :3], _get(spline.points, "radius", 1), _get(spline.points, "tilt", 1)])
    if len(points) < 2:
        raise Degenerate("it has a single point")
    cyclic = spline.use_cyclic_u
    ends = np.stack([_direction(points[0], points[1]), _direction(points[-2], points[-1])])
    if spline.type == "POLY":
        count = len(points)
        steps = count if cyclic else count - 1
        basis = Basis(1, np.array([0, *range(steps + 1), steps], float), count)
        curve = Curve(basis, points, np.ones(count))
        return Path(curve, cyclic, np.ones(steps, bool), np.arange(steps + 1.0), ends)
    basis = basis_of(len(points), spline.order_u, spline.use_endpoint_u, spline.use_bezier_u, cyclic)
    curve = Curve(basis, points, _weights(values[:, 3]))
    count = resolution * (len(points) if cyclic else len(points) - 1)
    shown = np.linspace(*basis.domain, count + cyclic)
    return Path(curve, cyclic, np.zeros(len(basis.breaks) - 1, bool), shown, ends)


def _bezier_path(spline: bpy.types.Spline, resolution: int, from_last: bool) -> Path:
    knots = spline.bezier_points
    if len(knots) < 2:
        raise Degenerate("it has a single point")
    place, left, right = (_get(knots, name, 3) for name in ("co", "handle_left", "handle_right"))
    cyclic = spline.use_cyclic_u
    start = np.arange(len(knots) if cyclic else len(knots) - 1)
    stop = (start + 1) % len(knots)
    if cyclic and from_last:
        start, stop = np.roll(start, 1), np.roll(stop, 1)
    before, after = start - 1, stop + 1
    if cyclic:
        before, after = before % len(knots), after % len(knots)
    else:
        before, after = np.maximum(before, 0), np.minimum(after, len(knots) - 1)
    four = np.stack([before, start, stop, after])
    control = np.stack([place[start], right[start], left[stop], place[stop]], axis=1)
    channels = []
    for name, interpolation in (("radius", spline.radius_interpolation), ("tilt", spline.tilt_interpolation)):
        channels.append((HERMITE_TO_BEZIER[interpolation] @ _get(knots, name, 1)[four]).T)
    vector = np.array([(point.handle_left_type == "VECTOR", point.handle_right_type == "VECTOR") for point in knots])
    rigid: Bools = vector[start, 1] & vector[stop, 0]
    values = np.concatenate([control, np.stack(channels, axis=2)], axis=2)
    if rigid.any():
        values[rigid] = _straight(place, knots, start[rigid], stop[rigid])
    pieces = len(start)
    basis = Basis(3, np.repeat(np.arange(pieces + 1, dtype=np.float64), 4), 4 * pieces)
    shown = [piece + np.arange(steps) / steps for piece, steps in enumerate(np.where(rigid, 1, resolution))]
    ends = np.stack([_direction(place[0], right[0]), _direction(left[-1], place[-1])])
    last = np.array([*place[-1], knots[-1].radius, knots[-1].tilt])
    curve = Curve(basis, values.reshape(-1, 5), np.ones(4 * pieces))
    return Path(curve, cyclic, rigid, np.append(np.concatenate(shown), pieces), ends, None if cyclic else last)


def _straight(place: Float64, knots: bpy.types.bpy_prop_collection, start: Float64, stop: Float64) -> Float64:
    """Bezier points (S, 4, 5) of straight segments along which everything changes evenly."""
    ends = np.column_stack([place, _get(knots, "radius", 1), _get(knots, "tilt", 1)])
    share = np.linspace(0, 1, 4)[None, :, None]
    return np.asarray(ends[start][:, None] * (1 - share) + ends[stop][:, None] * share)


def _weights(weights: Float64) -> Float64:
    if not (weights > 0).all():
        raise Degenerate("a control point's weight is not positive")
    return weights


def _direction(start: Float64, stop: Float64) -> Float64:
    away = stop[:3] - start[:3]
    length = np.linalg.norm(away)
    return np.asarray(away / length if length > 0 else np.zeros(3))


def _get(items: bpy.types.bpy_prop_collection, name: str, width: int) -> Float64:
    values = np.empty(len(items) * width, np.float32)
    items.foreach_get(name, values)
    if not np.isfinite(values).all():
        raise Degenerate("it has control points that are not finite numbers")
    return values.astype(np.float64).reshape(len(items), width) if width > 1 else values.astype(np.float64)
