# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials whose two faces look unlike: each side reflects and shines by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.arrays import Bools, Float32
from radiosity_addon.chunks import finish
from radiosity_addon.geometry.appearance import appearance_of
from radiosity_addon.geometry.opacity import opacity_of
from radiosity_addon.geometry.sides import with_backs
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import rasterize
from radiosity_addon.geometry.transmittance import transmittance_of
from radiosity_addon.geometry.validity import solid_triangles
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.lighting.glow import glow_of
from radiosity_addon.lighting.lights import irradiance_at, lamps_of
from radiosity_addon.lighting.polygons import parallelogram, polygon_light
from radiosity_addon.scene import Material, Mesh, Scene, SunLight, World
from radiosity_addon.shading import Layout, Quantity
from tests.bakes import BLACK, floor, lit
from tests.shapes import box, cell_atlas, mesh_of, quad

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

RED, GREEN, DARK = (4.0, 0.5, 0.0), (0.2, 3.0, 0.1), (0.0, 0.0, 0.0)
WALL = mesh_of("Wall", [quad((-90, -90, -90), (180, 0, 0), (0, 180, 0))], [0])
"""So large that whatever shines before it is a lamp."""
FACING = 0.1998249
"""Form factor between opposite faces of a cube."""


def panel(cuts: int = 1) -> Mesh:
    """1 m x 0.7 m of cuts x cuts quads, which faces up."""
    step = np.array([1, 0.7, 0]) / cuts
    low = [(-0.5 + step[0] * i, -0.35 + step[1] * j, 0) for j in range(cuts) for i in range(cuts)]
    return mesh_of("Panel", [quad(corner, (step[0], 0, 0), (0, step[1], 0)) for corner in low], np.ones(cuts**2))


class Faces:
    """A shader that shows a colour on fronts and another on backs."""

    def __init__(self, front: tuple[float, ...], back: tuple[float, ...]) -> None:
        self.colors = {False: front, True: back}
        self.asked: list[tuple[Quantity, bool]] = []

    def __call__(self, layout: Layout, meshes: Bools, quantity: Quantity, behind: bool = False) -> Float32:
        self.asked.append((quantity, behind))
        return np.tile(np.float32(self.colors[behind]), (layout.page_count, layout.size, layout.size, 1))


def glowing(front: tuple[float, ...], back: tuple[float, ...], varies: bool = False) -> tuple[Material, ...]:
    """What the wall and the panel are made of, the panel's back last."""
    some = frozenset({"emission"}) if varies else frozenset()
    look = Material("Panel", DARK, (1.0,) * 3 if varies else front, varies=some)
    return BLACK, replace(look, back=2), replace(look, emission=(1.0,) * 3 if varies else back)


def light_of(
    mesh: Mesh, materials: tuple[Material, ...], shade: Faces | None, points, normals, triangle=None
) -> Float32:
    scene = Scene((mesh, WALL), materials)
    surfaces = flatten(scene)
    scene = scene.moved(-surfaces.origin)
    lamps = lamps_of(scene, surfaces, (), glow_of(scene, surfaces, shade)[0])
    assert lamps.sampled[: len(mesh.triangles)].all()
    places, ids = (points - surfaces.origin).astype(np.float32), np.arange(len(points))
    lit_by = irradiance_at(lamps, places, normals, Visibility(surfaces.corners), 64, ids, 1, triangle)
    return finish(lit_by)[:, 0]


@pytest.mark.parametrize("shown", ["panel", "mesh", "picture"])
@pytest.mark.parametrize(("front", "back"), [(RED, DARK), (DARK, GREEN), (RED, GREEN)])
def test_each_side_of_a_panel_shines_by_its_closed_form(shown: str, front, back) -> None:
    generator = np.random.default_rng(4)
    points = generator.uniform(-1, 1, (200, 3))
    points[:, 2] = np.abs(points[:, 2]) + 0.3
    points[::2, 2] *= -1
    normals = np.zeros((200, 3), np.float32)
    normals[:, 2] = -np.sign(points[:, 2])
    shade = Faces(front, back) if shown == "picture" else None
    found = light_of(
        panel(6 if shown == "mesh" else 1), glowing(front, back, shade is not None), shade, points, normals
    )
    both = parallelogram(np.array([-0.5, -0.35, 0]), np.array([1.0, 0, 0]), np.array([0, 0.7, 0]), two_sided=True)
    share = polygon_light(both, points.astype(np.float32), normals)[:, None]
    expected = share * np.where(points[:, 2:] > 0, front, back)
    assert np.abs(found - expected).max() < 0.01 * share.max() * 4
    assert (found[expected == 0] == 0).all()


@pytest.mark.parametrize("picture", [False, True], ids=["constant", "picture"])
@pytest.mark.parametrize(("front", "back"), [(RED, DARK), (DARK, RED), (GREEN, RED)])
def test_an_emitter_throws_on_itself_what_its_faces_that_see_one_another_have(picture, front, back) -> None:
    squares = [quad((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0)), quad((-0.5, -0.5, 1), (0, 1, 0), (1, 0, 0))]
    shade = Faces(front, back) if picture else None
    lower = np.random.default_rng(3).uniform(-0.5, 0.5, (4000, 3)) * [1, 1, 0] + [0, 0, 1e-4]
    up = np.tile(np.float32([0, 0, 1]), (4000, 1))
    materials = glowing(front, back, picture)
    triangle = np.where(lower[:, 0] > lower[:, 1], 0, 1).astype(np.int32)
    found = light_of(mesh_of("Pair", squares, [1, 1]), materials, shade, lower, up, triangle)
    assert found.mean(0, dtype=np.float64) / np.pi == pytest.approx(FACING * np.array(front), rel=0.01)


@pytest.mark.parametrize("lamp", [False, True], ids=["found by rays", "lamp"])
def test_a_furnace_with_sheets_of_unlike_faces_is_even(lamp: bool) -> None:
    """E = 1/2, rho = 1/2 on the walls and in front, E = 0.8, rho = 0.2 behind: all send out 1."""
    wall = Material("Wall", (0.5,) * 3, (0.5,) * 3)
    sheet = replace(wall, back=2)
    behind = Material("Back", (0.2,) * 3, (0.8,) * 3)
    room = box("Room", (0, 0, 0), (1, 1, 1), inward=True)
    size = 0.4 if lamp else 0.9
    low = 0.5 - size / 2
    cards = [quad((low, low, z), (size, 0, 0), (0, size, 0)) for z in ((0.5,) if lamp else (0.3, 0.5, 0.7))]
    found = lit(Scene((room, mesh_of("Sheet", cards, [1] * len(cards))), (wall, sheet, behind)), quality="draft")
    assert found.light.mean(dtype=np.float64) == pytest.approx(1, abs=2e-3 if lamp else 1e-5)
    assert np.abs(found.light - 1).max() < (0.1 if lamp else 1e-3)


def test_a_page_of_backs_reads_the_light_that_they_get_and_rooms_what_they_reflect() -> None:
    """A sheet that is white in front and black behind: what it gets there is the same, what it throws back is not."""
    white, black = Material("White", (0.9,) * 3, back=2), Material("Black", DARK)
    glow = Material("Glow", DARK, (1.0,) * 3)
    room = box("Room", (0, 0, 0), (1, 1, 1), inward=True)
    sheet = mesh_of("Sheet", [quad((0.3, 0.3, 0.5), (0.4, 0, 0), (0, 0.4, 0))], [1])
    light = {
        two: lit(Scene((room, replace(sheet, two_sided=two)), (glow, white, black)), quality="draft")
        for two in (False, True)
    }
    for found in light.values():
        below, above = (found.light[(found.mesh == 0) & (found.normal[:, 2] == way)].mean() for way in (1, -1))
        assert above - below > 0.05, "the ceiling sees the white side"
    assert light[True].of(2) == pytest.approx(1, rel=1e-3)


def test_backs_are_asked_for_apart_only_where_they_are_unlike_and_seen() -> None:
    some = frozenset({"reflectance"})
    plain = Material("Plain", (0.5,) * 3, varies=some)
    both = Material("Front", (0.5,) * 3, varies=some, back=2), Material("Back", (0.5,) * 3, varies=some)
    for two_sided in (False, True):
        meshes = tuple(
            mesh_of(f"{k}", [quad((2 * k, 0, 0), (1, 0, 0), (0, 1, 0))], [k], two_sided=two_sided) for k in (0, 1)
        )
        scene = Scene(meshes, (plain, *both))
        every = with_backs(scene)
        surfaces, atlas = flatten(every), cell_atlas(every, 64)
        texels = finish(rasterize(atlas, surfaces))
        shade, sampled = Faces((0.3,) * 3, (0.6,) * 3), np.zeros(surfaces.count, bool)
        look, _ = finish(appearance_of(scene, atlas, texels, sampled, shade))
        assert shade.asked == [("reflectance", False), ("reflectance", True)]
        mesh = surfaces.mesh[texels.triangle[:]]
        expected = np.select([mesh == 3], [0.6], 0.3)
        assert np.array_equal(look.reflectance[:, 0], expected.astype(np.float32))
        of_backs = look.behind.reflectance[:, 0]
        assert np.unique(of_backs[mesh == 0]) == pytest.approx(0.3)
        assert np.unique(of_backs[mesh == 1]) == pytest.approx(0.6)
        shade.asked.clear()
        look, _ = finish(appearance_of(scene, atlas, texels, sampled, shade, np.ones(surfaces.count, bool)))
        assert look.behind is None
        assert shade.asked == [("reflectance", False)]


@pytest.mark.parametrize("inside", [True, False])
def test_a_closed_body_that_shines_inward_is_a_room(inside: bool) -> None:
    glow, dark = Material("Glow", DARK, (1.0,) * 3), Material("Dark", DARK)
    faces = (replace(dark, back=1), glow) if inside else (replace(glow, back=1), dark)
    scene = Scene((box("Box", (0, 0, 0), (1, 1, 1)),), faces)
    surfaces = flatten(scene)
    scene = scene.moved(-surfaces.origin)
    solid = solid_triangles(scene, surfaces, Visibility(surfaces.corners))
    assert solid.any() != inside


CLEAR = Material("Clear", DARK, transmittance=(1.0,) * 3)


@pytest.mark.parametrize("faces_up", [True, False])
def test_shadow_rays_pass_a_sheet_from_its_clear_side_only(faces_up: bool) -> None:
    """They come from the floor: they meet the back of a sheet that faces up."""
    sheet = Material("Sheet", (0.5,) * 3, back=2)
    card = quad((-2, -2, 1), (4, 0, 0), (0, 4, 0))
    meshes = floor(), mesh_of("Sheet", [card if faces_up else card[::-1]], [1])
    sun = SunLight("Sun", (3.0,) * 3, (0, 0, -1))
    found = lit(Scene(meshes, (BLACK, sheet, CLEAR), (sun,)))
    assert found.of(0) == pytest.approx(3 / np.pi if faces_up else 0, abs=1e-5)


@pytest.mark.parametrize("gathers", [True, False])
def test_a_furnace_whose_walls_are_clear_from_outside_gets_nothing_from_there(gathers: bool) -> None:
    """E = rho = 1/2 inside, before a world and a ground a hundred times as bright."""
    wall = Material("Wall", (0.5,) * 3, (0.5,) * 3, back=1)
    ground = Material("Ground", (0.5,) * 3, (50.0,) * 3)
    room = box("Room", (0, 0, 0), (1, 1, 1), 0, inward=True)
    below = mesh_of("Ground", [quad((-3, -3, -0.1), (7, 0, 0), (0, 7, 0))], [2])
    scene = Scene((room, below), (wall, CLEAR, ground), world=World((100.0,) * 3))
    found = lit(scene, final_gather=gathers, tolerance=1e-8)
    assert np.abs(found.of(0) - 1).max() < 1e-3


def test_pictures_of_what_passes_are_asked_for_from_both_sides() -> None:
    some = frozenset({"transmittance"})
    grille = Material("Grille", DARK, transmittance=(0.5,) * 3, varies=some, back=1)
    scene = Scene((panel(),), (replace(grille, back=1), replace(grille, back=None)))
    scene = replace(scene, meshes=(replace(scene.meshes[0], material=np.zeros(2, np.int32)),))
    shade = Faces((0.25, 0.5, 0.75), (1.0, 0.5, 0.0))
    passed = transmittance_of(scene, flatten(scene), shade, 10.0)
    assert shade.asked == [("transmittance", False), ("transmittance", True)]
    where = np.zeros(2, np.int32), *np.full((2, 2), 0.3, np.float32)
    assert pytest.approx(np.array([*shade.colors.values()])) == passed.at(*where, front=np.array([True, False])).T
    assert passed.at(*where)[:, 0] == pytest.approx([0.25, 0.5, 0.0]), "what passes both ways"
    assert not passed.opaque.any()
    assert not passed.clear.any()


def test_pictures_that_are_the_same_on_both_sides_are_one() -> None:
    """Trees with Fresnel nodes are asked from both sides, whatever these nodes change."""
    shade = Faces(RED, RED)
    scene = Scene((panel(), WALL), glowing(RED, RED, varies=True))
    surfaces = flatten(scene)
    (glow, _), dim = glow_of(scene, surfaces, shade), frozenset({"transmittance"})
    assert shade.asked == [("emission", False), ("emission", True)]
    assert glow.backs is None
    lamps = lamps_of(scene, surfaces, (), glow)
    assert [lamp.two_sided for lamp in lamps.lamps] == [True]
    assert lamps.own.faces is None
    clear = tuple(replace(material, varies=dim) for material in scene.materials)
    passed = transmittance_of(replace(scene, materials=clear), surfaces, Faces((0.5,) * 3, (0.5,) * 3), 10.0)
    assert passed.behind is None


def test_a_page_of_backs_shows_what_stops_light_there() -> None:
    """White behind, clear in front: of what a sheet reflects as a whole each side has its own share."""
    front = Material("Clear", DARK, transmittance=(1.0,) * 3, back=2)
    half = Material("Half", (0.3,) * 3, transmittance=(0.5,) * 3)
    scene = with_backs(Scene((replace(panel(), two_sided=True),), (BLACK, front, half)))
    surfaces, atlas = flatten(scene), cell_atlas(scene, 64)
    texels = finish(rasterize(atlas, surfaces))
    opacity = opacity_of(texels, transmittance_of(scene, surfaces.without_backs(), None, 0.0))
    sampled = np.zeros(surfaces.count, bool)
    look = finish(appearance_of(scene, atlas, texels, sampled, None))[0].stopped(opacity)
    back = surfaces.mesh[texels.triangle[:]] == 1
    assert opacity.share == pytest.approx(1 / 2)
    assert look.reflectance[~back] == pytest.approx(0)
    assert look.reflectance[back] == pytest.approx(0.6)
    assert look.behind.reflectance[~back] == pytest.approx(0.6)
