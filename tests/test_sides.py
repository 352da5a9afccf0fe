# SPDX-License-Identifier: GPL-3.0-or-later
"""Two-sided surfaces: front and back have light of their own, and all else stays as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.geometry.appearance import appearance_of
from radiosity_addon.geometry.sides import seen_side, with_backs
from radiosity_addon.geometry.surfaces import flatten, on_front
from radiosity_addon.geometry.texels import rasterize
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.scene import AreaLight, Material, Mesh, PointLight, Scene, SunLight, World
from tests.bakes import BLACK, WHITE, floor, lit, planes
from tests.painter import Painter
from tests.shapes import box, cell_atlas, furnished_room, mesh_of, quad, sphere


def card(height: float = 1.0, **options: object) -> Mesh:
    """A leaf of 1 m that faces up."""
    return mesh_of("Card", [quad((-0.5, -0.5, height), (1, 0, 0), (0, 1, 0))], [0], **options)


def turned(mesh: Mesh) -> Mesh:
    """The mesh facing the other way, not two-sided."""
    scene = with_backs(Scene((replace(mesh, two_sided=True),), (WHITE,)))
    return replace(scene.meshes[1], front=None, two_sided=False)


def test_a_scene_without_two_sided_meshes_is_itself() -> None:
    scene = furnished_room()
    assert with_backs(scene) is scene
    surfaces = flatten(scene)
    assert surfaces.fronts == surfaces.count
    assert surfaces.without_backs() is surfaces
    assert not surfaces.two_sided.any()


def test_a_hit_on_a_back_is_one_on_the_front_of_its_twin_at_the_same_place() -> None:
    ball = replace(sphere("Ball", segments=12, rings=8), two_sided=True)
    surfaces = flatten(with_backs(Scene((floor(name="One-sided"), ball), (WHITE,))))
    rays = np.random.default_rng(1).normal(size=(500, 3)).astype(np.float32)
    origins = np.tile(np.float32([0, 0, 0.3]) - surfaces.origin.astype(np.float32), (500, 1))
    hits = Visibility(surfaces.without_backs().corners).first_hit(origins, rays)
    seen = seen_side(surfaces, hits)
    places = surfaces.points(seen.triangle, np.stack([seen.u, seen.v], axis=1))
    assert np.abs(places - (origins + hits.distance[:, None] * rays))[hits.triangle >= 0].max() < 1e-4
    inside = (surfaces.mesh[hits.triangle] == 1) & (hits.triangle >= 0) & ~hits.front
    assert inside.sum() > 200
    assert (surfaces.mesh[seen.triangle[inside]] == 2).all()
    assert seen.front[inside].all()
    assert np.einsum("ij,ij->i", surfaces.normal[seen.triangle[inside]], rays[inside]).max() < 0
    flat, u, v = on_front(surfaces, seen.triangle, np.stack([seen.u, seen.v], axis=1))
    assert np.array_equal(flat[inside], hits.triangle[inside])
    assert np.allclose(u[inside], hits.u[inside])
    assert np.allclose(v[inside], hits.v[inside])


@pytest.mark.parametrize("down", [True, False], ids=["from above", "from below"])
def test_the_sun_lights_one_side_of_a_leaf_only(down: bool) -> None:
    sun = SunLight("Sun", (3.0,) * 3, (0, 0, -1 if down else 1))
    found = lit(Scene((card(two_sided=True),), (BLACK,), (sun,)))
    front, back = found.of(0), found.of(1)
    bright, dark = (front, back) if down else (back, front)
    assert bright == pytest.approx(3 / np.pi, rel=1e-5)
    assert dark.max() == 0


def test_an_even_world_lights_both_sides_alike() -> None:
    found = lit(Scene((card(two_sided=True),), (WHITE,), world=World((0.7, 0.5, 0.3))))
    for side in (0, 1):
        assert np.abs(found.of(side) / np.float32([0.7, 0.5, 0.3]) - 1).max() < 0.002


def test_each_side_has_the_light_that_a_one_sided_leaf_facing_that_way_has() -> None:
    lamp = AreaLight("Lamp", (20.0,) * 3, (0.3, 0, 3), (1, 0, 0), (0, 1, 0), (0, 0, -1))
    scene = Scene((floor(), card(0.6)), (WHITE,), (lamp,))
    settings = {"quality": "medium", "page_size": 128}
    alone = lit(scene, **settings), lit(replace(scene, meshes=(floor(), turned(card(0.6)))), **settings)
    together = lit(replace(scene, meshes=(floor(), card(0.6, two_sided=True))), **settings)
    for side, one in zip((1, 2), alone, strict=True):
        wanted = one.of(1).mean(dtype=np.float64)
        assert together.of(side).mean(dtype=np.float64) == pytest.approx(wanted, rel=0.01)
    assert together.of(2).mean() < 0.5 * together.of(1).mean(), "the back sees the floor, and its own shadow on it"
    ground = alone[0].of(0).mean(dtype=np.float64)
    assert together.of(0).mean(dtype=np.float64) == pytest.approx(ground, rel=0.01)


def test_a_two_sided_furnace_is_exact_within_and_dark_without() -> None:
    """Closed, E = 1 on either side, rho = 1/2: H = E / (1 - rho) = 2 within; out of doors nothing shines back."""
    glow = Material("Glow", (0.5,) * 3, (1 / np.pi,) * 3)
    room = box("Room", (0, 0, 0), (3, 2, 1), inward=True, two_sided=True)
    found = lit(Scene((room,), (glow,)), tolerance=1e-7)
    within, without = found.mesh == 0, found.mesh == 1
    assert np.abs(found.light[within] * np.pi / 2 - 1).max() < 1e-5
    assert found.light[without].max() == 0


def test_a_two_sided_room_is_lit_alike_whichever_way_its_walls_face() -> None:
    scene = furnished_room()
    room, *blocks = scene.meshes
    pages = []
    for way in (False, True):
        walls = tuple(replace(wall, two_sided=True) for wall in planes(room, turned=way))
        found = lit(replace(scene, meshes=(*walls, *blocks)), quality="medium", page_size=256)
        within = [found.of(8 + k if way else k).mean(0, dtype=np.float64) for k in range(6)]
        without = [found.of(k if way else 8 + k).max() for k in range(6)]
        assert max(without) == 0
        pages.append(within)
    assert np.abs(np.array(pages[1]) / np.array(pages[0]) - 1).max() < 0.02


def test_the_inside_of_a_closed_two_sided_box_is_dark_and_its_outside_as_before() -> None:
    scene = Scene((box("Box", (0, 0, 0), (1, 1, 1)),), (WHITE,), (PointLight("Lamp", (9, 9, 9), (0.4, 0.6, 2)),))
    one = lit(scene)
    two = lit(replace(scene, meshes=(replace(scene.meshes[0], two_sided=True),)))
    assert two.of(1).max() == 0
    assert two.of(0).mean(dtype=np.float64) == pytest.approx(one.of(0).mean(dtype=np.float64), rel=0.01)


def test_backs_look_like_fronts_where_colours_vary() -> None:
    leaf = Material("Leaf", (0.4,) * 3, varies=frozenset({"reflectance"}))
    scene = Scene((card(two_sided=True),), (leaf,))
    every_side = with_backs(scene)
    atlas, surfaces = cell_atlas(every_side, 64), flatten(every_side)
    texels = finish(rasterize(atlas, surfaces))
    painter = Painter(scene, {"reflectance": lambda points: 0.4 + points @ [[0.5] * 3, [0.2] * 3, [0] * 3]})
    sampled = np.zeros(surfaces.count, bool)
    look, _ = finish(appearance_of(scene, atlas, texels, sampled, painter))
    place = texels.position + surfaces.origin
    wanted = 0.4 + 0.5 * place[:, 0] + 0.2 * place[:, 1]
    assert set(surfaces.mesh[texels.triangle[:]]) == {0, 1}
    off = np.abs(look.reflectance[:, 0] - wanted)[texels.covered == 15]
    assert np.quantile(off, 0.98) < 0.7 / 26, "of the texel in front, at most one off; at rims the painter guesses"
