# SPDX-License-Identifier: GPL-3.0-or-later
"""How texels are fitted to the gather points that they see."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from radiosity_addon.arrays import Float32
from radiosity_addon.chunks import finish
from radiosity_addon.gather import irradiance_fit
from radiosity_addon.gather.gather_points import FILLED, GatherPoints, part_at_walls, place_points
from radiosity_addon.gather.irradiance_fit import OVERSHOOT, fit_irradiance
from radiosity_addon.gather.neighbours import NEIGHBOURS, SAME_FACING, Neighbours, find_neighbours
from radiosity_addon.geometry.texels import Texels
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.geometry.walls import find_walls, hidden
from tests.gathering import FAR, NEAR, Blind, far, floor, sheet
from tests.shapes import box, mesh_of, quad


def fitted(
    texels: Texels,
    values: Callable[[Float32], Float32],
    base: float = 0.25,
    workers: int = 1,
    scale: Callable[[Float32], Float32] = lambda position: np.float32(0.6),
) -> tuple[Float32, GatherPoints, Neighbours]:
    """Irradiance (T, 1) from `values` at the positions (P, 3) of points."""
    visibility = Visibility(texels.surfaces.corners)
    walls = finish(find_walls(texels, visibility, workers))
    near = Blind(texels, scale)
    points = finish(place_points(texels, texels.valid, base, NEAR, 0.07, near))
    points = finish(part_at_walls(points, texels, walls, near, visibility, workers))
    neighbours = finish(find_neighbours(texels, points, visibility, workers))
    irradiance = np.asarray(values(texels.position[points.texel]), np.float32).reshape(points.count, -1)
    return (
        finish(fit_irradiance(texels, points, neighbours, irradiance, visibility, 0.07, workers)),
        points,
        neighbours,
    )


def test_a_cell_counts_its_own_point_and_others_by_distance() -> None:
    texels = floor()
    _, points, neighbours = fitted(texels, lambda position: np.ones(len(position)))
    assert neighbours.point.shape == (points.count, NEIGHBOURS)
    assert (neighbours.count > 3).all()
    assert (neighbours.point == np.arange(points.count)[:, None]).any(1).all()
    place = texels.position[points.texel]
    gap = np.linalg.norm(place[neighbours.point] - place[:, None], axis=2)
    assert gap.max() < 5 * points.width.max()


def test_even_light_stays_even() -> None:
    found, _, _ = fitted(floor(), lambda position: np.full(len(position), 0.3))
    assert found == pytest.approx(0.3, rel=1e-5)


def test_a_slope_is_followed_across_the_surface() -> None:
    texels = floor()
    found, _, _ = fitted(texels, lambda position: 5 + position[:, 0] - 0.5 * position[:, 1])
    x, y, _ = texels.position.T
    inner = np.maximum(np.abs(x), np.abs(y)) < 1.7
    assert np.abs(found[:, 0] - (5 + x - 0.5 * y))[inner].max() < 0.03


def test_a_narrow_cell_does_not_keep_wide_ones_around_from_their_points() -> None:
    texels = floor()

    def scale(position: Float32) -> Float32:
        return np.where(np.linalg.norm(position - (0.5, 0.5, 0), axis=1) < 0.45, 0.1, FAR).astype(np.float32)

    found, points, _ = fitted(texels, lambda position: 5 + position[:, 0], 1.0, scale=scale)
    assert points.width.min() < points.width.max() / 2
    error = (found[:, 0] - 5 - texels.position[:, 0])[np.abs(texels.position).max(1) < 1.4]
    assert np.sqrt((error**2).mean()) < 0.035


def test_no_point_counts_across_a_sharp_edge_that_is_shaded_smooth() -> None:
    texels = sheet([0, 2, 4], [0, 1.7, 0])
    _, points, neighbours = fitted(texels, lambda position: position[:, 0])
    face = texels.normal[points.texel]
    assert (neighbours.count > 1).mean() > 0.9
    assert np.einsum("cx,cnx->cn", face, face[neighbours.point]).min() > SAME_FACING


def test_each_texel_of_a_fold_sees_the_point_of_its_cell() -> None:
    texels = sheet(np.arange(11) / 10, 0.06 * (np.arange(11) % 2))
    _, points, _ = fitted(texels, lambda position: position[:, 0], 0.25, scale=lambda position: np.float32(0.05))
    visibility = Visibility(texels.surfaces.corners)
    every = np.flatnonzero(points.cell >= 0)
    seat = points.texel[points.cell[every]]
    assert not hidden(texels, every, seat, visibility).any()


def test_fits_never_leave_the_range_of_their_points_by_more_than_the_stated_share() -> None:
    texels = floor()
    rng = np.random.default_rng(7)
    found, points, _ = fitted(texels, lambda position: rng.random(len(position)) ** 6)
    assert points.count > 100
    assert found.min() >= 0
    assert found.max() <= 1 + OVERSHOOT


def test_light_does_not_cross_a_wall_on_the_way_to_texels() -> None:
    """A screen without thickness stands in the midst of cells; what is bright on one side stays there."""
    screen = mesh_of("Screen", [quad((1.9, 0, 0), (0, 4, 0), (0, 0, 2))], [0])
    texels = floor(screen)
    wall = 1.9 - texels.surfaces.origin[0]
    found, _, _ = fitted(texels, lambda position: position[:, 0] < wall)
    ground = texels.normal[:, 2] > 0.5
    side = texels.position[:, 0] - wall
    assert found[ground & (side < 0), 0].min() > 0.999
    assert found[ground & (side > 0), 0].max() < 0.001


def test_what_lies_in_a_gap_does_not_darken_what_lies_beside_it() -> None:
    """Under a board that hovers 2 mm over the floor it is dark, and a texel beside its edge is not."""
    texels = floor()
    board = 0.31 - texels.surfaces.origin[0]  # its edge; the points there are those of the finest cells

    def gap(position: Float32) -> Float32:
        return np.where(position[:, 0] < board, 0.002, 0.3).astype(np.float32)

    found, _, _ = fitted(texels, lambda position: position[:, 0] >= board, scale=gap)
    beside = (texels.position[:, 0] > board + 0.035) & (texels.position[:, 0] < board + 0.25)
    under = (texels.position[:, 0] < board - 0.07) & (texels.position[:, 0] > board - 0.25)
    assert np.abs(found[beside, 0] - 1).mean() < 0.05
    assert found[under, 0].mean() < 0.25


def test_a_cell_of_few_texels_looks_no_farther_than_these_reach() -> None:
    """A plate of 0.2 m has one cell of the 1 m grid; cells that are whole keep their width."""
    texels = floor(mesh_of("Plate", [quad((1, 1, 1), (0.2, 0, 0), (0, 0.2, 0))], [0]))
    _, points, _ = fitted(texels, lambda position: position[:, 0], base=1.0, scale=far)
    plate = (texels.position + texels.surfaces.origin)[points.texel, 2] > 0.5
    assert (points.width[plate] <= 2 * FILLED * 0.2).all()
    assert plate.any()
    assert (points.width[~plate] == 1).all()


def test_each_texel_takes_only_points_that_it_sees_past_the_end_of_a_wall() -> None:
    """What a cell's point sees around the end of a screen, some of the cell's texels do not: each asks for itself."""
    x, y = 1.9, 2.0  # the screen leads along this x, up to this y
    screen = mesh_of("Screen", [quad((x, 0, 0), (0, y, 0), (0, 0, 2))], [0])
    texels = floor(screen)
    found, points, _ = fitted(texels, lambda p: p[:, 0] < x - texels.surfaces.origin[0], base=0.5, scale=far)
    place = (texels.position + texels.surfaces.origin)[:, :2]
    bright = place[points.texel][place[points.texel, 0] < x]
    shaded = np.flatnonzero((texels.normal[:, 2] > 0.5) & (place[:, 0] > x + 0.01) & (place[:, 1] < y - 0.03))
    reach = 2.5 * points.width.max()

    def sees_light(spot: Float32) -> bool:
        gap = bright - spot
        crossing = spot[1] + gap[:, 1] * (x - spot[0]) / gap[:, 0]  # where the line of sight meets the screen's line
        return bool(((crossing > y - 0.01) & (np.linalg.norm(gap, axis=1) < reach)).any())

    dark = np.array([texel for texel in shaded if not sees_light(place[texel])])
    assert len(dark) > 100
    assert found[dark, 0].max() == 0
    assert found[shaded, 0].max() > 0.05, "others see around the end"


def test_neighbours_and_fits_are_the_same_for_any_number_of_threads() -> None:
    texels = floor(box("Box", (1, 1, 0), (2, 2, 1)))
    (one, _, few), (two, _, more) = (fitted(texels, lambda p: p[:, 0] ** 2, workers=count) for count in (1, 2))
    assert np.array_equal(one, two)
    assert np.array_equal(few.point, more.point)


def test_no_colour_falls_below_nothing_and_groups_still_add_up():
    """Two points, one red and one blue: beyond the red one the plane through them has less than no blue."""
    values = np.float32([[4, 0, 0, 0, 0, 0.2], [0, 0, 1, 0, 0, 0.1]]).T[:, :, None]  # two light groups
    weight, row = np.float32([[0.75], [0.25]]), np.zeros(1, np.int64)
    plane = np.float32([5, 0, -0.25, 0, 0, 0.225])[:, None]
    found = irradiance_fit._kept_in_range(plane.copy(), weight, values, row)
    assert found.min() >= 0
    mean = values[:, :, 0] @ weight
    share = (found - plane)[:, 0] / np.where(mean != plane, mean - plane, 1)[:, 0]
    moved = np.flatnonzero(mean != plane)
    assert share[moved] == pytest.approx(np.full(len(moved), 0.5), abs=1e-6)  # -0.25 to 0.25: half of the way, for all
    dark = irradiance_fit._kept_in_range(-plane, weight, -values, row)  # of negative lamps colours may be negative
    assert dark[0, 0] < 0
