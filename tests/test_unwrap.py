# SPDX-License-Identifier: GPL-3.0-or-later
"""Charts and pages: what a lightmap's uv must hold, and what input may not break."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.atlas.cells import lay_cells
from radiosity_addon.atlas.kept_uv import UvMapError
from radiosity_addon.atlas.overlap import overlapping
from radiosity_addon.atlas.packing import Items, fill_page
from radiosity_addon.atlas.unwrap import build_atlas
from radiosity_addon.chunks import finish
from radiosity_addon.errors import SceneError, SettingsError
from radiosity_addon.scene import Material, Mesh, Scene
from radiosity_addon.settings import BakeSettings
from tests.unwrapped import (
    assert_sound,
    atlas_of,
    flat_area,
    make_bevelled_box,
    make_box,
    make_grid,
    make_mesh,
    make_sphere,
    make_tube,
    sampled,
    world_area,
)


def make_star(name="star", height=0.0):
    """One concave polygon of ten corners about its own first corner, flat or not."""
    angle = np.arange(10) * np.pi / 5
    radius = np.where(np.arange(10) % 2, 0.45, 1.0)
    z = height * np.array([0, 1, 0, -1, 0.5, 0, -0.5, 1, 0, 0.3])
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    mesh = make_mesh(name, points, [tuple(range(10))])
    ears = [(9, 0, 1), (1, 2, 3), (3, 4, 5), (5, 6, 7), (7, 8, 9), (9, 1, 3), (9, 3, 5), (9, 5, 7)]
    return replace(mesh, triangles=np.array(ears, np.int32), corner=np.array(ears, np.int32))


def room():
    """A room with furniture: boxes, balls, tubes."""
    random = np.random.default_rng(1)
    meshes = [make_box("room", (6, 5, 2.8))]
    for number in range(18):
        at = random.random(3) * [5, 4, 2]
        meshes.append(make_box(f"box {number}", random.random(3) * [1, 0.8, 1] + 0.1, at))
    meshes += [make_sphere(f"ball {i}", 8, 0.3, random.random(3)) for i in range(3)]
    return [*meshes, make_tube()]


def test_a_room_is_packed_without_overlap_at_one_density_and_fills_its_page():
    meshes = room()
    atlas = atlas_of(meshes, page_size=512)
    assert_sound(atlas, meshes, gap=4)
    assert atlas.page_count == 1
    assert not atlas.warnings
    assert np.ptp(atlas.density) == pytest.approx(0, abs=1e-9)
    assert atlas.fill[0] > 0.6


def test_small_pages_keep_two_texels_between_charts():
    meshes = room()
    assert_sound(atlas_of(meshes, page_size=128), meshes, gap=2)


def test_a_cube_gets_six_squares_at_the_best_density():
    atlas = atlas_of([make_box()], page_size=256)
    assert len(np.unique(atlas.chart[0])) == 6
    assert atlas.density[0] == pytest.approx((256 - 2) / 3 - 2, rel=0.01)  # three squares side by side


def test_charts_are_numbered_through_the_atlas():
    atlas = atlas_of([make_box("a"), make_box("b"), make_grid("hidden", lightmapped=False)], page_size=128)
    used = [set(chart.tolist()) for chart in atlas.chart]
    assert not (used[0] & used[1])
    assert not (used[0] & used[2])
    assert not (used[1] & used[2])
    assert set.union(*used) == set(range(len(set.union(*used))))


def test_density_multiplies_per_object():
    meshes = [make_box("a"), make_box("b", density=2.0), make_sphere("c")]
    meshes[2] = replace(meshes[2], density=0.5)
    atlas = atlas_of(meshes, page_size=512, density=40)
    assert atlas.density == pytest.approx([40, 80, 20], rel=1e-6)
    assert_sound(atlas, meshes, gap=4)


def test_density_takes_as_many_pages_as_needed_with_each_object_on_one():
    meshes = [make_box(f"box {i}", (1, 1, 1)) for i in range(7)]
    atlas = atlas_of(meshes, page_size=128, density=30)
    assert atlas.page_count == 4  # two cubes a page: 12 squares of 32 texels and a gap; three would be 18 of 15
    assert sorted(np.unique(atlas.page, return_counts=True)[1].tolist()) == [1, 2, 2, 2]
    assert_sound(atlas, meshes, gap=2)


def test_a_too_large_object_is_refused_with_the_density_that_fits():
    meshes = [make_box("crate"), make_box("hall", (8, 8, 8)), make_box("shed", (2, 2, 2))]
    with pytest.raises(SettingsError, match="hall does not fit") as refusal:
        atlas_of(meshes, page_size=256, density=64)
    fits = float(re.search(r"largest density that fits is ([\d.]+)", str(refusal.value)).group(1))
    assert fits == pytest.approx(((256 - 2) / 3 - 2) / 8, rel=0.01)
    assert atlas_of(meshes, page_size=256, density=fits).density == pytest.approx(fits)


@pytest.mark.parametrize(
    "mesh",
    [make_tube(), make_bevelled_box(), make_star(), make_star("bent star", 0.4), make_sphere(), make_grid(height=3.0)],
    ids=lambda mesh: mesh.name,
)
def test_polygons_stay_whole(mesh):
    assert_sound(atlas_of([mesh], page_size=256), [mesh], gap=2)


def test_a_bow_tie_stays_one_polygon_without_overlap():
    points = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0.3]])
    mesh = make_mesh("bow tie", points, [(0, 1, 2, 3)])
    assert_sound(atlas_of([mesh], page_size=64), [mesh], gap=2)


def test_no_triangle_of_a_curved_surface_is_stretched_much():
    meshes = [make_sphere(rows=16), make_tube()]
    atlas = atlas_of(meshes, page_size=512)
    for index, mesh in enumerate(meshes):
        local = np.sqrt(flat_area(atlas.uv[index]) / world_area(mesh)) * atlas.size / atlas.density[index]
        assert local.min() > 0.6
        assert local.max() < 1.6


def test_the_same_scene_gives_the_same_atlas():
    first, second = atlas_of(room(), page_size=256), atlas_of(room(), page_size=256)
    assert all(np.array_equal(a, b) for a, b in zip(first.uv, second.uv, strict=True))
    assert all(np.array_equal(a, b) for a, b in zip(first.chart, second.chart, strict=True))


def test_degenerate_triangles_get_a_place_in_their_own_chart():
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0, 0], [2, 2, 2]]
    mesh = make_mesh("torn", points, [(0, 4, 1, 2, 3), (1, 1, 2), (5, 5, 5)])
    atlas = atlas_of([mesh], page_size=64)
    assert_sound(atlas, [mesh], gap=2)
    assert len(np.unique(atlas.chart[0])) == 1
    middle = atlas.uv[0][0, 1]  # the corner half-way along the square's lower edge
    assert middle == pytest.approx((atlas.uv[0][0, 0] + atlas.uv[0][0, 2]) / 2, abs=1e-4)


def test_a_mesh_without_area_gets_no_page_and_a_warning():
    flat = make_mesh("thread", [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [(0, 1, 2)])
    atlas = atlas_of([flat, make_box()], page_size=64)
    assert atlas.page.tolist() == [-1, 0]
    assert "thread" in atlas.warnings[0]


@pytest.mark.parametrize("scale", [1e-8, 1e-3, 1e6])
def test_any_size_is_unwrapped_alike(scale):
    mesh = make_bevelled_box()
    usual, scaled = (atlas_of([replace(mesh, vertices=mesh.vertices * k)], page_size=128) for k in (1.0, scale))
    assert scaled.density[0] * scale == pytest.approx(usual.density[0], rel=0.01)
    assert len(np.unique(scaled.chart[0])) == len(np.unique(usual.chart[0]))


def test_far_from_the_origin_is_unwrapped_alike():
    mesh = make_bevelled_box()
    near = atlas_of([mesh], page_size=128)
    far = atlas_of([replace(mesh, vertices=mesh.vertices + np.array([1e6, -2e6, 1e6]))], page_size=128)
    assert far.density[0] == pytest.approx(near.density[0], rel=0.01)


def test_tiny_faces_of_a_large_mesh_are_kept():
    big, small = make_grid(cells=2, size=100.0), make_box(size=(1e-3, 1e-3, 1e-3), at=(5, 5, 5))
    mesh = Mesh(
        name="both",
        vertices=np.concatenate([big.vertices, small.vertices]),
        triangles=np.concatenate([big.triangles, small.triangles + len(big.vertices)]).astype(np.int32),
        corner_normals=np.concatenate([big.corner_normals, small.corner_normals]),
        material=np.concatenate([big.material, small.material]),
        polygon=np.concatenate([big.polygon, small.polygon + 4]).astype(np.int32),
        corner=np.concatenate([big.corner, small.corner + 16]).astype(np.int32),
    )
    atlas = atlas_of([mesh], page_size=256)
    flat = flat_area(atlas.uv[0]) * atlas.size**2 / atlas.density[0] ** 2
    assert flat[-12:] == pytest.approx(0.5e-6, rel=0.2)


def test_duplicate_faces_get_places_of_their_own():
    mesh = make_mesh("twice", make_box().vertices, [(0, 1, 3, 2), (0, 1, 3, 2), (3, 1, 0, 2), (2, 0, 1, 3)])
    assert_sound(atlas_of([mesh], page_size=64), [mesh], gap=2)


def test_non_manifold_edges_are_unwrapped():
    points = [[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0, 1], [-1, 1, 0], [-1, 1, 1], [-1, -1, 0], [-1, -1, 1]]
    mesh = make_mesh("fan", points, [(0, 2, 3, 1), (0, 4, 5, 1), (0, 6, 7, 1)])
    assert_sound(atlas_of([mesh], page_size=64), [mesh], gap=2)


def test_slivers_are_unwrapped():
    fan = [[np.cos(a), np.sin(a), 0] for a in np.linspace(0, 0.02, 200)]
    mesh = make_mesh("fan", [[0, 0, 0], *fan], [(0, i, i + 1) for i in range(1, 200)])
    assert_sound(atlas_of([mesh], page_size=64), [mesh], gap=2)


def test_vertices_that_are_not_finite_are_refused_by_name():
    mesh = make_box("torn")
    mesh.vertices[3] = np.nan
    with pytest.raises(SceneError, match="torn"):
        atlas_of([mesh])


@pytest.mark.parametrize("multiplier", [0.0, -1.0, np.nan])
def test_a_multiplier_that_is_not_positive_is_refused_by_name(multiplier):
    with pytest.raises(SceneError, match="crate: its density multiplier"):
        atlas_of([make_box("crate", density=multiplier)])


def test_an_existing_map_is_kept_as_a_whole():
    grid = make_grid("floor", 4, size=2.0)
    uv = (grid.vertices[grid.triangles][..., :2] / 4 + [0.1, 0.3]).astype(np.float32)
    meshes = [replace(grid, uv=uv), make_box()]
    atlas = atlas_of(meshes, page_size=256)
    assert_sound(atlas, meshes, gap=2)
    old, new = (part.astype(np.float64) - part[0, 0] for part in (uv, atlas.uv[0]))
    ratio = np.linalg.norm(new, axis=2).max() / np.linalg.norm(old, axis=2).max()
    turn = np.round(np.linalg.lstsq(old.reshape(-1, 2), new.reshape(-1, 2) / ratio, rcond=None)[0], 4)
    assert np.abs(turn).sum() == pytest.approx(2)
    assert np.linalg.det(turn) == pytest.approx(1)
    assert new == pytest.approx(old @ turn * ratio, abs=1e-5)
    assert atlas.density[0] == pytest.approx(atlas.density[1], rel=1e-6)


def test_charts_of_an_existing_map_stay_apart_by_their_own_gap():
    box = make_box()
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]]).reshape(2, 3, 2) * 0.2
    uv = np.concatenate([square + np.array([0.3 * (i % 3) + 0.05, 0.5 * (i // 3) + 0.1]) for i in range(6)]).astype(
        np.float32
    )
    atlas = atlas_of([replace(box, uv=uv)], page_size=256)
    assert len(np.unique(atlas.chart[0])) == 6
    assert np.ptp(atlas.uv[0][..., 0]) * 256 <= 256 - 2
    across = np.sort(np.ptp(atlas.uv[0].reshape(-1, 2), axis=0)) / np.sort(np.ptp(uv.reshape(-1, 2), axis=0))
    assert across[0] == pytest.approx(across[1], rel=1e-4)


@pytest.mark.parametrize(
    ("change", "cause", "polygons"),
    [
        (lambda uv: uv + np.array([0.7, 0.0]), "leaves the square", [2, 3, 6, 7, 10, 11, 14, 15]),
        (
            lambda uv: np.where(np.arange(32)[:, None, None] < 2, uv[2:4].repeat(16, 0), uv),
            "lie on one another",
            [0, 1],
        ),
        (lambda uv: np.where(np.arange(32)[:, None, None] == 5, 0.5, uv), "no area", [2]),
    ],
)
def test_an_unusable_map_is_refused_with_its_polygons(change, cause, polygons):
    grid = make_grid("floor", 4)
    uv = (grid.vertices[grid.triangles][..., :2] * 0.5).astype(np.float32)
    with pytest.raises(UvMapError, match=f"floor: its uv map .*{cause}") as refusal:
        atlas_of([replace(grid, uv=change(uv).astype(np.float32))])
    assert refusal.value.polygons.tolist() == polygons


def test_hidden_meshes_follow_the_real_pages_with_a_cell_for_each_triangle():
    meshes = [make_box(), make_sphere("ghost"), make_grid("floor", 8)]
    meshes[1:] = [replace(mesh, lightmapped=False) for mesh in meshes[1:]]
    atlas = atlas_of(meshes, page_size=256)
    assert atlas.page_count == 1
    assert atlas.hidden_page_count == 1
    assert atlas.page.tolist() == [0, 1, 1]
    assert 0.3 * atlas.density[0] > atlas.density[1] > 0.05 * atlas.density[0]
    assert sampled(atlas, 1)[1] == 0
    for index in (1, 2):
        assert (flat_area(atlas.uv[index]) > 0).all()
        assert len(np.unique(atlas.chart[index])) == len(meshes[index].triangles)


@pytest.mark.parametrize("cells", [20, 40, 120])
def test_hidden_meshes_of_many_triangles_share_texels_on_one_page(cells):
    mesh = make_grid("crowd", cells)
    (place,) = lay_cells([mesh], 1000.0, 100)
    assert place.page == 0
    assert place.uv.min() >= 0
    assert place.uv.max() <= 0.64
    texel = np.floor(place.uv.mean(axis=1) * 100).astype(int)
    used = len(np.unique(texel, axis=0))
    assert used == min(len(mesh.triangles), -(-len(mesh.triangles) // -(-len(mesh.triangles) // 64**2)))


def test_hidden_meshes_alone_need_no_real_page():
    atlas = atlas_of([replace(make_box(), lightmapped=False)], page_size=64)
    assert (atlas.page_count, atlas.hidden_page_count, atlas.page.tolist()) == (0, 1, [0])


def test_an_empty_scene_has_no_page():
    atlas = atlas_of([make_mesh("empty", np.zeros((0, 3)), [])])
    assert (atlas.page_count, atlas.hidden_page_count, atlas.page.tolist()) == (0, 0, [-1])


def test_progress_rises():
    steps = build_atlas(Scene(tuple(room()), (Material("grey"),)), BakeSettings(page_size=256))
    shares = list(steps)
    assert shares == sorted(shares)
    assert shares[0] >= 0
    assert shares[-1] <= 1
    assert len(shares) > 10


def test_more_charts_than_a_page_holds_is_a_clear_error():
    meshes = [make_box(f"box {i}") for i in range(60)]
    with pytest.raises(SettingsError, match="360 charts don't fit on one page of 16 texels"):
        atlas_of(meshes, page_size=16)


def test_overlaps_are_found_and_neighbours_are_not():
    square = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], float)
    group = np.zeros(2, np.int64)
    assert len(overlapping(square, group)) == 0
    assert overlapping(square + np.array([[[0, 0]], [[0.1, -0.1]]]), group).tolist() == [[0, 1]]
    assert len(overlapping(np.concatenate([square, square]), np.array([0, 0, 1, 1]))) == 0
    assert len(overlapping(np.concatenate([square, square[:, ::-1]]), np.zeros(4, np.int64))) > 0


def test_items_are_turned_to_fit():
    bars = np.array([[[0, 0], [60, 0], [60, 10]], [[0, 0], [60, 10], [0, 10]]], float)
    tall = bars[..., ::-1][:, ::-1]
    items = Items(np.concatenate([bars, tall] * 3), np.arange(0, 13, 2))
    placement = finish(fill_page(items, 64, 2))
    assert placement is not None
    assert placement.scale == pytest.approx((64 / 6 - 2) / 10, rel=0.01)
    assert len(np.unique((placement.turn + [0, 1] * 3) % 2)) == 1
