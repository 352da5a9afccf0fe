# SPDX-License-Identifier: GPL-3.0-or-later
"""Whose faces point away from the light is said, by name, and of nobody else."""

from __future__ import annotations

from dataclasses import replace

import pytest

from radiosity_addon.scene import Mesh, PointLight, Scene, SunLight, World
from tests.bakes import WHITE, bake_of, floor, planes
from tests.shapes import box, furnished_room, mesh_of, quad


def named(scene: Scene) -> list[str]:
    """Names of those that are said to be lit from behind."""
    warnings = [text for text in bake_of(scene).warnings if "backs of its faces" in text]
    return [text.split(":")[0] for text in warnings]


def card(**options: object) -> Mesh:
    return mesh_of("Card", [quad((-0.5, -0.5, 1), (1, 0, 0), (0, 1, 0))], [0], **options)


@pytest.mark.parametrize("turned", [False, True], ids=["inward", "outward"])
def test_a_room_of_planes_is_named_if_they_face_out(turned: bool) -> None:
    scene = furnished_room()
    room, *blocks = scene.meshes
    walls = planes(room, turned=turned)
    assert named(replace(scene, meshes=(*walls, *blocks))) == ([wall.name for wall in walls] if turned else [])


def test_a_leaf_lit_from_below_is_named_unless_it_is_two_sided() -> None:
    lamp = PointLight("Lamp", (9, 9, 9), (0, 0, 0.5))
    assert named(Scene((card(),), (WHITE,), (lamp,))) == ["Card"]
    assert named(Scene((card(two_sided=True),), (WHITE,), (lamp,))) == []
    assert named(Scene((card(lightmapped=False), floor()), (WHITE,), (lamp,))) == []


def test_a_panel_that_reflects_behind_only_is_not_named() -> None:
    lamp = PointLight("Lamp", (9, 9, 9), (0, 0, 0.5))
    dim, grey = (replace(WHITE, reflectance=(share,) * 3, back=1) for share in (0.0, 0.5))
    assert named(Scene((card(),), (dim, WHITE), (lamp,))) == []
    assert named(Scene((card(),), (grey, WHITE), (lamp,))) == ["Card"]


def test_who_has_light_on_both_sides_is_not_named() -> None:
    assert named(Scene((card(), floor()), (WHITE,), (SunLight("Sun", (3.0,) * 3, (0, 0, -1)),))) == []
    assert named(Scene((card(),), (WHITE,), world=World((1, 1, 1)))) == []


def test_solids_and_what_is_dark_are_not_named() -> None:
    dark = box("Box", (0, 0, 0), (1, 1, 1))
    assert named(Scene((dark,), (WHITE,), world=World((1, 1, 1)))) == []
    assert named(Scene((card(),), (WHITE,))) == []
