# SPDX-License-Identifier: GPL-3.0-or-later
"""What counts as the inside of something, where no light is."""

from copy import deepcopy

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import rasterize
from radiosity_addon.geometry.validity import solid_triangles, strata_inside
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.scene import AreaLight, Material, Mesh, PointLight, Scene, SunLight
from tests.shapes import box, cell_atlas, furnished_room, mesh_of, quad, sphere

GREY, GLOW = Material("Grey"), Material("Glow", emission=(1.0, 1.0, 1.0))
BULB = PointLight("Bulb", (1, 1, 1), (0.5, 0.5, 0.8))

PANEL = AreaLight("Panel", (1, 1, 1), (0.5, 0.5, 0.9), (0.2, 0, 0), (0, 0.2, 0), (0, 0, -1))


def solids(scene):
    """Names of the meshes that are solid."""
    surfaces = flatten(scene)
    solid = solid_triangles(scene.moved(-surfaces.origin), surfaces, Visibility(surfaces.corners))
    return {scene.meshes[index].name for index in np.unique(surfaces.mesh[solid])}


def on_a_floor(meshes, size=256, workers=1):
    """Texels of a 4 m floor with `meshes` on it, before and after leaving out what is inside."""
    floor = mesh_of("Floor", [quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))], [0])
    scene = Scene((floor, *meshes), (GREY,), (SunLight("Sun", (1, 1, 1), (0, 0, -1)),))
    surfaces = flatten(scene)
    visibility = Visibility(surfaces.corners)
    solid = solid_triangles(scene.moved(-surfaces.origin), surfaces, visibility)
    texels = finish(rasterize(cell_atlas(scene, size), surfaces))
    inside = finish(strata_inside(texels, solid, visibility, workers))
    return texels, deepcopy(texels).without(inside)


def floor_of(texels):
    """Floor texels and their x and y in world space."""
    own = texels.surfaces.mesh[texels.triangle[:]] == 0
    return own, (texels.position.astype(float) + texels.surfaces.origin)[:, :2]


@pytest.mark.parametrize("inward", [False, True])
@pytest.mark.parametrize("lamp", [BULB, PANEL])
def test_a_closed_box_around_a_lamp_is_a_room_whichever_way_it_faces(inward, lamp):
    assert solids(Scene((box("Room", (0, 0, 0), (1, 1, 1), inward=inward),), (GREY,), (lamp,))) == set()


def test_a_closed_box_without_a_lamp_in_it_is_solid():
    block = box("Block", (3, 0, 0), (4, 1, 1))
    assert solids(Scene((box("Room", (-1, -1, -1), (6, 3, 3), inward=True), block), (GREY,), (BULB,))) == {"Block"}


def test_a_glowing_mesh_makes_the_box_around_it_a_room():
    glow = mesh_of("Glow", [quad((0.4, 0.4, 0.5), (0.2, 0, 0), (0, 0.2, 0))], [1])
    room, block = box("Room", (0, 0, 0), (1, 1, 1)), box("Block", (3, 0, 0), (4, 1, 1))
    assert solids(Scene((room, block, glow), (GREY, GLOW))) == {"Block"}


def test_a_glowing_solid_stays_solid():
    assert solids(Scene((box("Lamp", (0, 0, 0), (1, 1, 1), materials=1),), (GREY, GLOW))) == {"Lamp"}


def test_the_back_of_a_room_that_faces_inward_hides_nothing():
    after = on_a_floor([box("Room", (-1, -1, 0.5), (1, 1, 1.5), inward=True)])[1]
    assert after.valid.all()


def test_a_hollow_in_a_solid_is_not_inside_of_it():
    house = box("House", (-1, -1, -0.1), (1, 1, 2))
    hollow = box("Hollow", (-0.8, -0.8, 0.1), (0.8, 0.8, 1.8), inward=True)
    after = on_a_floor([house, hollow])[1]
    own = after.surfaces.mesh[after.triangle[:]]
    assert after.valid[own == 2].all()
    assert not after.valid[own == 0].all()


def test_the_sun_is_inside_of_nothing():
    scene = Scene((box("Block", (-1, -1, -1), (1, 1, 1)),), (GREY,), (SunLight("Sun", (1, 1, 1), (0, 0, -1)),))
    assert solids(scene) == {"Block"}


def test_open_meshes_are_never_solid():
    whole = box("Box", (0, 0, 0), (1, 1, 1))
    parts = {name: vars(whole)[name][:-2] for name in ("triangles", "corner_normals", "material", "polygon", "corner")}
    open_box = Mesh(**{**vars(whole), **parts, "name": "Open"})
    assert solids(Scene((open_box, mesh_of("Sheet", [quad((3, 0, 0), (1, 0, 0), (0, 1, 0))], [0])), (GREY,))) == set()


def test_the_floor_under_a_box_takes_no_part_and_the_rest_does():
    before, after = on_a_floor([box("Block", (-0.5, -0.5, -0.01), (0.5, 0.5, 1))])
    own, place = floor_of(before)
    reach = np.abs(place).max(1)
    step = 4 / 122
    assert before.valid.all()
    assert not after.valid[own & (reach < 0.5 - step)].any()
    assert after.valid[own & (reach > 0.5 + step)].all()


def test_texels_that_a_box_covers_in_part_lose_that_part_of_their_area():
    before, after = on_a_floor([box("Block", (-0.5, -0.5, -0.01), (0.5, 0.5, 1))])
    own, _ = floor_of(before)
    lost = before.area[own].sum() - after.area[own & after.valid].sum()
    assert lost == pytest.approx(1, rel=0.03)
    partly = own & after.valid & (after.area < before.area)
    assert partly.any()
    _, place = floor_of(after)
    assert (np.abs(place[partly]).max(1) > 0.5).all()


def test_no_other_surface_loses_anything_to_a_box_on_the_floor():
    before, after = on_a_floor([box("Block", (-0.5, -0.5, -0.01), (0.5, 0.5, 1))])
    block = ~floor_of(before)[0] & (before.normal[:, 2] > 0.5)
    assert after.valid[block].all()
    assert np.array_equal(after.area[block], before.area[block])


def test_a_thin_leg_between_the_first_samples_is_found_by_its_neighbours():
    before, after = on_a_floor([box("Leg", (0.2, 0.2, -0.01), (0.28, 0.28, 1))])
    own, _ = floor_of(before)
    lost = before.area[own].sum() - after.area[own & after.valid].sum()
    assert lost == pytest.approx(0.08**2, rel=0.3)


def test_nothing_is_inside_an_open_sheet():
    before, after = on_a_floor([mesh_of("Sheet", [quad((-1, -1, 0.5), (0, 2, 0), (2, 0, 0))], [0])])
    assert after is before or after.valid.all()


def test_a_floor_inside_a_sphere_is_hidden_however_far_its_wall():
    before, after = on_a_floor([sphere_closed(1.5)])
    own, place = floor_of(before)
    reach = np.linalg.norm(place, axis=1)
    assert not after.valid[own & (reach < 1.35)].any()
    assert after.valid[own & (reach > 1.6)].all()


def test_what_stands_beside_touching_solids_is_not_inside_of_any():
    """Rays leave one book where they enter the next, and meet only one of both faces."""
    books = [box(f"Book {k}", (-0.9 + 0.3 * k, -0.3, 0.0), (-0.6 + 0.3 * k, 0.3, 0.5)) for k in range(6)]
    board = box("Board", (-1.5, -0.4, -0.1), (1.5, 0.4, 0.01))
    side = box("Side", (1.2, -0.4, -0.05), (1.3, 0.4, 0.7))
    after = on_a_floor([*books, board, side])[1]
    lit = (after.surfaces.mesh[after.triangle[:]] == 8) & (after.normal[:, 0] < -0.5)
    z = after.position[:, 2] + after.surfaces.origin[2]
    assert after.valid[lit & (z > 0.05)].all()
    assert not after.valid[lit & (z < -0.01)].any()


def sphere_closed(radius):
    """A sphere whose poles are closed by fans."""
    ball = sphere("Ball", radius, segments=24, rings=12)
    vertices, triangles = ball.vertices, ball.triangles
    top, bottom = np.array([0, 0, radius]), np.array([0, 0, -radius])
    corner = vertices[triangles]
    ends = corner[..., 2].max(), corner[..., 2].min()
    rims = [np.unique(vertices[np.isclose(vertices[:, 2], z)].round(9), axis=0) for z in ends]
    quads = [corner[0::2][:, [0, 1, 2]], corner[1::2]]
    fans = []
    for rim, pole, turn in ((rims[0], top, 1), (rims[1], bottom, -1)):
        rim = rim[np.argsort(np.arctan2(rim[:, 1], rim[:, 0]))]
        fans.append(np.stack([np.broadcast_to(pole, rim.shape), rim, np.roll(rim, -1, axis=0)], axis=1)[:, ::turn])
    soup = np.concatenate([*quads, *fans]).round(9)
    soup = np.concatenate([soup, soup[:1]]) if len(soup) % 2 else soup  # cells hold two triangles each
    count = len(soup)
    index = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    normal = soup / np.linalg.norm(soup, axis=2)[..., None]
    zero = np.zeros(count, np.int32)
    return Mesh("Ball", soup.reshape(-1, 3), index, normal.astype(np.float32), zero, zero, index)


def test_the_result_does_not_depend_on_threads():
    blocks = [box("Block", (-0.5, -0.5, -0.01), (0.5, 0.5, 1))]
    one, three = on_a_floor(blocks, 512, 1)[1], on_a_floor(blocks, 512, 3)[1]
    assert np.array_equal(one.covered, three.covered)
    assert np.array_equal(one.area, three.area)


def test_the_room_under_its_own_lamp_keeps_every_texel_but_those_under_blocks():
    room = furnished_room()
    surfaces = flatten(room)
    visibility = Visibility(surfaces.corners)
    solid = solid_triangles(room.moved(-surfaces.origin), surfaces, visibility)
    assert set(surfaces.mesh[solid]) == {1, 2}
    texels = finish(rasterize(cell_atlas(room, 300), surfaces))
    inside = finish(strata_inside(texels, solid, visibility, 1))
    under = inside.all(1)
    assert under.any()
    height = texels.position[under, 2] + surfaces.origin[2]
    assert np.abs(height).max() < 1e-5
