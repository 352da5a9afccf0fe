# SPDX-License-Identifier: GPL-3.0-or-later
"""Patches: groups of texels between which light is transported, the finite elements of the method.

Texels are grouped by cells of a world-space grid, so patches follow the surface and the wanted fineness, not the
modeller's triangles or the borders of charts. Surfaces that can be seen from behind have patches of that side too.

What a ray meets is an "element": a texel's front (0 .. T - 1), the back of patch i (T + i), the sky, or nothing
that takes part. One table of radiances, indexed by element, then serves every ray.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float32, Float64, Int32, Int64
from ..chunks import finish
from ..columns import extremes
from ..geometry.by_triangle import ByTriangle
from ..geometry.opacity import Opacity
from ..geometry.sides import seen_side
from ..geometry.surfaces import BLOCK
from ..geometry.texels import Texels
from ..geometry.visibility import Hits, Visibility
from ..geometry.walls import Walls, hidden, part_cells
from ..indices import numbers_of
from ..sampling import even_uniform
from .patch_strata import PatchStrata, sending

SKY = -1
"""A ray that left the scene."""

NOTHING = -2
"""A ray that met something which takes no part: the inside of a solid, an invalid texel."""

BACK_COARSENESS = 2.0
"""Cells of back sides are this much wider: their light is seen only after one more bounce."""

LAYER = 0.1
"""Texels of a cell that lie this share of its width off its mean plane are a cell of their own: the front of one flank
of a folded sheet faces as the back of the next one does, and they may see a sun and a room."""

SUMMED = 1 << 16
"""Texels summed in one go: 0.5 MB a temporary."""

ORIGIN_DIMENSION = 2
"""Dimension of the sample sequence that spreads ray origins; directions take 0 and 1."""


@dataclass(frozen=True, eq=False)
class Patches:
    """N patches, front sides first.

    Attributes:
        area: (N,) float64, m2, that stops light: of a half clear patch half of what it covers
        reflectance: (N, 3) float32, mean over this area
        emission: (N, 3) float32, W/m2, exitance that is not sampled as a lamp
        of_element: (T + N,) int32, patch of each element; NOTHING for invalid texels
        back: (T,) int32, patch behind each texel, NOTHING for solids and two-sided meshes
        texels: the texels
        walls: where walls stand on them
        sides: (N,) float32, 1 for fronts, -1 for backs
        stopping: (T,) float32, m2, area of texels that stops light
        strata: the parts of texels that send light
    """

    area: Float64
    reflectance: Float32
    emission: Float32
    of_element: Int32
    back: Int32
    sides: Float32
    texels: Texels
    stopping: Float32
    walls: Walls
    strata: PatchStrata

    @property
    def count(self) -> int:
        return len(self.area)

    def origins(self, patches: Int64 | Int32, sample: Int64 | Int32) -> tuple[Float32, Float32]:
        """Points spread evenly over patches (R,), lifted off the surface, and unit normals; both (R, 3) float32, m."""
        surfaces = self.texels.surfaces
        points, triangle = self.texels.stratum_points(self.stratum(patches, sample))
        normals = surfaces.normals(triangle)
        if self.has_backs:
            normals *= self.sides.take(patches)[:, None]
        points += normals * np.float32(surfaces.offset)
        return points, normals

    def stratum(self, patches: Int64 | Int32, sample: Int64 | Int32) -> Int64 | Int32:
        """The strata (R,) that `origins` start from, numbered texel * 4 + slot."""
        number = self.strata.number.take(patches)
        chosen = (even_uniform(patches, sample, ORIGIN_DIMENSION) * number).astype(np.int32)
        np.minimum(chosen, number - 1, out=chosen)
        chosen += self.strata.start.take(patches)
        return self.strata.at(chosen)

    @property
    def has_backs(self) -> bool:
        return bool(len(self.sides) and self.sides[-1] < 0)

    def elements(self, hits: Hits) -> Int32:
        """The element (R,) that each ray met."""
        hits = seen_side(self.texels.surfaces, hits)
        found = self.texels.at(hits.triangle, hits.u, hits.v)
        beyond, beside = self.walls.beyond(self.texels, found, hits)
        found[beyond] = beside
        found[found < 0] = NOTHING
        behind = np.flatnonzero(~hits.front & (found >= 0))
        back = self.back[found[behind]]
        back[back >= 0] += np.int32(self.texels.count)
        found[behind] = back
        found[hits.triangle < 0] = SKY
        return found

    def at(self, hits: Hits) -> Int32:
        """The patch (R,) that each ray met, SKY or NOTHING."""
        element = self.elements(hits)
        met = self.of_element.take(element, mode="clip")
        beside = np.flatnonzero(element < 0)
        met[beside] = element[beside]
        return met

    def mean(self, values: Float32, share: Float32 | ByTriangle | None = None) -> Float64:
        """Area-weighted means (N, ..., 3) of texel values (T, ..., 3) over the front patches; 0 on backs.

        Args:
            share: (T, 3), of the values; None: all
        """
        front = self.of_element[: self.texels.count]
        means, area = np.zeros((self.count, values[:1].size)), np.zeros(self.count)
        taking = numbers_of((front >= 0) & (self.stopping > 0))
        for part in _parts(len(taking)):
            own = taking[part]
            found = values.take(own, axis=0)
            if share is not None:
                found = found * share.take(own, axis=0).reshape(-1, *(1,) * (values.ndim - 2), 3)
            owner, weight = front[own], self.stopping[own].astype(np.float64)
            _add_sums(means, owner, weight, found.reshape(len(own), -1))
            area += np.bincount(owner, weight, self.count)
        means /= np.maximum(area, 1e-30)[:, None]
        return means.reshape(self.count, *values.shape[1:])

    def any_texels(self) -> Int64:
        """One of each patch's texels (N,)."""
        texel: Int64 = np.zeros(self.count, np.int64)
        for patch in (self.back, self.of_element[: self.texels.count]):
            for start in range(0, len(patch), SUMMED):
                own = patch[start : start + SUMMED]
                there = np.flatnonzero(own >= 0)
                texel[own[there]] = start + there
        return texel


def group_patches(
    texels: Texels,
    walls: Walls,
    reflectance: Float32 | ByTriangle,
    emission: Float32 | ByTriangle,
    solid: Bools,
    target: int,
    visibility: Visibility,
    workers: int = 1,
    opacity: Opacity | None = None,
    levels: Int32 | None = None,
    rear: tuple[Float32 | ByTriangle, Float32 | ByTriangle] | None = None,
) -> Patches:
    """Group texels into about `target` patches, none of which lies on both sides of a wall.

    Texels that stop no light are in none.

    Args:
        reflectance: (T, 3) float32, of light that is stopped
        emission: (T, 3) float32, W/m2, exitance that is not sampled as a lamp, over the area that stops light
        solid: (F,) bool, triangles that nothing sees from behind
        opacity: what texels stop; None: everything
        levels: (T,) how often cells are halved at each texel, fronts alone; None: nowhere
        rear: reflectance and emission from behind; None: the same
    """
    stopping = texels.area if opacity is None else texels.area * opacity.share
    taking = numbers_of(texels.valid & (stopping > 0))
    extent = float(texels.area[taking].sum(dtype=np.float64))
    width = float(np.sqrt(extent / max(target, 1))) or 1.0
    hollow = ~(solid | texels.surfaces.two_sided)[texels.triangle[taking]]

    def parted(cell: Int32, count: int, chosen: Int32, first: Bools, side: int) -> tuple[Int32, int]:
        """Cells that no wall crosses."""
        seat = np.empty(count, np.int64)
        seat[cell] = chosen  # any of its texels
        whole = np.full(texels.count, -1, np.int32)
        whole[chosen] = cell
        whole, seat = finish(part_cells(whole, seat, first, texels, visibility, workers, side))
        return whole[chosen], len(seat)

    front, fronts = parted(*_cells(texels, taking, width, levels), taking, walls.border, 1)
    hollows = taking[hollow]
    some = _chessboard(texels)  # of backs: walls were looked for on fronts
    behind, backs = parted(*_cells(texels, hollows, width * BACK_COARSENESS), hollows, some, -1)
    behind += np.int32(fronts)
    count = fronts + backs

    del some, hollow
    area = np.zeros(count)
    light = np.zeros((2, count, 3))  # reflectance and emission
    shown = (reflectance, emission)
    for owner, texel, side in ((front, taking, shown), (behind, hollows, rear or shown)):
        for part in _parts(len(texel)):
            own, patch = texel[part], owner[part]
            weight = stopping[own].astype(np.float64)
            area += np.bincount(patch, weight, count)
            for total, values in zip(light, side, strict=True):
                _add_sums(total, patch, weight, values.take(own, axis=0))
    light /= np.maximum(area, 1e-30)[:, None]

    of_element = np.full(texels.count + count, NOTHING, np.int32)
    of_element[taking] = front
    of_element[texels.count :] = np.arange(count)
    _join_lonely(of_element, texels, visibility)
    back = np.full(texels.count, NOTHING, np.int32)
    back[hollows] = behind
    return Patches(
        area=area,
        reflectance=light[0].astype(np.float32),
        emission=light[1].astype(np.float32),
        of_element=of_element,
        back=back,
        sides=np.where(np.arange(count) < fronts, 1, -1).astype(np.float32),
        texels=texels,
        stopping=stopping,
        walls=walls,
        strata=PatchStrata.of([(front, taking), (behind, hollows)], sending(texels, opacity), count),
    )


def _chessboard(texels: Texels) -> Bools:
    """Every other texel (T,) of each row and column."""
    light = np.empty(texels.count, bool)
    for start in range(0, texels.count, BLOCK):
        row, column = np.divmod(texels.pixel[start : start + BLOCK], texels.size)
        light[start : start + BLOCK] = ((row + column) & 1) == 0
    return light


def _parts(count: int) -> Iterator[slice]:
    return (slice(start, start + SUMMED) for start in range(0, count, SUMMED))


def _add_sums(total: Float64, members: Int32, weight: Float64, values: Float32) -> None:
    """Add to sums (N, C) over members (K,) their weights (K,) times values (K, C)."""
    for column, each in enumerate(values.T):
        total[:, column] += np.bincount(members, weight * each, len(total))


def _cell_keys(texels: Texels, chosen: Int32, width: float, levels: Int32 | None) -> Int64:
    """One number for each texel (C,): equal for texels of one cell, facing, material and connected surface."""
    surfaces = texels.surfaces
    deepest = 0 if levels is None else int(levels.max(initial=0))
    coarse, width = width, width / 2**deepest
    least, most = extremes(surfaces.corners.reshape(-1, 3))
    low = np.floor(least / width).astype(np.int64) - 1
    sizes = np.floor(most / width).astype(np.int64) - low + 2
    label = surfaces.component.astype(np.int64) * (int(surfaces.material.max()) + 1) + surfaces.material
    keys = np.empty(len(chosen), np.int64)
    for start in range(0, len(chosen), BLOCK):
        own = chosen[start : start + BLOCK]
        triangle = texels.triangle[own]
        key = label.take(triangle)
        key *= 6
        key += _facing(*surfaces.normals(triangle).T)
        finest: Float32 | np.float32 = np.float32(width)
        if levels is not None:
            key = key * (deepest + 1) + levels[own]
            finest = (coarse / (1 << levels[own])).astype(np.float32)
        for place, least, size in zip(texels.position.take(own, axis=0).T, low, sizes, strict=True):
            key *= size
            key += np.floor(place / finest).astype(np.int64)
            key -= least
        keys[start : start + BLOCK] = key
    return keys


def _facing(x: Float32, y: Float32, z: Float32) -> Int64:
    """0 to 5: along which axis, forward or backward, normals (C,) point most."""
    wide, tall, deep = np.abs(x), np.abs(y), np.abs(z)
    axis = np.where(deep > np.maximum(wide, tall), 2, np.where(tall > wide, 1, 0))
    value = np.choose(axis, (x, y, z))
    return axis * 2 + (value < 0)


def mixed_radix(*parts: Int32 | Int64) -> Int64:
    """One number for each tuple of integers; 10^5 components x 10^3 materials x 6 facings x 10^8 cells fit."""
    key = np.zeros(len(parts[0]), np.int64)
    for part in parts:
        low = int(part.min(initial=0))
        key *= int(part.max(initial=0)) - low + 1
        key += part
        key -= low
    return key


def _cells(texels: Texels, chosen: Int32, width: float, levels: Int32 | None = None) -> tuple[Int32, int]:
    """Number of the cell of each chosen texel (C,), and how many cells there are."""
    cell, count = _numbered(_cell_keys(texels, chosen, width, levels))
    layer = _layers(texels, chosen, cell, count, width, levels)
    return _numbered(mixed_radix(cell, layer)) if layer.any() else (cell, count)


def _numbered(key: Int64) -> tuple[Int32, int]:
    """Number of each key (C,) in their order, and how many there are."""
    begin, length = _runs(key)
    names, number = np.unique(key[begin], return_inverse=True)
    return np.repeat(number.reshape(-1).astype(np.int32), length), len(names)


def _layers(texels: Texels, chosen: Int32, cell: Int32, count: int, width: float, levels: Int32 | None) -> Int32:
    """Layer of its cell (C,) that each chosen texel (C,) lies in, 0 about the mean plane."""
    blocks = [slice(start, start + SUMMED) for start in range(0, len(chosen), SUMMED)]
    sums = np.zeros((7, count))
    for part in blocks:
        own = chosen[part]
        sums[6] += np.bincount(cell[part], minlength=count)
        normals = texels.surfaces.normals(texels.triangle[own])
        for row, values in enumerate((*normals.T, *texels.position.take(own, axis=0).T)):
            sums[row] += np.bincount(cell[part], values, count)
    normal, centre = sums[:3], sums[3:6] / sums[6]
    normal /= np.maximum(np.sqrt((normal**2).sum(0)), 1e-30)
    level = (normal * centre).sum(0)
    layer = np.zeros(len(chosen), np.int32)
    for part in blocks:
        own, owner = chosen[part], cell[part]
        places = texels.position.take(own, axis=0).T
        height = sum(axis.take(owner) * along for axis, along in zip(normal, places, strict=True))
        height -= level.take(owner)
        finest = width if levels is None else width / (1 << levels[own])
        layer[part] = np.rint(height / (LAYER * finest))
    return layer


def _runs(values: Int64 | Int32) -> tuple[Int64, Int64]:
    """Where runs of equal values begin, and how long they are. Texels come row by row, so there are few to sort."""
    ends = np.flatnonzero(values[1:] != values[:-1]) + 1
    begin = np.append(0, ends)[: len(values)]
    return begin, np.diff(np.append(begin, len(values)))


def _join_lonely(of_element: Int32, texels: Texels, visibility: Visibility) -> None:
    """Give valid texels without area of their own, beside charts, the patch of a texel next to them that they see."""
    lonely = np.flatnonzero(texels.valid & (of_element[: texels.count] < 0))
    known = of_element[: texels.count].copy()
    last = len(texels.texel_at) - 1
    size = texels.size
    for step in (1, -1, size, -size, size + 1, size - 1, 1 - size, -1 - size):
        beside = texels.texel_at[np.clip(texels.pixel[lonely] + step, 0, last)]
        found = np.where(beside >= 0, known[beside], NOTHING)
        walled = np.flatnonzero(texels.crossed[lonely] & (found >= 0))
        found[walled[hidden(texels, lonely[walled], beside[walled], visibility)]] = NOTHING
        of_element[lonely] = np.where(of_element[lonely] < 0, found, of_element[lonely])
