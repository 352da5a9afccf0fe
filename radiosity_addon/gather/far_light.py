# SPDX-License-Identifier: GPL-3.0-or-later
"""What gather points receive from afar, without the noise of single points.

Light that comes from afar changes slowly along a surface, except where something near stands in its way; what is near
fills much of the view, so that few rays know it well. So irradiance is parted by the distance of what sends it (Arikan,
Forsyth and O'Brien 2005). The part from afar is the open share of the view times the mean light in it: the first is
each point's own, and keeps contact shadows sharp; the second is taken from all points around, farther than the
final fit looks. Nothing here depends on how strong a light is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float32
from ..chunks import Fractions, in_chunks, scaled
from ..geometry.texels import Texels
from .gather_points import GatherPoints
from .irradiance_fit import shares_at_points
from .neighbours import Neighbours

FAR = 4.0
"""Light is from afar from this many widths of the coarsest cells on."""

REACH = 2.2
"""A point takes part within this many widths of the cells around."""

LEAST = 0.02
"""Share of the view below which too few rays tell the light in it."""

POINTS = 1 << 12
"""Points smoothed in one go: their arrays, 0.3 MB each, stay in cache."""


@dataclass(frozen=True, eq=False)
class FarLight:
    """What P points receive from afar.

    Attributes:
        irradiance: (P, C) float32, W/m2
        openness: (P,) float32, share of the view, weighed by the cosine, in which nothing is near
    """

    irradiance: Float32
    openness: Float32


def smooth_far_light(
    irradiance: Float32,
    far: FarLight,
    texels: Texels,
    points: GatherPoints,
    neighbours: Neighbours,
    workers: int,
) -> Fractions[Float32]:
    """Irradiance (P, C), W/m2, of all light, its part from afar smoothed along the surface.

    The mean light of the open view is the ratio of two smoothed parts, irradiance and openness, by the same shares of
    the points around: what varies in both alike, for being hidden, leaves it. Where nearly all of the view is near, or
    a slope leads below nothing, a point keeps what it has.
    """
    shares = yield from scaled(shares_at_points(texels, points, neighbours, REACH, workers), 0, 0.7)
    smoothed = irradiance.copy()

    def work(start: int, stop: int) -> None:
        part = slice(start, stop)
        share, point = np.ascontiguousarray(shares[part].T), np.ascontiguousarray(neighbours.point[part].T)
        around = (share * far.openness.take(point)).sum(0)
        own = far.openness[part] / np.maximum(around, np.float32(LEAST))
        light = np.stack([(share * channel.take(point)).sum(0) for channel in channels], axis=1)
        found = irradiance[part] + (own[:, None] * light - far.irradiance[part])
        good = (around >= LEAST) & (found.min(1) >= np.minimum(irradiance[part].min(1), 0))
        smoothed[start + np.flatnonzero(good)] = found[good]

    channels = np.ascontiguousarray(far.irradiance.T)
    yield from scaled(in_chunks(work, points.count, POINTS, workers), 0.7, 1)
    return smoothed
