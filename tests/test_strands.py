# SPDX-License-Identifier: GPL-3.0-or-later
"""Hair as tubes."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.curves.strands import MOST_TRIANGLES, tubes


def straight(strands: int = 1, points: int = 3, radius: float = 0.1, length: float = 2.0):
    place = np.zeros((strands, points, 3))
    place[..., 2] = np.linspace(0, length, points)
    place[..., 0] = np.arange(strands)[:, None]
    return place.reshape(-1, 3), np.full(strands * points, radius), np.arange(strands + 1) * points


def volume(found) -> float:
    a, b, c = np.moveaxis(found.vertices[found.triangles], 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def area(found) -> float:
    a, b, c = np.moveaxis(found.vertices[found.triangles], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_a_tube_is_closed_and_faces_outward():
    found = tubes(*straight())
    edges = found.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert {tuple(edge) for edge in edges} == {tuple(edge[::-1]) for edge in edges}
    assert volume(found) > 0


def test_the_side_of_a_tube_is_as_large_as_that_of_the_round_strand():
    found = tubes(*straight(radius=0.01))
    assert area(found) == pytest.approx(2 * np.pi * 0.01 * 2.0, rel=0.01)


def test_a_bent_strand_runs_through_its_points():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 1, 1.0]])
    found = tubes(points, np.full(4, 0.01), np.array([0, 4]))
    gap = np.linalg.norm(found.vertices[None] - points[:, None], axis=2).min(axis=1)
    assert gap.max() < 0.012
    assert volume(found) > 0


def test_strands_of_different_lengths_and_lone_points_go_together():
    points = np.concatenate([straight(2, 3)[0], [[5, 5, 5]], straight(1, 6)[0]])
    found = tubes(points, np.full(len(points), 0.1), np.array([0, 3, 6, 7, 13]))
    assert np.isfinite(found.vertices).all()
    assert found.vertices.max() < 4
    assert volume(found) == pytest.approx(3 * volume(tubes(*straight())), rel=1e-6)


def test_very_many_strands_have_fewer_sides():
    count = MOST_TRIANGLES // 2 // 6 // 4 + 1
    few, many = tubes(*straight(10, 2)), tubes(*straight(count, 2))
    assert len(many.triangles) / count < len(few.triangles) / 10


def test_nothing_makes_nothing():
    assert len(tubes(np.zeros((0, 3)), np.zeros(0), np.array([0])).triangles) == 0
    assert len(tubes(np.ones((3, 3)), np.ones(3), np.array([0, 3])).triangles) == 0
