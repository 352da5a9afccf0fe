# SPDX-License-Identifier: GPL-3.0-or-later
"""Light from afar at gather points, on a floor whose light is known."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.arrays import Float32
from radiosity_addon.chunks import finish
from radiosity_addon.gather.far_light import REACH, FarLight, smooth_far_light
from radiosity_addon.gather.gather_points import GatherPoints, place_points
from radiosity_addon.gather.irradiance_fit import shares_at_points
from radiosity_addon.gather.neighbours import Neighbours, find_neighbours
from radiosity_addon.geometry.texels import Texels
from radiosity_addon.geometry.visibility import Visibility
from tests.gathering import NEAR, Blind, far, floor


@pytest.fixture(scope="module")
def ground() -> tuple[Texels, GatherPoints, Neighbours]:
    """A floor of 4 x 4 m with a point in each cell of 0.25 m."""
    texels = floor()
    points = finish(place_points(texels, texels.valid, 0.25, NEAR, 0.07, Blind(texels, far)))
    return texels, points, finish(find_neighbours(texels, points, Visibility(texels.surfaces.corners), 1))


def smoothed(
    ground: tuple[Texels, GatherPoints, Neighbours], near: Float32, light: Float32, openness: Float32, workers: int = 1
) -> Float32:
    """Irradiance at the points from `near` (P, C) and mean `light` (P, C) in the open share of the view (P,)."""
    texels, points, neighbours = ground
    from_afar = FarLight(np.float32(light * openness[:, None]), np.float32(openness))
    return finish(
        smooth_far_light(np.float32(near) + from_afar.irradiance, from_afar, texels, points, neighbours, workers)
    )


def test_noise_of_light_from_afar_falls_as_the_shares_of_the_points_around_say(ground) -> None:
    """A slope stays; independent noise keeps the sum of the squared shares of its variance."""
    texels, points, neighbours = ground
    place = texels.position[points.texel]
    slope = (5 + place[:, :1] - 0.5 * place[:, 1:2]).repeat(3, axis=1)
    noise = np.random.default_rng(3).normal(0, 0.2, (32, points.count, 3)).mean(2, keepdims=True) * np.ones(3)
    whole = np.ones(points.count, np.float32)
    zero = np.zeros_like(slope)
    left = np.array([smoothed(ground, zero, slope + each, whole) - slope for each in noise])
    inner = np.abs(place).max(1) < 1.4
    shares = finish(shares_at_points(texels, points, neighbours, REACH, 1))
    expected = np.sqrt((shares[inner] ** 2).sum(1).mean())
    assert left[:, inner].std() / noise[:, inner].std() == pytest.approx(expected, rel=0.05)
    assert expected < 0.45
    assert np.abs(left[:, inner].mean()) < 0.005


def test_an_edge_of_what_hides_far_light_stays_sharp(ground) -> None:
    texels, points, _ = ground
    hidden = texels.position[points.texel, 0] > 0.1
    openness = np.where(hidden, 0.3, 0.9)
    light = np.full((points.count, 3), 2.0)
    found = smoothed(ground, np.zeros((points.count, 3)), light, openness)
    assert found == pytest.approx(light * openness[:, None], rel=1e-4)


def test_near_light_is_left_alone_also_where_the_view_is_closed(ground) -> None:
    near = np.random.default_rng(4).random((ground[1].count, 3))
    for openness in (0.0, 0.5):
        found = smoothed(ground, near, np.ones((len(near), 3)), np.full(len(near), openness))
        assert found == pytest.approx(np.float32(near) + np.float32(openness), rel=1e-4)


def test_light_groups_add_up(ground) -> None:
    rng = np.random.default_rng(5)
    one, two = 1 + rng.random((2, ground[1].count, 3))
    openness = 0.5 + 0.5 * rng.random(len(one))
    both = smoothed(ground, one, np.column_stack([one, two])[:, :3] + two, openness)
    apart = smoothed(ground, np.column_stack([one, 0 * two]), np.column_stack([one, two]), openness)
    assert apart[:, :3] + apart[:, 3:] == pytest.approx(both, rel=1e-4)


def test_no_colour_falls_below_nothing(ground) -> None:
    """Few points shine: planes through them lead below nothing at some others, which keep what they have."""
    light = (np.random.default_rng(7).random((ground[1].count, 3)) > 0.9).astype(np.float32)
    found = smoothed(ground, np.zeros_like(light), light, np.ones(len(light)))
    assert found.min() >= 0
    assert 0.02 < (found == light).all(1).mean() < 0.9


def test_points_are_smoothed_alike_by_any_number_of_threads(ground) -> None:
    rng = np.random.default_rng(6)
    near, light = rng.random((2, ground[1].count, 3))
    openness = rng.random(len(near))
    assert np.array_equal(*(smoothed(ground, near, light, openness, workers) for workers in (1, 2)))
