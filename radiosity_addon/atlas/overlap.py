# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds triangles of a uv map that lie on one another."""

from __future__ import annotations

import numpy as np

from ..arrays import Float64, Int64

TOLERANCE = 1e-6
"""Share of a group's extent by which triangles may lie on one another: rounding of float32 uv."""

ROW_PHASE = 0.4142
"""Where in its band a row is probed; irrational, so that rows miss the vertices of regular grids."""

MAX_ROWS = 4096


def overlapping(uv: Float64, group: Int64, tolerance: float = TOLERANCE) -> Int64:
    """Pairs of triangles of one group that overlap, at least one pair for each place where some do.

    Probes horizontal rows: along a row every triangle is an exact interval, and sorted intervals show whether they
    are apart. Overlaps smaller than the distance of the rows, a 4096th to a 16th of the group's height depending on
    its number of triangles, can escape.

    Args:
        uv: (F, 3, 2) float64, any winding
        group: (F,) int64, 0 or more
        tolerance: share of the group's width by which intervals may overlap

    Returns:
        (K, 2) int64 indices of triangles, the lower first
    """
    nothing = np.zeros((0, 2), np.int64)
    if not len(uv):
        return nothing
    groups = int(group.max()) + 1
    triangles = np.bincount(group, minlength=groups)
    low, high = np.full((groups, 2), np.inf), np.full((groups, 2), -np.inf)
    np.minimum.at(low, group, uv.min(axis=1))
    np.maximum.at(high, group, uv.max(axis=1))
    extent = np.where(triangles[:, None] > 0, high - low, 1.0)
    extent[extent <= 0] = 1.0
    rows = np.clip(8 * np.sqrt(triangles) + 16, 16, MAX_ROWS).astype(np.int64)
    row_base = np.cumsum(rows) - rows
    x = (uv[..., 0] - low[group, 0, None]) / extent[group, 0, None]
    y = (uv[..., 1] - low[group, 1, None]) / extent[group, 1, None] * rows[group, None]  # in rows

    first = np.ceil(y.min(axis=1) - ROW_PHASE).astype(np.int64)
    count = np.maximum(np.floor(y.max(axis=1) - ROW_PHASE).astype(np.int64) - first + 1, 0)
    triangle = np.repeat(np.arange(len(uv)), count)
    if not len(triangle):
        return nothing
    row = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count) + first[triangle]
    probe = row + ROW_PHASE
    left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        ya, yb, xa, xb = y[triangle, a], y[triangle, b], x[triangle, a], x[triangle, b]
        crosses = (ya <= probe) != (yb <= probe)
        share = (probe - ya) / np.where(crosses, yb - ya, 1.0)
        at = xa + share * (xb - xa)
        np.minimum(left, np.where(crosses, at, np.inf), out=left)
        np.maximum(right, np.where(crosses, at, -np.inf), out=right)

    real = right - left > tolerance  # narrower intervals can't overlap by more
    triangle, left, right = triangle[real], left[real], right[real]
    key = 2.0 * (row_base[group[triangle]] + row[real])  # intervals of later rows lie beyond those of earlier ones
    order = np.argsort(key + left, kind="stable")
    triangle, left, right = triangle[order], (key + left)[order], (key + right)[order]
    reach = np.maximum.accumulate(right)
    holder = np.maximum.accumulate(np.where(right == reach, np.arange(len(right)), 0))
    hit = np.flatnonzero(left[1:] < reach[:-1] - tolerance) + 1
    pairs = np.stack([triangle[holder[hit - 1]], triangle[hit]], axis=1)
    return np.unique(np.sort(pairs, axis=1), axis=0)
