# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of meshes on flat surfaces, known at few points: the same as each texel would ask for."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from radiosity_addon.arrays import Float32
from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import Texels, rasterize
from radiosity_addon.lighting.flat_cells import FlatCells, Rectangles
from radiosity_addon.lighting.lights import lamps_of
from radiosity_addon.lighting.mesh_lamp import MeshLamp
from radiosity_addon.lighting.sparse_light import FINE, LEAST, light_of_meshes
from radiosity_addon.scene import Material, Mesh, Scene
from tests.lamps import GREY, WHITE
from tests.shapes import box, cell_atlas, mesh_of, quad


def screen(height: float, cuts: int = 12) -> Mesh:
    """A level square of 1 m, of many quads, over the middle of the floor."""
    step = 1 / cuts
    low = [(2.5 + step * i, 2.5 + step * j, height) for j in range(cuts) for i in range(cuts)]
    return mesh_of("Screen", [quad(corner, (step, 0, 0), (0, step, 0)) for corner in low], np.zeros(cuts**2))


@cache
def ground(height: float) -> tuple[Texels, MeshLamp]:
    """Texels of a floor, a wall and a turned box, and a screen over them that is not among them."""
    floor = mesh_of("Floor", [quad((0, 0, 0), (6, 0, 0), (0, 6, 0))], [1])
    wall = mesh_of("Wall", [quad((0, 6, 0), (6, 0, 0), (0, 0, 6))], [1])
    lit = (floor, wall, box("Box", (0.5, 1, 0), (1.5, 2, 1), 1))
    materials = (Material("Glow", emission=WHITE), GREY)
    alone = flatten(Scene(lit, materials))
    scene = Scene((*lit, screen(height)), materials)
    surfaces = flatten(scene)
    assert np.array_equal(surfaces.origin, alone.origin)
    (lamp,) = lamps_of(scene.moved(-surfaces.origin), surfaces).lamps
    assert isinstance(lamp, MeshLamp)
    return finish(rasterize(cell_atlas(Scene(lit, materials), 384), alone)), lamp


def sparse(height: float, workers: int = 1) -> Float32:
    texels, lamp = ground(height)
    light = np.full((1, texels.count), np.nan, np.float32)
    finish(light_of_meshes([lamp], texels, light, workers))
    return light[0]


@pytest.mark.parametrize("height", [0.05, 1.5, 5.0])
def test_light_on_planes_is_what_each_texel_would_ask_for(height: float) -> None:
    texels, lamp = ground(height)
    expected = lamp.light(texels.position, texels.shading_normal, None)
    found = sparse(height)
    assert np.abs(found - expected).max() < 5e-3 * expected.max()
    lit = expected > 0.01 * expected.max()
    assert np.abs(found / np.where(lit, expected, 1) - 1)[lit].max() < 0.02
    assert np.sqrt(np.mean((found / np.where(lit, expected, 1) - 1)[lit] ** 2)) < 2e-3


def test_a_lamp_may_be_asked_for_nowhere() -> None:
    """As where no rectangle is clear of it."""
    _, lamp = ground(1.5)
    nowhere = np.zeros((0, 3), np.float32)
    assert lamp.light(nowhere, nowhere, None).shape == (0,)


def test_few_points_are_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    texels, _ = ground(1.5)
    asked = []
    ask = MeshLamp.in_channels
    monkeypatch.setattr(
        MeshLamp, "in_channels", lambda self, c, p, *more: asked.append(len(p)) or ask(self, c, p, *more)
    )
    sparse(1.5)
    assert sum(asked) < 0.2 * texels.count


def test_what_a_plane_does_not_see_is_dark() -> None:
    """The top of the box is above the screen, which faces up and down."""
    texels, _ = ground(0.05)
    height = texels.position[:, 2] - texels.position[:, 2].min()
    top = (np.abs(height - 1) < 1e-3) & (texels.shading_normal[:, 2] > 0.5)
    assert top.any()
    assert not sparse(0.05)[top].any()


def test_light_does_not_depend_on_the_number_of_threads() -> None:
    assert np.array_equal(sparse(1.5, 1), sparse(1.5, 3))


def test_each_flat_texel_lies_in_one_rectangle_and_within_its_edges_however_often_they_are_halved() -> None:
    texels, _ = ground(1.5)
    flat = FlatCells.of(texels, LEAST)
    cells, done = flat.whole, []
    while len(cells.start):
        parted = (cells.length >= 2 * LEAST) & cells.wide
        done.append(cells.only(~parted))
        cells = finish(flat.halves(cells.only(parted), 2))
    smallest = Rectangles.joined(done)
    assert len(smallest.start) > 100
    index, number = flat.texels(smallest)
    assert np.array_equal(np.sort(np.concatenate([flat.order[index], flat.others])), np.flatnonzero(texels.valid))
    off = flat.place[:, index] - smallest.middle[number].T
    assert (np.abs(off) <= smallest.half[number].T * (1 + 1e-5) + 1e-5).all()
    corners = flat.at(smallest, np.array([[-1, -1], [1, 1]], np.float32))
    low, high = corners.min(1)[number], corners.max(1)[number]
    inside = (texels.position[flat.order[index]] > low - 1e-4) & (texels.position[flat.order[index]] < high + 1e-4)
    assert inside.all()


def test_rectangles_are_halved_once() -> None:
    texels, _ = ground(1.5)
    flat = FlatCells.of(texels, LEAST)
    first = finish(flat.halves(flat.whole, 1))
    order, count = flat.order.copy(), len(flat.known.start)
    again = finish(flat.halves(flat.whole, 1))
    assert all(
        np.array_equal(one, other) for one, other in zip(vars(first).values(), vars(again).values(), strict=True)
    )
    assert np.array_equal(flat.order, order)
    assert len(flat.known.start) == count == 3 * len(flat.whole.start)


def test_light_that_may_err_more_is_found_from_fewer_points_and_errs_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    texels, lamp = ground(1.5)
    expected = lamp.light(texels.position, texels.shading_normal, None)
    asked = []
    ask = MeshLamp.in_channels
    monkeypatch.setattr(
        MeshLamp, "in_channels", lambda self, c, p, *more: asked.append(len(p)) or ask(self, c, p, *more)
    )
    counts, errors = [], []
    for tolerance in (FINE, 4 * FINE):
        asked.clear()
        light = np.zeros((1, texels.count), np.float32)
        finish(light_of_meshes([lamp], texels, light, 1, None, tolerance))
        counts.append(sum(asked))
        errors.append(np.sqrt(np.mean((light[0] - expected) ** 2)) / expected.mean())
    assert counts[1] < 0.8 * counts[0]
    assert errors[0] < errors[1] < 4 * FINE


def test_rectangles_of_texels_in_one_point_are_not_halved() -> None:
    """Their halves would have no texels, again and again."""
    one = np.zeros((2, 2), np.float32)
    cells = Rectangles(
        np.array([0, 5]), np.array([5, 9]), one + 1, one + np.float32([[0], [1e-3]]), *np.zeros((2, 2), int)
    )
    assert cells.wide.tolist() == [False, True]
