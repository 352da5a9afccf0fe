# SPDX-License-Identifier: GPL-3.0-or-later
"""Where gather points stand."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.gather.gather_points import place_points
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import rasterize
from radiosity_addon.scene import Material, Scene
from tests.gathering import FAR, NEAR, Blind, far, floor, placed
from tests.shapes import box, cell_atlas, mesh_of, quad, sphere


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
    scene = Scene((sphere("Ball", 0.2, 8, 4),), (Material("Grey"),))
    ball = finish(rasterize(cell_atlas(scene, 96), flatten(scene), 1))
    near = [placed(texels, 0.5, lambda position: np.float32(0.55)).width for texels in (ball, floor())]
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
