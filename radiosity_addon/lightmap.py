# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages from texels: invalid texels filled from their own surface, gutters filled from what lies next to them."""

from __future__ import annotations

import numpy as np

from .arrays import Bools, Float32
from .seams import close_seams
from .texels import Texels

GROWTH = 4
"""Steps by which charts are grown over invalid texels and gutters before the rest is filled coarsely."""


def compose(texels: Texels, irradiance: Float32, page_count: int) -> list[Float32]:
    """Pages (S, S, 3) float32, W/(m2 sr), row 0 at v = 0, holding H / pi in every texel.

    Args:
        irradiance: (T, G, 3), W/m2; light groups are added up
        page_count: pages wanted; those after them are hidden ones
    """
    size = texels.size
    taking = slice(0, int(np.searchsorted(texels.pixel, page_count * size * size)))
    valid = texels.valid[taking]
    pixel = texels.pixel[taking][valid]
    pages: Float32 = np.zeros((page_count * size * size, 3), np.float32)
    pages[pixel] = irradiance[taking][valid].sum(1) / np.float32(np.pi)
    known = np.zeros(len(pages), bool)
    known[pixel] = True
    buried = _buried(texels, taking)
    known[texels.pixel[taking][buried]] = True
    close_seams(pages, known, texels)
    shape = (page_count, size, size)
    return [_filled(*page) for page in zip(pages.reshape(*shape, 3), known.reshape(shape), strict=True)]


def _buried(texels: Texels, taking: slice) -> Bools:
    """(t,) bool: invalid texels of surfaces without any valid one: things inside a solid, where it is dark."""
    component = texels.surfaces.component[texels.triangle[taking, 0]]
    valid = texels.valid[taking]
    seen = np.zeros(int(component.max(initial=0)) + 1, bool)
    seen[component[valid]] = True
    return ~valid & ~seen[component]


def _filled(image: Float32, known: Bools) -> Float32:
    for _ in range(GROWTH):
        image, known = _grown(image, known)
    return push_pull(image, known)


def _grown(image: Float32, known: Bools) -> tuple[Float32, Bools]:
    """One step outward: the mean over known neighbours, the diagonal ones at half weight."""
    height, width = known.shape
    wanted = np.zeros_like(known)
    wanted[1:] |= known[:-1]
    wanted[:-1] |= known[1:]
    wide = wanted | known
    wanted[:, 1:] |= wide[:, :-1]
    wanted[:, :-1] |= wide[:, 1:]
    rows, columns = np.nonzero(wanted & ~known)
    total = np.zeros((len(rows), 3), np.float32)
    weight = np.zeros(len(rows), np.float32)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            y, x = np.clip(rows + dy, 0, height - 1), np.clip(columns + dx, 0, width - 1)
            share = known[y, x] * np.float32(0.5 if dx and dy else 1.0)
            total += image[y, x] * share[:, None]
            weight += share
    image, known = image.copy(), known.copy()
    met = weight > 0
    image[rows[met], columns[met]] = total[met] / weight[met, None]
    known[rows[met], columns[met]] = True
    return image, known


def push_pull(image: Float32, known: Bools) -> Float32:
    """Fill (H, W, 3) where not `known` from ever coarser means (Gortler et al. 1996, section 3.5)."""
    if known.all() or not known.any():
        return image
    height, width = known.shape
    padded = np.zeros((height + height % 2, width + width % 2, 3), np.float32)
    weight = np.zeros(padded.shape[:2], np.float32)
    padded[:height, :width] = image * known[:, :, None]
    weight[:height, :width] = known
    coarse = sum(padded[y::2, x::2] for y in (0, 1) for x in (0, 1))
    total = sum(weight[y::2, x::2] for y in (0, 1) for x in (0, 1))
    mean = np.asarray(coarse / np.maximum(total, 1)[:, :, None], np.float32)
    mean = push_pull(mean, np.asarray(total > 0))
    wide = np.repeat(np.repeat(mean, 2, axis=0), 2, axis=1)[:height, :width]
    return np.where(known[:, :, None], image, wide)
