# SPDX-License-Identifier: GPL-3.0-or-later
"""Many lamps: as right as each by itself, at a fraction of the rays; and the nodes between which light is fitted."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from radiosity_addon.arrays import Float32
from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import Texels, rasterize
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.geometry.walls import find_walls
from radiosity_addon.lighting import lights
from radiosity_addon.lighting.light_nodes import LightNodes, place_nodes
from radiosity_addon.lighting.lights import direct_irradiance, lamps_of
from radiosity_addon.lighting.shades import Shades, pooled
from radiosity_addon.scene import AreaLight, Light, PointLight, Scene, SpotLight
from radiosity_addon.settings import BakeSettings
from tests.bakes import lit, planes
from tests.lamps import GREY
from tests.shapes import box, cell_atlas, furnished_room, mesh_of, quad

SETTINGS = BakeSettings(page_size=160, threads=1)
REACH = 8  # texels; both ends of a page's rows are nearer than this to its edge
DOWN = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))


def hall(count: int = 120, groups: tuple[float, ...] = (1.0,)) -> Scene:
    """Two rooms with a door between them, and points, spots and panels in turn under their ceiling.

    Args:
        groups: strength of the lamps of each light group; lamps are dealt out to them
    """
    meshes = (
        mesh_of("floor", [quad((0, 0, 0), (6, 0, 0), (0, 6, 0))], [0]),
        mesh_of("wall", [quad((0, 6, 0), (6, 0, 0), (0, 0, 6))], [0]),
        box("partition", (2.9, 0, 0), (3.1, 5, 3)),
        box("box", (1, 2, 0), (2, 3, 1)),
    )
    made: list[Light] = []
    for k in range(count):
        place = (6 * (0.7548776662466927 * k % 1), 6 * (0.5698402909980532 * k % 1), 2.5)
        level, group = (groups[k % len(groups)],) * 3, k % len(groups)
        if k % 3 == 0:
            made.append(PointLight("point", level, place, 0.05, group=group))
        elif k % 3 == 1:
            made.append(SpotLight("spot", level, place, DOWN, 2.0, 0.4, 0.02, group=group))
        else:
            made.append(AreaLight("area", level, place, (0.5, 0, 0), (0, 0.5, 0), (0, 0, -1), group=group))
    names = tuple(str(k) for k in range(len(groups)))
    return Scene(meshes, (GREY,), tuple(made), groups=names)


@cache
def ground() -> tuple[Texels, Visibility]:
    scene = hall(1)
    surfaces = flatten(scene)
    visibility = Visibility(surfaces.corners, None, surfaces.offset)
    texels = finish(rasterize(cell_atlas(scene, SETTINGS.page_size), surfaces))
    finish(find_walls(texels, visibility, 1))
    return texels, visibility


@cache
def nodes() -> LightNodes:
    texels, visibility = ground()
    return finish(place_nodes(texels, visibility, 4.0, 1))


def between(field: Float32) -> Float32:
    """What a field (N,) at nodes is at all texels (T,); 0 where no node speaks for them."""
    total = np.zeros((ground()[0].count, 1), np.float32)
    nodes().add(field[nodes().near][..., None], 0, total)
    return total[:, 0]


def light_of(scene: Scene, workers: int = 1, many: int = 0) -> tuple[Float32, int]:
    """Direct light of the scene's lamps, and rays; `many` lamps or more are told apart by nodes."""
    texels, visibility = ground()
    before = visibility.rays
    surfaces = flatten(scene)
    lamps = lamps_of(scene.moved(-surfaces.origin), surfaces)
    settings = replace(SETTINGS, threads=workers)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lights, "MANY", many)
        light = finish(direct_irradiance(lamps, texels, visibility, settings, len(scene.groups)))
    return light, visibility.rays - before


def test_many_lamps_take_few_rays_and_err_less_than_allowed() -> None:
    scene = hall()
    exact, rays = light_of(scene, many=1000)
    fitted, fewer = light_of(scene)
    lit = exact[:, 0, 0]
    error = fitted[:, 0, 0] - lit
    assert fewer < 0.3 * rays  # twice as many where none of the weaker ones is served by few
    allowed = np.sqrt(2) * SETTINGS.steps.lamp_error  # by fits, and as much by few rays
    assert np.sqrt(np.mean(error**2)) < allowed * lit.mean()
    assert abs(error.mean()) < 0.2 * SETTINGS.steps.lamp_error * lit.mean()


def test_groups_keep_their_light_when_others_are_dimmed_or_brightened() -> None:
    as_it_is, _ = light_of(hall(40, (1.0, 1.0)))
    changed, _ = light_of(hall(40, (1.0, 1024.0)))
    assert np.array_equal(changed[:, 0], as_it_is[:, 0])
    assert np.allclose(changed[:, 1], 1024 * as_it_is[:, 1], rtol=1e-5)


def test_backs_throw_back_as_much_of_many_lamps_as_of_one_of_their_power() -> None:
    room, low, _ = furnished_room().meshes
    around = replace(furnished_room(), meshes=(*planes(room, turned=True), low))
    found = []
    for count in (1, 2 * lights.MANY):
        lamps = tuple(PointLight(f"{k}", (20 / count,) * 3, (3.5, 3.5, 4)) for k in range(count))
        found.append(lit(replace(around, lights=lamps), page_size=64, quality="draft").of(6).mean(0))
    assert found[1] == pytest.approx(found[0], rel=0.01)


def test_threads_do_not_change_the_light_of_many_lamps() -> None:
    assert np.array_equal(light_of(hall(32))[0], light_of(hall(32), workers=2)[0])


def test_a_linear_field_at_nodes_is_exact_between_them() -> None:
    texels, _ = ground()
    floor = np.flatnonzero((texels.position[:, 2] == texels.position[:, 2].min()) & texels.valid)
    inner = floor[(texels.area[floor] > 0.99 * texels.area[floor].max())]
    field = texels.position[nodes().texel] @ np.array([0.3, -0.7, 0], np.float32)
    at = between(field)[inner]
    slope = at - texels.position[inner] @ np.array([0.3, -0.7, 0], np.float32)
    assert np.abs(slope).max() < 0.03  # of 6 m; the ridge takes some of the slope where few nodes are near
    assert np.median(np.abs(slope)) < 2e-3


def test_nodes_speak_for_no_texel_behind_a_wall() -> None:
    texels, _ = ground()
    origin = texels.surfaces.origin
    place = texels.position + origin
    floor = (texels.normal[:, 2] > 0.9) & (place[:, 2] < 0.01) & texels.valid & (place[:, 1] < 4.5)
    west = (place[:, 0] < 2.9) & floor
    east = (place[:, 0] > 3.1) & floor
    at = between((place[nodes().texel, 0] < 3).astype(np.float32))
    assert np.allclose(at[west], 1, atol=1e-5)
    assert np.allclose(at[east], 0, atol=1e-5)


def test_texels_that_look_around_find_what_whole_pages_show() -> None:
    texels, _ = ground()
    codes = np.random.default_rng(3).integers(0, 255, (2, texels.count)).astype(np.uint8)
    column = texels.pixel % texels.size
    some = np.flatnonzero((column < REACH) | (column >= texels.size - REACH))[::2]
    few = texels.only(some, np.full(len(texels.texel_at), -1, np.int32))
    shades = Shades(codes[0][some], codes[1][some])
    sparse = finish(pooled(shades, few, REACH, 1))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("radiosity_addon.lighting.shades.SPARSE", 1 << 30)
        whole = finish(pooled(shades, few, REACH, 1))
    assert np.array_equal(sparse.low, whole.low)
    assert np.array_equal(sparse.high, whole.high)
