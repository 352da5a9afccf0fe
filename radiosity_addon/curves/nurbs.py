# SPDX-License-Identifier: GPL-3.0-or-later
"""Rational B-spline curves and tensor-product surfaces (NURBS): points, derivatives, normals, lengths.

A rational spline is the picture of one in a space with a dimension more, whose last coordinate is the weight (Piegl
and Tiller 1997, chapter 4). With weights of 1 it is the plain B-spline, on one span the (rational) Bezier curve.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import comb

import numpy as np

from ..arrays import Bools, Float64
from .bspline import Basis

GAUSS_POINTS = 8
"""Points of the Gauss-Legendre rule for arc length."""

PIECES = 8
"""Parts of each polynomial piece to which that rule is applied."""

DEGENERATE = 1e-9
"""Partial derivatives whose cross product is below this share of the largest have no normal of their own."""

NUDGE = 1e-4
"""Share of the domain by which a point moves inward where first and mixed derivatives give no normal."""

BLOCK = 1 << 13
"""Points of a surface that are found at once: their temporaries stay in cache."""


def _check(points: Float64, weights: Float64) -> None:
    if not (np.isfinite(points).all() and np.isfinite(weights).all()):
        raise ValueError("control points and weights must be finite")
    if (weights <= 0).any():
        raise ValueError("weights must be positive")


def _homogeneous(points: Float64, weights: Float64) -> Float64:
    weighted = np.concatenate([points * weights[..., None], weights[..., None]], axis=-1)
    return np.ascontiguousarray(np.moveaxis(weighted, -1, 0))


@dataclass(frozen=True, eq=False)
class Curve:
    """A rational B-spline curve in C dimensions; beyond space these may be a radius or an angle.

    Attributes:
        basis: of `points` control points
        points: (N, C) float64
        weights: (N,) float64, positive

    Raises:
        ValueError: weights that aren't positive, values that aren't finite
    """

    basis: Basis
    points: Float64
    weights: Float64

    def __post_init__(self) -> None:
        _check(self.points, self.weights)

    @cached_property
    def control(self) -> Float64:
        """(C + 1, N) weighted points and weights."""
        return _homogeneous(self.points, self.weights)

    def at(self, parameters: Float64) -> Float64:
        """Points (T, C) at parameters (T,)."""
        return self.derivatives(parameters, 0)[0]

    def derivatives(self, parameters: Float64, order: int, from_left: bool = False) -> list[Float64]:
        """Points and derivatives up to an order, (T, C) each (Piegl and Tiller 1997, eq. 4.8)."""
        weighted = [self.basis.blend(self.control, parameters, k, from_left) for k in range(order + 1)]
        weight = weighted[0][-1]
        found: list[Float64] = []
        for k in range(order + 1):
            value = weighted[k][:-1].copy()
            for i in range(1, k + 1):
                value -= comb(k, i) * weighted[i][-1] * found[k - i]
            found.append(value / weight)
        return [np.ascontiguousarray(value.T) for value in found]

    def arc_length(self, parameters: Float64) -> Float64:
        """Length (T,) along the first three dimensions from the start of the domain to each parameter.

        By a Gauss-Legendre rule on parts of each polynomial piece; exact to rounding where the speed is smooth.
        """
        breaks = self.basis.breaks
        steps = np.unique(np.concatenate([_refined(breaks, PIECES), np.clip(parameters, *self.basis.domain)]))
        nodes, share = np.polynomial.legendre.leggauss(GAUSS_POINTS)
        half = np.diff(steps) / 2
        places = (steps[:-1] + half)[:, None] + half[:, None] * nodes
        velocity = self.derivatives(places.ravel(), 1)[1][:, :3]
        speed = np.linalg.norm(velocity, axis=1).reshape(places.shape)
        length = np.append(0.0, np.cumsum((speed * share).sum(axis=1) * half))
        return np.asarray(length[np.searchsorted(steps, np.clip(parameters, *self.basis.domain))])


def _refined(breaks: Float64, parts: int) -> Float64:
    """Breaks (B,) and evenly spaced parameters between them."""
    share = np.arange(parts) / parts
    inner = breaks[:-1, None] + np.diff(breaks)[:, None] * share
    return np.append(inner.ravel(), breaks[-1])


@dataclass(frozen=True, eq=False)
class Surface:
    """A rational tensor-product surface.

    Attributes:
        basis_u, basis_v: of the rows and columns of control points
        points: (U, V, 3) float64, m
        weights: (U, V) float64, positive

    Raises:
        ValueError: weights that aren't positive, values that aren't finite
    """

    basis_u: Basis
    basis_v: Basis
    points: Float64
    weights: Float64

    def __post_init__(self) -> None:
        _check(self.points, self.weights)

    @cached_property
    def control(self) -> Float64:
        """(4, V, U) weighted points and weights."""
        return np.ascontiguousarray(np.swapaxes(_homogeneous(self.points, self.weights), 1, 2))

    @cached_property
    def rational(self) -> bool:
        """Whether the weights differ."""
        return bool(np.ptp(self.weights) > 0)

    def at(self, u: Float64, v: Float64) -> Float64:
        """Points (U, V, 3) at all pairs of parameters (U,) and (V,)."""
        result = np.empty((len(u), len(v), 3))
        for rows in _blocks(len(u), len(v)):
            result[rows] = np.moveaxis(self.partials(u[rows], v, [(0, 0)])[0, 0], 0, -1)
        return result

    def partials(
        self, u: Float64, v: Float64, wanted: list[tuple[int, int]], left: tuple[bool, bool] = (False, False)
    ) -> Mapping[tuple[int, int], Float64]:
        """Partial derivatives at all pairs of parameters (Piegl and Tiller 1997, eq. 4.20).

        Args:
            u, v: (U,) and (V,) float64
            wanted: orders along u and v
            left: the limits from below at knots of u and of v

        Returns:
            (3, U, V) float64 each
        """
        needed = {pair for most in wanted for pair in product(*(range(order + 1) for order in most))}
        along_u = {
            k: np.ascontiguousarray(np.swapaxes(self.basis_u.blend(self.control, u, k, left[0]), 1, 2))
            for k in {pair[0] for pair in needed}
        }
        found: dict[tuple[int, int], Float64] = {}
        weights: dict[tuple[int, int], Float64] = {}
        for k, m in sorted(needed):
            weighted = self.basis_v.blend(along_u[k], v, m, left[1])
            value, weights[k, m] = weighted[:3], weighted[3]
            if self.rational:
                for i, j in product(range(k + 1), range(m + 1)):
                    if i or j:
                        value -= comb(k, i) * comb(m, j) * weights[i, j] * found[k - i, m - j]
            value /= weights[0, 0]
            found[k, m] = value
        return {pair: found[pair] for pair in wanted}

    def normals(self, u: Float64, v: Float64, left: tuple[bool, bool] = (False, False)) -> Float64:
        """Unit normals (U, V, 3) along dS/du x dS/dv; zero where the surface has none.

        Where one of both derivatives vanishes, as at a pole, the normal is the limit from within: there the mixed
        derivative says which way the vanishing one points beside it.
        """
        return self.points_and_normals(u, v, left)[1]

    def points_and_normals(
        self, u: Float64, v: Float64, left: tuple[bool, bool] = (False, False)
    ) -> tuple[Float64, Float64]:
        """Both at once, (U, V, 3) each: see `at` and `normals`."""
        points, normals = np.empty((len(u), len(v), 3)), np.empty((len(u), len(v), 3))
        size = float(np.linalg.norm(np.ptp(self.points.reshape(-1, 3), axis=0)))
        (low_u, high_u), (low_v, high_v) = self.basis_u.domain, self.basis_v.domain
        least = DEGENERATE * size**2 / ((high_u - low_u) * (high_v - low_v))
        for rows in _blocks(len(u), len(v)):
            found = self.partials(u[rows], v, [(0, 0), (1, 0), (0, 1)], left)
            points[rows] = np.moveaxis(found[0, 0], 0, -1)
            cross = _cross(found[1, 0], found[0, 1])
            length = np.sqrt(cross[0] ** 2 + cross[1] ** 2 + cross[2] ** 2)
            lost = ~(length > least)
            cross /= np.where(lost, 1.0, length)
            normals[rows] = np.moveaxis(cross, 0, -1)
            if lost.any():
                normals[rows][lost] = self._limits(u[rows], v, left)[lost]
        return points, normals

    def _limits(self, u: Float64, v: Float64, left: tuple[bool, bool]) -> Float64:
        """Normals (U, V, 3) of a patch with degenerate points, as limits from within the domain."""
        found = self.partials(u, v, [(1, 0), (0, 1), (1, 1)], left)
        along_u, along_v, mixed = found[1, 0], found[0, 1], found[1, 1]
        inward_u = np.where(u >= self.basis_u.domain[1], -1.0, 1.0)[:, None]
        inward_v = np.where(v >= self.basis_v.domain[1], -1.0, 1.0)[None, :]
        cross = inward_v * _cross(mixed, along_v) + inward_u * _cross(along_u, mixed)
        normal, known = _unit(cross)
        if not known.all():
            inner_u, inner_v = _inward(u, self.basis_u), _inward(v, self.basis_v)
            nearby = self.partials(inner_u, inner_v, [(1, 0), (0, 1)], left)
            other, _ = _unit(_cross(nearby[1, 0], nearby[0, 1]))
            normal = np.where(known, normal, other)
        return np.asarray(np.moveaxis(normal, 0, -1))


def _blocks(rows: int, columns: int) -> list[slice]:
    step = max(1, BLOCK // max(columns, 1))
    return [slice(start, start + step) for start in range(0, rows, step)]


def _cross(a: Float64, b: Float64) -> Float64:
    """Cross products of vectors whose coordinates lie along the first axis."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _unit(vector: Float64) -> tuple[Float64, Bools]:
    """Vectors (3, U, V) of unit length, and which (U, V) have one that stands out from rounding."""
    length = np.sqrt((vector**2).sum(axis=0))
    known = length > DEGENERATE * max(float(length.max(initial=0.0)), 1e-300)
    return vector / np.where(known, length, 1.0) * known, known


def _inward(parameters: Float64, basis: Basis) -> Float64:
    low, high = basis.domain
    gap = NUDGE * (high - low)
    return np.asarray(np.clip(parameters + np.where(parameters >= high, -gap, gap), low + gap, high - gap))
