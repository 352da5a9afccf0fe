# SPDX-License-Identifier: GPL-3.0-or-later
"""Shadow rays that start on the rounder surface: its height on paper, and what light a faceted ball then gets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import Surfaces, flatten
from radiosity_addon.geometry.texels import Texels, rasterize
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.lighting.lamp_samples import evenly_bent_share
from radiosity_addon.lighting.lights import direct_irradiance, irradiance_at, lamps_of
from radiosity_addon.lighting.terminator import bulge, footing
from radiosity_addon.scene import AreaLight, Material, Mesh, PointLight, Scene, SunLight, World
from radiosity_addon.settings import BakeSettings
from tests.bakes import BLACK, floor, lit
from tests.shapes import box, cell_atlas, mesh_of, quad, sphere

TOWARDS = np.array([0.8, 0.36, 0.48])
"""The sun: its terminator runs across facets."""
SUN = SunLight("sun", (1.0, 1.0, 1.0), (-0.8, -0.36, -0.48))
EDGE = 0.2


def ball_triangle(turned: bool = False) -> Surfaces:
    """An equilateral triangle of edges of 0.2 m on a ball of 1 m; its front looks inward if `turned`."""
    angle = 2 * np.pi / 3 * np.arange(3)
    reach = EDGE / np.sqrt(3)
    corners = np.stack([reach * np.cos(angle), reach * np.sin(angle), np.full(3, np.sqrt(1 - reach**2))], axis=1)
    normals = corners.copy()
    if turned:
        corners, normals = corners[::-1], -normals[::-1]
    index = np.zeros(1, np.int32)
    three = np.arange(3, dtype=np.int32)[None]
    mesh = Mesh("Ball", corners, three, normals[None].astype(np.float32), index, index, three, terminator=0.1)
    return flatten(Scene((mesh,), (Material("Grey", (0.5,) * 3),), (SUN,)))


def height(surfaces: Surfaces, v: float, w: float, side: int = 1) -> float:
    """Of the bulge at barycentrics, along the front's normal, m."""
    lift = bulge(surfaces, np.zeros(1, np.int32), np.array([[v, w]], np.float32), side)[0]
    return float(lift @ surfaces.normal[0])


def test_the_bulge_over_the_middle_of_an_edge_is_where_tangent_planes_meet() -> None:
    """Planes that touch a ball at the ends of a chord l meet l^2 / 4 over its middle, to second order."""
    assert height(ball_triangle(), 0.5, 0.0) == pytest.approx(EDGE**2 / 4, rel=0.02)


def test_the_bulge_is_nothing_at_corners() -> None:
    found = [height(ball_triangle(), *weights) for weights in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))]
    np.testing.assert_allclose(found, 0, atol=1e-8)


def test_in_a_hollow_the_planes_are_moved_up_to_the_highest_corner() -> None:
    """Seen from inside, corners stand l^2 / 2 over one another's planes: so much is left at a corner's own share."""
    assert height(ball_triangle(turned=True), 1 / 3, 1 / 3) == pytest.approx(EDGE**2 / 6, rel=0.02)
    assert height(ball_triangle(turned=True), 0.5, 0.0) == pytest.approx(0, abs=1e-8)


def test_backs_see_the_bulge_of_the_turned_triangle() -> None:
    front = height(ball_triangle(), 0.3, 0.3, side=-1)
    assert front == pytest.approx(-height(ball_triangle(turned=True), 0.3, 0.4), rel=1e-4)


def lit_ball(terminator: float | None) -> tuple[np.ndarray, Texels]:
    """Direct light (T,) of a sun on a coarse ball with smooth normals."""
    ball = sphere("Ball", segments=12, rings=8, terminator=terminator)
    scene = Scene((ball,), (Material("Grey", (0.5,) * 3),), (SUN,))
    surfaces = flatten(scene)
    texels = finish(rasterize(cell_atlas(scene, 256), surfaces))
    light = finish(
        direct_irradiance(lamps_of(scene, surfaces), texels, Visibility(surfaces.corners), BakeSettings(), 1)
    )
    return light[:, 0, 0], texels


def test_a_ball_of_facets_is_lit_as_its_normals_say_up_to_the_terminator() -> None:
    light, texels = lit_ball(1.0)
    cosine = texels.shading_normal @ TOWARDS
    np.testing.assert_allclose(light[cosine > 0.02], cosine[cosine > 0.02], atol=2e-3)
    assert not light[cosine < 0].any()


def test_without_it_facets_that_look_away_are_dark() -> None:
    light, texels = lit_ball(None)
    away = (texels.shading_normal @ TOWARDS > 0.02) & (texels.normal @ TOWARDS < 0)
    assert away.sum() > 100
    assert not light[away].any()


def test_with_an_offset_of_0_light_from_below_passes_the_facet_that_it_meets_but_no_other() -> None:
    """An open triangle is lit as its normals say; the other side of a ball keeps its facets dark."""
    alone = lit_triangle(0.0, tilt=0.3)
    np.testing.assert_allclose(alone, np.sin(0.2), rtol=1e-3)
    assert not lit_triangle(None, tilt=0.3).any()
    light, texels = lit_ball(0.0)
    away = (texels.shading_normal @ TOWARDS > 0.02) & (texels.normal @ TOWARDS < -0.02)
    assert away.sum() > 50
    assert not light[away].any()


def lit_triangle(terminator: float | None, tilt: float) -> np.ndarray:
    """Light of a sun 0.1 rad below a level triangle whose normals all lean by `tilt` rad towards it."""
    floor = mesh_of("Leaf", [quad((0, 0, 0), (1, 0, 0), (0, 1, 0))], [0], terminator=terminator)
    leaning = np.broadcast_to(np.float32([np.sin(tilt), 0, np.cos(tilt)]), floor.corner_normals.shape)
    sun = SunLight("sun", (1.0, 1.0, 1.0), (-np.cos(0.1), 0.0, np.sin(0.1)))
    scene = Scene((replace(floor, corner_normals=leaning),), (Material("Grey", (0.5,) * 3),), (sun,))
    surfaces = flatten(scene)
    texels = finish(rasterize(cell_atlas(scene, 32), surfaces))
    lamps = lamps_of(scene.moved(-surfaces.origin), surfaces)
    light = finish(direct_irradiance(lamps, texels, Visibility(surfaces.corners), BakeSettings(), 1))
    return light[:, 0, 0]


def test_light_that_does_not_graze_is_left_as_it_is() -> None:
    off, texels = lit_ball(None)
    low, _ = lit_ball(0.1)
    steep = np.minimum(texels.shading_normal @ TOWARDS, texels.normal @ TOWARDS) > 0.35
    np.testing.assert_array_equal(low[steep], off[steep])
    assert np.abs(low - off).max() > 0.05


def test_points_are_lit_as_the_texels_that_they_lie_in() -> None:
    light, texels = lit_ball(0.1)
    ids = np.flatnonzero(texels.valid)
    surfaces = texels.surfaces
    visibility = Visibility(surfaces.corners)
    scene = Scene((sphere("Ball", segments=12, rings=8, terminator=0.1),), (Material("Grey", (0.5,) * 3),), (SUN,))
    lamps = lamps_of(scene, surfaces)
    found = np.zeros(len(ids))
    for stratum in range(4):
        places = ids, np.full(len(ids), stratum)
        points, stand = texels.origins(*places), footing(texels, *places)
        normals = texels.shading_normal[ids]
        found += finish(irradiance_at(lamps, points, normals, visibility, 1, ids, 1, None, stand))[:, 0, 0] / 4
    assert np.abs(found - light[ids]).mean() < 1e-3


def test_flat_triangles_have_no_terminator_of_their_own() -> None:
    floor = mesh_of("Floor", [quad((0, 0, 0), (1, 0, 0), (0, 1, 0))], [0], terminator=0.5)
    surfaces = flatten(Scene((floor,), (Material("Grey", (0.5,) * 3),), (SUN,)))
    assert not surfaces.rounds


BENDS = (1.25, 2.0)
"""Of a Shading Offset of 0.4, and of 1, the largest."""


def uniform(bend: float) -> float:
    """What a bent cosine leaves of light that comes alike from everywhere, by the midpoint rule."""
    t = (np.arange(10000) + 0.5) / 10000 * np.pi / 2
    return float((np.maximum(np.cos(np.minimum(bend * t, np.pi)), 0) * 2 * np.sin(t)).sum() * np.pi / 2 / 10000)


@pytest.mark.parametrize("bend", BENDS)
def test_what_a_bent_cosine_leaves_of_even_light_is_its_integral(bend: float) -> None:
    assert evenly_bent_share(np.float32([bend, 1.0])) == pytest.approx([uniform(bend), 1.0], rel=1e-5)


@pytest.mark.parametrize("bend", BENDS)
def test_a_sun_counts_by_the_cosine_of_a_larger_angle(bend: float) -> None:
    for angle in (0.3, 0.7, 1.3):
        sun = SunLight("Sun", (np.pi,) * 3, (np.sin(angle), 0.0, -np.cos(angle)))
        found = lit(Scene((floor(bend=bend),), (BLACK,), (sun,)))
        assert found.light == pytest.approx(max(np.cos(bend * angle), 0), abs=1e-4)


@pytest.mark.parametrize("bend", BENDS)
def test_a_lamp_is_weighed_point_by_point(bend: float) -> None:
    """A quarter of it hidden behind a sheet: what is left is the sum over the rest, each point by its own angle."""
    lamp = AreaLight("Lamp", (1.0, 1.0, 1.0), (0.0, 0.0, 1.0), (2.0, 0, 0), (0, 0.2, 0), (0, 0, -1))
    spot = mesh_of("Spot", [quad((-0.01, -0.01, 0), (0.02, 0, 0), (0, 0.02, 0))], [0], bend=bend)
    sheet = mesh_of("Sheet", [quad((0.25, -1, 0.5), (1, 0, 0), (0, 2, 0))], [0])
    x, y = np.meshgrid((np.arange(400) + 0.5) / 200 - 1, (np.arange(40) + 0.5) / 200 - 0.1)
    square = x**2 + y**2 + 1
    bent = np.maximum(np.cos(np.minimum(bend * np.arccos(square**-0.5), np.pi)), 0)
    each = bent * square**-1.5 * (0.4 / x.size) / np.pi
    for meshes, seen in (((spot,), x == x), ((spot, sheet), x < 0.5)):
        found = lit(Scene(meshes, (BLACK,), (lamp,)), quality="high").of(0).mean()
        assert found == pytest.approx(each[seen].sum(), rel=0.01)


@pytest.mark.parametrize("bend", BENDS)
def test_many_lamps_count_by_bent_cosines_too(bend: float) -> None:
    lamps = tuple(PointLight(f"Lamp {k}", (1.0,) * 3, (0.05 * k, 0.0, 1.0)) for k in range(40))
    found = lit(
        Scene((mesh_of("Spot", [quad((-0.1, -0.1, 0), (0.2, 0, 0), (0, 0.2, 0))], [0], bend=bend),), (BLACK,), lamps)
    )
    square = 1 + (0.05 * np.arange(40)) ** 2
    bent = np.maximum(np.cos(np.minimum(bend * np.arccos(square**-0.5), np.pi)), 0) / square / np.pi
    assert found.light.mean() == pytest.approx(bent.sum(), rel=0.02)


@pytest.mark.parametrize("bend", BENDS)
def test_the_sky_counts_by_a_bent_cosine(bend: float) -> None:
    found = lit(Scene((floor(bend=bend),), (BLACK,), world=World((1.0, 1.0, 1.0))), quality="medium")
    assert found.light.mean() == pytest.approx(uniform(bend), rel=0.01)


@pytest.mark.parametrize("bend", BENDS)
def test_a_room_whose_walls_bend_reflects_the_less_at_each_bounce(bend: float) -> None:
    """A furnace: all see B everywhere, and B = E + rho D B."""
    walls = Material("Wall", (0.5,) * 3, emission=(1.0,) * 3)
    found = lit(Scene((box("Room", (0, 0, 0), (2, 2, 2), inward=True, bend=bend),), (walls,)), quality="medium")
    share = uniform(bend)
    assert found.light.mean() == pytest.approx(share / (1 - 0.5 * share), rel=0.01)
