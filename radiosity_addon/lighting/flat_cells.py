# SPDX-License-Identifier: GPL-3.0-or-later
"""Texels that lie flat on planes, in rectangles that are halved again and again until few texels are left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float32, Int64
from ..chunks import Fractions, in_chunks
from ..columns import vectors_at
from ..geometry.coverage import ragged
from ..geometry.surfaces import PLANES_APART
from ..geometry.texels import Texels
from .lamp_samples import basis, dot, rows_of

ALIKE = np.float32(1 - 1e-6)
"""Least cosine between the shading normal of a texel and its plane's: 1.4 mrad."""

CHUNK = 1 << 14
"""Texels treated in one go."""

HALVED = 16
"""Rectangles halved in one go."""


@dataclass(frozen=True, eq=False)
class Rectangles:
    """N rectangles, each on a plane.

    Attributes:
        start, stop: (N,) int64, where the texels of each begin and end
        middle, half: (N, 2) float32, m, centre and half the edges, on the plane
        plane: (N,) int64
        number: (N,) int64, which of those of `FlatCells.known` they are
    """

    start: Int64
    stop: Int64
    middle: Float32
    half: Float32
    plane: Int64
    number: Int64

    @property
    def length(self) -> Int64:
        """Texels (N,) of each."""
        return self.stop - self.start

    @property
    def wide(self) -> Bools:
        """Which (N,) have an extent, so that both their halves have texels."""
        wide: Bools = self.half.max(axis=1, initial=0) > np.float32(1e-6) * np.abs(self.middle).max(axis=1, initial=0)
        return wide

    def only(self, chosen: Int64 | Bools | slice) -> Rectangles:
        """Those that are chosen."""
        return Rectangles(*(part[chosen] for part in vars(self).values()))

    @classmethod
    def joined(cls, parts: Sequence[Rectangles]) -> Rectangles:
        """Those of all parts, one or more, in order."""
        return cls(*(np.concatenate(each) for each in zip(*(vars(part).values() for part in parts), strict=True)))


@dataclass(eq=False)
class FlatCells:
    """The K texels that lie flat on M planes, and rectangles about them, from those about whole planes on.

    Rectangles are halved when that is asked for the first time.

    Attributes:
        order: (K,) int64, the texels; those of a rectangle are neighbours
        place: (2, K) float32, m, where they lie on their plane
        known: R rectangles, first those of whole planes
        first_half: (R,) int64, numbers of their first halves, each before the second; -1 for those not halved yet
        normal, along, across: (M, 3) float32, unit, of the planes
        height: (M,) float32, m, of the planes over the origin
        others: texels that lie in none
    """

    order: Int64
    place: Float32
    known: Rectangles
    first_half: Int64
    normal: Float32
    along: Float32
    across: Float32
    height: Float32
    others: Int64

    @classmethod
    def of(cls, texels: Texels, least: int) -> FlatCells:
        """Those of all planes with at least so many texels."""
        plane = _planes(texels)
        kept = np.bincount(plane + 1)[1:] >= least
        plane = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)[plane]
        others = np.flatnonzero((plane < 0) & texels.valid)
        order = np.argsort(plane, kind="stable")[np.count_nonzero(plane < 0) :]
        plane = plane[order]
        first = np.flatnonzero(np.diff(plane, prepend=-1))
        normal = texels.surfaces.normal[texels.triangle[order[first]]]
        along, across = (np.ascontiguousarray(axis.T) for axis in basis(rows_of(normal)))
        height = np.einsum("ij,ij->i", normal, texels.position[order[first]])
        place = np.empty((2, len(order)), np.float32)
        for begin in range(0, len(order), CHUNK):
            part = slice(begin, begin + CHUNK)
            position = vectors_at(texels.position, order[part]).T
            for own, axis in zip(place, (along, across), strict=True):
                own[part] = dot(position, rows_of(axis[plane[part]]))
        whole = _about(place, first, np.append(first[1:], len(order))[: len(first)], plane[first], 0)
        return cls(order, place, whole, np.full(len(first), -1), normal, along, across, height, others)

    @property
    def whole(self) -> Rectangles:
        """The rectangles of all planes."""
        return self.known.only(slice(len(self.normal)))

    def texels(self, cells: Rectangles) -> tuple[Int64, Int64]:
        """Where the texels of C rectangles are in `order`, (P,), and of which of them they are, (P,)."""
        return ragged(cells.start, cells.length), np.repeat(np.arange(len(cells.start)), cells.length)

    def at(self, cells: Rectangles, places: Float32) -> Float32:
        """Points (C, P, 3), m, at places (P, 2) of C rectangles, each -1 to 1."""
        place = cells.middle[:, None] + cells.half[:, None] * places
        points: Float32 = (self.normal[cells.plane] * self.height[cells.plane][:, None])[:, None]
        for k, axis in enumerate((self.along, self.across)):
            points = points + axis[cells.plane][:, None] * place[:, :, k : k + 1]
        return points

    def balls(self, cells: Rectangles) -> tuple[Float32, Float32]:
        """Centres (C, 3) and radii (C,), m, of balls about C rectangles."""
        half = cells.half
        return self.at(cells, np.zeros((1, 2), np.float32))[:, 0], np.sqrt(np.einsum("ij,ij->i", half, half))

    def halves(self, cells: Rectangles, workers: int) -> Fractions[Rectangles]:
        """The two halves (2 C) across the longer edge of each of C rectangles."""
        whole = cells.only(self.first_half[cells.number] < 0)

        def halve(first: int, last: int) -> Rectangles:
            return self._halved(whole.only(slice(first, last)), len(self.known.start) + 2 * first)

        parts = yield from in_chunks(halve, len(whole.start), HALVED, workers)
        self.first_half[whole.number] = len(self.known.start) + 2 * np.arange(len(whole.start))
        self.first_half = np.append(self.first_half, np.full(2 * len(whole.start), -1))
        self.known = Rectangles.joined([self.known, *parts])
        return self.known.only((self.first_half[cells.number][:, None] + np.arange(2)).ravel())

    def _halved(self, cells: Rectangles, number: int) -> Rectangles:
        """The halves of rectangles, by `number` and on, whose texels are sorted for it."""
        index, cell = self.texels(cells)
        begin = np.cumsum(cells.length) - cells.length
        place = self.place[:, index]
        axis = np.argmax(cells.half, axis=1)
        across = np.where(axis[cell] > 0, place[1], place[0])
        upper = across > np.where(axis > 0, cells.middle[:, 1], cells.middle[:, 0])[cell]
        cut = cells.stop - np.add.reduceat(upper, begin, dtype=np.int64)
        rank = np.cumsum(upper)
        rank -= (rank[begin] - upper[begin])[cell]
        target = np.where(upper, cut[cell] + rank - 1, index - rank)
        self.order[target] = self.order[index]
        self.place[:, target] = place
        start, stop = np.stack([cells.start, cut], axis=1).ravel(), np.stack([cut, cells.stop], axis=1).ravel()
        return _about(self.place, start, stop, np.repeat(cells.plane, 2), number)


def _about(place: Float32, start: Int64, stop: Int64, plane: Int64, number: int) -> Rectangles:
    """Rectangles about places (2, K) from `start` to `stop`, (N,), by `number` and on."""
    numbers = number + np.arange(len(start))
    own = place[:, ragged(start, stop - start)]
    if not len(start):
        return Rectangles(start, stop, own.T, own.T, plane, numbers)
    begin = np.cumsum(stop - start) - (stop - start)
    low: Float32 = np.minimum.reduceat(own, begin, axis=1).T
    high: Float32 = np.maximum.reduceat(own, begin, axis=1).T
    return Rectangles(start, stop, (low + high) * np.float32(0.5), (high - low) * np.float32(0.5), plane, numbers)


def _planes(texels: Texels) -> Int64:
    """The plane (T,) that each texel lies flat on, by its number in `Surfaces.plane`; -1 for none."""
    surfaces = texels.surfaces
    plane = np.full(texels.count, -1, np.int64)
    for start in range(0, texels.count, CHUNK):
        part = slice(start, min(start + CHUNK, texels.count))
        triangle = texels.triangle[part]
        normal = surfaces.normal[triangle]
        rise = np.einsum("ij,ij->i", texels.position[part] - surfaces.corners[triangle, 0], normal)
        flat = np.abs(rise) < np.float32(PLANES_APART * surfaces.radius)
        flat &= np.einsum("ij,ij->i", texels.shading_normal[part], normal) > ALIKE
        flat &= texels.valid[part]
        plane[part] = np.where(flat, surfaces.plane[triangle], -1)
    return plane
