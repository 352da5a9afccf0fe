# SPDX-License-Identifier: GPL-3.0-or-later
"""Arithmetic along a last axis that is short: the channels of a colour, the coordinates of a point.

NumPy starts a loop for each row there, which takes several times longer than adding whole columns.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Bools, Float32, Int32, Int64


def sums(values: Float32) -> Float32:
    """Sums (...) of values (..., C)."""
    total: Float32 = values[..., 0].copy()
    for column in range(1, values.shape[-1]):
        total += values[..., column]
    return total


def dots(one: Float32, other: Float32) -> Float32:
    """Dot products (...) of vectors (..., C)."""
    total: Float32 = one[..., 0] * other[..., 0]
    for column in range(1, one.shape[-1]):
        total += one[..., column] * other[..., column]
    return total


def some(values: NDArray[Any]) -> Bools:
    """Whether any (...) of values (..., C) is true, or not 0."""
    found: Bools = values[..., 0] != 0
    for column in range(1, values.shape[-1]):
        found |= values[..., column] != 0
    return found


def extremes(values: NDArray[Any]) -> NDArray[Any]:
    """Least and greatest (2, C) of the columns of values (R, C)."""
    return np.array([[extreme(column) for column in values.T] for extreme in (np.min, np.max)], values.dtype)


def vectors_at(vectors: Float32, which: Int64 | Int32) -> Float32:
    """Those (R, 3) of vectors (T, 3) at `which` (R,), in memory x, y and z apart: six times as fast as taking rows."""
    found = np.empty((3, len(which)), vectors.dtype)
    if not vectors.flags.c_contiguous:
        for k in range(3):
            np.take(vectors[:, k], which, out=found[k], mode="wrap")
        return found.T
    place = np.multiply(which, 3, dtype=np.int64)
    for row in found:
        np.take(vectors.reshape(-1), place, out=row, mode="wrap")
        place += 1
    return found.T
