# SPDX-License-Identifier: GPL-3.0-or-later
"""Closed forms against published values, against each other and against brute quadrature."""

from __future__ import annotations

import math

import numpy as np
import pytest

from radiosity_addon.lighting import polygons
from radiosity_addon.lighting.polygons import cap_light, convex_polygon, ellipse, parallelogram, polygon_light

X, Y, Z = np.eye(3)


def facing_down(width: float, depth: float, height: float, two_sided: bool = False) -> polygons.Polygon:
    return parallelogram(np.array([-width / 2, -depth / 2, height]), depth * Y, width * X, two_sided)


def at(*point: float) -> np.ndarray:
    return np.array([point], np.float32)


def directions(normal: np.ndarray, count: int) -> np.ndarray:
    return np.repeat(np.asarray(normal, np.float32)[None] / np.float32(np.linalg.norm(normal)), count, axis=0)


def brute(corner: np.ndarray, u: np.ndarray, v: np.ndarray, point: np.ndarray, normals: list, n: int = 600) -> float:
    """Midpoint rule over a one-sided parallelogram; normals[0] has the cosine, all have horizons."""
    steps = (np.arange(n) + 0.5) / n
    a, b = (grid.reshape(-1, 1) for grid in np.meshgrid(steps, steps))
    away = corner + a * u + b * v - point
    cross = np.cross(u, v)
    square = (away**2).sum(1)
    light = (away @ normals[0]) * np.maximum(-(away @ cross), 0) / square**2
    for normal in normals:
        light = np.where(away @ normal > 0, light, 0)
    return float(light.mean())


@pytest.mark.parametrize("x, y, expected", [(0, 0, 0.2394565), (0.5, 0.5, 0.1385316)])
def test_point_under_a_unit_square_has_the_published_form_factor(x: float, y: float, expected: float) -> None:
    light = polygon_light(facing_down(1, 1, 1), at(x, y, 0), directions(Z, 1))
    assert light[0] / math.pi == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize(
    "width, depth, distance, expected", [(1, 1, 1, 0.1998249), (2, 2, 1, 0.4152533), (1, 1.5, 0.5, 0.4755764)]
)
def test_parallel_rectangles_have_the_published_form_factor(
    width: float, depth: float, distance: float, expected: float
) -> None:
    assert polygons.parallel_rectangles(width, depth, distance) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("width, height, edge, expected", [(1, 1, 1, 0.2000438), (2, 1, 1, 0.1164263)])
def test_perpendicular_rectangles_have_the_published_form_factor(
    width: float, height: float, edge: float, expected: float
) -> None:
    assert polygons.perpendicular_rectangles(width, height, edge) == pytest.approx(expected, rel=1e-6)


def test_coaxial_discs_have_the_published_form_factor() -> None:
    assert polygons.coaxial_discs(1, 1, 1) == pytest.approx(0.3819660, rel=1e-6)


def test_floor_of_a_box_sees_walls_and_ceiling_and_nothing_else() -> None:
    walls = 2 * polygons.perpendicular_rectangles(2, 1, 1) + 2 * polygons.perpendicular_rectangles(1, 1, 2)
    assert walls + polygons.parallel_rectangles(2, 1, 1) == pytest.approx(1, abs=1e-12)


def gauss_grid(width: float, depth: float, n: int = 24) -> tuple[np.ndarray, np.ndarray]:
    nodes, weights = np.polynomial.legendre.leggauss(n)
    x, y = (grid.ravel() for grid in np.meshgrid(nodes * width / 2, nodes * depth / 2))
    return np.stack([x, y, 0 * x], axis=1).astype(np.float32), np.outer(weights, weights).ravel() / 4


def test_point_to_polygon_integrates_to_parallel_rectangles() -> None:
    points, weights = gauss_grid(1.5, 1)
    light = polygon_light(facing_down(1.5, 1, 0.5), points, directions(Z, len(points)))
    assert weights @ light / math.pi == pytest.approx(polygons.parallel_rectangles(1.5, 1, 0.5), rel=2e-5)


def test_point_to_ellipse_integrates_to_coaxial_discs() -> None:
    radius, weights = np.polynomial.legendre.leggauss(24)
    radius = (radius + 1) / 2
    points = np.stack([radius, 0 * radius, 0 * radius], axis=1).astype(np.float32)
    disc = ellipse(np.array([0, 0, 1.0]), X, -Y)
    light = polygon_light(disc, points, directions(Z, len(points)))
    assert weights @ (radius * light) / math.pi == pytest.approx(polygons.coaxial_discs(1, 1, 1), rel=1e-3)


def test_small_far_lamp_keeps_its_precision_in_float32() -> None:
    lamp = facing_down(0.2, 0.2, 30)
    exact = 0.04 / 30**2
    assert polygon_light(lamp, at(0, 0, 0), directions(Z, 1))[0] == pytest.approx(exact, rel=1e-4)
    closed = polygons._from_corners(lamp, np.zeros((3, 1), np.float32), directions(Z, 1).T)
    assert closed[0] == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize("shape", ["square", "ellipse", "triangle"])
def test_nodes_and_corners_agree_where_one_takes_over_from_the_other(shape: str) -> None:
    lamp = {
        "square": facing_down(1, 1, 0),
        "ellipse": ellipse(np.zeros(3), X, -0.7 * Y),
        "triangle": convex_polygon(np.array([[0.0, 0, 0], [0.3, 1, 0], [1, 0, 0]])),
    }[shape]
    rng = np.random.default_rng(4)
    away = rng.normal(size=(2000, 3))
    away[:, 2] = -np.abs(away[:, 2])
    away /= np.linalg.norm(away, axis=1)[:, None]
    normal = -away + 0.4 * rng.normal(size=away.shape)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    p = (lamp.centre + away * polygons.FAR * lamp.radius).T.astype(np.float32)
    n = normal.T.astype(np.float32)
    above = (n * (lamp.centre[:, None] - p)).sum(0) > 2 * lamp.radius
    near, far = polygons._from_corners(lamp, p, n)[above], polygons._from_nodes(lamp, p, n)[above]
    assert np.abs(near - far).max() / near.max() < 5e-4


def test_polygon_cut_by_the_horizon_equals_brute_quadrature() -> None:
    corner, u, v = np.array([0.5, -0.5, -0.6]), 1.4 * Z + 0.2 * X, 1.3 * Y
    lamp = parallelogram(corner, u, v)
    normal = np.array([0.3, 0.1, 1]) / np.linalg.norm([0.3, 0.1, 1])
    light = polygon_light(lamp, at(0, 0, 0), directions(normal, 1))
    assert light[0] == pytest.approx(brute(corner, u, v, np.zeros(3), [normal]), rel=2e-3)


def test_light_below_the_geometric_horizon_counts_nothing() -> None:
    corner, u, v = np.array([-0.5, -0.5, 0.4]), 1.2 * Y, 1.1 * X
    lamp = parallelogram(corner, u, v)
    shading = np.array([0.5, 0.2, 1.0]) / np.linalg.norm([0.5, 0.2, 1.0])
    geometric = np.array([-0.9, 0.1, 0.5]) / np.linalg.norm([-0.9, 0.1, 0.5])
    light = polygon_light(lamp, at(0, 0, 0), directions(shading, 1), directions(geometric, 1))
    expected = brute(corner, u, v, np.zeros(3), [shading, geometric])
    assert light[0] == pytest.approx(expected, rel=2e-3)
    assert light[0] < 0.95 * polygon_light(lamp, at(0, 0, 0), directions(shading, 1))[0]


def test_one_sided_polygon_leaves_its_back_dark_and_a_two_sided_one_does_not() -> None:
    normals = directions(-Z, 1)
    assert polygon_light(facing_down(1, 1, 1), at(0, 0, 2), normals)[0] == 0
    light = polygon_light(facing_down(1, 1, 1, two_sided=True), at(0, 0, 2), normals)
    assert light[0] / math.pi == pytest.approx(0.2394565, rel=2e-6)


def test_point_that_touches_the_polygon_gets_at_most_the_whole_sky() -> None:
    heights = np.array([1e-6, 0, 1e-3], np.float32)
    points = np.stack([0 * heights + 0.1, 0 * heights, 1 - heights], axis=1)
    light = polygon_light(facing_down(1, 1, 1), points, directions(Z, 3))
    assert np.isfinite(light).all()
    assert light.max() <= math.pi * (1 + 1e-5)
    assert light[2] == pytest.approx(math.pi, rel=1e-2)


def test_point_in_the_plane_of_the_polygon_gets_nothing() -> None:
    light = polygon_light(facing_down(1, 1, 0, two_sided=True), at(2, 0, 0), directions(X * -1, 1))
    assert abs(light[0]) < 1e-6


def test_points_of_a_polygon_get_nothing_from_it_whatever_their_shading_normals() -> None:
    rng = np.random.default_rng(3)
    corners = rng.normal(size=(3, 3)) + 1
    lamp = polygons.convex_polygon(corners, two_sided=True)
    points = rng.dirichlet(np.ones(3), 500) @ corners
    normals = lamp.normal + 0.2 * rng.normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    assert not polygon_light(lamp, points.astype(np.float32), normals.astype(np.float32)).any()
    over = (points + 1e-3 * lamp.normal).astype(np.float32)
    assert polygon_light(lamp, over, -normals.astype(np.float32)).mean() == pytest.approx(math.pi, rel=0.05)


def test_blocks_do_not_change_the_result() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (polygons.BLOCK + 100, 3)).astype(np.float32)
    normals = rng.normal(size=points.shape).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    lamp = facing_down(0.5, 0.5, 0.3, two_sided=True)
    whole = polygon_light(lamp, points, normals)
    parts = [polygon_light(lamp, points[k : k + 61], normals[k : k + 61]) for k in range(0, len(points), 61)]
    assert np.allclose(whole, np.concatenate(parts), rtol=1e-4, atol=1e-6)


def test_sphere_above_the_horizon_is_a_point_at_its_centre() -> None:
    cosine = np.array([0.5, 0.9, 1.0], np.float32)
    assert cap_light(cosine, np.float32(0.04)) == pytest.approx(math.pi * 0.04 * cosine, rel=1e-6)


@pytest.mark.parametrize("cosine", [-0.6, -0.3, 0.0, 0.2, 0.5, 0.65])
def test_sphere_cut_by_the_horizon_equals_brute_quadrature(cosine: float) -> None:
    half = math.asin(math.sqrt(0.5))
    theta = (np.arange(2000) + 0.5) / 2000 * half
    phi = (np.arange(1000) + 0.5) / 1000 * 2 * math.pi
    sine = math.sqrt(1 - cosine**2)
    height = np.cos(theta)[:, None] * cosine + np.sin(theta)[:, None] * np.cos(phi) * sine
    expected = (np.maximum(height, 0) * np.sin(theta)[:, None]).sum() * half / 2000 * 2 * math.pi / 1000
    light = cap_light(np.array([cosine], np.float32), np.float32(0.5))
    assert light[0] == pytest.approx(expected, rel=1e-3, abs=1e-5)


def test_cap_joins_smoothly_where_the_horizon_begins_to_cut_it() -> None:
    edge = np.float32(math.sqrt(0.2))
    light = cap_light(np.array([edge * 0.9999, edge * 1.0001], np.float32), np.float32(0.2))
    assert light[0] == pytest.approx(light[1], rel=1e-3)
    assert cap_light(np.array([-edge * 1.0001], np.float32), np.float32(0.2))[0] == 0


def test_a_cap_of_half_the_sky_over_a_level_point_is_pi() -> None:
    assert cap_light(np.array([1.0], np.float32), np.float32(1))[0] == pytest.approx(math.pi, rel=1e-6)
