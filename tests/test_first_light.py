# SPDX-License-Identifier: GPL-3.0-or-later
"""First light: coarse, but physics all the same."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.geometry.sides import with_backs
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.radiosity.first_light import FirstLight, first_light
from radiosity_addon.radiosity.vertices import place_vertices
from radiosity_addon.scene import Material, PointLight, Scene, World
from tests.bakes import BLACK, WHITE, floor
from tests.shapes import box, furnished_room, sphere

MIDDLE = np.array([0], np.int32), np.array([[0.0, 0.5]], np.float32)
"""The middle of the floor, on its first triangle's diagonal."""


def light_of(scene: Scene) -> FirstLight:
    return finish(first_light(with_backs(scene)))


# vertices


def test_pieces_of_triangles_cover_them_once() -> None:
    surfaces = flatten(Scene((floor(), sphere("Ball")), (WHITE,)))
    vertices = place_vertices(surfaces, 0.37, 100_000)
    pieces, triangle = vertices.pieces()
    corners = surfaces.points(vertices.triangle, vertices.weights)[pieces].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.einsum("ij,ij->i", cross, surfaces.normal[triangle])
    assert np.bincount(triangle, facing / 2) == pytest.approx(surfaces.area, rel=1e-3)
    assert np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).max() < 0.37 * 1.5


def test_between_vertices_values_are_linear() -> None:
    """x, y and z of the vertices give the points back."""
    surfaces = flatten(Scene((floor(),), (WHITE,)))
    vertices = place_vertices(surfaces, 0.3, 100_000)
    places = surfaces.points(vertices.triangle, vertices.weights)[vertices.seat]
    rng = np.random.default_rng(1)
    weights = np.sort(rng.random((500, 2)), axis=1).astype(np.float32)
    weights[:, 1] -= weights[:, 0]
    triangle = rng.integers(0, 2, 500).astype(np.int32)
    found = vertices.between(places, triangle, weights)
    assert np.abs(found - surfaces.points(triangle, weights)).max() < 1e-5


def test_samples_are_no_more_than_asked_for() -> None:
    surfaces = flatten(Scene((floor(),), (WHITE,)))
    assert place_vertices(surfaces, 0.1, 100_000).count > 600
    assert place_vertices(surfaces, 0.1, 300).count <= 300


# light


def test_a_point_lamp_lights_the_floor_below_as_the_closed_form_has_it() -> None:
    """H = I / d^2."""
    light = light_of(Scene((floor(),), (BLACK,), (PointLight("Lamp", (9.0, 9.0, 9.0), (0, 0, 3)),)))
    assert light.vertices.between(light.direct, *MIDDLE) == pytest.approx(1.0, rel=0.01)
    assert not light.indirect.any()


@pytest.mark.parametrize("reflectance, expected", [(0.5, 2.0), (0.7, 10 / 3)])
def test_furnace(reflectance: float, expected: float) -> None:
    """Closed, E = 1 and rho uniform: H = E / (1 - rho) everywhere, to the last bounce that is counted."""
    glow = Material("Glow", (reflectance,) * 3, (1 / np.pi,) * 3)
    light = light_of(Scene((box("Room", (0, 0, 0), (3, 2, 1), inward=True),), (glow,)))
    assert (light.direct + light.indirect).mean() == pytest.approx(expected, rel=0.05)


def test_an_open_floor_sees_the_whole_sky() -> None:
    """H = pi L."""
    light = light_of(Scene((floor(),), (WHITE,), world=World((1.0, 2.0, 3.0))))
    assert light.indirect == pytest.approx(np.pi * np.array([[1.0, 2.0, 3.0]]) * np.ones_like(light.indirect), rel=1e-5)


def test_what_sinks_into_the_floor_is_not_as_dark_as_what_is_below() -> None:
    """A skirting board, 5 mm deep in the boards: its side sees half of a sky of 1 and a floor that is lit by it."""
    skirting = box("Skirting", (-9.0, -0.01, -0.005), (9.0, 0.01, 0.09))
    light = light_of(
        Scene((box("Floor", (-10, -10, -1), (10, 10, 0)), skirting), (WHITE,), world=World((1.0, 1.0, 1.0)))
    )
    vertices = light.vertices
    height = vertices.surfaces.points(vertices.triangle, vertices.weights)[:, 2] + vertices.surfaces.origin[2]
    side = vertices.surfaces.normal[vertices.triangle, 1] < -0.99
    assert light.indirect[vertices.sample[side & (height > 0.01)]].min() > 1


def test_backs_of_two_sided_meshes_have_light_of_their_own() -> None:
    """A lamp below lights the back of the floor only."""
    lamp = PointLight("Lamp", (9.0, 9.0, 9.0), (0, 0, -3))
    light = light_of(Scene((floor(two_sided=True),), (WHITE,), (lamp,)))
    mesh = light.vertices.surfaces.mesh[light.vertices.triangle[light.vertices.seat]]
    assert light.direct[mesh == 0].max() == 0
    assert light.direct[mesh == 1].min() > 0.3


def test_a_glimpse_comes_before_it_and_has_its_light_from_fewer_samples_and_rays() -> None:
    steps = first_light(with_backs(furnished_room()))
    glimpse = next(light for light in steps if light is not None)
    light = finish(steps)
    for part in ("direct", "indirect"):
        early, late = getattr(glimpse, part), getattr(light, part)
        assert early.mean() == pytest.approx(late.mean(), rel=0.05)
        assert not np.array_equal(early, late)


def test_it_does_not_depend_on_chance() -> None:
    one, other = light_of(furnished_room()), light_of(furnished_room())
    assert np.array_equal(one.radiance, other.radiance)
