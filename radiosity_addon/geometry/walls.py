# SPDX-License-Identifier: GPL-3.0-or-later
"""Thin walls that stand on texels: what is on one side of them must not be taken for what is on the other.

A wall without thickness, or thinner than a texel, leaves no texel inside a solid that would part its two sides. It is
found by rays from texel to texel along the surface. A texel at its foot stands for the side that its centre is on, and
cells of texels, be they patches or those of gather points, are parted into what sees each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ..arrays import Bools, Float32, Int8, Int32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..columns import dots, some
from .texels import STRATA, Texels
from .visibility import Hits, Visibility

Ids: TypeAlias = Int64 | Int32

CLEARANCE = 0.005
"""Height above a flat surface, as a share of the distance, at which two points must see each other."""

SPAN = 8
"""Steps from texel to texel that one ray takes where the surface is flat."""

LEVEL = 1e-4
"""Least 1 - cosine between normals, and least squared share of a step that leads off the plane, of what is not flat."""

BENT = 0.95
"""Least cosine between normals of neighbours that a wall can be found between: a crease hides as well."""

STEEP = 0.7
"""Least cosine between normals of texels that can be asked whether they see each other."""

CREASED = 2.0
"""A crease rises twice as high over its chord as an arc between the same normals."""

MARGIN = 1.2
"""Strata are seen if so much of the way to them, in shares, is clear: what stands in a wall sees to both sides."""

FOOT = 0.03
"""A texel nearer to a wall than this share of the way to its neighbour, beside a chart, stands in the wall's foot."""

PARTS = 4
"""Parts of a cell that are told from each other; the last one keeps whatever is left."""

CHUNK = 1 << 15


@dataclass(frozen=True, eq=False)
class Walls:
    """Where thin walls stand on the texels of a scene.

    Attributes:
        border: (T,) bool, texels beside which surfaces end, are buried, or a wall stands; a wall across several texels
            leaves such ones on either side
        row: (T,) int32, of crossed texels in `planes`
        planes: (C, 4, 4) float32: a texel keeps of its footprint the points p with planes @ (p, 1) >= 0
        behind: (2, K) int32, texels at the back of a sheet that stands there, and those next to them at its front
    """

    border: Bools
    row: Int32
    planes: Float32
    behind: Int32

    def beyond(self, texels: Texels, texel: Int32, hits: Hits) -> tuple[Int64, Int32]:
        """Hits on fronts of texels (R,), -1 for none, that are beyond the wall which stands on theirs.

        Returns:
            which hits, and the texels beside theirs, on the hits' own side of the wall; -1 where that is not sure
        """
        if not len(self.planes):
            return np.zeros(0, np.int64), np.zeros(0, np.int32)
        near = np.flatnonzero(texels.crossed.take(texel) & (texel >= 0) & hits.front)
        points = texels.surfaces.points(hits.triangle[near], np.stack([hits.u[near], hits.v[near]], axis=1))
        below = self._below(texel[near], points)
        chosen = np.flatnonzero(below.any(0))
        near, below, points = near[chosen], below[:, chosen], points[chosen]
        other = texels.texel_at[texels.pixel[texel[near]] + np.array(_steps(texels))[below.argmax(0)]]
        other[self._below(other, points).any(0) | (below.sum(0) > 1)] = -1
        return near, other

    def _below(self, texel: Int32, points: Float32) -> Bools:
        """(4, K) bool, which planes of texels (K,), if they have any, points (K, 3) are behind."""
        row = self.row[texel]
        planes = self.planes.take(np.maximum(row, 0), axis=0)
        height = np.einsum("rkx,rx->kr", planes[:, :, :3], points) + planes[:, :, 3].T
        return np.asarray((height < 0) & (row >= 0))


def _steps(texels: Texels) -> tuple[int, int, int, int]:
    """From a pixel to its neighbours, in the order of the planes of walls."""
    return -1, 1, -texels.size, texels.size


def lift(distance: Float32, cosine: Float32, offset: float) -> Float32:
    """Height (R, 1), m, at which points so far apart, with so much between their normals, must see each other.

    The chord of an arc between normals at an angle t sags by distance * tan(t / 4) / 2.
    """
    sag = np.sqrt(np.maximum(1 - cosine, 0) / 8) / 2  # about t / 8
    height = distance * (sag * np.float32(1.2) + np.float32(CLEARANCE)) + np.float32(offset)
    return np.asarray(height[:, None], np.float32)


def hidden(
    texels: Texels,
    here: Ids,
    there: Ids,
    visibility: Visibility,
    steep: float = 1.0,
    side: int = 1,
    most: Float32 | None = None,
) -> Bools:
    """Whether something stands on the surface between texels `here` and `there`, (R,) each.

    Args:
        most: (R,) height, m, over which another surface may lie above one of them; None if that is not known
        side: 1 for fronts, -1 for backs
        steep: how many times higher than over an arc the surface may rise between them
    """
    start, span = _sight(texels, here, there, steep, side, most)
    return np.asarray(visibility.occluded(start, span) & (here != there))


def _sight(
    texels: Texels, here: Ids, there: Ids, steep: float, side: int = 1, most: Float32 | None = None
) -> tuple[Float32, Float32]:
    """Where the rays of `hidden` start, and the ways that they go, (R, 3) each, m."""
    normal, other = (texels.shading_normal.take(ids, axis=0) for ids in (here, there))
    start, span = (texels.position.take(ids, axis=0) for ids in (here, there))
    span -= start
    distance = np.sqrt(dots(span, span))
    up = lift(distance * np.float32(steep), dots(normal, other), texels.surfaces.offset)
    if most is not None:
        np.minimum(up, most[:, None], out=up)
    up *= np.float32(side)
    start += normal * up
    other -= normal
    other *= up
    span += other
    return start, span


def _meets_itself(texels: Texels, here: Ids, there: Ids, visibility: Visibility) -> Bools:
    """(R,) bool, what hides texels `there` from those `here` is the edge between faces that they lie on, no wall."""
    surfaces = texels.surfaces
    hits = visibility.first_hit(*_sight(texels, here, there, CREASED))
    met = np.maximum(hits.triangle, 0)
    own = hits.triangle >= 0
    for ids in (here, there):
        triangle = texels.triangle[ids]
        own &= surfaces.component[triangle] == surfaces.component[met]
        own &= dots(surfaces.normals(triangle), surfaces.normals(met)) > BENT
    return np.asarray(own)


def find_walls(texels: Texels, visibility: Visibility, workers: int) -> Fractions[Walls]:
    """Find the walls on texels, and leave to each texel only the strata on its centre's side: changes the texels."""
    crossed = texels.crossed
    for axis, order in enumerate((np.arange(texels.count, dtype=np.int32), _by_columns(texels))):
        cut = yield from scaled(_parted_steps(texels, order, (1, texels.size)[axis], visibility, workers), 0.0, 0.9)
        crossed[cut] = True
    rows = np.flatnonzero(crossed)
    number = np.full(texels.count if len(rows) else 0, -1, np.int32)
    number[rows] = np.arange(len(rows), dtype=np.int32)
    if len(rows):
        beyond = np.zeros((texels.count, STRATA), bool)
        beyond[rows] = _strata_beyond(texels, rows, visibility)
        texels.without(beyond)
    planes, nearest, facing = _planes(texels, rows, visibility)
    behind = _behind_sheets(texels, rows, number, facing)
    _step_aside(texels, rows[nearest < FOOT], visibility)
    return Walls(_at_border(texels), number, planes, behind)


def _by_columns(texels: Texels) -> Int32:
    """Texels column by column."""
    grid = texels.texel_at.reshape(-1, texels.size, texels.size).transpose(0, 2, 1).reshape(-1)
    return grid[grid >= 0]


def _parted_steps(texels: Texels, order: Int32, stride: int, visibility: Visibility, workers: int) -> Fractions[Int64]:
    """Texels that do not see the next one in `order`, which lies `stride` pixels on, and those next ones."""
    component = texels.surfaces.component

    def work(start: int, stop: int) -> Int64:
        path = order[start : stop + 1]
        here, there = path[:-1], path[1:]
        triangle = texels.triangle[path]
        pixel, part = texels.pixel[path], component.take(triangle)
        valid = texels.valid[path]
        wanted = (np.diff(pixel) == stride) & (part[1:] == part[:-1]) & valid[1:] & valid[:-1]
        if stride == 1:
            wanted &= pixel[1:] % texels.size != 0
        x, y, z = np.ascontiguousarray(texels.position.take(path, axis=0).T)
        p, q, r = texels.surfaces.normals(triangle).T
        cosine = p[1:] * p[:-1] + q[1:] * q[:-1] + r[1:] * r[:-1]
        dx, dy, dz = np.diff(x), np.diff(y), np.diff(z)
        rise = dx * p[1:] + dy * q[1:] + dz * r[1:]
        wanted &= cosine > BENT
        creased = _creased(texels, path)
        wanted &= ~(creased[1:] | creased[:-1])
        level = (cosine > 1 - LEVEL) & (rise * rise <= LEVEL * (dx * dx + dy * dy + dz * dz))
        first, last = _pieces(wanted & level)
        blocked = hidden(texels, path[first], path[last], visibility)
        single = wanted & ~level
        for step in range(SPAN):
            single[np.minimum(first[blocked] + step, last[blocked] - 1)] = True
        asked = np.flatnonzero(single)
        asked = asked[hidden(texels, here[asked], there[asked], visibility, CREASED)]
        asked = asked[~_meets_itself(texels, here[asked], there[asked], visibility)]
        return np.concatenate([here[asked], there[asked]])

    parts = yield from in_chunks(work, max(0, len(order) - 1), CHUNK, workers)
    return np.concatenate(parts) if parts else np.zeros(0, np.int64)


def _creased(texels: Texels, chosen: Int32) -> Bools:
    """(C,) bool, texels across an edge of a smooth surface: their middle lies beneath it, and sees no neighbour's."""
    mixed = np.flatnonzero(texels.footprints.seat.take(chosen) < 0)
    triangles = texels.footprints.triangles(chosen[mixed])
    x, y, z = texels.surfaces.normals(triangles.reshape(-1)).T.reshape(3, -1, STRATA)
    creased = np.zeros(len(chosen), bool)
    creased[mixed] = some(x * x[:, :1] + y * y[:, :1] + z * z[:, :1] < BENT)
    return creased


def _pieces(steps: Bools) -> tuple[Int64, Int64]:
    """Runs of true `steps` (S,), cut into pieces of at most SPAN: the points, of S + 1, that each leads from and to."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], steps, [False]]).view(np.int8)))
    begin, end = ends[::2], ends[1::2]
    number = -(-(end - begin) // SPAN)
    first = np.repeat(begin, number) + SPAN * (np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number))
    return first, np.minimum(first + SPAN, np.repeat(end, number))


def _strata_beyond(texels: Texels, chosen: Int64, visibility: Visibility) -> Bools:
    """(C, 4) bool, covered strata of texels (C,) on the other side of a wall than the first that the centre sees."""
    slots = np.arange(STRATA)
    every = np.repeat(chosen, STRATA)
    points = texels.origins(every, np.tile(slots, len(chosen))).reshape(-1, STRATA, 3)
    covered = ((texels.covered[chosen][:, None] >> slots) & 1) > 0

    def unseen(start: Float32) -> Bools:
        span = (points - start[:, None]) * np.float32(MARGIN)
        return visibility.occluded(np.repeat(start, STRATA, axis=0), span.reshape(-1, 3)).reshape(-1, STRATA)

    centre = texels.position[chosen] + texels.normal[chosen] * np.float32(texels.surfaces.offset)
    first = (covered & ~unseen(centre)).argmax(1)
    beyond = unseen(points[np.arange(len(chosen)), first])
    return np.asarray(covered & beyond & (slots != first[:, None]))


def _at_border(texels: Texels) -> Bools:
    """(T,) bool, texels that are crossed, or do not have a valid texel to every side on the page."""
    inner: Bools = np.zeros(len(texels.texel_at), bool)
    inner[texels.pixel[texels.valid & ~texels.crossed]] = True
    inner = inner.reshape(-1, texels.size, texels.size)
    whole = inner.copy()
    for axis in (1, 2):
        ahead, behind = np.moveaxis(whole, axis, 0), np.moveaxis(inner, axis, 0)
        ahead[1:] &= behind[:-1]
        ahead[:-1] &= behind[1:]
    return ~whole.reshape(-1)[texels.pixel]


def _planes(texels: Texels, chosen: Int64, visibility: Visibility) -> tuple[Float32, Float32, Int8]:
    """(C, 4, 4) planes of the walls between texels (C,) and their neighbours on the page; 0 where there is none.

    Also (C,), at which share of the way to a neighbour the nearest wall stands, and (C, 4), 1 where a wall shows its
    front to the texel, -1 where its back.
    """
    planes = np.zeros((len(chosen), 4, 4), np.float32)
    facing = np.zeros((len(chosen), 4), np.int8)
    nearest = np.ones(len(chosen), np.float32)
    surfaces = texels.surfaces
    component = surfaces.component[texels.triangle[:]] if len(chosen) else np.zeros(0, np.int32)
    column = texels.pixel[chosen] % texels.size
    for side, step in enumerate(_steps(texels)):
        other = texels.texel_at.take(texels.pixel[chosen] + step, mode="clip")
        there = (other >= 0) & texels.valid[other] & (component[other] == component[chosen])
        if abs(step) == 1:
            there &= np.abs(texels.pixel[other] % texels.size - column) == 1
        row = np.flatnonzero(there)
        here, next_to = chosen[row], other[row]
        normal, beside = texels.normal[here], texels.normal[next_to]
        row = row[np.einsum("ij,ij->i", normal, beside) > STEEP]
        here, next_to = chosen[row], other[row]
        start = texels.position[here] + texels.normal[here] * np.float32(surfaces.offset)
        end = texels.position[next_to] + texels.normal[next_to] * np.float32(surfaces.offset)
        hits = visibility.first_hit(start, end - start)
        met = np.flatnonzero((hits.triangle >= 0) & (hits.distance < 1))
        nearest[row[met]] = np.minimum(nearest[row[met]], hits.distance[met])
        triangle = hits.triangle[met]
        facing[row[met], side] = np.where(hits.front[met], 1, -1)
        normal = surfaces.normals(triangle) * facing[row[met], side, None]
        planes[row[met], side, :3] = normal
        planes[row[met], side, 3] = -np.einsum("ij,ij->i", normal, surfaces.corners[triangle, 0])
    return planes, nearest, facing


def _behind_sheets(texels: Texels, chosen: Int64, row: Int32, facing: Int8) -> Int32:
    """(2, K): of texels (C,), rows (T,), those to which a wall shows its back, and neighbours that see its front."""
    pairs = [np.zeros((2, 0), np.int32)]
    for side, step in enumerate(_steps(texels)):
        back = np.flatnonzero(facing[:, side] < 0)
        other = texels.texel_at[texels.pixel[chosen[back]] + step]
        front = facing[row[other], side ^ 1] * (row[other] >= 0) > 0
        pairs.append(np.stack([chosen[back[front]], other[front]]).astype(np.int32))
    return np.concatenate(pairs, axis=1)


def _step_aside(texels: Texels, chosen: Int64, visibility: Visibility) -> None:
    """Let texels that stand in a wall, and see to both its sides, stand where a neighbour that they see does."""
    within = chosen
    for step in (1, -1, texels.size, -texels.size):
        other = texels.texel_at.take(texels.pixel[chosen] + step, mode="clip")
        near = (other >= 0) & texels.valid[other] & ~np.isin(other, within)
        near &= np.einsum("ij,ij->i", texels.normal[chosen], texels.normal[other]) > STEEP
        near[near] = ~hidden(texels, chosen[near], other[near], visibility)
        texels.stand_at(chosen[near], other[near])
        chosen = chosen[~near]


def part_cells(
    cell: Int32, seat: Int64, first: Bools, texels: Texels, visibility: Visibility, workers: int, side: int = 1
) -> Fractions[tuple[Int32, Int64]]:
    """Part cells of texels so that each one's texels see its seat.

    A texel that does not goes to the cell of a neighbour on the page whose seat it sees, or to a cell of its own.

    Args:
        cell: (T,) int32, cell of each texel, -1 for none
        seat: (N,) int64, the texel of each cell that the others are to see
        first: (T,) bool, texels that are asked first; all others only in cells where some of these do not see theirs
        side: 1 for fronts, -1 for backs
    Returns:
        the cells (T,), and seats of all cells, new ones last
    """
    cell = cell.copy()

    def unseen(here: Int64, there: Int64, unlike: bool = False) -> Fractions[Bools]:
        """Which of the texels `here` do not see those `there`; `unlike` where they face too differently to be asked."""

        def work(start: int, stop: int) -> Bools:
            one, other = here[start:stop], there[start:stop]
            alike = dots(*(texels.shading_normal.take(ids, axis=0) for ids in (one, other))) > STEEP
            found = hidden(texels, one, other, visibility, side=side)
            return np.asarray(np.where(alike, found, unlike))

        return np.concatenate([np.zeros(0, bool), *(yield from in_chunks(work, len(here), CHUNK, workers))])

    asked = np.flatnonzero(first & (cell >= 0))
    asked = asked[(yield from unseen(asked, seat[cell[asked]]))]
    parted = np.zeros(len(seat) + 1, bool)
    parted[cell[asked]] = True
    asked = np.flatnonzero(parted[cell])
    asked = asked[(yield from unseen(asked, seat[cell[asked]]))]
    lost = np.zeros(texels.count, bool)
    lost[asked] = True
    label = texels.surfaces.component.astype(np.int64) << 32 | texels.surfaces.material
    for step in (1, -1, texels.size, -texels.size):
        other = texels.texel_at.take(texels.pixel[asked] + step, mode="clip")
        near = (other >= 0) & (cell[other] >= 0) & ~lost[other]
        near &= label[texels.triangle[other]] == label[texels.triangle[asked]]
        near[near] = ~(yield from unseen(asked[near], seat[cell[other[near]]], True))
        cell[asked[near]] = cell[other[near]]
        asked = asked[~near]
    for _ in range(PARTS - 1):
        if not len(asked):
            break
        names, number = np.unique(cell[asked], return_inverse=True)
        order = np.argsort(number, kind="stable")
        begin = np.searchsorted(number[order], np.arange(len(names) + 1))
        cell[asked] = (len(seat) + number).astype(cell.dtype)
        seat = np.concatenate([seat, asked[order[(begin[:-1] + begin[1:]) // 2]]])
        asked = asked[(yield from unseen(asked, seat[cell[asked]]))]
    return cell, seat
