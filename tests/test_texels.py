# SPDX-License-Identifier: GPL-3.0-or-later
"""Texels: conservative, of true area, each on the surface where it says it is."""

from copy import deepcopy
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radiosity_addon.atlas.unwrap import Atlas
from radiosity_addon.chunks import finish
from radiosity_addon.geometry.coverage import ScanLines, ragged
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import STRATA, rasterize
from radiosity_addon.scene import Material, Mesh, Scene
from tests.shapes import box, cell_atlas, furnished_room, mesh_of, quad, sphere

GREY = (Material("Grey"),)


def laid_out(triangles, size, page=0, chart=None, stretch=1.0):
    """A mesh in the plane z = 0 whose uv map, in texels, is `triangles` (F, 3, 2), with its atlas."""
    triangles = np.asarray(triangles, np.float64)
    count = len(triangles)
    vertices = np.concatenate([triangles * stretch, np.zeros((count, 3, 1))], axis=2).reshape(-1, 3)
    corners = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    zero = np.zeros(count, np.int32)
    up = np.zeros((count, 3, 3), np.float32)
    up[..., 2] = 1
    scene = Scene((Mesh("Flat", vertices, corners, up, zero, zero, corners),), GREY)
    atlas = Atlas(
        size=size,
        page=np.array([page], np.int32),
        page_count=page + 1,
        hidden_page_count=0,
        uv=((triangles / size).astype(np.float32),),
        chart=(zero if chart is None else np.asarray(chart, np.int32),),
        density=np.ones(1),
        fill=np.ones(1),
        warnings=(),
    )
    return scene, atlas


def texels_of(scene, atlas, workers=1):
    return finish(rasterize(atlas, flatten(scene), workers))


def distance_to(triangle, points):
    """Largest of |dx|, |dy| from points (K, 2) to the nearest point, in that norm, of a filled triangle."""
    low, high = np.zeros(len(points)), np.full(len(points), 64.0)
    for _ in range(60):  # a square of half width r about the point meets the triangle: separating axes, bisected
        middle = (low + high) / 2
        apart = np.zeros(len(points), bool)
        edges = np.roll(triangle, -1, axis=0) - triangle
        axes = np.concatenate([np.eye(2), np.stack([-edges[:, 1], edges[:, 0]], axis=1)])
        for axis in axes:
            if not axis.any():
                continue
            reach = np.abs(axis).sum() * middle
            along, own = points @ axis, triangle @ axis
            apart |= (along + reach < own.min()) | (along - reach > own.max())
        low, high = np.where(apart, middle, low), np.where(apart, high, middle)
    return high


def centres(size):
    return np.stack(np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5), axis=-1).reshape(-1, 2)


def test_a_square_that_fills_whole_texels_covers_them_and_those_beside():
    scene, atlas = laid_out([[(4, 4), (12, 4), (12, 12)], [(4, 4), (12, 12), (4, 12)]], 16, stretch=0.5)
    texels = texels_of(scene, atlas)
    row, column = texels.pixel // 16, texels.pixel % 16
    inner = (row >= 4) & (row < 12) & (column >= 4) & (column < 12)
    assert inner.sum() == 64
    assert (texels.covered[inner] == 15).all()
    assert texels.area[inner] == pytest.approx(0.25, abs=0.02)  # the diagonal's sub-texels all go to one triangle
    assert texels.area[inner].sum() == pytest.approx(16, rel=1e-6)
    assert texels.count == 100
    assert (texels.covered[~inner] == 0).all()
    assert (texels.area[~inner] == 0).all()


@pytest.mark.parametrize("scene", [furnished_room(), Scene((sphere("Ball", segments=60, rings=40),), GREY)])
@pytest.mark.parametrize("size", [200, 333])
def test_texel_areas_sum_to_each_component_of_the_surface(scene, size):
    surfaces = flatten(scene)
    texels = finish(rasterize(cell_atlas(scene, size, margin=1.3), surfaces))
    assert texels.area.sum(dtype=float) == pytest.approx(surfaces.area.sum(), rel=1e-6)


def test_triangles_much_smaller_than_texels_keep_their_area():
    rng = np.random.default_rng(3)
    corner = rng.uniform(1, 31, (500, 1, 2))
    scene, atlas = laid_out(corner + rng.uniform(0, 0.2, (500, 3, 2)), 32, chart=np.arange(500))
    texels = texels_of(scene, atlas)
    assert texels.area.sum(dtype=float) == pytest.approx(flatten(scene).area.sum(), rel=1e-6)
    assert (texels.texel_at[(corner[:, 0] + 0.1).astype(int) @ [1, 32]] >= 0).mean() > 0.9


def test_a_partly_covered_texel_has_that_share_of_a_whole_ones_area():
    scene, atlas = laid_out([[(2, 2), (5.5, 2), (5.5, 6)], [(2, 2), (5.5, 6), (2, 6)]], 8)
    texels = texels_of(scene, atlas)
    column = texels.pixel % 8
    own = texels.covered > 0
    assert texels.area[own & (column == 5)] == pytest.approx(0.5, rel=1e-6)
    assert (texels.covered[own & (column == 5)] == 0b0101).all()
    assert texels.area[own & (column < 5)] == pytest.approx(1, rel=1e-6)


def random_triangle(size=24):
    place = st.floats(0, size, allow_nan=False, width=32)
    return st.lists(st.tuples(place, place), min_size=3, max_size=3)


@settings(max_examples=150, deadline=None)
@given(random_triangle())
def test_every_pixel_whose_bilinear_footprint_touches_a_chart_has_a_texel(triangle):
    size = 24
    triangle = np.array(triangle, np.float64)
    scene, atlas = laid_out(triangle[None], size)
    has = texels_of(scene, atlas).texel_at >= 0
    reach = distance_to(triangle, centres(size))
    assert has[reach < 1 - 1e-3].all()
    assert not has[reach > 1 + 1e-3].any()


@settings(max_examples=60, deadline=None)
@given(random_triangle(), st.floats(0, 24), st.floats(0, 24))
def test_slivers_that_are_thinner_than_the_grid_of_borders_are_covered(triangle, x, y):
    first = np.array(triangle[0], np.float64)
    thin = np.array([first, first + np.array([0.004, 0.003]), (x, y)])
    thin = np.clip(thin, 0, 24)
    has = texels_of(*laid_out(thin[None], 24)).texel_at >= 0
    assert has[distance_to(thin, centres(24)) < 1 - 1e-3].all()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 96), st.integers(0, 96)), min_size=5, max_size=5, unique=True))
def test_sub_texels_on_edges_that_triangles_share_are_covered_once(points):
    rim = np.array([(0, 0), (96, 0), (96, 96), (0, 96)])
    inner = np.array(points) / 4  # quarters of a texel: many fall on sub-texel centres
    fan = []
    for centre in inner[:1]:
        fan = [(centre, rim[k] / 4, rim[(k + 1) % 4] / 4) for k in range(4)]
    uv = np.array(fan, np.float64)
    scan = ScanLines(uv, np.zeros(4, np.int32), 24)
    spans = scan.spans(0, scan.rows)
    cells = ragged(spans.line * 48 + spans.left, spans.right - spans.left)
    assert np.array_equal(np.sort(cells), np.arange(48 * 48))


def test_the_same_is_covered_however_the_rows_are_cut():
    rng = np.random.default_rng(1)
    scan = ScanLines(rng.uniform(0, 32, (50, 3, 2)), np.zeros(50, np.int32), 32)

    def cells(spans):
        return ragged(spans.line * 64 + spans.left, spans.right - spans.left)

    whole = cells(scan.spans(0, scan.rows))
    cuts = scan.cuts(100)
    assert len(cuts) > 20
    parts = [cells(scan.spans(int(a), int(b))) for a, b in pairwise(cuts)]
    assert np.array_equal(np.concatenate(parts), whole)


def test_every_chart_owns_a_texel_even_when_it_is_a_point_or_a_line():
    shapes = [[(3.2, 3.2)] * 3, [(10.1, 10.1), (14.7, 10.1), (12, 10.1)], [(20.4, 3), (20.41, 3), (20.4, 9)]]
    scene, atlas = laid_out(shapes, 32, chart=[0, 1, 2])
    owners = set(np.unique(texels_of(scene, atlas).triangle[:]))
    assert owners == {0, 1, 2}


def test_barycentrics_give_the_place_of_each_stratum():
    scene = furnished_room()
    surfaces = flatten(scene)
    texels = finish(rasterize(cell_atlas(scene, 200, margin=2.3), surfaces))
    triangle, weights = texels.footprints.strata(np.arange(texels.count))
    x0, y0, xu, xv, yu, yv = texels.lookup.astype(float)[:, triangle]
    u, v = np.moveaxis(weights, 2, 0).astype(float)
    x, y = x0 + u * xu + v * xv, y0 + u * yu + v * yv
    slot = np.arange(STRATA)
    wanted_x = (texels.pixel % 200)[:, None] + 0.25 + 0.5 * (slot % 2)
    wanted_y = (texels.pixel // 200)[:, None] + 0.25 + 0.5 * (slot // 2)
    kept = (texels.covered[:, None] >> slot & 1) > 0
    width = 1e-5 * 200  # the margin that keeps points off edges
    assert np.abs(x - wanted_x)[kept].max() < width
    assert np.abs(y - wanted_y)[kept].max() < width


def test_positions_follow_from_barycentrics():
    scene = Scene((sphere("Ball", radius=2.0),), GREY)
    surfaces = flatten(scene)
    texels = finish(rasterize(cell_atlas(scene, 256, margin=2), surfaces))
    ids = np.arange(texels.count)
    own, weights = texels.footprints.strata(ids)
    corners = surfaces.corners.astype(float)[own]
    u, v = np.moveaxis(weights, 2, 0).astype(float)[..., None]
    points = corners[:, :, 0] * (1 - u - v) + corners[:, :, 1] * u + corners[:, :, 2] * v
    assert np.abs(texels.position - points.mean(1)).max() < 1e-5
    for slot in range(STRATA):
        found, triangle = texels.points(ids, np.full(len(ids), slot))
        assert np.abs(found - points[:, slot]).max() < 1e-5
        assert np.array_equal(triangle, own[:, slot])


def test_shading_normals_of_a_smooth_sphere_point_from_its_centre():
    scene = Scene((sphere("Ball", segments=64, rings=32),), GREY)
    texels = texels_of(scene, cell_atlas(scene, 400, margin=2))
    outward = texels.position / np.linalg.norm(texels.position, axis=1)[:, None]
    assert np.einsum("ij,ij->i", texels.shading_normal, outward).min() > 0.9999
    assert np.linalg.norm(texels.shading_normal, axis=1) == pytest.approx(1, abs=1e-5)


def test_flat_faces_have_one_normal():
    scene = furnished_room()
    texels = texels_of(scene, cell_atlas(scene, 128))
    assert np.array_equal(texels.shading_normal, texels.normal)


@pytest.mark.parametrize("sample", [0, 3, 5, 27, 143])
def test_looking_up_a_point_finds_the_texel_it_belongs_to(sample):
    scene = furnished_room()
    surfaces = flatten(scene)
    texels = finish(rasterize(cell_atlas(scene, 200, margin=2.3), surfaces))
    ids = np.flatnonzero(texels.covered == 15)
    points, triangle = texels.points(ids, np.full(len(ids), sample))
    corners = surfaces.corners[triangle].astype(float)
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    weights = np.einsum("rij,rj->ri", np.linalg.pinv(edges), points - corners[:, 0])
    u, v = weights.T.astype(np.float32)
    assert np.array_equal(texels.at(triangle, u, v), ids)


def test_later_samples_of_a_texel_differ_and_stay_on_its_triangles():
    scene = furnished_room()
    texels = texels_of(scene, cell_atlas(scene, 128))
    ids = np.flatnonzero(texels.covered > 0)
    first, triangle = texels.points(ids, np.zeros(len(ids), np.int64))
    later, same = texels.points(ids, np.full(len(ids), 4))
    assert np.array_equal(triangle, same)
    assert (np.abs(first - later).max(1) > 0).mean() > 0.9
    width = np.sqrt(texels.area.max())
    assert np.abs(first - later).max() < width


def test_origins_are_lifted_to_the_front():
    scene = furnished_room()
    texels = texels_of(scene, cell_atlas(scene, 64))
    ids = np.arange(texels.count)
    slot = np.zeros(len(ids), np.int64)
    lift = texels.origins(ids, slot).astype(float) - texels.points(ids, slot)[0]
    height = np.einsum("ij,ij->i", lift, texels.normal)
    assert height.min() > 0.5 * texels.surfaces.offset
    assert height.max() < 1.5 * texels.surfaces.offset


def test_a_mirrored_chart_has_the_same_texels_the_other_way_round():
    shape = np.array([[(3, 2.2), (13.4, 4), (6, 12.1)]])
    plain = texels_of(*laid_out(shape, 16))
    scene, atlas = laid_out(shape, 16)
    turned = replace(atlas, uv=(np.stack([1 - atlas.uv[0][..., 0], atlas.uv[0][..., 1]], axis=-1).astype(np.float32),))
    mirrored = texels_of(scene, turned)
    flipped = plain.pixel // 16 * 16 + 15 - plain.pixel % 16
    assert np.array_equal(np.sort(flipped), mirrored.pixel)
    assert mirrored.area.sum() == pytest.approx(plain.area.sum(), rel=1e-6)
    assert np.array_equal(mirrored.normal, plain.normal[np.argsort(flipped)])
    whole = mirrored.covered == 15
    assert np.abs(mirrored.position - plain.position[np.argsort(flipped)])[whole].max() < 1e-4


def test_meshes_without_a_page_have_no_texels():
    scene = Scene((box("Shown", (0, 0, 0), (1, 1, 1)), box("Gone", (3, 0, 0), (4, 1, 1))), GREY)
    atlas = replace(cell_atlas(scene, 64), page=np.array([0, -1], np.int32))
    texels = texels_of(scene, atlas)
    assert set(texels.surfaces.mesh[texels.triangle[:]]) == {0}
    assert texels.area.sum(dtype=float) == pytest.approx(6, rel=1e-6)


def test_pages_are_kept_apart():
    scene = Scene((box("One", (0, 0, 0), (1, 1, 1)), box("Two", (3, 0, 0), (4, 1, 1))), GREY)
    atlas = replace(cell_atlas(scene, 64), page=np.array([0, 1], np.int32), page_count=2)
    texels = texels_of(scene, atlas)
    assert np.array_equal(texels.pixel // 64**2, texels.surfaces.mesh[texels.triangle[:]])
    ids = np.flatnonzero(texels.covered == 15)
    _, weights = texels.footprints.at(ids, np.zeros_like(ids))
    u, v = weights.T
    assert np.array_equal(texels.at(texels.triangle[ids], u, v), ids)


def test_the_texels_do_not_depend_on_the_number_of_threads():
    scene = Scene((sphere("Ball", segments=64, rings=32),), GREY)
    atlas = cell_atlas(scene, 512, margin=1.5)
    one, three = texels_of(scene, atlas, 1), texels_of(scene, atlas, 3)
    for name in ("pixel", "covered", "area", "position", "shading_normal"):
        assert np.array_equal(getattr(one, name), getattr(three, name)), name
    for name in ("seat", "triangle", "weights"):
        assert np.array_equal(getattr(one.footprints, name), getattr(three.footprints, name)), name


def test_leaving_strata_out_shrinks_the_area_and_moves_the_mean():
    scene = Scene((mesh_of("Floor", [quad((0, 0, 0), (1, 0, 0), (0, 1, 0))], [0]),), GREY)
    texels = texels_of(scene, cell_atlas(scene, 16, margin=4))
    whole = np.flatnonzero(texels.covered == 15)[:2]
    inside = np.zeros((texels.count, STRATA), bool)
    inside[whole[0], [1, 3]] = True
    inside[whole[1]] = True
    less = deepcopy(texels).without(inside)
    assert less.area[whole[0]] == pytest.approx(texels.area[whole[0]] / 2)
    assert less.area[whole[1]] == 0
    assert less.valid[whole[0]]
    assert not less.valid[whole[1]]
    assert less.position[whole[0], 0] == pytest.approx(texels.position[whole[0], 0] - 1 / 32, abs=1e-5)
    others = np.setdiff1d(np.arange(texels.count), whole)
    assert np.array_equal(less.position[others], texels.position[others])
    assert np.array_equal(less.area[others], texels.area[others])
    assert less.valid[others].all()
    assert texels.valid.all()
