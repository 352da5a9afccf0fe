# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive subdivision: patches are split where the radiosity changes across them.

As in Cohen, Greenberg, Immel and Brock (1986), a coarse solution tells where; but what is split is the grid that the
patches are cells of, a quarter of a cell at a time, so that patches still follow the surface and not the mesh.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Bools, Float32, Float64, Int32, Int64
from ..geometry.appearance import Appearance
from .patches import Patches

STEEP = 0.08
"""Patches are split where the radiosity's spread within one, or its step to the next, is this share of the mean."""

EVENINGS = 3
"""How often the light of patches is evened out before steps are looked for: each takes out most of what is left of the
noise, and of no step that is wider than a few patches."""


def steep_patches(patches: Patches, look: Appearance, direct: Float32, irradiance: Float32) -> Bools:
    """Which of the N patches (N,) are to be split.

    Args:
        direct: (T, G, 3) float32, W/m2, irradiance from lamps
        irradiance: (N, G, 3), W/m2, of patches, from other patches and the sky
    """
    count = patches.count
    owner = patches.of_element[: patches.texels.count]
    taking = np.flatnonzero((owner >= 0) & (patches.stopping > 0))
    owner, area = owner[taking], patches.stopping[taking].astype(np.float64)
    own = np.einsum("tgc,tc->t", direct[taking], look.reflectance[taking]) + np.pi * look.emission[taking].sum(1)
    received = (irradiance * patches.reflectance[:, None]).sum((1, 2)).astype(np.float64)
    extent = np.maximum(np.bincount(owner, area, count), 1e-30)
    mean = np.bincount(owner, area * own, count) / extent
    spread = np.sqrt(np.maximum(np.bincount(owner, area * own**2, count) / extent - mean**2, 0))
    one, other = _beside(patches)
    step = np.zeros(count)
    even = _evened(received, one, other)
    for patch in (one, other):
        np.maximum.at(step, patch, np.abs(even[one] - even[other]))
    level = STEEP * float((extent * (mean + received)).sum() / extent.sum())
    return np.asarray(np.maximum(spread, step) > level)


def _beside(patches: Patches) -> tuple[Int64, Int64]:
    """Pairs (P,), (P,) of patches that lie beside each other on a page, once each."""
    texels = patches.texels
    owner = patches.of_element[: texels.count].astype(np.int64)
    last = len(texels.texel_at) - 1
    keys = []
    for step in (1, texels.size):
        beside = texels.texel_at[np.minimum(texels.pixel + step, last)]
        pair = np.flatnonzero((beside >= 0) & (owner >= 0))
        one, other = owner[pair], owner[beside[pair]]
        kept = (other >= 0) & (one != other)
        one, other = one[kept], other[kept]
        keys.append(np.minimum(one, other) * patches.count + np.maximum(one, other))
    one, other = np.divmod(np.unique(np.concatenate(keys)), patches.count)
    return one, other


def _evened(value: Float64, one: Int64, other: Int64) -> Float64:
    """Values (N,) with much of the noise of their rays taken out: means with those beside them, some times over."""
    for _ in range(EVENINGS):
        total, number = value.copy(), np.ones(len(value))
        for here, there in ((one, other), (other, one)):
            total += np.bincount(here, value[there], len(value))
            number += np.bincount(here, minlength=len(value))
        value = total / number
    return value


def split(levels: Int32, patches: Patches, steep: Bools) -> Int32:
    """Levels (T,) of subdivision of texels, one more in patches that are `steep` (N,)."""
    owner = patches.of_element[: patches.texels.count]
    return levels + (steep[np.maximum(owner, 0)] & (owner >= 0)).astype(np.int32)


def patch_edges(patches: Patches) -> Bools:
    """(T,) texels beside which another patch begins, or the chart ends."""
    texels = patches.texels
    owner = patches.of_element[: texels.count]
    last = len(texels.texel_at) - 1
    edge = np.zeros(texels.count, bool)
    for step in (1, texels.size):
        beside = texels.texel_at[np.minimum(texels.pixel + step, last)]
        edge |= (beside < 0) | (owner[np.maximum(beside, 0)] != owner)
    return edge
