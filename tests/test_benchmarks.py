# SPDX-License-Identifier: GPL-3.0-or-later
"""What benchmarks make of curves that were measured: noise and floor, levels that are reached, growth."""

from __future__ import annotations

import math

import pytest

from benchmarks._curves import NoiseFit, crossing, exponent, first_reaching, fit_cost, fit_noise, noise_to_extrapolate

SAMPLES = [1, 4, 16, 64, 256]


def test_noise_and_floor_are_found_again() -> None:
    made = NoiseFit(0.4, 0.01)
    found = fit_noise(SAMPLES, [made.error(count) for count in SAMPLES])
    assert (found.noise, found.floor) == pytest.approx((0.4, 0.01))


@pytest.mark.parametrize(("noise", "floor"), [(0.4, 0.0), (0.0, 0.02)])
def test_neither_noise_nor_floor_falls_below_zero(noise: float, floor: float) -> None:
    """The first error is a little too high, or too low: a free fit would put the other part below zero."""
    errors = [NoiseFit(noise, floor).error(count) * ((1.3 if noise else 0.8) if count == 1 else 1) for count in SAMPLES]
    found = fit_noise(SAMPLES, errors)
    assert found.noise == pytest.approx(noise, rel=0.1)
    assert found.floor == pytest.approx(floor, rel=0.1)


def test_one_point_tells_noise_only() -> None:
    assert fit_noise([16], [0.1]) == NoiseFit(pytest.approx(0.4), 0.0)


def test_samples_are_the_inverse_of_the_error() -> None:
    made = NoiseFit(0.4, 0.01)
    assert made.error(made.samples(0.025)) == pytest.approx(0.025)


def test_no_number_of_samples_gets_below_the_floor() -> None:
    assert NoiseFit(0.4, 0.01).samples(0.01) is None


def test_without_a_floor_half_the_error_costs_four_times_the_samples() -> None:
    made = NoiseFit(0.4, 0.0)
    assert made.samples(0.01) == pytest.approx(4 * made.samples(0.02))


def test_a_floor_far_below_the_last_error_is_taken_for_chance() -> None:
    errors = [NoiseFit(0.4, 0.005).error(count) for count in SAMPLES]
    assert noise_to_extrapolate(SAMPLES, errors) == NoiseFit(pytest.approx(0.4, rel=0.02), 0.0)


def test_a_floor_that_the_last_error_has_nearly_reached_counts() -> None:
    errors = [NoiseFit(0.4, 0.03).error(count) for count in SAMPLES]
    assert noise_to_extrapolate(SAMPLES, errors).floor == pytest.approx(0.03)


def test_two_measurements_tell_of_no_floor() -> None:
    assert noise_to_extrapolate([1, 2], [1.8, 1.5]).floor == 0.0


def test_noise_is_extrapolated_from_the_last_measurements() -> None:
    errors = [9.0, 0.4 / 2, 0.4 / 4, 0.4 / 8, 0.4 / 16]
    assert noise_to_extrapolate(SAMPLES, errors).noise == pytest.approx(0.4)


def test_cost_is_a_start_and_a_price_a_sample() -> None:
    found = fit_cost([1, 4, 16], [2.5, 4.0, 10.0])
    assert found.seconds(64) == pytest.approx(34.0)


def test_a_start_is_not_below_zero() -> None:
    assert fit_cost([1, 10], [0.1, 10.0]).start == 0.0


def test_a_level_between_two_points_is_reached_in_between_on_logarithmic_scales() -> None:
    assert crossing([1, 100], [0.1, 0.001], 0.01) == pytest.approx(10.0)


def test_a_level_is_reached_where_the_curve_first_falls_to_it() -> None:
    """A denoiser's error may rise again with more samples."""
    assert crossing([1, 4, 16, 64], [0.08, 0.02, 0.03, 0.01], 0.02) == pytest.approx(4.0)


def test_what_no_point_reaches_is_never_reached() -> None:
    assert crossing([1, 100], [0.1, 0.02], 0.01) is None
    assert first_reaching([1, 100], [0.1, 0.02], 0.01) is None


def test_a_first_point_below_the_level_counts_with_its_own_time() -> None:
    assert crossing([3, 9], [0.01, 0.005], 0.02) == 3.0


def test_without_points_in_between_the_next_one_that_reaches_counts() -> None:
    assert first_reaching([1, 2, 4], [0.03, 0.02, 0.01], 0.025) == 2


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_the_exponent_of_a_power_is_that_power(power: float) -> None:
    sizes = [10, 100, 3000]
    assert exponent(sizes, [7 * math.pow(size, power) for size in sizes]) == pytest.approx(power)
