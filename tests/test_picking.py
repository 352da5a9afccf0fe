# SPDX-License-Identifier: GPL-3.0-or-later
"""What a single ray meets, and what a page holds there."""

import numpy as np
import pytest

from radiosity_addon.geometry.picking import bilinear, first_triangle

SQUARE = np.float32([[[0, 0, 0], [2, 0, 0], [2, 2, 0]], [[0, 0, 0], [2, 2, 0], [0, 2, 0]]])
DOWN = np.array([0.0, 0.0, -2.0])


def down_at(x, y, corners=SQUARE):
    return first_triangle(np.array([x, y, 3.0]), DOWN, corners)


def test_a_ray_meets_the_triangle_below_it_at_its_weights():
    assert down_at(1.5, 0.5) == pytest.approx((0, 1.5, 0.5, 0.25))  # distance in lengths of the direction
    assert down_at(0.5, 1.5) == pytest.approx((1, 1.5, 0.25, 0.5))


def test_the_nearest_of_two_layers_is_met_from_either_side():
    layers = np.concatenate([SQUARE - np.float32([0, 0, 1]), SQUARE[:, ::-1]])
    assert down_at(1.5, 0.5, layers)[0] == 2
    assert first_triangle(np.array([1.5, 0.5, -3.0]), -DOWN, layers)[0] == 0


def test_a_diagonal_and_a_corner_let_nothing_through():
    for x in np.linspace(0, 2, 41):
        assert down_at(x, x) is not None


@pytest.mark.parametrize("place", [(2.1, 1.0), (-0.1, 1.0), (1.0, 2.1)])
def test_a_ray_beside_the_square_meets_nothing(place):
    assert down_at(*place) is None


def test_a_ray_that_looks_away_or_along_meets_nothing():
    above = np.array([1.0, 0.5, 3.0])
    assert first_triangle(above, -DOWN, SQUARE) is None
    assert first_triangle(above, np.array([1.0, 0.0, 0.0]), SQUARE) is None
    assert first_triangle(above, DOWN, SQUARE[:0]) is None


def test_a_page_is_read_between_its_texels_and_as_it_is_beyond_them():
    page = np.arange(8, dtype=np.float32).reshape(2, 4, 1)
    assert bilinear(page, 0.125, 0.25) == pytest.approx([0])  # centre of the first texel
    assert bilinear(page, 0.25, 0.25) == pytest.approx([0.5])
    assert bilinear(page, 0.25, 0.5) == pytest.approx([2.5])
    assert bilinear(page, 0.0, 0.0) == pytest.approx([0])
    assert bilinear(page, 1.0, 1.0) == pytest.approx([7])
