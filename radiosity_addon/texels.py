# SPDX-License-Identifier: GPL-3.0-or-later
"""Texels: the elements that receive light, rasterised conservatively from the charts of an atlas.

A texel holds the mean over its footprint, clipped to its chart. Each has four strata (2 x 2 sub-texels); a
stratum that the chart does not cover repeats one that it does, so that every stratum is a point of the surface.
Texels that no stratum touches, but whose bilinear footprint touches the chart, stand at the nearest surface point.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .arrays import Bools, Float32, Float64, Int32, Int64
from .chunks import Fractions, in_chunks
from .surfaces import Surfaces
from .unwrap import Atlas

STRATA = 4
"""Sub-texels of a texel, 2 x 2: slot = 2 * (upper half) + (right half)."""

SAMPLE_CHUNK = 1 << 19
"""Sub-texels rasterised in one go, at most, counting the boxes around triangles."""

PIECE = 4.0
"""Chart borders are cut into pieces of at most this many texels before they are widened."""

EDGE_MARGIN = 1e-5
"""Least barycentric weight of a stratum: a point on an edge may lie in the plane of a wall, and see past it."""

KEPT_INSIDE = np.float32(0.95)
"""Offsets within a stratum that end on an edge of the triangle are shortened to this share."""

INSET = 0.05
"""Texels beside a chart stand this far inside its border, in texels: an edge shared with a wall is neither side."""


@dataclass(frozen=True, eq=False)
class Texels:
    """T texels on all pages, in page order.

    Attributes:
        size: texels along an edge of a page
        page_count: pages, hidden ones included
        pixel: (T,) int64, page * size^2 + row * size + column, row 0 at v = 0
        texel_at: (page_count * size^2,) int32, the texel of each pixel, -1 for none
        triangle: (T, 4) int32, triangle of each stratum
        barycentric: (T, 4, 2) float32, weights of corners 1 and 2 at each stratum
        covered: (T,) uint8, bit s set if stratum s is covered by the chart and not inside other geometry
        area: (T,) float32, m2, of the covered part; a triangle's texels sum to its area
        position: (T, 3) float32, m, mean over the strata
        normal: (T, 3) float32, unit geometric normal
        shading_normal: (T, 3) float32, unit
        valid: (T,) bool, takes part in the light; the others are filled from their neighbours
        lookup: (F, 6) float32, texel coordinates x0, y0, dx/du, dx/dv, dy/du, dy/dv of each triangle
        page: (F,) int32, page of each triangle
        surfaces: the triangles
    """

    size: int
    page_count: int
    pixel: Int64
    texel_at: Int32
    triangle: Int32
    barycentric: Float32
    covered: np.ndarray  # type: ignore[type-arg]
    area: Float32
    position: Float32
    normal: Float32
    shading_normal: Float32
    valid: Bools
    lookup: Float32
    page: Int32
    surfaces: Surfaces

    @property
    def count(self) -> int:
        return len(self.pixel)

    def points(self, texels: Int64 | Int32, sample: Int64 | Int32) -> tuple[Float32, Int32]:
        """Points on the surface spread over the footprints of texels (R,), and the triangles they lie on.

        Args:
            sample: (R,) int, walks through the strata first and then through offsets inside them
        Returns:
            (R, 3) float32, m, and (R,) int32
        """
        slot = sample & (STRATA - 1)
        flat = texels.astype(np.int64) * STRATA + slot
        triangle = self.triangle.reshape(-1)[flat]
        weights = self.barycentric.reshape(-1, 2)[flat]
        turn = sample >> 2
        turn = np.where(self.covered[texels] > 0, turn, 0)
        if turn.any():
            weights = self._shifted(weights, triangle, turn)
        return interpolate(self.surfaces.corners, triangle, weights), triangle

    def origins(self, texels: Int64 | Int32, sample: Int64 | Int32) -> Float32:
        """Ray origins (R, 3): `points`, lifted off the surface."""
        points, triangle = self.points(texels, sample)
        points += self.surfaces.normal[triangle] * np.float32(self.surfaces.offset)
        return points

    def _shifted(self, weights: Float32, triangle: Int32, turn: Int64 | Int32) -> Float32:
        """Barycentrics moved within their stratum along an R2 sequence (Roberts 2018), kept in the triangle."""
        steps = turn.astype(np.float64)
        x = ((0.7548776662466927 * steps) % 1 - (steps > 0) * 0.5).astype(np.float32) * np.float32(0.5)
        y = ((0.5698402909980532 * steps) % 1 - (steps > 0) * 0.5).astype(np.float32) * np.float32(0.5)
        _, _, xu, xv, yu, yv = self.lookup[triangle].T
        determinant = xu * yv - xv * yu
        determinant = np.where(np.abs(determinant) > 1e-9, determinant, np.float32(np.inf))
        u = np.maximum(weights[:, 0] + (x * yv - y * xv) / determinant, 0)
        v = np.maximum(weights[:, 1] + (y * xu - x * yu) / determinant, 0)
        over = np.maximum(u + v, 1)
        moved = np.stack([u / over, v / over], axis=1)
        return (weights + KEPT_INSIDE * (moved - weights)).astype(np.float32)

    def at(self, triangle: Int32, u: Float32, v: Float32) -> Int32:
        """The texel (R,) at barycentrics u, v of triangles (R,); -1 where the page has none."""
        x0, y0, xu, xv, yu, yv = self.lookup[triangle].T
        x = (x0 + u * xu + v * xv).astype(np.int32)
        y = (y0 + u * yu + v * yv).astype(np.int32)
        np.clip(x, 0, self.size - 1, out=x)
        np.clip(y, 0, self.size - 1, out=y)
        pixel = (self.page[triangle].astype(np.int64) * self.size + y) * self.size + x
        return self.texel_at[pixel]

    def without(self, inside: Bools) -> Texels:
        """The same texels with strata (T, 4) that lie inside other geometry left out."""
        slots = np.arange(STRATA)
        kept = (((self.covered[:, None] >> slots) & 1) > 0) & ~inside
        lonely = (self.covered == 0) & ~inside[:, 0]  # beside the chart: its one point stands in all strata
        source = _repeated(kept)
        rows = np.arange(self.count)[:, None]
        share = kept.sum(1) / np.maximum(_bits(self.covered), 1)
        return replace(
            self,
            triangle=self.triangle[rows, source],
            barycentric=self.barycentric[rows, source],
            covered=(kept << slots).sum(1).astype(np.uint8),
            area=(self.area * share).astype(np.float32),
            valid=self.valid & (kept.any(1) | lonely),
        ).with_means()

    def with_means(self) -> Texels:
        """The same texels with position and normals averaged over their strata."""
        position = np.empty((self.count, 3), np.float32)
        shading = np.empty((self.count, 3), np.float32)
        for start in range(0, self.count, 1 << 16):
            part = slice(start, start + (1 << 16))
            triangle = self.triangle[part].reshape(-1)
            weights = self.barycentric[part].reshape(-1, 2)
            points = interpolate(self.surfaces.corners, triangle, weights)
            position[part] = points.reshape(-1, STRATA, 3).mean(1)
            normals = interpolate(self.surfaces.corner_normals, triangle, weights).reshape(-1, STRATA, 3).sum(1)
            length = np.sqrt(np.einsum("ij,ij->i", normals, normals))[:, None]
            geometric = self.surfaces.normal[self.triangle[part, 0]]
            shading[part] = np.where(length > 1e-6, normals / np.maximum(length, 1e-6), geometric)
        return replace(
            self, position=position, shading_normal=shading, normal=self.surfaces.normal[self.triangle[:, 0]]
        )


def interpolate(corners: Float32, triangle: Int32, weights: Float32) -> Float32:
    """Values (R, 3) at barycentric weights (R, 2) of corner values (F, 3, 3)."""
    chosen = corners[triangle]
    u, v = weights[:, :1], weights[:, 1:]
    result: Float32 = chosen[:, 1] * u
    result += chosen[:, 2] * v
    result += chosen[:, 0] * (1 - u - v)
    return result


def _bits(mask: np.ndarray) -> Int64:  # type: ignore[type-arg]
    return ((mask[:, None] >> np.arange(STRATA)) & 1).sum(1)


def _repeated(kept: Bools) -> Int64:
    """(T, 4): for each stratum itself if kept, else a kept one of the same texel (stratum 0 if there is none)."""
    order = np.argsort(~kept, axis=1, kind="stable")
    count = np.maximum(kept.sum(1), 1)
    filled = np.take_along_axis(order, np.arange(STRATA)[None, :] % count[:, None], axis=1)
    filled[~kept.any(1)] = 0
    return np.where(kept, np.arange(STRATA)[None, :], filled)


def rasterize(atlas: Atlas, surfaces: Surfaces, workers: int = 1) -> Fractions[Texels]:
    """The texels of an atlas; yields the share done."""
    size = atlas.size
    pages = atlas.page_count + atlas.hidden_page_count
    uv = np.concatenate([part for part in atlas.uv if len(part)] or [np.zeros((0, 3, 2))]).astype(np.float64) * size
    page = np.repeat(np.asarray(atlas.page, np.int32), np.diff(surfaces.first))
    placed = page >= 0  # meshes without a surface have no page; nothing meets their triangles
    page = np.maximum(page, 0)
    uv[~placed] = 0
    chart = np.concatenate([part for part in atlas.chart if len(part)] or [np.zeros(0)]).astype(np.int64)

    scan = _ScanLines(uv, page, size)
    cuts = scan.cuts(SAMPLE_CHUNK)
    texel_at = np.full(pages * size * size, -1, np.int32)

    def mark(start: int, stop: int) -> Int64:
        spans = scan.spans(int(cuts[start]), int(cuts[stop]))
        texel_at[scan.pixels(*spans.samples())] = 0
        return spans.width

    widths = yield from in_chunks(mark, len(cuts) - 1, 1, workers)
    width = np.concatenate(widths) if widths else np.zeros(0, np.int64)
    samples = np.bincount(scan.triangle_of(0, scan.rows), weights=width, minlength=surfaces.count)
    tiny = np.flatnonzero((samples == 0) & placed)
    centre = np.clip(uv[tiny].mean(1), 0, size - 1e-6).astype(np.int64)
    tiny_pixel = (page[tiny].astype(np.int64) * size + centre[:, 1]) * size + centre[:, 0]
    border = _beside_charts(uv, page, chart, texel_at, size)
    texel_at[border.pixel] = 0
    lost = texel_at[tiny_pixel] < 0
    texel_at[tiny_pixel] = 0
    pixels = np.flatnonzero(texel_at == 0)
    texel_at[pixels] = np.arange(len(pixels), dtype=np.int32)

    count = len(pixels)
    triangles = np.full((count, STRATA), -1, np.int32)
    barycentric = np.zeros((count, STRATA, 2), np.float32)

    def fill(start: int, stop: int) -> None:
        triangle, line, column = scan.spans(int(cuts[start]), int(cuts[stop])).samples()
        flat = texel_at[scan.pixels(triangle, line, column)].astype(np.int64) * STRATA
        flat += (line & 1) * 2 + (column & 1)
        triangles.reshape(-1)[flat] = triangle
        barycentric.reshape(-1, 2)[flat] = scan.barycentrics(triangle, line, column)

    yield from in_chunks(fill, len(cuts) - 1, 1, workers)
    kept = triangles >= 0
    per_sample = surfaces.area / np.maximum(samples, 1)
    area = np.where(kept, per_sample[triangles], 0).sum(1)
    area += np.bincount(texel_at[tiny_pixel], weights=surfaces.area[tiny], minlength=count)

    alone = texel_at[border.pixel]
    triangles[alone, 0] = border.triangle
    barycentric[alone, 0] = border.weights
    triangles[texel_at[tiny_pixel[lost]], 0] = tiny[lost]
    barycentric[texel_at[tiny_pixel[lost]], 0] = 1 / 3
    source = _repeated(kept)
    rows = np.arange(count)[:, None]
    edges = uv[:, 1:] - uv[:, :1]
    lookup = np.stack(
        [uv[:, 0, 0], uv[:, 0, 1], edges[:, 0, 0], edges[:, 1, 0], edges[:, 0, 1], edges[:, 1, 1]], axis=1
    )
    empty = np.zeros((0, 3), np.float32)
    return Texels(
        size=size,
        page_count=pages,
        pixel=pixels,
        texel_at=texel_at,
        triangle=triangles[rows, source],
        barycentric=barycentric[rows, source],
        covered=(kept << np.arange(STRATA)).sum(1).astype(np.uint8),
        area=area.astype(np.float32),
        position=empty,
        normal=empty,
        shading_normal=empty,
        valid=np.ones(count, bool),
        lookup=lookup.astype(np.float32),
        page=page,
        surfaces=surfaces,
    ).with_means()


@dataclass(frozen=True, eq=False)
class _Spans:
    """Runs of sub-texels in R rows: triangle, line, first column and width, all (R,) int64."""

    triangle: Int64
    line: Int64
    left: Int64
    width: Int64

    def samples(self) -> tuple[Int64, Int64, Int64]:
        """Triangle, line and column of every sub-texel."""
        run = np.repeat(np.arange(len(self.width)), self.width)
        before = np.cumsum(self.width) - self.width
        column = np.arange(len(run)) + (self.left - before)[run]
        return self.triangle[run], self.line[run], column


class _ScanLines:
    """Which triangle covers each sub-texel centre, row by row.

    Spans are half-open: a centre on an edge that two triangles share belongs to exactly one.
    """

    def __init__(self, uv: Float64, page: Int32, size: int) -> None:
        fine = uv * 2
        limit = 2 * size
        low = np.clip(np.ceil(fine[:, :, 1].min(1, initial=limit) - 0.5), 0, limit).astype(np.int64)
        high = np.clip(np.ceil(fine[:, :, 1].max(1, initial=0) - 0.5), 0, limit).astype(np.int64)
        self._low, self._height = low, np.maximum(high - low, 0)
        self._ends = np.cumsum(self._height)
        across = fine[:, :, 0].max(1, initial=0) - fine[:, :, 0].min(1, initial=limit)
        self._width = np.maximum(np.ceil(across), 1).astype(np.int64)
        following = np.roll(fine, -1, axis=1)
        upward = (fine[..., 1] <= following[..., 1])[..., None]
        self._below = np.where(upward, fine, following)
        self._above = np.where(upward, following, fine)
        rise = self._above[..., 1] - self._below[..., 1]
        self._slope = (self._above[..., 0] - self._below[..., 0]) / np.where(rise > 0, rise, 1)
        self._corner = fine[:, 0]
        self._b, self._c = fine[:, 1] - fine[:, 0], fine[:, 2] - fine[:, 0]
        determinant = self._b[:, 0] * self._c[:, 1] - self._b[:, 1] * self._c[:, 0]
        self._determinant = np.where(determinant != 0, determinant, np.inf)
        self._page, self._size = page.astype(np.int64), size
        self.rows = int(self._ends[-1]) if len(self._ends) else 0

    def cuts(self, samples: int) -> Int64:
        """Row numbers, from 0 to `rows`, between which lie at most about so many sub-texels."""
        box = self._width
        ends = np.cumsum(self._height * box)
        targets = np.arange(0, int(ends[-1]) if len(ends) else 0, samples)
        triangle = np.searchsorted(ends, targets, side="right")
        into = (targets - (ends - self._height * box)[triangle]) // box[triangle]
        return np.append((self._ends - self._height)[triangle] + into, self.rows)

    def triangle_of(self, start: int, stop: int) -> Int64:
        """Triangle of each row."""
        return np.searchsorted(self._ends, np.arange(start, stop), side="right")

    def spans(self, start: int, stop: int) -> _Spans:
        triangle = self.triangle_of(start, stop)
        line = np.arange(start, stop) - (self._ends - self._height - self._low)[triangle]
        y = (line + 0.5)[:, None]
        below = self._below[triangle]
        crossing = (below[..., 1] <= y) & (y < self._above[triangle, :, 1])
        x = below[..., 0] + (y - below[..., 1]) * self._slope[triangle]
        limit = 2 * self._size
        left = np.clip(np.ceil(np.where(crossing, x, np.inf).min(1) - 0.5), 0, limit)
        right = np.clip(np.ceil(np.where(crossing, x, -np.inf).max(1) - 0.5), 0, limit)
        return _Spans(triangle, line, left.astype(np.int64), np.maximum(right - left, 0).astype(np.int64))

    def pixels(self, triangle: Int64, line: Int64, column: Int64) -> Int64:
        return (self._page[triangle] * self._size + (line >> 1)) * self._size + (column >> 1)

    def barycentrics(self, triangle: Int64, line: Int64, column: Int64) -> Float32:
        x = column + 0.5 - self._corner[triangle, 0]
        y = line + 0.5 - self._corner[triangle, 1]
        b, c, determinant = self._b[triangle], self._c[triangle], self._determinant[triangle]
        u = (x * c[:, 1] - y * c[:, 0]) / determinant
        v = (y * b[:, 0] - x * b[:, 1]) / determinant
        weights = np.clip(np.stack([u, v], axis=1), 0, 1)
        return (weights * (1 - 3 * EDGE_MARGIN) + EDGE_MARGIN).astype(np.float32)


@dataclass(frozen=True, eq=False)
class _Border:
    pixel: Int64
    triangle: Int32
    weights: Float32


def _beside_charts(uv: Float64, page: Int32, chart: Int64, texel_at: Int32, size: int) -> _Border:
    """Texels outside every chart whose bilinear footprint touches one, at the nearest point of its border."""
    if not len(uv):
        return _Border(np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros((0, 2), np.float32))
    triangle, side = _border_edges(uv, chart)
    real = np.ptp(uv[triangle], axis=1).any(1)
    triangle, side = triangle[real], side[real]
    start, stop = uv[triangle, side], uv[triangle, (side + 1) % 3]
    pieces = np.maximum(np.ceil(np.abs(stop - start).max(1) / PIECE), 1).astype(np.int64)
    edge = np.repeat(np.arange(len(pieces)), pieces)
    nth = np.arange(len(edge)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    t0, t1 = nth / pieces[edge], (nth + 1) / pieces[edge]
    along = stop - start
    p0 = start[edge] + along[edge] * t0[:, None]
    p1 = start[edge] + along[edge] * t1[:, None]
    corner = np.floor(np.minimum(p0, p1) - 1.5).astype(np.int64) + 1
    reach = int(PIECE) + 4
    best: list[tuple[Int64, Float64, Int64, Float64]] = []
    delta = p1 - p0
    length2 = np.maximum((delta**2).sum(1), 1e-20)
    sheet = page[triangle][edge].astype(np.int64)
    for dy in range(reach):
        for dx in range(reach):
            x, y = corner[:, 0] + dx, corner[:, 1] + dy
            offset_x, offset_y = x + 0.5 - p0[:, 0], y + 0.5 - p0[:, 1]
            t = np.clip((offset_x * delta[:, 0] + offset_y * delta[:, 1]) / length2, 0, 1)
            gap_x, gap_y = offset_x - t * delta[:, 0], offset_y - t * delta[:, 1]
            near = (np.maximum(np.abs(gap_x), np.abs(gap_y)) < 1) & (x >= 0) & (y >= 0) & (x < size) & (y < size)
            chosen = np.flatnonzero(near)
            pixel = (sheet[chosen] * size + y[chosen]) * size + x[chosen]
            free = texel_at[pixel] < 0
            chosen, pixel = chosen[free], pixel[free]
            whole = t0[chosen] + t[chosen] * (t1 - t0)[chosen]
            best.append((pixel, gap_x[chosen] ** 2 + gap_y[chosen] ** 2, edge[chosen], whole))
    pixel, gap, owner, t = (np.concatenate(part) for part in zip(*best, strict=True))
    order = np.lexsort((owner, gap, pixel))
    pixel, first = np.unique(pixel[order], return_index=True)
    owner, t = owner[order][first], t[order][first]
    triangle, side = triangle[owner], side[owner]
    full = np.zeros((len(owner), 3))
    rows = np.arange(len(owner))
    full[rows, side] = 1 - t
    full[rows, (side + 1) % 3] = t
    point = (uv[triangle] * full[:, :, None]).sum(1)
    to_centre = np.linalg.norm(uv[triangle].mean(1) - point, axis=1)
    inward = np.minimum(0.3, INSET / np.maximum(to_centre, 1e-9))[:, None]
    full = full * (1 - inward) + inward / 3
    return _Border(pixel, triangle.astype(np.int32), full[:, 1:].astype(np.float32))


def _border_edges(uv: Float64, chart: Int64) -> tuple[Int64, Int64]:
    """Triangle and side of the edges that no other triangle of the chart shares."""
    grid = np.round(uv.reshape(-1, 2) * 64).astype(np.int64)
    place = ((np.repeat(chart, 3) << 40) ^ (grid[:, 0] << 20)) + grid[:, 1]
    _, vertex = np.unique(place, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    ends = np.stack([vertex, np.roll(vertex, -1, axis=1)], axis=2).reshape(-1, 2)
    ends.sort(axis=1)
    _, edge, shared = np.unique(ends[:, 0] * (vertex.max() + 1) + ends[:, 1], return_inverse=True, return_counts=True)
    single = np.flatnonzero(shared[edge.reshape(-1)] == 1)
    return single // 3, single % 3
