# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes over uv maps that the modeller made."""

from __future__ import annotations

import numpy as np

from ..arrays import Bools, Float64, Int64
from ..errors import SceneError
from ..scene import Mesh
from .islands import uv_charts
from .overlap import overlapping

OUTSIDE = 1e-5
"""How far uv may leave 0..1: rounding of what was snapped to the border."""

TOUCHING = 1e-5
"""Share of the map by which triangles may lie on one another: rounding of what was packed without a gap."""


class UvMapError(SceneError):
    """A uv map can't be kept.

    Attributes:
        polygons: (K,) int64, polygons of the mesh to be selected for the user
    """

    def __init__(self, subject: str, cause: str, remedy: str, polygons: Int64) -> None:
        super().__init__(subject, cause, remedy)
        self.polygons = polygons


def kept_uv(mesh: Mesh, area: Float64, solid: Bools) -> tuple[Float64, Int64]:
    """The map of `mesh` scaled as a whole to metres, and its charts.

    Args:
        area: (F,) float64, m2
        solid: (F,) bool, triangles that aren't degenerate

    Returns:
        (F, 3, 2) float64, m, and (F,) int64

    Raises:
        UvMapError: uv outside of 0..1, triangles on one another or without area in the map
    """
    assert mesh.uv is not None
    uv = mesh.uv.astype(np.float64)
    outside = ~((uv >= -OUTSIDE) & (uv <= 1 + OUTSIDE)).all(axis=(1, 2))
    if outside.any():
        raise _refused(mesh, "leaves the square from 0 to 1", np.flatnonzero(outside))
    uv = np.clip(uv, 0, 1)
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    flat = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    share = np.where(solid, area / area.sum(), 0)
    collapsed = solid & ~(flat > 1e-6 * share * flat.sum())
    if collapsed.any():
        raise _refused(mesh, "gives faces no area", np.flatnonzero(collapsed))
    chosen = np.flatnonzero(solid)
    pairs = overlapping(uv[chosen], np.zeros(len(chosen), np.int64), TOUCHING)
    if len(pairs):
        raise _refused(mesh, "has faces that lie on one another", chosen[np.unique(pairs)])
    return uv * np.sqrt(area[solid].sum() / flat[solid].sum()), uv_charts(mesh.triangles, uv)[0]


def _refused(mesh: Mesh, what: str, triangles: Int64) -> UvMapError:
    polygons = np.unique(mesh.polygon[triangles]).astype(np.int64)
    cause = f"its uv map {what} ({len(polygons)} faces)"
    return UvMapError(mesh.name, cause, "Repair the map, or let the object be unwrapped anew", polygons)
