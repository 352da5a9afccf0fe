# SPDX-License-Identifier: GPL-3.0-or-later
"""Where guided rays of the gather go."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.gather.guiding import (
    BIN_DENSITY,
    BINS,
    TURNS,
    direction_bins,
    directions_in,
    draw_bins,
    pool,
    sweep_starts,
)


def test_directions_in_a_bin_belong_to_it() -> None:
    rng = np.random.default_rng(1)
    bins = np.repeat(np.arange(BINS), 8)
    u, v = (0.001 + 0.998 * rng.random((2, len(bins)))).astype(np.float32)
    directions = directions_in(bins, u, v)
    assert np.abs(np.linalg.norm(directions, axis=1) - 1).max() < 1e-5
    assert np.array_equal(direction_bins(directions), bins)


def test_bins_are_of_equal_solid_angle() -> None:
    rng = np.random.default_rng(2)
    vectors = rng.normal(size=(400_000, 3))
    directions = (vectors / np.linalg.norm(vectors, axis=1)[:, None]).astype(np.float32)
    seen = np.bincount(direction_bins(directions), minlength=BINS)
    mean = len(directions) / BINS
    assert ((seen - mean) ** 2 / mean).sum() == pytest.approx(BINS - 1, abs=5 * np.sqrt(2 * BINS)), "chi squared"


def test_a_histogram_of_light_is_a_density_over_the_sphere_and_a_dark_one_is_none() -> None:
    groups = np.array([0, 0, 0, 2])
    density = pool(groups, 3, np.array([5, 5, 300, 0]), np.float32([1, 2, 1, 4]))
    total = density.sum(1) / BIN_DENSITY
    assert total[[0, 2]] == pytest.approx(1, abs=0.05), "but for what the poles spread beyond"
    assert total[1] == 0
    assert density[0].argmax() == 5
    assert density[0, 5] == pytest.approx(3 * density[0, 300], rel=1e-5)
    assert density[2, 0] > density[2, TURNS - 1] > 0, "neighbours meet around the axis"


def test_bins_are_drawn_in_proportion_to_their_density() -> None:
    rng = np.random.default_rng(3)
    density = (rng.random((4, BINS)) ** 8).astype(np.float32)
    density *= BIN_DENSITY / density.sum(1, keepdims=True)
    samples = 10_000
    drawn = draw_bins(density, samples, np.arange(4), np.array([0.0, 0.3, 0.6, 0.9]))
    for row, bins in enumerate(drawn):
        expected = samples * density[row] / BIN_DENSITY
        assert np.abs(np.bincount(bins, minlength=BINS) - expected).max() <= 1.01


def test_points_of_one_group_share_its_light_evenly_between_them() -> None:
    """Each of 16 points draws every bin too often or too seldom by up to 1: if alike, by up to 16 in all."""
    density = np.random.default_rng(4).random((2, BINS)).astype(np.float32)
    density *= BIN_DENSITY / density.sum(1, keepdims=True)
    group, samples = np.repeat([1, 0], 16), 100
    drawn = draw_bins(density, samples, group, sweep_starts(group, np.tile(np.arange(16), 2)))
    for row in (0, 1):
        found = np.bincount(drawn[group == row].reshape(-1), minlength=BINS)
        assert np.abs(found - 16 * samples * density[row] / BIN_DENSITY).max() < 3
