# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes that light between surfaces does not meet, or that stop no light of lamps, against answers known on paper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.scene import Material, Mesh, PointLight, Scene, SunLight, World
from tests.bakes import BLACK, WHITE, bake_of, floor, lit
from tests.shapes import box, furnished_room, mesh_of, quad

SUN = SunLight("Sun", (3.0,) * 3, (0, 0, -1))


def cover(**options: object) -> Mesh:
    return mesh_of("Cover", [quad((-1, -1, 1), (2, 0, 0), (0, 2, 0))], [0], **options)


def test_one_tree_serves_all_rays_where_no_mesh_is_hidden_from_some() -> None:
    corners = np.float32([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    here = Visibility(corners)
    assert here.of_lamps is here
    everywhere = Visibility(corners, met=np.ones(1, bool), casts=np.ones(1, bool))
    assert everywhere.of_lamps is everywhere


def test_triangles_hidden_from_rays_are_not_met_and_the_others_keep_their_numbers() -> None:
    sheet = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    corners = np.stack([sheet + np.float32([0, 0, height]) for height in (3, 2, 1)])
    seen = Visibility(corners, met=np.array([False, True, True]), casts=np.array([False, False, True]))
    origins, down = np.float32([[0.2, 0.2, 5]]), np.float32([[0, 0, -1]])
    assert seen.first_hit(origins, down).triangle[0] == 1
    assert seen.of_lamps.first_hit(origins, down).triangle[0] == 2
    assert seen.occluded(origins, 3.5 * down)[0]
    assert not seen.of_lamps.occluded(origins, 3.5 * down)[0]
    assert seen.traced == 4


def test_what_casts_no_shadow_lets_the_sun_through_and_is_lit_itself() -> None:
    found = lit(Scene((floor(), cover(casts=False)), (BLACK,), (SUN,)))
    assert found.of(0) == pytest.approx(3 / np.pi, rel=1e-5)
    assert found.of(1) == pytest.approx(3 / np.pi, rel=1e-5)


def test_what_casts_no_shadow_still_hides_the_sky() -> None:
    world = World((1, 1, 1))
    wide = mesh_of("Cover", [quad((-50, -50, 0.5), (100, 0, 0), (0, 100, 0))], [0], casts=False, lightmapped=False)
    assert lit(Scene((floor(), wide), (BLACK,), world=world)).of(0).max() < 0.05


def test_light_between_surfaces_passes_what_it_does_not_meet() -> None:
    """A cover that only casts shadows: no sun below it, but all of the sky; and it has its own light."""
    scene = Scene((floor(), cover(met=False)), (BLACK,), (SUN,), World((1, 1, 1)))
    found = lit(scene)
    below = (found.mesh == 0) & (np.abs(found.position[:, :2]).max(1) < 0.9)
    assert found.light[below] == pytest.approx(1, rel=0.002)
    assert found.of(1).mean() == pytest.approx(1 + 3 / np.pi, rel=0.002)


def test_what_light_does_not_meet_sends_out_none() -> None:
    glow = Material("Glow", (0.8,) * 3, (5.0,) * 3)
    shining = replace(cover(met=False, casts=False), material=np.ones(2, np.int32))
    assert bake_of(Scene((floor(), shining), (WHITE, glow))).pages[0].max() == 0
    lamp = PointLight("Lamp", (1, 1, 1), (0, 0, 0.5))
    found = lit(Scene((floor(), cover(met=False)), (WHITE,), (lamp,)))
    x, y, _ = found.position[found.mesh == 0].T
    wanted = 0.5 / (x**2 + y**2 + 0.25) ** 1.5 / np.pi
    off = found.of(0)[:, 0] / wanted - 1
    assert np.abs(off[np.hypot(x, y) > 0.5]).max() < 0.01, "the lamp's light alone, none thrown back by the cover"


def test_a_block_hidden_from_all_light_leaves_the_floor_below_it_lit() -> None:
    block = box("Block", (-0.5, -0.5, 0), (0.5, 0.5, 1), met=False, casts=False)
    found = lit(Scene((floor(), block), (BLACK,), (SUN,)))
    assert found.of(0) == pytest.approx(3 / np.pi, rel=1e-5)


def test_a_room_with_nothing_hidden_is_baked_bit_for_bit_as_before() -> None:
    room = furnished_room()
    said = replace(room, meshes=tuple(replace(mesh, met=True, casts=True) for mesh in room.meshes))
    assert np.array_equal(bake_of(room).pages[0], bake_of(said).pages[0])
