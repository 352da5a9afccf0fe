# SPDX-License-Identifier: GPL-3.0-or-later
"""Texels: the elements that receive light, rasterised conservatively from the charts of an atlas.

A texel holds the mean over its footprint, clipped to its chart. Each has four strata (2 x 2 sub-texels); a
stratum that the chart does not cover repeats one that it does, so that every stratum is a point of the surface.
Texels that no stratum touches, but whose bilinear footprint touches the chart, stand at the nearest surface point.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Float32, Float64, Int32, Int64
from ..atlas.unwrap import Atlas
from ..chunks import Fractions, in_chunks, scaled
from ..columns import some
from ..indices import numbers_of
from .by_triangle import ByTriangle, FirstTriangle
from .coverage import ScanLines, beside_charts
from .footprints import STRATA as STRATA
from .footprints import Footprints, footprints_of, spread_of
from .surfaces import BLOCK, Surfaces

SAMPLE_CHUNK = 1 << 16
"""Sub-texels rasterised in one go, at most, counting the boxes around triangles: 0.3 MB a temporary, in cache."""

TEXEL_CHUNK = 1 << 13
"""Texels completed in one go."""

KEPT_INSIDE = np.float32(0.95)
"""Offsets within a stratum that end on an edge of the triangle are shortened to this share."""

_SLOTS = np.arange(STRATA)


def _stand_ins() -> Int64:
    """(16, 4): for each set of kept strata and each stratum, itself if kept, else a kept one; the first if none is."""
    kept = ((np.arange(1 << STRATA)[:, None] >> _SLOTS) & 1) > 0
    order = np.argsort(~kept, axis=1, kind="stable")
    filled = np.take_along_axis(order, _SLOTS % np.maximum(kept.sum(1), 1)[:, None], axis=1)
    return np.where(kept, _SLOTS, np.where(kept.any(1)[:, None], filled, 0))


STAND_INS = _stand_ins()
BITS = ((np.arange(1 << STRATA)[:, None] >> _SLOTS) & 1).sum(1)


@dataclass(frozen=True, eq=False)
class Texels:
    """T texels on all pages, in page order.

    Attributes:
        size: texels along an edge of a page
        page_count: pages, hidden ones included
        pixel: (T,) int32, page * size^2 + row * size + column, row 0 at v = 0; int64 where there are more than 2^31
        texel_at: (page_count * size^2,) int32, the texel of each pixel, -1 for none
        footprints: triangle and barycentrics of each stratum
        covered: (T,) uint8, bit s set if stratum s is covered by the chart and not inside other geometry
        area: (T,) float32, m2, of the covered part; a triangle's texels sum to its area
        position: (T, 3) float32, m, mean over the strata
        shading_normal: (T, 3) float32, unit
        valid: (T,) bool, takes part in the light; the others are filled from their neighbours
        crossed: (T,) bool, a thin wall stands on or beside it, so that points stay at the strata's centres
        lookup: (6, F) float32, texel coordinates x0, y0, dx/du, dx/dv, dy/du, dy/dv of each triangle
        page: (F,) int32, page of each triangle
        surfaces: the triangles
        triangle: (T,) int32, that of the first stratum
        normal: (T, 3) float32, unit geometric normal, of that triangle
    """

    size: int
    page_count: int
    pixel: Int32 | Int64
    texel_at: Int32
    footprints: Footprints
    covered: NDArray[np.uint8]
    area: Float32
    position: Float32
    shading_normal: Float32
    valid: Bools
    crossed: Bools
    lookup: Float32
    page: Int32
    surfaces: Surfaces

    @property
    def count(self) -> int:
        return len(self.pixel)

    @property
    def normal(self) -> ByTriangle:
        return ByTriangle(self.surfaces.normal, self.footprints)

    @property
    def triangle(self) -> FirstTriangle:
        return FirstTriangle(self.footprints)

    def before(self, pixel: int) -> int:
        """How many texels come before a pixel."""
        last = min(pixel, len(self.texel_at))
        return int(np.searchsorted(self.pixel, self.pixel.dtype.type(last - 1), side="right")) if last > 0 else 0

    def points(self, texels: Int64 | Int32, sample: Int64 | Int32) -> tuple[Float32, Int32]:
        """Points on the surface spread over the footprints of texels (R,), and the triangles they lie on.

        Args:
            sample: (R,) int, walks through the strata first and then through offsets inside them
        Returns:
            (R, 3) float32, m, in memory x, y and z apart, and (R,) int32
        """
        if sample.max(initial=0) < STRATA:
            return self.footprints.points(texels, sample)
        triangle, weights = self.places(texels, sample)
        return self.surfaces.points(triangle, weights), triangle

    def places(self, texels: Int64 | Int32, sample: Int64 | Int32) -> tuple[Int32, Float32]:
        """Triangles (R,) and barycentrics (R, 2) of `points`."""
        triangle, weights = self.footprints.at(texels, sample & (STRATA - 1))
        if sample.max(initial=0) < STRATA:
            return triangle, weights
        turn = np.where((self.covered[texels] > 0) & ~self.crossed[texels], sample >> 2, 0)
        return triangle, self._shifted(weights, triangle, turn)

    def stratum_points(self, stratum: Int64 | Int32) -> tuple[Float32, Int32]:
        """As `points`, of strata (R,) numbered texel * 4 + slot."""
        return self.footprints.points(stratum // STRATA, stratum & (STRATA - 1))

    def origins(self, texels: Int64 | Int32, sample: Int64 | Int32) -> Float32:
        """Ray origins (R, 3): `points`, lifted off the surface."""
        points, triangle = self.points(texels, sample)
        normals = self.surfaces.normals(triangle)
        normals *= np.float32(self.surfaces.offset)
        points += normals
        return points

    def _shifted(self, weights: Float32, triangle: Int32, turn: Int64 | Int32) -> Float32:
        """Barycentrics moved within their stratum along an R2 sequence (Roberts 2018), kept in the triangle."""
        steps = np.arange(int(turn.max(initial=0)) + 1, dtype=np.float64)
        along_x, along_y = (
            (((share * steps) % 1 - (steps > 0) * 0.5) * 0.5).astype(np.float32)
            for share in (0.7548776662466927, 0.5698402909980532)
        )
        shifted = np.empty_like(weights)
        for start in range(0, len(triangle), BLOCK):
            part = slice(start, start + BLOCK)
            where = triangle[part].astype(np.intp)
            x, y = along_x[turn[part]], along_y[turn[part]]
            xu, xv, yu, yv = (np.take(row, where, mode="clip") for row in self.lookup[2:])
            determinant = xu * yv - xv * yu
            determinant = np.where(np.abs(determinant) > 1e-9, determinant, np.float32(np.inf))
            old_u, old_v = np.ascontiguousarray(weights[part].T)
            u = np.maximum(old_u + (x * yv - y * xv) / determinant, 0)
            v = np.maximum(old_v + (y * xu - x * yu) / determinant, 0)
            over = np.maximum(u + v, 1)
            shifted[part, 0] = old_u + KEPT_INSIDE * (u / over - old_u)
            shifted[part, 1] = old_v + KEPT_INSIDE * (v / over - old_v)
        return shifted

    def at(self, triangle: Int32, u: Float32, v: Float32) -> Int32:
        """The texel (R,) at barycentrics u, v of triangles (R,); -1 where the page has none."""
        found = np.empty(len(triangle), np.int32)
        last = np.float32(self.size - 1)
        for start in range(0, len(triangle), BLOCK):
            part = slice(start, start + BLOCK)
            where = triangle[part].astype(np.intp)
            pixel = np.zeros(len(where), np.int64) if self.page_count == 1 else self.page[where] * np.int64(self.size)
            for base, by_u, by_v in ((1, 4, 5), (0, 2, 3)):  # y, then x
                place = np.take(self.lookup[by_u], where, mode="clip")
                place *= u[part]
                place_v = np.take(self.lookup[by_v], where, mode="clip")
                place_v *= v[part]
                place += place_v
                place += np.take(self.lookup[base], where, mode="clip", out=place_v)
                np.maximum(place, 0, out=place)
                np.minimum(place, last, out=place)
                pixel += place.astype(np.int32)
                if base:
                    pixel *= self.size
            np.take(self.texel_at, pixel, out=found[part], mode="clip")
        return found

    def only(self, chosen: Int64, texel_at: Int32) -> Texels:
        """Those at `chosen` (C,), in page order.

        Args:
            texel_at: as the attribute, all -1; the chosen ones are entered
        """
        pixel = self.pixel[chosen]
        texel_at[pixel] = np.arange(len(chosen), dtype=np.int32)
        parts = (
            "covered",
            "area",
            "position",
            "shading_normal",
            "valid",
            "crossed",
        )
        own = {name: getattr(self, name)[chosen] for name in parts}
        return replace(self, pixel=pixel, texel_at=texel_at, footprints=self.footprints.only(chosen, pixel), **own)

    def without(self, inside: Bools) -> Texels:
        """Leave out strata (T, 4) that lie inside other geometry: changes these texels, and returns them.

        A second copy of them would be what a large page can't afford.
        """
        changed = np.flatnonzero(some(inside))
        parts = [
            self._leave_out(changed[start : start + TEXEL_CHUNK], inside)
            for start in range(0, len(changed), TEXEL_CHUNK)
        ]
        if parts:
            triangle, weights = zip(*parts, strict=True)
            self.footprints.put(changed, np.concatenate(triangle), np.concatenate(weights))
        return self

    def stand_at(self, changed: Int64, others: Int32 | Int64) -> None:
        """Let texels stand in one point, the first stratum of `others`, all (C,): changes these texels."""
        triangle, weights = self.footprints.strata(others)
        triangle, weights = triangle[:, [0] * STRATA], weights[:, [0] * STRATA]
        self.footprints.put(changed, triangle, weights)
        self.position[changed], self.shading_normal[changed] = _means(self.surfaces, triangle, weights)

    def _leave_out(self, changed: Int64, inside: Bools) -> tuple[Int32, Float32]:
        before = self.covered[changed]
        lost = (inside[changed] << _SLOTS).sum(1)
        mask = before & ~lost
        lonely = (before == 0) & ((lost & 1) == 0)  # beside the chart: its one point stands in all strata
        source = STAND_INS[mask]
        triangle, weights = self.footprints.strata(changed)
        triangle = np.take_along_axis(triangle, source, axis=1)
        weights = np.take_along_axis(weights, source[:, :, None], axis=1)
        self.covered[changed] = mask
        self.area[changed] *= (BITS[mask] / np.maximum(BITS[before], 1)).astype(np.float32)
        self.valid[changed] &= (mask > 0) | lonely
        self.position[changed], self.shading_normal[changed] = _means(self.surfaces, triangle, weights)
        return triangle, weights


def _means(surfaces: Surfaces, triangle: Int32, barycentric: Float32) -> tuple[Float32, Float32]:
    """Mean position and mean shading normal (T, 3) of texels.

    Args:
        triangle: (T, 4)
        barycentric: (T, 4, 2)
    """
    first = np.ascontiguousarray(triangle[:, 0])
    weights = (barycentric[:, 0] + barycentric[:, 1] + barycentric[:, 2] + barycentric[:, 3]) * np.float32(0.25)
    position = surfaces.points(first, weights)
    shading = surfaces.blended_normals(first, weights)
    flat = surfaces.flat[first]
    mixed = np.flatnonzero((triangle[:, 1] != first) | (triangle[:, 2] != first) | (triangle[:, 3] != first))
    if len(mixed):
        each, apart = triangle[mixed].reshape(-1), barycentric[mixed].reshape(-1, 2)
        position[mixed] = surfaces.points(each, apart).reshape(-1, STRATA, 3).mean(1)
        shading[mixed] = surfaces.blended_normals(each, apart).reshape(-1, STRATA, 3).mean(1)
        flat[mixed] = False
    length = np.sqrt(np.einsum("ij,ij->i", shading, shading))
    flat |= length < 1e-6
    shading /= np.maximum(length, np.float32(1e-6))[:, None]
    return position, np.where(flat[:, None], surfaces.normals(first), shading)


def rasterize(atlas: Atlas, surfaces: Surfaces, workers: int = 1) -> Fractions[Texels]:
    """The texels of an atlas; yields the share done."""
    size = atlas.size
    pages = atlas.page_count + atlas.hidden_page_count
    uv = np.concatenate([np.zeros((0, 3, 2), np.float32), *atlas.uv]).astype(np.float64) * size
    page = np.repeat(np.asarray(atlas.page, np.int32), np.diff(surfaces.first))
    placed = page >= 0  # meshes without a surface have no page; nothing meets their triangles
    page = np.maximum(page, 0)
    uv[~placed] = 0
    chart = np.concatenate([np.zeros(0, np.int32), *atlas.chart]).astype(np.int64)

    scan = ScanLines(uv, page, size)
    cuts = scan.cuts(SAMPLE_CHUNK)
    texel_at = np.full(pages * size * size, -1, np.int32)
    samples = np.zeros(surfaces.count)

    def mark(start: int, stop: int) -> tuple[int, Float64]:
        spans = scan.spans(int(cuts[start]), int(cuts[stop]))
        texel_at[scan.pixels(spans)] = 0
        first = int(spans.triangle[0]) if len(spans.triangle) else 0
        return first, np.bincount(spans.triangle - first, weights=spans.right - spans.left)

    for first, number in (yield from scaled(in_chunks(mark, len(cuts) - 1, 1, workers), 0.0, 0.25)):
        samples[first : first + len(number)] += number
    tiny = np.flatnonzero((samples == 0) & placed)
    centre = np.clip(uv[tiny].mean(1), 0, size - 1e-6).astype(np.int64)
    tiny_pixel = (page[tiny].astype(np.int64) * size + centre[:, 1]) * size + centre[:, 0]
    shown = np.flatnonzero(placed)
    border = yield from scaled(beside_charts(uv[shown], page[shown], chart[shown], texel_at, size, workers), 0.25, 0.4)
    texel_at[border.pixel] = 0
    lost = texel_at[tiny_pixel] < 0
    texel_at[tiny_pixel] = 0
    there = texel_at == 0
    pixels = numbers_of(there) if len(there) < 1 << 31 else np.flatnonzero(there)
    texel_at[pixels] = np.arange(len(pixels), dtype=np.int32)

    count = len(pixels)
    triangles = np.full((count, STRATA), -1, np.int32)
    barycentric = np.zeros((count, STRATA, 2), np.float32)

    def fill(start: int, stop: int) -> None:
        spans = scan.spans(int(cuts[start]), int(cuts[stop]))
        number, triangle, weights = scan.samples(spans, texel_at[scan.first_pixel(spans)].astype(np.int64))
        triangles.reshape(-1)[number] = triangle
        barycentric.reshape(-1).view(np.int64)[number] = weights.reshape(-1).view(np.int64)

    yield from scaled(in_chunks(fill, len(cuts) - 1, 1, workers), 0.4, 0.7)
    beside = np.zeros(count, bool)
    alone = texel_at[border.pixel]
    beside[alone] = True
    triangles[alone, 0] = shown[border.triangle]
    barycentric[alone, 0] = border.weights
    alone = texel_at[tiny_pixel[lost]]
    beside[alone] = True
    triangles[alone, 0] = tiny[lost]
    barycentric[alone, 0] = 1 / 3

    per_sample = np.append(surfaces.area / np.maximum(samples, 1), 0)
    area = np.empty(count, np.float32)
    covered = np.empty(count, np.uint8)
    position, shading = (np.empty((count, 3), np.float32) for _ in range(2))

    def complete(start: int, stop: int) -> None:
        part = slice(start, stop)
        own, weights = triangles[part], barycentric[part]
        mask = np.zeros(len(own), np.uint8)
        total = np.zeros(len(own))
        for slot in range(STRATA):
            triangle = own[:, slot].astype(np.intp)
            mask |= (triangle >= 0).view(np.uint8) << np.uint8(slot)
            total += per_sample[triangle]  # that of -1, the last one, is 0
        mask[beside[part]] = 0
        total[beside[part]] = 0
        covered[part], area[part] = mask, total
        some = np.flatnonzero(mask != (1 << STRATA) - 1)
        source = STAND_INS[mask[some]]
        own[some] = np.take_along_axis(own[some], source, axis=1)
        weights[some] = weights[some[:, None], source]
        position[part], shading[part] = _means(surfaces, own, weights)

    yield from scaled(in_chunks(complete, count, TEXEL_CHUNK, workers), 0.7, 1.0)
    np.add.at(area, texel_at[tiny_pixel], surfaces.area[tiny])
    edges = uv[:, 1:] - uv[:, :1]
    parts = [uv[:, 0, 0], uv[:, 0, 1], edges[:, 0, 0], edges[:, 1, 0], edges[:, 0, 1], edges[:, 1, 1]]
    lookup = np.stack(parts).astype(np.float32)
    spread = spread_of(uv, page, size, surfaces.corners)
    whole = covered == (1 << STRATA) - 1
    return Texels(
        size=size,
        page_count=pages,
        pixel=pixels,
        texel_at=texel_at,
        footprints=footprints_of(pixels, size, whole, triangles, barycentric, lookup, spread, surfaces),
        covered=covered,
        area=area,
        position=position,
        shading_normal=shading,
        valid=np.ones(count, bool),
        crossed=np.zeros(count, bool),
        lookup=lookup,
        page=page,
        surfaces=surfaces,
    )
