# SPDX-License-Identifier: GPL-3.0-or-later
"""Rational curves and surfaces against shapes that are known on paper."""

from __future__ import annotations

import time

import numpy as np
import pytest

from radiosity_addon.curves.bspline import Basis, clamped_knots
from radiosity_addon.curves.nurbs import Curve, Surface
from radiosity_addon.curves.patchwork import Net, patchwork
from radiosity_addon.curves.tessellation import CHORD, TURN, extent, grid_parameters, smooth_normals
from tests.splines import circle, cone, sheet, sphere, torus


def test_a_rational_quadratic_is_an_exact_circle():
    curve = circle()
    t = np.linspace(0, 4, 1001)
    assert np.abs(np.linalg.norm(curve.at(t), axis=1) - 1).max() < 1e-12
    assert curve.arc_length(np.array([1.0, 4.0])) == pytest.approx([np.pi / 2, 2 * np.pi], abs=1e-12)


def test_a_rational_quadratic_is_an_exact_ellipse_and_hyperbola():
    basis = Basis(2, clamped_knots(3, 2), 3)
    t = np.linspace(0, 1, 101)
    quarter = Curve(basis, np.array([[2, 0, 0], [2, 1, 0], [0, 1, 0.0]]), np.array([1, np.sqrt(0.5), 1]))
    x, y, _ = quarter.at(t).T
    assert np.abs((x / 2) ** 2 + y**2 - 1).max() < 1e-12
    branch = Curve(basis, np.array([[2, 0.5, 0], [0.8, 0.8, 0], [0.5, 2, 0.0]]), np.array([1, 1.25, 1]))
    x, y, _ = branch.at(t).T
    assert np.abs(x * y - 1).max() < 1e-12


def test_weights_of_one_give_the_plain_spline():
    points = np.random.default_rng(0).normal(size=(6, 3))
    basis = Basis(3, clamped_knots(6, 3), 6)
    t = np.linspace(0, 3, 20)
    assert np.allclose(Curve(basis, points, np.ones(6)).at(t), basis.matrix(t) @ points, atol=1e-14)


@pytest.mark.parametrize("weight", [0.0, -1.0, np.nan])
def test_weights_that_are_not_positive_are_refused(weight):
    with pytest.raises(ValueError, match="weights"):
        Curve(Basis(1, clamped_knots(2, 1), 2), np.zeros((2, 3)), np.array([1.0, weight]))


def test_derivatives_of_a_rational_curve_are_its_slopes():
    random = np.random.default_rng(1)
    curve = Curve(Basis(4, clamped_knots(8, 4), 8), random.normal(size=(8, 3)), 0.5 + random.random(8))
    t = np.linspace(0.1, 3.9, 50)
    found = curve.derivatives(t, 3)
    for k in range(3):
        slope = (curve.derivatives(t + 1e-5, k)[k] - curve.derivatives(t - 1e-5, k)[k]) / 2e-5
        assert np.allclose(slope, found[k + 1], atol=2e-4)


def test_points_and_normals_of_a_sphere_are_the_same_also_at_its_poles():
    u, v = np.linspace(0, 4, 33), np.linspace(0, 2, 17)
    points, normals = sphere().points_and_normals(u, v)
    assert np.abs(np.linalg.norm(points, axis=2) - 1).max() < 1e-12
    assert np.abs(normals - points).max() < 1e-9


def test_a_torus_is_exact_and_so_are_its_normals():
    points, normals = torus().points_and_normals(np.linspace(0, 4, 41), np.linspace(0, 4, 41))
    ring = points * [1, 1, 0] / np.linalg.norm(points[..., :2], axis=2, keepdims=True)
    assert np.abs(np.linalg.norm(points - ring, axis=2) - 0.25).max() < 1e-12
    assert np.abs(normals - (points - ring) / 0.25).max() < 1e-9


def test_the_normal_at_the_tip_of_a_cone_is_that_of_its_side():
    _, normals = cone().points_and_normals(np.array([0.0]), np.array([0.0, 0.5, 1.0]))
    assert np.allclose(normals[0], np.array([2, 0, 1]) / np.sqrt(5), atol=1e-9)


def test_mixed_derivatives_of_a_rational_surface_are_slopes_of_slopes():
    surface = sheet(6, 5, seed=2, weighted=2.0)
    u, v, h = np.linspace(0.2, 2.8, 7), np.linspace(0.2, 1.8, 5), 1e-5
    found = surface.partials(u, v, [(1, 1), (2, 0)])
    along_v = [surface.partials(u, v + s * h, [(1, 0)])[1, 0] for s in (1, -1)]
    along_u = [surface.partials(u + s * h, v, [(1, 0)])[1, 0] for s in (1, -1)]
    assert np.allclose((along_v[0] - along_v[1]) / (2 * h), found[1, 1], atol=1e-5)
    assert np.allclose((along_u[0] - along_u[1]) / (2 * h), found[2, 0], atol=1e-5)


def worst_faces(surface: Surface, u: np.ndarray, v: np.ndarray) -> float:
    """How far the surface lies from the triangles between the lines u and v, measured along its normals."""
    share = np.linspace(0, 1, 5)
    fine = [(line[:-1, None] + np.diff(line)[:, None] * share).ravel() for line in (u, v)]
    shape = (len(u) - 1, 5, len(v) - 1, 5, 3)
    points, normals = (array.reshape(shape) for array in surface.points_and_normals(*fine))
    corner = surface.at(u, v)[:, None, :, None]
    a, b = share[None, :, None, None, None], share[None, None, None, :, None]
    c00, c10, c01, c11 = corner[:-1, :, :-1], corner[1:, :, :-1], corner[:-1, :, 1:], corner[1:, :, 1:]
    flat = np.where(
        a + b <= 1, c00 + (c10 - c00) * a + (c01 - c00) * b, c11 + (c01 - c11) * (1 - a) + (c10 - c11) * (1 - b)
    )
    return float(np.abs(((points - flat) * normals).sum(axis=-1)).max())


@pytest.mark.parametrize(
    "surface",
    [
        sphere(),
        torus(),
        sheet(6, 7),
        sheet(7, 5, 2, seed=1),
        sheet(6, 6, 5, seed=2, weighted=3.0),
        sheet(4, 4, 1, seed=3),
    ],
    ids=["sphere", "torus", "cubic", "quadratic", "weighted quintic", "twisted"],
)
@pytest.mark.parametrize("chord", [CHORD, 4e-3])
def test_faces_stay_within_the_bound_of_the_true_surface(surface, chord):
    bound = chord * extent(surface.points)
    assert worst_faces(surface, *grid_parameters(surface, bound, TURN)) < bound


def test_steps_are_dense_where_the_surface_bends_and_wide_where_it_is_flat():
    points = np.zeros((8, 2, 3))
    knots = clamped_knots(8, 3)
    points[:, :, 0] = ((knots[1:9] + knots[2:10] + knots[3:11]) / 3)[:, None]  # where a straight line runs evenly
    points[:, 1, 1] = 1
    points[6, :, 2] = 2  # flat up to there
    surface = Surface(Basis(3, knots, 8), Basis(1, clamped_knots(2, 1), 2), points, np.ones((8, 2)))
    u, v = grid_parameters(surface, CHORD * extent(points))
    assert len(v) == 2
    assert np.count_nonzero(u < 1.99) <= 2  # the two flat spans take a step each
    assert np.count_nonzero(u > 3) > 15


def test_shading_normals_at_a_crease_are_the_mean_of_both_sides():
    points = np.array([[[-1, 0, 0], [-1, 1, 0]], [[0, 0, 1], [0, 1, 1]], [[1, 0, 0], [1, 1, 0.0]]])
    basis = Basis(1, clamped_knots(3, 1), 3)
    roof = Surface(basis, Basis(1, clamped_knots(2, 1), 2), points, np.ones((3, 2)))
    normals = smooth_normals(roof, np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0]))
    assert np.allclose(normals[:, 0], [[-np.sqrt(0.5), 0, np.sqrt(0.5)], [0, 0, 1], [np.sqrt(0.5), 0, np.sqrt(0.5)]])


def test_a_surface_of_100_by_100_points_becomes_a_million_triangles_within_two_seconds():
    surface = sheet(100, 100)
    begin = time.process_time()  # other work on the machine is not what is measured
    grid_parameters(surface, 1.0)
    u = np.linspace(0, 97, 708)
    found = patchwork([Net(surface.at(u, u), u, u, smooth_normals(surface, u, u))])
    assert time.process_time() - begin < 2
    assert 2 * len(found.loop_start) > 999_000
