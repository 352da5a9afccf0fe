# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole bakes held to physics: answers known on paper, symmetries, and what must not leak, break or differ."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.arrays import Float32, Float64
from radiosity_addon.bake import Baked, bake
from radiosity_addon.chunks import finish
from radiosity_addon.errors import SceneError
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import rasterize
from radiosity_addon.scene import AreaLight, Light, Material, Mesh, PointLight, Scene, SpotLight, SunLight, World
from radiosity_addon.settings import BakeSettings
from radiosity_addon.stages import STAGES, Progress
from tests.bakes import BLACK, WHITE, bake_of, floor, lit
from tests.shapes import box, furnished_room, mesh_of, quad, sphere

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")  # what NumPy has to say is heard first


WATTS_100 = (100 / (4 * np.pi),) * 3
"""W/sr of a point lamp of 100 W."""


def in_the_middle(page: Float32) -> Float64:
    """Mean over the four texels around the middle of a page that a square floor fills."""
    half = len(page) // 2
    return page[half - 1 : half + 1, half - 1 : half + 1].mean((0, 1), dtype=np.float64)


# answers known on paper


@pytest.mark.parametrize("quality", ["draft", "medium"])
@pytest.mark.parametrize("reflectance, expected", [(0.5, 2.0), (0.9, 10.0)])
def test_furnace(reflectance: float, expected: float, quality: str) -> None:
    """Closed, E = 1 and rho uniform: H = B = E / (1 - rho) at every texel."""
    glow = Material("Glow", (reflectance,) * 3, (1 / np.pi,) * 3)
    room = Scene((box("Room", (0, 0, 0), (3, 2, 1), inward=True),), (glow,))
    page = bake_of(room, quality=quality, tolerance=1e-7).pages[0]
    assert np.abs(page * np.pi / expected - 1).max() < 1e-5


def test_integrating_sphere_of_100_w() -> None:
    """R = 1 m, rho = 0.5: radiance rho H / pi = 100 / (4 pi^2) rho / (1 - rho) = 2.5330 everywhere."""
    ball = sphere("Sphere", segments=64, rings=64, inward=True)
    scene = Scene((ball,), (Material("Half", (0.5,) * 3),), (PointLight("Lamp", WATTS_100, (0, 0, 0)),))
    page = bake_of(scene, page_size=128, quality="medium").pages[0]
    assert np.abs(0.5 * page / 2.5330 - 1).max() < 0.01


def test_bounced_light_in_a_sphere_is_even_wherever_its_lamp_hangs() -> None:
    """All that bounces is H = P rho / (4 pi (1 - rho)), though one side is lit 80 times as strongly as the other."""
    ball = sphere("Sphere", segments=64, rings=64, inward=True)
    at = np.array([0.8, 0, 0])
    lamp = PointLight("Lamp", WATTS_100, tuple(at))
    found = lit(Scene((ball,), (Material("Half", (0.5,) * 3),), (lamp,)), quality="medium", page_size=128)
    gap = at - found.position
    distance = np.linalg.norm(gap, axis=1)
    radial = -found.position / np.linalg.norm(found.position, axis=1)[:, None]
    direct = WATTS_100[0] * (gap * radial).sum(1) / distance**3
    bounced = np.pi * found.light[:, 0] - direct
    far = found.position[:, 0] < 0.3  # facets stray from the sphere by more than bounced light nearer to the lamp
    expected = 100 / (4 * np.pi)
    assert bounced[far].mean() == pytest.approx(expected, rel=0.01)
    error = bounced[far] / expected - 1
    assert error.std() < 0.011, "0.0078 to 0.0088 with the lamp in eight directions"
    assert np.abs(error).max() < 0.08, "0.051 to 0.061"


CLOCK = 0.02
"""Seconds by which clocks of threads and of the process may differ."""

HANGING: dict[str, tuple[Light, float]] = {
    "point": (PointLight("Lamp", WATTS_100, (0, 0, 2)), 0.633257),
    "spot": (
        SpotLight("Lamp", WATTS_100, (0, 0, 2), ((1, 0, 0), (0, 1, 0), (0, 0, -1)), 0.8, 0.2),
        0.633257,
    ),
    "soft point": (PointLight("Lamp", WATTS_100, (0, 0, 2), radius=0.5), 0.633257 / (1 + 0.5**2 / 2**2)),
    "sun": (SunLight("Lamp", (3.0,) * 3, (0, 0, -1)), 0.954930),
    "wide sun": (SunLight("Lamp", (3.0,) * 3, (0, 0, -1), 0.5), 0.954930),
    "square": (AreaLight("Lamp", (100 / np.pi,) * 3, (0, 0, 2), (1, 0, 0), (0, 1, 0), (0, 0, -1)), 2.33887),
}


@pytest.mark.parametrize("kind", HANGING)
def test_a_lamp_over_a_floor_gives_what_cycles_measured(kind: str) -> None:
    """H / pi below a lamp of 100 W, or a sun of 3 W/m2, 2 m above an open floor."""
    lamp, expected = HANGING[kind]
    page = bake_of(Scene((floor(),), (WHITE,), (lamp,))).pages[0]
    assert in_the_middle(page) == pytest.approx(expected, rel=0.005)


def test_an_emissive_square_lights_the_floor_like_a_lamp_of_its_radiance() -> None:
    glow = Material("Glow", (0.0,) * 3, (100 / np.pi,) * 3)
    panel = mesh_of("Panel", [quad((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0))], [1])
    found = lit(Scene((floor(), panel), (WHITE, glow)))
    near = (found.mesh == 0) & (np.abs(found.position[:, :2]).max(1) < 0.1)
    assert found.light[near].mean(0, dtype=np.float64) == pytest.approx(2.33887, rel=0.005)
    assert found.of(1).max() < 0.75 * found.of(0).max(), "emission itself is not on the page"


def test_a_point_lamp_follows_the_inverse_square_of_distance_on_the_whole_floor() -> None:
    found = lit(Scene((floor(),), (WHITE,), (PointLight("Lamp", WATTS_100, (0.3, -0.2, 2)),)))
    squared = ((found.position - [0.3, -0.2, 2]) ** 2).sum(1)
    expected = WATTS_100[0] * 2 / squared**1.5 / np.pi
    assert np.abs(found.light[:, 0] / expected - 1).max() < 0.005


def test_an_open_floor_under_an_even_world_has_the_worlds_radiance() -> None:
    sky = (0.7, 0.5, 0.3)
    page = bake_of(Scene((floor(),), (WHITE,), world=World(sky))).pages[0]
    assert np.abs(page / np.float32(sky) - 1).max() < 0.002


def test_a_black_wall_takes_away_half_of_the_sky() -> None:
    """At distance x from an endless wall of height h a share (1 + x / sqrt(x^2 + h^2)) / 2 of the sky is left."""
    height = 40.0
    wall = mesh_of("Wall", [quad((0, -100, 0), (0, 200, 0), (0, 0, height))], [1], lightmapped=False)
    ground = mesh_of("Floor", [quad((0, -0.5, 0), (1, 0, 0), (0, 1, 0))], [0])
    found = lit(Scene((ground, wall), (WHITE, BLACK), world=World((1, 1, 1))), quality="high", page_size=32)
    x = found.position[:, 0]
    expected = (1 + x / np.sqrt(x**2 + height**2)) / 2
    assert found.light.mean() == pytest.approx(expected.mean(), rel=0.005)
    assert np.abs(found.light[:, 0] / expected - 1).max() < 0.1


def test_a_closed_room_absorbs_what_its_lamp_sends_out() -> None:
    """The irradiance on all surfaces times 1 - rho sums to the lamp's power pi A L: the gather loses no light."""
    scene = furnished_room()
    found = lit(scene, quality="medium", page_size=128)
    surfaces = flatten(scene)
    texels = finish(rasterize(found.baked.atlas, surfaces, 1))
    reflectance = np.array([entry.reflectance for entry in scene.materials])
    absorbed = 1 - reflectance[surfaces.material[texels.triangle[:]]]
    hidden = (found.normal[:, 2] < -0.5) & (found.mesh > 0)  # undersides of blocks, on the floor
    under = (found.mesh == 0) & (found.position[:, 2] < 1e-6)
    for low, high in (((0.8, 1), (2.4, 2.6)), ((3, 2.8), (4.6, 4.4))):
        hidden |= under & ((found.position[:, :2] > low) & (found.position[:, :2] < high)).all(1)
    power = np.pi * found.light * absorbed * found.area[:, None]
    lamp = scene.lights[0]
    expected = np.pi * np.array(lamp.radiance) * 1.3 * 1.05
    assert power[~hidden].sum(0, dtype=np.float64) == pytest.approx(expected, rel=0.01)


# symmetries


def with_power(scene: Scene, factor: float) -> Scene:
    lamp = scene.lights[0]
    return replace(scene, lights=(replace(lamp, radiance=tuple(factor * x for x in lamp.radiance)),))


@pytest.mark.parametrize("factor", [2.0, 1000.0, 3.7e-4])
def test_power_times_k_is_light_times_k(factor: float) -> None:
    once = bake_of(furnished_room()).pages[0]
    often = bake_of(with_power(furnished_room(), factor)).pages[0]
    assert np.abs(often / factor - once).max() < 1e-5 * once.max()
    assert often / factor == pytest.approx(once, rel=1e-4)


def two_lamps(groups: int, materials: tuple[Material, ...] | None = None) -> Scene:
    """The furnished room with a second lamp, in a light group of its own if there are two."""
    room = furnished_room()
    lamp = PointLight("Other", (10, 5, 20), (1, 1, 4), group=groups - 1)
    names = tuple("ab"[:groups])
    return replace(room, lights=(*room.lights, lamp), groups=names, materials=materials or room.materials)


def test_direct_light_does_not_depend_on_how_lamps_are_grouped() -> None:
    dark = tuple(replace(entry, reflectance=(0, 0, 0)) for entry in furnished_room().materials)
    one, two = (bake_of(two_lamps(groups, dark)).pages[0] for groups in (1, 2))
    assert one == pytest.approx(two, rel=1e-5, abs=1e-5 * float(one.max()))


def test_light_groups_add_up_to_all_lamps_at_once() -> None:
    """Groups ride on the same rays, and what is taken for missing or clipped depends on their sum alone."""
    one, two = (bake_of(two_lamps(groups), quality="medium", tolerance=1e-8).pages[0] for groups in (1, 2))
    assert np.abs(one - two).max() < 1e-5 * one.max()
    assert one.mean((0, 1), dtype=np.float64) == pytest.approx(two.mean((0, 1), dtype=np.float64), rel=1e-4)


def test_pages_of_light_groups_add_up_to_the_page_and_each_holds_its_own_light() -> None:
    room = two_lamps(2)
    third = replace(room.lights[0], name="Third", group=2)
    baked = bake_of(replace(room, lights=(*room.lights, third), groups=("a", "b", "a")), light_groups=True)
    (a,), (b,) = baked.apart["a"], baked.apart["b"]
    np.testing.assert_allclose(a + b, baked.pages[0], rtol=1e-4, atol=1e-4 * baked.pages[0].max())
    only_b = bake_of(replace(room, lights=room.lights[1:]), light_groups=True)
    assert [page.max() > 0 for (page,) in only_b.apart.values()] == [False, True]
    assert bake_of(room).apart == {}, "unless asked for"


def test_a_dim_group_that_is_kept_apart_gets_as_many_rays_as_a_bright_one() -> None:
    def page_of_b(intensity: float) -> Float32:
        room = two_lamps(2)
        lamp = PointLight("Other", (intensity,) * 3, (1, 1, 4), group=1)
        baked = bake_of(replace(room, lights=(room.lights[0], lamp)), quality="medium", light_groups=True)
        return baked.apart["b"][0] / np.float32(intensity)

    bright, dim = page_of_b(10), page_of_b(0.001)
    lit_up = bright.min(2) > 0.02 * bright.max()
    error = (dim - bright)[lit_up] / bright[lit_up]
    assert np.sqrt((error**2).mean()) < 3e-3


def test_lamps_baked_apart_add_up_within_the_gathers_noise() -> None:
    both = two_lamps(1)
    together = bake_of(both, quality="medium").pages[0]
    apart = sum(bake_of(replace(both, lights=(lamp,)), quality="medium").pages[0] for lamp in both.lights)
    lit_up = together.min(2) > 0.02 * together.max()
    error = (apart - together)[lit_up] / together[lit_up]
    assert abs(error.mean()) < 0.005
    assert np.sqrt((error**2).mean()) < 0.02


def test_a_mirrored_scene_is_lit_alike() -> None:
    scene = furnished_room()

    def mirrored(mesh: Mesh) -> Mesh:
        order = [0, 2, 1]  # the winding turns with the mirror
        return replace(
            mesh,
            vertices=mesh.vertices * [-1, 1, 1],
            triangles=np.ascontiguousarray(mesh.triangles[:, order]),
            corner_normals=mesh.corner_normals[:, order] * np.float32([-1, 1, 1]),
            corner=np.ascontiguousarray(mesh.corner[:, order]),
        )

    lamp = scene.lights[0]
    x, y, z = lamp.position
    other = replace(
        scene, meshes=tuple(mirrored(mesh) for mesh in scene.meshes), lights=(replace(lamp, position=(-x, y, z)),)
    )
    here, there = lit(scene, page_size=128), lit(other, page_size=128)
    for index in range(3):
        means = [
            np.average(found.of(index), axis=0, weights=found.area[found.mesh == index]) for found in (here, there)
        ]
        assert means[0] == pytest.approx(means[1], rel=0.03)


def test_a_million_metres_from_the_origin_is_lit_alike() -> None:
    here = bake_of(furnished_room()).pages[0]
    there = bake_of(furnished_room().moved(np.array([1e6, -1e6, 1e6]))).pages[0]
    assert (np.abs(there - here) < 1e-3 * here.max()).mean() > 0.999


@pytest.mark.parametrize("factor", [2.0**-20, 2.0**-9, 2.0**10], ids=["5 um", "1 cm", "6 km"])
def test_a_room_of_any_size_is_lit_alike(factor: float) -> None:
    """Radiance does not change with the size of things. Powers of two round alike."""
    room = furnished_room()
    lamp = room.lights[0]

    def grown(vector: tuple[float, float, float]) -> tuple[float, ...]:
        return tuple(factor * x for x in vector)

    larger = replace(
        room,
        meshes=tuple(replace(mesh, vertices=factor * mesh.vertices) for mesh in room.meshes),
        lights=(replace(lamp, position=grown(lamp.position), edge_u=grown(lamp.edge_u), edge_v=grown(lamp.edge_v)),),
    )
    here, there = bake_of(room).pages[0], bake_of(larger).pages[0]
    assert (np.abs(there - here) < 1e-3 * here.max()).mean() > 0.999


# who takes part


def test_surfaces_without_a_lightmap_cast_shadows() -> None:
    cover = mesh_of("Cover", [quad((-1, -1, 1), (2, 0, 0), (0, 2, 0))], [0], lightmapped=False)
    found = lit(Scene((floor(), cover), (BLACK,), (SunLight("Sun", (3.0,) * 3, (0, 0, -1)),)))
    assert set(found.mesh) == {0}
    outside = np.abs(found.position[:, :2]).max(1)
    assert found.light[outside < 0.9].max() == 0
    assert found.light[outside > 1.1] == pytest.approx(3 / np.pi, rel=0.005)


def test_surfaces_without_a_lightmap_bounce_the_same_light() -> None:
    scene = furnished_room()
    room, *blocks = scene.meshes
    hidden = replace(scene, meshes=(room, *(replace(block, lightmapped=False) for block in blocks)))
    whole, partly = (lit(entry, quality="medium") for entry in (scene, hidden))
    shown = (whole.position[:, 2] > 1e-3) & (whole.mesh == 0)  # not the floor, part of which is under the blocks
    also = (partly.position[:, 2] > 1e-3) & (partly.mesh == 0)
    mean = whole.light[shown].mean(0, dtype=np.float64)
    assert partly.light[also].mean(0, dtype=np.float64) == pytest.approx(mean, rel=0.02)
    assert list(partly.baked.atlas.page) == [0, 1, 1]
    assert len(partly.baked.pages) == 1


def test_a_light_group_without_light_changes_nothing() -> None:
    room = furnished_room()
    alone = bake_of(room).pages[0]
    beside = bake_of(replace(room, groups=("used", "empty"))).pages[0]
    assert beside == pytest.approx(alone, rel=1e-6)


def test_degenerate_triangles_change_nothing_around_them() -> None:
    """Triangles that are points, lines and slivers, and a face that lies on another one, under an open sky."""
    bad = [
        [(1, 1, 0.5), (1, 1, 0.5), (1, 1, 0.5)],
        [(0, 0, 0.5), (1, 0, 0.5), (2, 0, 0.5)],
        [(0, 0, 0.2), (1, 0, 0.2), (1, 1e-9, 0.2)],
    ]
    count = len(bad)
    triangles = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    up = np.tile(np.float32([0, 0, 1]), (count, 3, 1))
    zeros = np.zeros(count, np.int32)
    mesh = Mesh("Bad", np.reshape(bad, (-1, 3)), triangles, up, zeros, np.arange(count, dtype=np.int32), triangles)
    world = World((0.7, 0.5, 0.3))
    found = lit(Scene((floor(), mesh), (WHITE,), world=world))
    assert np.abs(found.of(0) / np.float32(world.radiance) - 1).max() < 0.002


def test_a_scene_without_light_is_black() -> None:
    assert bake_of(replace(furnished_room(), lights=())).pages[0].max() == 0


@pytest.mark.parametrize("meshes", [(), (floor(lightmapped=False),)], ids=["empty", "nothing lightmapped"])
def test_a_scene_without_a_surface_to_bake_is_an_error(meshes: tuple[Mesh, ...]) -> None:
    with pytest.raises(SceneError, match="no surface to bake"):
        bake_of(Scene(meshes, (WHITE,), (SunLight("Sun", (3.0,) * 3, (0, 0, -1)),)))


# how it runs


@pytest.fixture(scope="module")
def steps() -> tuple[list[Progress], Baked]:
    """All that a bake in medium quality says, and its result."""
    said, running = [], bake(furnished_room(), BakeSettings(page_size=64))
    while True:
        try:
            said.append(next(running))
        except StopIteration as stop:
            return said, stop.value


def test_one_thread_and_two_give_the_same_bits() -> None:
    one, two = (bake_of(two_lamps(2), quality="medium", page_size=128, threads=threads) for threads in (1, 2))
    assert np.array_equal(one.pages[0], two.pages[0])
    assert (one.rays, one.residual) == (two.rays, two.residual)


def test_progress_goes_forward_through_all_stages(steps: tuple[list[Progress], Baked]) -> None:
    said, baked = steps
    fractions = [progress.fraction for progress in said]
    assert fractions == sorted(fractions)
    assert 0 <= fractions[0] <= 0.01
    assert 0.9 < fractions[-1] <= 1
    assert list(dict.fromkeys(progress.stage for progress in said)) == list(STAGES)
    assert [stage.name for stage in baked.stages] == list(STAGES)


def test_rays_grow_and_the_residual_falls_to_the_tolerance(steps: tuple[list[Progress], Baked]) -> None:
    said, baked = steps
    rays, residuals = [progress.rays for progress in said], [progress.residual for progress in said]
    assert rays == sorted(rays)
    assert residuals == sorted(residuals, reverse=True)
    assert 0 < baked.residual <= BakeSettings.tolerance
    assert sum(stage.rays for stage in baked.stages) == baked.rays >= rays[-1] > 0
    assert sum(stage.tally.closest + stage.tally.shadow for stage in baked.stages) == baked.rays


def test_no_stage_spends_more_in_embree_than_it_takes(steps: tuple[list[Progress], Baked]) -> None:
    _, baked = steps
    assert all(0 <= stage.tally.seconds <= stage.processor + CLOCK for stage in baked.stages)


@pytest.mark.parametrize("stage", STAGES)
def test_closing_a_bake_in_any_stage_ends_its_threads(stage: str) -> None:
    running = bake(furnished_room(), BakeSettings(page_size=128, threads=2))
    assert any(progress.stage == stage for progress in running)
    next(running, None)
    running.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("radiosity")]
    with pytest.raises(StopIteration):
        next(running)


def white_room(reflectance: float) -> Scene:
    return Scene(
        (box("Room", (0, 0, 0), (1, 1, 1), inward=True),),
        (Material("Snow", (reflectance,) * 3),),
        (PointLight("Lamp", (1, 1, 1), (0.5, 0.5, 0.5)),),
    )


def test_a_white_room_says_how_far_its_light_has_settled() -> None:
    """Block refinement stops after 500 steps, with as many reflections unshot: 0.99^500 = 0.7 %."""
    baked = bake_of(white_room(0.99), tolerance=1e-8, solver="progressive")
    assert any("0.6" in warning and "unshot" in warning for warning in baked.warnings)
    assert baked.residual == pytest.approx(0.99**500, rel=0.1)


def test_light_settles_in_a_white_room() -> None:
    """The default solver: the lamp's 4 pi W, of which a hundredth is absorbed at each of endless reflections."""
    baked = bake_of(white_room(0.99), tolerance=1e-6)
    assert not any("unshot" in warning for warning in baked.warnings)
    assert baked.pages[0].mean() * np.pi * 6 * 0.01 == pytest.approx(4 * np.pi, rel=0.05)
