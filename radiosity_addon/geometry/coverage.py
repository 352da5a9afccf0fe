# SPDX-License-Identifier: GPL-3.0-or-later
"""Which sub-texels and texels the charts of an atlas touch: scan lines inside charts, distances beside them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from ..arrays import Bools, Float32, Float64, Int32, Int64
from ..chunks import Fractions, in_chunks

PIECE = 4.0
"""Chart borders are cut into pieces of at most this many texels before they are widened."""

PIECES = 1 << 11
"""Pieces widened in one go: some 30 texels each, 0.5 MB a temporary."""

GRID = 64
"""Corners of a chart nearer than 1 / GRID texels count as one when its border is looked for."""

EDGE_MARGIN = 1e-5
"""Least barycentric weight of a stratum: a point on an edge may lie in the plane of a wall, and see past it."""

INSET = 0.05
"""Texels beside a chart stand this far inside its border, in texels: an edge shared with a wall is neither side."""


@dataclass(frozen=True, eq=False)
class Spans:
    """Runs of sub-texels: their triangle, line, first column and the one after the last, all (R,) int64."""

    triangle: Int64
    line: Int64
    left: Int64
    right: Int64


class ScanLines:
    """Which triangle covers each sub-texel centre (2 x 2 a texel), row by row.

    Spans are half-open: a centre on an edge that two triangles share belongs to exactly one.
    """

    def __init__(self, uv: Float64, page: Int32, size: int) -> None:
        """Triangles (F,) with corners `uv` (F, 3, 2), in texels, on pages (F,) of `size` texels."""
        fine = uv * 2
        limit = 2 * size
        x, y = fine[..., 0], fine[..., 1]
        low = np.clip(np.ceil(y.min(1, initial=limit) - 0.5), 0, limit).astype(np.int64)
        high = np.clip(np.ceil(y.max(1, initial=0) - 0.5), 0, limit).astype(np.int64)
        self._low, self._height = low, np.maximum(high - low, 0)
        self._ends = np.cumsum(self._height)
        self._width = np.maximum(np.ceil(x.max(1, initial=0) - x.min(1, initial=limit)), 1).astype(np.int64)
        self._edges = [self._edge(fine[:, k], fine[:, (k + 1) % 3]) for k in range(3)]
        b, c = fine[:, 1] - fine[:, 0], fine[:, 2] - fine[:, 0]
        determinant = b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0]
        scale = 1 / np.where(determinant != 0, determinant, np.inf)
        # u = (x - x0) * u_x + (y - y0) * u_y, v alike
        self._corner = fine[:, 0]
        self._gradient = np.stack([c[:, 1], -c[:, 0], -b[:, 1], b[:, 0]]) * scale
        self._page, self._size = page.astype(np.int64), size
        self.rows = int(self._ends[-1]) if len(self._ends) else 0

    @staticmethod
    def _edge(start: Float64, stop: Float64) -> Float64:
        """Rows (4, F): lowest y, highest y, x at the lowest, dx/dy."""
        upward = start[:, 1] <= stop[:, 1]
        below, above = np.where(upward, start.T, stop.T), np.where(upward, stop.T, start.T)
        rise = above[1] - below[1]
        return np.stack([below[1], above[1], below[0], (above[0] - below[0]) / np.where(rise > 0, rise, 1)])

    def cuts(self, samples: int) -> Int64:
        """Row numbers, from 0 to `rows`, between which lie at most about so many sub-texels."""
        ends = np.cumsum(self._height * self._width)
        targets = np.arange(0, int(ends[-1]) if len(ends) else 0, samples)
        triangle = np.searchsorted(ends, targets, side="right")
        into = (targets - (ends - self._height * self._width)[triangle]) // self._width[triangle]
        return np.append((self._ends - self._height)[triangle] + into, self.rows)

    def spans(self, start: int, stop: int) -> Spans:
        """What rows start to stop cover; empty ones are left out."""
        first = int(np.searchsorted(self._ends, start, side="right"))
        last = int(np.searchsorted(self._ends, stop - 1, side="right")) + 1
        begin = self._ends[first:last] - self._height[first:last]
        rows = np.minimum(self._ends[first:last], stop) - np.maximum(begin, start)
        repeat = partial(np.repeat, repeats=rows)
        line = np.arange(start, stop) - repeat(begin - self._low[first:last])
        y = line + 0.5
        left, right = np.full(len(y), np.inf), np.full(len(y), -np.inf)
        for edge in self._edges:
            bottom, top, x, slope = (repeat(part) for part in edge[:, first:last])
            crossed = (bottom <= y) & (y < top)
            x += (y - bottom) * slope
            np.minimum(left, x, out=left, where=crossed)
            np.maximum(right, x, out=right, where=crossed)
        limit = 2 * self._size
        left, right = (np.clip(np.ceil(x - 0.5), 0, limit) for x in (left, right))
        kept = np.flatnonzero(left < right)
        triangle = repeat(np.arange(first, last))[kept]
        return Spans(triangle, line[kept], left[kept].astype(np.int64), right[kept].astype(np.int64))

    def first_pixel(self, spans: Spans) -> Int64:
        """Pixel in which each span begins."""
        row: Int64 = self._page[spans.triangle] * self._size + (spans.line >> 1)
        return row * self._size + (spans.left >> 1)

    def pixels(self, spans: Spans) -> Int64:
        """Every pixel that a span touches."""
        number = ((spans.right - 1) >> 1) - (spans.left >> 1) + 1
        return ragged(self.first_pixel(spans), number)

    def samples(self, spans: Spans, texel: Int64) -> tuple[Int64, Int32, Float32]:
        """Number (K,), texel * 4 + slot, of every sub-texel, its triangle (K,) and barycentrics (K, 2).

        Args:
            texel: that of each span's first pixel; those of the next ones follow it
        """
        width = spans.right - spans.left
        column = ragged(spans.left, width)
        odd = column & 1
        number = np.repeat(4 * (texel - (spans.left >> 1)) + 2 * (spans.line & 1), width)
        number += 2 * column  # the column of a texel is half of it: 4 (column // 2) + odd
        number -= odd
        x = spans.left + 0.5 - self._corner[spans.triangle, 0]
        y = spans.line + 0.5 - self._corner[spans.triangle, 1]
        along = (column - np.repeat(spans.left, width)).astype(np.float32)
        weights = np.empty((len(column), 2), np.float32)
        for k in (0, 1):
            dx, dy = self._gradient[2 * k, spans.triangle], self._gradient[2 * k + 1, spans.triangle]
            value = np.repeat(dx.astype(np.float32), width)
            value *= along
            value += np.repeat((x * dx + y * dy).astype(np.float32), width)
            np.maximum(value, 0, out=value)
            np.minimum(value, 1, out=value)
            value *= np.float32(1 - 3 * EDGE_MARGIN)
            value += np.float32(EDGE_MARGIN)
            weights[:, k] = value
        return number, np.repeat(spans.triangle.astype(np.int32), width), weights


def ragged(start: Int64, length: Int64) -> Int64:
    """start[0], start[0] + 1 ... of length[0], then the next run."""
    ends = np.cumsum(length)
    result = np.repeat(start - (ends - length), length)
    result += np.arange(len(result))
    return result


@dataclass(frozen=True, eq=False)
class Border:
    """Texels beside charts: pixel (B,), triangle (B,) and barycentrics (B, 2) of the surface point they stand at."""

    pixel: Int64
    triangle: Int32
    weights: Float32


def beside_charts(
    uv: Float64, page: Int32, chart: Int64, texel_at: Int32, size: int, workers: int
) -> Fractions[Border]:
    """Texels outside every chart whose bilinear footprint touches one, at the nearest point of its border.

    Args:
        uv: (F, 3, 2), texels
        page, chart: (F,)
        texel_at: (P * S * S,), negative where no chart is
    """
    triangle, side = _border_edges(uv, chart)
    start, along = uv[triangle, side], uv[triangle, (side + 1) % 3] - uv[triangle, side]
    pieces = np.maximum(np.ceil(np.abs(along).max(1, initial=0) / PIECE), 1).astype(np.int64)
    edge = np.repeat(np.arange(len(pieces)), pieces)
    nth = ragged(np.zeros_like(pieces), pieces)

    def widen(begin: int, end: int) -> tuple[Int64, Float64, Int64, Float64]:
        """Pixels near pieces begin to end, squared distance, edge and place along it."""
        own = edge[begin:end]
        t0, step = nth[begin:end] / pieces[own], 1 / pieces[own]
        p0, delta = start[own] + along[own] * t0[:, None], along[own] * step[:, None]
        p1 = p0 + delta
        low = np.maximum(np.floor(np.minimum(p0, p1) - 1.5).astype(np.int64) + 1, 0)
        high = np.minimum(np.ceil(np.maximum(p0, p1) + 0.5).astype(np.int64), size)
        wide, tall = np.maximum(high - low, 0).T
        lines = np.repeat(np.arange(len(own)), tall)
        line = ragged(low[:, 1], tall)
        base = (page[triangle[own]].astype(np.int64)[lines] * size + line) * size
        x = ragged(low[lines, 0], wide[lines])
        pixel = np.repeat(base, wide[lines]) + x
        free = np.flatnonzero(texel_at[pixel] < 0)
        pixel, x = pixel[free], x[free]
        piece, y = np.repeat(lines, wide[lines])[free], np.repeat(line, wide[lines])[free]
        (from_x, from_y), (delta_x, delta_y) = p0[piece].T, delta[piece].T
        offset_x, offset_y = x + 0.5 - from_x, y + 0.5 - from_y
        length2 = np.maximum(delta_x**2 + delta_y**2, 1e-20)
        t = np.clip((offset_x * delta_x + offset_y * delta_y) / length2, 0, 1)
        gap = (offset_x - t * delta_x) ** 2 + (offset_y - t * delta_y) ** 2
        near = np.flatnonzero(_within_one(offset_x, offset_y, delta_x, delta_y))
        piece = piece[near]
        return pixel[near], gap[near], own[piece], t0[piece] + t[near] * step[piece]

    parts = yield from in_chunks(widen, len(edge), PIECES, workers)
    if not parts:
        return Border(np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros((0, 2), np.float32))
    pixel, gap, owner, t = (np.concatenate(part) for part in zip(*parts, strict=True))
    nearest = _first_of_each(pixel, gap)
    pixel, owner, t = pixel[nearest], owner[nearest], t[nearest]
    triangle, side = triangle[owner], side[owner]
    full = np.zeros((len(owner), 3))
    rows = np.arange(len(owner))
    full[rows, side] = 1 - t
    full[rows, (side + 1) % 3] = t
    point = start[owner] + along[owner] * t[:, None]
    to_centre = np.linalg.norm(uv[triangle].mean(1) - point, axis=1)
    inward = np.minimum(0.3, INSET / np.maximum(to_centre, 1e-9))[:, None]
    full = full * (1 - inward) + inward / 3
    return Border(pixel, triangle.astype(np.int32), full[:, 1:].astype(np.float32))


def _within_one(x: Float64, y: Float64, delta_x: Float64, delta_y: Float64) -> Bools:
    """Whether the segment (0, 0) to (delta_x, delta_y) meets the open square of half width 1 about (x, y)."""
    enter, leave = np.zeros(len(x)), np.ones(len(x))
    for place, delta in ((x, delta_x), (y, delta_y)):
        inverse = 1 / np.where(np.abs(delta) > 1e-12, delta, 1e-12)
        a, b = (place - 1) * inverse, (place + 1) * inverse
        np.maximum(enter, np.minimum(a, b), out=enter)
        np.minimum(leave, np.maximum(a, b), out=leave)
    return np.asarray(enter <= leave)


def _first_of_each(pixel: Int64, gap: Float64) -> Int64:
    """Index of the least gap of each pixel, the first of equal ones; in order of pixels."""
    keys = (pixel.astype(np.uint64) << np.uint64(32)) | gap.astype(np.float32).view(np.uint32)
    order = np.argsort(keys, kind="stable")
    ranked = pixel[order]
    return order[np.flatnonzero(np.concatenate([[len(ranked) > 0], ranked[1:] != ranked[:-1]]))]


def _border_edges(uv: Float64, chart: Int64) -> tuple[Int64, Int64]:
    """Triangle and side of the edges that no other triangle of the chart shares.

    A triangle thinner than the grid, whose own edges fall on each other, gives all of its edges.
    """
    vertex = _numbered(uv, chart)
    following = np.roll(vertex, -1, axis=1)
    thin: Bools = (vertex == following).any(axis=1)
    keys = (np.minimum(vertex, following) * (vertex.max(initial=0) + 1) + np.maximum(vertex, following)).reshape(-1)
    order = np.argsort(keys, kind="stable")
    ranked = keys[order]
    new = np.concatenate([[True], ranked[1:] != ranked[:-1], [True]])
    single = np.repeat(thin, 3)
    single[order[np.flatnonzero(new[:-1] & new[1:])[: len(order)]]] = True
    edges = np.flatnonzero(single)
    return edges // 3, edges % 3


def _numbered(uv: Float64, chart: Int64) -> Int64:
    """One number (F, 3) for each corner's place on the grid of its chart."""
    grid = np.rint(uv.reshape(-1, 2) * GRID).astype(np.int64)
    place = ((np.repeat(chart, 3) << 40) ^ (grid[:, 0] << 20)) + grid[:, 1]
    order = np.argsort(place, kind="stable")
    ranked = place[order]
    number = np.empty(len(place), np.int64)
    number[order] = np.cumsum(np.concatenate([[0], ranked[1:] != ranked[:-1]])[: len(order)])
    return number.reshape(-1, 3)
