# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive subdivision: where patches are split, that the parts lie in the whole, and that the light stays."""

import numpy as np
import pytest

from radiosity_addon.bake import bake
from radiosity_addon.chunks import finish
from radiosity_addon.errors import SettingsError
from radiosity_addon.radiosity import exchange
from radiosity_addon.radiosity.subdivision import patch_edges
from radiosity_addon.scene import Material, PointLight, Scene
from radiosity_addon.settings import MOST_SUBDIVISIONS, BakeSettings
from tests.shapes import box, mesh_of, quad, sphere

GREY = (Material("Grey", (0.5,) * 3),)
LAMP = (PointLight("Lamp", (2.0,) * 3, (0, 0, 1.5)),)


def shaded_floor() -> Scene:
    """A floor of 4 m, half of it under a screen: its shadow ends at x = 0."""
    floor = mesh_of("Floor", [quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))], [0])
    screen = mesh_of("Screen", [quad((-9, -9, 0.75), (9, 0, 0), (0, 18, 0))], [0], lightmapped=False)
    return Scene((floor, screen), GREY, LAMP)


def exchanges(scene: Scene, monkeypatch, **settings) -> tuple[list, list]:
    """What each round of an adaptive bake led to, and its pages."""
    rounds = []
    kept = exchange._exchange

    def spy(*given):
        result = yield from kept(*given)
        rounds.append(result)
        return result

    monkeypatch.setattr(exchange, "_exchange", spy)
    return rounds, finish(bake(scene, BakeSettings(page_size=128, **settings))).pages


def test_patches_are_split_at_the_edge_of_a_shadow_and_not_far_from_it(monkeypatch):
    (coarse, fine), _ = exchanges(shaded_floor(), monkeypatch, subdivisions=1)
    texels = fine.patches.texels
    floor = texels.surfaces.mesh[texels.triangle[:]] == 0
    owner = fine.patches.of_element[: texels.count]
    whole = np.sqrt(coarse.patches.area[coarse.patches.of_element[: texels.count]])
    part = np.sqrt(fine.patches.area[owner])
    x = texels.position[:, 0] + texels.surfaces.origin[0]
    edge, shade = floor & (np.abs(x) < 0.02), floor & (x < -1) & (x > -1.8)
    assert np.median(part[edge] / whole[edge]) == pytest.approx(0.5, abs=0.1)
    assert np.median(part[shade] / whole[shade]) == 1


def test_the_parts_of_a_patch_lie_in_it(monkeypatch):
    (coarse, middle, fine), _ = exchanges(shaded_floor(), monkeypatch, subdivisions=2)
    for whole, part in ((coarse, middle), (middle, fine)):
        count = whole.patches.texels.count
        mother, child = whole.patches.of_element[:count], part.patches.of_element[:count]
        both = (mother >= 0) & (child >= 0)
        pairs = np.unique(np.stack([child[both], mother[both]]), axis=1)
        assert len(np.unique(pairs[0])) == pairs.shape[1]
        assert part.patches.count > whole.patches.count


def test_evenly_lit_patches_stay_whole(monkeypatch):
    """Whatever noise their rays have: inside a sphere around its lamp all is equally bright."""
    ball = Scene(
        (sphere("Ball", segments=32, rings=32, inward=True),), GREY, (PointLight("Lamp", (2.0,) * 3, (0, 0, 0)),)
    )
    rounds, _ = exchanges(ball, monkeypatch, subdivisions=1)
    assert rounds[1].patches.count < 1.02 * rounds[0].patches.count


def test_the_light_of_a_room_is_the_same_however_its_patches_are_split(monkeypatch):
    room = Scene(
        (box("Room", (0, 0, 0), (3, 2, 2), inward=True),), GREY, (PointLight("Lamp", (2.0,) * 3, (1, 1, 1.5)),)
    )
    (plain,), (split,) = (exchanges(room, monkeypatch, subdivisions=number)[1] for number in (0, 2))
    assert split.mean() == pytest.approx(plain.mean(), rel=0.003)
    assert np.sqrt(np.mean((split - plain) ** 2)) < 0.02 * plain.mean()


def test_edges_are_where_a_patch_ends(monkeypatch):
    (only,), _ = exchanges(shaded_floor(), monkeypatch)
    patches = only.patches
    edge = patch_edges(patches)
    texels = patches.texels
    inner = np.flatnonzero(~edge)
    for step in (1, texels.size):
        beside = texels.texel_at[texels.pixel[inner] + step]
        assert (beside >= 0).all()
        assert np.array_equal(patches.of_element[beside], patches.of_element[inner])
    assert 0.05 < edge.mean() < 0.95


def test_shown_patches_have_dark_edges_and_the_same_light_between(monkeypatch):
    _, (plain,) = exchanges(shaded_floor(), monkeypatch, final_gather=False)
    _, (shown,) = exchanges(shaded_floor(), monkeypatch, final_gather=False, show_patches=True)
    lit = plain > 0.1 * plain.max()
    share = shown[lit] / plain[lit]
    assert share.min() == pytest.approx(0.3, abs=0.02)
    assert np.median(share) == 1


def test_too_many_subdivisions_are_refused():
    with pytest.raises(SettingsError):
        BakeSettings(subdivisions=MOST_SUBDIVISIONS + 1)
