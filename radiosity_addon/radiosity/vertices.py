# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices on triangles, close enough for light to be shown by their colours alone, as Gouraud (1971) has it.

Small triangles have their corners; wide ones get a grid. Vertices of one connected surface that lie near each other
and face alike are one sample of the light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float32, Int32, Int64
from ..geometry.surfaces import Surfaces

MOST_STEPS = 24
"""Pieces that an edge is cut into, at most."""

NARROWEST = 0.25
"""Samples are at least this share of the spacing apart."""

INSET = 0.25
"""A sample's point lies this share of the way from its vertex to the centre of its piece: not in a corner of walls."""

FACINGS = 2.0
"""Normals times this, rounded, are their facing."""

Cells = tuple[Int64, Int64]
"""Names (K,) of cells of a world-space grid and of a facing, ascending, and the index into them of what was sorted."""


@dataclass(frozen=True, eq=False)
class Vertices:
    """V vertices on F triangles, and the S samples that they share.

    Attributes:
        surfaces: the triangles
        steps: (F,) int32, pieces along the edges of each
        first: (F + 1,) int64, where the vertices of each begin
        triangle: (V,) int32, that each lies on
        weights: (V, 2) float32, barycentrics
        sample: (V,) int32
        seat: (S,) int64, the vertex that each sample stands at
    """

    surfaces: Surfaces
    steps: Int32
    first: Int64
    triangle: Int32
    weights: Float32
    sample: Int32
    seat: Int64

    @property
    def count(self) -> int:
        """Samples."""
        return len(self.seat)

    def points(self) -> tuple[Float32, Float32]:
        """Points of the samples on their surfaces and unit shading normals there, both (S, 3) float32, m."""
        triangle = self.triangle[self.seat]
        weights = self.weights[self.seat]
        weights += (np.float32(1 / 3) - weights) * (np.float32(INSET) / self.steps[triangle])[:, None]
        normals = self.surfaces.blended_normals(triangle, weights)
        length = np.sqrt(np.einsum("ij,ij->i", normals, normals))[:, None]
        flat = self.surfaces.normals(triangle)
        return self.surfaces.points(triangle, weights), np.where(
            length > 1e-6, normals / np.maximum(length, 1e-6), flat
        )

    def at(self, triangle: Int32, weights: Float32) -> Int32:
        """The sample (R,) nearest to barycentrics (R, 2) of triangles (R,)."""
        steps = self.steps[triangle]
        column, row = np.rint(weights.T * steps).astype(np.int64)
        return self._sample_at(triangle, steps, column, row)

    def between(self, values: Float32, triangle: Int32, weights: Float32) -> Float32:
        """Values (S, 3) of samples at barycentrics (R, 2) of triangles (R,), linear in each piece."""
        steps = self.steps[triangle]
        column, row = np.floor(weights.T * steps).astype(np.int64)
        right, up = weights.T * steps - (column, row)
        turned = right + up > 1  # a piece that points down is as the others, seen from its own right angle
        corner, across, along = (
            self._sample_at(triangle, steps, column + x, row + y)
            for x, y in ((turned, turned), (~turned, turned), (turned, ~turned))
        )
        right, up = np.where(turned, (1 - right, 1 - up), (right, up)).astype(np.float32)
        found: Float32 = values[corner] * (1 - right - up)[:, None]
        found += values[across] * right[:, None]
        found += values[along] * up[:, None]
        return found

    def _sample_at(self, triangle: Int32, steps: Int32, column: Int64, row: Int64) -> Int32:
        column = np.minimum(np.maximum(column, 0), steps)
        row = np.minimum(np.maximum(row, 0), steps - column)
        return np.asarray(self.sample[self.first[triangle] + _row_start(row, steps) + column])

    def pieces(self) -> tuple[Int64, Int32]:
        """Triangles (K, 3) between vertices, and which of the surfaces' triangles (K,) each is part of."""
        corners, owners = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int32)]
        for steps in np.unique(self.steps):
            triangles = np.flatnonzero(self.steps == steps).astype(np.int32)
            local = _grid_pieces(int(steps))
            corners.append((self.first[triangles][:, None, None] + local).reshape(-1, 3))
            owners.append(np.repeat(triangles, len(local)))
        return np.concatenate(corners), np.concatenate(owners)


def place_vertices(surfaces: Surfaces, spacing: float, most: int) -> Vertices:
    """Vertices at most about `spacing` metres apart, which share at most `most` samples or one for each facing."""
    corners = surfaces.corners
    edges = np.stack([corners[:, k] - corners[:, k - 1] for k in range(3)])
    longest = np.sqrt(np.einsum("kij,kij->ki", edges, edges).max(0, initial=0))
    steps = np.clip(np.ceil(longest / spacing), 1, MOST_STEPS).astype(np.int32)
    number = (steps.astype(np.int64) + 1) * (steps + 2) // 2
    first = np.concatenate([[0], np.cumsum(number)])
    weights = np.empty((int(first[-1]), 2), np.float32)
    for each in np.unique(steps):
        grid = _grid(int(each))
        own = first[:-1][steps == each]
        weights[own[:, None] + np.arange(len(grid))] = (grid / each).astype(np.float32)
    triangle = np.repeat(np.arange(surfaces.count, dtype=np.int32), number)
    position = surfaces.points(triangle, weights)
    normals = surfaces.blended_normals(triangle, weights)
    width = NARROWEST * spacing
    while True:
        names = cell_names(surfaces, triangle, position, normals, width)
        order = np.argsort(names, kind="stable")
        begin = np.flatnonzero(np.diff(names[order], prepend=-1))
        if len(begin) <= most or width > surfaces.radius:
            break
        width *= 2
    sample = np.empty(len(order), np.int32)
    sample[order] = np.repeat(np.arange(len(begin), dtype=np.int32), np.diff(begin, append=len(order)))
    # the first vertices of a cell lie at the edge of its surface, where furniture stands on floors, and sinks into them
    seat = order[(begin + np.append(begin[1:], len(order))) // 2]
    return Vertices(surfaces, steps, first, triangle, weights, sample, seat)


def cell_names(
    surfaces: Surfaces,
    triangle: Int32,
    position: Float32,
    normals: Float32,
    width: float,
    shift: Int64 | int = 0,
    apart: bool = True,
) -> Int64:
    """A number (R,) for the connected surface, the facing and the cell, `width` metres wide, of points on triangles.

    Args:
        shift: (3,) cells by which the point is looked for beside its own
        apart: connected surfaces are told apart
    """
    facing = np.rint(normals * np.float32(FACINGS)).astype(np.int64) + int(FACINGS)
    extent = int(np.ceil(surfaces.radius / width)) + 2
    cell = np.floor(position / np.float32(width)).astype(np.int64) + shift + extent
    name = surfaces.component[triangle].astype(np.int64) if apart else np.zeros(len(triangle), np.int64)
    for part in facing.T:
        name = name * (2 * int(FACINGS) + 1) + part
    for part in cell.T:
        name = name * (2 * extent + 1) + np.clip(part, 0, 2 * extent)
    return name


def _row_start(row: Int64, steps: Int32 | int) -> Int64:
    """Vertices of a grid before those of a row: rows hold one less each."""
    return np.asarray(row * (steps + 1) - row * (row - 1) // 2)


def _grid(steps: int) -> Int64:
    """(G, 2) columns and rows of the vertices of a triangle whose edges are cut into `steps`."""
    row = np.repeat(np.arange(steps + 1), np.arange(steps + 1, 0, -1))
    return np.stack([np.arange(len(row)) - _row_start(row, steps), row], axis=1)


def _grid_pieces(steps: int) -> Int64:
    """(steps^2, 3) triangles between the vertices of `_grid`, wound as the whole."""
    column, row = _grid(steps).T
    here = np.arange(len(column))
    above = here + steps + 1 - row
    upright, turned = column + row < steps, column + row < steps - 1
    return np.concatenate(
        [
            np.stack([here, here + 1, above], axis=1)[upright],
            np.stack([here + 1, above + 1, above], axis=1)[turned],
        ]
    )
