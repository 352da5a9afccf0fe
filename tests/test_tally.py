# SPDX-License-Identifier: GPL-3.0-or-later
"""What the rays of gather points count."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.arrays import Float32
from radiosity_addon.chunks import finish
from radiosity_addon.gather.tally import BELOW, RayCounts, Tally
from radiosity_addon.radiosity.patches import NOTHING


def tally(elements: list[list[int]], weights: list[list[float]], pilots: int) -> Tally:
    return Tally(
        np.array(elements, np.int32),
        np.array(weights, np.float32),
        RayCounts(pilots, len(elements[0]) - pilots),
        np.zeros(len(elements), bool),
        np.zeros((len(elements), len(elements[0])), bool),
    )


def summed(table: Float32) -> Float32:
    """Radiances (elements, C) as rays read them: with their sum as a last column."""
    return np.column_stack([table, table.sum(1)])


def test_an_evenly_bright_view_gives_pi_times_its_radiance_whatever_the_weights_sum_to() -> None:
    rng = np.random.default_rng(5)
    table = np.full((20, 3), 0.7, np.float32)
    rays = Tally(
        rng.integers(0, 20, (50, 24)).astype(np.int32),
        rng.random((50, 24)).astype(np.float32),
        RayCounts(16, 8),
        np.zeros(50, bool),
        np.zeros((50, 24), bool),
    )
    assert finish(rays.sum(summed(table), 1))[0] == pytest.approx(np.pi * 0.7, rel=1e-5)


def test_rays_below_the_horizon_count_as_dark_and_those_that_met_nothing_are_made_up_for() -> None:
    table = np.zeros((2 + 3, 1), np.float32)
    table[:2] = 1  # two bright elements, and the rows of BELOW, NOTHING and SKY
    quarter = [np.pi / 4] * 4
    seen, _ = finish(tally([[0, 1, BELOW, BELOW], [0, 1, NOTHING, 1]], [quarter, quarter], 4).sum(summed(table), 1))
    assert seen[0, 0] == pytest.approx(np.pi / 2, rel=1e-5)
    assert seen[1, 0] == pytest.approx(np.pi, rel=1e-5)


def test_a_sum_is_the_same_for_any_number_of_threads() -> None:
    rng = np.random.default_rng(6)
    rays = Tally(
        rng.integers(0, 99, (3000, 64)).astype(np.int32),
        rng.random((3000, 64)).astype(np.float32),
        RayCounts(48, 16),
        np.arange(3000) % 3 > 0,
        rng.random((3000, 64)) < 0.5,
    )
    table = summed(rng.random((99, 6)).astype(np.float32))
    (one, one_far), (two, two_far) = (finish(rays.sum(table, workers)) for workers in (1, 2))
    assert np.array_equal(one, two)
    assert np.array_equal(one_far.irradiance, two_far.irradiance)


def test_what_comes_from_afar_is_told_from_the_rest() -> None:
    """Of four pilots one met nothing and two got far, and so did the one guided ray."""
    table = np.float32([[1, 2, 3], [4, 4, 4], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    rays = Tally(
        np.int32([[0, 1, 1, NOTHING, 0]]),
        np.full((1, 5), np.pi / 4, np.float32),
        RayCounts(4, 1),
        np.zeros(1, bool),
        np.array([[False, True, True, False, True]]),
    )
    total, far = finish(rays.sum(summed(table), 1))
    assert total[0] == pytest.approx(np.pi / 4 * np.float32([2 + 8, 4 + 8, 6 + 8]), rel=1e-5)
    missing = (2 / 3 * np.pi - 3 / 4 * np.pi) / 2  # of each pilot that got far; of level (1 + 2 + 3 + 2 * 12) / 3
    dim = 10 / 12
    expected = np.pi / 4 * np.float32([1 + 8, 2 + 8, 3 + 8]) + missing * dim * 8
    assert far.irradiance[0] == pytest.approx(expected, rel=1e-5)
    assert far.openness == pytest.approx(2 / 3)


def test_no_points_give_no_light() -> None:
    rays = Tally.empty(RayCounts(3, 1), np.zeros(0, bool), tinted=False)
    assert finish(rays.sum(np.zeros((3, 7), np.float32), 1))[0].shape == (0, 6)
