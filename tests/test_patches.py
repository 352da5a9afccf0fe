# SPDX-License-Identifier: GPL-3.0-or-later
"""Patches part the texels, sides included, and what rays meet is found by one look-up."""

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import rasterize
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.geometry.walls import Walls
from radiosity_addon.radiosity.patches import NOTHING, SKY, group_patches, mixed_radix
from radiosity_addon.scene import Material, Scene
from tests.shapes import box, cell_atlas, furnished_room, mesh_of, quad, sphere

GREY = (Material("Grey"),)


def texels_of(scene, size=200, margin=2.3):
    return finish(rasterize(cell_atlas(scene, size, margin), flatten(scene)))


def grouped(texels, target=300, solid=False):
    """Patches whose reflectance is the texel's height, and without emission."""
    height = np.repeat(texels.position[:, 2:], 3, axis=1)
    solid = np.broadcast_to(solid, texels.surfaces.count)
    visibility = Visibility(texels.surfaces.corners)
    walls = Walls(
        np.zeros(texels.count, bool), np.zeros(0, np.int32), np.zeros((0, 4, 4), np.float32), np.zeros((2, 0), np.int32)
    )
    return group_patches(texels, walls, height, np.zeros_like(height), solid, target, visibility)


def hits_of(texels, origins, directions):
    return Visibility(texels.surfaces.corners).first_hit(
        np.array(origins, np.float32) - texels.surfaces.origin.astype(np.float32), np.array(directions, np.float32)
    )


def test_every_texel_with_area_is_in_one_front_patch_and_no_patch_is_empty():
    texels = texels_of(furnished_room())
    patches = grouped(texels, solid=True)
    front = patches.of_element[: texels.count]
    assert (front[texels.area > 0] >= 0).all()
    assert set(front[front >= 0]) == set(range(patches.count))
    assert (patches.sides == 1).all()


def test_patch_areas_sum_to_the_surfaces():
    texels = texels_of(furnished_room())
    patches = grouped(texels, solid=True)
    assert patches.area.sum() == pytest.approx(texels.surfaces.area.sum(), rel=1e-6)
    assert (patches.area > 0).all()


def test_values_are_means_weighted_by_area():
    texels = texels_of(furnished_room())
    patches = grouped(texels, solid=True)
    front = patches.of_element[: texels.count]
    for patch in (0, patches.count // 2, patches.count - 1):
        own = (front == patch) & (texels.area > 0)
        wanted = np.average(texels.position[own, 2].astype(float), weights=texels.area[own])
        assert patches.reflectance[patch] == pytest.approx(wanted, abs=1e-5)
    assert patches.mean(texels.position)[:, 2] == pytest.approx(patches.reflectance[:, 0], abs=1e-5)
    per_group = patches.mean(np.stack([texels.position, 2 * texels.position], axis=1))
    assert per_group[:, 1] == pytest.approx(2 * per_group[:, 0])


@pytest.mark.parametrize("scene", [furnished_room(), Scene((sphere("Ball", radius=3),), GREY)])
@pytest.mark.parametrize("target", [50, 2000])
def test_no_two_distant_texels_share_a_patch(scene, target):
    texels = texels_of(scene, 400, margin=1.5)
    patches = grouped(texels, target, solid=True)
    width = np.sqrt(texels.area.sum() / target)
    front = patches.of_element[: texels.count]
    own = np.flatnonzero((front >= 0) & (texels.area > 0))
    for axis in range(3):
        low, high = np.full(patches.count, np.inf), np.full(patches.count, -np.inf)
        np.minimum.at(low, front[own], texels.position[own, axis])
        np.maximum.at(high, front[own], texels.position[own, axis])
        assert (high - low).max() <= width * 1.0001


def test_patches_keep_to_one_facing_one_material_and_one_connected_part():
    texels = texels_of(furnished_room(), 400)
    patches = grouped(texels, 100, solid=True)
    front = patches.of_element[: texels.count]
    own = np.flatnonzero((front >= 0) & (texels.area > 0))
    first = np.full(patches.count, -1)
    first[front[own][::-1]] = own[::-1]
    triangle, other = texels.triangle[own], texels.triangle[first[front[own]]]
    surfaces = texels.surfaces
    for values in (surfaces.material, surfaces.component):
        assert np.array_equal(values[triangle], values[other])
    assert np.einsum("ij,ij->i", surfaces.normal[triangle], surfaces.normal[other]).min() > 0.99


def test_about_as_many_patches_come_as_are_asked_for():
    texels = texels_of(furnished_room(), 400)
    assert 1000 < grouped(texels, 1000, solid=True).count < 3500


def test_only_what_is_no_solid_has_backs():
    room = Scene(
        (box("Block", (0, 0, 0), (1, 1, 1)), mesh_of("Sheet", [quad((3, 0, 0), (1, 0, 0), (0, 1, 0))], [0])), GREY
    )
    texels = texels_of(room)
    patches = grouped(texels, solid=texels.surfaces.mesh == 0)
    sheet = texels.surfaces.mesh[texels.triangle[:]] == 1
    assert (patches.back[~sheet] == NOTHING).all()
    behind = patches.back[sheet & (texels.area > 0)]
    assert (patches.sides[behind] == -1).all()
    assert patches.area[patches.sides < 0].sum() == pytest.approx(1, rel=1e-6)
    assert (patches.sides < 0).sum() < (patches.of_element[: texels.count][sheet].max() + 1)


def test_rays_find_the_side_that_they_meet():
    sheet = Scene((mesh_of("Sheet", [quad((0, 0, 0), (1, 0, 0), (0, 1, 0))], [0]),), GREY)
    texels = texels_of(sheet, 64)
    place = [(0.3, 0.6, 1), (0.3, 0.6, -1), (0.3, 0.6, 1)]
    hits = hits_of(texels, place, [(0, 0, -1), (0, 0, 1), (0, 0, 1)])
    open_sheet = grouped(texels, 10)
    front, back, sky = open_sheet.at(hits)
    assert sky == SKY
    assert open_sheet.sides[front] == 1
    assert open_sheet.sides[back] == -1
    element = open_sheet.elements(hits)
    assert element[1] == texels.count + back
    assert np.abs(texels.position[element[0], :2] + 0.5 - (0.3, 0.6)).max() < 1 / 58
    assert list(grouped(texels, 10, solid=True).at(hits))[1:] == [NOTHING, SKY]


def test_invalid_texels_take_no_part():
    texels = texels_of(furnished_room())
    low = texels.position[:, 0] < texels.position[:, 0].mean()
    patches = grouped(replace(texels, valid=~low), solid=True)
    assert (patches.of_element[: texels.count][low] == NOTHING).all()
    assert patches.area.sum() == pytest.approx(texels.area[~low].sum(dtype=float), rel=1e-5)


def test_texels_beside_charts_belong_to_the_patch_next_to_them():
    texels = texels_of(furnished_room())
    patches = grouped(texels, solid=True)
    beside = np.flatnonzero(texels.area == 0)
    assert len(beside)
    front = patches.of_element[: texels.count]
    assert (front[beside] >= 0).all()
    assert np.array_equal(
        texels.surfaces.mesh[texels.triangle[beside]],
        texels.surfaces.mesh[texels.triangle[np.unique(front, return_index=True)[1]]][front[beside]],
    )


def test_origins_spread_over_the_patch_and_stand_on_its_side():
    sheet = Scene((mesh_of("Sheet", [quad((0, 0, 0), (4, 0, 0), (0, 4, 0))], [0]),), GREY)
    texels = texels_of(sheet, 128)
    patches = grouped(texels, 16)
    count = 512
    for patch in (0, 5, patches.count - 1):
        points, normals = patches.origins(np.full(count, patch), np.arange(count))
        side = patches.sides[patch]
        assert normals[:, 2] == pytest.approx(side)
        assert points[:, 2] * side == pytest.approx(texels.surfaces.offset, rel=0.2)
        of_texel = patches.of_element[: texels.count] if side > 0 else patches.back
        own = (of_texel == patch) & (texels.area > 0)
        centre = np.average(texels.position[own].astype(float), axis=0, weights=texels.area[own])
        width = np.ptp(texels.position[own], axis=0).max()
        assert np.abs(points.mean(0) - centre)[:2].max() < 0.03 * width
        assert np.ptp(points, axis=0)[:2].max() == pytest.approx(width, rel=0.1)


def test_numbers_of_tuples_collide_only_where_all_parts_are_equal():
    rng = np.random.default_rng(4)
    parts = [rng.integers(low, high, 5000).astype(np.int32) for low, high in ((-300, 4), (0, 7), (-2, 40_000), (5, 6))]
    key = mixed_radix(*parts)
    assert len(np.unique(key)) == len(np.unique(np.stack(parts), axis=1).T)


def test_coordinates_far_from_the_origin_do_not_wrap():
    big = np.array([2_000_000_000, -2_000_000_000, 2_000_000_000], np.int32)
    small = np.array([0, 0, 1], np.int32)
    assert len(np.unique(mixed_radix(big, small))) == 3


def test_no_patch_lies_on_both_sides_of_a_folded_sheet():
    """Of a closed sheet in folds of 10 cm the front of one flank faces as the back of the next one."""
    folds = 0.05 * np.arange(13)
    across = np.where(np.arange(13) % 2, 0.1, 0.0)
    thin = 0.003
    quads = []
    for k in range(12):
        low, step = (folds[k], across[k], 0), (0.05, across[k + 1] - across[k], 0)
        quads += [quad(low, step, (0, 0, 0.6)), quad((low[0], low[1] + thin, 0), (0, 0, 0.6), step)]
    sheet = Scene((mesh_of("Sheet", quads, np.zeros(24)),), GREY)
    texels = texels_of(sheet, 400)
    patches = grouped(replace(texels, surfaces=joined_up(texels.surfaces)), 40, solid=True)
    behind = texels.triangle[:] // 2 % 2
    front = patches.of_element[: texels.count]
    own = (front >= 0) & (texels.area > 0)
    areas = [
        np.bincount(front[own & (behind == side)], texels.area[own & (behind == side)], patches.count)
        for side in (0, 1)
    ]
    assert np.minimum(*areas).sum() < 0.1 * sum(areas).sum()  # 0.49 of it where cells have no layers


def joined_up(surfaces):
    """The same triangles as one connected surface."""
    return replace(surfaces, component=np.zeros_like(surfaces.component))
