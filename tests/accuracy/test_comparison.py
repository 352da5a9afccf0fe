# SPDX-License-Identifier: GPL-3.0-or-later
"""Which probes are compared: those beside which another object stands are not."""

from __future__ import annotations

import numpy as np

from radiosity_addon.scene import Material, Mesh, Scene
from tests.accuracy.comparison import beside_others, bilinear, distances
from tests.accuracy.probes import References
from tests.shapes import mesh_of, quad

FLOOR = mesh_of("Floor", [quad((0, 0, 0), (4, 0, 0), (0, 4, 0))], [0])
REACH = 0.5


def crowded(other: Mesh) -> bool:
    at = np.array([[2.0, 2.0, 0.0]])
    measured = np.zeros((1, 3))
    probe = References(
        np.array(["Floor"]), at, np.array([[0.0, 0.0, 1.0]]), measured, measured, 0.1, "", 1, at, at, 0, ""
    )
    return bool(beside_others(Scene((FLOOR, other), (Material("Grey"),)), probe, REACH)[0])


def wall_at(x: float, low: float, high: float) -> Mesh:
    return mesh_of("Wall", [quad((x, 0, low), (0, 4, 0), (0, 0, high - low))], [0])


def test_distances_of_triangles_are_to_their_inside_edges_and_corners() -> None:
    corners = np.array([[(-1, -1, 2), (2, -1, 2), (-1, 2, 2)], [(3, -1, 0), (3, 1, 0), (5, 0, 0)]], float)
    corner = np.array([[(1, 1, 1), (2, 1, 1), (1, 2, 2)]], float)
    np.testing.assert_allclose(distances(np.concatenate([corners, corner])), [2, 3, 3**0.5])


def test_a_probe_beside_a_wall_of_another_object_is_crowded() -> None:
    assert crowded(wall_at(2.4, 0, 1))


def test_a_probe_farther_from_a_wall_than_a_reading_reaches_is_not() -> None:
    aslant = mesh_of("Wall", [quad((1, 3.85, 0), (2.85, -2.85, 0), (0, 0, 1))], [0])  # 0.6 m away, its box around it
    assert not crowded(wall_at(2.6, 0, 1))
    assert not crowded(aslant)


def test_what_hangs_higher_than_a_reading_is_wide_crowds_nothing() -> None:
    assert not crowded(wall_at(2.1, 0.6, 1))


def test_what_stands_under_a_surface_crowds_nothing() -> None:
    assert not crowded(wall_at(2.1, -1, 0))


def test_a_wall_of_the_same_object_crowds_nothing() -> None:
    wall = wall_at(2.1, 0, 1)
    assert not crowded(Mesh(**{**vars(wall), "name": "Floor"}))


def test_what_changes_evenly_is_read_as_it_is() -> None:
    rows, columns = np.mgrid[0:8, 0:8] + 0.5
    page = np.stack([columns, rows, 2 * columns - rows], axis=2)
    uv = np.array([[0.3, 0.6], [0.5, 0.5], [0.11, 0.9]])
    x, y = (8 * uv).T
    np.testing.assert_allclose(bilinear(page, uv), np.stack([x, y, 2 * x - y], axis=1))
