# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a smooth surface is cut, filtering shows the same light from both sides."""

import numpy as np
import pytest

from radiosity_addon.atlas.unwrap import Atlas
from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import rasterize
from radiosity_addon.pages.seams import close_seams
from radiosity_addon.scene import Material, Mesh, Scene

SIDES, SIZE, HEIGHT = 48, 128, 2.0


def cylinder(smooth=True):
    """A tube of radius 1 about z, its quads one after the other, and its normals."""
    turn = np.arange(SIDES + 1) * (2 * np.pi / SIDES)
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    ring[-1] = ring[0]
    top = ring + np.array([0, 0, HEIGHT])
    quads = np.stack([ring[:-1], ring[1:], top[1:], top[:-1]], axis=1)
    corners = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
    normals = corners * (1, 1, 0)
    if not smooth:
        normals = np.repeat(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, None], 3, axis=1)
        normals /= np.linalg.norm(normals, axis=2)[..., None]
    index = np.arange(len(corners) * 3, dtype=np.int32).reshape(-1, 3)
    zero = np.zeros(len(corners), np.int32)
    return Mesh("Tube", corners.reshape(-1, 3), index, normals.astype(np.float32), zero, zero, index)


def cut_in_charts(charts):
    """The tube's atlas: `charts` strips above each other, turned and shifted so that texels don't line up."""
    each = SIDES // charts
    uv = []
    for side in range(SIDES):
        chart, x = divmod(side, each)
        low = 4.3 + chart * (SIZE - 8) / charts * 1.003
        tall = (SIZE - 8) / charts - 9.6
        left, right = (5.1 + 2.1 * chart + (x + k) * 100.0 / each for k in (0, 1))
        square = np.array([(left, low), (right, low), (right, low + tall), (left, low + tall)])
        uv += [square[[0, 1, 2]], square[[0, 2, 3]]]
    return Atlas(
        size=SIZE,
        page=np.zeros(1, np.int32),
        page_count=1,
        hidden_page_count=0,
        uv=((np.array(uv) / SIZE).astype(np.float32),),
        chart=(np.repeat(np.arange(SIDES) // each, 2).astype(np.int32),),
        density=np.ones(1),
        fill=np.ones(1),
        warnings=(),
    )


def lit(texels, noise=0.0):
    """A page with light that varies around the tube and along it, and where it is known."""
    x, y, z = texels.position.astype(float).T
    light = 2 + np.sin(5 * np.arctan2(y, x)) + 0.5 * z
    light *= 1 + noise * np.random.default_rng(8).normal(size=len(light))
    pages = np.zeros((SIZE * SIZE, 3), np.float32)
    pages[texels.pixel] = light[:, None] * (1, 0.5, 0.1)
    known = np.zeros(SIZE * SIZE, bool)
    known[texels.pixel] = True
    return pages, known


def bilinear(pages, place):
    place = place - 0.5
    corner = np.floor(place).astype(int)
    x, y = (place - corner).T[..., None]
    at = pages.reshape(SIZE, SIZE, 3).astype(float)
    low, column = corner[:, 1], corner[:, 0]
    return (at[low, column] * (1 - x) + at[low, column + 1] * x) * (1 - y) + (
        at[low + 1, column] * (1 - x) + at[low + 1, column + 1] * x
    ) * y


def both_sides(texels, pages):
    """Filtered values along every cut, from the chart before it and the chart after it; (E, 200, 3)."""
    x0, y0, xu, xv, yu, yv = texels.lookup.astype(float)
    uv = np.stack([x0, y0, x0 + xu, y0 + yu, x0 + xv, y0 + yv], axis=1).reshape(-1, 3, 2)
    quads = uv.reshape(SIDES, 2, 3, 2)
    along = ((np.arange(200) + 0.5) / 200)[:, None]
    found = []
    for side in range(SIDES):
        before, after = quads[side], quads[(side + 1) % SIDES]
        right, left = (before[0, 1], before[0, 2]), (after[0, 0], after[1, 2])
        if np.abs(np.array(right) - left).max() > 0.01:
            found.append([bilinear(pages, a + (b - a) * along) for a, b in (right, left)])
    return np.moveaxis(np.array(found), 1, 0)


def tube(charts, smooth=True):
    scene = Scene((cylinder(smooth),), (Material("Grey"),))
    return finish(rasterize(cut_in_charts(charts), flatten(scene)))


@pytest.mark.parametrize("charts, noise, most", [(1, 0, 1e-3), (1, 0.02, 1e-3), (3, 0, 1e-3), (6, 0, 3e-3)])
def test_both_sides_of_a_cut_show_the_same_light(charts, noise, most):
    texels = tube(charts)
    pages, known = lit(texels, noise)
    before, after = both_sides(texels, pages)
    assert len(before) == charts
    assert np.abs(before - after).max() > 5e-3
    close_seams(pages, known, texels)
    before, after = both_sides(texels, pages)
    assert np.sqrt(np.mean((before - after) ** 2)) / before.mean() < most


def test_only_texels_along_cuts_change_and_those_little():
    texels = tube(3)
    pages, known = lit(texels)
    closed = pages.copy()
    close_seams(closed, known, texels)
    change = np.abs(closed - pages)[texels.pixel].max(1)
    column = texels.pixel % SIZE
    beside = np.zeros(texels.count, bool)
    for chart in range(3):
        for edge in (5.1 + 2.1 * chart, 105.1 + 2.1 * chart):
            beside |= np.abs(column + 0.5 - edge) < 1.01
    assert (change[~beside] == 0).all()
    assert change[beside].max() > 0
    assert change.max() < 0.2


def test_texels_that_the_chart_covers_hardly_change():
    """Those across the edge, which only the seam's filter reads, take what closes it."""
    texels = tube(3)
    pages, known = lit(texels, 0.02)
    closed = pages.copy()
    close_seams(closed, known, texels)
    change = np.abs(closed - pages)[texels.pixel].max(1)
    whole = texels.covered == 15
    assert change[whole].max() < 0.1 * change[~whole].max()


def test_sharp_edges_are_left_as_they_are():
    scene = Scene((cylinder(smooth=False),), (Material("Grey"),))
    atlas = cut_in_charts(3)
    texels = finish(rasterize(atlas, flatten(scene)))
    pages, known = lit(texels)
    angle = np.cos(2 * np.pi / SIDES)
    assert angle > 0.97  # a facet of this tube is as good as smooth: steeper ones are not
    steep = Mesh(**{**vars(scene.meshes[0]), "corner_normals": -scene.meshes[0].corner_normals * alternating()})
    texels = finish(rasterize(atlas, flatten(Scene((steep,), (Material("Grey"),)))))
    closed = pages.copy()
    close_seams(closed, known, texels)
    assert np.array_equal(closed, pages)


def alternating():
    """Signs by which the normals of every second side point inward."""
    return np.repeat(np.where(np.arange(SIDES) % 2, 1, -1), 2)[:, None, None].astype(np.float32)


def test_places_whose_filter_reaches_unknown_pixels_are_left_out():
    texels = tube(3)
    pages, known = lit(texels)
    closed = pages.copy()
    close_seams(closed, np.zeros_like(known), texels)
    assert np.array_equal(closed, pages)


def test_uniform_light_stays_uniform():
    texels = tube(3)
    pages, known = lit(texels)
    pages[known] = 0.7
    close_seams(pages, known, texels)
    assert pages[known] == pytest.approx(0.7, abs=1e-6)


def test_light_never_turns_negative():
    texels = tube(6)
    pages, known = lit(texels)
    pages[texels.pixel] *= (np.random.default_rng(9).random(texels.count) < 0.3)[:, None]
    close_seams(pages, known, texels)
    assert pages.min() >= 0
