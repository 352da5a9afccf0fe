# SPDX-License-Identifier: GPL-3.0-or-later
"""Where samples go: hashes, a low-discrepancy sequence, and directions by the Nusselt analog.

Every sample is a function of the ids it belongs to, so a bake depends on no generator's state and on no
order of work. All is float32 and in few passes: making a ray has to cost less than tracing it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .arrays import Float32, Int32, Int64

Bits: TypeAlias = NDArray[np.uint32]

SEQUENCE_BITS = 16
"""The low-discrepancy sequence is tabulated to 2^16 samples: the table stays in cache, and no point needs more."""

BLOCK = 16384
"""Directions are made in blocks of so many, whose temporaries (about 1 MB) stay in the second-level cache."""

# Degree, inner coefficients and first direction numbers of the primitive polynomials of dimensions 1 to 5.
_PRIMITIVE_POLYNOMIALS = ((1, 0, (1,)), (2, 1, (1, 3)), (3, 1, (1, 3, 1)), (3, 2, (1, 1, 1)), (4, 1, (1, 1, 3, 3)))

DIMENSIONS = 1 + len(_PRIMITIVE_POLYNOMIALS)
"""Dimensions of the low-discrepancy sequence; the pairs (0, 1) and (2, 3) are the most even."""


def hash_bits(ids: Int32 | Int64, dimension: int = 0) -> Bits:
    """32 well-mixed bits of each id, (R,) uint32.

    Two rounds of multiply and xor-shift with the constants of the hash "lowbias32" (Wellons 2018, "Prospecting for
    Hash Functions"), whose avalanche bias is below 0.2 %. Each `dimension` gives an independent hash of the same ids.
    """
    bits = np.asarray(ids).astype(np.uint32)
    bits ^= np.uint32((dimension * 0x9E3779B9 + 0x3C6EF372) & 0xFFFFFFFF)
    shifted = bits >> np.uint32(16)
    bits ^= shifted
    bits *= np.uint32(0x7FEB352D)
    np.right_shift(bits, np.uint32(15), out=shifted)
    bits ^= shifted
    bits *= np.uint32(0x846CA68B)
    np.right_shift(bits, np.uint32(16), out=shifted)
    bits ^= shifted
    return bits


def unit_interval(bits: Bits) -> Float32:
    """The upper 24 bits as float32 in [0, 1): all that float32 holds, so that 1 is never reached."""
    scaled: Float32 = (bits >> np.uint32(8)).astype(np.float32)
    scaled *= np.float32(2.0**-24)
    return scaled


def hash_uniform(ids: Int32 | Int64, dimension: int = 0) -> Float32:
    """Uniform numbers (R,) float32 in [0, 1), one for each id, independent for each `dimension`."""
    return unit_interval(hash_bits(ids, dimension))


def even_uniform(ids: Int32 | Int64, sample: Int32 | Int64, dimension: int) -> Float32:
    """Uniform numbers (R,) float32 in [0, 1) that fill the unit cube evenly over the samples 0, 1, 2 ... of one id.

    Sobol's sequence (Sobol 1967; direction numbers of Joe and Kuo 2008), scrambled for each id by an exclusive or
    with its hash (Kollig and Keller 2002), which keeps its stratification: any 2^k samples from 0 have one value in
    each interval of length 2^-k.

    Args:
        ids: (R,) what the samples belong to (a patch, a texel)
        sample: (R,) number of the sample among those of its id, below 2^16
        dimension: 0 to 5; use (0, 1) and (2, 3) for pairs
    """
    bits = _sobol(dimension)[sample]
    bits ^= hash_bits(ids, dimension)
    return unit_interval(bits)


def even_rows(ids: Int32 | Int64, samples: int, dimension: int, first: Int64 | None = None) -> Float32:
    """`even_uniform` of so many samples of each id (Q,): (Q, samples), each id hashed once.

    Args:
        first: (Q,), of the samples; None: 0
    """
    table = _sobol(dimension)
    bits = table[:samples] if first is None else table[first[:, None] + np.arange(samples)]
    return unit_interval(bits ^ hash_bits(ids, dimension)[:, None])


@lru_cache(maxsize=DIMENSIONS)
def _sobol(dimension: int) -> Bits:
    """Sobol's sequence (2^16,) as 32-bit fractions, built by doubling: the sample n + 2^k is the sample n xor v_k."""
    if dimension == 0:
        numbers = [1 << (31 - k) for k in range(SEQUENCE_BITS)]
    else:
        degree, inner, first = _PRIMITIVE_POLYNOMIALS[dimension - 1]
        numbers = [m << (31 - k) for k, m in enumerate(first)]
        for k in range(degree, SEQUENCE_BITS):
            number = numbers[k - degree] ^ (numbers[k - degree] >> degree)
            for tap in range(1, degree):
                if inner >> (degree - 1 - tap) & 1:
                    number ^= numbers[k - tap]
            numbers.append(number)
    table = np.zeros(1, np.uint32)
    for number in numbers:
        table = np.concatenate([table, table ^ np.uint32(number)])
    table.flags.writeable = False
    return table


def cosine_directions(normals: Float32, u: Float32, v: Float32) -> Float32:
    """Unit directions (R, 3) or (R, S, 3) float32 about `normals` (R, 3), with density cos / pi.

    The Nusselt analog read backwards: points uniform on the unit disc, lifted to the hemisphere (Malley 1988). The
    basis about the normal has no branches (Duff et al. 2017, "Building an Orthonormal Basis, Revisited", listing 3).

    Args:
        normals: (R, 3) float32, unit
        u, v: (R,) or, for S directions about each normal, (R, S) float32 in [0, 1); u goes outward on the disc, v
            around it
    """
    directions: Float32 = np.empty((*u.shape, 3), np.float32)
    step = max(1, BLOCK * len(u) // max(u.size, 1))
    for start in range(0, len(u), step):
        part = slice(start, start + step)
        _fill_cosine_directions(normals[part], u[part], v[part], directions[part])
    return directions


def _fill_cosine_directions(normals: Float32, u: Float32, v: Float32, directions: Float32) -> None:
    nx, ny, nz = np.ascontiguousarray(normals.T).reshape(3, -1, *(1,) * (u.ndim - 1))
    radius = np.sqrt(u)
    turn = v * np.float32(2 * np.pi)
    x, y = np.cos(turn), np.sin(turn)
    x *= radius
    y *= radius
    z = np.sqrt(1 - u, out=turn)
    sign = np.copysign(np.float32(1), nz)
    # With a = -1 / (sign + nz) and w = a (sign x nx + y ny), the lifted point is
    # x (1 + sign a nx nx, sign a nx ny, -sign nx) + y (a nx ny, sign + a ny ny, -ny) + z n.
    along = sign * x
    along *= nx
    across = y * ny
    along += across
    w = np.divide(along, sign + nz, out=radius)
    np.subtract(z, w, out=w)
    np.multiply(nx, w, out=across)
    np.add(across, x, out=directions[..., 0])
    np.multiply(ny, w, out=across)
    y *= sign
    np.add(across, y, out=directions[..., 1])
    z *= nz
    np.subtract(z, along, out=directions[..., 2])
