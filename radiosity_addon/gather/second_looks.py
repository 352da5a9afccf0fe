# SPDX-License-Identifier: GPL-3.0-or-later
"""Which gather points look again: those whose rays differ most, where most texels are served.

The error of a lightmap is largest in few places, beside what the sun shines on: a twentieth of the interior's surface
held five sixths of the squared noise. For a given number of rays in all the squared error is least if each point sends
rays in proportion to its standard deviation and the root of the area it stands for (Neyman 1934).

A point that chose the number of its rays by its own would err: where by chance they met little light it would be
content, and where they met much it would look again until the mean is right. So points of a group are parted in two
halves, and the variance of each half tells how often the other looks again.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Float32, Float64, Int64
from ..chunks import Fractions
from ..geometry.texels import Texels
from .gather_points import GatherPoints, cell_keys

NOISY = 4.0
"""A point looks again once for each so many times that its noise holds the mean of all points: where all are noisy
alike, none does, and there can't be more than 1 / NOISY times as many further looks as points."""

MOST_LOOKS = 31
"""Further looks of a point, at most."""

GROUP_WIDTH = 4.0
"""Variances are shared within cells this many times as wide as those of points."""


def variances(weights: Float32, radiance: Float32) -> Float64:
    """Variance (Q,) of each sum of weighted radiances, both (Q, R), as if its rays were independent."""
    light = weights * radiance
    total = light.sum(1, dtype=np.float64)  # the square of a light that float32 holds may be more than it holds
    found: Float64 = np.einsum("qr,qr->q", light, light, dtype=np.float64) - total * total / light.shape[1]
    return found


def further_looks(variance: Float64, texels: Texels, points: GatherPoints, workers: int) -> Fractions[Int64]:
    """How often each point looks again (P,), by the variances (P,) of the first looks of others."""
    half = yield from _halves(texels, points, workers)
    count = int(half.max(initial=0)) + 2
    number, total = np.bincount(half, minlength=count), np.bincount(half, variance, count)
    other = total[half ^ 1] / np.maximum(number[half ^ 1], 1)
    served = np.bincount(points.cell[points.cell >= 0], minlength=points.count)
    noise = np.sqrt(np.maximum(other, 0) * served)
    mean = noise.mean() if points.count else 0.0
    looks = noise / (NOISY * mean) if mean > 0 else np.zeros(points.count)
    return np.asarray(np.minimum(looks, MOST_LOOKS), np.int64)


def _halves(texels: Texels, points: GatherPoints, workers: int) -> Fractions[Int64]:
    """(P,) int64, which half of which group each point is in: 2 g or 2 g + 1."""
    half = np.zeros(points.count, np.int64)
    groups = 0
    for width in np.unique(points.width):
        own = np.flatnonzero(points.width == width)
        keys = yield from cell_keys(texels, points.texel[own], float(width) * GROUP_WIDTH, workers)
        _, begin, group = np.unique(np.sort(keys), return_index=True, return_inverse=True)
        rank = np.arange(len(own)) - begin[group]
        half[own[np.argsort(keys, kind="stable")]] = 2 * (groups + group) + rank % 2
        groups += len(begin)
    return half
