# SPDX-License-Identifier: GPL-3.0-or-later
"""Points of smooth-shaded surfaces, measured where Cycles knows how round the surface is.

Where light grazes a smooth surface, Cycles starts shadow rays on the rounder surface that the normals of the triangle's
corners tell of. A small triangle has next to no roundness of its own: at it, light would arrive as on a flat facet,
which is not what the surface shows. So such a point is measured on a copy of the whole triangle that it lies on, laid
on an image one pixel wide so that one pixel is the point, a few millimetres wide. What else of the triangle the image
would hold, above and below that pixel, is covered by black ones, which Cycles is done with at once. Copies have the
offset that objects come with, 0.1, as all objects of the sample scenes do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

BENT = 1e-4
"""Corner normals that stray farther from the triangle's own make it a round one."""
FAR = 1e4
"""Pixels to the side where the third corner of a covering triangle lies: far enough to cover whole rows."""
MOST_ROWS = 192
"""Rows of the image for a point, at most: so large a triangle is round at no size that texels have."""


@dataclass(frozen=True)
class Hosts:
    """The triangles that N points lie on.

    Attributes:
        corners: (N, 3, 3), m
        normals: (N, 3, 3) unit shading normals at the corners
    """

    corners: np.ndarray
    normals: np.ndarray

    @property
    def longest(self) -> np.ndarray:
        """(N, 3) the longest edges, m"""
        edges = np.roll(self.corners, -1, axis=1) - self.corners
        return edges[np.arange(len(edges)), np.linalg.norm(edges, axis=2).argmax(axis=1)]

    def round(self, edge: float) -> np.ndarray:
        """(N,) bool: those to copy where pieces of `edge` metres stand for points."""
        bent = (np.abs(self.normals - flat_normals(self.corners)[:, None]) > BENT).any(axis=(1, 2))
        found: np.ndarray = bent & (heights(self) < MOST_ROWS * edge)
        return found

    def only(self, chosen: np.ndarray) -> Hosts:
        """Those at `chosen`, (N,) bool or indices."""
        return Hosts(self.corners[chosen], self.normals[chosen])


@dataclass(frozen=True)
class Strip:
    """Triangles laid one above the other on an image one pixel wide.

    Attributes:
        uv: (N, 3, 2), v in 0..1; where u is outside 0..1, the image ends
        covers: (2 N, 3, 2) of triangles over all rows but those that show points
        row: (N,) that shows the point
        height: rows of the image
    """

    uv: np.ndarray
    covers: np.ndarray
    row: np.ndarray
    height: int


def flat_normals(corners: np.ndarray) -> np.ndarray:
    """(N, 3) unit normals of triangles (N, 3, 3), anticlockwise about the front."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    unit: np.ndarray = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    return unit


def heights(hosts: Hosts) -> np.ndarray:
    """(N,) of triangles over their longest edges, m."""
    edges = hosts.corners[:, 1:] - hosts.corners[:, :1]
    twice = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    found: np.ndarray = twice / np.linalg.norm(hosts.longest, axis=1)
    return found


def strip(hosts: Hosts, position: np.ndarray, edge: float) -> Strip:
    """Lay out triangles so that a pixel in each is centred on a position (N, 3) and `edge` metres wide."""
    corners = hosts.corners - position[:, None]
    along = hosts.longest / np.linalg.norm(hosts.longest, axis=1, keepdims=True)
    up = np.cross(flat_normals(hosts.corners), along)
    flat = np.stack([np.einsum("ncx,nx->nc", corners, axis) for axis in (along, up)], axis=2) / edge
    below = np.ceil(-flat[:, :, 1].min(axis=1) + 0.5).astype(int)
    above = np.ceil(flat[:, :, 1].max(axis=1) + 0.5).astype(int)
    last = np.cumsum(below + above + 1)
    row = last - above - 1
    height = int(last[-1])
    bottom = np.concatenate([row - below, row + 1])
    top = np.concatenate([row, last])
    covers = np.stack(
        [np.stack([np.full(len(at), x), at], axis=1) for x, at in ((-1, bottom), (FAR, bottom), (-1, top))], axis=1
    )
    uv = flat + np.stack([np.full(len(row), 0.5), row + 0.5], axis=1)[:, None]
    return Strip(uv / [1, height], covers / [1, height], row, height)


def host_mesh(hosts: Hosts, laid: Strip, lift: float) -> tuple[Any, Any]:
    """Copies of triangles, `lift` metres above them, as a smooth mesh, and the image that it bakes into."""
    import bpy

    count = 3 * len(hosts.corners)
    points = np.tile(hosts.corners + lift * flat_normals(hosts.corners)[:, None], (3, 1, 1))
    mesh = bpy.data.meshes.new("Smooth Probes")
    mesh.from_pydata(points.reshape(-1, 3).tolist(), [], np.arange(3 * count).reshape(-1, 3).tolist(), shade_flat=False)
    mesh.uv_layers.new(name="Probes").data.foreach_set(
        "uv", np.concatenate([laid.uv, laid.covers]).astype(np.float32).ravel()
    )
    mesh.normals_split_custom_set(np.tile(hosts.normals, (3, 1, 1)).reshape(-1, 3).tolist())
    mesh.polygons.foreach_set("material_index", np.repeat([0, 1, 1], count // 3).astype(np.int32))
    image = bpy.data.images.new("Smooth Probes", 1, laid.height, alpha=False, float_buffer=True, is_data=True)
    return mesh, image
