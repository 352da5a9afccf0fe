# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps that light some meshes only; what those throw back reaches all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.scene import Mesh, PointLight, Scene, SunLight
from tests.bakes import BLACK, WHITE, floor, lit
from tests.shapes import mesh_of, quad

SUN = SunLight("Sun", (3.0,) * 3, (0, 0, -1))


def beside(name: str, **options: object) -> Mesh:
    """A second floor, next to the first."""
    return mesh_of(name, [quad((3, -2, 0), (4, 0, 0), (0, 4, 0))], [0], **options)


def test_a_lamp_lights_its_receivers_only() -> None:
    other = SunLight("Other", (0.5,) * 3, (0, 0, -1))
    scene = Scene((floor(), beside("Beside")), (BLACK,), (other, SUN), receivers={1: frozenset([1])})
    found = lit(scene)
    assert found.of(0) == pytest.approx(0.5 / np.pi, rel=1e-5)
    assert found.of(1) == pytest.approx(3.5 / np.pi, rel=1e-5)


def test_receivers_stay_with_their_lamp_beside_dark_ones_and_across_batches() -> None:
    dark = replace(SUN, irradiance=(0.0,) * 3)
    lamps = (*[dark] * 3, *[SUN] * 11)
    scene = Scene((floor(), beside("Beside")), (BLACK,), lamps, receivers={13: frozenset([0]), 4: frozenset()})
    found = lit(scene)
    assert found.of(0) == pytest.approx(10 * 3 / np.pi, rel=1e-5)
    assert found.of(1) == pytest.approx(9 * 3 / np.pi, rel=1e-5)


def test_both_sides_of_a_receiver_are_lit() -> None:
    below = SunLight("Below", (2.0,) * 3, (0, 0, 1))
    card = mesh_of("Card", [quad((0, 0, 1), (1, 0, 0), (0, 1, 0))], [0], two_sided=True)
    far = mesh_of("Far", [quad((5, 0, 1), (1, 0, 0), (0, 1, 0))], [0], two_sided=True)
    found = lit(Scene((card, far), (BLACK,), (SUN, below), receivers={0: frozenset([0]), 1: frozenset([0])}))
    assert found.of(2) == pytest.approx(2 / np.pi, rel=1e-5), "the card's back"
    assert found.of(0) == pytest.approx(3 / np.pi, rel=1e-5)
    assert found.of(1).max() == found.of(3).max() == 0


@pytest.mark.parametrize("turned", [False, True], ids=["from its front", "from its back"])
def test_what_a_receiver_throws_back_reaches_all_and_others_throw_back_none(turned: bool) -> None:
    """A screen beside a floor: with the screen as the receiver the floor is lit by it; with none, nothing is."""
    corners = quad((-2, -2, 0), (0, 4, 0), (0, 0, 2))
    screen = mesh_of("Screen", [corners[::-1] if turned else corners], [0])
    lamp = PointLight("Lamp", (1, 1, 1), (0, 0, 1))
    scene = Scene((floor(), screen), (WHITE,), (lamp,))
    only, none = (lit(replace(scene, receivers={0: frozenset(lit_ones)})) for lit_ones in ([1], []))
    assert only.of(0).mean() > 0.002
    assert none.of(0).max() == none.of(1).max() == 0
