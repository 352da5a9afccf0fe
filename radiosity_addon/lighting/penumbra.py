# SPDX-License-Identifier: GPL-3.0-or-later
"""Penumbrae traced and, where wide, made smooth: what texels around see of a lamp, fitted by a plane if it is one."""

from __future__ import annotations

import numpy as np

from ..arrays import Bools, Float32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..geometry.texels import STRATA, Texels
from ..geometry.visibility import Visibility
from .lamp_samples import basis, dot, rows_of
from .lamps import Lamp
from .shadows import trace_partly

CHUNK = 1 << 14
"""Texels fitted in one go."""

REACH = 2
"""Texels to every side that a fit takes in, at most."""

TRUST = 1.2
"""A fit is taken while its mean squared residual is below this many times the variance of the shares."""

FLAT = 0.95
"""Least cosine between the normals of texels that are fitted together."""

THICK = 0.1
"""Neighbours stand no farther than this off the texel's plane, as a share of their distance."""

APART = 1.6
"""Neighbours on the page are neighbours in the world: no farther than so many texels for each texel of the page."""

NO_SHARE = np.float32(-1)
"""Stands for the share of a texel that takes part in no fit."""


def trace_shares(
    lamp: Lamp,
    texels: Texels,
    partly: Int64,
    lit: Bools,
    share: Float32,
    weak: Bools | None,
    visibility: Visibility,
    rays: int,
    workers: int,
) -> Fractions[None]:
    """Find the share (C, T) of a lamp's light that arrives at partly lit texels, in place.

    Args:
        partly: (N,) int64, texels to treat
        lit: (T,) bool, texels that the unshadowed lamp shines on
        weak: (T,) bool, texels where one ray from each stratum does; None: nowhere
        rays: of the others
    """
    noise = np.zeros_like(share)
    parts = [(partly, rays)]
    if weak is not None:
        few = weak[partly]
        parts = [(partly[few], STRATA), (partly[~few], rays)]
    found = []
    for part, count in parts:
        tracing = trace_partly(lamp, texels, part, lit, share, noise, visibility, count, workers)
        found.append((yield from scaled(tracing, 0, 0.8)))
    if lamp.extended:
        penumbra = np.concatenate(found)
        for channel, (shares, variances) in enumerate(zip(share, noise, strict=True)):
            steps = smooth_penumbrae(texels, penumbra, shares, variances, lit, workers)
            low, high = (0.8 + 0.2 * each / len(share) for each in (channel, channel + 1))
            yield from scaled(steps, low, high)


def smooth_penumbrae(
    texels: Texels, partly: Int64, ratio: Float32, noise: Float32, lit: Bools, workers: int
) -> Fractions[list[None]]:
    """Replace the visible shares of partly lit texels by first-order fits over their neighbours, in world space.

    Windows grow from 3 x 3 to 5 x 5 as long as the samples' own noise explains a fit's residual; where the smallest
    does not fit, at a contact shadow, a texel keeps what it has.

    Args:
        partly: (N,) int64, texels to treat
        ratio: (T,) float32, visible shares, changed in place
        noise: (T,) float32, variances of `ratio`
        lit: (T,) bool, texels that the unshadowed lamp shines on
    """
    shares = np.where(lit & texels.valid, ratio, NO_SHARE)

    def work(start: int, stop: int) -> None:
        ids = partly[start:stop]
        ratio[ids] = _fitted(texels, ids, shares, noise)

    return in_chunks(work, len(partly), CHUNK, workers)


def _fitted(texels: Texels, ids: Int64, shares: Float32, noise: Float32) -> Float32:
    position, normal = rows_of(texels.position.take(ids, axis=0)), rows_of(texels.normal.take(ids))
    pixel = texels.pixel[ids]
    own = shares[ids]
    area = texels.area[ids]
    result = own.copy()
    moments = np.zeros((10, len(ids)), np.float32)
    variance = noise[ids]
    moments[0] = 1  # the texel itself; shares are taken relative to its own
    left = np.arange(len(ids))
    for reach in range(1, REACH + 1):
        frame = *basis(normal), normal
        row, column = (pixel // texels.size) % texels.size, pixel % texels.size
        inner = (row >= reach) & (row < texels.size - reach) & (column >= reach) & (column < texels.size - reach)
        for dy, dx in _ring(reach):
            other = texels.texel_at.take(pixel + (dy * texels.size + dx), mode="clip")
            share = shares.take(other)
            used = (share >= 0) & (other >= 0)
            if not inner.all():
                used &= (row + dy >= 0) & (row + dy < texels.size) & (column + dx >= 0) & (column + dx < texels.size)
            gap = rows_of(texels.position.take(other, axis=0))
            gap -= position
            s, t, off = (dot(gap, axis) for axis in frame)
            off *= off
            square = s * s
            square += t * t
            used &= off <= np.float32(THICK**2) * square
            square += off
            used &= square <= np.float32(APART**2 * (dx * dx + dy * dy)) * np.maximum(texels.area.take(other), area)
            used &= dot(rows_of(texels.normal.take(other)), normal) > np.float32(FLAT)
            share -= own
            weight = used.astype(np.float32)
            variance += noise.take(other) * weight
            _accumulate(moments, weight, s, t, share)
        value, residual = _plane(moments)
        good = np.flatnonzero(residual < np.float32(TRUST) * variance / moments[0])
        result[left[good]] = np.clip(own + value, 0, 1)[good]
        left, pixel = left[good], pixel[good]
        own, area, variance = own[good], area[good], variance[good]
        position, normal, moments = position[:, good], normal[:, good], moments[:, good]
    return result


def _ring(reach: int) -> list[tuple[int, int]]:
    """Offsets (dy, dx) at the rim of a square window."""
    span = range(-reach, reach + 1)
    return [(dy, dx) for dy in span for dx in span if max(abs(dy), abs(dx)) == reach]


def _accumulate(moments: Float32, weight: Float32, s: Float32, t: Float32, value: Float32) -> None:
    """Add neighbours (B,) of weight 0 or 1 at tangent coordinates s, t to the sums that a plane's fit needs."""
    moments[0] += weight
    s, t, value = (np.where(weight > 0, part, 0) for part in (s, t, value))
    for index, part in ((1, s), (2, t), (6, value)):
        moments[index] += part
    for index, one, two in ((3, s, s), (4, s, t), (5, t, t), (7, value, s), (8, value, t), (9, value, value)):
        moments[index] += one * two


def _plane(moments: Float32) -> tuple[Float32, Float32]:
    """A plane's value at the origin and its mean squared residual per degree of freedom; infinite where undefined."""
    n, s, t, ss, st, tt, v, vs, vt, vv = moments
    a, b, c = ss - s * s / n, st - s * t / n, tt - t * t / n
    x, y = vs - s * v / n, vt - t * v / n
    determinant = a * c - b * b
    defined = (determinant > 1e-3 * a * c) & (n > 5)
    safe = np.where(defined, determinant, 1)
    along, across = (c * x - b * y) / safe, (a * y - b * x) / safe
    value: Float32 = (v - along * s - across * t) / n
    left = vv - v * v / n - along * x - across * y
    residual: Float32 = np.where(defined, left / np.maximum(n - 3, 1), np.inf)
    return value, residual
