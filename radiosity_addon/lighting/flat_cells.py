# SPDX-License-Identifier: GPL-3.0-or-later
"""Texels that lie flat on planes, in rectangles that are halved again and again until few texels are left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float32, Int64
from ..geometry.coverage import ragged
from ..geometry.surfaces import PLANES_APART
from ..geometry.texels import Texels
from .lamp_samples import basis, dot, rows_of

ALIKE = np.float32(1 - 1e-6)
"""Least cosine between the shading normal of a texel and its plane's: 1.4 mrad."""

CHUNK = 1 << 14
"""Texels treated in one go."""


@dataclass(frozen=True, eq=False)
class Rectangles:
    """N rectangles, each on a plane.

    Attributes:
        start, stop: (N,) int64, where the texels of each begin and end
        halves: (N,) int64, the first of its halves, the other is the next one; -1 for none
        middle, half: (N, 2) float32, m, centre and half the edges, on the plane
        plane: (N,) int64
    """

    start: Int64
    stop: Int64
    halves: Int64
    middle: Float32
    half: Float32
    plane: Int64


@dataclass(frozen=True, eq=False)
class FlatCells:
    """Rectangles about the K texels that lie flat on M planes. Those of whole planes come first.

    Attributes:
        order: (K,) int64, the texels; those of a rectangle are neighbours
        place: (2, K) float32, m, where they lie on their plane
        cells: the rectangles
        normal, along, across: (M, 3) float32, unit, of the planes
        height: (M,) float32, m, of the planes over the origin
        others: texels that lie in none
    """

    order: Int64
    place: Float32
    cells: Rectangles
    normal: Float32
    along: Float32
    across: Float32
    height: Float32
    others: Int64

    @classmethod
    def of(cls, texels: Texels, least: int) -> FlatCells:
        """The rectangles of all planes with at least so many texels, none with fewer."""
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
            position = rows_of(texels.position[order[part]])
            for own, axis in zip(place, (along, across), strict=True):
                own[part] = dot(position, rows_of(axis[plane[part]]))
        cells = _halved(order, place, first, plane[first], least)
        return cls(order, place, cells, normal, along, across, height, others)

    def texels(self, cells: Int64) -> tuple[Int64, Int64]:
        """Where the texels of rectangles (C,) are in `order`, (P,), and of which of them they are, (P,)."""
        start = self.cells.start[cells]
        length = self.cells.stop[cells] - start
        return ragged(start, length), np.repeat(np.arange(len(cells)), length)

    def at(self, cells: Int64, places: Float32) -> Float32:
        """Points (C, P, 3), m, at places (P, 2) of rectangles (C,), each -1 to 1."""
        plane = self.cells.plane[cells]
        place = self.cells.middle[cells][:, None] + self.cells.half[cells][:, None] * places
        points: Float32 = (self.normal[plane] * self.height[plane][:, None])[:, None]
        for k, axis in enumerate((self.along, self.across)):
            points = points + axis[plane][:, None] * place[:, :, k : k + 1]
        return points

    def balls(self, cells: Int64) -> tuple[Float32, Float32]:
        """Centres (C, 3) and radii (C,), m, of balls about rectangles (C,)."""
        half = self.cells.half[cells]
        return self.at(cells, np.zeros((1, 2), np.float32))[:, 0], np.sqrt(np.einsum("ij,ij->i", half, half))


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


def _halved(order: Int64, place: Float32, start: Int64, plane: Int64, least: int) -> Rectangles:
    """Rectangles about texels at places (2, K), which begin at `start` on each plane; both are sorted as they part."""
    stop = np.append(start[1:], len(order))
    found: list[tuple[Int64, Int64, Int64, Float32, Float32, Int64]] = []
    number = 0
    while len(start):
        length = stop - start
        index = ragged(start, length)
        begin = np.cumsum(length) - length
        own = place[:, index]
        low: Float32 = np.minimum.reduceat(own, begin, axis=1).T
        high: Float32 = np.maximum.reduceat(own, begin, axis=1).T
        middle: Float32 = (low + high) * np.float32(0.5)
        half: Float32 = (high - low) * np.float32(0.5)
        cell = np.repeat(np.arange(len(start)), length)
        axis = np.argmax(half, axis=1)
        upper = own[axis[cell], np.arange(len(index))] > middle[np.arange(len(start)), axis][cell]
        lower = length - np.add.reduceat(upper, begin, dtype=np.int64)
        parted = (length >= 2 * least) & (lower > 0) & (lower < length)
        rank = np.cumsum(upper)
        rank -= (rank[begin] - upper[begin])[cell]
        target = start[cell] + np.where(upper, lower[cell] + rank - 1, np.arange(len(index)) - begin[cell] - rank)
        order[target] = order[index]
        place[:, target] = own
        number += len(start)
        found.append((start, stop, np.where(parted, number + 2 * (np.cumsum(parted) - 1), -1), middle, half, plane))
        cut = start[parted] + lower[parted]
        start, stop = np.stack([start[parted], cut], axis=1).ravel(), np.stack([cut, stop[parted]], axis=1).ravel()
        plane = np.repeat(plane[parted], 2)
    if not found:
        none, nowhere = np.zeros(0, np.int64), np.zeros((0, 2), np.float32)
        return Rectangles(none, none, none, nowhere, nowhere, none)
    return Rectangles(*(np.concatenate(parts) for parts in zip(*found, strict=True)))
