# SPDX-License-Identifier: GPL-3.0-or-later
"""Nets as meshes, and their charts by arc length."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.atlas.overlap import overlapping
from radiosity_addon.curves.nurbs import Surface
from radiosity_addon.curves.patchwork import Cap, Net, patchwork
from radiosity_addon.curves.tessellation import CHORD, extent, grid_parameters, smooth_normals
from radiosity_addon.curves.unrolling import STRETCH, unroll
from tests.splines import cone, sheet, sphere, torus, vase


def net_of(surface: Surface, closed: tuple[bool, bool] = (False, False)) -> Net:
    u, v = grid_parameters(surface, CHORD * extent(surface.points))
    points, normals = surface.at(u, v), smooth_normals(surface, u, v)
    rows, columns = (slice(0, -1 if ring else None) for ring in closed)
    return Net(points[rows, columns], u / u[-1], v / v[-1], normals[rows, columns])


def tube(length: float, radius: float, sides: int = 32) -> Net:
    angle = np.arange(sides) / sides * 2 * np.pi
    ring = np.stack([np.zeros(sides), np.cos(angle), np.sin(angle)], axis=1) * radius
    points = ring + np.linspace(0, length, 41)[:, None, None] * [1, 0, 0]
    return Net(points, np.linspace(0, 1, 41), np.linspace(0, 1, sides + 1))


def triangles(mesh, places: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Corners in space (F, 3, 3), and the patchwork's corners (F, 3): polygons as fans."""
    size = np.diff(np.append(mesh.loop_start, len(mesh.loop_vertex)))
    fans = [
        start + np.array([0, k, k + 1]) for start, n in zip(mesh.loop_start, size, strict=True) for k in range(1, n - 1)
    ]
    corner = np.array(fans)
    return mesh.vertices[mesh.loop_vertex[corner]], corner


def areas(corners: np.ndarray) -> np.ndarray:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return (
        np.linalg.norm(np.cross(a, b), axis=1) / 2
        if corners.shape[2] == 3
        else (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    )


def test_a_pole_is_one_vertex_with_triangles_around_it():
    mesh = patchwork([net_of(sphere(), closed=(True, False))])
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
    size = np.diff(np.append(mesh.loop_start, len(mesh.loop_vertex)))
    around = len(net_of(sphere(), closed=(True, False)).points)
    assert np.count_nonzero(size == 3) == 2 * around
    assert len(mesh.vertices) - len(np.unique(edges(mesh), axis=0)) + len(mesh.loop_start) == 2  # Euler: closed


def edges(mesh) -> np.ndarray:
    size = np.diff(np.append(mesh.loop_start, len(mesh.loop_vertex)))
    following = np.arange(len(mesh.loop_vertex)) + 1
    following[mesh.loop_start + size - 1] = mesh.loop_start
    return np.sort(np.stack([mesh.loop_vertex, mesh.loop_vertex[following]], axis=1), axis=1)


@pytest.mark.parametrize(
    ("surface", "rims"),
    [(sphere(), 0), (torus(), 0), (vase(), 1), (cone(), 1)],
    ids=["sphere", "torus", "vase", "cone"],
)
def test_edges_are_shared_but_for_open_rims(surface, rims):
    ring = surface.basis_v is surface.basis_u
    mesh = patchwork([net_of(surface, closed=(True, ring))])
    _, count = np.unique(edges(mesh), axis=0, return_counts=True)
    assert set(count) <= {1, 2}
    assert np.count_nonzero(count == 1) == rims * len(net_of(surface, closed=(True, ring)).points)


@pytest.mark.parametrize(
    ("surface", "most"),
    [(sphere(), 4), (torus(), 2), (torus(0.7), 8), (vase(), 6), (cone(), 1), (sheet(4, 4), 32)],
    ids=["sphere", "torus", "fat torus", "vase", "cone", "wavy sheet"],
)
def test_charts_are_few_true_to_length_and_do_not_overlap(surface, most):
    net = net_of(surface)
    mesh = patchwork([net])
    places, charts = unroll([net], [], np.eye(3))
    corners, corner = triangles(mesh)
    flat = places[mesh.face[corner]]
    chart = charts[mesh.face[corner[:, 0]]]
    assert chart.max() < most
    share = areas(flat) / areas(corners)
    assert (np.sign(share) == np.sign(share[0])).all()
    assert np.abs(share).max() / np.abs(share).min() < STRETCH**4
    ordinary = areas(corners) > 1e-6 * areas(corners).mean()
    edge, edge_flat = (np.linalg.norm(np.roll(x, -1, axis=1) - x, axis=2)[ordinary] for x in (corners, flat))
    scale = np.sqrt(np.bincount(chart, areas(corners)) / np.bincount(chart, np.abs(areas(flat))))[chart][ordinary, None]
    stretch = (edge_flat * scale)[edge > 1e-6] / edge[edge > 1e-6]
    assert stretch.max() < STRETCH * 1.1  # bounded at a sample of the faces
    assert stretch.min() > 1 / STRETCH / 1.1
    assert not len(overlapping(flat, chart.astype(np.int64)))


def test_a_cone_and_a_tube_unroll_without_any_distortion():
    for net in (net_of(cone()), tube(1.0, 0.3)):
        mesh = patchwork([net])
        places, _ = unroll([net], [], np.eye(3))
        corners, corner = triangles(mesh)
        share = np.abs(areas(places[mesh.face[corner]])) / areas(corners)
        assert np.ptp(share) < 2e-3


def test_a_long_tube_is_cut_into_strips_that_pack_well():
    net = tube(20.0, 0.01)
    places, charts = unroll([net], [], np.eye(3))
    widest = max(np.ptp(places[charts == chart], axis=0).max() for chart in range(charts.max() + 1))
    assert charts.max() >= 5
    assert widest < 2.1 * np.sqrt(20.0 * 0.02 * np.pi)


def test_charts_are_laid_out_at_the_scale_of_the_world():
    net = tube(1.0, 0.3)
    places, _ = unroll([net], [], np.diag([3.0, 1.0, 1.0]))
    assert sorted(np.ptp(places, axis=0)) == pytest.approx([0.6 * np.pi, 3.0], rel=0.01)


def test_a_cap_lies_flat_as_it_is():
    angle = np.arange(12) / 12 * 2 * np.pi
    rim = (
        np.stack([np.cos(angle), np.sin(angle), np.zeros(12)], axis=1)
        @ np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    )
    net, cap = tube(1.0, 0.3), Cap(rim)
    mesh = patchwork([net], [cap])
    places, charts = unroll([net], [cap], np.eye(3))
    flat = places[mesh.face[-12:]]
    assert np.linalg.norm(flat - flat.mean(axis=0), axis=1) == pytest.approx(np.ones(12))
    assert len(set(charts[mesh.face[-12:]])) == 1


def test_what_bends_too_much_is_no_net_to_lay_flat():
    random = np.random.default_rng(0)
    net = Net(random.normal(size=(40, 40, 3)), np.linspace(0, 1, 40), np.linspace(0, 1, 40))
    assert unroll([net], [], np.eye(3)) is None
