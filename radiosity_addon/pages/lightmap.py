# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages from texels: invalid texels filled from their own surface, gutters filled from what lies next to them."""

from __future__ import annotations

import numpy as np

from ..arrays import Bools, Float32, Int32
from ..geometry.surfaces import BLOCK
from ..geometry.texels import Texels
from .seams import close_seams

GROWTH = 4
"""Steps by which charts are grown over invalid texels and gutters before the rest is filled coarsely."""


def compose(texels: Texels, irradiance: Float32, page_count: int) -> list[Float32]:
    """Pages (S, S, 3) float32, W/(m2 sr), row 0 at v = 0, holding H / pi in every texel.

    Args:
        irradiance: (T, G, 3), W/m2; light groups are added up
        page_count: pages wanted; those after them are hidden ones
    """
    size = texels.size
    count = texels.before(page_count * size * size)
    pages: Float32 = np.zeros((page_count * size * size, 3), np.float32)
    known = np.zeros(len(pages), bool)
    component = texels.surfaces.component
    seen = np.zeros(int(component.max(initial=-1)) + 1, bool)
    for start in range(0, count, BLOCK):
        chosen = start + np.flatnonzero(texels.valid[start : min(start + BLOCK, count)])
        groups = irradiance.take(chosen, axis=0)
        light = groups[:, 0]
        for group in range(1, irradiance.shape[1]):
            light += groups[:, group]
        light *= np.float32(1 / np.pi)
        pages[texels.pixel[chosen]] = light
        known[texels.pixel[chosen]] = True
        seen[component[texels.triangle[chosen]]] = True
    hidden = np.flatnonzero(~texels.valid[:count])
    buried = hidden[~seen[component[texels.triangle[hidden]]]]
    known[texels.pixel[buried]] = True  # a surface without a valid texel lies inside a solid, where it is dark
    close_seams(pages, known, texels)
    shape = (page_count, size, size)
    result = list(pages.reshape(*shape, 3))
    for image, there in zip(result, known.reshape(shape), strict=True):
        for _ in range(GROWTH):
            grow(image, there)
        push_pull(image, there)
    return result


def show_fronts(irradiance: Float32, behind: Int32) -> None:
    """Let texels at the back of a sheet, in place, hold the light at its front if that is brighter.

    Filters mix it in there, as a dark rim. A texel can't serve both sides; the front is the one that is meant to be
    seen, unless it is the darker one: then the sheet may well be turned the wrong way round.

    Args:
        irradiance: (T, G, 3)
        behind: (2, K) texels at the back, and those beside them at the front
    """
    here, order = np.unique(behind[0], return_inverse=True)
    share = 1 / np.bincount(order)
    light = np.zeros((len(here), *irradiance.shape[1:]), np.float32)
    np.add.at(light, order, irradiance[behind[1]] * share[order, None, None].astype(np.float32))
    brighter = np.flatnonzero(light.sum((1, 2)) > irradiance[here].sum((1, 2)))
    irradiance[here[brighter]] = light[brighter]


def grow(image: Float32, known: Bools) -> None:
    """One step outward, in place: the mean over known neighbours, the diagonal ones at half weight."""
    height, width = known.shape
    wanted = np.zeros_like(known)
    wanted[1:] |= known[:-1]
    wanted[:-1] |= known[1:]
    wide = wanted | known
    wanted[:, 1:] |= wide[:, :-1]
    wanted[:, :-1] |= wide[:, 1:]
    wanted &= ~known
    pixel = np.flatnonzero(wanted).astype(np.int32)
    flat, there = image.reshape(-1, 3), known.reshape(-1)
    mean = np.empty((len(pixel), 3), np.float32)
    for start in range(0, len(pixel), BLOCK):
        row, column = np.divmod(pixel[start : start + BLOCK], np.int32(width))
        total = np.zeros((len(row), 3), np.float32)
        weight = np.zeros(len(row), np.float32)
        for dy in (-1, 0, 1):
            line = np.minimum(np.maximum(row + np.int32(dy), 0), np.int32(height - 1)) * np.int32(width)
            for dx in (-1, 0, 1):
                beside = line + np.minimum(np.maximum(column + np.int32(dx), 0), np.int32(width - 1))
                met = np.flatnonzero(there.take(beside))
                share = np.float32(0.5 if dx and dy else 1.0)
                total[met] += flat.take(beside.take(met), axis=0) * share
                weight[met] += share
        mean[start : start + BLOCK] = total / weight[:, None]
    flat[pixel] = mean
    there[pixel] = True


def push_pull(image: Float32, known: Bools) -> None:
    """Fill (H, W, 3), in place, where not `known` from ever coarser means (Gortler et al. 1996, section 3.5)."""
    unknown = np.flatnonzero(~known)
    if len(unknown) in (0, known.size):
        return
    height, width = known.shape
    flat = image.reshape(-1, 3)
    flat[unknown] = 0
    tall, wide = (height + 1) // 2, (width + 1) // 2
    coarse = np.zeros((tall, wide, 3), np.float32)
    total = np.zeros((tall, wide), np.float32)
    for y in (0, 1):
        for x in (0, 1):
            part = known[y::2, x::2]
            coarse[: part.shape[0], : part.shape[1]] += image[y::2, x::2]
            total[: part.shape[0], : part.shape[1]] += part
    coarse /= np.maximum(total, 1)[:, :, None]
    push_pull(coarse, np.asarray(total > 0))
    flat[unknown] = coarse.reshape(-1, 3)[unknown // width // 2 * wide + unknown % width // 2]
