# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps whose light is not alike in all directions, or does not fall off by the square of the distance.

Such a lamp's intensity is multiplied with two factors: one of the direction in which light leaves it, looked up in a
picture on an octahedron laid flat, and one of the distance that the light has come.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float32, Float64
from ..scene import Distribution
from .lamp_samples import TINY, Rows, across, dot

RIM = 6
"""Directions about a lamp's middle that are looked at to find out whether its light varies over it."""

EVEN = 0.05
"""Share of the brightest direction by which they may differ to count as even."""

LEAST_DISTANCE = np.float32(1e-6)
"""m; below that light has come nowhere."""


@dataclass(frozen=True, eq=False)
class Factors:
    """A distribution in one colour.

    Attributes:
        picture: (N + 2, N + 2) float32, factors on the flat octahedron, continued by one texel on each side
        axes: (3, 3) float32, rows: unit x, y, z
        reach: of the picture, as a Distribution has it
        falloff: (2, K) float64, logarithms of distances, m, and of the factors there; None: 1 everywhere
        on_sphere: as a Distribution has it
    """

    picture: Float32
    axes: Float32
    reach: float
    falloff: Float64 | None
    on_sphere: bool

    @classmethod
    def of(cls, distribution: Distribution) -> list[Factors]:
        """One for each colour."""
        falloff = None
        if distribution.falloff is not None:
            falloff = np.log(np.maximum(distribution.falloff.T, 1e-30))
        axes, reach = np.array(distribution.axes, np.float32), distribution.reach
        channels = np.moveaxis(distribution.directions, 2, 0)
        return [cls(_continued(own, reach), axes, reach, falloff, distribution.on_sphere) for own in channels]

    def along(self, away: Rows, distance: Float32) -> Float32:
        """Factor (B,) of light that comes along -away (3, B), from distances (B,), m."""
        factor = self._towards(away)
        if self.falloff is not None:
            factor = factor * self._fallen(distance, self.falloff)
        return factor

    def vary(self, away: Rows, radius: Float32) -> Bools:
        """Where the factor may differ much over a lamp of `radius` (B,), m, about the ends of ways (3, B)."""
        low = high = self._towards(away)
        length = np.sqrt(np.maximum(dot(away, away), TINY))
        axis = np.stack([row / length for row in away])
        for k in range(RIM):
            turn = 2 * math.pi * k / RIM
            beside = across(axis, radius * np.float32(math.cos(turn)), radius * np.float32(math.sin(turn)))
            found = self._towards([row + step for row, step in zip(away, beside, strict=True)])
            low, high = np.minimum(low, found), np.maximum(high, found)
        differ: Bools = high - low > np.float32(EVEN) * np.max(np.abs(self.picture))
        return differ

    def _towards(self, away: Rows) -> Float32:
        """Factor (B,) of the direction along -away (3, B), between texels by their distances."""
        x, y, z = (-dot(away, axis) for axis in self.axes)
        scale = 1 / np.maximum(np.abs(x) + np.abs(y) + np.abs(z), TINY)
        x *= scale
        y *= scale
        lower = np.flatnonzero(z < 0)
        if len(lower):
            one, other = x[lower], y[lower]
            x[lower] = np.copysign(1 - np.abs(other), one)
            y[lower] = np.copysign(1 - np.abs(one), other)
        width = len(self.picture)
        steps = np.float32((width - 2) / 2)
        first, shares = [], []
        for part in (x, y):
            part *= np.float32(1 / self.reach)
            part += 1
            part *= steps
            part += np.float32(0.5)  # texel centres lie at whole numbers
            np.clip(part, 0, np.float32(width - 1.001), out=part)
            whole = part.astype(np.int32)
            part -= whole
            first.append(whole)
            shares.append(part)
        place = first[1] * np.int32(width) + first[0]
        texels, (right, up) = self.picture.reshape(-1), shares
        below, above = (
            texels.take(place + row) * (1 - right) + texels.take(place + (row + 1)) * right for row in (0, width)
        )
        factor: Float32 = below + (above - below) * up
        return factor

    def _fallen(self, distance: Float32, falloff: Float64) -> Float32:
        """Factor (B,) at distances (B,), m."""
        distances, factors = falloff
        logarithm = np.log(np.maximum(distance, LEAST_DISTANCE))
        factor: Float32 = np.exp(np.interp(logarithm, distances, factors)).astype(np.float32)
        return factor


def flat_octahedron(directions: Float64) -> Float64:
    """Where directions (..., 3) lie on the unit octahedron laid flat, (..., 2) from -1 to 1 (Cigolla et al. 2014)."""
    x, y, z = np.moveaxis(directions / np.abs(directions).sum(-1, keepdims=True), -1, 0)
    lower = z < 0
    folded = np.where(lower, np.copysign(1 - np.abs(y), x), x), np.where(lower, np.copysign(1 - np.abs(x), y), y)
    return np.stack(folded, axis=-1)


def on_octahedron(flat: Float64) -> Float64:
    """Points (..., 3) of the unit octahedron at places (..., 2) from -1 to 1 on it, laid flat."""
    x, y = np.moveaxis(flat, -1, 0)
    z = 1 - np.abs(x) - np.abs(y)
    lower = z < 0
    folded = np.where(lower, np.copysign(1 - np.abs(y), x), x), np.where(lower, np.copysign(1 - np.abs(x), y), y)
    return np.stack([*folded, z], axis=-1)


def _continued(picture: Float32, reach: float) -> Float32:
    """A picture (N, N) with one texel more on each side: the octahedron's edges meet themselves, turned about."""
    if reach < 1:
        return np.pad(picture, 1, "edge")
    wide = np.pad(picture, 1)
    wide[0, 1:-1], wide[-1, 1:-1] = picture[0, ::-1], picture[-1, ::-1]
    wide[1:-1, 0], wide[1:-1, -1] = picture[::-1, 0], picture[::-1, -1]
    wide[0, 0], wide[0, -1], wide[-1, 0], wide[-1, -1] = (
        picture[row, column] for row, column in ((-1, -1), (-1, 0), (0, -1), (0, 0))
    )
    return wide
