# SPDX-License-Identifier: GPL-3.0-or-later
"""Nodes: texels that speak for those around them where light varies slowly.

A node stands for texels of a cell of a world-space grid that face as it does and see it across the surface. What is
known at nodes is known at texels by a first-order fit over the nodes around them, the same for every quantity.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from ..arrays import Bools, Float32, Int32, Int64
from ..chunks import Fractions, in_chunks
from ..columns import vectors_at
from ..geometry.coverage import ragged
from ..geometry.texels import Texels
from ..geometry.visibility import Visibility
from ..geometry.walls import hidden
from .lamp_samples import basis, dot, rows_of

AROUND = 12
"""Nodes around a node that count for its texels, at most; on a flat surface eight cells are beside its own."""

ALIKE = 0.9
"""Least cosine between normals of a texel and a node that counts for it (26 degrees)."""

LEVEL = 0.3
"""Nodes count that lie within this share of the distance off the tangent plane."""

ROUNDS = 6
"""Nodes of a cell, at most: surfaces on both sides of a wall, of a fold, of a step, and what bends within it."""

REACH = 2.0
"""A node counts for texels within this many widths of its cell."""

RIDGE = 0.01
"""Added to the variance of the nodes' places, in widths squared, so that few nodes make no steep fits."""

CHUNK = 1 << 12
"""Texels fitted in one go: their nodes take 0.2 MB a temporary."""

PLACE_BITS = 18
"""Bits of a cell's place along an axis. Cells 2^18 apart would be one; they don't see each other."""


@dataclass(frozen=True, eq=False)
class LightNodes:
    """N nodes.

    Attributes:
        texel: (N,) int64, where each stands
        width: (N,) float32, m, of its cell
        near: (N, 1 + AROUND) int32, itself, those around it, then itself again as padding
        count: (N,) int32, how many of them count
        alone: texels that no node speaks for
        texels: all texels
    """

    texel: Int64
    width: Float32
    near: Int32
    count: Int32
    alone: Int64
    texels: Texels
    _of_texel: Int32
    _members: Int64
    _start: Int64

    @property
    def number(self) -> int:
        return len(self.texel)

    def members(self, chosen: Bools) -> tuple[Int64, Int32]:
        """The texels (P,) that chosen (N,) nodes speak for, in page order, and their nodes (P,)."""
        nodes = np.flatnonzero(chosen)
        texels = np.sort(self._members[ragged(self._start[nodes], self._start[nodes + 1] - self._start[nodes])])
        return texels, self._of_texel[texels]

    def add(self, values: Float32, first: int, total: Float32) -> None:
        """Add to texels' `total` (T, ...) what is known for them at nodes.

        Args:
            values: (M, 1 + AROUND, ...) float32, for texels of the nodes from `first` on, at the nodes `near` them
        """
        texels = self._members[self._start[first] : self._start[first + len(values)]]
        values = values.reshape(*values.shape[:2], -1)
        for start in range(0, len(texels), CHUNK):
            part = texels[start : start + CHUNK]
            own = values[self._of_texel[part] - first]
            found = np.einsum("ijk,ij->ik", own, self._weights(part))
            total[part] += found.reshape(len(part), *total.shape[1:])

    def _weights(self, texels: Int64) -> Float32:
        """Weights (P, 1 + AROUND) of nodes in a plane fitted around each texel (P,); they add up to 1."""
        node = self._of_texel[texels]
        near = self.near[node]
        places = vectors_at(self.texels.position, texels).T
        normal = rows_of(self.texels.normal.take(texels))
        gap = [self._place[k].take(near) - places[k][:, None] for k in range(3)]
        s, t, off = (
            dot(gap, [row[:, None] for row in axis]) / self.width[node][:, None] for axis in (*basis(normal), normal)
        )
        weight = 1 - (s * s + t * t + off * off) * np.float32(REACH**-2)
        np.maximum(weight, np.float32(1e-3), out=weight)
        weight *= weight
        weight *= np.arange(near.shape[1]) < self.count[node][:, None]
        weight /= weight.sum(1)[:, None]
        s_mean, t_mean = ((weight * part).sum(1) for part in (s, t))
        s -= s_mean[:, None]
        t -= t_mean[:, None]
        a, b, c = ((weight * square).sum(1) for square in (s * s, s * t, t * t))
        a += np.float32(RIDGE)
        c += np.float32(RIDGE)
        determinant = a * c - b * b
        along = (c * s_mean - b * t_mean) / determinant
        across = (a * t_mean - b * s_mean) / determinant
        weight *= 1 - along[:, None] * s - across[:, None] * t
        return weight

    @cached_property
    def _place(self) -> Float32:
        return vectors_at(self.texels.position, self.texel).T


def place_nodes(texels: Texels, visibility: Visibility, spacing: float, workers: int) -> Fractions[LightNodes]:
    """Nodes about `spacing` texels apart."""
    width, key = _cells(texels, spacing)
    of_texel = np.full(texels.count, -1, np.int32)
    left = np.flatnonzero(texels.valid)
    places: list[Int64] = []
    number = 0
    for turn in range(ROUNDS):
        standing, owner = _middles(texels, key, left)
        places.append(standing)
        heard = np.concatenate((yield from _heard(texels, left, standing[owner], visibility, workers)) or [left > 0])
        of_texel[left[heard]] = number + owner[heard]
        number += len(standing)
        left = left[~heard]
        yield 0.6 * (turn + 1) / ROUNDS
    node = np.concatenate(places)
    order = np.argsort(of_texel, kind="stable")
    start = np.searchsorted(of_texel[order], np.arange(len(node) + 1))
    cell = width[node]
    near, count = yield from _find_near(texels, node, key[node], cell, visibility, workers)
    return LightNodes(node, cell, near, count, left, texels, of_texel, order, start)


def _cells(texels: Texels, spacing: float) -> tuple[Float32, Int64]:
    """Width (T,), m, and number (T,) of the cell of each texel. Widths are powers of 2: neighbours share their grid."""
    lookup = texels.lookup.astype(np.float64)
    each = 2 * texels.surfaces.area / np.maximum(np.abs(lookup[2] * lookup[5] - lookup[3] * lookup[4]), 1e-12)
    level = np.round(np.log2(np.maximum(spacing * np.sqrt(each), 1e-6))).astype(np.int64)
    triangle = texels.triangle[:]
    width = np.ldexp(np.float32(1), level.astype(np.int32))[triangle].astype(np.float32)
    normal = texels.normal[:]
    facing = np.abs(normal).argmax(1)
    key = level[triangle] & 31
    key = key * 8 + 2 * facing + (np.take_along_axis(normal, facing[:, None], axis=1)[:, 0] < 0)
    for places in texels.position.T:
        key <<= PLACE_BITS
        key |= np.floor(places / width).astype(np.int64) & ((1 << PLACE_BITS) - 1)
    return width, key


def _middles(texels: Texels, key: Int64, chosen: Int64) -> tuple[Int64, Int64]:
    """Texels nearest the middle of those of each cell among the chosen (C,), and the number (C,) of its cell."""
    cells, owner = np.unique(key[chosen], return_inverse=True)
    owner = owner.reshape(-1)
    size = np.bincount(owner, minlength=len(cells))
    square = np.zeros(len(chosen))
    for places in texels.position.T:
        own = places[chosen].astype(np.float64)
        square += (own - (np.bincount(owner, own, len(cells)) / np.maximum(size, 1))[owner]) ** 2
    order = np.lexsort((square, owner))
    return chosen[order[np.searchsorted(owner[order], np.arange(len(cells)))]], owner


def _heard(
    texels: Texels, here: Int64, there: Int64, visibility: Visibility, workers: int
) -> Generator[float, None, list[Bools]]:
    """Which texels (C,) face as those `there` and see them, in chunks."""

    def work(start: int, stop: int) -> Bools:
        one, other = here[start:stop], there[start:stop]
        alike = np.einsum("ij,ij->i", texels.normal[one], texels.normal[other]) > ALIKE
        some = np.flatnonzero(alike)
        alike[some[hidden(texels, one[some], other[some], visibility)]] = False
        return np.asarray(alike)

    return (yield from in_chunks(work, len(here), 1 << 14, workers))


def _find_near(
    texels: Texels, node: Int64, key: Int64, width: Float32, visibility: Visibility, workers: int
) -> Fractions[tuple[Int32, Int32]]:
    """The nodes that count for each node's texels, as `LightNodes` has them."""
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    mask = (1 << PLACE_BITS) - 1
    place = [(key >> (PLACE_BITS * k)) & mask for k in (2, 1, 0)]
    rest = key >> (3 * PLACE_BITS)
    ones, others = [], []
    for step in product((-1, 0, 1), repeat=3):
        sought = rest
        for own, along in zip(place, step, strict=True):
            sought = (sought << PLACE_BITS) | ((own + along) & mask)
        begin, end = np.searchsorted(ordered, sought, "left"), np.searchsorted(ordered, sought, "right")
        ones.append(np.repeat(np.arange(len(node)), end - begin))
        others.append(order[ragged(begin, end - begin)])
    one, other = np.concatenate(ones), np.concatenate(others)
    gap = texels.position[node[other]] - texels.position[node[one]]
    distance = np.sqrt(np.einsum("ij,ij->i", gap, gap))
    height = np.abs(np.einsum("ij,ij->i", gap, texels.normal[node[one]]))
    kept = (one != other) & (distance < np.float32(REACH) * width[one]) & (height <= np.float32(LEVEL) * distance)
    one, other, distance = one[kept], other[kept], distance[kept]
    seen = yield from _heard(texels, node[one], node[other], visibility, workers)
    kept = np.concatenate(seen or [one > 0])
    one, other, distance = one[kept], other[kept], distance[kept]
    order = np.lexsort((distance, one))
    one, other = one[order], other[order]
    rank = np.arange(len(one)) - np.searchsorted(one, one)
    one, other, rank = one[rank < AROUND], other[rank < AROUND], rank[rank < AROUND]
    near = np.repeat(np.arange(len(node), dtype=np.int32)[:, None], 1 + AROUND, axis=1)
    near[one, 1 + rank] = other
    return near, 1 + np.bincount(one, minlength=len(node)).astype(np.int32)
