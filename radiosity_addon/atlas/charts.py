# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes charts that a uv map of polygon corners can hold.

xatlas cuts triangles apart; Blender's uv maps hold one uv per polygon corner. So uv are kept per corner (`loop`) and
the chart per polygon: a polygon that was cut apart keeps its largest triangle in place and the others are unfolded
onto it; where that makes the chart overlap the polygon becomes a chart of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float64, Int64
from .overlap import overlapping

MIN_HEIGHT = 1e-6
"""A triangle whose height is below this share of its longest edge has no direction of its own (float32 vertices)."""

MIN_AREA = 1e-14
"""Nor has one below this share of its mesh's squared radius: the edges are at the limit of float32 positions."""

MAX_STRETCH = 20.0
"""A triangle whose area in its chart errs by this factor would starve or hoard texels: it leaves the chart."""

FOLDED = 1e-3
"""A triangle with less than this share of its area left in the chart counts as collapsed or turned over."""

REPAIRS = 12
"""Rounds in which single polygons leave an overlapping chart; after them every polygon involved leaves."""


@dataclass(frozen=True, eq=False)
class Faces:
    """Triangles of several meshes with their polygons.

    Attributes:
        position: (L, 3) float64, m, of each polygon corner
        vertex: (L,) int64, vertex of each polygon corner, counted through all meshes
        loop: (F, 3) int64, polygon corner of each triangle corner
        polygon: (F,) int64, counted through all meshes, every number from 0 to polygons - 1 in use
        polygons: how many
        loop_polygon: (L,) int64
        area: (F,) float64, m2
        solid: (F,) bool, not degenerate
    """

    position: Float64
    vertex: Int64
    loop: Int64
    polygon: Int64
    polygons: int
    loop_polygon: Int64
    area: Float64
    solid: Bools

    @property
    def corners(self) -> Float64:
        """(F, 3, 3) float64, m."""
        return self.position[self.loop]


@dataclass(frozen=True, eq=False)
class Charts:
    """Where the polygons of some Faces lie.

    Attributes:
        uv: (L, 2) float64, m, each chart in a plane of its own; NaN on polygons without a chart
        chart: (P,) int64, chart of each polygon, -1: none
    """

    uv: Float64
    chart: Int64


def measure(corners: Float64, radius: Float64) -> tuple[Float64, Bools]:
    """Area (F,), m2, of triangles (F, 3, 3) and whether each is not degenerate in a mesh of radius (F,), m."""
    edges = np.roll(corners, -1, axis=1) - corners
    longest = (edges**2).sum(axis=2).max(axis=1, initial=0)
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    return area, (area > MIN_HEIGHT / 2 * longest) & (area > MIN_AREA * radius**2)


def tidy(faces: Faces, triangle_uv: Float64, triangle_chart: Int64) -> Charts:
    """Charts without cut polygons, folds or overlaps, in metres and true to area, from a raw unwrap.

    Args:
        triangle_uv: (F, 3, 2) float64; each chart may be scaled along u and along v, and mirrored
        triangle_chart: (F,) int64, -1: none
    """
    uv, usable = _straighten(faces, triangle_uv, triangle_chart)
    charts, unfolded = _join_polygons(faces, uv, np.where(usable, triangle_chart, -1))
    charts = _part_overlaps(faces, charts, unfolded)
    charts = _true_to_area(faces, charts)
    return _place_degenerate(faces, charts)


def signed_area(uv: Float64) -> Float64:
    """(F,) float64 of triangles (F, 3, 2), positive where they wind counter-clockwise."""
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return np.asarray((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2)


def _straighten(faces: Faces, uv: Float64, chart: Int64) -> tuple[Float64, Bools]:
    """Undoes mirroring and per-axis scaling, and says which triangles are usable as they lie.

    A conformal map has |grad u| = |grad v| everywhere; their means over a chart give both scales.
    """
    solid = faces.solid & (chart >= 0) & np.isfinite(uv).all(axis=(1, 2))
    uv = np.where(solid[:, None, None], uv, 0.0)
    count = int(chart.max(initial=-1)) + 1
    index = np.where(solid, chart, 0)

    def total(values: Float64) -> Float64:
        return np.bincount(index[solid], weights=values[solid], minlength=count)

    turned = np.flatnonzero(total(signed_area(uv)) < 0)
    uv[np.isin(chart, turned), :, 0] *= -1
    corners = faces.corners
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    g11, g12, g22 = (e1 * e1).sum(1), (e1 * e2).sum(1), (e2 * e2).sum(1)
    shape = np.where(solid, faces.area / np.maximum(np.maximum(g11, g22), 1e-300), 0)
    weight = np.where(solid, np.minimum(shape, 0.05), 0) * faces.area  # gradients of slivers are mostly rounding
    d1, d2 = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    determinant = np.where(solid, g11 * g22 - g12**2, 1.0)
    squared = (g22[:, None] * d1**2 - 2 * g12[:, None] * d1 * d2 + g11[:, None] * d2**2) / determinant[:, None]
    mean = np.stack([total(squared[:, axis] * weight) for axis in (0, 1)], axis=1)
    mean /= np.maximum(total(weight), 1e-300)[:, None]
    uv = uv / np.sqrt(np.where(mean > 0, mean, 1.0))[index][:, None, :]
    area = signed_area(uv)
    scale = total(faces.area) / np.maximum(total(area), 1e-300)
    share = area * scale[index] / np.where(solid, faces.area, 1.0)
    return uv * np.sqrt(scale)[index][:, None, None], solid & (share > 1 / MAX_STRETCH) & (share < MAX_STRETCH)


def _join_polygons(faces: Faces, uv: Float64, chart: Int64) -> tuple[Charts, Bools]:
    """One chart a polygon. Returns the charts and which polygons (P,) were unfolded."""
    placed = chart >= 0
    order = np.lexsort((faces.area, placed & faces.solid))  # the best triangle of a polygon last
    seed = np.full(faces.polygons, -1)
    seed[faces.polygon[order]] = order
    polygon_chart = np.where(placed[seed], chart[seed], -1)
    scale = _extents(uv, chart)[seed]

    loop_uv = np.full((len(faces.position), 2), np.nan)
    loop_uv[faces.loop[seed]] = uv[seed]
    same = placed & (chart == polygon_chart[faces.polygon])
    loop_uv[faces.loop[same]] = uv[same]
    apart = np.abs(loop_uv[faces.loop] - uv).max(axis=(1, 2), initial=0) > 1e-5 * scale[faces.polygon]
    cut = np.zeros(faces.polygons, bool)
    cut[faces.polygon[faces.solid & (~same | apart)]] = True
    cut &= polygon_chart >= 0
    loop_uv[(cut | (polygon_chart < 0))[faces.loop_polygon]] = np.nan
    loop_uv[faces.loop[seed[cut]]] = uv[seed[cut]]
    _unfold(faces, loop_uv, cut)
    charts = Charts(loop_uv, polygon_chart)
    alone = _folded(faces, charts)
    alone[faces.polygon[faces.solid & (polygon_chart[faces.polygon] < 0)]] = True
    return _stand_alone(faces, charts, alone), cut


def _extents(uv: Float64, chart: Int64) -> Float64:
    """(F,) larger extent of each triangle's chart."""
    count = int(chart.max(initial=-1)) + 2
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, chart, uv.min(axis=1))
    np.maximum.at(high, chart, uv.max(axis=1))
    return np.asarray((high - low).max(axis=1)[chart])


def _unfold(faces: Faces, loop_uv: Float64, polygons: Bools) -> None:
    """Lays the unplaced corners of polygons (P,) beside the placed ones; each triangle keeps its shape."""
    waiting = np.flatnonzero(faces.solid & polygons[faces.polygon])
    while len(waiting):
        known = np.isfinite(loop_uv[faces.loop[waiting], 0])
        ready = known.sum(axis=1) == 2
        if not ready.any():
            return
        triangle, apex = waiting[ready], np.argmin(known[ready], axis=1)
        a, b, c = (faces.loop[triangle, (apex + step) % 3] for step in (1, 2, 0))
        edge, side = faces.position[b] - faces.position[a], faces.position[c] - faces.position[a]
        squared = np.maximum((edge**2).sum(axis=1), 1e-300)
        along = (edge * side).sum(axis=1) / squared
        height = 2 * faces.area[triangle] / squared
        flat = loop_uv[b] - loop_uv[a]
        across = np.stack([-flat[:, 1], flat[:, 0]], axis=1)
        loop_uv[c] = loop_uv[a] + along[:, None] * flat + height[:, None] * across
        waiting = waiting[~ready & (known.sum(axis=1) < 3)]


def _folded(faces: Faces, charts: Charts) -> Bools:
    """(P,) polygons with a triangle that is collapsed, turned over or not placed in its chart."""
    area = signed_area(charts.uv[faces.loop])
    bad = faces.solid & ~(area > FOLDED * faces.area) & (charts.chart[faces.polygon] >= 0)
    folded = np.zeros(faces.polygons, bool)
    folded[faces.polygon[bad]] = True
    return folded


def _part_overlaps(faces: Faces, charts: Charts, unfolded: Bools) -> Charts:
    """Takes polygons out of charts that lie on themselves, those that were unfolded first."""
    size = np.bincount(faces.polygon, weights=faces.area, minlength=faces.polygons)
    suspects = np.unique(charts.chart[charts.chart >= 0])
    for repair in range(REPAIRS):
        chosen = np.flatnonzero(faces.solid & np.isin(charts.chart[faces.polygon], suspects))
        _, group = np.unique(charts.chart[faces.polygon[chosen]], return_inverse=True)
        pairs = faces.polygon[chosen[overlapping(charts.uv[faces.loop[chosen]], group.reshape(-1))]]
        if not len(pairs):
            break
        suspects = np.unique(charts.chart[pairs])
        rank = unfolded[pairs].astype(np.float64) - size[pairs] / size.max()
        leaving = pairs[np.arange(len(pairs)), np.argmax(rank, axis=1)]
        alone = np.zeros(faces.polygons, bool)
        alone[pairs.reshape(-1) if repair == REPAIRS - 1 else leaving] = True
        charts = _stand_alone(faces, charts, alone)
        suspects = np.union1d(suspects, charts.chart[alone])
    return charts


def _simple(faces: Faces, charts: Charts, polygons: Bools) -> Bools:
    """(P,) of those polygons: which don't lie on themselves."""
    chosen = np.flatnonzero(faces.solid & polygons[faces.polygon])
    pairs = overlapping(charts.uv[faces.loop[chosen]], faces.polygon[chosen])
    good = polygons.copy()
    good[faces.polygon[chosen[pairs.reshape(-1)]]] = False
    return good


def _stand_alone(faces: Faces, charts: Charts, polygons: Bools) -> Charts:
    """Makes each of these polygons (P,) a chart of its own: seen along its normal, else unfolded, else on a circle."""
    if not polygons.any():
        return charts
    uv, chart = charts.uv.copy(), charts.chart.copy()
    chart[polygons] = int(chart.max(initial=-1)) + 1 + np.arange(int(polygons.sum()))
    left = Charts(uv, chart)
    members = polygons[faces.loop_polygon]
    uv[members] = _projected(faces, polygons)[members]
    left_over = polygons & (_folded(faces, left) | ~_simple(faces, left, polygons))
    if left_over.any():
        order = np.lexsort((faces.area, faces.solid))
        seed = np.full(faces.polygons, -1)
        seed[faces.polygon[order]] = order
        seed = seed[left_over]
        corners = faces.corners[seed]
        edge, side = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        length = np.linalg.norm(edge, axis=1)
        zero = np.zeros(len(seed))
        uv[left_over[faces.loop_polygon]] = np.nan
        uv[faces.loop[seed, 0]] = 0
        uv[faces.loop[seed, 1]] = np.stack([length, zero], axis=1)
        uv[faces.loop[seed, 2]] = np.stack([(edge * side).sum(1) / length, 2 * faces.area[seed] / length], axis=1)
        _unfold(faces, uv, left_over)
        left_over &= _folded(faces, left) | ~_simple(faces, left, left_over)
    if left_over.any():
        members = left_over[faces.loop_polygon]
        uv[members] = _on_circle(faces)[members]
        turned = np.bincount(faces.polygon, signed_area(uv[faces.loop]), faces.polygons) < 0
        uv[members & turned[faces.loop_polygon], 0] *= -1
    return left


def _projected(faces: Faces, polygons: Bools) -> Float64:
    """(L, 2) polygon corners along the polygon's normal, its longest edge along u."""
    chosen = np.flatnonzero(polygons[faces.polygon] & faces.solid)
    owner = faces.polygon[chosen]
    corners = faces.corners[chosen]
    normal = np.zeros((faces.polygons, 3))
    np.add.at(normal, owner, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    edges = (np.roll(corners, -1, axis=1) - corners).reshape(-1, 3)
    flat = edges - (edges * normal[np.repeat(owner, 3)]).sum(axis=1)[:, None] * normal[np.repeat(owner, 3)]
    length = np.linalg.norm(flat, axis=1)
    order = np.argsort(length, kind="stable")
    u = np.zeros((faces.polygons, 3))
    u[np.repeat(owner, 3)[order]] = (flat / np.maximum(length, 1e-300)[:, None])[order]
    v = np.cross(normal, u)
    return np.stack([(faces.position * axis[faces.loop_polygon]).sum(axis=1) for axis in (u, v)], axis=1)


def _on_circle(faces: Faces) -> Float64:
    """(L, 2) polygon corners in order on a circle: any triangulation of a polygon is free of folds there."""
    first = np.searchsorted(faces.loop_polygon, np.arange(faces.polygons + 1))
    count = np.diff(first)[faces.loop_polygon]
    angle = 2 * np.pi * (np.arange(len(faces.position)) - first[faces.loop_polygon]) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _true_to_area(faces: Faces, charts: Charts) -> Charts:
    """Scales every chart to the area of its surface and numbers the charts from 0."""
    _, chart = np.unique(charts.chart, return_inverse=True)
    chart = chart.reshape(-1) - int((charts.chart < 0).any())
    solid = faces.solid
    index, count = chart[faces.polygon[solid]], int(chart.max(initial=-1)) + 1
    true = np.bincount(index, faces.area[solid], count)
    flat = np.bincount(index, signed_area(charts.uv[faces.loop[solid]]), count)
    scale = np.append(np.sqrt(true / np.where(flat > 0, flat, 1.0)), 1.0)
    return Charts(charts.uv * scale[chart[faces.loop_polygon]][:, None], chart)


def _place_degenerate(faces: Faces, charts: Charts) -> Charts:
    """Gives corners of degenerate triangles a place: in their own polygon, else at a neighbour's, else NaN."""
    uv, chart = charts.uv.copy(), charts.chart.copy()
    lost = np.flatnonzero(~np.isfinite(uv[:, 0]) & (chart[faces.loop_polygon] >= 0))
    solid = np.flatnonzero(faces.solid)
    solid = solid[np.argsort(faces.polygon[solid], kind="stable")]
    low, high = (np.searchsorted(faces.polygon[solid], faces.loop_polygon[lost], side=s) for s in ("left", "right"))
    pair = np.repeat(np.arange(len(lost)), high - low)
    triangle = solid[np.arange(len(pair)) - np.repeat(np.cumsum(high - low) - high, high - low)]
    share = _barycentric(faces.position[lost[pair]], faces.corners[triangle])
    order = np.lexsort((share.min(axis=1), pair))  # the triangle that the corner is least outside of comes last
    share = np.maximum(share, 0)
    share /= share.sum(axis=1, keepdims=True)
    uv[lost[pair[order]]] = np.einsum("lc,lcx->lx", share, uv[faces.loop[triangle]])[order]

    rank = np.where(chart[faces.loop_polygon] >= 0, np.arange(len(uv)), -1)
    neighbour = np.full(int(faces.vertex.max(initial=0)) + 1, -1)
    np.maximum.at(neighbour, faces.vertex, rank)
    loops = np.flatnonzero((chart[faces.loop_polygon] < 0) & (neighbour[faces.vertex] >= 0))
    source = np.full(faces.polygons, -1)
    source[faces.loop_polygon[loops]] = neighbour[faces.vertex[loops]]
    found = source >= 0
    members = found[faces.loop_polygon]
    uv[members] = uv[source[faces.loop_polygon[members]]]
    chart[found] = chart[faces.loop_polygon[source[found]]]
    return Charts(uv, chart)


def _barycentric(point: Float64, corners: Float64) -> Float64:
    """(N, 3) weights of the corners of triangles (N, 3, 3) at points (N, 3)."""
    e1, e2, d = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], point - corners[:, 0]
    g11, g12, g22 = (e1 * e1).sum(1), (e1 * e2).sum(1), (e2 * e2).sum(1)
    b1, b2 = (e1 * d).sum(1), (e2 * d).sum(1)
    determinant = np.maximum(g11 * g22 - g12**2, 1e-300)
    v, w = (g22 * b1 - g12 * b2) / determinant, (g11 * b2 - g12 * b1) / determinant
    return np.stack([1 - v - w, v, w], axis=1)
