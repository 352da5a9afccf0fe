# SPDX-License-Identifier: GPL-3.0-or-later
"""Thin walls on a floor: which texels they stand on, and that nothing is taken for what lies beyond them."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.arrays import Bools, Float64
from radiosity_addon.atlas.unwrap import build_atlas
from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import Texels, rasterize
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.geometry.walls import Walls, find_walls, hidden, part_cells
from radiosity_addon.radiosity.patches import Patches, group_patches
from radiosity_addon.scene import Material, Mesh, Scene
from radiosity_addon.settings import BakeSettings
from tests.shapes import box, cell_atlas, folded_sheet, furnished_room, mesh_of, quad, sphere

GREY = (Material("Grey"),)
SIZE = 4.0
"""m, edge of the floor; its texels are 4 / 58 m wide."""
TEXEL = SIZE / 58


def upright(start: tuple[float, float], end: tuple[float, float], thickness: float = 0.0) -> Mesh:
    """A wall of 2 m from one point of the floor to another, which goes through the floor."""
    p, q = np.array([*start, -0.1]), np.array([*end, -0.1])
    aside = np.cross(q - p, (0, 0, 1)) / np.linalg.norm(q - p) * thickness / 2
    up = (0, 0, 2.1)
    faces = [quad(p + aside, q - p, up)]
    if thickness:
        faces += [quad(q - aside, p - q, up), quad(q + aside, -2 * aside, up), quad(p - aside, 2 * aside, up)]
        faces += [quad(p + aside + up, q - p, -2 * aside), quad(p + aside, -2 * aside, q - p)]
    return mesh_of("Wall", faces, [0] * len(faces))


def texels_of(*meshes: Mesh, across: int = 1) -> Texels:
    scene = Scene(meshes, GREY)
    return finish(rasterize(cell_atlas(scene, 64 * across), flatten(scene), 1))


def with_walls(*walls: Mesh) -> tuple[Texels, Walls, Visibility, Float64, Bools]:
    """A floor with walls on it: texels, their walls, what rays meet, positions (T, 3), and which texels are floor."""
    ground = mesh_of("Floor", [quad((0, 0, 0), (SIZE, 0, 0), (0, SIZE, 0))], [0])
    quads = 1 + sum(len(wall.triangles) // 2 for wall in walls)
    texels = texels_of(ground, *walls, across=int(np.ceil(np.sqrt(quads))))
    visibility = Visibility(texels.surfaces.corners)
    found = finish(find_walls(texels, visibility, 1))
    return (
        texels,
        found,
        visibility,
        texels.position + texels.surfaces.origin,
        texels.surfaces.mesh[texels.triangle[:]] == 0,
    )


WALLS = {
    "straight": ((2.013, 0.0), (2.013, SIZE), (1.0, 0.0), 2.013),
    "on the border of texels": ((30 * TEXEL, 0.0), (30 * TEXEL, SIZE), (1.0, 0.0), 30 * TEXEL),
    "slanted": ((1.5, -0.5), (2.5, 4.5), (0.98058068, -0.19611614), 1.56892908),
}


@pytest.mark.parametrize("kind", WALLS)
@pytest.mark.parametrize("thickness", [0.0, 0.01], ids=["plane", "1 cm"])
def test_texels_on_both_sides_of_a_thin_wall_are_found_and_no_others(kind: str, thickness: float) -> None:
    start, end, normal, distance = WALLS[kind]
    texels, _, _, place, floor = with_walls(upright(start, end, thickness))
    off = np.abs(place[:, :2] @ np.array(normal) - distance)
    assert texels.crossed[floor & (off < 0.45 * TEXEL)].all()
    assert not texels.crossed[floor & (off > 1.5 * TEXEL)].any()


@pytest.mark.parametrize("kind", WALLS)
def test_a_texel_at_the_foot_of_a_wall_stands_on_one_side_wherever_its_points_are_taken(kind: str) -> None:
    start, end, normal, distance = WALLS[kind]
    texels, _, _, _, floor = with_walls(upright(start, end))
    ids = np.flatnonzero(floor)
    many = 64
    points = texels.points(np.repeat(ids, many), np.tile(np.arange(many), len(ids)))[0] + texels.surfaces.origin
    side = (points[:, :2] @ np.array(normal) - distance).reshape(-1, many)
    assert ((side > -1e-6).all(1) | (side < 1e-6).all(1)).all()


def test_the_side_of_the_centre_counts() -> None:
    wall = 30.7 * TEXEL  # beyond the centre of column 30, before its right strata's
    texels, _, _, place, floor = with_walls(upright((wall, 0), (wall, SIZE)))
    column = np.floor(place[:, 0] / TEXEL).astype(int)
    on_it = floor & (column == 30) & (texels.covered > 0)
    assert (place[on_it, 0] < wall).all()
    assert set(texels.covered[on_it]) == {0b0101}, "the left strata"


def patches_of(texels: Texels, walls: Walls, visibility: Visibility, target: int = 300) -> Patches:
    grey = np.full((texels.count, 3), 0.5, np.float32)
    solid = np.zeros(texels.surfaces.count, bool)
    return group_patches(texels, walls, grey, np.zeros_like(grey), solid, target, visibility)


@pytest.mark.parametrize("back", [False, True], ids=["fronts", "backs"])
@pytest.mark.parametrize("kind", WALLS)
def test_no_patch_lies_on_both_sides_of_a_wall(kind: str, back: bool) -> None:
    start, end, normal, distance = WALLS[kind]
    along = np.subtract((*end, 0), (*start, 0))
    wall = mesh_of("Wall", [quad((*start, -1 if back else 0), along, (0, 0, 1))], [0])
    texels, walls, visibility, place, floor = with_walls(wall)
    patches = patches_of(texels, walls, visibility)
    patch = patches.back if back else patches.of_element[: texels.count]
    side = place[:, :2] @ np.array(normal) - distance
    own = floor & (patch >= 0) & (np.abs(side) > 1e-6)
    before, beyond = (np.bincount(patch[own & part], minlength=patches.count) for part in (side < 0, side > 0))
    assert np.count_nonzero(before) > 20
    assert np.minimum(before, beyond).max() <= (1 if back else 0), "of backs, every second texel is asked"


def test_a_ray_that_meets_the_other_side_of_a_texel_at_a_wall_meets_the_texel_beside() -> None:
    wall = 30.7 * TEXEL
    texels, walls, visibility, _, _ = with_walls(upright((wall, 0), (wall, SIZE)))
    patches = patches_of(texels, walls, visibility)
    x = np.array([30.1, 30.6, 30.8, 30.95, 31.2, 35]) * TEXEL
    origins = np.stack([x, np.full(6, 2.0), np.full(6, 0.5)], axis=1) - texels.surfaces.origin
    hits = visibility.first_hit(origins.astype(np.float32), np.tile(np.float32([0, 0, -1]), (6, 1)))
    found = patches.elements(hits)
    column = np.floor((texels.position[found, 0] + texels.surfaces.origin[0]) / TEXEL).astype(int)
    assert list(column) == [30, 30, 31, 31, 31, 35]


@pytest.mark.parametrize("kind", WALLS)
def test_texels_next_to_a_sheet_know_which_side_of_it_they_are_on(kind: str) -> None:
    start, end, normal, distance = WALLS[kind]
    texels, walls, _, place, floor = with_walls(upright(start, end))
    side = place[:, :2] @ np.array(normal) - distance
    back, front = walls.behind
    assert (side[back] < 1e-6).all()
    assert (side[front] > -1e-6).all()
    assert np.linalg.norm(place[back] - place[front], axis=1) == pytest.approx(TEXEL, rel=0.55), "some stepped aside"
    near = np.flatnonzero(floor & (side < -0.1 * TEXEL) & (side > -0.7 * TEXEL) & texels.valid)
    assert len(near) > 20
    assert np.isin(near, back).mean() > 0.95


def test_a_wall_with_two_sides_has_no_back() -> None:
    _, walls, _, _, floor = with_walls(upright((2.013, 0.0), (2.013, SIZE), 0.01))
    assert not floor[walls.behind].any(), "the floor has one: the wall goes through it"


def test_texels_of_a_cell_see_its_seat_or_get_another_cell() -> None:
    wall = 33.2 * TEXEL  # within the cells of columns 30 to 35
    texels, walls, visibility, place, floor = with_walls(upright((wall, 0), (wall, SIZE)))
    column = np.floor(place[:, :2] / (6 * TEXEL)).astype(int)
    _, cell = np.unique(column @ [1, 1000], return_inverse=True)
    cell = np.where(floor, cell.reshape(-1), -1).astype(np.int32)
    seat = np.full(cell.max() + 1, -1)
    seat[cell[floor]] = np.flatnonzero(floor)
    cells, seats = finish(part_cells(cell, seat, walls.border, texels, visibility, 1))
    ids = np.flatnonzero(floor)
    assert (cells[~floor] == -1).all()
    assert len(seats) > len(seat)
    assert not hidden(texels, ids, seats[cells[ids]], visibility).any()
    assert ((place[ids, 0] < wall) == (place[seats[cells[ids]], 0] < wall)).all()
    unparted = np.abs(place[ids, 0] - wall) > 6.5 * TEXEL
    assert np.array_equal(cells[ids][unparted], cell[ids][unparted])


@pytest.mark.parametrize(
    "scene",
    [
        Scene((sphere("Ball", segments=24, rings=12),), GREY),
        Scene((box("Room", (0, 0, 0), (1, 1, 1), inward=True),), GREY),
        furnished_room(),
    ],
    ids=["ball", "room", "blocks"],
)
def test_no_walls_are_found_where_none_are(scene: Scene) -> None:
    """On round surfaces and in corners. Texels below thick blocks are no longer valid in a bake."""
    texels = finish(rasterize(cell_atlas(scene, 400, 1.5), flatten(scene), 1))
    visibility = Visibility(texels.surfaces.corners)
    buried = (texels.surfaces.mesh[texels.triangle[:]] == 0) & (np.abs(texels.position[:, 2] + 2.75) < 0.01)
    texels.valid[buried & (len(scene.meshes) > 1)] = False
    walls = finish(find_walls(texels, visibility, 1))
    assert not texels.crossed.any()
    assert walls.planes.shape == (0, 4, 4)


def test_an_edge_of_a_smooth_surface_is_no_wall() -> None:
    scene, atlas = folded_sheet([0, 2.03, 4], [0, 0.8, 0])  # it leads through texels, whose middles lie beneath it
    texels = finish(rasterize(atlas, flatten(scene), 1))
    finish(find_walls(texels, Visibility(texels.surfaces.corners), 1))
    assert not texels.crossed.any()


@pytest.mark.parametrize(("segments", "size"), [(24, 64), (24, 128), (20, 256)])
def test_edges_of_a_coarse_smooth_ball_are_no_walls(segments: int, size: int) -> None:
    """Its faces meet at 15 degrees or 18, its normals turn far less from texel to texel; charts are xatlas' own."""
    scene = Scene((sphere("Ball", segments=segments, rings=segments * 2 // 3),), GREY)
    atlas = finish(build_atlas(scene, BakeSettings(page_size=size)))
    texels = finish(rasterize(atlas, flatten(scene), 1))
    area = texels.area.sum()
    finish(find_walls(texels, Visibility(texels.surfaces.corners), 1))
    assert texels.crossed.mean() < 0.01
    assert texels.area.sum() > 0.99 * area
