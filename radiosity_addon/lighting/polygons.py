# SPDX-License-Identifier: GPL-3.0-or-later
"""Closed forms of light: what Lambertian polygons, discs and spheres bring to a point, and known form factors.

The quantity is the projected solid angle, in sr: the irradiance per unit radiance, pi times the point's form factor.
Points come in blocks whose temporaries stay in cache, and vectors as three rows (x, y, z) of one block. Angles are
taken by atan2(|a x b|, a . b); arccos would err by 9 % in float32 for a lamp of 0.2 m at 30 m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from ..arrays import Bools, Float32, Float64, Int64

BLOCK = 16384
"""Points treated in one go: some twenty rows of 64 kB stay in a second-level cache."""

FAR = 8.0
"""From this many radii on a polygon is replaced by its nodes: a 2 x 2 Gauss rule is then right to 2e-4."""

ELLIPSE_CORNERS = 24
"""Corners of the polygon that stands for an ellipse: right to 1e-3 as near as a tenth of the radius."""

GRAZING = np.float32(1e-5)
"""A polygon that nowhere rises above a horizon by this share of its size plus coordinates does not rise at all: seen
from a point of its own plane it would else be nothing or half the sky, as rounding has it."""

TINY = np.float32(1e-30)
"""Keeps 0 / 0 from arising where a point lies on an edge; the numerator is then 0 as well."""

Rows: TypeAlias = Sequence[Float32] | Float32
"""Vectors as three rows x, y, z, each (B,) or one number for all points."""


@dataclass(frozen=True, eq=False)
class Polygon:
    """A planar Lambertian emitter. Its front is where the corners run counter-clockwise.

    Attributes:
        corners: (E, 3) float64, m
        nodes: (K, 3) float64, points that stand for it from afar, m
        weights: (K,) float64, their areas, m2
        normal: (3,) float64, unit, of the front
        two_sided: shines to both sides
    """

    corners: Float64
    nodes: Float64
    weights: Float64
    normal: Float64
    two_sided: bool = False

    @property
    def area(self) -> float:
        return float(self.weights.sum())

    @property
    def centre(self) -> Float64:
        """(3,) m, the centroid."""
        centroid: Float64 = self.weights @ self.nodes / self.weights.sum()
        return centroid

    @property
    def radius(self) -> float:
        """Distance of the farthest corner from the centroid, m."""
        return float(np.max(np.linalg.norm(self.corners - self.centre, axis=1)))


def parallelogram(corner: Float64, edge_u: Float64, edge_v: Float64, two_sided: bool = False) -> Polygon:
    """A parallelogram with its front along edge_u x edge_v; nodes are 2 x 2 Gauss points."""
    corners = corner + np.array([np.zeros(3), edge_u, edge_u + edge_v, edge_v])
    cross = np.cross(edge_u, edge_v)
    area = np.linalg.norm(cross)
    steps = np.array([0.5 - math.sqrt(1 / 12), 0.5 + math.sqrt(1 / 12)])
    u, v = (grid.reshape(-1, 1) for grid in np.meshgrid(steps, steps))
    return Polygon(corners, corner + u * edge_u + v * edge_v, np.full(4, area / 4), cross / area, two_sided)


def ellipse(centre: Float64, half_u: Float64, half_v: Float64, two_sided: bool = False) -> Polygon:
    """An ellipse of given half axes as a polygon of equal area; nodes are a 7-point rule (Stroud 1971, S2: 5-1)."""
    turn = (np.arange(ELLIPSE_CORNERS) + 0.5) * (2 * math.pi / ELLIPSE_CORNERS)
    scale = math.sqrt(2 * math.pi / (ELLIPSE_CORNERS * math.sin(2 * math.pi / ELLIPSE_CORNERS)))
    corners = centre + scale * (np.cos(turn)[:, None] * half_u + np.sin(turn)[:, None] * half_v)
    cross = np.cross(half_u, half_v)
    area = math.pi * float(np.linalg.norm(cross))
    around = np.arange(6) * (math.pi / 3)
    ring = math.sqrt(2 / 3) * (np.cos(around)[:, None] * half_u + np.sin(around)[:, None] * half_v)
    nodes = centre + np.concatenate([np.zeros((1, 3)), ring])
    weights = area * np.array([1 / 4] + [1 / 8] * 6)
    return Polygon(corners, nodes, weights, cross / np.linalg.norm(cross), two_sided)


def convex_polygon(corners: Float64, two_sided: bool = False) -> Polygon:
    """A convex polygon; nodes are three points of each triangle of its fan (degree 2)."""
    first, second, third = corners[:1], corners[1:-1], corners[2:]
    cross = np.cross(second - first, third - first)
    areas = np.linalg.norm(cross, axis=1) / 2
    triangles = np.stack([np.broadcast_to(first, second.shape), second, third], axis=1)
    barycentric = np.full((3, 3), 1 / 6) + np.eye(3) / 2
    nodes = np.einsum("kc,fcx->fkx", barycentric, triangles).reshape(-1, 3)
    normal = cross.sum(0)
    return Polygon(corners, nodes, np.repeat(areas / 3, 3), normal / np.linalg.norm(normal), two_sided)


def polygon_light(polygon: Polygon, points: Float32, shading: Float32, geometric: Float32 | None = None) -> Float32:
    """Projected solid angle of a polygon at points (P, 3), clipped to their horizons: (P,) float32, sr.

    Lambert's formula (Lambert 1760; Arvo 1994, "The Irradiance Jacobian", equation 3) for the part of the polygon
    above the horizons of both normals; the cosine is that of the shading normal.

    Args:
        shading: (P, 3) float32, unit shading normals
        geometric: (P, 3) float32, unit geometric normals; None if they are the shading normals
    """
    result = np.empty(len(points), np.float32)
    for start in range(0, len(points), BLOCK):
        part = slice(start, start + BLOCK)
        normals = [np.ascontiguousarray(shading[part].T)]
        if geometric is not None and geometric is not shading:
            normals.append(np.ascontiguousarray(geometric[part].T))
        result[part] = _polygon_block(polygon, np.ascontiguousarray(points[part].T), normals)
    return result


def _polygon_block(polygon: Polygon, p: Float32, normals: list[Float32]) -> Float32:
    """Points are split into those that the polygon is near, far from, cut by a horizon of, and below."""
    centre = polygon.centre.astype(np.float32)
    radius = np.float32(polygon.radius)
    away = [centre[k] - p[k] for k in range(3)]
    height = _dot(away, normals[0])
    for normal in normals[1:]:
        np.minimum(height, _dot(away, normal), out=height)
    whole = height > radius
    far = _dot(away, away) > (radius * np.float32(FAR)) ** 2
    far &= whole
    if far.all():
        total = _from_nodes(polygon, p, normals[0])
    else:
        corners = polygon.corners.astype(np.float32)
        low, high = _heights(corners, p, normals)
        least = _least_rise(corners)
        whole |= low > least
        near = whole & ~far
        if near.all():
            total = _lambert(corners, p, normals[0])
        else:
            total = np.zeros(p.shape[1], np.float32)
            for chosen, light in ((np.flatnonzero(far), _from_nodes), (np.flatnonzero(near), _from_corners)):
                if len(chosen):
                    total[chosen] = light(polygon, p[:, chosen], normals[0][:, chosen])
            cut = np.flatnonzero(~whole & (high > least))
            if len(cut):
                total[cut] = _clipped(corners, p[:, cut], [normal[:, cut] for normal in normals])
    return np.abs(total, out=total) if polygon.two_sided else np.maximum(total, 0, out=total)


def signed_light(corners: Float32, p: Float32, normals: list[Float32]) -> Float32:
    """Projected solid angle of a polygon of its own for each point, (B,) float32, sr; negative behind its front.

    Args:
        corners: (E, 3, B) float32, m
        p: (3, B) float32, m
        normals: (3, B) each; the first has the cosine, all have horizons
    """
    low, high = _heights(corners, p, normals)
    least = _least_rise(corners)
    whole = low > least
    if whole.all():
        return _lambert(corners, p, normals[0])
    total = np.zeros(p.shape[1], np.float32)
    seen = np.flatnonzero(whole)
    total[seen] = _lambert(corners[:, :, seen], p[:, seen], normals[0][:, seen])
    cut = np.flatnonzero(~whole & (high > least))
    if len(cut):
        total[cut] = _clipped(corners[:, :, cut], p[:, cut], [normal[:, cut] for normal in normals])
    return total


def _heights(corners: Float32, p: Float32, normals: list[Float32]) -> tuple[Float32, Float32]:
    """How high the lowest and the highest corner stand over the nearer horizon, (B,) m each."""
    low = np.full(p.shape[1], np.inf, np.float32)
    high = np.full(p.shape[1], np.inf, np.float32)
    for normal in normals:
        ground = _dot(p, normal)
        top = np.full(p.shape[1], -np.inf, np.float32)
        for corner in corners:
            height = _dot(corner, normal)
            height -= ground
            np.minimum(low, height, out=low)
            np.maximum(top, height, out=top)
        np.minimum(high, top, out=high)
    return low, high


def _least_rise(corners: Float32) -> Float32:
    """How high a polygon (E, 3) or (E, 3, B) has to rise over a horizon to be seen, () or (B,) m."""
    size: Float32 = np.abs(corners - corners[0]).max(axis=(0, 1))
    size += np.abs(corners).max(axis=(0, 1)) / 8
    return size * GRAZING


def _from_corners(polygon: Polygon, p: Float32, normal: Float32) -> Float32:
    return _lambert(polygon.corners.astype(np.float32), p, normal)


def _lambert(corners: Float32, p: Float32, normal: Float32) -> Float32:
    """Half the sum of angle times normal component over the edges, (B,); corners (E, 3) or (E, 3, B).

    The normal of an edge's plane is a x (b - a): the difference is exact where a x b would cancel for small or far
    polygons.
    """
    total = np.zeros(p.shape[1], np.float32)
    a = [corners[0][k] - p[k] for k in range(3)]
    work = np.empty_like(total)
    for start, stop in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = stop - start
        b = [stop[k] - p[k] for k in range(3)]
        cross = []
        for k in range(3):
            component = a[k - 2] * edge[k - 1]
            component -= np.multiply(a[k - 1], edge[k - 2], out=work)
            cross.append(component)
        sine = _dot(cross, cross)
        np.sqrt(sine, out=sine)
        angle = _dot(a, b)
        np.arctan2(sine, angle, out=angle)
        angle *= _dot(cross, normal)
        angle /= np.maximum(sine, TINY, out=sine)
        total += angle
        a = b
    total *= np.float32(-0.5)
    return total


def _from_nodes(polygon: Polygon, p: Float32, normal: Float32) -> Float32:
    """The polygon as a few points: sum of area times both cosines over the squared distance, (B,), signed."""
    total = np.zeros(p.shape[1], np.float32)
    front = polygon.normal.astype(np.float32)
    for node, weight in zip(polygon.nodes.astype(np.float32), polygon.weights.astype(np.float32), strict=True):
        away = [node[k] - p[k] for k in range(3)]
        square = _dot(away, away)
        square *= square
        light = _dot(away, normal)
        light *= _dot(away, front)
        light /= np.maximum(square, TINY, out=square)
        light *= -weight
        total += light
    return total


def _clipped(corners: Float32, p: Float32, normals: list[Float32]) -> Float32:
    """As `_lambert`, for the part above all horizons; corners (E, 3) or (E, 3, B).

    The horizons of smooth normals cut the very polygon that a point lies on: it would be nothing or half the sky there,
    as rounding has it, and is nothing.
    """
    polygon = corners if corners.ndim == 3 else np.broadcast_to(corners[:, :, None], (*corners.shape, p.shape[1]))
    for normal in normals:
        polygon = _above(polygon, p, normal)
    light = _lambert(polygon, p, normals[0])
    light[_in_plane(corners, p)] = 0
    return light


def _in_plane(corners: Float32, p: Float32) -> Bools:
    """Which points p (3, B) lie in the plane of their polygon, (E, 3) or (E, 3, B)."""
    spokes = corners - corners[0]
    front = np.sum([np.cross(a, b, axis=0) for a, b in pairwise(spokes[1:])], axis=0)
    height = _dot([p[k] - corners[0][k] for k in range(3)], front)
    flat: Bools = np.abs(height) <= np.sqrt(_dot(front, front)) * _least_rise(corners)
    return flat


def _above(polygon: Float32, p: Float32, normal: Float32) -> Float32:
    """A polygon (E, 3, B) for each point, cut by its horizon (Sutherland and Hodgman 1974); padded by its last corner.

    Returns:
        (E', 3, B); all corners are one where nothing is left
    """
    height = np.einsum("ekb,kb->eb", polygon, normal) - np.einsum("kb,kb->b", p, normal)
    following = np.roll(height, -1, axis=0)
    inside = height > 0
    crossing = inside != (following > 0)
    share = height / np.where(crossing, height - following, 1)
    cuts = polygon + share[:, None] * (np.roll(polygon, -1, axis=0) - polygon)
    found = np.stack([polygon, cuts], axis=1).reshape(-1, *polygon.shape[1:])
    kept = np.stack([inside, crossing], axis=1).reshape(-1, polygon.shape[2])
    count = kept.sum(0)
    order = np.argsort(~kept, axis=0, kind="stable")
    slots = np.minimum(np.arange(max(int(count.max()), 1))[:, None], np.maximum(count - 1, 0))
    chosen: Int64 = np.take_along_axis(order, slots, axis=0)
    return np.take_along_axis(found, chosen[:, None, :], axis=0)


def _dot(a: Rows, b: Rows) -> Float32:
    total: Float32 = a[0] * b[0]
    total += a[1] * b[1]
    total += a[2] * b[2]
    return total


def cap_light(cosine: Float32, sine_squared: Float32) -> Float32:
    """Projected solid angle of a round cap of the sky, clipped to the horizon: (P,) float32, sr.

    A sphere of radius r at distance d is a cap of sin^2 = r^2 / d^2, a disc that faces the point one of
    sin^2 = r^2 / (r^2 + d^2). Where the horizon cuts it: Snyder 1996, "Area Light Sources for Real-Time Graphics";
    the form used is Lagarde and de Rousiers 2014, "Moving Frostbite to Physically Based Rendering", listing 7.

    Args:
        cosine: (P,) float32, between the normal and the direction of the cap's centre
        sine_squared: (P,) or () float32, of the cap's half angle, 0 to 1
    """
    sine_squared = np.broadcast_to(np.asarray(sine_squared, np.float32), cosine.shape)
    result: Float32 = np.float32(math.pi) * sine_squared * cosine
    whole = (cosine > 0) & (cosine * cosine >= sine_squared)
    cut = np.flatnonzero(~whole & (cosine * cosine < sine_squared))
    result[~whole] = 0
    if len(cut):
        c, s2 = cosine[cut], sine_squared[cut]
        sine = np.sqrt(np.maximum(1 - c * c, 0))
        cot = np.sqrt(np.maximum(1 / s2 - 1, 0))
        y = np.clip(-cot * c / np.maximum(sine, TINY), -1, 1)
        root = np.sqrt((1 - y) * (1 + y))
        light = (c * np.arctan2(root, y) - cot * sine * root) * s2 + np.arctan2(sine * root, cot)
        result[cut] = np.maximum(light, 0)
    return result


def parallel_rectangles(width: float, depth: float, distance: float) -> float:
    """Form factor between equal, directly opposed rectangles (Howell's catalogue, C-11)."""
    x, y = width / distance, depth / distance
    p, q = math.sqrt(1 + x * x), math.sqrt(1 + y * y)
    logarithm = 0.5 * math.log((1 + x * x) * (1 + y * y) / (1 + x * x + y * y))
    along = x * q * math.atan(x / q) + y * p * math.atan(y / p) - x * math.atan(x) - y * math.atan(y)
    return 2 / (math.pi * x * y) * (logarithm + along)


def perpendicular_rectangles(width: float, height: float, edge: float) -> float:
    """Form factor from a rectangle (width x edge) to one (height x edge) that stands on their common edge (C-14)."""
    w, h = width / edge, height / edge
    s = w * w + h * h
    a = (1 + w * w) * (1 + h * h) / (1 + s)
    b = (w * w * (1 + s) / ((1 + w * w) * s)) ** (w * w)
    c = (h * h * (1 + s) / ((1 + h * h) * s)) ** (h * h)
    angles = w * math.atan(1 / w) + h * math.atan(1 / h) - math.sqrt(s) * math.atan(1 / math.sqrt(s))
    return (angles + 0.25 * math.log(a * b * c)) / (math.pi * w)


def coaxial_discs(radius: float, other_radius: float, distance: float) -> float:
    """Form factor from a disc to a parallel one on the same axis (C-41)."""
    a, b = radius / distance, other_radius / distance
    x = 1 + (1 + b * b) / (a * a)
    return 0.5 * (x - math.sqrt(x * x - 4 * (b / a) ** 2))
