# SPDX-License-Identifier: GPL-3.0-or-later
"""From gather points to every texel: a first-order least-squares fit in world space over the points nearby.

Each point counts within a radius in proportion to its cell, so the fit is fine where points are dense. Points that
a texel can't see across the surface are left out: light does not leak under a wall.
"""

from __future__ import annotations

import numpy as np

from .arrays import Float32, Int64
from .chunks import Fractions, in_chunks
from .gather_points import GatherPoints
from .neighbours import GROWTH, REACH, SAME_FACING, SAME_PLANE, Neighbours, lift
from .texels import Texels
from .visibility import Visibility

SLOPE_DAMPING = 0.02
"""Added to the normalised second moments: slopes fade out where points are too few to tell them."""

OVERSHOOT = 0.3
"""A fitted value may leave the range of its points by this share of the range."""

CHUNK = 1 << 14


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
    cell_of = points.cell[taking]
    taking = taking[np.lexsort((cell_of, neighbours.count[cell_of]))]  # rows of one chunk are about equally long
    position = texels.position[points.texel]
    normal = texels.shading_normal[points.texel]
    result: Float32 = np.zeros((texels.count, irradiance.shape[1]), np.float32)

    def work(start: int, stop: int) -> None:
        texel = taking[start:stop]
        cell = points.cell[texel]
        most = int(neighbours.count[cell].max(initial=1))
        point = neighbours.point[cell, :most]
        padding = np.arange(most) >= neighbours.count[cell][:, None]
        here, facing = texels.position[texel], texels.shading_normal[texel]
        gap = position[point]
        gap -= here[:, None]
        width = points.width[point]
        width[padding] = np.inf
        weight, reach = _weights(gap, np.einsum("tkc,tc->tk", normal[point], facing), width, facing)
        weight[padding] = 0
        asking = np.flatnonzero(neighbours.crowded[cell])
        if len(asking):
            _leave_out_hidden(weight, asking, texels, texel, here, facing, gap, normal[point], visibility)
        lonely = weight.sum(1) <= 0
        weight[lonely, 0] = 1
        result[texel] = _fit(weight, gap, facing, irradiance[point], reach)

    yield from in_chunks(work, len(taking), CHUNK, workers)
    return result


def _weights(gap: Float32, cosine: Float32, width: Float32, facing: Float32) -> tuple[Float32, Float32]:
    """Weights (T, K) of points at `gap` (T, K, 3) from texels facing (T, 3), and the reach (T,), m."""
    weight: Float32 = np.einsum("tkc,tkc->tk", gap, gap)
    distance = np.sqrt(weight)
    reach = np.float32(REACH) * (width + np.float32(GROWTH) * distance).min(1)
    flat = np.abs(np.einsum("tkc,tc->tk", gap, facing)) <= np.float32(2 * SAME_PLANE) * distance
    weight /= (reach * reach)[:, None]
    np.subtract(1, weight, out=weight)
    np.maximum(weight, 0, out=weight)
    weight *= weight
    cosine = (cosine - np.float32(SAME_FACING)) / np.float32(1 - SAME_FACING)
    weight *= np.maximum(cosine, 0)
    weight *= flat
    return weight, reach


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
    up = lift(distance, np.einsum("ij,ij->i", facing[row], normal[row, column]), texels.surfaces.offset)
    start = facing[row] * up
    blocked = visibility.occluded(here[row] + start, span + normal[row, column] * up - start)
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
