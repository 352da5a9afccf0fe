# SPDX-License-Identifier: GPL-3.0-or-later
"""What surfaces let straight through: constants and pictures, and how rays pass them."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.transmittance import BUDGET, Transmittance, transmittance_of
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.microfacet import mean_pane_transmittance
from radiosity_addon.scene import Material, Mesh, Scene
from tests.painter import Painter
from tests.shapes import mesh_of, quad

OPAQUE = Material("Opaque")
CUT_OUT = Material("Cut-out", varies=frozenset({"transmittance"}))


def pane_of(*transmittance: float) -> Material:
    red, green, blue = transmittance if len(transmittance) == 3 else transmittance * 3
    return Material("Pane", (0.0,) * 3, transmittance=(red, green, blue))


def panes(heights, material=0, size=2.0) -> Mesh:
    """Squares that face up, around the z axis."""
    return mesh_of("Panes", [quad((-size / 2, -size / 2, z), (size, 0, 0), (0, size, 0)) for z in heights], material)


def looked(scene: Scene, painter: Painter | None = None, density: float = 16.0) -> Transmittance | None:
    return transmittance_of(scene, flatten(scene), painter, density)


def painted(color, mesh: Mesh | None = None, density: float = 16.0) -> Transmittance:
    """What a mesh, by default a square of 2 m, lets through, painted by a function of points."""
    scene = Scene((mesh or panes([0.0], [0]),), (CUT_OUT,))
    found = looked(scene, Painter(scene, {"transmittance": color}), density)
    assert found is not None
    return found


def seen_through(scene: Scene, painter: Painter | None = None) -> Visibility:
    surfaces = flatten(scene)
    return Visibility(surfaces.corners, transmittance_of(scene, surfaces, painter, 16.0), surfaces.offset)


def random_points(count: int = 4000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles 0 and 1 and barycentrics."""
    rng = np.random.default_rng(3)
    u, v = rng.uniform(0, 1, (2, count)).astype(np.float32)
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return rng.integers(0, 2, count).astype(np.int32), u, v


def test_a_scene_of_opaque_surfaces_has_none() -> None:
    assert looked(Scene((panes([0.0], [0]),), (OPAQUE,))) is None


def test_without_a_shader_the_mean_of_what_varies_serves() -> None:
    mean = Material("Leaf", transmittance=(0.3,) * 3, varies=frozenset({"transmittance"}))
    found = looked(Scene((panes([0.0], [0]),), (mean,)))
    assert found is not None
    assert found.at(np.zeros(1, np.int32), np.float32([0.2]), np.float32([0.2])) == pytest.approx(0.3)


def test_grey_has_one_channel_and_colour_three() -> None:
    for material, channels in ((pane_of(0.3), 1), (pane_of(0.3, 0.2, 0.3), 3)):
        found = looked(Scene((panes([0.0], [0]),), (material,)))
        assert found is not None
        assert found.channels == channels
    assert painted(lambda points: np.repeat(0.5 + points[:, :1] / 4, 3, axis=1)).channels == 1
    assert painted(lambda points: np.clip(points + 0.5, 0, 1)).channels == 3


def test_a_coloured_picture_lies_channel_by_channel_in_memory() -> None:
    """Where channels alternate, each look-up copies a whole channel first: a bake took ten times as long."""
    assert painted(lambda points: np.clip(points + 0.5, 0, 1)).texels.flags.c_contiguous


def test_a_picture_of_a_gradient_is_the_gradient() -> None:
    found = painted(lambda points: np.repeat(0.5 + points[:, :1] / 4 - points[:, 1:2] / 8, 3, axis=1))
    triangle, u, v = random_points()
    scene = Scene((panes([0.0], [0]),), (CUT_OUT,))
    points = flatten(scene).points(triangle, np.stack([u, v], axis=1))
    assert found.at(triangle, u, v)[0] == pytest.approx(0.5 + points[:, 0] / 4 - points[:, 1] / 8, abs=1e-4)


def test_a_clear_triangle_beside_an_opaque_one_stays_clear_to_its_edge() -> None:
    def upper(points: np.ndarray) -> np.ndarray:
        return np.repeat((points[:, 1:2] > points[:, :1]).astype(float), 3, axis=1)

    def each(points: np.ndarray) -> np.ndarray:
        return np.repeat((points[:, 2:] > 0.5).astype(float), 3, axis=1)

    found = painted(each, panes([0.0, 1.0], [0, 0]))
    assert list(found.opaque) == [True, True, False, False]
    assert list(found.clear) == [False, False, True, True]
    mixed = painted(upper)
    assert not mixed.opaque.any()
    assert not mixed.clear.any()


@pytest.mark.parametrize("count", [3, 5000, 100_000])
def test_pictures_keep_to_the_budget_and_to_themselves(count: int) -> None:
    rng = np.random.default_rng(1)
    corners = rng.uniform(-5, 5, (count, 1, 3)) + rng.uniform(-1, 1, (count, 3, 3)) * rng.uniform(0, 0.5, (count, 1, 1))
    index = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    face = np.arange(count, dtype=np.int32)
    normals = np.zeros((count, 3, 3), np.float32)
    mesh = Mesh("Leaves", corners.reshape(-1, 3), index, normals, 0 * face, face, index)
    asked = []

    def shade(layout, meshes, quantity):
        uv = layout.uv[0]
        assert uv.min() >= 0
        assert uv.max() <= 1
        low = np.floor(uv.min(1) * layout.size).astype(int)  # cells are square, so their lower left texels tell them
        assert len(np.unique(low[:, 1] * layout.size + low[:, 0])) == count
        asked.append((layout.size, (((uv[:, 1, 0] - uv[:, 0, 0]) * layout.size) ** 2).sum()))
        return np.full((1, layout.size, layout.size, 3), 0.5, np.float32)

    scene = Scene((mesh,), (CUT_OUT,))
    assert transmittance_of(scene, flatten(scene), shade, 500.0) is not None
    ((size, used),) = asked
    assert used <= BUDGET
    assert size**2 <= 4 * BUDGET


@pytest.mark.parametrize("count", [1, 2, 7])
def test_each_pane_dims_once_from_any_angle(count: int) -> None:
    through = seen_through(Scene((panes(np.arange(count) / 10, [0] * count, 60.0),), (pane_of(0.5),)))
    tilt = np.linspace(0, np.radians(88), 400)
    way = np.stack([np.sin(tilt), 0 * tilt, -np.cos(tilt)], axis=1)
    origins = -way * (0.8 / np.cos(tilt)[:, None]) + [0.013, 0.021, -0.01]
    share = through.transmitted(origins.astype(np.float32), (way * (1.5 / np.cos(tilt)[:, None])).astype(np.float32))
    assert np.array_equal(share, np.full((1, 400), 0.5**count, np.float32))


def test_colours_multiply() -> None:
    scene = Scene((panes([0.0, 0.1], [0, 1]),), (pane_of(1, 0.5, 0), pane_of(0.5, 0.5, 1)))
    share = seen_through(scene).transmitted(np.float32([[0.1, 0.2, 1]]), np.float32([[0, 0, -2]]))
    assert share[:, 0] == pytest.approx((0.5, 0.25, 0))


def test_a_target_on_a_pane_is_not_dimmed_by_it() -> None:
    through = seen_through(Scene((panes([0.0, 0.5], [0, 0]),), (pane_of(0.5),)))
    assert through.transmitted(np.float32([[0.1, 0.2, 1]]), np.float32([[0, 0, -1]]))[0, 0] == np.float32(0.5)


def test_what_is_opaque_behind_panes_stops_all() -> None:
    scene = Scene((panes([0.0, 0.1, 0.2], [0, 1, 0]),), (pane_of(0.5), OPAQUE))
    through = seen_through(scene)
    ray = np.float32([[0.1, 0.2, 1]]), np.float32([[0, 0, -2]])
    assert through.transmitted(*ray)[0, 0] == 0
    assert through.occluded(*ray)[0]


def test_rays_pass_panes_in_proportion_and_meet_what_is_behind() -> None:
    """One chance serves all layers: of n rays of one receiver t^2 n pass two panes, to within one."""
    scene = Scene((panes([-0.2, -0.1, 0.2], [0, 0, 1]),), (pane_of(0.75), OPAQUE))
    through = seen_through(scene)
    count = 1024
    origins = np.tile(np.float32([0.1, 0.2, -1]), (count, 1))
    hits = through.first_hit(
        origins, np.tile(np.float32([0, 0, 2]), (count, 1)), (np.arange(count) / count).astype("f")
    )
    met = [np.count_nonzero(hits.triangle >> 1 == pane) for pane in range(3)]
    assert met == pytest.approx([0.25 * count, 0.1875 * count, 0.5625 * count], abs=1)
    for pane, height in enumerate((-0.2, -0.1, 0.2)):
        assert hits.distance[hits.triangle >> 1 == pane] == pytest.approx((height + 1) / 2, abs=1e-5)
    assert not hits.front.any()
    assert hits.tint is None
    hashed = through.first_hit(
        origins + np.float32(1e-3) * np.random.default_rng(1).normal(size=(count, 3)), origins * 0 + (0, 0, 1)
    )
    assert np.count_nonzero(hashed.triangle >> 1 == 2) == pytest.approx(0.5625 * count, abs=4 * 16)


def test_tint_and_chance_together_are_the_transmittance() -> None:
    scene = Scene((panes([0.0, 0.1], [0, 1]),), (pane_of(1, 0.5, 0), pane_of(0.2, 0.6, 1)))
    count = 1 << 14
    origins = np.tile(np.float32([0.1, 0.2, -1]), (count, 1))
    chance = (np.arange(count) / count).astype(np.float32)
    hits = seen_through(scene).first_hit(origins, np.tile(np.float32([0, 0, 1]), (count, 1)), chance)
    assert hits.tint is not None
    passed = hits.triangle < 0
    assert hits.tint[passed].sum(0) / count == pytest.approx((0.2, 0.3, 0), abs=2e-4)


def test_clear_triangles_are_met_by_no_ray() -> None:
    through = seen_through(Scene((panes([0.0], [0]),), (pane_of(1.0),)))
    ray = np.float32([[0.1, 0.2, 1]]), np.float32([[0, 0, -2]])
    assert through.transmitted(*ray)[0, 0] == 1
    assert through.first_hit(*ray).triangle[0] < 0
    assert through.escapes(*ray)[0]


def test_a_slab_of_glass_passes_less_at_grazing_angles() -> None:
    """Two surfaces of n = 1.5 pass (1 - F) / (1 + F): 12 / 13 from above, and by Fresnel at 60 degrees, F = 0.0892."""
    mean = mean_pane_transmittance(1.5)
    slab = Material("Glass", (0.0,) * 3, transmittance=(mean,) * 3, ior=1.5)
    through = seen_through(Scene((panes([-0.05, 0.05], [0, 0], 60.0),), (slab,)))
    ways = np.float32([[0, 0, -1], [3**0.5, 0, -1]])
    share = through.transmitted(-ways + np.float32([0.01, 0.02, 0]), 2 * ways)[0]
    assert share == pytest.approx([12 / 13, (1 - 0.0892) / (1 + 0.0892)], abs=1e-4)
