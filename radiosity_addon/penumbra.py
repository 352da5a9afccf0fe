# SPDX-License-Identifier: GPL-3.0-or-later
"""Wide penumbrae made smooth: what neighbouring texels see of a lamp, fitted by a plane where it is one."""

from __future__ import annotations

import numpy as np

from .arrays import Bools, Float32, Float64, Int64
from .chunks import Fractions, in_chunks
from .lamp_samples import basis, dot, rows_of
from .texels import Texels

CHUNK = 1 << 14
"""Texels fitted in one go."""

REACH = 3
"""Texels to every side that a fit takes in, at most."""

TRUST = 1.2
"""A fit is taken while its mean squared residual is below this many times the variance of the shares."""

FLAT = 0.95
"""Least cosine between the normals of texels that are fitted together."""

THICK = 0.1
"""Neighbours stand no farther than this off the texel's plane, as a share of their distance."""

APART = 1.6
"""Neighbours on the page are neighbours in the world: no farther than so many texels for each texel of the page."""


def smooth_penumbrae(
    texels: Texels, partly: Int64, ratio: Float32, noise: Float32, lit: Bools, workers: int
) -> Fractions[list[None]]:
    """Replace the visible shares of partly lit texels by first-order fits over their neighbours, in world space.

    Each texel takes the largest window, 3 x 3 to 7 x 7, whose residual the samples' own noise explains; where the
    smallest does not fit, at a contact shadow, it keeps what it has.

    Args:
        partly: (N,) int64, texels to treat
        ratio: (T,) float32, visible shares, changed in place
        noise: (T,) float32, variances of `ratio`
        lit: (T,) bool, texels that the unshadowed lamp shines on
    """
    before = ratio.copy()

    def work(start: int, stop: int) -> None:
        ids = partly[start:stop]
        ratio[ids] = _fitted(texels, ids, before, noise, lit)

    return in_chunks(work, len(partly), CHUNK, workers)


def _fitted(texels: Texels, ids: Int64, ratio: Float32, noise: Float32, lit: Bools) -> Float32:
    position, normal = rows_of(texels.position[ids]), rows_of(texels.normal[ids])
    tangent, bitangent = basis(normal)
    pixel = texels.pixel[ids]
    row, column = (pixel // texels.size) % texels.size, pixel % texels.size
    own = ratio[ids]
    spacing = np.sqrt(texels.area[ids])
    result = own.copy()
    moments = np.zeros((10, len(ids)))
    variance = noise[ids].astype(np.float64)
    moments[0] = 1  # the texel itself; shares are taken relative to its own
    for reach in range(1, REACH + 1):
        for dy, dx in _ring(reach):
            there = (row + dy >= 0) & (row + dy < texels.size) & (column + dx >= 0) & (column + dx < texels.size)
            other = texels.texel_at[np.where(there, pixel + dy * texels.size + dx, 0)]
            other = np.where(there, other, -1)
            gap = rows_of(texels.position[other])
            gap -= position
            square = dot(gap, gap)
            off = dot(gap, normal)
            limit = APART**2 * (dx * dx + dy * dy)
            used = (other >= 0) & lit[other] & texels.valid[other]
            used &= dot(rows_of(texels.normal[other]), normal) > FLAT
            used &= off * off <= THICK**2 * square
            used &= square <= limit * np.maximum(spacing, np.sqrt(texels.area[other])) ** 2
            variance += np.where(used, noise[other], 0)
            _accumulate(moments, used, dot(gap, tangent), dot(gap, bitangent), ratio[other] - own)
        value, residual = _plane(moments)
        good = residual < TRUST * variance / moments[0]
        result[good] = np.clip(own + value, 0, 1)[good]
    return result


def _ring(reach: int) -> list[tuple[int, int]]:
    """Offsets (dy, dx) at the rim of a square window."""
    span = range(-reach, reach + 1)
    return [(dy, dx) for dy in span for dx in span if max(abs(dy), abs(dx)) == reach]


def _accumulate(moments: Float64, used: Bools, s: Float32, t: Float32, value: Float32) -> None:
    """Add neighbours (B,) at tangent coordinates s, t to the sums that a plane's fit needs."""
    s, t, value = (np.where(used, part, 0) for part in (s, t, value))
    for index, product in enumerate((used, s, t, s * s, s * t, t * t, value, value * s, value * t, value * value)):
        moments[index] += product


def _plane(moments: Float64) -> tuple[Float64, Float64]:
    """A plane's value at the origin and its mean squared residual per degree of freedom; infinite where undefined."""
    n, s, t, ss, st, tt, v, vs, vt, vv = moments
    a, b, c = ss - s * s / n, st - s * t / n, tt - t * t / n
    x, y = vs - s * v / n, vt - t * v / n
    determinant = a * c - b * b
    defined = (determinant > 1e-3 * a * c) & (n > 5)
    safe = np.where(defined, determinant, 1)
    along, across = (c * x - b * y) / safe, (a * y - b * x) / safe
    value = (v - along * s - across * t) / n
    left = vv - v * v / n - along * x - across * y
    residual = np.where(defined, left / np.maximum(n - 3, 1), np.inf)
    return value, residual
