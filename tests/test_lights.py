# SPDX-License-Identifier: GPL-3.0-or-later
"""Direct light: closed forms against their own samples, shadows against geometry, and what must cost nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import Texels, rasterize
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.lighting.lamp_samples import lattice, pixel_shifts
from radiosity_addon.lighting.lights import direct_irradiance, irradiance_at, lamps_of
from radiosity_addon.scene import AreaLight, Light, Material, PointLight, Scene, SpotLight, SunLight
from radiosity_addon.settings import QUALITIES, BakeSettings
from tests.lamps import GREY, PANEL, WHITE, by_samples, lamp_of, receivers
from tests.shapes import box, cell_atlas, mesh_of, quad, sphere

DOWN = ((1.0, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, -1.0))


LIGHTS: dict[str, Light] = {
    "point": PointLight("point", WHITE, (0, 0, 1.5)),
    "soft point": PointLight("point", WHITE, (0, 0, 1.5), 0.4),
    "sphere": PointLight("point", WHITE, (0, 0, 1.5), 0.4, soft_falloff=False),
    "spot": SpotLight("spot", WHITE, (0, 0, 1.5), DOWN, 1.2, 0.5, 0.1),
    "hard spot": SpotLight("spot", WHITE, (0, 0, 1.5), DOWN, 1.2, 0.0, 0.4, soft_falloff=False),
    "sun": SunLight("sun", WHITE, (0.6, 0, -0.8)),
    "wide sun": SunLight("sun", WHITE, (0.6, 0, -0.8), 0.5),
    "rectangle": PANEL,
    "ellipse": replace(PANEL, ellipse=True),
    "softbox": replace(PANEL, spread=1.2),
    "round softbox": replace(PANEL, spread=0.6, ellipse=True),
}


@pytest.mark.parametrize("name", LIGHTS)
@pytest.mark.parametrize("bent", [False, True], ids=["flat", "bent normals"])
def test_closed_form_is_the_mean_of_the_samples_that_shadow_rays_aim_at(name: str, bent: bool) -> None:
    points, shading, geometric = receivers()
    (lamp,) = lamp_of(LIGHTS[name]).lamps
    closed = lamp.light(points, shading, geometric) if bent else lamp.light(points, shading, None)
    sampled = by_samples(lamp, points, [shading, geometric] if bent else [shading], 610)
    assert closed.sum() == pytest.approx(sampled.sum(), rel=2e-3)
    assert np.sqrt(np.mean((closed - sampled) ** 2)) < 4e-3 * sampled.max()


def test_a_point_lamp_follows_the_inverse_square_of_distance() -> None:
    (lamp,) = lamp_of(PointLight("point", (100 / (4 * math.pi),) * 3, (0, 0, 0))).lamps
    point = np.array([[0, 0, -2]], np.float32)
    light = lamp.light(point, np.array([[0, 0, 1]], np.float32), None)[0] * lamp.strength[0] / math.pi
    assert light == pytest.approx(0.633257, rel=1e-5)


@pytest.mark.parametrize("angle", [0.0, 0.1, 1.0])
def test_a_sun_keeps_its_irradiance_at_any_angle(angle: float) -> None:
    (lamp,) = lamp_of(SunLight("sun", (3, 3, 3), (0, 0, -1), angle)).lamps
    light = lamp.light(np.zeros((1, 3), np.float32), np.array([[0, 0, 1]], np.float32), None)[0]
    assert light * 3 / math.pi == pytest.approx(0.954930, rel=1e-5)


def test_soft_falloff_on_the_axis_is_that_of_a_disc() -> None:
    (lamp,) = lamp_of(PointLight("point", WHITE, (0, 0, 0), 0.5)).lamps
    light = lamp.light(np.array([[0, 0, -2]], np.float32), np.array([[0, 0, 1]], np.float32), None)[0]
    assert light == pytest.approx(1 / (4 * (1 + 0.25 / 4)), rel=1e-5)


@pytest.mark.parametrize("name", LIGHTS)
def test_a_lamp_that_touches_a_surface_stays_finite(name: str) -> None:
    light = LIGHTS[name]
    if isinstance(light, SunLight):
        light = replace(light, direction=(1, 0, 0))
    else:
        light = replace(light, position=(0, 0, 0))
    (lamp,) = lamp_of(light).lamps
    points, shading, geometric = receivers(200)
    points[:50] = 0
    assert np.isfinite(lamp.light(points, shading, geometric)).all()
    assert np.isfinite(by_samples(lamp, points, [shading, geometric], 16)).all()


class Stage:
    """A lit scene: its texels, and their direct light."""

    def __init__(self, scene: Scene, size: int = 256, quality: str = "medium", threads: int = 1) -> None:
        self.surfaces = flatten(scene)
        moved = scene.moved(-self.surfaces.origin)
        self.visibility = Visibility(self.surfaces.corners)
        self.texels: Texels = finish(rasterize(cell_atlas(scene, size), self.surfaces))
        self.lamps = lamps_of(moved, self.surfaces)
        self.settings = BakeSettings(quality=quality, threads=threads)
        self.groups = len(scene.groups)
        self.world = self.texels.position + self.surfaces.origin
        self.direct = self.run()

    def run(self) -> np.ndarray:
        return finish(direct_irradiance(self.lamps, self.texels, self.visibility, self.settings, self.groups))

    def on_floor(self) -> np.ndarray:
        return np.flatnonzero(self.surfaces.mesh[self.texels.triangle[:]] == 0)


def shaded_floor(light: Light, height: float = 1.0) -> Scene:
    """A floor of 4 m with a square of 1 m above it that faces up, in the middle."""
    floor = mesh_of("floor", [quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))], [0])
    screen = mesh_of("screen", [quad((-0.5, -0.5, height), (1, 0, 0), (0, 1, 0))], [0])
    return Scene((floor, screen), (GREY,), (light,))


def test_the_edge_of_a_sun_shadow_is_anti_aliased_and_stands_where_it_must() -> None:
    stage = Stage(shaded_floor(SunLight("sun", WHITE, (0.3 / math.hypot(0.3, 1), 0, -1 / math.hypot(0.3, 1)))), 300)
    floor = stage.on_floor()
    light, place = stage.direct[floor, 0, 0], stage.world[floor]
    full = light.max()
    low, high = np.array([-0.2, -0.5]), np.array([0.8, 0.5])
    spacing = 4 / 144
    gap = np.maximum(low - place[:, :2], place[:, :2] - high).max(axis=1)
    assert (light[gap < -spacing] == 0).all()
    assert light[gap > spacing] == pytest.approx(full, rel=1e-5)
    dark = ((full - light) / full).sum() * spacing**2
    assert dark == pytest.approx(1.0, rel=0.01)
    assert np.count_nonzero((light > 0.05 * full) & (light < 0.95 * full)) > 60


def test_a_penumbra_is_as_wide_and_as_dark_as_the_lamp_makes_it() -> None:
    """A long lamp parallel to a long screen's edge: the share seen is linear across the penumbra."""
    lamp = AreaLight("lamp", WHITE, (0, 0, 2), (0.4, 0, 0), (0, 0.02, 0), (0, 0, -1))
    floor = mesh_of("floor", [quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))], [0])
    screen = mesh_of("screen", [quad((0, -9, 1), (9, 0, 0), (0, 18, 0))], [0])
    scene = Scene((floor, screen), (GREY,), (lamp,))
    stage = Stage(scene, 400)
    (bare,) = stage.lamps.lamps
    floor_texels = stage.on_floor()
    texels = stage.texels
    whole = bare.light(texels.position[floor_texels], texels.shading_normal[floor_texels], None)
    share = stage.direct[floor_texels, 0, 0] / whole
    x, y = stage.world[floor_texels, 0], stage.world[floor_texels, 1]
    middle = np.abs(y) < 0.5
    expected = np.clip((0.2 - x) / 0.4, 0, 1)[middle]
    error = share[middle] - expected
    assert np.sqrt(np.mean(error**2)) < 0.01
    assert np.abs(error).max() < 0.06
    assert abs(error.mean()) < 1e-3


@pytest.mark.parametrize("degrees", [0, 10, 31, 45, 72])
def test_a_penumbra_has_no_stripes_whatever_way_its_edge_runs(degrees: float) -> None:
    lamp = AreaLight("lamp", WHITE, (0, 0, 2), (0.8, 0, 0), (0, 0.8, 0), (0, 0, -1))
    across = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees)), 0])
    along = np.array([-across[1], across[0], 0])
    floor = mesh_of("floor", [quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))], [0])
    screen = mesh_of("screen", [quad(tuple(-9 * along + [0, 0, 1]), tuple(9 * across), tuple(18 * along))], [0])
    stage = Stage(Scene((floor, screen), (GREY,), (lamp,)), 400)
    (bare,) = stage.lamps.lamps
    chosen = stage.on_floor()
    place = stage.world[chosen]
    chosen = chosen[np.linalg.norm(place, axis=1) < 0.45]
    place = stage.world[chosen]
    whole = bare.light(stage.texels.position[chosen], stage.texels.shading_normal[chosen], None)
    share = stage.direct[chosen, 0, 0] / whole
    u, v = (grid.ravel() for grid in np.meshgrid(np.linspace(-0.398, 0.398, 100), np.linspace(-0.398, 0.398, 100)))
    spots = np.sort(u * across[0] + v * across[1])
    expected = np.searchsorted(spots, -(place @ across)) / len(spots)
    assert np.sqrt(np.mean((share - expected) ** 2)) < 0.02


def test_a_thin_pole_between_probes_does_not_vanish() -> None:
    floor = mesh_of("floor", [quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))], [0])
    pole = box("pole", (0.1, 0.1, 0), (0.13, 0.13, 1))
    light = PointLight("point", WHITE, (-1, -1, 2))
    stage = Stage(Scene((floor, pole), (GREY,), (light,)), 400, quality="draft")
    (bare,) = stage.lamps.lamps
    floor_texels = stage.on_floor()
    texels = stage.texels
    whole = bare.light(texels.position[floor_texels], texels.shading_normal[floor_texels], None)
    share = stage.direct[floor_texels, 0, 0] / whole
    along = (stage.world[floor_texels, 0] + stage.world[floor_texels, 1]) / 2
    across = stage.world[floor_texels, 0] - stage.world[floor_texels, 1]
    for distance in np.linspace(0.3, 1.0, 8):
        strip = (np.abs(along - distance) < 0.04) & (np.abs(across) < 0.06)
        assert share[strip].min() < 0.3


def test_what_stands_on_the_floor_casts_its_shadow_from_its_very_foot() -> None:
    floor = mesh_of("floor", [quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))], [0])
    block = box("block", (-0.5, -0.5, 0), (0.5, 0.5, 1))
    light = AreaLight("lamp", WHITE, (-3, 0, 3), (0.3, 0, 0), (0, 0.3, 0), (0.7071, 0, -0.7071))
    stage = Stage(Scene((floor, block), (GREY,), (light,)), 400)
    floor_texels = stage.on_floor()
    texels, (bare,) = stage.texels, stage.lamps.lamps
    whole = bare.light(texels.position[floor_texels], texels.shading_normal[floor_texels], None)
    place, share = stage.world[floor_texels], stage.direct[floor_texels, 0, 0] / whole
    behind = (np.abs(place[:, 1]) < 0.4) & (place[:, 0] > 0.53) & (place[:, 0] < 0.7)
    before = (np.abs(place[:, 1]) < 0.4) & (place[:, 0] < -0.53) & (place[:, 0] > -0.7)
    assert share[behind].max() == 0
    assert share[before].min() == pytest.approx(1, rel=1e-6)


def test_direct_light_does_not_depend_on_the_number_of_threads() -> None:
    scene = shaded_floor(replace(PANEL, position=(0, 0, 3)))
    for several in (scene, replace(scene, lights=(*scene.lights, replace(PANEL, position=(1, 0, 2))))):
        assert np.array_equal(Stage(several, threads=1).direct, Stage(several, threads=2).direct)


def test_lamps_superpose_and_each_lights_its_own_group() -> None:
    lights = (
        PointLight("a", (3, 2, 1), (-1, 0, 2), 0.2, group=1),
        SunLight("b", (1, 1, 4), (0, 0.6, -0.8), 0.1, group=0),
    )
    scene = replace(shaded_floor(lights[0]), lights=lights, groups=("", "other"))
    both = Stage(scene).direct
    for light in lights:
        alone = Stage(replace(scene, lights=(light,))).direct
        assert np.allclose(both[:, light.group], alone[:, light.group], rtol=1e-5)
        assert not alone[:, 1 - light.group].any()


def test_strength_scales_the_light_and_changes_no_ray() -> None:
    light = PointLight("a", (3, 2, 1), (-1, 0, 2), 0.2)
    one, ten = Stage(shaded_floor(light)), Stage(shaded_floor(replace(light, intensity=(30, 20, 10))))
    assert np.allclose(10 * one.direct, ten.direct, rtol=1e-5)
    assert one.visibility.rays == ten.visibility.rays


def test_a_lamp_that_faces_away_or_casts_no_shadow_costs_no_ray() -> None:
    away = replace(PANEL, position=(0, 0, 3), direction=(0, 0, 1))
    stage = Stage(shaded_floor(away))
    assert not stage.direct.any()
    assert stage.visibility.rays == 0
    stage = Stage(shaded_floor(replace(PANEL, position=(0, 0, 3), shadow=False)))
    assert stage.visibility.rays == 0
    assert stage.direct[stage.on_floor()].min() > 0


def test_texels_that_are_not_valid_stay_dark_and_send_no_rays() -> None:
    stage = Stage(shaded_floor(replace(PANEL, position=(0, 0, 3))))
    stage.texels = replace(stage.texels, valid=np.zeros(stage.texels.count, bool))
    before = stage.visibility.rays
    assert not stage.run().any()
    assert stage.visibility.rays == before


def test_irradiance_at_points_agrees_with_texels() -> None:
    stage = Stage(shaded_floor(replace(PANEL, position=(0, 0, 3))), quality="high")
    floor = stage.on_floor()[::7]
    texels = stage.texels
    lifted = texels.position[floor] + stage.surfaces.offset * texels.normal[floor]
    found = finish(irradiance_at(stage.lamps, lifted, texels.normal[floor], stage.visibility, 64, floor, 1))
    error = (found - stage.direct[floor])[:, 0, 0] / stage.direct[floor].max()
    assert np.sqrt(np.mean(error**2)) < 0.015
    assert abs(error.mean()) < 2e-3


def test_shifts_of_neighbouring_pixels_fill_the_square() -> None:
    x, y = (part.ravel() for part in np.meshgrid(np.arange(5), np.arange(5)))
    u, v = pixel_shifts((y + 3) * 64 + x + 7, 64)
    gap = np.stack([u[:, None] - u, v[:, None] - v])
    gap -= np.round(gap)
    distance = np.sqrt((gap**2).sum(0)) + np.eye(25)
    assert distance.min() > 0.16


@pytest.mark.parametrize("count", [1, 2, 16, 36, 144])
def test_the_lattice_is_even_on_both_axes(count: int) -> None:
    for values in lattice(count).T:
        assert sorted(np.round(values * count).astype(int)) == list(range(count))


@pytest.mark.parametrize("quality", QUALITIES)
def test_every_quality_lights_a_floor_with_a_ball(quality: str) -> None:
    """The number of rays to a lamp that hides part of itself is no round one."""
    floor = mesh_of("Floor", [quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))], [0])
    ball = sphere("Ball", 0.2, segments=24, rings=12)
    ball = replace(ball, vertices=ball.vertices + np.array([0, 0, 0.8]), material=np.ones_like(ball.material))
    post = box("Post", (0.3, 0.3, 0), (0.4, 0.4, 0.5))
    scene = Scene((floor, ball, post), (Material("Grey"), Material("Glow", emission=(5.0, 5.0, 5.0))))
    surfaces = flatten(scene)
    scene = scene.moved(-surfaces.origin)
    texels = finish(rasterize(cell_atlas(scene, 256, margin=1), surfaces))
    settings = BakeSettings(page_size=256, quality=quality)
    light = finish(direct_irradiance(lamps_of(scene, surfaces), texels, Visibility(surfaces.corners), settings, 1))
    at_floor = surfaces.mesh[texels.triangle[:]] == 0
    assert 0.5 < light[at_floor].max() < 5 * np.pi
    assert light[at_floor].min() < 0.7 * light[at_floor].max()
