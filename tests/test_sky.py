# SPDX-License-Identifier: GPL-3.0-or-later
"""The sky split into lamps and a map: nothing is lost, nothing counts twice, and planes get what the integral says."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.bake import bake
from radiosity_addon.chunks import finish
from radiosity_addon.lighting.lamps import sun_lamp
from radiosity_addon.lighting.sky import CELLS, MOST_LAMPS, Sky, cells, sky_of
from radiosity_addon.scene import Material, Scene, SkyTile, SunLight, World
from radiosity_addon.settings import BakeSettings
from tests.shapes import box, mesh_of, quad

TILTS = (0.0, 35.0, 90.0, 140.0, 180.0)
SUN_WAY = np.array([0.48, 0.36, 0.8])


def ways(height: int, width: int | None = None) -> np.ndarray:
    """Unit vectors (H, W, 3) to the middles of a whole sky's pixels."""
    width = width or 2 * height
    latitude = ((np.arange(height) + 0.5) / height - 0.5)[:, None] * np.pi
    longitude = ((np.arange(width) + 0.5) / width - 0.5)[None] * 2 * np.pi
    return np.stack(
        np.broadcast_arrays(
            np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)
        ),
        axis=2,
    )


def solid_angles(height: int) -> np.ndarray:
    """(H, 1), sr, of a whole sky's pixels in each row."""
    return np.diff(np.sin((np.arange(height + 1) / height - 0.5) * np.pi))[:, None] * (np.pi / height)


def picture(radiance: np.ndarray) -> SkyTile:
    return SkyTile(np.repeat(radiance[:, :, None], 3, axis=2).astype(np.float32))


def photograph(height: int = 256) -> np.ndarray:
    """(H, 2 H) radiance like that of a photographed sky: a gradient, brown ground, a glow, a sharp sun, a far lamp."""
    way = ways(height)
    angle = np.arccos(np.clip(way @ SUN_WAY, -1, 1))
    sky = np.where(way[:, :, 2] > 0, 0.6 + 0.8 * (1 - way[:, :, 2]) ** 4, 0.2)
    lamp = np.arccos(np.clip(way @ [-0.6, 0.0, 0.8], -1, 1)) < 0.03
    return sky + 20 * np.exp(-((angle / 0.12) ** 2)) + 3e4 * (angle < 0.012) + 150 * lamp


def plane(tilt: float, reflectance: float = 0.5) -> Scene:
    """A square that faces up, turned about x by `tilt` degrees."""
    angle = np.radians(tilt)
    square = quad((0, 0, 0), (1, 0, 0), (0, np.cos(angle), np.sin(angle)))
    return Scene((mesh_of("Plane", [square], [0]),), (Material("Grey", (reflectance,) * 3),))


def normal(tilt: float) -> np.ndarray:
    return np.array([0.0, -np.sin(np.radians(tilt)), np.cos(np.radians(tilt))])


def page(scene: Scene, world: World, **settings: object) -> np.ndarray:
    scene = Scene(scene.meshes, scene.materials, world=world)
    return finish(bake(scene, BakeSettings(**{"page_size": 32, "quality": "medium", **settings}))).pages[0]


def light_of(sky: Sky, facing: np.ndarray) -> np.ndarray:
    """Irradiance (3,) on a plane in the open, from the lamps and the map's cells."""
    total = np.zeros(3)
    for sun in sky.suns:
        light = sun_lamp(sun, 1.0).light(np.zeros((1, 3), np.float32), facing[None].astype(np.float32), None)
        total += light * np.array(sun.irradiance)
    way = ways(1024)
    cosine = np.maximum(way @ facing, 0) * solid_angles(1024)
    weight = np.bincount(cells(way.reshape(-1, 3).astype(np.float32)), cosine.reshape(-1), CELLS)
    return total + weight @ sky.radiance


def flux(sky: Sky) -> float:
    """W/m2 of the first channel, lamps and map."""
    way = ways(1024)
    solid = np.broadcast_to(solid_angles(1024), way.shape[:2]).reshape(-1)
    solid = np.bincount(cells(way.reshape(-1, 3).astype(np.float32)), solid, CELLS)
    return float(solid @ sky.radiance[:, 0]) + sum(
        sun.irradiance[0] * 2 / (1 + np.cos(sun.angle / 2)) for sun in sky.suns
    )


def test_a_cell_is_found_for_each_direction_and_the_horizon_parts_them() -> None:
    way = ways(512).reshape(-1, 3).astype(np.float32)
    found = cells(way)
    assert len(np.unique(found)) == CELLS
    assert ((found < CELLS // 2) == (way[:, 2] > 0)).all()
    assert (cells(7 * way) == found).all()


def test_cells_are_compact() -> None:
    way = ways(512).reshape(-1, 3)
    found = cells(way.astype(np.float32))
    middle = np.stack([np.bincount(found, way[:, k], CELLS) for k in range(3)], axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.clip((middle[found] * way).sum(1), -1, 1))).max() < 2.5


@pytest.mark.parametrize("height", [4, 37, 300])
def test_an_even_sky_has_no_lamps_and_the_same_radiance_in_every_cell(height: int) -> None:
    sky = sky_of(World(sky=(picture(np.full((height, 2 * height), 0.7)),)))
    assert sky is not None
    assert not sky.suns
    np.testing.assert_allclose(sky.radiance, 0.7, rtol=1e-6)


def test_lamps_and_map_add_up_to_the_picture() -> None:
    light = photograph()
    sky = sky_of(World(sky=(picture(light),)))
    assert sky is not None
    assert 2 <= len(sky.suns) <= MOST_LAMPS
    assert sky.radiance.max() < 1e-3 * light.max()
    # 512 divides 1024, so the map's cells are told the same parts as here
    assert flux(sky) == pytest.approx(float((light * solid_angles(256)).sum()), rel=1e-4)


@pytest.mark.parametrize("tilt", TILTS)
def test_lamps_and_map_light_a_plane_as_the_picture_does(tilt: float) -> None:
    light = photograph()
    sky = sky_of(World(sky=(picture(light),)))
    assert sky is not None
    wanted = float((light * np.maximum(ways(256) @ normal(tilt), 0) * solid_angles(256)).sum())
    assert light_of(sky, normal(tilt))[0] == pytest.approx(wanted, rel=0.003)


def test_a_small_bright_disc_is_one_lamp_of_its_direction_size_and_light() -> None:
    angle = np.arccos(np.clip(ways(2048) @ SUN_WAY, -1, 1))
    sky = sky_of(World(sky=(picture(np.where(angle < 0.01, 1e4, 0.0)),), group=0))
    assert sky is not None
    (sun,) = sky.suns
    np.testing.assert_allclose(sun.direction, -SUN_WAY, atol=5e-5)
    assert sun.angle == pytest.approx(0.02, rel=0.01)
    assert sun.irradiance[0] == pytest.approx(1e4 * np.pi * np.sin(0.01) ** 2, rel=0.01)
    assert not sky.radiance.any()


def test_a_finer_tile_takes_the_place_of_the_pixels_under_it() -> None:
    """A sun that the coarse picture shows wrong, in a tile of 8 x 8 of its pixels."""
    coarse = np.ones((64, 128))
    coarse[40:48, 80:88] = 5000
    step = np.pi / 64
    fine = np.ones((64, 64, 3), np.float32)
    fine[30:34, 30:34] = 1000, 2000, 3000
    west, south = 80 * step - np.pi, 40 * step - np.pi / 2
    tile = SkyTile(fine, west, west + 8 * step, south, south + 8 * step)
    sky = sky_of(World(sky=(picture(coarse), tile)))
    assert sky is not None
    (sun,) = sky.suns
    middle = south + 4 * step
    solid = (step / 2) ** 2 * np.cos(middle)
    ratio = np.array(sun.irradiance) / solid
    np.testing.assert_allclose(ratio, np.array([1000, 2000, 3000]), rtol=0.003)
    np.testing.assert_allclose(sky.radiance.max(), 4, rtol=0.2)


def test_two_suns_near_each_other_are_two_lamps() -> None:
    way = ways(1024)
    one, two = (np.arccos(np.clip(way @ np.array(to), -1, 1)) < 0.006 for to in (SUN_WAY, [0.6, 0.0, 0.8]))
    sky = sky_of(World(sky=(picture(1 + 1e5 * one + 4e4 * two),)))
    assert sky is not None
    strengths = [sun.irradiance[0] for sun in sky.suns]
    assert len(strengths) == 2
    assert strengths[1] / strengths[0] == pytest.approx(0.4, rel=0.05)


def test_the_split_does_not_depend_on_how_strong_the_sky_is() -> None:
    weak, strong = (sky_of(World(sky=(picture(scale * photograph()),))) for scale in (1, 1024))
    assert weak is not None
    assert strong is not None
    assert [sun.direction for sun in weak.suns] == [sun.direction for sun in strong.suns]
    np.testing.assert_allclose(strong.radiance, 1024 * weak.radiance, rtol=1e-5)


def test_a_black_picture_is_a_black_sky() -> None:
    sky = sky_of(World(sky=(picture(np.zeros((8, 16))),)))
    assert sky is not None
    assert not sky.suns
    assert not sky.radiance.any()


@pytest.mark.parametrize("tilt", [0.0, 90.0])
def test_an_even_picture_bakes_as_the_same_colour_does(tilt: float) -> None:
    scene = Scene((*plane(tilt).meshes, box("Box", (0.3, 0.3, 0.2), (0.6, 0.6, 0.5))), plane(tilt).materials)
    colour = page(scene, World((0.5, 0.5, 0.5)))
    pictured = page(scene, World(sky=(picture(np.full((16, 32), 0.5)),)))
    np.testing.assert_allclose(pictured, colour, rtol=1e-6)


@pytest.mark.parametrize("tilt", TILTS)
def test_a_white_hemisphere_lights_a_tilted_plane_by_half_of_one_plus_its_cosine(tilt: float) -> None:
    white_above = np.repeat([[0.0], [1.0]], 128, axis=0) * np.ones((1, 512))
    found = page(plane(tilt), World(sky=(picture(white_above),)), quality="high")
    wanted = (1 + np.cos(np.radians(tilt))) / 2
    assert found.mean() == pytest.approx(wanted, abs=0.004)  # of 27 tilts RMS 0.0012, at most 0.0025


@pytest.mark.parametrize("tilt", [0.0, 50.0, 120.0])
def test_an_open_plane_gets_the_integral_of_a_photographed_sky(tilt: float) -> None:
    light = photograph()
    found = page(plane(tilt), World(sky=(picture(light),)), quality="high")
    wanted = float((light * np.maximum(ways(256) @ normal(tilt), 0) * solid_angles(256)).sum()) / np.pi
    assert found.mean() == pytest.approx(wanted, rel=0.003)


def test_a_sun_in_the_sky_shadows_as_a_sun_lamp_does() -> None:
    angle = np.arccos(np.clip(ways(2048) @ SUN_WAY, -1, 1))
    sky = World(sky=(picture(np.where(angle < 0.02, 2500.0, 0.0)),))
    scene = Scene((*plane(0).meshes, box("Box", (0.4, 0.4, 0.1), (0.6, 0.6, 0.4))), plane(0).materials)
    power = 2500 * np.pi * np.sin(0.02) ** 2
    x, y, z = (float(-part) for part in SUN_WAY)
    lamp = Scene(scene.meshes, scene.materials, (SunLight("Sun", (power,) * 3, (x, y, z), 0.04),))
    found = page(scene, sky, page_size=128)
    wanted = finish(bake(lamp, BakeSettings(page_size=128))).pages[0]
    assert np.abs(found - wanted).mean() < 0.004 * wanted.mean()


def test_the_sky_shines_in_its_own_light_group() -> None:
    world = World((0.1, 0.1, 0.1), 1, (picture(photograph(64)),))
    scene = Scene(plane(0).meshes, plane(0).materials, world=world, groups=("", "Sky"))
    alone = page(plane(0), World((0.1, 0.1, 0.1), 0, world.sky))
    found = finish(bake(scene, BakeSettings(page_size=32))).pages[0]
    np.testing.assert_allclose(found, alone, rtol=1e-5)


def test_backs_of_a_leaning_board_pass_the_skys_light_on() -> None:
    """A white board stands over a floor, its back to the bright half of the sky: the floor sees that back."""
    east = np.where(ways(64)[:, :, 0] > 0, 1.0, 0.0)
    floor = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    board = quad((-0.2, -4, 0.05), (0, 0, 4), (0, 8, 0))  # faces west: to -x
    black = Scene(
        (mesh_of("Floor", [floor], [0]), mesh_of("Board", [board], [1], lightmapped=False)),
        (Material("Black", (0.0,) * 3), Material("White", (0.9,) * 3)),
    )
    dark = Scene(black.meshes, (black.materials[0], Material("Dark", (0.0,) * 3)))
    world = World(sky=(picture(east),))
    assert page(black, world).mean() > 1.15 * page(dark, world).mean()
