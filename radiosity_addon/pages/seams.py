# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a smooth surface is cut into charts, both sides of the cut show the same light.

Irradiance is found in world space and agrees, but bilinear filtering mixes other texels on either side. The texels
along seams are changed as little as possible so that the filtered values match (after Iwanicki 2013, "Lighting
Technology of The Last of Us", seam equalisation by least squares).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float32, Float64, Int64
from ..geometry.surfaces import Surfaces
from ..geometry.texels import STRATA, Texels

SMOOTH = 0.97
"""Least cosine between the shading normals of both sides: a sharper edge is meant to show."""

SAMPLES_A_TEXEL = 1.5
"""Places along a seam where both sides are compared."""

KEEP = 0.005
"""Weight of leaving texels as they are, against 1 for each comparison."""

KEEP_COVERED = 0.5
"""The same of texels that the chart covers whole. What is read far from the seam hangs on them; the others, across the
edge, can take the change alone."""

ITERATIONS = 10
"""Steps of the conjugate gradients: seams are short-ranged, so few suffice."""


@dataclass(frozen=True, eq=False)
class _Comparison:
    """S places on seams: eight texels each and their weights, those of the second side negative.

    Attributes:
        pixel: (K,) int64, the pixels that take part
        keep: (K,) float64, weight of leaving each as it is
        column: (8, S) int64, into `pixel`
        weight: (8, S) float64
    """

    pixel: Int64
    keep: Float64
    column: Int64
    weight: Float64

    def normal_product(self, values: Float64) -> Float64:
        """A^T A x (C, K) of pixel values x (C, K), where A x are the differences between both sides."""
        return np.stack([self._spread(self._differences(channel)) for channel in values])

    def _differences(self, channel: Float64) -> Float64:
        difference = np.zeros(self.column.shape[1])
        for column, weight in zip(self.column, self.weight, strict=True):
            part = np.take(channel, column, mode="clip")
            part *= weight
            difference += part
        return difference

    def _spread(self, difference: Float64) -> Float64:
        weights = (self.weight * difference).reshape(-1)
        return np.bincount(self.column.reshape(-1), weights=weights, minlength=len(self.pixel))


def close_seams(pages: Float32, known: Bools, texels: Texels) -> None:
    """Equalise, in place, the filtered values along seams.

    Args:
        pages: (P * S * S, 3) float32
        known: (P * S * S,) bool, pixels that hold light
    """
    compared = _compare(texels, known)
    if compared is None:
        return
    values = pages[compared.pixel].T.astype(np.float64)
    scale = np.maximum(np.abs(values).mean(1), 1e-12)[:, None]
    values /= scale
    change = np.zeros_like(values)
    residual = -compared.normal_product(values)
    direction = residual.copy()
    power = (residual**2).sum(1)
    for _ in range(ITERATIONS):
        applied = compared.normal_product(direction) + compared.keep * direction
        step = power / np.maximum((direction * applied).sum(1), 1e-30)
        change += step[:, None] * direction
        residual -= step[:, None] * applied
        new = (residual**2).sum(1)
        direction = residual + (new / np.maximum(power, 1e-30))[:, None] * direction
        power = new
    pages[compared.pixel] = np.maximum((values + change) * scale, 0).T


def _compare(texels: Texels, known: Bools) -> _Comparison | None:
    first, second = _seams(texels)
    size = texels.size
    length = np.maximum(*(np.linalg.norm(side[:, 1] - side[:, 0], axis=1) for side in (first[0], second[0])))
    count = np.ceil(length * SAMPLES_A_TEXEL).astype(np.int64) + 1
    seam = np.repeat(np.arange(len(count)), count)
    if not len(seam):
        return None
    along = ((np.arange(len(seam)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[seam])[:, None]
    pixels: list[Int64] = []
    weights: list[Float64] = []
    for sign, (ends, page) in ((1.0, first), (-1.0, second)):
        place = ends[seam, 0] + (ends[seam, 1] - ends[seam, 0]) * along - 0.5
        corner = np.floor(place).astype(np.int64)
        part = place - corner
        for dy in (0, 1):
            for dx in (0, 1):
                x, y = np.clip(corner[:, 0] + dx, 0, size - 1), np.clip(corner[:, 1] + dy, 0, size - 1)
                pixels.append((page[seam].astype(np.int64) * size + y) * size + x)
                share_x = part[:, 0] if dx else 1 - part[:, 0]
                share_y = part[:, 1] if dy else 1 - part[:, 1]
                weights.append(sign * share_x * share_y)
    inside = np.ones(len(seam), bool)
    for pixel in pixels:
        inside &= known[np.minimum(pixel, len(known) - 1)] & (pixel < len(known))
    if not inside.any():
        return None
    table, weight = np.stack([pixel[inside] for pixel in pixels]), np.stack([part[inside] for part in weights])
    used = np.zeros(len(known), bool)
    used[table] = True
    pixel = np.flatnonzero(used)
    number = np.empty(len(known), np.int32)
    number[pixel] = np.arange(len(pixel), dtype=np.int32)
    texel = texels.texel_at[pixel]
    whole = (texel >= 0) & (texels.covered.take(texel) == (1 << STRATA) - 1)
    return _Comparison(pixel, np.where(whole, KEEP_COVERED, KEEP), number[table].astype(np.int64), weight)


_Sides = tuple[tuple[Float64, Int64], tuple[Float64, Int64]]


def _seams(texels: Texels) -> _Sides:
    """Both sides of every seam: ends (E, 2, 2) in texels and page (E,)."""
    surfaces: Surfaces = texels.surfaces
    vertex = _vertices(surfaces)
    following = np.roll(vertex, -1, axis=1)
    low, high = np.minimum(vertex, following).reshape(-1), np.maximum(vertex, following).reshape(-1)
    key = low * (int(vertex.max(initial=0)) + 1) + high
    order = np.argsort(key, kind="stable")
    begin = np.flatnonzero(np.concatenate([[True], np.diff(key[order]) != 0])[: len(order)])
    pair = begin[np.diff(np.append(begin, len(order))) == 2]
    one, other = order[pair], order[pair + 1]
    x0, y0, xu, xv, yu, yv = texels.lookup.astype(np.float64)
    uv = np.stack([x0, y0, x0 + xu, y0 + yu, x0 + xv, y0 + yv], axis=1).reshape(-1, 3, 2)
    backward = (vertex > following).reshape(-1)

    def corners(edge: Int64) -> tuple[Int64, Int64, Int64]:
        """Triangle, and its corners at the edge's lower and higher vertex."""
        triangle, corner = edge // 3, edge % 3
        after, turned = (corner + 1) % 3, backward[edge]
        return triangle, np.where(turned, after, corner), np.where(turned, corner, after)

    def ends(edge: Int64) -> tuple[Float64, Int64]:
        triangle, first, last = corners(edge)
        return np.stack([uv[triangle, first], uv[triangle, last]], axis=1), texels.page[triangle].astype(np.int64)

    def normals(edge: Int64) -> Float32:
        triangle, first, last = corners(edge)
        return np.stack([surfaces.corner_normals[triangle, first], surfaces.corner_normals[triangle, last]], axis=1)

    (end, page), (end_b, page_b) = ends(one), ends(other)
    apart = np.flatnonzero((np.abs(end - end_b) > 0.01).any((1, 2)) | (page != page_b))
    alike = np.einsum("eij,eij->ei", normals(one[apart]), normals(other[apart])) > SMOOTH
    chosen = apart[alike.all(1)]
    return (end[chosen], page[chosen]), (end_b[chosen], page_b[chosen])


def _vertices(surfaces: Surfaces) -> Int64:
    """One number (F, 3) for all corners at the same place, on a grid of the ray offset: 2^20 steps to each side."""
    grid = np.rint(surfaces.corners.reshape(-1, 3) / np.float32(surfaces.offset or 1.0)).astype(np.int64)
    place = (grid[:, 0] << 42) + (grid[:, 1] << 21) + grid[:, 2]
    order = np.argsort(place, kind="stable")
    ranked = place[order]
    number = np.empty(len(place), np.int64)
    number[order] = np.cumsum(np.concatenate([[0], ranked[1:] != ranked[:-1]])[: len(order)])
    number[3 * surfaces.fronts :] += len(number)  # the other side of a surface is not beside it
    return number.reshape(-1, 3)
