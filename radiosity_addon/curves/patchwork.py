# SPDX-License-Identifier: GPL-3.0-or-later
"""Rectangular nets of points and flat caps as one mesh of polygons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Float64, Int64

T = TypeVar("T", bound=np.generic)

COINCIDENT = 1e-7
"""Neighbours of a net closer than this share of its extent are one point, as at a pole."""


@dataclass(frozen=True, eq=False)
class Net:
    """A surface sampled on rows and columns; four neighbours make a face.

    Attributes:
        points: (R, C, 3) float64
        rows: texture coordinate of each row, (R,), or (R + 1,) where the last row is followed by the first
        columns: the same for columns
        normals: (R, C, 3) float64, unit, or None to take those of the faces
        material: slot
    """

    points: Float64
    rows: Float64
    columns: Float64
    normals: Float64 | None = None
    material: int = 0

    @property
    def closed(self) -> tuple[bool, bool]:
        """Whether the rows close to a ring, and the columns."""
        return len(self.rows) > self.points.shape[0], len(self.columns) > self.points.shape[1]

    def around(self, grid: NDArray[T]) -> NDArray[T]:
        """A grid (R, C, ...) of this net with its first row and column again where the net is closed."""
        for axis, closed in enumerate(self.closed):
            if closed:
                grid = np.concatenate([grid, np.take(grid, [0], axis=axis)], axis=axis)
        return grid


@dataclass(frozen=True, eq=False)
class Cap:
    """A flat polygon (K, 3) that closes the end of a tube, anticlockwise from outside."""

    points: Float64
    material: int = 0


@dataclass(frozen=True, eq=False)
class Patchwork:
    """Polygons of three corners and more.

    Attributes:
        vertices: (V, 3) float64
        loop_vertex: (L,) int64, vertex of each polygon corner
        loop_start: (P,) int64, first corner of each polygon
        loop_uv: (L, 2) float64, texture coordinates
        loop_normal: (L, 3) float64, unit, zero where the faces' own are meant
        material: (P,) int64
        face: (L,) int64, corner of a net's or cap's own numbering: see `patchwork`
        numbered: corners in that
    """

    vertices: Float64
    loop_vertex: Int64
    loop_start: Int64
    loop_uv: Float64
    loop_normal: Float64
    material: Int64
    face: Int64
    numbered: int


def faces_of(grid: NDArray[T]) -> NDArray[T]:
    """Corners (R - 1, C - 1, 4, ...) of the faces of a grid (R, C, ...).

    In Blender's order, so that the faces look the same way as those that it makes of the surface.
    """
    return np.stack([grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1], grid[:-1, :-1]], axis=2)


def patchwork(nets: Sequence[Net], caps: Sequence[Cap] = ()) -> Patchwork:
    """One mesh of all. Points of a net that coincide become one, and faces that lose a corner by it triangles.

    Corners of the parts are numbered one part after the other: four for each face of a net, then those of the caps.
    """
    return joined([*map(faces_of_net, nets), *map(face_of_cap, caps)])


def joined(parts: Sequence[Patchwork]) -> Patchwork:
    """One patchwork of several, with the vertices and corners of one part after those of the other."""
    vertices = np.cumsum([0, *(len(part.vertices) for part in parts)])
    loops = np.cumsum([0, *(len(part.loop_vertex) for part in parts)])
    numbered = np.cumsum([0, *(part.numbered for part in parts)])
    return Patchwork(
        vertices=np.concatenate([part.vertices for part in parts]),
        loop_vertex=np.concatenate([part.loop_vertex + n for part, n in zip(parts, vertices, strict=False)]),
        loop_start=np.concatenate([part.loop_start + n for part, n in zip(parts, loops, strict=False)]),
        loop_uv=np.concatenate([part.loop_uv for part in parts]),
        loop_normal=np.concatenate([part.loop_normal for part in parts]),
        material=np.concatenate([part.material for part in parts]),
        face=np.concatenate([part.face + n for part, n in zip(parts, numbered, strict=False)]),
        numbered=int(numbered[-1]),
    )


def faces_of_net(net: Net) -> Patchwork:
    """The faces of one net."""
    index, count = _numbered_points(net)
    corner = faces_of(net.around(index)).reshape(-1, 4)
    uv = faces_of(np.stack(np.meshgrid(net.rows, net.columns, indexing="ij"), axis=2)).reshape(-1, 2)
    normal = np.zeros((corner.size, 3)) if net.normals is None else _corner_normals(net, corner)
    loop, size, face = corner.reshape(-1), np.full(len(corner), 4), np.arange(corner.size)
    distinct = net.points.reshape(-1, 3)
    if count < index.size:
        distinct = np.zeros((count, 3))
        distinct[index] = net.points
        keep = corner != np.roll(corner, 1, axis=1)
        keep &= (keep.sum(axis=1) >= 3)[:, None]
        keep &= ((corner[:, 0] != corner[:, 2]) & (corner[:, 1] != corner[:, 3]))[:, None]
        size, face = keep.sum(axis=1), np.flatnonzero(keep)
        loop, uv, normal, size = loop[face], uv[face], normal[face], size[size > 0]
    return Patchwork(
        vertices=distinct,
        loop_vertex=loop,
        loop_start=np.cumsum(size) - size,
        loop_uv=uv,
        loop_normal=normal,
        material=np.full(len(size), net.material),
        face=face,
        numbered=corner.size,
    )


def face_of_cap(cap: Cap) -> Patchwork:
    """The one face of a cap."""
    count = len(cap.points)
    return Patchwork(
        vertices=cap.points,
        loop_vertex=np.arange(count),
        loop_start=np.zeros(1, np.int64),
        loop_uv=np.stack([np.arange(count) / max(count - 1, 1), np.zeros(count)], axis=1),
        loop_normal=np.zeros((count, 3)),
        material=np.array([cap.material]),
        face=np.arange(count),
        numbered=count,
    )


def _numbered_points(net: Net) -> tuple[Int64, int]:
    """A number (R, C) for each point of a net, the same for neighbours that coincide, and how many there are."""
    points = net.points
    index = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    near = COINCIDENT * float(np.linalg.norm(np.ptp(points.reshape(-1, 3), axis=0)))
    same = [(np.abs(np.diff(points, axis=axis)) <= near).all(axis=2) for axis in (0, 1)]
    if not (same[0].any() or same[1].any()):
        return index, index.size
    for axis in (1, 0, 1, 0):  # a run along a row may be joined to others by runs along columns
        index = _first_of_run(index, same[axis], axis)
    _, number = np.unique(index, return_inverse=True)
    number = number.reshape(index.shape)
    return number, int(number.max()) + 1


def _first_of_run(index: Int64, same: Bools, axis: int) -> Int64:
    """The number of the first of each run of coinciding points along an axis, for all of the run."""
    lines = np.expand_dims(np.arange(index.shape[axis]), 1 - axis)
    starts = np.insert(~same, 0, True, axis=axis)
    begin = np.maximum.accumulate(np.where(starts, lines, 0), axis=axis)
    return np.take_along_axis(index, begin, axis=axis)


def _corner_normals(net: Net, corner: Int64) -> Float64:
    """Normals (4 Q, 3) of the corners of faces (Q, 4); at a pole the mean along its side of the face."""
    assert net.normals is not None
    normal = faces_of(net.around(net.normals)).reshape(-1, 4, 3)
    for k in range(4):
        pair = np.flatnonzero(corner[:, k] == corner[:, k - 1])
        mean = normal[pair, k] + normal[pair, k - 1]
        length = np.linalg.norm(mean, axis=1, keepdims=True)
        normal[pair, k] = normal[pair, k - 1] = mean / np.where(length > 0, length, 1.0)
    return normal.reshape(-1, 3)
