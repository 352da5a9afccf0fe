# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages are full, hold H / pi, and keep what was computed."""

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import rasterize
from radiosity_addon.pages.lightmap import compose, push_pull, show_fronts
from radiosity_addon.scene import Material, Scene
from tests.shapes import cell_atlas, furnished_room, mesh_of, quad

GREY = (Material("Grey"),)


def texels_of(scene, size, margin=3, **changes):
    return finish(rasterize(replace(cell_atlas(scene, size, margin), **changes), flatten(scene)))


@pytest.mark.parametrize("shape", [(16, 16), (13, 7), (1, 9)])
def test_push_pull_fills_everything_and_keeps_what_is_known(shape):
    rng = np.random.default_rng(6)
    known = rng.random(shape) < 0.1
    known[0, 0] = True
    image = rng.random((*shape, 3)).astype(np.float32) + 1
    filled = np.where(known[..., None], image, np.nan).astype(np.float32)
    push_pull(filled, known)
    assert np.array_equal(filled[known], image[known])
    assert np.isfinite(filled).all()
    assert filled.min() >= image[known].min()
    assert filled.max() <= image[known].max() + 1e-6


def test_push_pull_spreads_one_value_over_the_whole_page():
    image = np.zeros((9, 20, 3), np.float32)
    image[3, 4] = (1, 2, 3)
    known = np.zeros((9, 20), bool)
    known[3, 4] = True
    push_pull(image, known)
    assert (image == np.float32((1, 2, 3))).all()


def test_push_pull_leaves_pages_without_light_alone():
    image = np.zeros((4, 4, 3), np.float32)
    push_pull(image, np.zeros((4, 4), bool))
    assert not image.any()


def test_texels_hold_irradiance_over_pi_and_light_groups_add_up():
    texels = texels_of(furnished_room(), 96)
    rng = np.random.default_rng(7)
    irradiance = rng.random((texels.count, 3, 3)).astype(np.float32)
    (page,) = compose(texels, irradiance, 1)
    assert page.dtype == np.float32
    assert page.reshape(-1, 3)[texels.pixel] == pytest.approx(irradiance.sum(1) / np.pi, rel=1e-5)


def test_pages_are_full():
    texels = texels_of(furnished_room(), 96)
    (page,) = compose(texels, np.full((texels.count, 1, 3), 2 * np.pi, np.float32), 1)
    assert page == pytest.approx(2, rel=1e-5)


def test_invalid_texels_take_the_light_of_those_beside():
    scene = Scene((mesh_of("Floor", [quad((0, 0, 0), (1, 0, 0), (0, 1, 0))], [0]),), GREY)
    texels = texels_of(scene, 32)
    valid = np.ones(texels.count, bool)
    middle = np.abs(texels.position[:, :2]).max(1) < 0.1
    valid[middle] = False
    light = np.where(valid, np.pi, 1e6).astype(np.float32)
    (page,) = compose(replace(texels, valid=valid), np.repeat(light[:, None, None], 3, axis=2), 1)
    assert middle.any()
    assert page == pytest.approx(1, rel=1e-5)


def test_gutters_repeat_the_nearest_chart():
    scene = Scene((mesh_of("Two", [quad((k, 0, 0), (1, 0, 0), (0, 1, 0)) for k in (0, 5)], [0, 0]),), GREY)
    texels = texels_of(scene, 64, margin=6)
    left = texels.triangle[:] < 2
    light = np.where(left, 1, 9).astype(np.float32) * np.float32(np.pi)
    (page,) = compose(texels, np.repeat(light[:, None, None], 3, axis=2), 1)
    # cells are 32 wide and charts begin 6 in: charts and their footprints end at 27 and begin at 37
    assert page[16, 20:31, 0] == pytest.approx(1)
    assert page[16, 33:44, 0] == pytest.approx(9)


def test_texels_at_the_back_of_a_sheet_hold_the_light_at_its_front():
    light = np.repeat(np.float32([4, 8, 1, 9])[:, None, None], 3, axis=2)
    show_fronts(light, np.array([[2, 2], [0, 1]], np.int32))
    assert light[:, 0, 0] == pytest.approx([4, 8, 6, 9])
    show_fronts(light, np.array([[3], [0]], np.int32))
    assert light[3, 0, 0] == 9, "it is the brighter side"


def test_hidden_pages_are_not_written():
    room = furnished_room()
    texels = texels_of(room, 96, page=np.array([0, 1, 0], np.int32), page_count=1, hidden_page_count=1)
    pages = compose(texels, np.ones((texels.count, 1, 3), np.float32), 1)
    assert len(pages) == 1
    assert pages[0].shape == (96, 96, 3)
