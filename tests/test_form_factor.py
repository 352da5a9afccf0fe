# SPDX-License-Identifier: GPL-3.0-or-later
"""The traced transport: closed forms first, then what holds for every scene."""

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.radiosity import form_factor, transport
from radiosity_addon.radiosity.form_factor import HemicubeRays, ray_counts, trace_view
from radiosity_addon.radiosity.hemicube import hemicube, resolution_for
from radiosity_addon.radiosity.pairs import exchange_of_pairs
from radiosity_addon.radiosity.patches import NOTHING, SKY
from radiosity_addon.radiosity.transport import Transport, View, closed, join_hits
from radiosity_addon.sampling import cosine_directions, even_uniform
from tests.rooms import Facets, box, joined, rectangle, sphere

MANY = 16384


def transport_of_hits(area, rays, target, workers) -> Transport:
    view = View(rays, target)
    return finish(closed(area, view, finish(join_hits(area, view, workers)), workers))


def between(transport: Transport, senders: slice, receivers: slice) -> float:
    """Form factor between two sets of patches."""
    return transport.dense()[senders, receivers].sum() / transport.area[senders].sum()


@pytest.mark.parametrize(
    "width, depth, height, expected", [(1, 1, 1, 0.1998249), (2, 2, 1, 0.4152533), (1, 1.5, 0.5, 0.4755764)]
)
def test_parallel_rectangles(width, depth, height, expected):
    floor = rectangle((0, 0, 0), (width, 0, 0), (0, depth, 0))
    ceiling = rectangle((0, 0, height), (0, depth, 0), (width, 0, 0))
    transport = Facets(*joined(floor, ceiling)).transport(MANY)
    assert between(transport, slice(0, 1), slice(1, 2)) == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize("width, height, length, expected", [(1, 1, 1, 0.2000438), (2, 1, 1, 0.1164263)])
def test_perpendicular_rectangles_with_a_common_edge(width, height, length, expected):
    floor = rectangle((0, 0, 0), (width, 0, 0), (0, length, 0))
    wall = rectangle((0, 0, 0), (0, length, 0), (0, 0, height))
    transport = Facets(*joined(floor, wall)).transport(MANY)
    assert between(transport, slice(0, 1), slice(1, 2)) == pytest.approx(expected, rel=0.01)


def test_coaxial_discs():
    """Discs as 128-gons of the same area, cut into triangles like a cake."""
    sides, angle = 128, 2 * np.pi / 128
    radius = np.sqrt(2 * np.pi / (sides * np.sin(angle)))
    turn = np.arange(sides) * angle
    here, there = (radius * np.stack([np.cos(t), np.sin(t), 0 * t], 1) for t in (turn, turn + angle))
    low = np.zeros((sides, 3)), here, there
    high = np.tile([0.0, 0.0, 1.0], (sides, 1)), there, here
    transport = Facets(*joined(low, high), triangular=True).transport(4096)
    assert between(transport, slice(0, sides), slice(sides, None)) == pytest.approx(0.3819660, rel=0.005)


@pytest.mark.parametrize("place, expected", [((0.5, 0.5), 0.2394565), ((0, 0), 0.1385316)])
def test_small_patch_under_a_square(place, expected):
    small = rectangle((place[0] - 0.005, place[1] - 0.005, 0), (0.01, 0, 0), (0, 0.01, 0))
    square = rectangle((0, 0, 1), (0, 1, 0), (1, 0, 0))
    transport = Facets(*joined(small, square)).transport(40000)  # a quarter of them for the small one
    assert between(transport, slice(0, 1), slice(1, 2)) == pytest.approx(expected, rel=0.01)


def test_floor_of_a_box_sees_walls_by_their_closed_forms():
    """2 x 1 x 1 m: ceiling 0.2858, long walls 0.2406 each, end walls 0.1164263 each; together 1."""
    transport = box((2, 1, 1)).transport(MANY)
    row = transport.dense()[0] / transport.area[0]
    assert row.sum() == pytest.approx(1, abs=1e-6)
    assert row[2:4] == pytest.approx([0.1164263, 0.1164263], rel=0.01)
    assert row[0] == 0


def test_walls_of_a_cube_see_each_other_alike():
    """The enclosure of Goral, Torrance, Greenberg and Battaile (1984), a patch each: 0.1998 across, 0.2000 beside."""
    shares = box().transport(MANY).dense()
    opposite = np.kron(np.eye(3), np.array([[0, 1], [1, 0]]))
    expected = 0.1998249 * opposite + 0.2000438 * (1 - opposite - np.eye(6))
    assert shares == pytest.approx(expected, abs=0.0015)  # a few deviations of 32,768 rays a pair, spread evenly


def test_error_falls_faster_than_the_root_of_the_rays():
    """Sobol points: 64 times the rays, where plain random ones would err 8 times less; mean of 16 cut squares."""

    def error(rays: int) -> float:
        floor = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0), 4)
        ceiling = rectangle((0, 0, 1), (0, 1, 0), (1, 0, 0), 4)
        transport = Facets(*joined(floor, ceiling)).transport(rays)
        return float(np.sqrt(np.mean((transport.escaped - exact) ** 2)))

    floor = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0), 4)
    ceiling = rectangle((0, 0, 1), (0, 1, 0), (1, 0, 0), 4)
    exact = Facets(*joined(floor, ceiling)).transport(60000).escaped
    assert error(2048) < error(32) / 8


def test_exchange_is_reciprocal_to_the_last_bit():
    matrix = box((3, 2, 1), 4).transport(64).dense()
    assert np.array_equal(matrix, matrix.T)
    assert matrix.any()


def test_sampled_rows_are_reciprocal_within_three_sigma():
    room = box((3, 2, 1), 2)
    rays, count = 4096, room.count
    ids, sample = np.repeat(np.arange(count), rays), np.tile(np.arange(rays), count)
    origins, about = room.origins(ids, sample)
    directions = cosine_directions(about, even_uniform(ids, sample, 0), even_uniform(ids, sample, 1))
    target = room.at(Visibility(room.corners()).first_hit(origins, directions))
    share = np.bincount(ids * count + target, minlength=count * count).reshape(count, count) / rays
    exchange = room.area[:, None] * share
    sigma = room.area[:, None] * np.sqrt(share * (1 - share) / rays)
    difference = np.abs(exchange - exchange.T)
    assert (difference <= 3 * np.sqrt(sigma**2 + sigma.T**2) + 1e-12).all()


def test_rows_of_a_closed_room_sum_to_one():
    for room in (box((3, 2, 1), 6), sphere(6)):
        assert np.abs(room.transport(64).escaped).max() < 1e-6


def test_rows_of_an_open_scene_never_exceed_one():
    """A box without a ceiling, and a plate that hardly sees anything."""
    room = box((1, 1, 1), 4)
    walls = np.r_[0:16, 32:96]
    transport = Facets(room.origin[walls], room.edge_u[walls], room.edge_v[walls]).transport(32)
    assert transport.escaped.min() > -1e-6
    assert transport.escaped.max() > 0.1


def test_plates_whose_own_estimates_disagree_are_balanced():
    """The small plate sees 30 % and the large one's rays say 25 %: what escapes gives way in both."""
    area = np.array([1.0, 1.0])
    target = np.int32([1] * 30 + [SKY] * 70 + [0] * 25 + [SKY] * 75)
    transport = transport_of_hits(area, np.array([100, 100]), target, 1)
    kept = transport.dense().sum(1)
    assert kept[0] == pytest.approx(kept[1], rel=1e-6)
    assert 0.25 < kept[0] < 0.30
    assert kept + transport.escaped == pytest.approx([1, 1], abs=1e-12)


def test_rows_that_no_scaling_can_close_make_no_light():
    """A large patch that sees only a small one, and loses nothing: impossible, but rays may say so."""
    area = np.array([10.0, 1.0])
    transport = transport_of_hits(area, np.array([2, 2]), np.int32([1, 1, 0, 0]), 1)
    assert (transport.dense().sum(1) <= area * (1 + 1e-6)).all()
    assert np.isfinite(transport.exchange).all()


def test_both_estimates_of_a_pair_are_joined_by_their_rays():
    """c01 + c10 = 2 + 2 hits over n0 / A0 + n1 / A1 = 4 + 4 rays a square metre, and half of all rays escape."""
    target = np.int32([1, SKY, 1, SKY, 0, 0, SKY, SKY])
    transport = transport_of_hits(np.ones(2), np.array([4, 4]), target, 1)
    assert transport.dense() == pytest.approx(np.array([[0, 0.5], [0.5, 0]]))
    assert transport.escaped == pytest.approx([0.5, 0.5])
    assert list(transport.rays) == [4, 4]


def test_rays_that_meet_nothing_do_not_count():
    plain = np.int32([1, SKY, 0, SKY])
    mixed = np.int32([NOTHING, 1, SKY, NOTHING, 0, SKY])
    expected = transport_of_hits(np.ones(2), np.array([2, 2]), plain, 1)
    transport = transport_of_hits(np.ones(2), np.array([4, 2]), mixed, 1)
    assert np.array_equal(transport.dense(), expected.dense())
    assert np.array_equal(transport.escaped, expected.escaped)
    assert list(transport.rays) == [2, 2]


def test_a_buried_patch_keeps_its_light():
    target = np.int32([NOTHING] * 4 + [2] * 4 + [1] * 4)
    transport = transport_of_hits(np.ones(3), np.array([4, 4, 4]), target, 1)
    assert transport.dense()[0].sum() == 0
    assert transport.escaped == pytest.approx([1, 0, 0], abs=1e-6)
    assert not transport.sky.any()


def test_share_of_sky_is_what_the_exact_form_factor_leaves():
    """Over a 1 x 1 m floor 1 m below a ceiling of its size, 1 - 0.1998249 is open."""
    floor, ceiling = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0)), rectangle((0, 0, 1), (0, 1, 0), (1, 0, 0))
    assert Facets(*joined(floor, ceiling)).transport(MANY).sky == pytest.approx([0.8001751] * 2, rel=0.002)


def test_a_scene_without_patches_has_an_empty_transport():
    transport = transport_of_hits(np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int32), 2)
    assert transport.count == 0
    assert transport.gather(np.zeros((0, 3))).shape == (0, 3)


def test_joining_in_blocks_changes_nothing(monkeypatch):
    room = box((3, 2, 1), 6)
    whole = room.transport(64)
    monkeypatch.setattr(transport, "MERGED_HITS", 1000)
    monkeypatch.setattr(transport, "BLOCK_ENTRIES", 50)
    monkeypatch.setattr(transport, "SUMMED_ENTRIES", 500)
    blocks = room.transport(64)
    assert np.array_equal(blocks.column, whole.column)
    assert np.array_equal(blocks.exchange, whole.exchange)


def test_transport_is_the_same_for_any_number_of_threads():
    room = box((3, 2, 1), 8)
    one, two = room.transport(256, workers=1), room.transport(256, workers=2)
    for name in ("first", "column", "exchange", "escaped", "sky", "rays"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name


def test_tracing_reports_rising_shares():
    room = box((3, 2, 1), 8)
    steps = form_factor.trace_transport(room, Visibility(room.corners()), room.settings(256, 1))
    shares = list(steps)
    assert shares == sorted(shares)
    assert len(shares) > 4
    assert 0 < shares[0] < shares[-1] <= 1


def test_gather_multiplies_by_the_whole_matrix():
    transport = box((3, 2, 1), 4).transport(64)
    radiosity = np.random.default_rng(1).random((transport.count, 6))
    assert transport.gather(radiosity) == pytest.approx(transport.dense() @ radiosity, rel=1e-12)


def test_gather_passes_over_patches_that_see_nothing():
    transport = Transport(
        np.ones(3), np.array([0, 0, 1, 1]), np.int32([1]), np.float32([0.5]), *np.zeros((2, 3)), np.ones(3, int)
    )
    assert np.array_equal(transport.gather(np.ones((3, 1))), [[0], [0.5], [0]])


@pytest.mark.parametrize("senders", [[5], [3, 40, 41], list(range(96))])
def test_scatter_sends_what_the_chosen_rows_leave(senders):
    transport = box((3, 2, 1), 4).transport(64)
    rows = np.array(senders)
    radiosity = np.random.default_rng(2).random((len(rows), 3))
    expected = transport.dense()[:, rows] @ radiosity
    assert transport.scatter(rows, radiosity) == pytest.approx(expected, rel=1e-12)


def test_rays_grow_with_the_root_of_the_area_within_bounds():
    rays = ray_counts(np.array([1.0] * 1000 + [4.0, 1e-6, 400.0]), 128)
    assert rays[1000] == pytest.approx(2 * rays[0], abs=1)
    assert rays[1001] == 32
    assert rays[1002] == 512


# the other estimators

ESTIMATORS = ("nusselt", "hemicube", "area")


@pytest.mark.parametrize("resolution", [2, 4, 10, 64, 256])
def test_cells_of_a_hemicube_see_everything_once(resolution):
    cube = hemicube(resolution)
    assert len(cube.weights) == 3 * resolution**2
    assert abs(cube.weights.sum() - 1) < 1e-12
    assert cube.weights.min() > 0


def test_cells_of_a_hemicube_have_their_exact_form_factors():
    """The cells within half a unit of the axis are a unit square at height 1; all sides are alike."""
    cube = hemicube(4)
    inner = (np.abs(cube.directions[:16, :2] / cube.directions[:16, 2:]) < 0.5).all(1)
    assert cube.weights[:16][inner].sum() == pytest.approx(0.2394565, abs=1e-7)
    sides = cube.weights[16:].reshape(4, -1).sum(1)
    assert sides == pytest.approx([(1 - cube.weights[:16].sum()) / 4] * 4, rel=1e-12)


@pytest.mark.parametrize("odd", [0, 1, 3])
def test_a_hemicube_has_an_even_resolution(odd):
    with pytest.raises(ValueError, match="even"):
        hemicube(odd)


def test_a_hemicubes_resolution_is_chosen_by_the_rays_that_it_sends():
    assert [resolution_for(rays) for rays in (1, 12, 48, 108, 12288)] == [2, 2, 4, 6, 64]


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize(
    "width, depth, height, expected", [(1, 1, 1, 0.1998249), (2, 2, 1, 0.4152533), (1, 1.5, 0.5, 0.4755764)]
)
def test_each_estimator_finds_parallel_rectangles(estimator, width, depth, height, expected):
    floor = rectangle((0, 0, 0), (width, 0, 0), (0, depth, 0), 6)
    ceiling = rectangle((0, 0, height), (0, depth, 0), (width, 0, 0), 6)
    found = Facets(*joined(floor, ceiling)).transport(432, form_factors=estimator)
    assert between(found, slice(0, 36), slice(36, 72)) == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("width, height, length, expected", [(1, 1, 1, 0.2000438), (2, 1, 1, 0.1164263)])
def test_each_estimator_finds_rectangles_with_a_common_edge(estimator, width, height, length, expected):
    floor = rectangle((0, 0, 0), (width, 0, 0), (0, length, 0), 8)
    wall = rectangle((0, 0, 0), (0, length, 0), (0, 0, height), 8)
    found = Facets(*joined(floor, wall)).transport(432, form_factors=estimator)
    assert between(found, slice(0, 64), slice(64, 128)) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_each_estimator_gives_a_reciprocal_operator_whose_rows_add_up(estimator):
    found = box((3, 2, 1), 5).transport(108, form_factors=estimator)
    full = found.dense()
    assert np.array_equal(full, full.T)
    assert full.sum(1) / found.area == pytest.approx(np.ones(found.count), abs=1e-5)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_each_estimator_sees_what_stands_in_the_way(estimator):
    """A screen that reaches beyond both halves them off: what is left goes round it."""
    floor = rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0), 4)
    ceiling = rectangle((0, 0, 1), (0, 1, 0), (1, 0, 0), 4)
    screen = rectangle((-9, -9, 0.5), (18, 0, 0), (0, 18, 0))
    found = Facets(*joined(floor, ceiling, screen)).transport(108, form_factors=estimator)
    assert between(found, slice(0, 16), slice(16, 32)) == 0


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_each_estimator_is_the_same_for_any_number_of_threads(estimator):
    room = box((3, 2, 1), 6)
    one, two = (room.transport(48, workers, estimator) for workers in (1, 2))
    assert np.array_equal(one.column, two.column)
    assert np.array_equal(one.exchange, two.exchange)


def slope(costs, errors) -> float:
    """Exponent with which errors fall with costs."""
    return float(np.polyfit(np.log(costs), np.log(errors), 1)[0])


def test_a_hemicube_of_finer_cells_errs_less():
    """Points under a unit square: only the cells at its border err, so the error falls as resolution^-1 to -1.5."""
    place = np.random.default_rng(5).uniform(0.1, 0.9, (200, 2))
    edge = 1e-4
    points = np.concatenate([place - edge / 2, np.zeros((200, 1))], axis=1)
    small = points, np.tile([edge, 0.0, 0.0], (200, 1)), np.tile([0.0, edge, 0.0], (200, 1))
    square = rectangle((0, 0, 1), (0, 1, 0), (1, 0, 0))
    patches = Facets(*joined(small, square))

    def corner(x, y):
        a, b = np.sqrt(1 + x * x), np.sqrt(1 + y * y)
        return (x / a * np.arctan(y / a) + y / b * np.arctan(x / b)) / (2 * np.pi)

    expected = sum(corner(x, y) for x in (place[:, 0], 1 - place[:, 0]) for y in (place[:, 1], 1 - place[:, 1]))
    resolutions = (4, 8, 16, 32, 64)
    errors = []
    for resolution in resolutions:
        view = finish(trace_view(patches, HemicubeRays(resolution), Visibility(patches.corners()), 1))[0]
        share = np.bincount(view.source, weights=view.weight(np.arange(len(view.target))) * (view.target == 200))
        errors.append(np.sqrt(np.mean((share[:200] / (3 * resolution**2) - expected) ** 2)))
    assert -2.0 < slope(resolutions, errors) < -0.9


def test_the_double_area_integral_errs_less_with_more_points():
    """Unit squares at distance 1, many pairs of them far apart: the points of a pair meet at random, so S^-1/2."""
    across = 80 * np.arange(40)[:, None] * np.array([1.0, 0, 0])
    low = across, np.tile([1.0, 0, 0], (40, 1)), np.tile([0.0, 1, 0], (40, 1))
    high = across + np.array([0, 0, 1.0]), low[2], low[1]
    patches = Facets(*joined(low, high))
    numbers = (4, 16, 64, 256)
    errors = []
    for number in numbers:
        first, column, exchange, _ = finish(exchange_of_pairs(patches, Visibility(patches.corners()), number, 1))
        row = np.repeat(np.arange(80), np.diff(first))
        errors.append(np.sqrt(np.mean((exchange[column == row + 40] - 0.1998249) ** 2)))
    assert errors[-1] < 0.006
    assert -0.8 < slope(numbers, errors) < -0.35
