# SPDX-License-Identifier: GPL-3.0-or-later
"""Penumbrae traced and, where wide, made smooth: what texels around see of a lamp, fitted by a plane if it is one."""

from __future__ import annotations

import numpy as np

from ..arrays import Bools, Float32, Int32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..columns import vectors_at
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
        yield from scaled(smooth_penumbrae(texels, penumbra, share, noise, lit, workers), 0.8, 1)


def smooth_penumbrae(
    texels: Texels, partly: Int64, ratio: Float32, noise: Float32, lit: Bools, workers: int
) -> Fractions[list[None]]:
    """Replace the visible shares of partly lit texels by first-order fits over their neighbours, in world space.

    Windows grow from 3 x 3 to 5 x 5 as long as the samples' own noise explains a fit's residual; where the smallest
    does not fit, at a contact shadow, a texel keeps what it has.

    Args:
        partly: (N,) int64, texels to treat
        ratio: (C, T) float32, visible shares, changed in place
        noise: (C, T) float32, variances of `ratio`
        lit: (T,) bool, texels that the unshadowed lamp shines on
    """
    shares = np.where(lit & texels.valid, ratio, NO_SHARE)

    def work(start: int, stop: int) -> None:
        ids = partly[start:stop]
        ratio[:, ids] = _fitted(texels, ids, shares, noise)

    return in_chunks(work, len(partly), CHUNK, workers)


def _fitted(texels: Texels, ids: Int64, shares: Float32, noise: Float32) -> Float32:
    """Shares (C, B) at texels (B,), fitted where shares (C, T) around them lie on a plane."""
    position, triangle = vectors_at(texels.position, ids).T, texels.triangle[ids]
    normal = rows_of(texels.surfaces.normals(triangle))
    pixel, area = texels.pixel[ids], texels.area[ids]
    own, variance = shares.take(ids, axis=1), noise.take(ids, axis=1)
    result = own.copy()
    geometry = np.zeros((6, len(ids)), np.float32)
    geometry[0] = 1  # the texel itself; shares are taken relative to its own
    values = np.zeros((4, *own.shape), np.float32)
    fits = np.ones(own.shape, bool)
    left = np.arange(len(ids))
    for reach in range(1, REACH + 1):
        frame = *basis(normal), normal
        row, column = (pixel // texels.size) % texels.size, pixel % texels.size
        inner = (row >= reach) & (row < texels.size - reach) & (column >= reach) & (column < texels.size - reach)
        for dy, dx in _ring(reach):
            other = texels.texel_at.take(pixel + (dy * texels.size + dx), mode="clip")
            share = shares.take(other, axis=1)
            used = (share[0] >= 0) & (other >= 0)
            if not inner.all():
                used &= (row + dy >= 0) & (row + dy < texels.size) & (column + dx >= 0) & (column + dx < texels.size)
            gap = vectors_at(texels.position, other).T
            gap -= position
            s, t, off = (dot(gap, axis) for axis in frame)
            off *= off
            square = s * s
            square += t * t
            used &= off <= np.float32(THICK**2) * square
            square += off
            used &= square <= np.float32(APART**2 * (dx * dx + dy * dy)) * np.maximum(texels.area.take(other), area)
            _keep_alike(used, texels, other, triangle)
            weight = used.astype(np.float32)
            s *= weight
            t *= weight
            for total, part in zip(geometry, (weight, s, t, s * s, s * t, t * t), strict=True):
                total += part
            for k, each in enumerate(share):
                variance[k] += noise[k].take(other) * weight
                each -= own[k]
                each *= weight
                for total, factor in zip(values[:, k], (weight, s, t, each), strict=True):
                    total += each * factor
        value, residual = _plane(geometry, values)
        fits &= residual < np.float32(TRUST) * variance / geometry[0]
        for k, good in enumerate(fits):
            result[k, left[good]] = np.clip(own[k] + value[k], 0, 1)[good]
        on = np.flatnonzero(fits.any(0))
        left, pixel, triangle, area = left[on], pixel[on], triangle[on], area[on]
        position, normal, geometry = (rows.take(on, axis=1) for rows in (position, normal, geometry))
        own, variance, fits, values = (rows.take(on, axis=-1) for rows in (own, variance, fits, values))
    return result


def _keep_alike(used: Bools, texels: Texels, other: Int32, triangle: Int32) -> None:
    """Of texels `other` (B,) that are `used` keep those, in place, that face as triangles (B,) do."""
    there = texels.triangle[other]
    asked = np.flatnonzero(used & (there != triangle))
    if len(asked):
        normals = (rows_of(texels.surfaces.normals(each[asked])) for each in (there, triangle))
        used[asked] = dot(*normals) > np.float32(FLAT)


def _ring(reach: int) -> list[tuple[int, int]]:
    """Offsets (dy, dx) at the rim of a square window."""
    span = range(-reach, reach + 1)
    return [(dy, dx) for dy in span for dx in span if max(abs(dy), abs(dx)) == reach]


def _plane(geometry: Float32, values: Float32) -> tuple[Float32, Float32]:
    """Planes' values (C, B) at the origin, and mean squared residuals per degree of freedom, infinite if undefined.

    Args:
        geometry: (6, B) of places s, t with weights 0 or 1 the number and the sums of s, t, s s, s t, t t
        values: (4, C, B) of values there the sums, plain, times s, times t and squared
    """
    n, s, t, ss, st, tt = geometry
    v, vs, vt, vv = values
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
