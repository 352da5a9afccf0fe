# SPDX-License-Identifier: GPL-3.0-or-later
"""Curves and surfaces whose shape is known exactly."""

from __future__ import annotations

import numpy as np

from radiosity_addon.curves.bspline import Basis, clamped_knots
from radiosity_addon.curves.nurbs import Curve, Surface

HALF = np.sqrt(0.5)
CIRCLE = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]], float)
CIRCLE_WEIGHTS = np.array([1, HALF, 1, HALF, 1, HALF, 1, HALF, 1])
CIRCLE_BASIS = Basis(2, np.array([0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4.0]), 9)
"""The unit circle as four rational quadratic arcs (Piegl and Tiller 1997, section 7.5)."""


def circle() -> Curve:
    return Curve(CIRCLE_BASIS, np.column_stack([CIRCLE, np.zeros(9)]), CIRCLE_WEIGHTS)


def revolved(profile: np.ndarray, weights: np.ndarray, basis: Basis) -> Surface:
    """A profile (N, 2) of radius and height turned about z; u goes around."""
    points = np.zeros((9, len(profile), 3))
    points[..., :2] = CIRCLE[:, None] * profile[None, :, :1]
    points[..., 2] = profile[None, :, 1]
    return Surface(CIRCLE_BASIS, basis, points, CIRCLE_WEIGHTS[:, None] * weights)


def sphere() -> Surface:
    """Radius 1."""
    basis = Basis(2, np.array([0, 0, 0, 1, 1, 2, 2, 2.0]), 5)
    profile = np.array([[0, -1], [1, -1], [1, 0], [1, 1], [0, 1.0]])
    return revolved(profile, np.array([1, HALF, 1, HALF, 1]), basis)


def torus(tube: float = 0.25) -> Surface:
    """A tube about the unit circle."""
    return revolved(CIRCLE * tube + [1.0, 0.0], CIRCLE_WEIGHTS, CIRCLE_BASIS)


def cone() -> Surface:
    """Radius 1 at the foot, 2 high."""
    return revolved(np.array([[1, 0], [0, 2.0]]), np.ones(2), Basis(1, np.array([0, 0, 1, 1.0]), 2))


def vase() -> Surface:
    profile = np.array([[0.0, 0], [0.5, 0], [1.2, 0.8], [0.9, 2], [0.2, 2.5], [0.35, 3], [0.6, 3.2]])
    return revolved(profile, np.ones(7), Basis(3, clamped_knots(7, 3), 7))


def sheet(rows: int, columns: int, degree: int = 3, seed: int = 0, weighted: float = 0.0) -> Surface:
    """A wavy net of unit cells."""
    random = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(float(rows)), np.arange(float(columns)), indexing="ij")
    points = np.stack([x, y, random.normal(size=x.shape)], axis=2)
    bases = [Basis(degree, clamped_knots(count, degree), count) for count in (rows, columns)]
    return Surface(*bases, points, 1 + weighted * random.random(x.shape))
