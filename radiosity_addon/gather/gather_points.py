# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the final gather looks: one texel in each cell of a grid that is finer where surfaces are near.

Indirect light changes over distances like that to the surfaces it comes from (Ward, Rubinstein and Clear 1988). The
fit from points to texels is of first order, so it errs by second derivatives (Schwarzhaupt, Jensen and Jarosz 2012):
each part of the view counts by the inverse square of its distance. So the scale of change is the root of the harmonic
mean of squared distances, and a cell is split while it is wide against that scale, of all that is seen or of what
shines there, or its normals differ. A box on the floor fills little of the view from beside it, but most of that mean.
Cells are world-space ones: charts of one surface share them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..arrays import Bools, Float32, Int32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..columns import dots, extremes
from ..geometry.texels import Texels
from ..geometry.visibility import Visibility
from ..geometry.walls import Walls, part_cells
from ..indices import numbers_of
from ..radiosity.patches import mixed_radix

LEVELS = 7
"""Widths halve from level to level, the last time in folds and nooks alone."""

FINE_LEVEL = 2
"""From this level on points are close together, share their rays through the fit, and get fewer each."""

SPLIT_BEND = 0.0025
"""A cell is split while its normals' mean is shorter than 1 by more than this: about 8 degrees across. The narrowest
cells that are bent as much are folds."""

FINEST = 2.6
"""The narrowest cells are so many texels wide. They are halved once more in folds: where they are bent, or lie on a
surface that is and are still wide against what they see."""

NOOK = 0.5
"""Or so is one that is wider than this share of that scale: between books, under a cushion, along a skirting board."""

RESOLVED = 2.0
"""What is nearer than so many texels counts as being so far: pages can't show how light changes there."""

SMALLEST = 5
"""Cells of no more texels than this are not split, unless they are folded: each flank has light of its own."""

FACINGS = 2.0
"""Normals times this, rounded, are their facing: both flanks of a fold differ in at least one number."""

DARK = 1e-3
"""A cell whose point receives less than this share of the mean over all points may be hidden."""

HIDDEN = 0.5
"""It is, and is not split, if nowhere in it is the way up clear for this share of its width: a floor under boards."""

LAYER = 0.2
"""Texels of a cell that lie this share of its width off its mean plane are a cell of their own: folds, thin sheets."""

THINNEST = 0.75
"""Layers are not thinner than this many texels."""

CROWDED = 0.75
"""A cell is crowded if another surface comes nearer than this many of its widths."""

FILLED = 1.5
"""A cell is halved while it is wider than twice this many times the edge of the square that its texels would fill."""

BLOCK = 1 << 15
"""Texels whose cells are found in one go: 1 MB of places and normals."""


@dataclass(frozen=True, eq=False)
class GatherPoints:
    """P points and the cells that they stand for.

    Attributes:
        texel: (P,) int64, the texel each stands at
        width: (P,) float32, m, of its cell
        nearest: (P,) float32, m, to the nearest surface seen
        cell: (T,) int32, point of the cell that a texel lies in, -1 for texels without light
    """

    texel: Int64
    width: Float32
    nearest: Float32
    cell: Int32

    @property
    def count(self) -> int:
        return len(self.texel)

    @property
    def crowded(self) -> Bools:
        """(P,) bool, other surfaces come close, so that texels of a cell may see what its point does not."""
        return np.asarray(self.nearest < self.width * np.float32(CROWDED))


class Eyes(Protocol):
    """What looks around from texels (Q,)."""

    def look(self, chosen: Int64, fine: Bools) -> Fractions[tuple[Float32, Float32, Float32]]:
        """Scale over which light changes and least distance of what is seen, m, and light received; all (Q,).

        Points that are `fine` (Q,), the last ones, need not look as hard as the others.
        """

    def clearance(self, chosen: Int64) -> Fractions[Float32]:
        """Distance (Q,), m, to the next surface along the normal."""


def coarsest_width(wanted: float, texel_width: float) -> float:
    """The width next to `wanted` from which halving leads to the narrowest cells."""
    finest = FINEST * texel_width
    return float(finest * 2.0 ** max(0, round(np.log2(wanted / finest))))


def cell_keys(texels: Texels, chosen: Int32 | Int64, width: float, workers: int) -> Fractions[Int64]:
    """One number for each texel (C,), equal within a cell of `width`, m, a facing and a connected surface."""
    component = texels.surfaces.component

    def names(part: Int32, facing: Float32, place: Float32) -> Int64:
        """(7, R) whole numbers that are alike within a cell."""
        turned, cube = np.rint(facing * np.float32(FACINGS)), np.floor(place / np.float32(width))
        return np.concatenate([part[None], turned.T, cube.T]).astype(np.int64)

    def of(start: int, stop: int) -> tuple[Int32, Float32, Float32]:
        block = chosen[start:stop]
        part = component.take(texels.triangle[block])
        return part, texels.shading_normal.take(block, axis=0), texels.position.take(block, axis=0)

    def reach(start: int, stop: int) -> list[Any]:
        part, facing, place = of(start, stop)
        return [extremes(part[:, None]), extremes(facing), extremes(place)]

    found = yield from scaled(in_chunks(reach, len(chosen), BLOCK, workers), 0, 0.5)
    if not found:
        return np.zeros(0, np.int64)
    # rounding keeps the order, so the ends of what is rounded are those of the whole numbers
    part, facing, place = (extremes(np.concatenate(each)) for each in zip(*found, strict=True))
    low, high = names(part[:, 0], facing, place).T
    keys = np.zeros(len(chosen), np.int64)

    def name(start: int, stop: int) -> None:
        key = keys[start:stop]
        for part, least, most in zip(names(*of(start, stop)), low, high, strict=True):
            key *= most - least + 1
            key += part
            key -= least

    yield from scaled(in_chunks(name, len(chosen), BLOCK, workers), 0.5, 1)
    return keys


def place_points(
    texels: Texels, lit: Bools, base: float, near: float, texel_width: float, eyes: Eyes, workers: int = 1
) -> Fractions[GatherPoints]:
    """Choose gather points among the texels `lit` (T,), starting from cells `base` metres wide.

    Args:
        near: a cell is split while it is wider than this share of the scale at its point
    """
    cell = np.full(texels.count, -1, np.int32)
    at_texel = np.full(texels.count, -1, np.int32)
    places: list[Int64] = []
    widths = scale = nearest = light = np.zeros(0, np.float32)
    open_texels = numbers_of(lit)
    folded = np.zeros(texels.count, bool)
    for level in range(LEVELS):
        if not len(open_texels):
            break
        width = base / 2**level
        finest = width < 1.5 * FINEST * texel_width
        last = width < 0.75 * FINEST * texel_width
        thickness = max(LAYER * width, THINNEST * texel_width)
        finding = _cells(texels, open_texels, width, thickness, workers)
        cells = yield from scaled(finding, level / LEVELS, level / LEVELS)
        members, begin, size = cells.members, cells.begin, cells.size
        point = np.maximum.reduceat(at_texel[members], begin)
        new = np.flatnonzero(point < 0)
        fine = np.full(len(new), level >= FINE_LEVEL)
        fresh = members[begin[new] + size[new] // 2].astype(np.int64)
        point[new] = len(widths) + np.arange(len(new), dtype=np.int32)
        at_texel[fresh] = point[new]
        seen = yield from scaled(eyes.look(fresh, fine), level / LEVELS, (level + 1) / LEVELS)
        scale, nearest, light = (np.concatenate(pair) for pair in zip((scale, nearest, light), seen, strict=True))
        widths = np.concatenate([widths, np.zeros(len(new), np.float32)])
        places.append(fresh)
        widths[point] = width
        cell[members] = np.repeat(point, size)
        if last:
            break
        folded[members[np.repeat(cells.bent, size)]] = True
        split = (cells.bent | (width > near * scale[point])) & (size > (1 if finest else SMALLEST))
        if finest:
            split &= folded[members[begin]] | (width > NOOK * scale[point])
        dark = split & (light[point] <= DARK * light.mean())
        if dark.any():
            asked = np.flatnonzero(np.repeat(dark, size))
            clear = np.zeros(len(members), np.float32)
            clear[asked] = yield from scaled(
                eyes.clearance(members[asked].astype(np.int64)), (level + 1) / LEVELS, (level + 1) / LEVELS
            )
            split &= ~dark | (np.maximum.reduceat(clear, begin) > HIDDEN * width)
        open_texels = np.sort(members[np.repeat(split, size)])
    texel = np.concatenate(places) if places else np.zeros(0, np.int64)
    return GatherPoints(texel, widths.astype(np.float32), nearest.astype(np.float32), cell)


def part_at_walls(
    points: GatherPoints, texels: Texels, walls: Walls, eyes: Eyes, visibility: Visibility, workers: int
) -> Fractions[GatherPoints]:
    """Give the texels of each cell that its point can't see a point of their own.

    Cells of which little is left, between layers or walls, become as narrow, so that the fit looks no farther.
    """
    first = np.append(points.crowded, False)[points.cell]  # folds part cells as walls do
    first |= walls.border
    parting = part_cells(points.cell, points.texel, first, texels, visibility, workers)
    cell, seat = yield from scaled(parting, 0, 0.5)
    new = seat[points.count :]
    width = points.width[points.cell[new]]
    _, nearest, _ = yield from scaled(eyes.look(new, np.ones(len(new), bool)), 0.5, 1)
    widths = np.concatenate([points.width, width])
    inside = numbers_of(cell >= 0)
    area = np.bincount(cell[inside], texels.area[inside], len(seat))
    halvings = np.log2(widths / np.sqrt(np.maximum(area, 1e-30)) / FILLED)
    widths *= np.float32(0.5) ** np.clip(np.floor(halvings), 0, LEVELS).astype(np.float32)
    return GatherPoints(seat, widths, np.concatenate([points.nearest, nearest]), cell)


@dataclass(frozen=True, eq=False)
class _Cells:
    """C cells: texels `members`, those of cell i from begin[i], size[i] of them; `bent` if their normals differ."""

    members: Int32 | Int64
    begin: Int64
    size: Int64
    bent: Bools


def _cells(texels: Texels, chosen: Int32 | Int64, width: float, thickness: float, workers: int) -> Fractions[_Cells]:
    keys = yield from scaled(cell_keys(texels, chosen, width, workers), 0, 0.5)
    members, begin, size = _grouped(chosen, keys)
    del keys
    ends = begin + size
    cuts = [*np.unique(np.searchsorted(ends, np.arange(0, len(members), BLOCK))), len(begin)]

    def work(start: int, stop: int) -> _Cells:
        first, last = cuts[start], cuts[stop]
        own = slice(int(begin[first]), int(ends[last - 1]))
        return _layers(texels, members[own], begin[first:last] - own.start, size[first:last], thickness)

    parts = yield from scaled(in_chunks(work, len(cuts) - 1, 1, workers), 0.5, 1)
    if not parts:
        return _Cells(members, begin, size, np.zeros(0, bool))
    size, bent = (np.concatenate([getattr(part, name) for part in parts]) for name in ("size", "bent"))
    return _Cells(np.concatenate([part.members for part in parts]), np.cumsum(size) - size, size, bent)


def _layers(texels: Texels, members: Int32 | Int64, begin: Int64, size: Int64, thickness: float) -> _Cells:
    """Cells as they are given, or parted where they have more than one layer."""
    owner = np.repeat(np.arange(len(begin)), size)
    share = (1 / size[:, None]).astype(np.float32)
    normal = np.add.reduceat(texels.shading_normal.take(members, axis=0), begin, axis=0) * share
    position = texels.position.take(members, axis=0)
    centre = np.add.reduceat(position, begin, axis=0) * share
    height = dots(position - centre.take(owner, axis=0), normal.take(owner, axis=0))
    layer = np.rint(height / np.float32(thickness)).astype(np.int64)
    if layer.any():
        members, begin, size = _grouped(members, mixed_radix(owner, layer))
        share = (1 / size[:, None]).astype(np.float32)
        normal = np.add.reduceat(texels.shading_normal.take(members, axis=0), begin, axis=0) * share
    return _Cells(members, begin, size, np.sqrt(dots(normal, normal)) < 1 - SPLIT_BEND)


def _grouped(chosen: Int32 | Int64, keys: Int64) -> tuple[Int32 | Int64, Int64, Int64]:
    order = np.argsort(keys, kind="stable")
    members = chosen[order]
    np.take(keys, order, out=order)
    begin = np.flatnonzero(np.concatenate([[True], order[1:] != order[:-1]]))
    return members, begin, np.diff(np.append(begin, len(order)))
