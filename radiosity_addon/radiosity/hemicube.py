# SPDX-License-Identifier: GPL-3.0-or-later
"""The hemicube: directions through the cells of half a cube over a patch, and the exact form factor of each cell.

As in Cohen and Greenberg (1985), "The Hemi-Cube", but cells are traced as rays, and their weights are differences of a
corner's integral, not the integrand at the cell's middle: so they add up to 1 at any resolution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..arrays import Float32, Float64


@dataclass(frozen=True, eq=False)
class Hemicube:
    """C = 3 n^2 cells of a hemicube of resolution n: n x n above, n x n / 2 on each side.

    Attributes:
        directions: (C, 3) float32, unit, through the middles of the cells; z is the patch's normal
        weights: (C,) float64, form factors of the cells, which add up to 1
    """

    directions: Float32
    weights: Float64


@lru_cache(maxsize=16)
def hemicube(resolution: int) -> Hemicube:
    """The hemicube of a resolution, an even number of cells along its edge."""
    if resolution < 2 or resolution % 2:
        raise ValueError("a hemicube's resolution is an even number")
    across = np.linspace(-1, 1, resolution + 1)
    up = across[resolution // 2 :]
    middle, height = (across[1:] + across[:-1]) / 2, (up[1:] + up[:-1]) / 2
    x, y = (part.ravel() for part in np.meshgrid(middle, middle, indexing="ij"))
    directions = [np.stack([x, y, np.ones_like(x)], axis=1)]
    weights = [_differences(_above(across[:, None], across[None])).ravel()]
    along, z = (part.ravel() for part in np.meshgrid(middle, height, indexing="ij"))
    beside = _differences(_beside(across[:, None], up[None])).ravel()
    one = np.ones_like(along)
    for sides in ((one, along, z), (-one, along, z), (along, one, z), (along, -one, z)):
        directions.append(np.stack(sides, axis=1))
        weights.append(beside)
    joined = np.concatenate(directions)
    joined /= np.linalg.norm(joined, axis=1, keepdims=True)
    return Hemicube(joined.astype(np.float32), np.concatenate(weights))


def resolution_for(rays: int) -> int:
    """The resolution whose cells are nearest to `rays` in number."""
    return max(2, 2 * round(math.sqrt(rays / 12)))


def _above(x: Float64, y: Float64) -> Float64:
    """Form factor of the rectangle from (0, 0, 1) to (x, y, 1), signed, over a point that faces it."""
    a, b = np.sqrt(1 + x * x), np.sqrt(1 + y * y)
    total: Float64 = (x / a * np.arctan(y / a) + y / b * np.arctan(x / b)) / (2 * np.pi)
    return total


def _beside(y: Float64, z: Float64) -> Float64:
    """Form factor of the rectangle from (1, 0, 0) to (1, y, z), signed, for a point whose normal is z."""
    a = np.sqrt(1 + z * z)
    total: Float64 = (np.arctan(y) - np.arctan(y / a) / a) / (2 * np.pi)
    return total


def _differences(corners: Float64) -> Float64:
    return np.diff(np.diff(corners, axis=0), axis=1)
