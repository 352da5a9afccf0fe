# SPDX-License-Identifier: GPL-3.0-or-later
"""Where on a lamp shadow rays aim, and the vector algebra of blocks of three rows (x, y, z)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from ..arrays import Bools, Float32, Float64, Int32, Int64
from ..sampling import hash_bits, unit_interval

TINY = np.float32(1e-30)
"""Keeps 0 / 0 from arising; the numerator is then 0 as well."""

Rows: TypeAlias = Sequence[Float32] | Float32
"""Vectors as three rows x, y, z, each (B,) or one number for all points."""

EVEN = 0.9
"""Lattices are used if their points keep this share of the largest distance that any lattice's points keep."""

# Steps of (u, v) from a pixel to the next one along a row and along a column, found by a random search for the
# largest least distance among the shifts of any 3 x 3 and 5 x 5 pixels (0.314 and 0.164 on the unit torus).
_ALONG_ROW = (0.6475742773114672, 0.05948547863510767)
_ALONG_COLUMN = (0.9366698205525124, 0.6688415946371068)


def dot(a: Rows, b: Rows) -> Float32:
    """Dot products (B,)."""
    total: Float32 = a[0] * b[0]
    total = total + a[1] * b[1]
    total += a[2] * b[2]
    return total


def basis(axis: Float32) -> tuple[Float32, Float32]:
    """Two unit vectors (3, B) square to unit axes (3, B) (Duff et al. 2017, listing 3)."""
    x, y, z = axis
    sign = np.copysign(np.float32(1), z)
    a = -1 / (sign + z)
    b = x * y * a
    return np.stack([1 + sign * x * x * a, sign * b, -sign * x]), np.stack([b, sign + y * y * a, -y])


def across(axis: Rows, x: Float32, y: Float32) -> tuple[Float32, Float32, Float32]:
    """X and y (B,) along the two vectors that `basis` gives for unit axes (3, B): the sum's three rows."""
    nx, ny, nz = axis
    sign = np.copysign(np.float32(1), nz)
    along = sign * x
    along *= nx
    along += y * ny
    tilt = along / (sign + nz)
    sign *= y
    sign -= ny * tilt
    np.negative(along, out=along)
    first: Float32 = x - nx * tilt
    return first, sign, along


def on_disc(u: Float32, v: Float32) -> tuple[Float32, Float32]:
    """The unit square (B,) laid on the unit disc, areas kept: u outward, v around."""
    radius = np.sqrt(u)
    turn = v * np.float32(2 * math.pi)
    return np.cos(turn) * radius, np.sin(turn) * radius


def rows_of(points: Float32) -> Float32:
    """(P, 3) as three rows."""
    return np.ascontiguousarray(points.T)


def normals_of(shading: Float32, geometric: Float32 | None) -> list[Float32]:
    """Shading normals and, where they differ, geometric ones, as rows."""
    return [rows_of(shading)] if geometric is None else [rows_of(shading), rows_of(geometric)]


def bent_share(cosine: Float32, bend: Float32) -> Float32:
    """By how much less light (R,) counts than by Lambert's law where it counts by cos(bend t), t its angle."""
    angle = np.arccos(np.minimum(cosine, 1))
    angle *= bend
    share: Float32 = np.maximum(np.cos(angle), 0)
    share /= np.maximum(cosine, TINY)
    return share


def evenly_bent_share(bend: Float32) -> Float32:
    """The same (R,) of light that comes alike from everywhere: cos(bend t) 2 sin(t), integrated up to pi / (2 bend)."""
    wide = np.maximum(bend.astype(np.float64), 1 + 1e-6)
    share: Float32 = (2 * (wide * np.sin(np.pi / 2 / wide) - 1) / (wide**2 - 1)).astype(np.float32)
    return share


def cosine_above(way: Float32, normals: list[Float32], bend: Float32 | None = None) -> Float32:
    """Cosine (B,) between ways (3, B) and the first normals, of the `bend` (B,) angle; 0 below the horizon of any."""
    cosine = dot(way, normals[0])
    cosine /= np.sqrt(np.maximum(dot(way, way), TINY))
    np.maximum(cosine, 0, out=cosine)
    if bend is not None:
        cosine *= bent_share(cosine, bend)
    for normal in normals[1:]:
        cosine *= dot(way, normal) > 0
    return cosine


def outside(box: Float32, p: Float32) -> Bools:
    """Whether points (3, B) lie outside a box (2, 3)."""
    result = np.zeros(p.shape[1], bool)
    for k in range(3):
        result |= (p[k] < box[0, k]) | (p[k] > box[1, k])
    return result


@lru_cache(maxsize=64)
def generators(count: int) -> Float32:
    """(G,) float32, the g of rank-1 lattices (k / n, k g / n) whose points keep a large distance, the largest first."""
    k = np.arange(1, count)
    found = []
    for g in range(1, max(count, 2)):
        if math.gcd(g, count) == 1:
            steps = np.stack([k / count, (k * g % count) / count])
            steps -= np.round(steps)
            found.append((float(np.min((steps**2).sum(0), initial=1)), g))
    least = EVEN**2 * max(distance for distance, _ in found)
    chosen = sorted((-round(distance, 9), g) for distance, g in found if distance >= least)
    result = np.array([g for _, g in chosen], np.float32)
    result.flags.writeable = False
    return result


def lattice(count: int) -> Float32:
    """(count, 2) float32 points of the lattice whose points keep the largest distance.

    Every projection on u or v has `count` different values, so that straight shadow edges of any direction cut it
    evenly; any shift on the torus keeps that.
    """
    k = np.arange(count)
    return np.stack([k / count, k * int(generators(count)[0]) % count / count], axis=1).astype(np.float32)


def lattice_generators(ids: Int32 | Int64, count: int) -> Float32:
    """For each id one of the generators of lattices of `count` points, (R,) float32.

    Each lattice lies on a few lines, and errs where a shadow's edge runs along them; that neighbours differ makes noise
    of what would be stripes.
    """
    good = generators(count)
    chosen: Float32 = good[hash_bits(ids) % np.uint32(len(good))]
    return chosen


@lru_cache(maxsize=4)
def disc_nodes(rings: int, spokes: int) -> Float64:
    """Nodes (rings * spokes, 3) for a disc: Gauss-Legendre in u, the squared radius; even and staggered in v."""
    nodes, weights = np.polynomial.legendre.leggauss(rings)
    u, turn = np.repeat((nodes + 1) / 2, spokes), np.tile(np.arange(spokes), rings)
    v = (turn + np.repeat((np.arange(rings) * 0.618) % 1, spokes)) / spokes
    return np.column_stack([u, v, np.repeat(weights / 2 / spokes, spokes)])


@lru_cache(maxsize=4)
def gauss_nodes(count: int) -> Float64:
    """Gauss-Legendre nodes (count^2, 3) of the unit square: u, v and weight; halves of u and v are panels."""
    nodes, weights = np.polynomial.legendre.leggauss(count // 2)
    along = np.concatenate([(nodes + 1) / 4, (nodes + 3) / 4])
    shares = np.tile(weights, 2) / 4
    u, v = (grid.ravel() for grid in np.meshgrid(along, along))
    return np.column_stack([u, v, np.outer(shares, shares).ravel()])


def pixel_shifts(pixel: Int64, size: int) -> tuple[Float32, Float32]:
    """Shifts (R,) of the sample lattice at pixels (R,): those of neighbouring pixels fill the square evenly.

    What one texel misses its neighbours see, so a fit over a few texels has hardly any noise left.
    """
    x, y = pixel % size, pixel // size
    shifts = []
    for along, across in zip(_ALONG_ROW, _ALONG_COLUMN, strict=True):
        bits = x * int(along * 2**32) + y * int(across * 2**32)  # a fixed-point fraction wraps by itself
        shifts.append(unit_interval((bits & 0xFFFFFFFF).astype(np.uint32)))
    return shifts[0], shifts[1]


def shifted(value: np.float32 | Float32, shift: Float32) -> Float32:
    """(value + shift) modulo 1."""
    moved: Float32 = shift + value
    moved -= moved >= 1
    return moved
