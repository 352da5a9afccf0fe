# SPDX-License-Identifier: GPL-3.0-or-later
"""The final gather, piece by piece: where rays go and what they count, where points stand, how texels are fitted."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from radiosity_addon.arrays import Float32, Int64
from radiosity_addon.bake import bake
from radiosity_addon.chunks import Fractions, finish
from radiosity_addon.gather import irradiance_fit
from radiosity_addon.gather.gather_points import GatherPoints, part_at_walls, place_points
from radiosity_addon.gather.gather_rays import GatherRays
from radiosity_addon.gather.irradiance_fit import OVERSHOOT, fit_irradiance
from radiosity_addon.gather.neighbours import NEIGHBOURS, SAME_FACING, Neighbours, find_neighbours
from radiosity_addon.gather.tally import BELOW, RayCounts, Tally
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import Texels, rasterize
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.geometry.walls import find_walls, hidden
from radiosity_addon.radiosity.illumination import SPECIAL_ROWS
from radiosity_addon.radiosity.patches import NOTHING, SKY, group_patches
from radiosity_addon.scene import Material, Mesh, Scene
from radiosity_addon.settings import BakeSettings
from tests.shapes import box, cell_atlas, folded_sheet, mesh_of, quad, sphere

GREY = (Material("Grey"),)
NEAR = 0.35
"""Share of the scale of change beyond which cells are split."""
FAR = 100.0
"""m; scale of change at a point in the open."""

# what rays count


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


def sheet(x: Sequence[float], height: Sequence[float]) -> Texels:
    scene, atlas = folded_sheet(x, height)
    return finish(rasterize(atlas, flatten(scene), 1))


def test_each_part_of_a_texel_on_two_faces_has_the_horizon_of_its_own_face() -> None:
    """A face under a white sky has (1 + cos a) / 2 of it if its shading normal leans by a; folds hide more of it."""
    texels = sheet([0, 2.03, 4], [0, 1.7, 0])  # the ridge leads through texels
    visibility = Visibility(texels.surfaces.corners)
    walls = finish(find_walls(texels, visibility, 1))
    grey, solid = np.zeros((texels.count, 3), np.float32), np.ones(texels.surfaces.count, bool)
    patches = group_patches(texels, walls, grey, grey, solid, 100, visibility)
    white = np.zeros(texels.count + patches.count + SPECIAL_ROWS, np.float32)
    white[SKY] = 1
    rays = GatherRays(texels, patches, visibility, BakeSettings(quality="high"), white)
    faces = texels.surfaces.normal[texels.footprints.triangles(np.arange(texels.count))]
    mixed = np.flatnonzero(np.ptp(faces[:, :, 0], axis=1) > 0.1)
    _, _, seen = finish(rays.look(mixed, np.zeros(len(mixed), bool)))
    lean = faces[mixed, :, 2].mean(1)
    assert len(mixed) > 20
    assert seen == pytest.approx((1 + lean) / 2, abs=0.02)


def test_what_shines_counts_by_its_distance_where_it_is_nearer_than_most() -> None:
    """Light of a board 0.1 m away changes over distances like that, however far the dark walls around are."""
    far_walls = box("Walls", (-20, -20, -1), (24, 24, 20))
    inward = Mesh(**{**vars(far_walls), "triangles": far_walls.triangles[:, ::-1]})
    board = mesh_of("Board", [quad((1.9, 1.9, 0.1), (0, 0.2, 0), (0.2, 0, 0))], [0])
    texels = floor(board, inward)
    visibility = Visibility(texels.surfaces.corners)
    walls = finish(find_walls(texels, visibility, 1))
    grey, solid = np.zeros((texels.count, 3), np.float32), np.ones(texels.surfaces.count, bool)
    patches = group_patches(texels, walls, grey, grey, solid, 500, visibility)
    place = texels.position + texels.surfaces.origin
    beside = np.linalg.norm(place - [2.2, 2.0, 0.0], axis=1).argmin(keepdims=True)
    scale = []
    for shining in (place[:, 2] > 9, np.abs(place[:, 2] - 0.1) < 0.01):
        bright = np.zeros(texels.count + patches.count + SPECIAL_ROWS, np.float32)
        bright[: texels.count] = shining
        rays = GatherRays(texels, patches, visibility, BakeSettings(quality="high"), bright)
        scale.append(finish(rays.look(beside, np.zeros(1, bool)))[0][0])
    assert 0.1 < scale[1] < 0.35
    assert scale[0] > 0.5


@pytest.mark.parametrize(("near_to", "expected"), [(0.0, math.sqrt(2) * 0.1), (2.0, 2.0)])
def test_under_a_wide_ceiling_the_scale_of_change_is_its_height_times_root_two(near_to: float, expected: float) -> None:
    """The mean of 1 / d^2 over what is seen, by the cosine, is 1 / (2 h^2); of what is nearer than it may be, that."""
    ceiling = mesh_of("Ceiling", [quad((-18, -18, 0.1), (0, 40, 0), (40, 0, 0))], [0])
    texels = floor(ceiling)
    visibility = Visibility(texels.surfaces.corners)
    walls = finish(find_walls(texels, visibility, 1))
    grey, solid = np.zeros((texels.count, 3), np.float32), np.ones(texels.surfaces.count, bool)
    patches = group_patches(texels, walls, grey, grey, solid, 500, visibility)
    even = np.ones(texels.count + patches.count + SPECIAL_ROWS, np.float32)
    rays = GatherRays(texels, patches, visibility, BakeSettings(quality="high"), even, near_to=near_to)
    middle = np.linalg.norm(texels.position + texels.surfaces.origin - [2, 2, 0], axis=1).argmin(keepdims=True)
    scale, _, _ = finish(rays.look(middle, np.zeros(1, bool)))
    assert scale[0] == pytest.approx(expected, rel=0.01)


# where points stand


class Blind:
    """Eyes that see what they are told: the scale of change at positions (Q, 3), m; light everywhere."""

    def __init__(self, texels: Texels, scale: Callable[[Float32], Float32]) -> None:
        self.texels, self.scale = texels, scale

    def look(self, chosen: Int64, fine: bool) -> Fractions[tuple[Float32, Float32, Float32]]:
        yield 1.0
        seen = np.broadcast_to(self.scale(self.texels.position[chosen]), len(chosen)).astype(np.float32)
        return seen, seen, np.ones(len(chosen), np.float32)

    def clearance(self, chosen: Int64) -> Fractions[Float32]:
        yield 1.0
        return np.full(len(chosen), FAR, np.float32)


def far(position: Float32) -> Float32:
    return np.full(len(position), FAR, np.float32)


def floor(*more: Mesh) -> Texels:
    """A floor of 4 x 4 m in z = 0, facing up; its texels are 4 / 58 m wide."""
    ground = mesh_of("Floor", [quad((0, 0, 0), (4, 0, 0), (0, 4, 0))], [0])
    scene = Scene((ground, *more), GREY)
    return finish(rasterize(cell_atlas(scene, 64 * (1 + bool(more))), flatten(scene), 1))


def placed(texels: Texels, base: float, scale: Callable[[Float32], Float32] = far, near: float = NEAR) -> GatherPoints:
    return finish(place_points(texels, texels.valid, base, near, 0.07, Blind(texels, scale)))


def test_in_the_open_points_stand_a_cell_apart() -> None:
    points = placed(floor(), 0.5)
    assert points.count == pytest.approx((4 / 0.5) ** 2, rel=0.3)
    assert set(points.width) == {np.float32(0.5)}


def test_cells_are_narrower_where_surfaces_are_near() -> None:
    texels = floor()
    points = placed(texels, 0.5, lambda position: np.where(position[:, 0] < 0, 0.5, FAR))
    left = texels.position[points.texel, 0] < -0.3
    right = texels.position[points.texel, 0] > 0.3
    assert set(points.width[left]) == {np.float32(0.25)}, "narrower ones would hold less than 2 x 2 texels"
    assert set(points.width[right]) == {np.float32(0.5)}
    assert left.sum() > 3 * right.sum()


def test_a_smaller_share_of_the_distance_splits_cells_sooner() -> None:
    for near, width in ((NEAR, 0.5), (NEAR / 2, 0.25)):
        assert set(placed(floor(), 0.5, lambda position: np.float32(2.0), near).width) == {np.float32(width)}


def test_points_stand_closer_together_in_folds_than_on_any_flat_surface() -> None:
    scene = Scene((sphere("Ball", 0.2, 8, 4),), GREY)
    ball = finish(rasterize(cell_atlas(scene, 96), flatten(scene), 1))
    near = [placed(texels, 0.5, lambda position: np.float32(0.3)).width for texels in (ball, floor())]
    assert np.mean(near[0] == np.float32(0.125)) > 0.6
    assert set(near[1]) == {np.float32(0.25)}


def test_points_stand_as_close_together_in_nooks_as_in_folds() -> None:
    assert set(placed(floor(), 0.5, lambda position: np.float32(0.2)).width) == {np.float32(0.125)}


def test_every_lit_texel_has_a_point_in_its_own_cell_and_no_other_has_one() -> None:
    texels = floor(box("Box", (1, 1, 0), (2, 2, 1)))
    lit = texels.valid & (texels.position[:, 0] < 1.5)
    near = Blind(texels, lambda position: 0.2 + np.abs(position[:, 1]))
    points = finish(place_points(texels, lit, 0.5, NEAR, 0.07, near))
    assert (points.cell[~lit] == -1).all()
    assert (points.cell[lit] >= 0).all()
    assert np.array_equal(points.cell[points.texel], np.arange(points.count)), "each point lies in its own cell"
    own = points.cell[lit]
    gap = np.abs(texels.position[lit] - texels.position[points.texel[own]]).max(1)
    assert (gap <= points.width[own] * 1.001).all()
    facing = np.einsum("ij,ij->i", texels.normal[lit], texels.normal[points.texel[own]])
    assert facing.min() > 0.7


def test_sheets_that_lie_close_together_have_points_of_their_own() -> None:
    above = mesh_of("Sheet", [quad((0, 0, 0.01), (4, 0, 0), (0, 4, 0))], [0])
    texels = floor(above)
    points = placed(texels, 0.5)
    height = texels.position[:, 2]
    assert np.abs(height - height[points.texel[points.cell]]).max() < 1e-4


def test_nothing_lit_needs_no_point() -> None:
    texels = floor()
    dark = np.zeros(texels.count, bool)
    points = finish(place_points(texels, dark, 0.5, NEAR, 0.07, Blind(texels, far)))
    assert points.count == 0
    assert (points.cell == -1).all()


# from points to texels


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
        finish(fit_irradiance(texels, points, neighbours, irradiance, visibility, workers)),
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


# the whole of it: an emitter of half the scene's surface is not a lamp, and only the gather's rays find it


@pytest.mark.parametrize(
    ("receiver", "emitter", "form_factor"),
    [
        (quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), quad((0, 0, 1), (0, 1, 0), (1, 0, 0)), 0.1998249),
        (quad((0, 0, 0), (2, 0, 0), (0, 2, 0)), quad((0, 0, 1), (0, 2, 0), (2, 0, 0)), 0.4152533),
        (quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), quad((0, 0, 0), (0, 1, 0), (0, 0, 1)), 0.2000438),
    ],
    ids=["squares 1 m apart", "squares half as far", "squares at a right angle"],
)
def test_the_gather_reads_the_form_factor_between_squares(receiver, emitter, form_factor) -> None:
    """H / pi of a black receiver is the emitter's radiance times F."""
    scene = Scene(
        (mesh_of("Receiver", [receiver], [0]), mesh_of("Emitter", [emitter], [1])),
        (Material("Black", (0, 0, 0)), Material("Glow", (0, 0, 0), (1, 1, 1))),
    )
    baked = finish(bake(scene, BakeSettings(page_size=128, quality="high")))
    texels = finish(rasterize(baked.atlas, flatten(scene), 1))
    light = baked.pages[0].reshape(-1, 3)[texels.pixel, 0].astype(np.float64)
    mine = texels.surfaces.mesh[texels.triangle[:]] == 0
    assert np.average(light[mine], weights=texels.area[mine]) == pytest.approx(form_factor, rel=0.01)


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
