# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures that shine: the same light as from panels of the same colours, each part counted once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.arrays import Float32, Float64
from radiosity_addon.bake import Baked, bake
from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.transmittance import transmittance_of
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.lighting.companies import companies_of
from radiosity_addon.lighting.glow import glow_of
from radiosity_addon.lighting.lights import Lamps, irradiance_at, lamps_of
from radiosity_addon.lighting.mesh_lamp import MeshLamp
from radiosity_addon.scene import Material, Mesh, Scene
from radiosity_addon.settings import BakeSettings
from tests.lamps import ball
from tests.painting import Painter
from tests.shapes import box, mesh_of, quad

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

VARIED = Material("Screen", (0.0,) * 3, (1.0,) * 3, varies=frozenset({"emission"}))
RED, GREEN = (4.0, 0.5, 0.0), (0.2, 3.0, 0.1)


def screen(cuts: int = 1, material: int = 0):
    """2 m wide and 1 m high, of cuts x cuts quads, in the plane y = 0; it faces y."""
    step = np.array([2.0, 0, 1.0]) / cuts
    low = [(-1 + step[0] * i, 0, step[2] * j) for j in range(cuts) for i in range(cuts)]
    quads = [quad(corner, (0, 0, step[2]), (step[0], 0, 0)) for corner in low]
    return mesh_of("Screen", quads, np.full(len(quads), material))


def half_and_half(place: Float64) -> Float64:
    return np.where(place[..., :1] < 0, RED, GREEN)


def even(color):
    return lambda place: np.broadcast_to(color, place.shape)


def nearly(color):
    """A picture of one colour but for 1 % of its brightness: no constant does for it."""
    return lambda place: np.where(place[..., :1] < 0, 0.995, 1.005) * np.array(color)


def lamps(scene: Scene, shown=half_and_half) -> tuple[Lamps, Visibility, Float64]:
    surfaces = flatten(scene)
    painter = Painter(scene, {"emission": shown})
    moved = scene.moved(-surfaces.origin)
    glow, warnings = glow_of(moved, surfaces, painter)
    assert warnings == ()
    return lamps_of(moved, surfaces, (), glow), Visibility(surfaces.corners), surfaces.origin


def before_a_wall(mesh: Mesh, *materials: Material) -> Scene:
    """The scene of a mesh and a large black wall far behind it: emitters must be small to be lamps."""
    wall = mesh_of("Wall", [quad((-30, -40, -30), (60, 0, 0), (0, 0, 60))], len(materials))
    return Scene((mesh, wall), (*materials, Material("Black", (0.0,) * 3)))


def light_at(scene: Scene, points: Float64, normals: Float32, shown=half_and_half, rays: int = 16) -> Float32:
    found, visibility, origin = lamps(scene, shown)
    ids = np.arange(len(points))
    return finish(irradiance_at(found, (points - origin).astype(np.float32), normals, visibility, rays, ids, 1))[:, 0]


def receivers(count: int = 200) -> tuple[Float64, Float32]:
    """Points in front of the screen, from 0.1 to 20 m, that face it or the sides."""
    generator = np.random.default_rng(5)
    points = generator.uniform(-1, 1, (count, 3)) * np.geomspace(0.1, 20, count)[:, None]
    points[:, 1] = np.abs(points[:, 1]) + 0.05
    normals = generator.normal(size=(count, 3))
    normals[:, 1] = -np.abs(normals[:, 1])
    return points, (normals / np.linalg.norm(normals, axis=1)[:, None]).astype(np.float32)


@pytest.mark.parametrize("cuts", [1, 6])
def test_a_screen_of_two_colours_lights_as_two_panels_do(cuts):
    halves = [quad((-1 + k, 0, 0), (0, 0, 1), (1, 0, 0)) for k in range(2)]
    panels = mesh_of("Panels", halves, [0, 1])
    two = before_a_wall(panels, Material("R", (0,) * 3, RED), Material("G", (0,) * 3, GREEN))
    points, normals = receivers()
    expected = light_at(two, points, normals)
    found = light_at(before_a_wall(screen(cuts), VARIED), points, normals)
    assert np.abs(found - expected).max() < 0.01 * expected.max()
    lit = expected > 0.02 * expected.max()
    assert np.abs(found / np.where(lit, expected, 1) - 1)[lit].max() < 0.02


def test_what_hides_one_half_of_a_screen_leaves_the_colour_of_the_other():
    halves = [quad((-1 + k, 0, 0), (0, 0, 1), (1, 0, 0)) for k in range(2)]
    hidden = quad((-3, 0.5, -1), (0, 0, 3), (3, 0, 0))
    panels = mesh_of("Panels", [*halves, hidden], [0, 1, 2])
    two = before_a_wall(panels, Material("R", (0,) * 3, RED), Material("G", (0,) * 3, GREEN), Material("B", (0.0,) * 3))
    whole = quad((-1, 0, 0), (0, 0, 1), (2, 0, 0))
    points, normals = receivers()
    points[:, 1] = np.abs(points[:, 1]) + 0.6
    expected = light_at(two, points, normals, rays=128)
    shown = before_a_wall(mesh_of("Screen", [whole, hidden], [0, 1]), VARIED, Material("B", (0.0,) * 3))
    found = light_at(shown, points, normals, rays=128)
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.1 * np.sqrt(np.mean(expected**2))
    assert found.mean(0) == pytest.approx(expected.mean(0), rel=0.03)


def test_a_picture_of_one_colour_lights_as_that_constant():
    points, normals = receivers()
    constant = before_a_wall(screen(), Material("Lamp", (0,) * 3, RED))
    expected = light_at(constant, points, normals)
    pictures = before_a_wall(screen(), VARIED)
    found = light_at(pictures, points, normals, nearly(RED))
    assert np.abs(found - expected).max() < 0.01 * expected.max()
    found = light_at(pictures, points, normals, even(RED))
    assert found == pytest.approx(expected, rel=1e-5)
    assert not any(isinstance(lamp, MeshLamp) for lamp in lamps(pictures, even(RED))[0].lamps)


def test_an_emitter_of_one_colour_lights_its_own_faces_whether_a_picture_shows_it_or_a_constant():
    quads = [quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), quad((0, 0, 0), (0, 1, 0), (0, 0, 1))]
    corner = mesh_of("Corner", quads, [0, 0])
    pages = []
    for material in (VARIED, Material("Lamp", (0,) * 3, RED)):
        scene = before_a_wall(corner, material)
        painter = Painter(scene, {"emission": even(RED)})
        pages.append(finish(bake(scene, BakeSettings(page_size=64, quality="draft"), painter)).pages[0])
    assert pages[0] == pytest.approx(pages[1], rel=1e-5)


def test_from_afar_a_ball_of_many_colours_shows_each_side_its_own():
    """Beside the sum over its triangles, each a point: from one point for all, sides differed by nothing."""
    mesh = ball(1.0, 12)
    corners = mesh.vertices[mesh.triangles]
    middle = corners.mean(1)
    brightness = 0.51 + 0.5 * middle
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    scene = before_a_wall(mesh, VARIED)
    away = np.random.default_rng(5).normal(size=(100, 3))
    away /= np.linalg.norm(away, axis=1)[:, None]
    found, _, origin = lamps(scene, lambda place: 0.51 + 0.5 * place)
    expected = np.zeros((100, 3))
    for k, point in enumerate(60 * away):
        way = middle - point
        facing = np.maximum(-np.einsum("ij,ij->i", way, area), 0) * np.maximum(-way @ away[k], 0)
        expected[k] = facing / np.einsum("ij,ij->i", way, way) ** 2 @ brightness
    light = np.zeros((100, 3))
    for lamp in found.lamps:
        light += (
            lamp.light((60 * away - origin).astype(np.float32), -away.astype(np.float32), None)[:, None] * lamp.strength
        )
    assert np.sqrt(np.mean((light - expected) ** 2)) < 0.015 * expected.mean()


def test_colours_that_differ_only_in_brightness_are_one_lamp_and_others_one_a_channel():
    grey = lamps(before_a_wall(screen(), VARIED), lambda place: (place[..., :1] + 1) * np.array([0.5, 1, 0.25]))[0]
    both = lamps(before_a_wall(screen(), VARIED))[0]
    blue = lamps(before_a_wall(screen(), VARIED), lambda place: np.where(place[..., :1] < 0, (1, 0, 0), (0, 0.1, 0)))[0]
    assert [len(found.lamps) for found in (grey, both, blue)] == [1, 3, 2]


def test_the_colours_of_a_picture_share_their_shadow_rays():
    points, normals = receivers()
    traced = []
    for shown in (half_and_half, even(RED)):
        found, visibility, origin = lamps(before_a_wall(screen(), VARIED), shown)
        at = (points - origin).astype(np.float32)
        finish(irradiance_at(found, at, normals, visibility, 16, np.arange(len(points)), 1))
        traced.append(visibility.traced)
    assert traced[0] == pytest.approx(traced[1], rel=0.02)  # a sample may fall where a colour is black


def test_colours_that_lie_apart_have_more_samples_and_alike_ones_hardly_any_more():
    def made_good(shown) -> float:
        found = lamps(before_a_wall(screen(), VARIED), shown)[0]
        (company,) = companies_of(found.lamps, ())
        return company.lamp.hidden_share

    apart = made_good(lambda place: np.where(place[..., :1] < 0, (1, 0, 0), (0, 1, 0)))
    alike = made_good(lambda place: np.where(place[..., :1] < 0, (1, 0.9, 1), (0.9, 1, 1)))
    assert apart == pytest.approx(0.5, abs=0.01)  # half of the samples are for each colour
    assert 0 <= alike < 0.01


def test_a_coloured_pane_lets_each_colour_of_a_picture_through_by_its_own_share():
    pane = quad((-50, 0.01, -50), (0, 0, 100), (100, 0, 0))
    tint = np.array([0.1, 0.8, 0.4])
    scene = before_a_wall(screen(), VARIED)
    glass = Material("Glass", (0.0,) * 3, transmittance=tuple(tint))
    scene = replace(scene, meshes=(*scene.meshes, mesh_of("Pane", [pane], [2])), materials=(*scene.materials, glass))
    found, _, origin = lamps(scene)
    surfaces = flatten(scene)
    visibility = Visibility(surfaces.corners, transmittance_of(scene, surfaces, None, 1.0), surfaces.offset)
    assert visibility.channels == 3
    points, normals = receivers()
    points[:, 1] += 0.5
    places, ids = (points - origin).astype(np.float32), np.arange(len(points))
    seen = finish(irradiance_at(found, places, normals, visibility, 16, ids, 1))[:, 0]
    bare = finish(irradiance_at(found, places, normals, Visibility(surfaces.corners[:0]), 16, ids, 1))[:, 0]
    lit = bare.min(1) > 1e-3 * bare.max()
    assert np.abs(seen / np.where(lit[:, None], bare, 1) - tint)[lit].max() < 1e-5


def test_a_black_picture_is_no_lamp_and_is_not_looked_for_by_the_gather_either():
    found, _, _ = lamps(before_a_wall(screen(), VARIED), np.zeros_like)
    assert found.lamps == ()
    assert found.sampled[:2].all()


def test_a_body_that_shines_lights_from_its_outside_alone():
    body = replace(box("Lamp", (-0.5, -0.5, 0), (0.5, 0.5, 1)), material=np.zeros(12, np.int32))
    inside_out = replace(body, triangles=body.triangles[:, ::-1].copy(), corner_normals=-body.corner_normals)
    points, normals = receivers()
    points[:, 1] += 1
    expected = light_at(before_a_wall(body, Material("Lamp", (0,) * 3, GREEN)), points, normals)
    for mesh in (body, inside_out):
        found = light_at(before_a_wall(mesh, VARIED), points, normals, nearly(GREEN))
        assert np.abs(found - expected).max() < 0.02 * expected.max()


def baked(shown, lamp: Material) -> tuple[Baked, Painter]:
    room = box("Room", (-1.5, -0.01, -0.5), (1.5, 3, 2), 1, inward=True)
    scene = Scene((room, screen()), (lamp, Material("White", (0.6,) * 3)))
    painter = Painter(scene, {"emission": shown})
    return finish(bake(scene, BakeSettings(page_size=64, quality="draft"), painter)), painter


def test_a_bake_counts_a_picture_once():
    """A screen of one colour, as a picture and as a constant: the same light, to the noise of their shadows."""
    shown, painter = baked(nearly(RED), VARIED)
    plain, _ = baked(half_and_half, Material("Lamp", (0,) * 3, RED))
    assert painter.asked == ["emission"]
    total, expected = (float(page.pages[0].mean(dtype=np.float64)) for page in (shown, plain))
    assert total == pytest.approx(expected, rel=3e-3)
    assert np.sqrt(np.mean((shown.pages[0] - plain.pages[0]) ** 2)) < 0.02 * expected


def test_small_bright_windows_in_a_large_wall_are_lamps_and_a_wall_that_glows_all_over_is_none():
    """The screen is as large as all the rest."""
    wall = mesh_of("Wall", [quad((-1, -4, 0), (2, 0, 0), (0, 0, 1))], 1)
    scene = Scene((screen(), wall), (VARIED, Material("Black", (0.0,) * 3)))
    window = lambda place: np.where(np.abs(place[..., :1] - 0.5) < 0.1, 5.0, 0.001) * np.ones(3)  # noqa: E731
    assert len(lamps(scene, window)[0].lamps) == 1
    assert lamps(scene, np.ones_like)[0].lamps == ()


def test_a_room_whose_own_walls_glow_is_left_to_the_gather():
    """In a furnace of emission 1 and reflectance 0.5 every texel gets 2 pi, pictured or not."""
    glow = Material("Glow", (0.5,) * 3, (1.0,) * 3, varies=frozenset({"emission"}))
    scene = Scene((box("Room", (0, 0, 0), (1, 1, 1), inward=True),), (glow,))
    painter = Painter(scene, {"emission": np.ones_like})
    page = finish(bake(scene, BakeSettings(page_size=64, quality="draft", tolerance=1e-6), painter)).pages[0]
    assert painter.asked == ["emission", "emission"]  # what its triangles give, and what its texels show
    assert np.abs(page - 2).max() < 1e-4
