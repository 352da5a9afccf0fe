# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes that share an unwrap: one layout, a place for each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from radiosity_addon.errors import SettingsError
from tests.unwrapped import (
    assert_sound,
    atlas_of,
    flat_area,
    make_bevelled_box,
    make_box,
    make_grid,
    make_sphere,
)


def member(mesh, number, scale=1.0, mirrored=False, shape=0, **more):
    """A copy of the mesh elsewhere, as an object that shares its data would be read."""
    vertices = mesh.vertices * scale * ([-1, 1, 1] if mirrored else [1, 1, 1]) + [2 * number, 0, 0]
    order = [0, 2, 1] if mirrored else [0, 1, 2]
    triangles, corner = (np.ascontiguousarray(part[:, order]) for part in (mesh.triangles, mesh.corner))
    name = f"{mesh.name} {number}"
    return replace(mesh, name=name, vertices=vertices, triangles=triangles, corner=corner, shape=shape, **more)


def unmirrored(atlas, meshes):
    """Atlas and meshes with all triangles wound as their charts are."""
    turned = [(flat_area(uv) < 0).all() for uv in atlas.uv]
    order = [[0, 2, 1] if turn else [0, 1, 2] for turn in turned]
    uv = tuple(uv[:, way] for uv, way in zip(atlas.uv, order, strict=True))
    corner = [replace(mesh, corner=mesh.corner[:, way]) for mesh, way in zip(meshes, order, strict=True)]
    return replace(atlas, uv=uv), corner


BASES = (make_box(), make_bevelled_box(), make_sphere(), make_grid(cells=3))


@settings(max_examples=6, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(
    st.lists(
        st.tuples(st.integers(0, len(BASES) - 1), st.floats(0.6, 1.8), st.booleans(), st.booleans()),
        min_size=2,
        max_size=7,
    ),
    st.sampled_from([None, 12.0]),
)
def test_members_never_overlap_and_keep_their_distance(drawn, density):
    meshes = [
        member(BASES[base], number, scale, mirrored, base if shared else None)
        for number, (base, scale, mirrored, shared) in enumerate(drawn)
    ]
    atlas = atlas_of(meshes, page_size=128, density=density)
    assert_sound(*unmirrored(atlas, meshes), gap=0.95 * 2)


def test_a_members_uv_are_the_shared_ones_scaled_and_shifted():
    meshes = [member(make_bevelled_box(), k, 1 + k / 5, k % 2 == 1) for k in range(5)]
    atlas = atlas_of(meshes, page_size=256)
    assert list(atlas.layouts) == [0]
    assert sorted(atlas.places) == [0, 1, 2, 3, 4]
    for index, mesh in enumerate(meshes):
        scale, *shift = atlas.places[index]
        expected = atlas.layouts[0].astype(float)[mesh.corner] * scale + shift
        np.testing.assert_allclose(atlas.uv[index], expected, atol=1e-6)
    assert atlas.layouts[0].max() == 1


def test_a_layout_covers_the_square_from_0_to_1_in_its_longer_direction():
    atlas = atlas_of([member(make_grid(cells=2), k) for k in range(3)], page_size=128)
    assert atlas.layouts[0].min() == 0
    assert atlas.layouts[0].max() == 1


def test_members_get_texels_as_they_are_large_in_the_world_but_at_least_half_the_mean():
    sizes = [1.0, 1.0, 1.0, 2.0, 0.1]
    meshes = [member(make_box(), k, size) for k, size in enumerate(sizes)]
    atlas = atlas_of(meshes, page_size=256)
    scales = np.array([atlas.places[index][0] for index in range(5)])
    np.testing.assert_allclose(scales / scales[0], [1, 1, 1, 2, np.mean(sizes) / 2], rtol=1e-6)
    np.testing.assert_allclose(atlas.density[:4], atlas.density[0], rtol=1e-6)


def test_an_objects_density_multiplies_its_place():
    meshes = [member(make_box(), k, density=1.5 if k else 1.0) for k in range(4)]
    atlas = atlas_of(meshes, page_size=256)
    assert atlas.places[1][0] / atlas.places[0][0] == pytest.approx(1.5)


def test_a_mesh_of_a_shape_that_no_other_has_is_packed_as_ever():
    room = [make_box(), make_sphere(at=(3, 0, 0))]
    one = [room[0], replace(room[1], shape=3)]
    for uv, expected in zip(atlas_of(one, page_size=256).uv, atlas_of(room, page_size=256).uv, strict=True):
        assert np.array_equal(uv, expected)


def test_two_alike_do_not_waste_half_of_a_page():
    """Two squares would; so a block's width follows the number of its copies."""
    alone = [member(make_bevelled_box(), k, shape=None) for k in range(2)]
    shared = [replace(mesh, shape=0) for mesh in alone]
    assert atlas_of(shared, page_size=512).density[0] > 0.85 * atlas_of(alone, page_size=512).density[0]


def test_faces_that_a_member_lacks_leave_the_others_in_place():
    """Objects under a shear lose triangles that have no area in the world."""
    whole = make_bevelled_box()
    less = replace(whole, **{name: getattr(whole, name)[:-5] for name in TRIANGLES})
    meshes = [member(less, 0), member(whole, 1), member(less, 2)]
    atlas = atlas_of(meshes, page_size=256)
    assert_sound(atlas, meshes, gap=0.95 * 2)
    scale, *shift = atlas.places[2]
    np.testing.assert_allclose(atlas.uv[2], atlas.layouts[0][less.corner] * scale + shift, atol=1e-6)


TRIANGLES = ("triangles", "corner_normals", "material", "polygon", "corner")


def test_a_kept_map_is_the_familys_layout():
    grid = make_grid(cells=2)
    uv = grid.vertices[grid.triangles][..., :2].astype(np.float32) * 0.4 + 0.5
    meshes = [member(replace(grid, uv=uv), k, 1 + k) for k in range(2)]
    atlas = atlas_of(meshes, page_size=128)
    layout = atlas.layouts[0][grid.corner]
    np.testing.assert_allclose(layout, (uv - uv.min((0, 1))) / np.ptp(uv), atol=1e-6)


def test_members_that_get_no_lightmap_are_no_part_of_the_family():
    meshes = [member(make_box(), k, lightmapped=k > 0) for k in range(3)]
    atlas = atlas_of(meshes, page_size=128)
    assert sorted(atlas.places) == [1, 2]
    assert atlas.page[0] == atlas.page_count


def test_a_family_spreads_over_pages_at_a_density():
    meshes = [member(make_box(), k) for k in range(12)]
    atlas = atlas_of(meshes, page_size=128, density=16.0)
    assert atlas.page_count > 1
    assert set(atlas.page) == set(range(atlas.page_count))
    assert_sound(atlas, meshes, gap=2)


def test_a_thousand_members_fill_a_page_at_the_common_distance():
    meshes = [member(make_box(), k) for k in range(1000)]
    atlas = atlas_of(meshes, page_size=1024)
    scale = atlas.places[0][0] * 1024
    spots = np.array([atlas.places[index][1:] for index in range(1000)]) * 1024
    extent = scale * atlas.layouts[0].max(axis=0)
    apart = np.abs(spots[:, None] - spots[None]) - extent
    nearest = apart.max(axis=2)[~np.eye(1000, dtype=bool)].min()
    assert nearest >= 4 - 1e-3
    assert len(meshes) * np.prod(extent + 4) > 0.8 * 1024**2


def test_a_block_is_no_longer_than_a_page():
    """Five copies would fill a square best as bars, which at this density only a larger page could hold."""
    atlas = atlas_of([member(make_box(), k) for k in range(5)], page_size=64, density=18.0)
    assert atlas.page_count == 5


def test_too_many_charts_for_a_page_are_refused():
    with pytest.raises(SettingsError, match="charts don't fit on one page of 64 texels"):
        atlas_of([member(make_box(), k) for k in range(500)], page_size=64)


@pytest.mark.parametrize("density", [None, 12.0])
def test_page_groups_never_share_a_page_and_each_fills_its_own(density):
    box = make_box()
    meshes = [
        replace(mesh, page_group=group)
        for group, mesh in [
            ("", make_sphere()),
            ("props", member(box, 1, shape=0)),
            ("", make_grid(cells=3)),
            ("props", member(box, 2, 1.5, shape=0)),
            ("hero", make_bevelled_box()),
        ]
    ]
    atlas = atlas_of(meshes, page_size=128, density=density)
    assert atlas.page_count == 3
    assert atlas.page[[0, 1, 4]].tolist() == [0, 2, 1], "in the order of their names, the nameless group first"
    assert (atlas.page[2], atlas.page[3]) == (atlas.page[0], atlas.page[1])
    assert_sound(*unmirrored(atlas, meshes), gap=2)
    if density is None:
        alone = atlas_of([meshes[4]], page_size=128)
        np.testing.assert_array_equal(atlas.uv[4], alone.uv[0])
