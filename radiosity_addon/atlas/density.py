# SPDX-License-Identifier: GPL-3.0-or-later
"""How densely a uv map lays texels on a surface."""

from __future__ import annotations

import numpy as np

from ..arrays import Float32, Float64, Floats

LEAST_UV_AREA = 1e-12
"""Of a triangle, per m2: below it a uv map gives the triangle no texels."""


def surface_per_uv(corners: Floats, uv: Floats) -> Float32:
    """Area vectors of triangles divided by their areas in the uv map.

    A matrix M moves them by its cofactors, as it moves all area vectors, so that they are found once for a mesh however
    its objects are scaled.

    Args:
        corners: (F, 3, 3), m
        uv: (F, 3, 2)

    Returns:
        (F, 3) float32, m2 for the whole uv square, along the normal
    """
    area = _area_vectors(corners)
    s, t = ((uv[:, k].astype(np.float64) - uv[:, 0]).T for k in (1, 2))
    flat = np.abs(s[0] * t[1] - s[1] * t[0])
    least = LEAST_UV_AREA * np.sqrt((area**2).sum(axis=0))
    ratio: Float32 = (area / np.maximum(np.maximum(flat, least), 1e-300)).T.astype(np.float32)
    return ratio


def _area_vectors(corners: Floats) -> Float64:
    """Of triangles (F, 3, 3), twice as long as their areas, (3, F); on planes, as np.cross is slow on rows of three."""
    b, c = ((corners[:, k].astype(np.float64) - corners[:, 0]).T for k in (1, 2))
    return np.stack([b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]])


def cofactors(matrix: Float64) -> Float64:
    """What area vectors are moved by, (..., 3, 3), where positions are moved by matrices (..., 3, 3)."""
    x, y, z = (matrix[..., k] for k in range(3))
    return np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=-1)


def texels_per_metre(ratio: Float32, matrix: Float64, texels: float) -> Float32:
    """Density (F,) of triangles, texels/m.

    Args:
        ratio: (F, 3), as of `surface_per_uv`
        matrix: (3, 3), from the mesh to the world
        texels: along an edge of the uv square
    """
    squared = ((cofactors(matrix) @ ratio.T.astype(np.float64)) ** 2).sum(axis=0)
    density: Float32 = (texels / np.sqrt(np.sqrt(np.maximum(squared, 1e-60)))).astype(np.float32)
    return density


def world_areas(corners: Float32, matrix: Float64) -> Float64:
    """Area (F,) of triangles (F, 3, 3) moved by `matrix` (3, 3), m2."""
    area: Float64 = np.sqrt(((cofactors(matrix) @ _area_vectors(corners)) ** 2).sum(axis=0)) / 2
    return area


def quantiles(values: Floats, weights: Floats, shares: tuple[float, ...]) -> tuple[float, ...]:
    """The values (N,) below which these shares of the weights (N,) lie; 0 where there is no weight."""
    order = np.argsort(values, kind="stable")
    below = np.cumsum(np.asarray(weights, np.float64)[order])
    if not len(below) or below[-1] <= 0:
        return (0.0,) * len(shares)
    at = np.minimum(np.searchsorted(below, np.array(shares) * below[-1]), len(below) - 1)
    return tuple(float(value) for value in values[order][at])
