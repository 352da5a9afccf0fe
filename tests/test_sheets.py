# SPDX-License-Identifier: GPL-3.0-or-later
"""Light that passes sheets scattered: each side has its own and the other one's, and no more than there is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.radiosity.crossing import Crossing
from radiosity_addon.radiosity.solvers import SOLVERS
from radiosity_addon.scene import Material, PointLight, Scene, World
from radiosity_addon.settings import SolverName
from tests.bakes import BLACK, WHITE, floor, lit
from tests.painter import Painter
from tests.rooms import box as patch_box
from tests.shapes import box, sphere


def paper(back: float, through: float, emission: float = 0.0) -> Material:
    """Throws `back` so much of what it gets, lets `through` so much; radiates `emission` W/m2."""
    return Material("Paper", (back + through,) * 3, (emission / np.pi,) * 3, translucence=(through,) * 3)


@pytest.mark.parametrize(("back", "through"), [(0.5, 0.0), (0.3, 0.4), (0.0, 0.6)])
def test_a_glowing_furnace_of_paper_is_exact_on_both_sides(back: float, through: float) -> None:
    """Closed, E = 1: H = 1 / (1 - rho) within; out of doors only what comes through."""
    room = box("Room", (0, 0, 0), (3, 2, 1), inward=True, two_sided=True)
    found = lit(Scene((room,), (paper(back, through, 1),)), tolerance=1e-7)
    inside = 1 / (1 - back) / (back + through)
    assert np.abs(found.of(0) * np.pi - back * inside).max() < 1e-5
    assert np.abs(found.of(1) * np.pi - through * inside).max() < 1e-5


@pytest.mark.parametrize("varies", [False, True], ids=["constants", "pictures"])
def test_a_box_of_paper_under_an_even_sky_has_what_comes_through_and_its_bounces(varies: bool) -> None:
    """E = pi without, tau pi / (1 - rho) within; each side holds (rho E + tau E') / (rho + tau)."""
    back, through = 0.3, 0.4
    material = paper(back, through)
    if varies:
        material = replace(
            paper(0.1, 0.1), varies=frozenset({"reflectance", "translucence"})
        )  # as if a picture told otherwise
    scene = Scene((box("Box", (0, 0, 0), (3, 2, 1), two_sided=True),), (material,), world=World((1.0,) * 3))
    shade = Painter(
        scene,
        {
            "reflectance": lambda points: np.full_like(points, back + through),
            "translucence": lambda points: np.full_like(points, through),
        },
    )
    found = lit(scene, shade=shade, tolerance=1e-7)
    within = through / (1 - back)
    assert np.abs(found.of(0) * (back + through) / (back + through * within) - 1).max() < 1e-3
    assert np.abs(found.of(1) * (back + through) / (back * within + through) - 1).max() < 1e-3


@pytest.mark.parametrize("rings", [32, 16])
@pytest.mark.parametrize("lightmapped", [True, False], ids=["on a page", "without a lightmap"])
def test_a_lantern_lights_the_floor_as_the_ball_of_even_radiance_that_it_is(lightmapped: bool, rings: int) -> None:
    """A bulb of 1 W/sr in a ball of radius R: E = 1 / R2 / (1 - rho) within, radiance tau E / pi without.

    A ball of flat faces is smaller than the one around it, and is as bright as the one of its mean area.
    """
    back, through, radius, height = 0.25, 0.375, 0.4, 1.0
    ball = sphere("Lantern", radius, segments=rings * 3 // 2, rings=rings)
    ball = replace(ball, vertices=ball.vertices + np.array([0, 0, height]), two_sided=True, lightmapped=lightmapped)
    bulb = PointLight("Bulb", (1.0,) * 3, (0, 0, height))
    found = lit(Scene((floor(3, material=1), ball), (paper(back, through), BLACK), (bulb,)), quality="medium")
    edges = np.diff(ball.vertices[ball.triangles], axis=1)
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum() / 2
    inside = 4 * np.pi / area / (1 - back)
    if lightmapped:
        assert found.of(1).mean() * np.pi == pytest.approx(through * inside / (back + through), rel=0.01)
        assert found.of(2).mean() * np.pi == pytest.approx(back * inside / (back + through), rel=0.01)
    distance = np.linalg.norm(found.position[found.mesh == 0] - [0, 0, height], axis=1)
    wanted = through * inside / np.pi * area / (4 * np.pi * distance**2) * height / distance
    near = distance < 1.4
    assert (found.of(0)[near, 0] / wanted[near]).mean() == pytest.approx(1, rel=0.03)


def test_paper_that_is_not_two_sided_throws_all_light_back() -> None:
    bulb = PointLight("Bulb", (1.0,) * 3, (0.5, 0.2, 1))
    pages = [
        lit(Scene((floor(2),), (material,), (bulb,))).light
        for material in (paper(0.3, 0.4), replace(WHITE, reflectance=(0.7,) * 3))
    ]
    assert np.array_equal(*pages)


def paired(count: int) -> Crossing:
    """Patches 0 and 1, 2 and 3, ... are sides of sheets that let red, green and blue through unlike."""
    row = np.arange(count, dtype=np.int32)
    return Crossing(row, row ^ 1, np.tile(np.array([[0.9], [0.5], [0.2]]), (1, count)))


@pytest.mark.parametrize("name", SOLVERS)
def test_all_solvers_find_the_same_light_through_sheets(name: SolverName) -> None:
    """B = E + rho M F B by elimination, M the mixing of sides."""
    patches = patch_box((3, 2, 1), 2, reflectance=(0.7, 0.5, 0.2))
    transport = replace(patches.transport(64), crossing=paired(patches.count))
    exitance = np.zeros((patches.count, 1, 3))
    exitance[1] = 3, 2, 1
    exitance[-2] = 0.1, 0, 0.2
    solution = finish(SOLVERS[name](transport, patches, exitance, 1e-10))
    assert solution.converged
    assert solution.balance.error < 1e-10
    for channel, weight in enumerate((0.9, 0.5, 0.2)):
        mixing = (1 - weight) * np.eye(patches.count)
        mixing[np.arange(patches.count), np.arange(patches.count) ^ 1] += weight
        form_factors = transport.dense(channel) / transport.area[:, None]
        matrix = np.eye(patches.count) - patches.reflectance[:, [channel]] * (mixing @ form_factors)
        wanted = np.linalg.solve(matrix, exitance[:, 0, channel])
        assert solution.radiosity[:, 0, channel] == pytest.approx(wanted, rel=1e-7, abs=1e-9)
