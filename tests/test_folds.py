# SPDX-License-Identifier: GPL-3.0-or-later
"""Finer texels where surfaces fold: surfaces whose curvature is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.atlas.folds import BLOCK, FINEST, MOST_MORE, MOST_TURN, Folds, turning
from radiosity_addon.atlas.unwrap import build_atlas
from radiosity_addon.chunks import finish
from radiosity_addon.estimate import FILLED
from radiosity_addon.scene import Material, Mesh, Scene
from radiosity_addon.settings import BakeSettings
from tests.shapes import mesh_of, quad, sheet

FINE = BakeSettings(density=100.0, page_size=4096, fine_folds=True)


def rate(mesh: Mesh) -> float:
    return turning(mesh.vertices, mesh.triangles, mesh.corner_normals)[0]


def fineness(*meshes: Mesh, settings: BakeSettings = FINE) -> list[float]:
    return Folds.of(meshes, settings).fineness.tolist()


def test_a_cylinder_turns_by_one_over_its_radius() -> None:
    turn, area = turning(*(getattr(sheet("", 0.1, 2.0), name) for name in ("vertices", "triangles", "corner_normals")))
    assert turn == pytest.approx(10.0, rel=1e-3)
    assert area == pytest.approx(0.2, rel=1e-3)


def test_a_ball_turns_by_one_over_its_radius() -> None:
    """Whichever edges its triangles have: the normal of the unit sphere is the place."""
    dice = np.random.default_rng(2)
    first = dice.normal(size=(BLOCK + 7, 1, 3))
    place = first / np.linalg.norm(first, axis=2, keepdims=True) + 1e-3 * dice.normal(size=(BLOCK + 7, 3, 3))
    place /= np.linalg.norm(place, axis=2, keepdims=True)
    triangles = np.arange(3 * len(place), dtype=np.int32).reshape(-1, 3)
    assert turning(0.5 * place.reshape(-1, 3), triangles, place.astype(np.float32))[0] == pytest.approx(2.0, rel=0.02)


def test_flat_faces_turn_by_nothing_and_points_do_no_harm() -> None:
    assert (
        rate(mesh_of("Box", [quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), quad((0, 0, 0), (0, 1, 0), (0, 0, 1))], [0, 0]))
        == 0
    )
    point = replace(sheet("", 0.1, 2.0), vertices=np.zeros((194, 3)))
    assert turning(point.vertices, point.triangles, point.corner_normals) == (0.0, 0.0)


def test_what_turns_on_less_than_a_tenth_of_its_area_is_left_as_it_is() -> None:
    """A plane with a rounded rim: its 10 % that turns most turn by nothing, or by 10 a metre."""
    bent = sheet("", 0.1, 1.0, length=1.0)
    for width, turn in ((2.0, 0.0), (0.5, 10.0)):
        flat = sheet("", width, 0.0)
        both = np.concatenate([bent.vertices, flat.vertices])
        triangles = np.concatenate([bent.triangles, flat.triangles + len(bent.vertices)])
        normals = np.concatenate([bent.corner_normals, flat.corner_normals])
        assert turning(both, triangles, normals)[0] == pytest.approx(turn, rel=1e-3)


def test_texels_get_as_fine_as_the_turn_asks_for_and_at_most_twice() -> None:
    """At 100 texels a metre a texel of a tube of 1 / (100 a) m turns by a; a floor keeps folds a small part of all."""
    floor = sheet("Floor", 100.0, 0.0)
    for turn, times in ((0.5, 1.0), (1.0, 1.0), (1.5, 1.5), (2.0, 2.0), (5.0, FINEST)):
        tube = sheet("Tube", 1 / (100 * turn * MOST_TURN), 2.0)
        assert fineness(floor, tube) == pytest.approx([1.0, times], rel=2e-3)


def test_a_higher_density_of_its_own_counts_and_nothing_becomes_finer_than_its_folds_ask_for() -> None:
    floor, tube = sheet("Floor", 100.0, 0.0), sheet("Tube", 1 / (100 * 1.8 * MOST_TURN), 2.0)
    for own, times in ((0.5, 2.0), (1.0, 1.8), (1.5, 1.2), (2.0, 1.0)):
        assert fineness(floor, replace(tube, density=own))[1] == pytest.approx(times, rel=2e-3)


def test_folds_alone_take_no_more_than_a_fifth_beyond_their_texels() -> None:
    tubes = [sheet(f"Tube {number}", 0.01, 2.0) for number in range(3)]
    assert fineness(*tubes) == pytest.approx([math.sqrt(1 + MOST_MORE)] * 3)
    first, second = fineness(
        sheet("Tube", 0.01, 2.0, length=3.0), sheet("Half as bent", 1 / (100 * 1.5 * MOST_TURN), 2.0)
    )
    assert (first**2 - 1) / (second**2 - 1) == pytest.approx(3 / 1.25, rel=1e-2), "all give up the same share"


def test_on_a_page_that_is_filled_texels_are_as_wide_as_its_group_leaves_them() -> None:
    floor, tube = sheet("Floor", 40.0, 0.0), sheet("Tube", 0.05, 2.0)
    settings = BakeSettings(page_size=512, fine_folds=True)
    density = math.sqrt(FILLED * 512**2 / (40.0 + 0.1))
    assert np.degrees(Folds.of([floor, tube], settings).turn[1]) == pytest.approx(math.degrees(20 / density), rel=1e-3)
    apart = replace(tube, page_group="Tubes")
    assert fineness(floor, apart, settings=settings)[1] == 1.0, "alone on a page its texels are fine enough"


def test_instances_are_as_fine_as_if_each_were_looked_at() -> None:
    floor, tube = sheet("Floor", 300.0, 0.0), sheet("Tube", 0.02, 2.0)
    turn = np.array([[0, 0, 1], [0.6, 0.8, 0], [-0.8, 0.6, 0]])
    larger = replace(
        tube,
        name="Larger",
        vertices=1.3 * tube.vertices @ turn + 5,
        corner_normals=(tube.corner_normals @ turn).astype(np.float32),
    )
    alike = fineness(floor, replace(tube, shape=4), replace(larger, shape=4))
    assert alike == pytest.approx(fineness(floor, tube, larger))
    assert alike[1] > alike[2] > 1


def test_the_atlas_lays_folds_finer_and_can_be_told_not_to() -> None:
    scene = Scene((sheet("Floor", 4.0, 0.0), sheet("Tube", 0.01, 2.0)), (Material("Grey"),))
    page = BakeSettings(page_size=256, fine_folds=True)
    atlas, even = (finish(build_atlas(scene, each)) for each in (page, replace(page, fine_folds=False)))
    assert atlas.density[1] / atlas.density[0] == pytest.approx(FINEST, rel=1e-3)
    assert even.density[1] == pytest.approx(even.density[0])
    assert 0.85 < atlas.density[0] / even.density[0] <= 1.001


def test_what_gets_no_lightmap_has_no_texels_to_be_finer() -> None:
    assert fineness(replace(sheet("Tube", 0.01, 2.0), lightmapped=False)) == [1.0]
