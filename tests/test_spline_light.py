# SPDX-License-Identifier: GPL-3.0-or-later
"""Light on curves and surfaces, and from them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.curves.patchwork import Cap, Net, patchwork
from radiosity_addon.curves.sweep import Line, caps, ring_profile, sweep
from radiosity_addon.curves.unrolling import unroll
from radiosity_addon.scene import AreaLight, Material, Mesh, Scene, World
from tests.bakes import floor, lit
from tests.splines import sphere, torus
from tests.test_unrolling import net_of


def mesh_from(
    name: str, nets: list[Net], ends: list[Cap] = (), charts: bool = True, material: int = 0, **options
) -> Mesh:
    """Nets as the bake takes them, in triangles; without `charts` they are unwrapped like any mesh."""
    faces = patchwork(nets, ends)
    size = np.diff(np.append(faces.loop_start, len(faces.loop_vertex)))
    fans = [
        (start, start + k, start + k + 1, polygon)
        for polygon, (start, n) in enumerate(zip(faces.loop_start, size, strict=True))
        for k in range(1, n - 1)
    ]
    corner, polygon = np.array(fans)[:, :3], np.array(fans)[:, 3]
    triangles = faces.loop_vertex[corner]
    points = faces.vertices[triangles]
    geometric = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    geometric /= np.linalg.norm(geometric, axis=1, keepdims=True)
    normals = faces.loop_normal[corner]
    normals = np.where(np.abs(normals).any(axis=2, keepdims=True), normals, geometric[:, None])
    uv = chart = None
    if charts:
        places, pieces = unroll(nets, ends, np.eye(3))
        uv, chart = places[faces.face[corner]].astype(np.float32), pieces[faces.face[corner[:, 0]]].astype(np.int32)
    return Mesh(
        name, faces.vertices, triangles.astype(np.int32), normals.astype(np.float32),
        np.full(len(triangles), material, np.int32), polygon.astype(np.int32), corner.astype(np.int32),
        uv=uv, chart=chart, **options,
    )  # fmt: skip


def outward(surface, steps: int | None = None) -> Net:
    """A closed surface facing outward, by its own tessellation or as a dense grid."""
    ring = surface.basis_v is surface.basis_u
    if steps is None:
        net = net_of(surface, closed=(True, ring))
    else:
        u, v = (np.linspace(*basis.domain, steps + 1) for basis in (surface.basis_u, surface.basis_v))
        points, normals = surface.points_and_normals(u[:-1], v[:-1] if ring else v)
        net = Net(points, u / u[-1], v / v[-1], normals)
    return replace(net, points=net.points[::-1], normals=net.normals[::-1])


def raised(mesh: Mesh, height: float) -> Mesh:
    return replace(mesh, vertices=mesh.vertices + np.array([0, 0, height]))


def seen(bake, mesh: int, ring: float) -> np.ndarray:
    """Mean light (D,) on a sphere or torus of the bake around each of WAYS, by the shape's true normals."""
    own = bake.mesh == mesh
    away = bake.position[own] - [0, 0, HEIGHT]
    spine = away * [1, 1, 0] / np.maximum(np.linalg.norm(away[:, :2], axis=1, keepdims=True), 1e-9) * ring
    normal = (away - spine) / np.linalg.norm(away - spine, axis=1, keepdims=True)
    weight = np.maximum(normal @ WAYS.T, 0) ** 6 * bake.area[own][:, None]
    return (weight.T @ bake.light[own, 0]) / weight.sum(axis=0)


HEIGHT = 1.4
WAYS = np.array(
    [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)], float
)
WAYS /= np.linalg.norm(WAYS, axis=1, keepdims=True)


@pytest.mark.parametrize(("surface", "ring"), [(sphere(), 0.0), (torus(0.35), 1.0)], ids=["sphere", "torus"])
def test_light_on_a_surface_is_that_on_a_dense_mesh_of_it(surface, ring):
    """Within 1 %: from every side of the shape, and on the floor below it."""
    white = Material("White", (0.7,) * 3)
    lamp = AreaLight("Lamp", (20.0,) * 3, (1.5, 0.5, 4), (1, 0, 0), (0, 1, 0), (0, 0, -1))
    found = []
    for steps, charts in ((None, True), (128, False)):
        shape = raised(mesh_from("Shape", [outward(surface, steps)], charts=charts), HEIGHT)
        scene = Scene((shape, floor(6.0)), (white,), (lamp,), World((0.3, 0.3, 0.3)))
        bake = lit(scene, page_size=256, quality="medium")
        below = bake.mesh == 1
        cell = (np.floor(bake.position[below, :2] / 2) + 2).astype(int) @ [4, 1]
        weight = np.bincount(cell, bake.area[below])
        plan = np.bincount(cell, bake.area[below] * bake.light[below, 0])[weight > 0] / weight[weight > 0]
        found.append(np.concatenate([seen(bake, 0, ring), plan]))
    assert found[0] == pytest.approx(found[1], rel=0.01)


def on_both_sides(mesh: Mesh, baked, index: int = 0) -> np.ndarray:
    """Filtered light (E, 2) on both sides of the middle of each seam of a mesh's charts."""
    uv, page = baked.atlas.uv[index], baked.pages[baked.atlas.page[index]][..., 0]
    size = len(page)
    edges: dict[tuple[int, int], list[np.ndarray]] = {}
    for triangle, places in zip(mesh.triangles, uv, strict=True):
        for k in range(3):
            a, b = int(triangle[k]), int(triangle[(k + 1) % 3])
            edges.setdefault((min(a, b), max(a, b)), []).append((places[k] + places[(k + 1) % 3]) / 2)
    pairs = np.array([two for two in edges.values() if len(two) == 2 and np.abs(two[0] - two[1]).max() > 0.5 / size])
    at = pairs * size - 0.5
    low = np.clip(np.floor(at).astype(int), 0, size - 2)
    x, y = np.moveaxis(at - low, -1, 0)
    i, j = np.moveaxis(low, -1, 0)
    below = page[j, i] * (1 - x) + page[j, i + 1] * x
    above = page[j + 1, i] * (1 - x) + page[j + 1, i + 1] * x
    return below * (1 - y) + above * y


@pytest.mark.parametrize("surface", [sphere(), torus(0.35), None], ids=["sphere", "torus", "tube"])
def test_both_sides_of_a_join_show_the_same_light(surface):
    if surface is None:
        turn = np.linspace(0, 1.5 * np.pi, 60)
        points = np.stack([np.cos(turn), np.sin(turn), 0.2 * turn], axis=1)
        line = Line(points, np.ones(60), np.zeros(60), np.linspace(0, 1, 60), False, np.zeros((2, 3)))
        net = sweep(line, ring_profile(0.2, 4, 3))
    else:
        net = outward(surface)
    shape = raised(mesh_from("Shape", [net]), 1.5)
    lamp = AreaLight("Lamp", (20.0,) * 3, (2, 1, 4), (1, 0, 0), (0, 1, 0), (0, 0, -1))
    scene = Scene((shape, floor(6.0)), (Material("White", (0.7,) * 3),), (lamp,))
    bake = lit(scene, page_size=256)
    sides = on_both_sides(shape, bake.baked)
    assert len(sides) > 20
    off = np.abs(sides[:, 0] - sides[:, 1]) / bake.of(0).max()
    assert np.quantile(off, 0.95) < 0.004
    assert off.max() < 0.02


def line_light(radius: float, length: float = 3.0, height: float = 1.0, radiance: float = 10.0) -> tuple[float, float]:
    """Irradiance under the middle of a glowing tube, baked and that of the line source."""
    ends = np.array([[-length / 2, 0, height], [length / 2, 0, height]])
    net = sweep(
        Line(ends, np.ones(2), np.zeros(2), np.array([0.0, 1.0]), False, np.zeros((2, 3))), ring_profile(radius, 0, 9)
    )
    glow, black = Material("Glow", (0, 0, 0), (radiance,) * 3), Material("Black", (0, 0, 0))
    tube = mesh_from("Tube", [net], caps(net), material=1, lightmapped=False)
    ground = raised(floor(4.0, lightmapped=False), -2)
    bake = lit(Scene((floor(0.04), tube, ground), (black, glow)), page_size=64, quality="high")
    half = np.arctan(length / 2 / height)
    closed = 2 * radius * radiance / height * (half + np.sin(2 * half) / 2)
    return float(np.pi * bake.of(0)[:, 0].mean()), float(closed)


@pytest.mark.parametrize("radius", [0.1, 0.03, 0.01, 0.003])
def test_a_thin_tube_lights_as_a_line_source_does(radius):
    """H = 2 r L / h (a + sin(2 a) / 2) below the middle of a line seen under the angle 2 a; the plate is 4 cm wide."""
    baked, closed = line_light(radius)
    assert baked == pytest.approx(closed, rel=0.005 + 0.1 * radius)
