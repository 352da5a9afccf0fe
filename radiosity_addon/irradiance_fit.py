# SPDX-License-Identifier: GPL-3.0-or-later
"""From gather points to every texel: a first-order least-squares fit in world space over the points nearby.

Each point counts within a radius in proportion to its cell, so the fit is fine where points are dense. Points that
a texel can't see across the surface are left out: light does not leak under a wall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import Float32, Int32, Int64
from .chunks import Fractions, in_chunks
from .gather_points import GatherPoints
from .texels import Texels
from .visibility import Visibility

REACH = 1.9
"""A point counts within this many widths of its cell."""

NEIGHBOURS = 16
"""Points considered for a cell, at most."""

SAME_FACING = 0.7
"""Least cosine between normals of a texel and a point that counts for it (45 degrees)."""

SAME_PLANE = 0.15
"""A point counts if it lies within this share of its reach off the common tangent plane."""

CLEARANCE = 0.1
"""Height above the surface, as a share of the distance, at which two points must see each other."""

SLOPE_DAMPING = 0.02
"""Added to the normalised second moments: slopes fade out where points are too few to tell them."""

OVERSHOOT = 0.3
"""A fitted value may leave the range of its points by this share of the range."""

CHUNK = 1 << 14


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Points that count for each cell.

    Attributes:
        point: (P, K) int32, nearest first, padded with the cell's own point
        count: (P,) int32
        crowded: (P,) bool, other surfaces come close: each texel asks for itself what it sees
    """

    point: Int32
    count: Int32
    crowded: np.ndarray  # type: ignore[type-arg]


def find_neighbours(
    texels: Texels, points: GatherPoints, visibility: Visibility, workers: int
) -> Fractions[Neighbours]:
    """Points that may count for the texels of each cell."""
    position = texels.position[points.texel]
    normal = texels.shading_normal[points.texel]
    blocks = _Blocks(position, float(points.width.max(initial=1e-9)) * (REACH + 1))

    def work(start: int, stop: int) -> tuple[Int64, Int64, Float32]:
        cell, point = blocks.pairs(start, stop)
        gap = position[point] - position[cell]
        distance = np.sqrt(np.einsum("ij,ij->i", gap, gap))
        reach = points.width[point] * np.float32(REACH)
        close = distance < reach + points.width[cell]
        cell, point, gap, distance, reach = cell[close], point[close], gap[close], distance[close], reach[close]
        facing = np.einsum("ij,ij->i", normal[cell], normal[point])
        height = np.abs(np.einsum("ij,ij->i", gap, normal[cell] + normal[point])) / 2
        kept = (facing > SAME_FACING) & (height <= np.float32(SAME_PLANE) * reach)
        cell, point, gap, distance = cell[kept], point[kept], gap[kept], distance[kept]
        nearness = (distance - points.width[cell]) / reach[kept]
        order = np.lexsort((point, nearness, cell))
        cell, point, gap, distance = cell[order], point[order], gap[order], distance[order]
        rank = np.arange(len(cell)) - np.searchsorted(cell, cell, side="left")
        first = rank < NEIGHBOURS
        cell, point, gap, distance = cell[first], point[first], gap[first], distance[first]
        lift = (distance * np.float32(CLEARANCE) + np.float32(texels.surfaces.offset))[:, None]
        origins = position[cell] + normal[cell] * lift
        blocked = visibility.occluded(origins, gap + (normal[point] - normal[cell]) * lift) & (distance > 0)
        return cell[~blocked], point[~blocked], cell[blocked]

    parts = yield from in_chunks(work, blocks.count, 64, workers)
    empty = np.zeros(0, np.int64)
    cell, point, cut = (np.concatenate(part) for part in zip(*parts, strict=True)) if parts else (empty,) * 3
    order = np.argsort(cell, kind="stable")
    cell, point = cell[order], point[order]
    rank = np.arange(len(cell)) - np.searchsorted(cell, cell, side="left")
    table = np.repeat(np.arange(points.count, dtype=np.int32)[:, None], NEIGHBOURS, axis=1)
    table[cell, rank] = point
    crowded = points.nearest < points.width * np.float32(1.5)
    crowded[cut.astype(np.int64)] = True
    hidden = points.cell[~texels.valid]
    crowded[hidden[hidden >= 0]] = True
    return Neighbours(table, np.bincount(cell, minlength=points.count).astype(np.int32), crowded)


class _Blocks:
    """Points in a coarse grid, so that near pairs are found without comparing all."""

    def __init__(self, position: Float32, width: float) -> None:
        grid = np.floor(position / np.float32(width)).astype(np.int64) + (1 << 20)
        key = (grid[:, 0] << 42) + (grid[:, 1] << 21) + grid[:, 2]
        self._order = np.argsort(key, kind="stable")
        self._names, self._begin = np.unique(key[self._order], return_index=True)
        self._size = np.diff(np.append(self._begin, len(key)))
        self.count = len(self._names)

    def pairs(self, start: int, stop: int) -> tuple[Int64, Int64]:
        """All pairs (cell, point) with the cell in blocks start..stop and the point in that block or one beside it."""
        cells: list[Int64] = []
        points: list[Int64] = []
        steps = np.arange(-1, 2)
        for dx in steps:
            for dy in steps:
                for dz in steps:
                    wanted = self._names[start:stop] + (dx << 42) + (dy << 21) + dz
                    place = np.minimum(np.searchsorted(self._names, wanted), self.count - 1)
                    here = np.flatnonzero(self._names[place] == wanted)
                    there = place[here]
                    here = here + start
                    each = self._size[here] * self._size[there]
                    pair = np.repeat(np.arange(len(here)), each)
                    nth = np.arange(len(pair)) - np.repeat(np.cumsum(each) - each, each)
                    across = self._size[there][pair]
                    cells.append(self._order[self._begin[here][pair] + nth // across])
                    points.append(self._order[self._begin[there][pair] + nth % across])
        return np.concatenate(cells), np.concatenate(points)


def fit_irradiance(
    texels: Texels,
    points: GatherPoints,
    neighbours: Neighbours,
    irradiance: Float32,
    visibility: Visibility,
    workers: int,
) -> Fractions[Float32]:
    """Irradiance (T, C) at every texel from that at the points (P, C); 0 where there is none.

    In the tangent plane of each texel the points' values are fitted by a plane with weights (1 - d^2 / r^2)^2
    (compact support, so no step shows where a point comes in), and the plane's value at the texel is taken.
    """
    taking = np.flatnonzero(points.cell >= 0)
    taking = taking[np.argsort(points.cell[taking], kind="stable")]
    position = texels.position[points.texel]
    normal = texels.shading_normal[points.texel]
    result: Float32 = np.zeros((texels.count, irradiance.shape[1]), np.float32)

    def work(start: int, stop: int) -> None:
        texel = taking[start:stop]
        cell = points.cell[texel]
        width = int(neighbours.count[cell].max(initial=1))
        point = neighbours.point[cell, :width]
        padding = np.arange(width) >= neighbours.count[cell][:, None]
        here, facing = texels.position[texel], texels.shading_normal[texel]
        gap = position[point]
        gap -= here[:, None]
        weight = _weights(gap, np.einsum("tkc,tc->tk", normal[point], facing), points.width[point], facing)
        weight[padding] = 0
        asking = np.flatnonzero(neighbours.crowded[cell])
        if len(asking):
            _leave_out_hidden(weight, asking, texels, texel, here, facing, gap, normal[point], visibility)
        lonely = weight.sum(1) <= 0
        weight[lonely, 0] = 1
        result[texel] = _fit(weight, gap, facing, irradiance[point], points.width[cell])

    yield from in_chunks(work, len(taking), CHUNK, workers)
    return result


def _weights(gap: Float32, cosine: Float32, width: Float32, facing: Float32) -> Float32:
    """Weights (T, K) of points at `gap` (T, K, 3) from texels facing (T, 3)."""
    reach = width * np.float32(REACH)
    weight: Float32 = np.einsum("tkc,tkc->tk", gap, gap)
    weight /= reach * reach
    np.subtract(1, weight, out=weight)
    np.maximum(weight, 0, out=weight)
    weight *= weight
    cosine = (cosine - np.float32(SAME_FACING)) / np.float32(1 - SAME_FACING)
    weight *= np.maximum(cosine, 0)
    weight *= np.abs(np.einsum("tkc,tc->tk", gap, facing)) <= reach * np.float32(2 * SAME_PLANE)
    return weight


def _leave_out_hidden(
    weight: Float32,
    asking: Int64,
    texels: Texels,
    texel: Int64,
    here: Float32,
    facing: Float32,
    gap: Float32,
    normal: Float32,
    visibility: Visibility,
) -> None:
    """Set to 0, in place, the weights of points that the texels `asking` can't see."""
    row, column = np.nonzero(weight[asking] > 0)
    row = asking[row]
    span = gap[row, column]
    distance = np.sqrt(np.einsum("ij,ij->i", span, span))
    lift = (distance * np.float32(CLEARANCE) + np.float32(texels.surfaces.offset))[:, None]
    start = facing[row] * lift
    blocked = visibility.occluded(here[row] + start, span + normal[row, column] * lift - start)
    weight[row[blocked], column[blocked]] = 0


def _fit(weight: Float32, gap: Float32, facing: Float32, values: Float32, width: Float32) -> Float32:
    """Value (T, C) at each texel of the plane fitted to values (T, K, C) at gaps (T, K, 3)."""
    sign = np.copysign(np.float32(1), facing[:, 2])
    a = -1 / (sign + facing[:, 2])
    b = facing[:, 0] * facing[:, 1] * a
    tangent = np.stack([1 + sign * facing[:, 0] ** 2 * a, sign * b, -sign * facing[:, 0]], axis=1)
    other = np.stack([b, sign + facing[:, 1] ** 2 * a, -facing[:, 1]], axis=1)
    x = np.einsum("tkc,tc->tk", gap, tangent) / width[:, None]
    y = np.einsum("tkc,tc->tk", gap, other) / width[:, None]
    total = weight.sum(1)
    wx, wy = weight * x, weight * y
    mean_x, mean_y = wx.sum(1) / total, wy.sum(1) / total
    xx = (wx * x).sum(1) / total - mean_x**2 + SLOPE_DAMPING
    yy = (wy * y).sum(1) / total - mean_y**2 + SLOPE_DAMPING
    xy = (wx * y).sum(1) / total - mean_x * mean_y
    # the plane at the texel is the mean of the values less the slope times the points' mean offset
    determinant = xx * yy - xy * xy
    slope_x = (mean_x * yy - mean_y * xy) / determinant
    slope_y = (mean_y * xx - mean_x * xy) / determinant
    weight = weight * (1 - (x - mean_x[:, None]) * slope_x[:, None] - (y - mean_y[:, None]) * slope_y[:, None])
    fitted = np.einsum("tk,tkc->tc", weight, values) / total[:, None]
    counting = (weight != 0)[:, :, None]
    low = np.where(counting, values, np.inf).min(1)
    high = np.where(counting, values, -np.inf).max(1)
    slack = OVERSHOOT * (high - low)
    return np.clip(fitted, np.maximum(low - slack, 0), high + slack).astype(np.float32)
