# SPDX-License-Identifier: GPL-3.0-or-later
"""The soup of triangles: parts, closedness, and the arithmetic on it."""

import numpy as np
import pytest

from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.scene import Material, Mesh, Scene
from tests.shapes import box, furnished_room, mesh_of, quad, sphere

GREY = (Material("Grey"),)


def welded_mesh(vertices, triangles):
    triangles = np.asarray(triangles, np.int32)
    zero = np.zeros(len(triangles), np.int32)
    normals = np.zeros((len(triangles), 3, 3), np.float32)
    normals[..., 2] = 1
    return Mesh("Welded", np.asarray(vertices, float), triangles, normals, zero, zero, triangles)


def test_boxes_of_separate_quads_are_closed_because_vertices_at_one_place_are_one():
    surfaces = flatten(Scene((box("Box", (0, 0, 0), (1, 2, 3)),), GREY))
    assert surfaces.closed.all()
    assert set(surfaces.component) == {0}


def test_a_box_without_a_side_is_open():
    whole = box("Box", (0, 0, 0), (1, 1, 1))
    open_box = Mesh(**{**vars(whole), **{k: vars(whole)[k][:-2] for k in ("triangles", "corner_normals", "material")}})
    assert not flatten(Scene((open_box,), GREY)).closed.any()


def with_a_vertex_on_an_edge(off):
    """A tetrahedron with a vertex on one edge, `off` aside of it, that only one of both faces there has."""
    return welded_mesh(
        [(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2), (1, off, 0)],
        [(0, 2, 1), (0, 4, 3), (4, 1, 3), (0, 3, 2), (1, 2, 3)],
    )


def test_a_slit_where_a_triangle_without_area_was_leaves_a_body_closed():
    assert flatten(Scene((with_a_vertex_on_an_edge(0.0),), GREY)).closed.all()


def test_a_slit_with_any_width_opens_a_body():
    assert not flatten(Scene((with_a_vertex_on_an_edge(1e-4),), GREY)).closed.any()


def test_a_slit_in_one_body_leaves_the_wide_rim_of_another_open():
    sheet = mesh_of("Sheet", [quad((0, 0, 0), (1, 0, 0), (0, 1, 0))], [0])
    surfaces = flatten(Scene((sheet, with_a_vertex_on_an_edge(0.0)), GREY))
    assert surfaces.closed.tolist() == [False] * 2 + [True] * 5


def test_an_edge_of_three_faces_is_not_closed():
    ring = welded_mesh(
        [(0, 0, 0), (0, 0, 1), (1, 0, 0), (0, 1, 0), (-1, -1, 0)],
        [(0, 1, 2), (0, 1, 3), (0, 1, 4)],
    )
    assert not flatten(Scene((ring,), GREY)).closed.any()


def test_parts_are_counted_through_all_meshes():
    room = furnished_room()
    surfaces = flatten(room)
    assert np.array_equal(surfaces.component, surfaces.mesh)
    pair = mesh_of("Pair", [quad((k, 0, 0), (0.5, 0, 0), (0, 1, 0)) for k in (0, 5)], [0, 0])
    surfaces = flatten(Scene((pair, pair), GREY))
    assert list(surfaces.component) == [0, 0, 1, 1, 2, 2, 3, 3]


def test_a_long_strip_with_shuffled_vertices_is_one_part():
    count = 20_000
    rng = np.random.default_rng(5)
    x = np.arange(count + 1.0)
    vertices = np.concatenate([np.stack([x, y + 0 * x, 0 * x], axis=1) for y in (0, 1)])
    place = rng.permutation(len(vertices))
    shuffled = np.empty_like(vertices)
    shuffled[place] = vertices
    k = np.arange(count)
    triangles = np.concatenate([np.stack([k, k + 1, k + count + 2], 1), np.stack([k, k + count + 2, k + count + 1], 1)])
    surfaces = flatten(Scene((welded_mesh(shuffled, place[triangles]),), GREY))
    assert not surfaces.component.any()


def test_far_from_the_origin_areas_stay_right():
    near, far = (flatten(Scene((sphere("Ball"),), GREY).moved(np.array([x, 0.0, 0.0]))) for x in (0, 1e6))
    assert far.area == pytest.approx(near.area, rel=1e-5)
    assert far.origin == pytest.approx([1e6, 0, 0], abs=1e-6)
    assert np.abs(far.corners - near.corners).max() < 1e-6


def test_a_scene_without_triangles_has_none():
    surfaces = flatten(Scene((), GREY))
    assert surfaces.count == 0
    assert len(surfaces.component) == len(surfaces.closed) == 0


def test_degenerate_triangles_have_no_area_and_no_nan():
    surfaces = flatten(Scene((welded_mesh([(0, 0, 0), (1, 1, 1), (2, 2, 2)], [(0, 1, 2), (0, 0, 1)]),), GREY))
    assert not surfaces.area.any()
    assert np.isfinite(surfaces.normal).all()


def test_points_are_weighted_means_of_corners():
    surfaces = flatten(Scene((sphere("Ball", radius=3),), GREY))
    rng = np.random.default_rng(0)
    triangle = rng.integers(0, surfaces.count, 40_000).astype(np.int32)
    weights = rng.dirichlet((1, 1, 1), len(triangle))
    wanted = np.einsum("rk,rkx->rx", weights, surfaces.corners[triangle].astype(float))
    assert np.abs(surfaces.points(triangle, weights[:, 1:].astype(np.float32)) - wanted).max() < 1e-6
    wanted = np.einsum("rk,rkx->rx", weights, surfaces.corner_normals[triangle].astype(float))
    assert np.abs(surfaces.blended_normals(triangle, weights[:, 1:].astype(np.float32)) - wanted).max() < 1e-6
    assert np.array_equal(surfaces.normals(triangle), surfaces.normal[triangle])


def test_only_faces_with_their_own_normal_are_flat():
    surfaces = flatten(Scene((box("Box", (0, 0, 0), (1, 1, 1)), sphere("Ball")), GREY))
    assert np.array_equal(surfaces.flat, surfaces.mesh == 0)
