# SPDX-License-Identifier: GPL-3.0-or-later
"""What emitters throw on their own faces: all inside a hollow one, nothing on a round one, form factors between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.arrays import Float32
from radiosity_addon.atlas.unwrap import Atlas
from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import Texels, rasterize
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.lighting.glow import glow_of
from radiosity_addon.lighting.lights import Lamps, direct_irradiance, irradiance_at, lamps_of
from radiosity_addon.lighting.own_faces import is_hollow
from radiosity_addon.lighting.polygons import convex_polygon, polygon_light
from radiosity_addon.scene import Material, Mesh, Scene
from radiosity_addon.settings import BakeSettings
from tests.lamps import GREY, WHITE, ball
from tests.painting import Painter
from tests.shapes import cell_atlas, mesh_of, quad, sphere

GLOW = Material("Glow", emission=WHITE)
VARIED = Material("Picture", (0.0,) * 3, (1.0,) * 3, varies=frozenset({"emission"}))
WALL = mesh_of("Wall", [quad((-90, -90, -90), (180, 0, 0), (0, 180, 0))], [1])
"""So large that whatever glows before it is a lamp."""
FACING = 0.1998249
"""Form factor between opposite faces of a cube."""
SQUARES = [quad((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0)), quad((-0.5, -0.5, 1), (0, 1, 0), (1, 0, 0))]
"""Two such faces, which look at one another."""


def stage(shape: Mesh, painter: Painter | None = None, material: Material = GLOW) -> tuple[Lamps, Texels, Visibility]:
    scene = Scene((shape, WALL), (material, GREY))
    surfaces = flatten(scene)
    glow, _ = glow_of(scene, surfaces, painter)
    texels = finish(rasterize(atlas(scene), surfaces))
    return lamps_of(scene.moved(-surfaces.origin), surfaces, (), glow), texels, Visibility(surfaces.corners)


def atlas(scene: Scene) -> Atlas:
    return cell_atlas(scene, 128, 1)


def on_itself(shape: Mesh, painter: Painter | None = None, material: Material = GLOW) -> tuple[Float32, Texels]:
    """Direct light / pi (T, 3) on the texels of a mesh that glows, and these."""
    lamps, texels, visibility = stage(shape, painter, material)
    light = finish(direct_irradiance(lamps, texels, visibility, BakeSettings(), 1))[:, 0] / np.pi
    own = texels.surfaces.mesh[texels.triangle[:]] == 0
    return light[own], texels.only(np.flatnonzero(own), np.full(len(texels.texel_at), -1, np.int32))


@pytest.mark.parametrize("rings", [4, 8])
def test_a_smooth_ball_throws_nothing_on_itself(rings: int) -> None:
    """Its next facets are below the horizon, though not below that of the smooth normals."""
    light, _ = on_itself(sphere("Ball", segments=2 * rings, rings=rings, terminator=0.1))
    assert not light.any()


def test_all_that_the_inside_of_a_glowing_ball_sees_glows() -> None:
    inside = replace(ball(1.0, 6, outward=False))
    normals = (-inside.vertices[inside.triangles]).astype(np.float32)
    shape = replace(inside, corner_normals=normals, terminator=0.1)
    lamps, _, visibility = stage(shape)
    surfaces = lamps.surfaces
    triangle = np.arange(len(shape.triangles), dtype=np.int32)
    points = surfaces.corners[triangle].mean(1) + surfaces.normal[triangle] * np.float32(surfaces.offset)
    light = finish(irradiance_at(lamps, points, surfaces.normal[triangle], visibility, 64, triangle, 1, triangle))
    np.testing.assert_allclose(light[:, 0] / np.pi, 1, rtol=1e-5)


def test_facing_squares_of_one_emitter_light_one_another_by_their_form_factor() -> None:
    light, texels = on_itself(mesh_of("Squares", SQUARES, [0, 0]))
    assert np.average(light[:, 0], weights=texels.area) == pytest.approx(FACING, rel=2e-3)


def test_texels_share_their_rays_with_neighbours_and_keep_what_changes_evenly() -> None:
    """Each texel of a square against the closed form: by its own rays alone they err three times as much."""
    light, texels = on_itself(mesh_of("Squares", SQUARES, [0, 0]))
    lower = texels.normal[:][:, 2] > 0
    corners = np.array(SQUARES[1]) - texels.surfaces.origin
    up = np.tile(np.float32([0, 0, 1]), (int(lower.sum()), 1))
    expected = polygon_light(convex_polygon(corners), texels.position[lower], up) / np.pi
    error = light[lower, 0] - expected
    assert abs(error.mean()) < 3e-4
    assert np.sqrt(np.mean(error**2)) < 0.003


def test_backs_of_faces_are_lit_as_fronts_are() -> None:
    """The squares turned away from one another."""
    shape = mesh_of("Squares", [corners[::-1] for corners in SQUARES], [0, 0])
    lamps, texels, visibility = stage(shape)
    surfaces = texels.surfaces
    own = np.flatnonzero(surfaces.mesh[texels.triangle[:]] == 0)
    triangle, normal = texels.triangle[own], texels.normal[own]
    points = texels.position[own] - normal * np.float32(surfaces.offset)
    light = finish(irradiance_at(lamps, points, -normal, visibility, 64, own, 1, triangle))[:, 0, 0] / np.pi
    assert np.average(light, weights=texels.area[own]) == pytest.approx(FACING, rel=5e-3)


def test_a_picture_throws_on_itself_what_it_shows() -> None:
    """The lower square is red, the upper one black: only the upper one is lit."""
    shape = mesh_of("Squares", SQUARES, [0, 0])
    scene = Scene((shape, WALL), (VARIED, GREY))
    painter = Painter(scene, {"emission": lambda place: np.where(place[..., 2:] < 0.5, (4.0, 0.5, 0.0), 0.0)})
    light, texels = on_itself(shape, painter, VARIED)
    upper = texels.normal[:][:, 2] < 0
    mean = np.average(light[upper], axis=0, weights=texels.area[upper])
    np.testing.assert_allclose(mean, FACING * np.array([4.0, 0.5, 0.0]), rtol=5e-3)
    assert not light[~upper].any()


def test_panels_and_convex_bodies_are_not_looked_at() -> None:
    shapes = {
        "panel": mesh_of("P", SQUARES[:1], [0]),
        "fine panel": mesh_of("P", [quad((k, 0, 0), (1, 0, 0), (0, 1, 0)) for k in range(20)], [0] * 20),
        "ball": ball(1.0, 2),
        "squares": mesh_of("S", SQUARES, [0, 0]),
    }
    found = {
        name: is_hollow(np.asarray(shape.vertices[shape.triangles], np.float32), name == "ball")
        for name, shape in shapes.items()
    }
    assert found == {"panel": False, "fine panel": False, "ball": False, "squares": True}


def test_light_does_not_depend_on_the_number_of_threads() -> None:
    lamps, texels, visibility = stage(mesh_of("Squares", SQUARES, [0, 0]))
    one, three = (finish(direct_irradiance(lamps, texels, visibility, BakeSettings(threads=n), 1)) for n in (1, 3))
    np.testing.assert_array_equal(one, three)
