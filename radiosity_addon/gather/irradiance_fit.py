# SPDX-License-Identifier: GPL-3.0-or-later
"""From gather points to every texel: a first-order least-squares fit in world space over the points nearby.

Each point counts within a reach in proportion to the cells around, so the fit is fine where points are dense. Points
that a texel can't see across the surface are left out: light does not leak under a wall.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Float32, Int32, Int64
from ..chunks import Fractions, in_chunks
from ..columns import dots
from ..geometry.texels import Texels
from ..geometry.visibility import Visibility
from ..geometry.walls import hidden
from ..indices import numbers_of
from .gather_points import GatherPoints
from .neighbours import GROWTH, REACH, Neighbours

SLOPE_DAMPING = 0.01
"""Added to the normalised second moments: slopes fade out where points are too few to tell them."""

OVERSHOOT = 0.3
"""A fitted value may leave the range of its points by this share of the range."""

ENOUGH = 6
"""Points that count for a texel, at least: beside a narrow cell the reach may end before the points of wide ones."""

ROOM = 1.5
"""Where fewer are known the reach is so many times the distance of the farthest."""

VALID = 2.0
"""A point counts a quarter where it is farther than the next one, in squares, by so many times the distance of the
nearest surface that it sees (after the validity radius of Ward, Rubinstein and Clear 1988): what lies in a gap tells
little of what lies beside it."""

GAP = 0.5
"""A gap is as wide as this many texels, at least."""

TEXELS = 1 << 12
"""Texels fitted in one go: their arrays, 0.3 MB each, stay in cache."""

TINY = np.float32(1e-30)

NOWHERE = np.float32(1e15)
"""Where padding lies, in metres: out of every reach, and its square within float32."""


def fit_irradiance(
    texels: Texels,
    points: GatherPoints,
    neighbours: Neighbours,
    irradiance: Float32,
    visibility: Visibility,
    texel_width: float,
    workers: int,
) -> Fractions[Float32]:
    """Irradiance (T, C) at every texel from that at the points (P, C); 0 where there is none.

    In the tangent plane of each cell the points' values are fitted, for each texel anew, by a plane with weights
    (1 - d^2 / r^2)^2 (compact support, so no step shows where a point comes in), less for points in gaps; the plane's
    value at the texel is taken.

    Args:
        texel_width: m, of most texels
    """
    narrow = np.square(np.float32(1 / VALID) / np.maximum(points.nearest, np.float32(GAP * texel_width)))
    taking = numbers_of(points.cell >= 0)
    rank = np.empty(points.count, np.int32)  # columns of one chunk are about equally long
    rank[np.argsort(neighbours.count, kind="stable")] = np.arange(points.count, dtype=np.int32)
    taking = taking[np.argsort(rank[points.cell[taking]], kind="stable")]
    result: Float32 = np.zeros((texels.count, irradiance.shape[1]), np.float32)

    def work(start: int, stop: int) -> None:
        texel = taking[start:stop]
        own = points.cell[texel]
        new = np.append(True, own[1:] != own[:-1])  # texels of a cell follow each other
        cells, row = own[new], np.cumsum(new) - 1
        plane = _Plane(cells, texels, points, neighbours)
        x, y = plane.project(texels.position.take(texel, axis=0), row)
        weight, reach = _weights(x, y, plane.width.take(row, axis=1), REACH)
        weight *= _validity(x, y, narrow.take(plane.point).take(row, axis=1))
        crowded = np.flatnonzero(neighbours.crowded[cells][row])
        if len(crowded):
            clear = np.minimum(neighbours.clear[cells], neighbours.clear.take(plane.point))
            _leave_out_hidden(weight, crowded, texels, texel, plane.texel, clear, row, visibility)
        lonely = weight.sum(0) <= 0
        weight[0, lonely] = 1
        values = np.stack([channel.take(plane.point) for channel in np.ascontiguousarray(irradiance.T)])
        share = _shares_of_plane(weight, x, y, reach)
        fitted = np.stack([(share * channel.take(row, axis=1)).sum(0) for channel in values])
        result[texel] = _kept_in_range(fitted, weight, values, row).T

    yield from in_chunks(work, len(taking), TEXELS, workers)
    return result


def shares_at_points(
    texels: Texels, points: GatherPoints, neighbours: Neighbours, reach: float, workers: int
) -> Fractions[Float32]:
    """What each neighbour's value counts in the plane fitted at each point itself: (P, NEIGHBOURS), rows sum to 1.

    Args:
        reach: points count within so many widths of the cells around
    """
    shares: Float32 = np.zeros(neighbours.point.shape, np.float32)

    def work(start: int, stop: int) -> None:
        cells = np.arange(start, stop)
        plane = _Plane(cells, texels, points, neighbours)
        x, y = plane.project(texels.position.take(points.texel[cells], axis=0), np.arange(len(cells)))
        weight, within = _weights(x, y, plane.width, reach)
        weight[0, weight.sum(0) <= 0] = 1
        shares[start:stop, : len(weight)] = _shares_of_plane(weight, x, y, within).T

    yield from in_chunks(work, points.count, TEXELS, workers)
    return shares


class _Plane:
    """Tangent planes of cells (C,) and where their neighbours (K, C) lie in them: with K first, all runs along texels.

    Attributes:
        point: (K, C) the neighbours, padded with the cell's own point
        texel: (K, C) the texels they stand at
        width: (K, C) float32, m, of their cells; huge for padding
    """

    def __init__(self, cells: Int32 | Int64, texels: Texels, points: GatherPoints, neighbours: Neighbours) -> None:
        count = neighbours.count[cells]
        most = int(count.max(initial=1))
        self.point = np.ascontiguousarray(neighbours.point[cells, :most].T)
        self.texel = points.texel.take(self.point)
        self.width = points.width.take(self.point)
        normal = texels.shading_normal[points.texel[cells]]
        self._origin = texels.position[points.texel[cells]]
        # Duff et al. 2017, "Building an Orthonormal Basis, Revisited", listing 3
        sign = np.copysign(np.float32(1), normal[:, 2])
        a = -1 / (sign + normal[:, 2])
        b = normal[:, 0] * normal[:, 1] * a
        self._tangent = np.stack([1 + sign * normal[:, 0] ** 2 * a, sign * b, -sign * normal[:, 0]], axis=1)
        self._other = np.stack([b, sign + normal[:, 1] ** 2 * a, -normal[:, 1]], axis=1)
        gap = texels.position.take(self.texel, axis=0)
        gap -= self._origin
        self._x = dots(gap, self._tangent)
        self._y = dots(gap, self._other)
        padding = np.arange(most)[:, None] >= count
        self._x[padding] = NOWHERE
        self.width[padding] = NOWHERE

    def project(self, position: Float32, row: Int64) -> tuple[Float32, Float32]:
        """Offsets (K, T), m, of the neighbours from texels at `position` (T, 3) of cells row (T,)."""
        gap = position - self._origin.take(row, axis=0)
        x, y = (along.take(row, axis=1) for along in (self._x, self._y))
        x -= dots(gap, self._tangent.take(row, axis=0))
        y -= dots(gap, self._other.take(row, axis=0))
        return x, y


def _means(weight: Float32, values: Float32, row: Int64, chosen: Int64) -> Float32:
    """Weighted means (C, Q) over the points, of texels `chosen` (Q,)."""
    share = weight[:, chosen]
    share /= share.sum(0)
    found: Float32 = np.stack([(share * channel.take(row[chosen], axis=1)).sum(0) for channel in values])
    return found


def _kept_in_range(fitted: Float32, weight: Float32, values: Float32, row: Int64) -> Float32:
    """`fitted` (C, T), its brightness kept near that of values (C, K, cells), weights (K, T), of cells row (T,).

    Brightness is the sum of all channels, so that light groups add up. Where a colour would be less than nothing, all
    channels alike move towards the mean of the points until it is not.
    """
    bright = values.sum(0)
    low, high = bright.min(0), bright.max(0)
    slack = OVERSHOOT * (high - low)
    lost = np.flatnonzero(fitted.sum(0) <= 0)
    fitted[:, lost] = _means(weight, values, row, lost)
    total = fitted.sum(0)
    wanted = np.clip(total, np.maximum(low - slack, 0)[row], (high + slack)[row])
    fitted *= np.divide(wanted, total, out=np.ones_like(total), where=total > 0)  # negative lamps: the mean
    below = np.flatnonzero(fitted.min(0) < 0)
    if len(below):
        mean, own = _means(weight, values, row, below), fitted[:, below]
        gap = np.where((own < 0) & (mean >= 0), own / np.minimum(own - mean, -TINY), 0)
        moved = own + gap.max(0) * (mean - own)
        fitted[:, below] = np.where(mean >= 0, np.maximum(moved, 0), moved)  # what rounding leaves
    return fitted


def _weights(x: Float32, y: Float32, width: Float32, widths: float) -> tuple[Float32, Float32]:
    """Weights (K, T) of points at offsets x, y, and the reach (T,), m, of so many widths of the cells around."""
    weight: Float32 = x * x
    weight += y * y
    reach = np.sqrt(weight)
    reach *= np.float32(GROWTH)
    reach += width
    reach = reach.min(0) * np.float32(widths)
    within = (weight < reach * reach).view(np.int8)
    few = np.flatnonzero(within.sum(0, dtype=np.int8) < ENOUGH)
    reach[few] = np.maximum(reach[few], _reach_of_enough(weight[:, few].T))
    with np.errstate(over="ignore"):  # what lies nowhere, in a scene of nanometres
        weight /= reach * reach
    np.subtract(1, weight, out=weight)
    np.maximum(weight, 0, out=weight)
    weight *= weight
    return weight, reach


def _validity(x: Float32, y: Float32, narrow: Float32) -> Float32:
    """Shares (K, T) that points at offsets x, y keep of their weights, the next one all; `narrow`, 1/m2, tells gaps."""
    share: Float32 = x * x
    share += y * y
    share -= share.min(0)
    with np.errstate(over="ignore"):  # what lies nowhere
        share *= narrow
        share += 1
        share *= share
    return np.divide(1, share, out=share)


def _reach_of_enough(squared: Float32) -> Float32:
    """The reach (T,), m, at which ENOUGH points count, by their squared distances (T, K); no step where others do."""
    nearest = np.sort(squared, axis=1)[:, : ENOUGH + 1]
    known = nearest < NOWHERE * NOWHERE / 4
    farthest = np.sqrt(np.where(known, nearest, 0).max(1))
    enough = known.sum(1) > ENOUGH
    return np.asarray(np.where(enough, farthest, np.float32(ROOM) * farthest), np.float32)


def _leave_out_hidden(
    weight: Float32,
    crowded: Int64,
    texels: Texels,
    texel: Int32,
    beside: Int64,
    clear: Float32,
    row: Int64,
    visibility: Visibility,
) -> None:
    """Set to 0, in place, the weights (K, T) of points, at texels `beside`, that the texels `crowded` can't see.

    Args:
        beside: (K, cells)
        clear: (K, cells) height, m, that is clear over both
        row: (T,) cell of each texel
    """
    number, one = np.nonzero(weight.take(crowded, axis=1) > 0)
    one = crowded.take(one)
    pair = number * beside.shape[1] + row.take(one)
    blocked = hidden(texels, texel.take(one), beside.take(pair), visibility, most=clear.take(pair))
    weight[number[blocked], one[blocked]] = 0


def _shares_of_plane(weight: Float32, x: Float32, y: Float32, reach: Float32) -> Float32:
    """What values at offsets x, y, all (K, T), count at each texel in the plane fitted to them; columns sum to 1."""
    scale = 1 / reach
    outside = weight == 0
    for offset in (x, y):
        offset *= scale
        offset[outside] = 0
    share = weight / weight.sum(0)
    mean_x, mean_y = ((share * offset).sum(0) for offset in (x, y))
    x -= mean_x
    y -= mean_y
    along, across = share * x, share * y
    xy = (along * y).sum(0)
    xx, yy = ((part * offset).sum(0) + np.float32(SLOPE_DAMPING) for part, offset in ((along, x), (across, y)))
    # the plane at the texel is the mean of the values less the slope times the points' mean offset
    determinant = xx * yy - xy * xy
    along *= (mean_x * yy - mean_y * xy) / determinant
    across *= (mean_y * xx - mean_x * xy) / determinant
    share -= along
    share -= across
    return np.asarray(share, np.float32)
