# SPDX-License-Identifier: GPL-3.0-or-later
"""Where light must not be: under walls, in solids, behind planes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.scene import Material, Mesh, PointLight, Scene, SunLight, World
from tests.bakes import BLACK, WHITE, floor, lit, planes
from tests.shapes import box, furnished_room, mesh_of, quad

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")  # what NumPy has to say is heard first


# where light must not be


def two_rooms(thickness: float) -> Scene:
    """Two cubes of 2 m side by side on one floor, under one ceiling, a lamp in the first, a wall between them."""
    ground = mesh_of("Floor", [quad((0, 0, 0), (4, 0, 0), (0, 2, 0))], [0])
    ceiling = mesh_of("Ceiling", [quad((0, 0, 2), (0, 2, 0), (4, 0, 0))], [0])
    sides = mesh_of(
        "Sides",
        [
            quad((0, 0, 0), (0, 0, 2), (4, 0, 0)),
            quad((0, 2, 0), (4, 0, 0), (0, 0, 2)),
            quad((0, 0, 0), (0, 2, 0), (0, 0, 2)),
            quad((4, 0, 0), (0, 0, 2), (0, 2, 0)),
        ],
        [0] * 4,
    )
    wall = box("Wall", (2 - thickness / 2, -0.1, -0.1), (2 + thickness / 2, 2.1, 2.1))
    return Scene((ground, ceiling, sides, wall), (WHITE,), (PointLight("Lamp", (10, 10, 10), (1, 1, 1)),))


def test_light_does_not_leak_under_a_wall() -> None:
    thickness = 0.2
    found = lit(two_rooms(thickness), quality="medium", page_size=128)
    beyond = (found.position[:, 0] > 2 + thickness / 2 + 1e-3) & (found.mesh < 3)
    before = found.position[:, 0] < 2 - thickness
    assert found.light[beyond].max() < 1e-3 * found.light[before].mean()


def test_the_dark_behind_a_picture_close_to_a_wall_does_not_show_on_it() -> None:
    """A sheet 0.4 mm before a wall receives what the bare wall does; 18 % of it were missing."""
    room = box("Room", (0, 0, 0), (4, 4, 3), [1, 0, 0, 0, 0, 0], inward=True)
    sheet = mesh_of("Picture", [quad((1, 3.9996, 1), (2, 0, 0), (0, 0, 1.2))], [0])
    materials = (Material("Grey", (0.5, 0.5, 0.5)), Material("Glow", (0.5, 0.5, 0.5), (1.0, 1.0, 1.0)))
    settings = {"page_size": 256, "quality": "medium"}
    bare, hung = lit(Scene((room,), materials), **settings), lit(Scene((room, sheet), materials), **settings)
    x, y, z = bare.position.T
    covered = (y > 3.9999) & (x > 1) & (x < 3) & (z > 1) & (z < 2.2)
    expected = bare.light[covered].mean()
    assert hung.of(1).mean() == pytest.approx(expected, rel=0.01)
    assert hung.of(1).min() > 0.8 * bare.light[covered].min()


def upright(start: tuple[float, float], end: tuple[float, float], thickness: float) -> Mesh:
    """A wall of 2 m from one point of the floor to another."""
    p, q = np.array([*start, 0.0]), np.array([*end, 0.0])
    across, up = np.array([end[1] - start[1], start[0] - end[0], 0]) / np.linalg.norm(q - p) * thickness, (0, 0, 2)
    if not thickness:
        return mesh_of("Screen", [quad(p, q - p, up)], [0])
    p, q = p - across / 2, q - across / 2
    faces = [quad(p, up, q - p), quad(p + across, q - p, up), quad(p, across, up), quad(q, up, across)]
    return mesh_of("Wall", [*faces, quad(p, q - p, across), quad(p + up, across, q - p)], [0] * 6)


@pytest.mark.parametrize("quality", ["draft", "medium"])
@pytest.mark.parametrize("thickness", [0.0, 0.02], ids=["without thickness", "thinner than a texel"])
@pytest.mark.parametrize(("place", "slant"), [(2.013, 0.0), (1.925, 0.3)], ids=["along texels", "slanted"])
def test_no_light_leaks_under_a_thin_wall(place: float, slant: float, thickness: float, quality: str) -> None:
    """The slanted one's edge stands right in the one point of a texel beside a chart."""
    scene = two_rooms(0.2)
    wall = upright((place - slant, 0), (place + slant, 2), thickness)
    found = lit(replace(scene, meshes=(*scene.meshes[:3], wall)), quality=quality, page_size=128)
    x, y, _ = found.position.T
    side = x - place - slant * (y - 1)
    beyond = (side > thickness) & (found.mesh < 3)
    before = found.light[(side < -0.1) & (found.mesh < 3)].mean()
    assert beyond.sum() > 3000
    assert found.light[beyond].max() < 1e-3 * before
    dark = (found.mesh == 3) & (found.normal[:, 0] > 0.9)
    assert found.light[dark].max() < 1e-3 * before


@pytest.mark.parametrize("inner", [planes, lambda mesh: (mesh,)], ids=["planes", "closed box"])
def test_a_room_within_a_closed_hull_is_lit(inner: Callable[[Mesh], tuple[Mesh, ...]]) -> None:
    """Its surfaces lie inside a closed surface that faces out, and yet not inside a solid: there is a lamp."""
    room = inner(box("Room", (-1, -1, -1), (1, 1, 1), inward=True))
    lamp = PointLight("Lamp", (1, 1, 1), (0.2, 0.1, 0))
    hull = box("Hull", (-1.2, -1.2, -1.2), (1.2, 1.2, 1.2))
    alone, within = (lit(Scene(meshes, (WHITE,), (lamp,))) for meshes in (room, (*room, hull)))
    count = len(room)
    assert within.light[within.mesh < count].mean() == pytest.approx(alone.light.mean(), rel=0.05)
    assert within.of(count).max() < 1e-3


def test_where_a_box_stands_on_a_floor_no_light_leaks_into_its_shadow_and_no_shadow_out() -> None:
    scene = Scene(
        (floor(), box("Box", (-0.5, -0.5, 0), (0.5, 0.5, 1))), (BLACK,), (SunLight("Sun", (3.0,) * 3, (0.6, 0, -0.8)),)
    )
    found = lit(scene, page_size=128)
    ground, x, y = found.mesh == 0, found.position[:, 0], np.abs(found.position[:, 1])
    behind = ground & (x > 0.5) & (x < 1.1) & (y < 0.4)
    before = ground & (x < -0.5) & (y < 0.4)
    sunlit = 3 * 0.8 / np.pi
    assert behind.sum() > 50
    assert found.light[behind].max() < 1e-3 * sunlit
    assert np.abs(found.light[before] / sunlit - 1).max() < 0.005


def test_the_inside_of_a_closed_box_is_dark() -> None:
    """The room's faces look inward, so its inside is on the page, and so is a block that stands in it."""
    room = box("Room", (-1, -1, 0.5), (1, 1, 2.5), inward=True)
    block = box("Block", (-0.3, -0.3, 0.5), (0.3, 0.3, 1))
    scene = Scene((room, block, floor(8)), (WHITE,), (SunLight("Sun", (3.0,) * 3, (0, 0, -1)),), World((1, 1, 1)))
    found = lit(scene)
    assert found.of(2).mean() > 0.5
    assert found.of(0).max() == 0
    underside = found.normal[:, 2] < -0.5  # lies in the room's floor, and looks out of it
    assert found.light[(found.mesh == 1) & ~underside].max() == 0


def test_what_lies_inside_a_solid_is_dark() -> None:
    outer, inner = box("Outer", (-1, -1, -1), (1, 1, 1)), box("Inner", (-0.3, -0.3, -0.3), (0.3, 0.3, 0.3))
    found = lit(Scene((outer, inner), (WHITE,), world=World((1, 1, 1))))
    assert found.of(0).min() > 0.99
    assert found.of(1).max() == 0


def test_a_room_of_planes_that_face_out_keeps_the_light_out_and_what_is_inside_dark() -> None:
    room = planes(box("Room", (-1, -1, 0), (1, 1, 2)))
    block = box("Block", (-0.3, -0.3, 0.5), (0.3, 0.3, 1))
    found = lit(Scene((*room, block), (WHITE,), (SunLight("Sun", (3.0,) * 3, (0.6, 0, -0.8)),), World((1, 1, 1))))
    assert found.of(1).mean() > 1, "its top stands in the sun"
    assert found.of(6).max() < 1e-3


def test_backs_of_planes_reflect_like_fronts() -> None:
    """A block under a lamp gets the same light whichever way the walls around it face."""
    room, *blocks = furnished_room().meshes
    turned = [
        lit(replace(furnished_room(), meshes=(*planes(room, turned=way), *blocks)), quality="medium")
        for way in (False, True)
    ]
    for index in (6, 7):
        front, back = (found.of(index).mean(0, dtype=np.float64) for found in turned)
        assert back == pytest.approx(front, rel=0.02)
    assert turned[1].of(0).max() == 0, "the floor's front is outside"


def test_the_foot_of_a_thin_wall_sees_the_floor_up_to_where_it_stands() -> None:
    """A strip of floor d wide that leaves B lights a wall's height z by B / 2 (1 - z / (z^2 + d^2)^.5).

    The wall's plane parts texels of the floor: their near part is seen, though their centre is beyond.
    """
    reflectance, d = 0.5, 2.0
    ground = mesh_of("Floor", [quad((-6, -d, 0), (12, 0, 0), (0, 4, 0))], [0])
    wall = mesh_of("Wall", [quad((-6, 0, 0), (12, 0, 0), (0, 0, 1))], [1])
    sun = SunLight("Sun", (1.0, 1.0, 1.0), (0.0, 0.0, -1.0))
    scene = Scene((ground, wall), (Material("White", (reflectance,) * 3), Material("Black", (0.0,) * 3)), (sun,))
    for shift in (0.0, 0.013, 0.031):
        moved = replace(wall, vertices=wall.vertices + np.array([0, shift, 0]))
        bake = lit(replace(scene, meshes=(ground, moved)), page_size=256, quality="medium", bounces=1)
        own = (bake.mesh == 1) & (np.abs(bake.position[:, 0]) < 1) & (bake.position[:, 2] < 0.2)
        z, width = bake.position[own, 2], d + shift
        expected = reflectance / np.pi / 2 * (1 - z / np.sqrt(z**2 + width**2))
        error = bake.light[own, 0] / expected - 1
        assert np.sqrt(np.mean(error**2)) < 0.025
        assert np.abs(error).max() < 0.1
