# SPDX-License-Identifier: GPL-3.0-or-later
"""Where suns on glossy floors throw their light."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.gather.gleams import Gleams
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import rasterize
from radiosity_addon.lighting.beams import Beams
from radiosity_addon.microfacet import FRESNEL_STEPS, facets_towards, metal_gloss
from radiosity_addon.scene import Gloss, Material, Scene, SunLight
from tests.bakes import BLACK, Lit, floor, lit
from tests.shapes import cell_atlas, mesh_of, quad

SUN = SunLight("Sun", (10.0, 10.0, 10.0), (0.8, 0.0, -0.6))
STEEL = metal_gloss(0.7, (0.8, 0.7, 0.6))
SIZE = 2.0
STEPS = 160


def beside_a_floor(gloss: tuple[Gloss, ...]) -> Lit:
    """A black wall, mesh 1, at the far end of a floor that reflects as STEEL does."""
    ground = mesh_of("Floor", [quad((0, 0, 0), (SIZE, 0, 0), (0, SIZE, 0))], [0])
    wall = mesh_of("Wall", [quad((SIZE, 0, 0), (0, 0, SIZE), (0, SIZE, 0))], [1])
    steel = Material("Steel", STEEL.albedo, glosses=gloss)
    return lit(Scene((ground, wall), (steel, BLACK), (SUN,)), page_size=96, quality="medium")


def thrown(points: np.ndarray, gloss: Gloss) -> np.ndarray:
    """H / pi (P, 3) on the wall that the floor's facets send there: a sum over its parts."""
    middle = (np.arange(STEPS) + 0.5) * SIZE / STEPS
    x, y = (axis.reshape(-1) for axis in np.meshgrid(middle, middle))
    places = np.stack([x, y, 0 * x], axis=1)
    up, towards = np.float32([[0, 0, 1]]), -np.float32([SUN.direction])
    found = []
    for point in points:
        gap = point - places
        squared = (gap**2).sum(axis=1)
        way = (gap / np.sqrt(squared)[:, None]).astype(np.float32)
        share, cosine = facets_towards(np.float32([gloss.width]), up, towards, way)
        fresnel = [np.interp(cosine * FRESNEL_STEPS, range(FRESNEL_STEPS + 1), f) for f in np.array(gloss.fresnel).T]
        sent = share * np.array(fresnel) * 10.0 * 0.6
        found.append((sent * way[:, 2] * way[:, 0] / squared).sum(axis=1) * (SIZE / STEPS) ** 2 / np.pi)
    return np.array(found)


def test_a_wall_has_the_light_that_facets_throw_at_it() -> None:
    found = beside_a_floor((STEEL,))
    wall = found.mesh == 1
    inner = wall & (found.position[:, 2] > 0.2) & (np.abs(found.position[:, 1] - 1) < 0.8)
    chosen = np.flatnonzero(inner)[::37]
    expected = thrown(found.position[chosen], STEEL)
    light = found.light[chosen] - 10.0 * 0.8 / np.pi  # of the sun itself
    assert np.sqrt(np.mean((light - expected) ** 2)) < 0.06 * expected.mean()
    assert light.mean() == pytest.approx(expected.mean(), rel=0.03)


def test_gleams_stay_in_their_suns_light_group() -> None:
    scene = Scene((floor(),), (Material("Steel", STEEL.albedo, glosses=(STEEL,)),))
    surfaces = flatten(scene)
    texels = finish(rasterize(cell_atlas(scene, 32), surfaces, 1))
    row, light = np.arange(texels.count, dtype=np.int32), np.ones((1, texels.count, 3), np.float32)
    beams = Beams(row, light, -np.float32([SUN.direction]), (1,), scene.materials)
    mirrored = np.float32([[-0.8, 0, -0.6]])  # a ray that looks down where the sun is thrown to
    ray, found = Gleams(beams, texels, 2).seen(np.int32([5]), mirrored)
    assert ray.tolist() == [0]
    assert (found[:, :3] == 0).all()
    assert (found[:, 3:] > 0.1).all()


def test_only_suns_in_gloss_change_what_a_wall_has() -> None:
    """Without a gloss the floor of the same reflectance is diffuse: most light then stays low."""
    glossy, diffuse = (beside_a_floor(gloss) for gloss in ((STEEL,), ()))
    high = (glossy.mesh == 1) & (glossy.position[:, 2] > 1)
    sunlight = np.float32(10.0 * 0.8 / np.pi)
    assert (glossy.light[high] - sunlight).mean() > 1.5 * (diffuse.light[high] - sunlight).mean()
    assert np.array_equal(glossy.of(0), diffuse.of(0))
