# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes of scenes that let light through: panes, cut-outs and stained glass, with answers known on paper."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.arrays import Float32, Float64
from radiosity_addon.bake import Baked, bake
from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import rasterize
from radiosity_addon.lighting.shadows import Tally
from radiosity_addon.scene import AreaLight, Light, Material, Mesh, PointLight, Scene, SunLight, World
from radiosity_addon.settings import BakeSettings
from tests.painter import Painter
from tests.shapes import box, mesh_of, quad

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

BLACK = Material("Black", (0.0,) * 3)
CUT_OUT = Material("Cut-out", (0.0,) * 3, varies=frozenset({"transmittance"}))
NOON = SunLight("Noon", (np.pi,) * 3, (0.0, 0.0, -1.0))

LAMPS: dict[str, Light] = {
    "sun": SunLight("Sun", (3.0,) * 3, (0.3, 0, -0.95)),
    "wide sun": SunLight("Sun", (3.0,) * 3, (0.3, 0, -0.95), 0.3),
    "point": PointLight("Point", (10.0,) * 3, (0.1, 0.2, 2.0)),
    "area": AreaLight("Area", (10.0,) * 3, (0, 0, 2.0), (1, 0, 0), (0, 1, 0), (0, 0, -1)),
}


def clear(*transmittance: float, reflectance: float = 0.0, emission: float = 0.0) -> Material:
    red, green, blue = transmittance if len(transmittance) == 3 else transmittance * 3
    return Material("Clear", (reflectance,) * 3, (emission,) * 3, transmittance=(red, green, blue))


def floor(size: float = 4.0) -> Mesh:
    """A square in z = 0 that faces up."""
    return mesh_of("Floor", [quad((-size / 2, -size / 2, 0), (size, 0, 0), (0, size, 0))], [0])


def pane(height: float, size: float = 8.0, material: int = 1) -> Mesh:
    """A square that faces up and has no lightmap."""
    corners = quad((-size / 2, -size / 2, height), (size, 0, 0), (0, size, 0))
    return mesh_of(f"Pane {height}", [corners], [material], lightmapped=False)


def bake_of(scene: Scene, painter: Painter | None = None, **settings: object) -> Baked:
    baked = finish(bake(scene, BakeSettings(**{"page_size": 64, "quality": "draft", **settings}), painter))
    assert all(np.isfinite(page).all() for page in baked.pages)
    assert all(page.min() > -1e-3 for page in baked.pages)  # a fit may reach below a channel that is dark
    return baked


def lit(scene: Scene, painter: Painter | None = None, **settings: object) -> tuple[Float64, Float32]:
    """Positions (T, 3), m, and light (T, 3), H / pi, of the texels of the first mesh."""
    baked = bake_of(scene, painter, **settings)
    surfaces = flatten(scene)
    texels = finish(rasterize(baked.atlas, surfaces, 1))
    own = np.flatnonzero((surfaces.mesh[texels.triangle[:]] == 0) & (texels.covered == 15))
    own = own[texels.pixel[own] < baked.atlas.size**2]
    return texels.position[own] + surfaces.origin, baked.pages[0].reshape(-1, 3)[texels.pixel[own]]


def painted(scene: Scene, share: Callable[[Float64], Float64]) -> Painter:
    """Paints a grey transmittance (P,) over points (P, 3)."""
    return Painter(scene, {"transmittance": lambda points: np.repeat(share(points)[:, None], 3, axis=1)})


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("name", LAMPS)
def test_panes_of_red_glass_dim_direct_light_by_a_power_exactly(name: str, count: int) -> None:
    panes = tuple(pane(0.5 + 0.1 * k) for k in range(count))
    page = bake_of(Scene((floor(), *panes), (BLACK, clear(1, 0.25, 0)), (LAMPS[name],))).pages[0]
    bare = bake_of(Scene((floor(),), (BLACK,), (LAMPS[name],))).pages[0]
    assert np.array_equal(page, bare * np.float32([1, 0.25**count, 0]))


def test_a_uniform_pane_costs_no_ray_more_than_the_probes() -> None:
    rays = {}
    for name, material in (("pane", clear(0.5)), ("none", clear(1.0))):
        scene = Scene((floor(), pane(0.5)), (BLACK, material), (LAMPS["area"],))
        rays[name] = next(stage.rays for stage in bake_of(scene).stages if stage.name == "Direct light")
    assert rays["pane"] <= 1.01 * rays["none"]


def test_a_texel_whose_probe_met_no_light_is_dimmed_as_its_neighbours_are() -> None:
    """Half of the lamp stands below the floor: many a texel's one probe aims at that half."""
    lamp = AreaLight("Low", (10.0,) * 3, (3, 0, 0), (0, 2, 0), (0, 0, 2), (-1, 0, 0))
    upright = mesh_of("Pane", [quad((2, -9, -9), (0, 18, 0), (0, 0, 18))], [1], lightmapped=False)
    page = bake_of(Scene((floor(2.0), upright), (BLACK, clear(0.5)), (lamp,))).pages[0]
    bare = bake_of(Scene((floor(2.0),), (BLACK,), (lamp,))).pages[0]
    assert page == pytest.approx(0.5 * bare, rel=1e-5)


def test_samples_that_are_all_dimmed_alike_have_no_variance() -> None:
    total = np.float32([8.0, 8.0, 8.0])
    squares = np.float32([16.0, 16.0, 16.0])  # four samples of light 2
    share = np.float32([[0.25, 0.25, 1.0]])  # one of four arrives, all arrive to a quarter, all arrive
    partly = np.float32([[0.0, 16 * 0.25 * 0.75, 0.0]])
    found = Tally(total, share * total, squares, partly)
    assert found.variance()[0] == pytest.approx([0.25 * 0.75 / 4, 0, 0])


def test_a_sun_casts_a_checker_where_it_must() -> None:
    """Squares of 0.5 m, at noon: the pattern stands on the floor as it hangs, texels on edges hold their share."""
    scene = Scene((floor(), pane(1.0, 4.0)), (BLACK, CUT_OUT), (NOON,))

    def checker(points: Float64) -> Float64:
        return ((np.floor(2 * points[:, 0]) + np.floor(2 * points[:, 1])) % 2).astype(float)

    position, light = lit(scene, painted(scene, checker))
    away = np.abs(2 * position[:, :2] - np.round(2 * position[:, :2])).min(1) / 2  # m to the nearest edge
    inside = away > 0.08
    assert np.count_nonzero(inside) > 500
    assert light[inside, 0] == pytest.approx(checker(position[inside]), abs=1e-5)
    assert light[:, 0].mean() == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("name", ["wide sun", "area"])
def test_the_far_penumbra_of_fine_foliage_is_its_mean(name: str) -> None:
    """Holes of 5 cm over a quarter of a screen that hangs over the whole floor, lamps that blur them."""
    lamps = {"wide sun": SunLight("Sun", (np.pi,) * 3, (0, 0, -1), 0.4), "area": LAMPS["area"]}
    scene = Scene((floor(1.0), pane(1.0, 3.0)), (BLACK, CUT_OUT), (lamps[name],))

    def holes(points: Float64) -> Float64:
        return ((np.floor(20 * points[:, :2]) % 2).sum(1) == 2).astype(float)

    page = bake_of(scene, painted(scene, holes), quality="medium").pages[0]
    bare = bake_of(Scene(scene.meshes[:1], (BLACK,), scene.lights), quality="medium").pages[0]
    shown = bare[..., 0] > 0
    ratio = page[..., 0][shown] / bare[..., 0][shown]
    assert ratio.mean() == pytest.approx(0.25, abs=0.005)
    assert ratio.std() < 0.035  # 0.072 would be that of the first samples, were they independent


def test_an_alpha_gradient_shows_on_the_floor_without_noise() -> None:
    scene = Scene((floor(), pane(1.0, 4.0)), (BLACK, CUT_OUT), (NOON,))
    position, light = lit(scene, painted(scene, lambda points: 0.5 + points[:, 0] / 4))
    assert light[:, 0] == pytest.approx(0.5 + position[:, 0] / 4, abs=2e-3)


def test_a_cut_out_leaf_shadows_through_an_opaque_floor_no_more_than_once() -> None:
    """A floor in two layers, the lower one in full shadow whatever hangs above."""
    scene = Scene((floor(), pane(0.5, 8.0, 0), pane(1.0)), (BLACK, clear(0.5)), (NOON,))
    assert not bake_of(scene).pages[0].any()


@pytest.mark.parametrize("quality", ["draft", "medium"])
def test_furnace_with_a_half_clear_wall_inside(quality: str) -> None:
    """What stops light has E = 1 and rho = 0.5, whatever share it stops: H = B = 2."""
    glow = Material("Glow", (0.5,) * 3, (1 / np.pi,) * 3)
    half = clear(0.5, reflectance=0.25, emission=0.5 / np.pi)
    room = box("Room", (0, 0, 0), (3, 2, 1), inward=True)
    wall = mesh_of("Wall", [quad((1, 0, 0), (0, 2, 0), (0, 0, 1))], [1])
    _, light = lit(Scene((room, wall), (glow, half)), quality=quality, tolerance=1e-7)
    assert light.mean() * np.pi == pytest.approx(2, rel=0.003)
    assert np.abs(light * np.pi / 2 - 1).max() < (0.08 if quality == "draft" else 0.05)


@pytest.mark.parametrize(("lamps", "sky"), [(1.0, 0.0), (0.0, 1.0), (0.5, 0.25)])
def test_a_pane_may_let_through_other_shares_of_the_light_of_lamps_and_of_all_else(lamps: float, sky: float) -> None:
    pane_of_both = replace(clear(lamps), indirect_transmittance=(sky,) * 3)
    noon, world = replace(NOON, angle=0.0), World((1.0,) * 3)
    sun = bake_of(Scene((floor(), pane(0.3, 400)), (BLACK, pane_of_both), (noon,))).pages[0].reshape(-1, 3)
    bare = bake_of(Scene((floor(),), (BLACK,), (noon,))).pages[0].reshape(-1, 3)
    np.testing.assert_allclose(sun, lamps * bare, atol=1e-5)
    under = bake_of(Scene((floor(), pane(0.3, 400)), (BLACK, pane_of_both), world=world), quality="medium").pages[0]
    assert under.mean() == pytest.approx(sky, abs=0.003)


@pytest.mark.parametrize("transmittance", [(0.5,), (1.0, 0.25, 0.0)])
def test_the_sky_through_a_pane_is_dimmed_and_coloured(transmittance: tuple[float, ...]) -> None:
    scene = Scene((floor(), pane(0.3, 400)), (BLACK, clear(*transmittance)), world=World((1.0,) * 3))
    light = bake_of(scene, quality="medium").pages[0].reshape(-1, 3)
    assert light.mean(0) == pytest.approx(np.broadcast_to(transmittance, 3), abs=0.003)  # medium errs by 2.1e-3
    assert (light.std(0) < 0.03).all()


def test_light_that_the_sky_sends_through_red_glass_bounces_red() -> None:
    """A white floor under a wide red pane, a white plate that sees the floor alone: no green light is anywhere."""
    plate = mesh_of("Plate", [quad((-1, -1, 0.2), (0, 2, 0), (2, 0, 0))], [0])
    ground = pane(0.0, 400, 0)
    scene = Scene((plate, ground, pane(0.4, 400)), (Material("White"), clear(1, 0, 0)), world=World((1.0,) * 3))
    _, light = lit(scene)
    assert light[:, 0].mean() > 0.05
    assert (light[:, 1:] < 2e-3 * light[:, :1].mean()).all()  # 1.3e-3 at most


def test_a_closed_box_that_is_wholly_clear_changes_nothing_at_all() -> None:
    lamps = (LAMPS["area"], PointLight("Inside", (1.0,) * 3, (0, 0, 0.4)))
    case = box("Case", (-0.5, -0.5, 0.01), (0.5, 0.5, 0.8), 1, lightmapped=False)
    world = World((0.5,) * 3)
    materials = (Material("Grey", (0.5,) * 3), clear(1.0))
    assert np.array_equal(
        bake_of(Scene((floor(), case), materials, lamps, world)).pages[0],
        bake_of(Scene((floor(),), materials, lamps, world)).pages[0],
    )


def test_what_stands_in_a_glass_case_is_lit_and_not_inside_a_solid() -> None:
    case = box("Case", (-1, -1, -0.5), (1, 1, 1), 1, lightmapped=False)
    scene = Scene((floor(1.0), case), (BLACK, clear(0.5)), (NOON,))
    assert bake_of(scene).pages[0] == pytest.approx(0.5)


def test_a_lamp_in_a_glass_case_shines_out_of_it() -> None:
    case = box("Case", (-0.2, -0.2, 0.8), (0.2, 0.2, 1.2), 1, lightmapped=False)
    lamp = PointLight("Lamp", (1.0,) * 3, (0, 0, 1))
    dimmed = bake_of(Scene((floor(), case), (BLACK, clear(0.5, 1, 0)), (lamp,))).pages[0]
    bare = bake_of(Scene((floor(),), (BLACK,), (lamp,))).pages[0]
    assert dimmed == pytest.approx(bare * np.float32([0.5, 1, 0]), rel=1e-4)


def test_a_half_clear_panel_that_glows_lights_as_what_it_emits() -> None:
    """Emission is of the surface as a whole: what it lets pass takes nothing from it, and nothing hides it."""
    light = {}
    for name, passing in (("opaque", 0.0), ("half", 0.5), ("all", 1.0)):
        glow = clear(passing, emission=3.0)
        panel = mesh_of("Panel", [quad((-0.5, -0.5, 1), (0, 1, 0), (1, 0, 0))], [1], lightmapped=False)
        light[name] = bake_of(Scene((floor(), panel), (BLACK, glow))).pages[0]
    assert np.array_equal(light["half"], light["opaque"])
    assert np.array_equal(light["all"], light["opaque"])


def test_a_glowing_dome_that_is_clear_lights_though_no_ray_meets_it() -> None:
    """Larger than a lamp may be, yet nothing stops at it: it has to be a lamp."""
    glow = clear(1.0, emission=1.0)
    page = bake_of(Scene((floor(1.0), pane(0.5, 200)), (BLACK, glow))).pages[0]
    assert page == pytest.approx(1, abs=0.02)


def test_a_page_of_a_cut_out_is_lit_where_it_is_clear_too() -> None:
    own = Material("Own", (0.0,) * 3, varies=frozenset({"transmittance"}))
    scene = Scene((mesh_of("Floor", [quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))], [0]),), (own,), (NOON,))
    baked = bake_of(scene, painted(scene, lambda points: (points[:, 0] > 0).astype(float)))
    assert baked.pages[0] == pytest.approx(1)


def test_a_bake_through_leaves_does_not_depend_on_the_number_of_threads() -> None:
    leaves = Material("Leaves", (0.3,) * 3, varies=frozenset({"transmittance"}))
    lamps = (LAMPS["wide sun"],)
    scene = Scene((floor(), pane(1.0, 2.0), pane(1.2, 2.0)), (Material("Grey"), leaves), lamps, World((0.3,) * 3))
    shade = painted(scene, lambda points: (np.sin(20 * points[:, 0]) * np.sin(17 * points[:, 1]) > 0).astype(float))
    one, four = (bake_of(scene, shade, threads=threads).pages[0] for threads in (1, 4))
    assert np.array_equal(one, four)


@pytest.mark.parametrize("form_factors", ["nusselt", "hemicube", "area"])
def test_light_that_bounces_through_stained_glass_has_its_colours(form_factors: str) -> None:
    """A lamp under a pane lights a floor, and the floor a ceiling: all of that light passes the pane once."""
    glass = (0.9, 0.3, 0.06)
    ceiling = mesh_of("Ceiling", [quad((-1, -1, 1), (0, 2, 0), (2, 0, 0))], [2])
    below = AreaLight("Below", (10.0,) * 3, (0, 0, 0.3), (0.2, 0, 0), (0, 0.2, 0), (0, 0, -1))
    scene = Scene((ceiling, floor(2.0), pane(0.5)), (Material("Grey"), clear(*glass), BLACK), (below,))
    _, light = lit(scene, final_gather=False, form_factors=form_factors, quality="medium")
    mean = light.mean(axis=0)
    assert mean.mean() > 0.005
    assert mean / mean.mean() == pytest.approx(np.array(glass) / np.mean(glass), rel=1e-3)
