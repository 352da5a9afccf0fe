# SPDX-License-Identifier: GPL-3.0-or-later
"""Penumbrae made smooth: planes come back, edges stay, and what is pooled or fitted together is as it is apart."""

from __future__ import annotations

from functools import cache

import numpy as np

from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import Texels, rasterize
from radiosity_addon.lighting.penumbra import smooth_penumbrae
from radiosity_addon.lighting.shades import Shades, pooled, pooled_at
from radiosity_addon.scene import Scene
from tests.lamps import GREY
from tests.shapes import box, cell_atlas

NOISE = 0.05
RANDOM = np.random.default_rng(5)


@cache
def faces() -> Texels:
    """Texels of a box's faces, each a chart."""
    scene = Scene((box("Box", (0, 0, 0), (1, 1, 1), 0),), (GREY,))
    return finish(rasterize(cell_atlas(scene, 192), flatten(scene)))


def ramp() -> np.ndarray:
    """Shares (T,) that are linear on each face."""
    position = faces().position
    return (0.5 + 0.2 * position[:, 0] + 0.3 * position[:, 1] - 0.1 * position[:, 2]).astype(np.float32)


def smoothed(shares: np.ndarray, noise: float = NOISE) -> np.ndarray:
    """Shares (C, T), fitted everywhere."""
    texels, found = faces(), shares.copy()
    everywhere = np.arange(texels.count)
    finish(smooth_penumbrae(texels, everywhere, found, np.full_like(found, noise**2), texels.valid, 1))
    return found


def noisy(channels: int) -> np.ndarray:
    return (ramp() + NOISE * RANDOM.standard_normal((channels, faces().count))).astype(np.float32)


def test_noise_falls_by_what_a_plane_over_25_texels_leaves_of_it() -> None:
    """Its value in the middle is the mean of them: a fifth of the noise."""
    left = (smoothed(noisy(1), 2 * NOISE) - ramp())[0]
    assert 0.8 < np.sqrt(np.mean(left**2)) / (NOISE / 5) < 2.0  # windows at a face's edge are smaller


def test_what_noise_does_not_explain_stays_as_it_is() -> None:
    step = (faces().position[:, :1].T > 0.1).astype(np.float32)
    assert np.array_equal(smoothed(step, 0.01), step)


def test_colours_that_are_fitted_together_are_as_if_each_was_alone() -> None:
    shares = noisy(3)
    shares[1] = np.round(shares[1])  # fits nowhere
    assert np.array_equal(smoothed(shares), np.concatenate([smoothed(each[None]) for each in shares]))


def test_shades_around_few_texels_are_those_around_all() -> None:
    texels = faces()
    shades = Shades(*RANDOM.integers(0, 256, (2, texels.count)).astype(np.uint8))
    whole = finish(pooled(shades, texels, 2, 1))
    some = RANDOM.choice(texels.count, 500, replace=False)
    found = finish(pooled_at(shades, texels, some, 2, 1))
    assert np.array_equal(found.low, whole.low[some])
    assert np.array_equal(found.high, whole.high[some])
