# SPDX-License-Identifier: GPL-3.0-or-later
"""The feet of what is sunk into floors without thickness: no dark shows over them, and no ledge is taken for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.geometry.sunk import leave_out_feet
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import Texels, rasterize
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.geometry.walls import find_walls
from radiosity_addon.scene import Material, Mesh, Scene, SunLight
from tests.bakes import BLACK, floor, lit
from tests.shapes import box, cell_atlas, mesh_of, quad


def turned(mesh: Mesh, angle: float) -> Mesh:
    """About z."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    normals = (mesh.corner_normals @ turn).astype(np.float32)
    return replace(mesh, vertices=mesh.vertices @ turn, corner_normals=normals)


@pytest.mark.parametrize("angle", [0.0, 0.4], ids=["straight", "turned"])
@pytest.mark.parametrize("density", [25, 100])
@pytest.mark.parametrize("depth", [0.001, 0.004, 0.02])
@pytest.mark.parametrize("up", [True, False], ids=["up", "down"])
def test_a_box_sunk_into_a_sheet_is_lit_down_to_its_foot(up: bool, depth: float, density: int, angle: float) -> None:
    """Whichever way the sheet faces. The sun's light is the same all over its sides; below the sheet there is none."""
    way = np.array([0.6, 0.3, -0.8]) / np.sqrt(1.09)
    block = turned(box("Block", (-0.2, -0.2, -depth), (0.2, 0.2, 0.3)), angle)
    ground = floor() if up else mesh_of("Floor", [quad((-2, -2, 0), (0, 4, 0), (4, 0, 0))], [0])
    scene = Scene((ground, block), (BLACK,), (SunLight("Sun", (np.pi,) * 3, tuple(way)),))
    found = lit(scene, density=density, page_size=512)
    sides = (found.mesh == 1) & (np.abs(found.normal[:, 2]) < 0.1) & (found.position[:, 2] > -0.5 / density)
    assert sides.sum() > 200
    np.testing.assert_allclose(found.light[sides, 0], np.maximum(-found.normal[sides] @ way, 0), atol=0.01)


def parted(*meshes: Mesh, size: int = 192) -> tuple[Texels, np.ndarray]:
    """Texels, and their places (T, 3), m, of meshes on pages of four cells."""
    scene = Scene(meshes, (Material("Grey"),))
    texels = finish(rasterize(cell_atlas(scene, size), flatten(scene)))
    visibility = Visibility(texels.surfaces.corners)
    leave_out_feet(texels, finish(find_walls(texels, visibility, 1)), visibility)
    return texels, texels.position + texels.surfaces.origin


def sheet(low: float, high: float, name: str = "Sheet") -> Mesh:
    return mesh_of(name, [quad((low, 0, 0), (high - low, 0, 0), (0, 2, 0))], [0])


def wall(start: float, end: float) -> Mesh:
    """A sheet that stands on x = start at y = 0, on x = end at y = 2."""
    return mesh_of("Wall", [quad((start, 0, -1), (end - start, 2, 0), (0, 0, 2))], [0])


def test_a_rim_behind_a_wall_takes_no_part() -> None:
    texels, place = parted(sheet(0, 2), wall(1.99, 1.99))
    rim = (texels.surfaces.mesh[texels.triangle[:]] == 0) & (place[:, 0] > 1.99)
    assert rim.sum() > 20
    assert not texels.valid[rim].any()
    assert texels.valid[~rim].all()


def test_a_ledge_as_wide_as_what_is_before_the_wall_stays() -> None:
    texels, _ = parted(mesh_of("Sheet", [quad((0, 0, 0), (0.06, 0, 0), (0, 2, 0))], [0]), wall(0.03, 0.03))
    assert texels.valid.all()


def test_a_rim_that_widens_stays() -> None:
    """Where a wall stands askew in a corner, the floor of the next room ends in a narrow wedge."""
    texels, _ = parted(sheet(0, 2), wall(1.99, 1.0))
    assert texels.valid.all()


def test_the_edge_of_a_chart_is_no_rim_where_the_surface_goes_on() -> None:
    two = mesh_of("Sheet", [quad((0, 0, 0), (2, 0, 0), (0, 2, 0)), quad((2, 0, 0), (2, 0, 0), (0, 2, 0))], [0, 0])
    texels, _ = parted(two, wall(1.99, 1.99))
    assert texels.valid.all()
