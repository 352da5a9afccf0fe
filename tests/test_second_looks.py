# SPDX-License-Identifier: GPL-3.0-or-later
"""Which gather points look again, and what that makes of their light."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.arrays import Float32
from radiosity_addon.chunks import finish
from radiosity_addon.gather import second_looks
from radiosity_addon.gather.gather_points import GatherPoints, place_points
from radiosity_addon.gather.second_looks import further_looks, variances
from radiosity_addon.gather.tally import FINE_PART, Further, RayCounts, Tally
from radiosity_addon.geometry.texels import Texels
from radiosity_addon.lighting.polygons import parallelogram, polygon_light
from radiosity_addon.settings import BakeSettings
from tests.gathering import floor, rays_of
from tests.shapes import mesh_of, quad


def grid(texels: Texels) -> GatherPoints:
    """A point at each fourth texel of the floor along both axes, for the texels around it."""
    cell = np.floor(texels.position / np.float32(0.28)).astype(np.int64)
    _, first, owner = np.unique(cell @ [1000, 1, 0], return_index=True, return_inverse=True)
    width = np.full(len(first), 0.28, np.float32)
    return GatherPoints(first.astype(np.int64), width, width, owner.astype(np.int32))


def test_the_variance_of_a_sum_is_that_of_many_such_sums() -> None:
    rng = np.random.default_rng(1)
    light = rng.exponential(size=(40_000, 24)).astype(np.float32)
    assert variances(np.full(light.shape, 0.5, np.float32), light).mean() == pytest.approx(0.25 * 23, rel=0.02)
    assert (0.5 * light.sum(1)).var() == pytest.approx(0.25 * 24, rel=0.03)


def test_points_look_again_in_proportion_to_noise_and_to_the_root_of_the_area_they_serve(monkeypatch) -> None:
    monkeypatch.setattr(second_looks, "NOISY", 0.5)
    texels = floor()
    points = grid(texels)
    place = texels.position[points.texel]
    noisy = place[:, 0] > 2
    looks = finish(further_looks(np.where(noisy, 9.0, 1.0).astype(np.float32), texels, points, 1))
    served = np.bincount(points.cell, minlength=points.count)
    noise = np.where(noisy, 3, 1) * np.sqrt(served)
    inside = np.abs(place[:, 0] - 2) > 1.2  # halves share their variance across the border
    assert np.array_equal(looks[inside], (noise / (0.5 * noise.mean())).astype(int)[inside])


def test_light_that_is_alike_for_all_but_brighter_changes_no_look(monkeypatch) -> None:
    monkeypatch.setattr(second_looks, "NOISY", 0.5)
    texels = floor()
    points = grid(texels)
    variance = np.random.default_rng(2).exponential(size=points.count).astype(np.float32) ** 2
    looks = [finish(further_looks(np.float32(scale) * variance, texels, points, 1)) for scale in (1, 2.0**20)]
    assert looks[0].max() > looks[0].min()
    assert np.array_equal(*looks)
    assert not finish(further_looks(0 * variance, texels, points, 1)).any(), "nothing shines"


def test_no_point_chooses_its_own_rays_by_what_they_met() -> None:
    texels = floor()
    points = grid(texels)
    for one in range(0, points.count, 37):
        variance = np.ones(points.count, np.float32)
        variance[one] = 400
        looks = finish(further_looks(variance, texels, points, 1))
        assert looks[one] <= np.median(looks)
        assert looks.max() > looks[one]


def test_a_point_without_others_near_by_looks_once() -> None:
    texels = floor()
    every = grid(texels)
    points = GatherPoints(every.texel[::60], every.width[::60], every.nearest[::60], every.cell // 60)
    looks = finish(further_looks(np.ones(points.count, np.float32), texels, points, 1))
    assert points.count > 3
    assert not looks.any()


def test_later_rows_of_rays_count_by_their_numbers() -> None:
    first, again = (
        Tally.empty(RayCounts(1, 0), np.array(fine), tinted=False) for fine in ([False, True, False], [False] * 3)
    )
    later = Further(np.array([0, 1, 1]), again)
    means = later.means(first, np.float32([[1], [1], [1]]), np.float32([[4], [4], [7]]))
    fine = (1 / FINE_PART + 4 + 7) / (1 / FINE_PART + 2)
    assert means[:, 0] == pytest.approx([2.5, fine, 1])


def gathered(workers: int = 1) -> tuple[Float32, Float32]:
    """Irradiance over pi at points of a floor under a shining square of 0.3 m, 0.25 m above; and its closed form."""
    board = mesh_of("Board", [quad((1.85, 1.85, 0.25), (0, 0.3, 0), (0.3, 0, 0))], [0])
    texels = floor(board, size=256)
    shining = texels.position[:, 2] > 0.1 - texels.surfaces.origin[2]
    rays, bright = rays_of(texels, shining, settings=BakeSettings(threads=workers))
    lit = texels.valid & ~shining
    points = finish(place_points(texels, lit, 0.25, 0.35, 0.07, rays))
    found = finish(finish(rays.tally(points, 0.25)).sum(np.stack([bright, bright], axis=1), workers))[0][:, 0]
    square = parallelogram(np.array([1.85, 1.85, 0.25]), np.array([0, 0.3, 0]), np.array([0.3, 0, 0]))
    place = (texels.position[points.texel] + texels.surfaces.origin).astype(np.float32)
    return found / np.float32(np.pi), polygon_light(square, place, texels.normal[points.texel]) / np.float32(np.pi)


def test_points_that_look_again_err_less_and_no_light_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = []
    for noisy in (1e9, 0.5):
        monkeypatch.setattr(second_looks, "NOISY", noisy)
        found, form_factor = gathered()
        errors.append(np.sqrt(np.mean((found - form_factor) ** 2)))
    assert errors[1] < 0.75 * errors[0]
    assert found.sum() == pytest.approx(form_factor.sum(), rel=0.03)


def test_second_looks_are_the_same_for_any_number_of_threads() -> None:
    assert np.array_equal(gathered(1)[0], gathered(2)[0])
