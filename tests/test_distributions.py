# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps that are not alike in all directions or fall off by a law of their own, against formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.lighting.distributions import flat_octahedron, on_octahedron
from radiosity_addon.lighting.lights import irradiance_at, lamps_of
from radiosity_addon.scene import Distribution, Light, PointLight, Scene, SpotLight
from tests.lamps import GREY, WHITE, by_samples, lamp_of, receivers
from tests.shapes import mesh_of, quad

DOWN = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
LEVEL = ((1.0, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, -1.0))
UP = np.array([[0, 0, 1]], np.float32)


def directions(size: int, reach: float = 1.0) -> np.ndarray:
    """Unit directions (size, size, 3) of a picture's texels."""
    along = ((np.arange(size) + 0.5) / size * 2 - 1) * reach
    points = on_octahedron(np.stack(np.meshgrid(along, along), axis=-1))
    return points / np.linalg.norm(points, axis=-1, keepdims=True)


def lobe(size: int = 256, reach: float = 1.0, falloff: float | None = None, **values: object) -> Distribution:
    """Bright along z, and more so towards +x: a cosine squared, and a fifth of it by the side."""
    x, _, z = np.moveaxis(directions(size, reach), -1, 0)
    law = None
    if falloff is not None:
        distance = np.geomspace(0.01, 100, 33)
        law = np.stack([distance, distance**falloff], axis=1)
    picture = np.float32(np.maximum(z, 0) ** 2 * (1 + 0.2 * x))[:, :, None]
    return Distribution(picture, DOWN, reach, law, **values)


def shape_of(way: np.ndarray) -> np.ndarray:
    """The lobe's factor along unit ways (P, 3)."""
    x, z = way[:, 0], -way[:, 2]
    return np.maximum(z, 0) ** 2 * (1 + 0.2 * x)


def test_directions_come_back_from_the_flat_octahedron() -> None:
    found = np.random.default_rng(1).normal(size=(500, 3))
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    back = on_octahedron(flat_octahedron(found))
    np.testing.assert_allclose(back / np.linalg.norm(back, axis=1, keepdims=True), found, atol=1e-12)


@pytest.mark.parametrize("reach", [1.0, 0.45])
def test_a_points_light_is_multiplied_with_the_factor_of_its_direction(reach: float) -> None:
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (400, 3)).astype(np.float32)
    points[:, 2] = 0
    (lamp,) = lamp_of(PointLight("point", WHITE, (0, 0, 1.5), distribution=lobe(reach=reach))).lamps
    way = points - [0, 0, 1.5]
    distance = np.linalg.norm(way, axis=1)
    expected = shape_of(way / distance[:, None]) * 1.5 / distance**3
    np.testing.assert_allclose(lamp.light(points, np.tile(UP, (400, 1)), None), expected, rtol=1e-3)


def test_the_picture_goes_on_across_the_octahedrons_folded_edges() -> None:
    """All around a lamp whose light depends on all of x, y and z, no direction is off."""
    size = 128
    picture = np.float32(0.5 + directions(size) @ [0.2, 0.1, 0.15])[:, :, None]
    (lamp,) = lamp_of(PointLight("p", WHITE, (0, 0, 0), distribution=Distribution(picture, DOWN))).lamps
    way = np.random.default_rng(3).normal(size=(4000, 3))
    way = np.float32(way / np.linalg.norm(way, axis=1, keepdims=True))
    expected = 0.5 + way.astype(float) @ np.array(DOWN).T @ [0.2, 0.1, 0.15]
    np.testing.assert_allclose(lamp.light(way, -way, None), expected, rtol=6e-3)


@pytest.mark.parametrize("power", [1.0, 2.0])
def test_light_falls_off_as_its_law_says(power: float) -> None:
    (lamp,) = lamp_of(PointLight("point", WHITE, (0, 0, 0), distribution=lobe(falloff=power))).lamps
    below = np.float32([[0, 0, -0.3], [0, 0, -1], [0, 0, -7.7]])
    found = lamp.light(below, np.tile(UP, (3, 1)), None)
    np.testing.assert_allclose(found, np.abs(below[:, 2]) ** (power - 2), rtol=1e-3)


SHAPED: dict[str, Light] = {
    "point": PointLight("p", WHITE, (0, 0, 1.5), distribution=lobe()),
    "soft point": PointLight("p", WHITE, (0, 0, 1.5), 0.4, distribution=lobe(falloff=1)),
    "sphere": PointLight("p", WHITE, (0, 0, 1.5), 0.4, soft_falloff=False, distribution=lobe()),
    "sphere by its normals": PointLight(
        "p", WHITE, (0, 0, 1.5), 0.4, soft_falloff=False, distribution=lobe(on_sphere=True)
    ),
    "soft spot": SpotLight("s", WHITE, (0, 0, 1.5), LEVEL, 1.2, 0.5, 0.1, distribution=lobe(reach=0.45)),
}


@pytest.mark.parametrize("name", SHAPED)
@pytest.mark.parametrize("bent", [False, True], ids=["flat", "bent normals"])
def test_light_is_the_mean_of_the_samples_that_shadow_rays_aim_at(name: str, bent: bool) -> None:
    points, shading, geometric = receivers()
    (lamp,) = lamp_of(SHAPED[name]).lamps
    closed = lamp.light(points, shading, geometric) if bent else lamp.light(points, shading, None)
    sampled = by_samples(lamp, points, [shading, geometric] if bent else [shading], 610)
    assert closed.sum() == pytest.approx(sampled.sum(), rel=2e-3)
    assert np.sqrt(np.mean((closed - sampled) ** 2)) < 4e-3 * sampled.max()


def test_a_sharp_edge_in_a_soft_lamps_light_is_found() -> None:
    """Receivers in the half shadow of an edge: few points over the lamp would see steps."""
    sharp = np.float32(directions(512)[:, :, :1] > 0)
    light = PointLight("p", WHITE, (0, 0, 1.5), 0.3, distribution=Distribution(sharp, DOWN))
    (lamp,) = lamp_of(light).lamps
    points = np.zeros((200, 3), np.float32)
    points[:, 0] = np.linspace(-0.35, 0.35, 200)
    normals = np.tile(UP, (200, 1))
    closed, sampled = lamp.light(points, normals, None), by_samples(lamp, points, [normals], 4181)
    assert np.abs(closed - sampled).max() < 0.02 * sampled.max()
    assert (closed[0], closed[-1] > 0.3) == (0, True)


def test_colours_shine_apart_and_only_on_what_their_lamp_lights() -> None:
    floor = [mesh_of(name, [quad((x, -1, 0), (1, 0, 0), (0, 2, 0))], [0]) for name, x in (("one", -1), ("two", 0))]
    picture = lobe(64).directions * np.float32([1, 0.5, 0.25])
    light = PointLight("p", (2.0, 1.0, 4.0), (0, 0, 1), distribution=replace(lobe(), directions=picture))
    plain = PointLight("q", WHITE, (0, 0, 1), distribution=lobe(64))
    scene = Scene(tuple(floor), (GREY,), (plain, light), receivers={1: frozenset({0})})
    surfaces = flatten(scene)
    lamps = lamps_of(scene.moved(-surfaces.origin), surfaces)
    assert len(lamps.lamps) == 4
    points = np.float32([[-0.3, 0, 1e-4], [0.3, 0, 1e-4]]) - surfaces.origin.astype(np.float32)
    triangle, ids = np.array([0, 2], np.int32), np.arange(2)
    visibility = Visibility(surfaces.corners)
    found = finish(irradiance_at(lamps, points, np.tile(UP, (2, 1)), visibility, 16, ids, 1, triangle))[:, 0]
    alone = found[1, 0]
    np.testing.assert_allclose(found[1], alone, rtol=1e-5)
    one = lamps.lamps[0].light(points[:1], UP, None)[0]
    np.testing.assert_allclose(found[0], one * (1 + np.array([2, 0.5, 1])), rtol=1e-5)
