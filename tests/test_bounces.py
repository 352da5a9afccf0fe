# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes whose bounces are counted or clamped, in rooms where the answer is a sum of a few terms."""

import numpy as np
import pytest

from radiosity_addon.bake import bake
from radiosity_addon.chunks import finish
from radiosity_addon.errors import SettingsError
from radiosity_addon.scene import Material, PointLight, Scene, World
from radiosity_addon.settings import BakeSettings
from tests.shapes import box, mesh_of, quad, sphere

RHO = 0.5
INTENSITY = (2.0, 2.0, 2.0)


def page_of(scene: Scene, **settings) -> np.ndarray:
    return finish(bake(scene, BakeSettings(**{"page_size": 64, "quality": "medium", **settings}))).pages[0]


def geometric_sum(bounces: int) -> float:
    return sum(RHO**k for k in range(bounces + 1))


def ball(*lights: PointLight, **options) -> Scene:
    inside = sphere("Sphere", segments=32, rings=32, inward=True)
    return Scene((inside,), (Material("Half", (RHO,) * 3),), lights, **options)


@pytest.mark.parametrize("quality", ["draft", "medium"])  # one pass of the gather, and two
@pytest.mark.parametrize("bounces", [0, 1, 2, 3, 7])
def test_lamplight_in_a_sphere_is_a_sum_of_as_many_terms(bounces, quality):
    """Each point sees all others alike: H = I / R^2 (1 + rho + ... + rho^k)."""
    page = page_of(ball(PointLight("Lamp", INTENSITY, (0, 0, 0))), bounces=bounces, quality=quality)
    assert page.mean() * np.pi == pytest.approx(2 * geometric_sum(bounces), rel=0.01)
    assert np.ptp(page) < 0.02 * page.mean()


@pytest.mark.parametrize("quality", ["draft", "medium"])
@pytest.mark.parametrize("bounces", [0, 1, 4])
def test_light_of_walls_that_glow_is_direct_light(bounces, quality):
    """A closed room of radiance 1: H = pi (1 + rho + ... + rho^k)."""
    glow = Material("Glow", (RHO,) * 3, (1.0,) * 3)
    room = Scene((box("Room", (0, 0, 0), (3, 2, 1), inward=True),), (glow,))
    assert page_of(room, bounces=bounces, quality=quality) == pytest.approx(geometric_sum(bounces), rel=1e-4)


@pytest.mark.parametrize("bounces, expected", [(0, 0.5), (1, 0.5 + 0.5 * RHO * 0.5)])
def test_skylight_is_direct_light(bounces, expected):
    """A wall of infinite length and height stands on an endless floor: each sees half of the sky, half of the other.

    Beside the edge the wall's H is pi / 2 and half of the floor's view is the wall: H = pi (1 + rho / 2) / 2.
    """
    size = 2000.0
    near = mesh_of("Near", [quad((0.5, -0.5, 0.001), (0.1, 0, 0), (0, 1, 0))], [0])
    wall = mesh_of("Wall", [quad((0, -size / 2, 0), (0, size, 0), (0, 0, size))], [0], lightmapped=False)
    rest = mesh_of("Rest", [quad((1, -size / 2, 0), (size, 0, 0), (0, size, 0))], [0], lightmapped=False)
    scene = Scene((near, wall, rest), (Material("Half", (RHO,) * 3),), world=World((1.0,) * 3))
    page = page_of(scene, bounces=bounces)
    assert page.mean() == pytest.approx(expected, rel=0.035)  # of 25 places RMS 0.8 %, at most 2.2 %


@pytest.mark.parametrize("bounces", [0, 1, 3])
def test_patches_shown_as_they_are_hold_as_many_bounces(bounces):
    page = page_of(ball(PointLight("Lamp", INTENSITY, (0, 0, 0))), bounces=bounces, final_gather=False)
    assert page.mean() * np.pi == pytest.approx(2 * geometric_sum(bounces), rel=0.01)


def test_the_ambient_term_is_exact_where_light_is_even():
    """Nothing is shot, all is guessed: H = I / R^2 (1 + rho / (1 - rho)), the first 1 being direct light."""
    scene = ball(PointLight("Lamp", INTENSITY, (0, 0, 0)))
    page = page_of(scene, most_steps=0, ambient=True, final_gather=False)
    assert page.mean() * np.pi == pytest.approx(2 / (1 - RHO), rel=0.01)
    assert page_of(scene, most_steps=0, final_gather=False).mean() * np.pi == pytest.approx(2, rel=0.01)


def test_a_limit_of_all_bounces_is_none():
    scene = ball(PointLight("Lamp", INTENSITY, (0, 0, 0)))
    assert np.array_equal(page_of(scene, bounces=1024), page_of(scene))
    assert page_of(scene).mean() * np.pi == pytest.approx(2 / (1 - RHO), rel=0.01)


def test_each_light_group_has_its_own_limit():
    """One lamp shines once, the other for ever: their light adds up."""
    once, ever = PointLight("Once", INTENSITY, (0, 0, 0), group=1), PointLight("Ever", (1.0,) * 3, (0, 0, 0))
    page = page_of(ball(once, ever, groups=("", "Once"), bounces={1: 0}))
    assert page.mean() * np.pi == pytest.approx(2 + 1 / (1 - RHO), rel=0.01)


def test_the_lower_of_two_limits_counts():
    scene = ball(PointLight("Lamp", INTENSITY, (0, 0, 0)), bounces={0: 3})
    assert np.array_equal(page_of(scene, bounces=1), page_of(ball(*scene.lights), bounces=1))


def test_direct_light_is_clamped_where_it_shows():
    """rho H / pi = 0.318 everywhere: clamped to 0.1, direct light is 0.1 / rho; what bounces stays."""
    page = page_of(ball(PointLight("Lamp", INTENSITY, (0, 0, 0))), clamp_direct=0.1, bounces=1)
    assert page.mean() == pytest.approx(0.1 / RHO + RHO * 2 / np.pi, rel=0.01)


def test_light_reflected_once_is_clamped_by_the_indirect_clamp():
    page = page_of(ball(PointLight("Lamp", INTENSITY, (0, 0, 0))), clamp_indirect=0.1, bounces=1)
    assert page.mean() == pytest.approx(2 / np.pi + 0.1, rel=0.01)


def test_clamps_above_all_light_change_nothing():
    scene = ball(PointLight("Lamp", INTENSITY, (0, 0, 0)))
    assert np.array_equal(page_of(scene, clamp_direct=10, clamp_indirect=10), page_of(scene))


@pytest.mark.parametrize("given", [{"bounces": -1}, {"clamp_direct": -1}, {"clamp_indirect": float("nan")}])
def test_limits_out_of_range_are_refused(given):
    with pytest.raises(SettingsError):
        BakeSettings(**given)
