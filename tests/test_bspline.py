# SPDX-License-Identifier: GPL-3.0-or-later
"""The basis functions: what defines them, on knot vectors of every kind."""

from __future__ import annotations

from functools import cache
from math import comb

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from radiosity_addon.curves.bspline import (
    Basis,
    bezier_pieces,
    clamped_knots,
    opened,
    periodic_basis,
    uniform_knots,
    with_knot,
)


@st.composite
def bases(draw: st.DrawFn, most_repeats: int = 100) -> Basis:
    """Any degree, any number of points, knots with repeats."""
    degree = draw(st.integers(0, 6))
    points = draw(st.integers(degree + 1, degree + 8))
    sizes = [0.25, 1.0, 3.0] + [0.0] * (most_repeats > 1)
    gaps = draw(st.lists(st.sampled_from(sizes), min_size=points + degree, max_size=points + degree))
    knots, repeats = [0.0], 1
    for gap in gaps:
        repeats = 1 if gap else repeats + 1
        if repeats > min(most_repeats, degree + 1):
            gap, repeats = 1.0, 1
        knots.append(knots[-1] + gap)
    assume(knots[points] > knots[degree])
    return Basis(degree, np.array(knots), points)


def inside(basis: Basis, count: int = 37) -> np.ndarray:
    return np.linspace(*basis.domain, count)


@given(bases())
@settings(max_examples=80, deadline=None)
def test_functions_sum_to_one_and_are_never_negative(basis):
    matrix = basis.matrix(inside(basis))
    assert np.allclose(matrix.sum(axis=1), 1, atol=1e-12)
    assert matrix.min() > -1e-14


@given(bases(), st.data())
@settings(max_examples=80, deadline=None)
def test_a_control_point_changes_nothing_outside_of_its_knots(basis, data):
    which = data.draw(st.integers(0, basis.points - 1))
    t = inside(basis)
    reach = basis.knots[which], basis.knots[which + basis.degree + 1]
    beyond = (t < reach[0]) | (t > reach[1])
    assert not basis.matrix(t)[beyond, which].any()


@given(bases())
@settings(max_examples=40, deadline=None)
def test_values_are_those_of_the_recursion_with_nothing_by_nothing_as_nothing(basis):
    k = basis.knots
    t = inside(basis)[:-1] + 1e-9  # clear of the knots, where the recursion's half-open spans decide

    @cache
    def recursion(i: int, degree: int) -> np.ndarray:
        if degree == 0:
            return ((t >= k[i]) & (t < k[i + 1])).astype(float)
        left, right = k[i + degree] - k[i], k[i + degree + 1] - k[i + 1]
        first = (t - k[i]) / left * recursion(i, degree - 1) if left > 0 else 0.0
        second = (k[i + degree + 1] - t) / right * recursion(i + 1, degree - 1) if right > 0 else 0.0
        return first + second

    expected = np.stack([recursion(i, basis.degree) + np.zeros(len(t)) for i in range(basis.points)], axis=1)
    assert np.allclose(basis.matrix(t), expected, atol=1e-7)


@pytest.mark.parametrize(("degree", "repeats"), [(m, k) for m in range(1, 6) for k in range(1, m + 1)])
def test_a_knot_takes_as_many_derivatives_as_it_is_repeated(degree, repeats):
    knots = np.concatenate([np.zeros(degree + 1), np.full(repeats, 1.0), np.full(degree + 1, 2.0)])
    basis = Basis(degree, knots, len(knots) - degree - 1)
    at = np.array([1.0])
    jumps = [
        np.abs(basis.matrix(at, k) - basis.matrix(at, k, from_left=True)).max() for k in range(degree - repeats + 2)
    ]
    assert basis.continuity(1.0) == degree - repeats
    assert max(jumps[:-1]) < 1e-9  # C^(degree - repeats)
    assert jumps[-1] > 0.1  # and no more


@given(bases(most_repeats=1))
@settings(max_examples=40, deadline=None)
def test_derivatives_are_the_slopes_of_the_values(basis):
    t = inside(basis)[1:-1] + 1e-4
    t = t[np.abs(t[:, None] - basis.knots).min(axis=1) > 1e-5]
    for k in range(basis.degree):
        slope = (basis.matrix(t + 1e-6, k) - basis.matrix(t - 1e-6, k)) / 2e-6
        assert np.allclose(slope, basis.matrix(t, k + 1), atol=1e-3, rtol=1e-5)


def test_a_single_span_between_clamped_ends_holds_bernstein_polynomials():
    t = np.linspace(0, 1, 11)
    for degree in range(1, 7):
        basis = Basis(degree, clamped_knots(degree + 1, degree), degree + 1)
        bernstein = [comb(degree, i) * t**i * (1 - t) ** (degree - i) for i in range(degree + 1)]
        assert np.allclose(basis.matrix(t), np.stack(bernstein, axis=1), atol=1e-14)


def test_a_bezier_curve_is_what_de_casteljau_finds():
    control = np.random.default_rng(0).normal(size=(2, 6))
    points = control
    for _ in range(5):
        points = 0.7 * points[:, :-1] + 0.3 * points[:, 1:]
    basis = Basis(5, clamped_knots(6, 5), 6)
    assert np.allclose(basis.blend(control, np.array([0.3])), points, atol=1e-14)


def test_a_clamped_spline_meets_its_end_points():
    control = np.random.default_rng(1).normal(size=(3, 7))
    basis = Basis(3, clamped_knots(7, 3), 7)
    assert np.allclose(basis.blend(control, np.array(basis.domain)), control[:, [0, -1]], atol=1e-14)


def test_a_knot_as_often_as_the_degree_meets_its_control_point():
    knots = np.array([0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 2.0])
    control = np.random.default_rng(2).normal(size=(2, 7))
    assert np.allclose(Basis(3, knots, 7).blend(control, np.array([1.0]))[:, 0], control[:, 3], atol=1e-14)


def test_an_open_uniform_spline_needs_points_plus_degree_plus_one_knots():
    assert len(uniform_knots(6, 3)) == 10
    with pytest.raises(ValueError, match="too few"):
        Basis(3, np.arange(9.0), 6)


@pytest.mark.parametrize("knots", [[0, 1, 0.5, 2], [0, np.nan, 1, 2], [1, 1, 1, 1]])
def test_knots_that_fall_or_span_nothing_are_refused(knots):
    with pytest.raises(ValueError):
        Basis(1, np.array(knots, float), 2)


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
def test_a_closed_spline_joins_as_smoothly_as_it_runs(degree):
    basis = periodic_basis(degree + 3, degree)
    start, end = (np.array([t]) for t in basis.domain)
    for k in range(degree):
        assert np.allclose(basis.matrix(start, k), basis.matrix(end, k, from_left=True), atol=1e-10)
    assert not np.allclose(basis.matrix(start, degree), basis.matrix(end, degree, from_left=True), atol=1e-3)


def test_a_closed_spline_repeats_its_first_points_after_the_last():
    closed = periodic_basis(5, 3)
    control = np.random.default_rng(3).normal(size=(2, 5))
    basis, repeated = opened(closed, control)
    assert np.array_equal(repeated[:, 5:], control[:, :3])
    t = inside(closed)
    assert np.allclose(basis.blend(repeated, t), closed.blend(control, t), atol=1e-14)


@given(bases(most_repeats=3), st.floats(0.01, 0.99), st.integers(1, 3))
@settings(max_examples=50, deadline=None)
def test_a_knot_more_leaves_the_curve_as_it_was(basis, share, times):
    low, high = basis.domain
    control = np.random.default_rng(4).normal(size=(2, basis.points))
    more, finer = with_knot(basis, control, low + share * (high - low), times)
    t = inside(basis)
    assert more.points >= basis.points
    assert np.allclose(more.blend(finer, t), basis.blend(control, t), atol=1e-9)


@given(bases(most_repeats=1))
@settings(max_examples=40, deadline=None)
def test_every_span_is_a_bezier_curve(basis):
    if basis.degree == 0:
        return
    control = np.random.default_rng(5).normal(size=(2, basis.points))
    bezier = Basis(basis.degree, clamped_knots(basis.degree + 1, basis.degree), basis.degree + 1)
    share = np.linspace(0.01, 0.99, 9)
    for piece, low, high in zip(bezier_pieces(basis, control), basis.breaks, basis.breaks[1:], strict=False):
        expected = basis.blend(control, low + (high - low) * share)
        assert np.allclose(bezier.blend(piece, share), expected, atol=1e-8)


def test_a_million_points_take_little_time():
    basis = Basis(3, clamped_knots(100, 3), 100)
    first, values = basis.banded(np.linspace(0, 97, 1_000_000))
    assert values.shape == (4, 1_000_000)
    assert first.max() == 96


def test_a_knot_is_never_repeated_more_often_than_the_degree():
    basis = Basis(3, clamped_knots(6, 3), 6)
    more, _ = with_knot(basis, np.zeros((1, 6)), 1.5, times=9)
    assert np.count_nonzero(more.knots == 1.5) == 3
