# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the strata of texels lie on their triangles, in few bytes.

Of a texel that lies whole on one triangle the triangle is all that is kept: its place on the page says the rest, as a
chart maps a triangle affinely. Others, at the edges of triangles and charts, have a row with each stratum's triangle
and barycentrics.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bools, Float32, Float64, Int32, Int64
from ..indices import numbers_of
from .coverage import EDGE_MARGIN
from .surfaces import BLOCK, Surfaces

STRATA = 4
"""Sub-texels of a texel, 2 x 2: slot = 2 * (upper half) + (right half)."""

KEPT = np.float32(1 - 3 * EDGE_MARGIN)
"""Barycentrics are moved inward by a margin: this share of them is kept."""

_SLOTS = np.arange(STRATA)
_ACROSS, _UP = (np.float32(0.25) + np.float32(0.5) * half.astype(np.float32) for half in (_SLOTS & 1, _SLOTS >> 1))


@dataclass(eq=False)
class Footprints:
    """Strata of T texels.

    Attributes:
        pixel: (T,) as of the texels
        size: texels along an edge of a page
        seat: (T,) int32, triangle of a texel that lies whole on it; of others -1 - row
        triangle: (K, 4) int32, of each stratum of the rows
        weights: (K, 4, 2) float32, its barycentrics, weights of corners 1 and 2
        lookup: (6, F) float32, as of the texels
        spread: (11, F) float32, of each triangle a corner of a texel near it, x and y counted through all pages, the
            point of the triangle's plane there, and the steps from it to the next texel along x and y, m
        surfaces: the triangles
    """

    pixel: Int32 | Int64
    size: int
    seat: Int32
    triangle: Int32
    weights: Float32
    lookup: Float32
    spread: Float32
    surfaces: Surfaces

    def first(self, texels: Int64 | Int32 | slice) -> Int32:
        """Triangle (R,) of the first stratum of texels (R,)."""
        if isinstance(texels, np.ndarray) and texels.dtype != bool:
            found = self.seat.take(texels)
        else:
            found = np.array(self.seat[texels])
        rows = np.flatnonzero(found < 0)
        found[rows] = self.triangle.reshape(-1).take(~found[rows] * STRATA)
        return found

    def triangles(self, texels: Int64 | Int32) -> Int32:
        """Triangles (R, 4) of the strata of texels (R,)."""
        seat = self.seat.take(texels)
        found = np.repeat(seat[:, None], STRATA, axis=1)
        rows = np.flatnonzero(seat < 0)
        found[rows] = self.triangle[~seat[rows]]
        return found

    def points(self, texels: Int64 | Int32, slot: Int64 | Int32) -> tuple[Float32, Int32]:
        """Points of strata of texels (R,): (R, 3) float32, m, in memory x, y and z apart, and their triangles (R,)."""
        triangle = self.seat.take(texels)
        rows = np.flatnonzero(triangle < 0)
        if len(rows) == 0:
            return self._spread(texels, slot, triangle).T, triangle
        faces, weights = self._of_rows(~triangle[rows], slot[rows])
        triangle[rows] = faces
        found = self.surfaces.points(faces, weights).T
        if len(rows) == len(triangle):
            return found.T, triangle
        if 2 * len(rows) < len(triangle):
            points = self._spread(texels, slot, triangle)
        else:
            whole = np.ones(len(triangle), bool)
            whole[rows] = False
            points = np.empty((3, len(triangle)), np.float32)
            points[:, whole] = self._spread(texels[whole], slot[whole], triangle[whole])
        points[:, rows] = found
        return points.T, triangle

    def strata(self, texels: Int64 | Int32) -> tuple[Int32, Float32]:
        """Triangles (R, 4) and barycentrics (R, 4, 2) of the strata of texels (R,)."""
        each: Int64 = np.repeat(texels, STRATA)
        triangle, weights = self.at(each, np.tile(_SLOTS, len(texels)))
        return triangle.reshape(-1, STRATA), weights.reshape(-1, STRATA, 2)

    def at(self, texels: Int64 | Int32, slot: Int64 | Int32) -> tuple[Int32, Float32]:
        """Triangles (R,) and barycentrics (R, 2) of strata of texels (R,)."""
        triangle = self.seat.take(texels)
        rows = np.flatnonzero(triangle < 0)
        triangle[rows], exact = self._of_rows(~triangle[rows], slot[rows])
        x, y = self._places(texels, slot, triangle)
        xu, xv, yu, yv = (each.take(triangle) for each in self.lookup[2:])
        determinant = xu * yv - xv * yu
        determinant = np.where(determinant != 0, determinant, np.float32(np.inf))
        # from the corner of a texel that `spread` counts from to the triangle's own
        for place, corner in ((x, self.lookup[0].take(triangle)), (y, self.lookup[1].take(triangle))):
            place += np.floor(corner) - corner
        weights: Float32 = np.stack([x * yv - y * xv, y * xu - x * yu], axis=1)
        weights *= KEPT / determinant[:, None]
        weights += np.float32(EDGE_MARGIN)
        weights[rows] = exact
        return triangle, weights

    def put(self, texels: Int64 | Int32, triangle: Int32, weights: Float32) -> None:
        """Give texels (R,), each once, strata with triangles (R, 4) and barycentrics (R, 4, 2): rows of their own."""
        known = self.seat[texels] < 0
        row = ~self.seat[texels[known]]
        self.triangle[row], self.weights[row] = triangle[known], weights[known]
        new = texels[~known]
        self.seat[new] = -1 - np.arange(len(self.triangle), len(self.triangle) + len(new), dtype=np.int32)
        self.triangle = np.concatenate([self.triangle, triangle[~known]])
        self.weights = np.concatenate([self.weights, weights[~known]])

    def only(self, chosen: Int64, pixel: Int32 | Int64) -> Footprints:
        """Those of texels `chosen` (C,), which lie at `pixel` (C,)."""
        return replace(self, pixel=pixel, seat=self.seat[chosen])

    def _of_rows(self, row: Int32, slot: Int64 | Int32) -> tuple[Int32, Float32]:
        """Triangles (K,) and barycentrics (K, 2) of strata of rows (K,)."""
        place = row * STRATA
        place += slot.astype(np.int32)
        return self.triangle.reshape(-1).take(place), self.weights.reshape(-1, 2).take(place, axis=0)

    def _places(self, texels: Int64 | Int32, slot: Int64 | Int32, triangle: Int64 | Int32) -> tuple[Float32, Float32]:
        """Centres of strata, x and y (R,) in texels from the corners that `spread` counts from."""
        pixel = self.pixel.take(texels)
        line = pixel // self.size
        pixel -= line * self.size
        x, y = pixel.astype(np.float32), line.astype(np.float32)
        x -= self.spread[0].take(triangle)
        y -= self.spread[1].take(triangle)
        x += _ACROSS.take(slot)
        y += _UP.take(slot)
        return x, y

    def _spread(self, texels: Int64 | Int32, slot: Int64 | Int32, triangle: Int32) -> Float32:
        """Points (3, R), m, of strata that lie whole on triangles (R,)."""
        points = np.empty((3, len(triangle)), np.float32)
        for start in range(0, len(triangle), BLOCK):
            part = slice(start, start + BLOCK)
            where = triangle[part].astype(np.intp)
            x, y = self._places(texels[part], slot[part], where)
            for axis in range(3):
                value = self.spread[5 + axis].take(where)
                value *= x
                other = self.spread[8 + axis].take(where)
                other *= y
                value += other
                value += self.spread[2 + axis].take(where, out=other, mode="clip")
                points[axis, part] = value
        return points


def footprints_of(
    pixel: Int32 | Int64,
    size: int,
    whole: Bools,
    triangle: Int32,
    weights: Float32,
    lookup: Float32,
    spread: Float32,
    surfaces: Surfaces,
) -> Footprints:
    """Footprints from the strata of all texels, (T, 4) and (T, 4, 2); rows are for those that are not `whole` (T,)."""
    seat = np.ascontiguousarray(triangle[:, 0])
    alike = whole.copy()
    for slot in range(1, STRATA):
        alike &= triangle[:, slot] == seat
    rows = numbers_of(~alike)
    seat[rows] = -1 - np.arange(len(rows), dtype=np.int32)
    return Footprints(pixel, size, seat, triangle[rows], weights[rows], lookup, spread, surfaces)


def spread_of(uv: Float64, page: Int32, size: int, corners: Float32) -> Float32:
    """`Footprints.spread` (11, F) of triangles with `uv` (F, 3, 2), in texels, on pages (F,), and corners (F, 3, 3), m.

    A point of the triangle's plane is p0 + (x - x0) p_x + (y - y0) p_y, with whole numbers x0 and y0, so that float32
    holds the differences as they are.
    """
    (xu, yu), (xv, yv) = (uv[:, 1] - uv[:, 0]).T, (uv[:, 2] - uv[:, 0]).T
    determinant = xu * yv - xv * yu
    scale = np.divide(1 - 3 * EDGE_MARGIN, determinant, out=np.zeros_like(determinant), where=determinant != 0)
    start = corners[:, 0].T.astype(np.float64)
    along, across = ((corners[:, k] - corners[:, 0]).T.astype(np.float64) for k in (1, 2))
    by_x, by_y = scale * (along * yv - across * yu), scale * (across * xu - along * xv)
    base = np.floor(uv[:, 0].T.astype(np.float32)).astype(np.float64)
    gap = base - uv[:, 0].T
    start += EDGE_MARGIN * (along + across) + by_x * gap[0] + by_y * gap[1]
    base[1] += page.astype(np.float64) * size
    return np.ascontiguousarray(np.concatenate([base, start, by_x, by_y]), np.float32)  # columns are gathered from
