# SPDX-License-Identifier: GPL-3.0-or-later
"""What a single ray meets, such as one through a pixel that a user points at: all triangles at once, no tree."""

from __future__ import annotations

import numpy as np

from ..arrays import Float32, Float64

EDGE = 1e-6
"""Barycentric weight by which a point may lie beyond an edge: none shall fall between two triangles."""


def first_triangle(origin: Float64, direction: Float64, corners: Float32) -> tuple[int, float, float, float] | None:
    """The nearest triangle before a ray, of either side (after Moeller and Trumbore 1997).

    Args:
        origin, direction: (3,)
        corners: (F, 3, 3)

    Returns:
        the triangle, the distance in lengths of `direction`, the weights of its corners 1 and 2; None if there is none
    """
    start = corners[:, 0].astype(np.float64)
    b, c = corners[:, 1] - start, corners[:, 2] - start
    across = np.cross(direction, c)
    determinant = (b * across).sum(axis=1)
    inverse = 1 / np.where(determinant != 0, determinant, np.inf)
    beside = origin - start
    u = (beside * across).sum(axis=1) * inverse
    turned = np.cross(beside, b)
    v = turned @ direction * inverse
    distance = (c * turned).sum(axis=1) * inverse
    met = (determinant != 0) & (u >= -EDGE) & (v >= -EDGE) & (u + v <= 1 + EDGE) & (distance > 0)
    found = np.flatnonzero(met)
    if not len(found):
        return None
    nearest = int(found[np.argmin(distance[found])])
    return nearest, float(distance[nearest]), float(u[nearest]), float(v[nearest])


def bilinear(page: Float32, u: float, v: float) -> Float64:
    """The value (C,) of a page (H, W, C), row 0 at v = 0, at u and v in 0..1, as it lies between texel centres."""
    height, width = page.shape[:2]
    x, y = u * width - 0.5, v * height - 0.5
    left, below = int(np.floor(x)), int(np.floor(y))
    total: Float64 = np.zeros(page.shape[2])
    for row, along in ((below, 1 - (y - below)), (below + 1, y - below)):
        for column, share in ((left, 1 - (x - left)), (left + 1, x - left)):
            total += along * share * page[min(max(row, 0), height - 1), min(max(column, 0), width - 1)]
    return total
