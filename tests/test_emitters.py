# SPDX-License-Identifier: GPL-3.0-or-later
"""Emissive meshes as lamps: their light is that of their triangles, near and far."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.arrays import Float32
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.lighting.emitter_tree import Blocks
from radiosity_addon.lighting.lamps import Lamp
from radiosity_addon.lighting.lights import lamps_of
from radiosity_addon.lighting.mesh_lamp import MeshLamp
from radiosity_addon.lighting.polygons import Polygon, cap_light, convex_polygon, polygon_light
from radiosity_addon.scene import Material, Mesh, Scene
from tests.lamps import GREY, PANEL, WHITE, ball, by_samples, lamp_of, receivers, unit
from tests.shapes import box, mesh_of, quad


def test_a_small_emissive_mesh_is_polygons_and_shines_to_both_sides() -> None:
    glow = Material("Glow", emission=(2, 2, 2))
    panel = mesh_of("panel", [quad((-0.5, -0.35, 0), (1, 0, 0), (0, 0.7, 0))], [0])
    wall = mesh_of("wall", [quad((-20, -20, 0), (40, 0, 0), (0, 40, 0))], [1])
    lamps = lamp_of(meshes=(panel, wall), materials=(glow, GREY))
    (lamp,) = lamps.lamps
    assert lamps.sampled.tolist() == [True, True, False, False]
    points = np.array([[0.1, 0, -1], [0.1, 0, 1]], np.float32)
    normals = np.array([[0, 0, 1], [0, 0, -1]], np.float32)
    (same,) = lamp_of(replace(PANEL, position=(0, 0, 0))).lamps
    expected = same.light(points[:1], normals[:1], None)[0]
    assert lamp.light(points, normals, None) == pytest.approx([expected, expected], rel=1e-5)
    assert lamp.strength == (2, 2, 2)


@pytest.mark.parametrize("outward", [True, False], ids=["outward", "inward"])
@pytest.mark.parametrize("rings", [6, 24])
def test_an_emissive_ball_lights_like_a_sphere_of_its_area(rings: int, outward: bool) -> None:
    glow = Material("Glow", emission=WHITE)
    wall = mesh_of(
        "wall", [quad((-20, -20, -20), (40, 0, 0), (0, 40, 0)), quad((20, 20, 20), (40, 0, 0), (0, 40, 0))], [1, 1]
    )
    shape = ball(0.5, rings, outward)
    scene = Scene((shape, wall), (glow, GREY))
    surfaces = flatten(scene)
    (lamp,) = lamps_of(scene.moved(-surfaces.origin), surfaces).lamps
    points, normals, _ = receivers(4000)
    points[:, 2] = -0.9 - np.abs(points[:, 0])
    way = -points
    distance = np.linalg.norm(way, axis=1)
    radius = math.sqrt(surfaces.area[: len(shape.triangles)].sum() / (4 * math.pi))
    cosine = ((way * normals).sum(1) / distance).astype(np.float32)
    expected = cap_light(cosine, ((radius / distance) ** 2).astype(np.float32))
    found = lamp.light((points - surfaces.origin).astype(np.float32), normals, None)
    assert found.sum() == pytest.approx(expected.sum(), rel=0.01)
    assert np.abs(found - expected).max() < 0.02 * expected.max()


def ball_lamp(rings: int) -> tuple[Lamp, float, np.ndarray]:
    """A glowing ball of 0.5 m, the radius of the sphere of its area, and the scene's origin."""
    wall = mesh_of("wall", [quad((-90, -90, -90), (180, 0, 0), (0, 180, 0))], [1])
    scene = Scene((ball(0.5, rings), wall), (Material("Glow", emission=WHITE), GREY))
    surfaces = flatten(scene)
    (lamp,) = lamps_of(scene.moved(-surfaces.origin), surfaces).lamps
    return lamp, math.sqrt(surfaces.area[: len(scene.meshes[0].triangles)].sum() / (4 * math.pi)), surfaces.origin


def far_ball(rings: int) -> tuple[Lamp, np.ndarray, np.ndarray, np.ndarray]:
    """A glowing ball, points 5 to 100 radii away that see all of it, their normals, and the light of a sphere."""
    lamp, radius, origin = ball_lamp(rings)
    rng = np.random.default_rng(3)
    away = unit(rng.normal(size=(2000, 3)))
    points = away * np.geomspace(2.6, 50, 2000)[:, None]
    normals = unit(-away + 0.5 * unit(rng.normal(size=(2000, 3))))
    light = math.pi * radius**2 * (-points * normals).sum(1) / np.linalg.norm(points, axis=1) ** 3
    return lamp, (points - origin).astype(np.float32), normals, light


def test_from_afar_an_emissive_ball_is_a_sphere_to_half_a_percent() -> None:
    lamp, points, normals, expected = far_ball(24)
    assert lamp.light(points, normals, None) == pytest.approx(expected, rel=5e-3)


def tube_lamp(radius: float, around: int, closed: bool = True) -> tuple[Lamp, list[Polygon], Float32]:
    """A glowing tube 2 m long about the x axis, its triangles as polygons, and the scene's origin.

    Without `closed` it is the lower half of a tube, which shines to both sides.
    """
    along = 20
    cells = around if closed else around // 2
    turn, x = -np.arange(around) * (2 * math.pi / around), np.linspace(-1, 1, along + 1)
    wheel = np.stack([np.zeros(around), radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    vertices = (wheel + x[:, None, None] * np.array([1.0, 0, 0])).reshape(-1, 3)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(along), np.arange(cells), indexing="ij"))
    a, b = around * i + j, around * i + (j + 1) % around
    faces = [np.stack([a, b, b + around], axis=1), np.stack([a, b + around, a + around], axis=1)]
    if closed:
        vertices = np.concatenate([vertices, [[-1, 0, 0], [1, 0, 0]]])
        k, n = np.arange(around), (np.arange(around) + 1) % around
        ends = len(vertices) - 2 + np.zeros_like(k), len(vertices) - 1 + np.zeros_like(k)
        faces += [
            np.stack([n, k, ends[0]], axis=1),
            np.stack([around * along + k, around * along + n, ends[1]], axis=1),
        ]
    triangles = np.concatenate(faces).astype(np.int32)
    corners = vertices[triangles]
    normals = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    count = len(triangles)
    numbers = np.arange(count, dtype=np.int32)
    zeros = np.zeros(count, np.int32)
    wall = mesh_of("wall", [quad((-90, -90, -90), (180, 0, 0), (0, 180, 0))], [1])
    tube = Mesh("tube", vertices, triangles, np.repeat(normals[:, None], 3, axis=1), zeros, numbers, triangles.copy())
    scene = Scene((tube, wall), (Material("Glow", emission=WHITE), GREY))
    surfaces = flatten(scene)
    (lamp,) = lamps_of(scene.moved(-surfaces.origin), surfaces).lamps
    return lamp, [convex_polygon(triangle, two_sided=not closed) for triangle in corners], surfaces.origin


@pytest.mark.parametrize("height", [2, 4, 8])
@pytest.mark.parametrize("around", [12, 24])
def test_an_emissive_tube_gives_the_light_of_its_triangles(around: int, height: float) -> None:
    lamp, polygons, origin = tube_lamp(0.05, around)
    points, normals, _ = receivers(300)
    points[:, 2] = -height
    expected = np.sum([polygon_light(polygon, points, normals) for polygon in polygons], axis=0)
    found = lamp.light((points - origin).astype(np.float32), normals, None)
    assert found.sum() == pytest.approx(expected.sum(), rel=3e-3)
    assert np.abs(found - expected).max() < 0.03 * expected.mean()


def test_faces_of_a_tube_are_one_point_each_from_afar_and_polygons_from_near() -> None:
    lamp, polygons, origin = tube_lamp(0.05, 12)
    assert isinstance(lamp, MeshLamp)
    assert lamp.tree is not None
    normals = np.array([[0, 0, 1], [0, 0, 1], [0.6, 0, 0.8]], np.float32)
    for height, expected in ((0.1, {0, 1, 4}), (3.0, {1})):
        points = np.array([[0.1, 0.02, -height], [-0.3, 0.01, -height], [0.2, 0, -height]], np.float32)
        blocks = Blocks.of((points - origin).astype(np.float32).T[:, :, None], [normals.T[:, :, None]])
        assert set(lamp.tree.cut(blocks)[2].tolist()) == expected
        faces = np.sum([polygon_light(polygon, points, normals) for polygon in polygons], axis=0)
        assert lamp.light((points - origin).astype(np.float32), normals, None) == pytest.approx(faces, rel=1e-3)


@pytest.mark.parametrize("closed", [True, False], ids=["tube", "trough"])
def test_from_afar_a_tube_gives_the_light_of_its_triangles_to_all_sides(closed: bool) -> None:
    lamp, polygons, origin = tube_lamp(0.05, 16, closed)
    away = unit(np.random.default_rng(5).normal(size=(300, 3)))
    points = 9 * away
    expected = np.sum([polygon_light(polygon, points, -away) for polygon in polygons], axis=0)
    found = lamp.light((points - origin).astype(np.float32), -away, None)
    assert found.sum() == pytest.approx(expected.sum(), rel=3e-3)
    assert np.abs(found - expected).max() < 0.03 * expected.mean()


@pytest.mark.parametrize("radii", [4, 6, 8])
def test_an_emissive_ball_seen_along_an_axis_is_a_sphere_to_a_percent(radii: float) -> None:
    lamp, radius, origin = ball_lamp(24)
    away = np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32)
    points = (radius * radii * away - origin).astype(np.float32)
    found = [lamp.light(points[k : k + 1], -away[k : k + 1], None)[0] for k in range(6)]  # each with a cut of its own
    assert found == pytest.approx(np.full(6, math.pi / radii**2), rel=1e-2)


@pytest.mark.parametrize("rings", [6, 24])
def test_the_samples_of_an_emissive_ball_have_its_light_as_their_mean(rings: int) -> None:
    lamp, points, normals, _ = far_ball(rings)
    closed, sampled = lamp.light(points, normals, None), by_samples(lamp, points, [normals], 987)
    assert sampled / closed == pytest.approx(np.ones(len(points)), abs=0.04)
    assert np.mean(sampled / closed) == pytest.approx(1, abs=5e-3)


def test_inside_a_glowing_ball_all_of_its_inside_shines() -> None:
    glow = Material("Glow", emission=WHITE)
    wall = mesh_of(
        "wall", [quad((-20, -20, -20), (40, 0, 0), (0, 40, 0)), quad((20, 20, 20), (40, 0, 0), (0, 40, 0))], [1, 1]
    )
    scene = Scene((ball(1.0, 16), wall), (glow, GREY))
    surfaces = flatten(scene)
    (lamp,) = lamps_of(scene.moved(-surfaces.origin), surfaces).lamps
    points = (np.array([[0, 0, 0], [0.3, 0.2, 0.1]]) - surfaces.origin).astype(np.float32)
    normals = np.array([[0, 0, 1], [0, 1, 0]], np.float32)
    assert lamp.light(points, normals, None) == pytest.approx([math.pi] * 2, rel=0.02)


def test_an_emitter_of_most_of_the_scene_is_left_to_the_gather() -> None:
    room = box("room", (0, 0, 0), (1, 1, 1), inward=True)
    lamps = lamp_of(meshes=(room,), materials=(Material("Glow", emission=WHITE),))
    assert lamps.lamps == ()
    assert not lamps.sampled.any()


@pytest.mark.parametrize("turned", range(6))
@pytest.mark.parametrize("rings", [0, 3, 24])
def test_an_emitter_does_not_light_the_surface_it_is(rings: int, turned: int) -> None:
    rng = np.random.default_rng(turned)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    shape = ball(0.5, rings) if rings else mesh_of("panel", [quad((-0.5, -0.35, 0), (1, 0, 0), (0, 0.7, 0))], [0])
    shape = replace(shape, vertices=shape.vertices @ turn.T + rng.uniform(-3, 3, 3))
    wall = mesh_of("wall", [quad((-20, -20, -9), (40, 0, 0), (0, 40, 0))], [1])
    scene = Scene((shape, wall), (Material("Glow", emission=WHITE), GREY))
    surfaces = flatten(scene)
    (lamp,) = lamps_of(scene.moved(-surfaces.origin), surfaces).lamps
    own = surfaces.corners[: len(shape.triangles)]
    weights = rng.dirichlet([1, 1, 1], (len(own), 7)).astype(np.float32)
    points = np.einsum("fkc,fcx->fkx", weights, own).reshape(-1, 3)
    normals = np.repeat(surfaces.normal[: len(own)], 7, axis=0)
    assert lamp.light(points, normals, None).max() < 0.01
    assert lamp.light(points, -normals, None).max() < (math.inf if rings else 0.01)
