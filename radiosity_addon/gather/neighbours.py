# SPDX-License-Identifier: GPL-3.0-or-later
"""Which gather points count for the texels of each cell: near, facing alike, and seen across the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float32, Int32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..columns import dots
from ..geometry.texels import Texels
from ..geometry.visibility import Visibility
from ..geometry.walls import lift
from .gather_points import GatherPoints

REACH = 1.6
"""A point counts for texels within this many widths of the cells around them."""

GROWTH = 0.35
"""Cells are taken to widen by this share of the distance, so that the reach has no steps where cells halve."""

NEIGHBOURS = 16
"""Points considered for a cell, at most."""

SAME_FACING = 0.7
"""Least cosine between normals of a texel and a point that counts for it (45 degrees), of shading normals and of faces:
where a smooth surface has a sharp edge, each face hides another part of what its shading normal looks at."""

SAME_PLANE = 0.2
"""A point counts if it lies within this share of the distance off the common tangent plane."""

CELL_RADIUS = 0.75
"""Texels of a cell lie within about this many widths of its point."""

LEVELS_APART = 2
"""Points of cells up to 2^2 times wider or narrower count."""

MARGIN = REACH * (1 + GROWTH * CELL_RADIUS)
"""How far beyond a cell a point may lie, in widths, to count for a texel in it."""

FACED = 0.25
"""A cell takes no points that face most along an axis which it faces less than this itself."""

CUBES = 2
"""Points are sought in cubes of this part of the radius: smaller ones hold fewer that are too far."""

CANDIDATES = 60
"""Where more points than these are near, only those in the innermost cubes are looked at: the nearest count most."""

COLUMNS = 1 << 16
"""Hashes that columns of cubes are told by: more than there are columns with points, few enough to stay in cache."""

RAYS = 1 << 15
"""Rays upwards traced at once."""

CELLS = 2048
"""Cells looked at in one go: some 10^5 candidate points, whose arrays stay in cache."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Points that count for each cell.

    Attributes:
        point: (P, NEIGHBOURS) int32, nearest first, padded with the cell's own point
        count: (P,) int32
        crowded: (P,) bool, other surfaces come close: each texel asks for itself what it sees
        clear: (P,) float32, m, half the way up from the point to the next surface
    """

    point: Int32
    count: Int32
    crowded: Bools
    clear: Float32


def find_neighbours(
    texels: Texels, points: GatherPoints, visibility: Visibility, workers: int
) -> Fractions[Neighbours]:
    """Points that may count for the texels of each cell."""
    position, normal, face = (
        rows.take(points.texel, axis=0) for rows in (texels.position, texels.shading_normal, texels.normal)
    )
    jobs = _jobs(position, normal, points)
    clear = yield from scaled(_clear_heights(texels, points, visibility, workers), 0, 0.1)

    def work(start: int, stop: int) -> tuple[Int64, Int64, Float32, Int64]:
        cell, point, gap, distance = jobs[start].pairs()
        width = points.width.take(cell)
        narrower = np.minimum(points.width.take(point), width)
        beyond = np.asarray((distance - np.float32(CELL_RADIUS) * width) / narrower, np.float32)
        here, there = normal.take(cell, axis=0), normal.take(point, axis=0)
        facing = np.minimum(dots(here, there), dots(face.take(cell, axis=0), face.take(point, axis=0)))
        there += here
        height = np.abs(dots(gap, there)) / 2
        alike = np.flatnonzero((facing > SAME_FACING) & (height <= np.float32(SAME_PLANE) * distance))
        order = alike[_by_cell(cell[alike], beyond[alike])]
        order = order[_rank(cell[order]) < NEIGHBOURS]
        cell, point, distance, beyond = cell[order], point[order], distance[order], beyond[order]
        up = lift(distance, facing.take(order), texels.surfaces.offset)
        np.minimum(up, np.minimum(clear[cell], clear[point])[:, None], out=up)  # else a wall's dark shows on a picture
        here, there = normal.take(cell, axis=0), normal.take(point, axis=0)
        origins = position.take(cell, axis=0) + here * up
        blocked = visibility.occluded(origins, gap.take(order, axis=0) + (there - here) * up) & (distance > 0)
        return cell[~blocked], point[~blocked], beyond[~blocked], cell[blocked]

    parts = yield from scaled(in_chunks(work, len(jobs), 1, workers), 0.1, 1)
    if not parts:
        return Neighbours(np.zeros((0, NEIGHBOURS), np.int32), np.zeros(0, np.int32), np.zeros(0, bool), clear)
    cell, point, beyond, cut = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = _by_cell(cell, beyond)
    cell, point = cell[order], point[order]
    rank = _rank(cell)
    kept = rank < NEIGHBOURS
    table = np.repeat(np.arange(points.count, dtype=np.int32)[:, None], NEIGHBOURS, axis=1)
    table[cell[kept], rank[kept]] = point[kept]
    count = np.minimum(np.bincount(cell, minlength=points.count), NEIGHBOURS).astype(np.int32)
    crowded = points.crowded
    crowded[cut] = True
    hidden = points.cell[~texels.valid]
    crowded[hidden[hidden >= 0]] = True
    return Neighbours(table, count, crowded, clear)


def _clear_heights(texels: Texels, points: GatherPoints, visibility: Visibility, workers: int) -> Fractions[Float32]:
    """(P,) float32, m: half the way up from each point to the next surface, but at least the scene's offset.

    Points on a wall behind a picture must not be lifted through it.
    """
    height = np.empty(points.count, np.float32)

    def work(start: int, stop: int) -> None:
        texel = points.texel[start:stop]
        origins = texels.origins(texel, np.zeros(len(texel), np.int64))
        height[start:stop] = visibility.first_hit(origins, texels.normal.take(texel, axis=0)).distance

    yield from in_chunks(work, points.count, RAYS, workers)
    return np.maximum(height / 2, np.float32(texels.surfaces.offset))


def _by_cell(cell: Int64, beyond: Float32) -> Int64:
    """The order (R,) by cell, and within a cell by how far beyond it; one sort of whole numbers is the fastest."""
    far = np.maximum(beyond, 0).view(np.int32)  # floats from 0 on are ordered like their bits
    return np.argsort((cell << 32) + far)


def _rank(cell: Int64) -> Int64:
    """How many equal numbers come before each, in sorted ones."""
    return np.arange(len(cell)) - np.searchsorted(cell, cell, side="left")


@dataclass(frozen=True, eq=False)
class _Job:
    """Cells (C,) and points (Q,), where they lie (C, 3), (Q, 3), and in which cubes; the points sorted by theirs.

    Attributes:
        occupied: (COLUMNS,) bool, by their hashes, columns of cubes along z with points: most around a cell have none
    """

    cell: Int64
    cell_place: Float32
    cell_cube: Int64
    point: Int64
    point_place: Float32
    point_cube: Int64
    occupied: Bools
    radius: float

    def _around(self, cells: Int64, cubes: int) -> tuple[Int64, Int64, Int64]:
        """Rows of cubes around cells (M,) that may hold points: of which cell, where these begin, how many they are."""
        span = np.arange(-cubes, cubes + 1)
        row = self.cell_cube[cells][:, None] + ((span[:, None] << 40) + (span << 20)).reshape(-1)
        which = np.flatnonzero(self.occupied.take(_column_hash(row)))
        row = row.reshape(-1)[which]  # cubes of a row follow each other in z
        begin = np.searchsorted(self.point_cube, row - cubes, side="left")
        end = np.searchsorted(self.point_cube, row + cubes, side="right")
        return cells[which // len(span) ** 2], begin, end - begin

    def pairs(self) -> tuple[Int64, Int64, Float32, Float32]:
        """Cells and points within the radius of each other, what lies between them (R, 3), and how far that is."""
        around = self._around(np.arange(len(self.cell)), CUBES)
        number = np.bincount(around[0], weights=around[2], minlength=len(self.cell))
        few = number[around[0]] <= CANDIDATES
        inner = self._around(np.flatnonzero(number > CANDIDATES), 1)
        rows, begin, size = (np.concatenate([outer[few], part]) for outer, part in zip(around, inner, strict=True))
        run = np.repeat(np.arange(len(size)), size)
        point = np.arange(len(run)) + (begin - (np.cumsum(size) - size))[run]
        cell = rows[run]
        gap = self.point_place.take(point, axis=0)
        gap -= self.cell_place.take(cell, axis=0)
        squared = dots(gap, gap)
        near = np.flatnonzero(squared < self.radius**2)
        return self.cell[cell[near]], self.point[point[near]], gap.take(near, axis=0), np.sqrt(squared[near])


def _column_hash(cube: Int64) -> Int64:
    """A number below COLUMNS for the column of cubes along z that cubes are in (Knuth's multiplicative hash)."""
    return np.asarray(((cube >> 20) * 0x1E3779B97F4A7C15 >> 40) & (COLUMNS - 1))


def _jobs(position: Float32, normal: Float32, points: GatherPoints) -> list[_Job]:
    """Cells with the points that may count for them, by the widths of both.

    Points are sorted by the axis they face most, then by cube; a cell asks for those axes that it faces itself.
    """
    towards = np.concatenate([normal, -normal], axis=1)  # share of the normal along +x, +y, +z, -x, -y, -z
    axis = towards.argmax(1).astype(np.int64) << 60
    jobs = []
    widths = np.unique(points.width)
    limit = np.float32(2.0 ** (LEVELS_APART + 0.5))
    for width in widths:
        cells, faced = np.nonzero((points.width == width)[:, None] & (towards > FACED))
        for other in widths[(widths < width * limit) & (widths > width / limit)]:
            radius = np.float32(CELL_RADIUS) * width + np.float32(MARGIN) * min(width, other)
            cube = np.floor(position * (CUBES / radius)).astype(np.int64) + (1 << 18)
            key = (cube[:, 0] << 40) + (cube[:, 1] << 20) + cube[:, 2]
            others = np.flatnonzero(points.width == other)
            sorted_key = key[others] + axis[others]
            order = np.argsort(sorted_key, kind="stable")
            others, sorted_key = others[order], sorted_key[order]
            occupied = np.zeros(COLUMNS, bool)
            occupied[_column_hash(sorted_key)] = True
            places = position[others]
            sought = key[cells] + (faced.astype(np.int64) << 60)
            near = np.argsort(sought, kind="stable")  # cells beside each other look at the same points
            for start in range(0, len(cells), CELLS):
                part = near[start : start + CELLS]
                mine = cells[part]
                jobs.append(
                    _Job(mine, position[mine], sought[part], others, places, sorted_key, occupied, float(radius))
                )
    return jobs
