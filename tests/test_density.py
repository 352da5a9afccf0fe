# SPDX-License-Identifier: GPL-3.0-or-later
"""How densely a uv map lays texels on a surface: squares whose answer is known."""

import numpy as np
import pytest

from radiosity_addon.atlas.density import cofactors, quantiles, surface_per_uv, texels_per_metre, world_areas

SQUARE = np.float32([[[0, 0, 0], [2, 0, 0], [2, 2, 0]], [[0, 0, 0], [2, 2, 0], [0, 2, 0]]])
"""A square of 2 m in two triangles."""
WHOLE = np.float32([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]])
"""A uv map that lays it over a whole page."""


def density(uv, matrix=None, texels=256):
    return texels_per_metre(surface_per_uv(SQUARE, uv), np.eye(3) if matrix is None else matrix, texels)


def test_two_metres_on_a_page_of_256_texels_have_128_a_metre():
    np.testing.assert_allclose(density(WHOLE), 128, rtol=1e-6)


@pytest.mark.parametrize("uv", [WHOLE[..., ::-1], WHOLE + 3, WHOLE @ np.float32([[0.6, 0.8], [-0.8, 0.6]])])
def test_mirrored_moved_and_turned_maps_are_as_dense(uv):
    np.testing.assert_allclose(density(uv), 128, rtol=1e-5)


def test_half_the_map_is_half_as_dense():
    np.testing.assert_allclose(density(WHOLE / 2), 64, rtol=1e-6)


def test_uneven_scale_counts_by_the_area_that_it_makes():
    """2 m x 2 m become 4 m x 16 m, and 256 x 256 texels lie on 64 m2."""
    np.testing.assert_allclose(density(WHOLE, np.diag([2.0, 8.0, 5.0])), 256 / 8, rtol=1e-6)


def test_density_after_any_matrix_is_that_of_the_moved_corners():
    matrix = np.random.default_rng(5).normal(size=(3, 3))
    moved = surface_per_uv((SQUARE @ matrix.T).astype(np.float32), WHOLE)
    np.testing.assert_allclose(density(WHOLE, matrix), texels_per_metre(moved, np.eye(3), 256), rtol=1e-5)
    np.testing.assert_allclose(cofactors(matrix), np.linalg.det(matrix) * np.linalg.inv(matrix).T, rtol=1e-9)


def test_a_map_without_area_has_next_to_no_texels_and_no_infinity():
    found = density(WHOLE * np.float32([1, 0]))
    assert np.isfinite(found).all()
    assert (found < 1e-3).all()


def test_areas_in_the_world_add_up():
    assert world_areas(SQUARE, np.diag([2.0, 8.0, 5.0])).sum() == pytest.approx(64)


def test_quantiles_go_by_weight():
    values, weights = np.array([3.0, 1.0, 2.0]), np.array([1.0, 8.0, 1.0])
    assert quantiles(values, weights, (0.05, 0.5, 0.85, 0.95)) == (1, 1, 2, 3)
    assert quantiles(np.zeros(0), np.zeros(0), (0.5,)) == (0,)
