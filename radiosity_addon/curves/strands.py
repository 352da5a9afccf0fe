# SPDX-License-Identifier: GPL-3.0-or-later
"""Hair and other bundles of strands as thin closed tubes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float64, Int64
from .sweep import upright_axes

SIDES = 6
"""Of a tube; its perimeter is that of the round strand, so that on the mean it is as wide."""

FEWEST = 3
"""Sides where there are very many strands."""

MOST_TRIANGLES = 2_000_000
"""Beyond this many triangles tubes have the fewest sides."""

STEPS = 3
"""Straight steps between two points of a strand, which is a curve through its points (Catmull and Rom 1974)."""


@dataclass(frozen=True, eq=False)
class Tubes:
    """Triangles of closed tubes: vertices (V, 3) float64 and triangles (F, 3) int64, facing outward."""

    vertices: Float64
    triangles: Int64


def tubes(points: Float64, radius: Float64, first: Int64) -> Tubes:
    """Tubes about strands; those of a single point or of no length are left out.

    Args:
        points: (N, 3) float64, m, strand after strand
        radius: (N,) float64, m
        first: (S + 1,) int64, where each strand begins, and N
    """
    counts = np.diff(first)
    steps = (np.maximum(counts, 1) - 1) * STEPS
    sides = SIDES if 2 * SIDES * int((steps + 1).sum()) <= MOST_TRIANGLES else FEWEST
    vertices, triangles, base = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for count in np.unique(counts[counts > 1]):
        index = first[:-1][counts == count, None] + np.arange(count)
        line, size = _smooth(points[index]), _smooth(radius[index][..., None])[..., 0]
        moving = np.ptp(line, axis=1).max(axis=1) > 0
        if moving.any():
            found = _swept(line[moving], np.maximum(size[moving], 0.0), sides)
            vertices.append(found.vertices)
            triangles.append(found.triangles + base)
            base += len(found.vertices)
    return Tubes(np.concatenate(vertices), np.concatenate(triangles))


def _smooth(values: Float64) -> Float64:
    """Values (S, K, C) at points of strands, and at STEPS - 1 places between any two."""
    padded = np.concatenate([2 * values[:, :1] - values[:, 1:2], values, 2 * values[:, -1:] - values[:, -2:-1]], axis=1)
    t = (np.arange(STEPS) / STEPS)[:, None]
    a, b, c, d = (padded[:, k : padded.shape[1] - 3 + k, None] for k in range(4))
    between = b + t * ((c - a) / 2 + t * (a - 2.5 * b + 2 * c - d / 2 + t * ((d - a) / 2 + 1.5 * (b - c))))
    between = between.reshape(len(values), -1, values.shape[2])
    return np.concatenate([between, values[:, -1:]], axis=1)


def _swept(line: Float64, size: Float64, sides: int) -> Tubes:
    """Tubes about strands of equally many places (S, K, 3)."""
    strands, count = line.shape[:2]
    direction = np.gradient(line, axis=1)
    length = np.linalg.norm(direction, axis=2, keepdims=True)
    direction = np.where(length > 0, direction / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0])
    x = np.empty_like(direction)
    x[:, 0] = upright_axes(direction[:, 0])
    for k in range(1, count):  # carried along; what it leans out of the plane across the strand is taken off
        lean = x[:, k - 1] - (x[:, k - 1] * direction[:, k]).sum(axis=1, keepdims=True) * direction[:, k]
        norm = np.linalg.norm(lean, axis=1, keepdims=True)
        x[:, k] = np.where(norm > 1e-6, lean / np.maximum(norm, 1e-12), upright_axes(direction[:, k]))
    y = np.cross(direction, x)
    angle = np.arange(sides) * (2 * np.pi / sides)
    reach = size * (np.pi / (sides * np.sin(np.pi / sides)))
    around = np.cos(angle)[:, None] * x[:, :, None] + np.sin(angle)[:, None] * y[:, :, None]
    rings = line[:, :, None] + reach[:, :, None, None] * around
    vertices = np.concatenate([rings.reshape(strands, -1, 3), line[:, [0, -1]]], axis=1)
    ring = np.arange(count - 1)[:, None] * sides
    here, after = np.arange(sides), (np.arange(sides) + 1) % sides
    low_here, low_after, high_here, high_after = ring + here, ring + after, ring + sides + here, ring + sides + after
    last, tips = (count - 1) * sides, count * sides
    parts = [
        np.stack([low_here, low_after, high_after], axis=2).reshape(-1, 3),
        np.stack([low_here, high_after, high_here], axis=2).reshape(-1, 3),
        np.stack([after, here, np.full(sides, tips)], axis=1),
        np.stack([last + here, last + after, np.full(sides, tips + 1)], axis=1),
    ]
    each = np.concatenate(parts)
    triangles = each[None] + np.arange(strands)[:, None, None] * vertices.shape[1]
    return Tubes(vertices.reshape(-1, 3), triangles.reshape(-1, 3))
