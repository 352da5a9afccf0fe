# SPDX-License-Identifier: GPL-3.0-or-later
"""Where curves and surfaces are sampled: as densely as their curvature asks for, and no denser.

A surface is sampled on the lines of a grid of parameters, so neighbouring faces share their corners and no crack can
open. Between knots the lines follow the need: their density is what keeps the distance of the linear pieces from the
true shape below a bound (Filip, Magedson and Markot 1986, "Surface algorithms using bounds on derivatives") and the
turn of the normal from one line to the next below an angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float64
from .bspline import Basis
from .nurbs import Curve, Surface

CHORD = 5e-4
"""Distance of the linear pieces from the true shape, as a share of the shape's extent."""

TURN = np.radians(20.0)
"""Most that the normal turns from one line of the grid to the next."""

ALONG, ACROSS = 0.375, 0.25
"""Shares of the bound for the bend along each direction, twice, and for the twist."""

SLIDE = 10.0
"""How much farther points of a curve may be off along it, where only its texture slides, than across it."""

PROBES = (np.cos(np.pi * (np.arange(5) + 0.5) / 5)[::-1] + 1) / 2
"""Where derivatives are looked at between two knots: nodes of Chebyshev, which stay clear of the ends."""

MARGIN = 1.1
"""By which the densities seen at the probes are enlarged for what lies between them."""

EVENNESS = 0.3
"""Least density between two knots, as a share of their mean: steps may differ, but not without end."""

MOST_FACES = 1 << 21
"""Beyond that many faces of one surface its lines are thinned out."""

MOST_STEPS = 4096
"""Most lines between two knots."""


@dataclass(frozen=True, eq=False)
class Density:
    """Steps that each parameter piece asks for.

    Attributes:
        breaks: (B,) float64, ends of the pieces
        rate: (B - 1, P) float64, steps per unit of the parameter at the probes of each piece
    """

    breaks: Float64
    rate: Float64

    @property
    def steps(self) -> Float64:
        """(B - 1,) steps of each piece, not yet whole."""
        return np.asarray(self.rate.mean(axis=1) * np.diff(self.breaks) * MARGIN)

    def scaled(self, factor: Float64 | float) -> Density:
        """With all rates of each piece times a factor."""
        return Density(self.breaks, self.rate * np.reshape(factor, (-1, 1)))

    def parameters(self, least: int = 1) -> Float64:
        """Parameters from the first to the last break, every break among them.

        Within a piece they lie so that each step takes the same share of the density.

        Args:
            least: steps in all
        """
        counts = np.clip(np.ceil(self.steps), 1, MOST_STEPS).astype(np.int64)
        short = least - int(counts.sum())
        if short > 0:
            counts += -(-short // len(counts))
        found = [self.breaks[:1]]
        for start, stop, count, rate in zip(self.breaks, self.breaks[1:], counts, self.rate, strict=False):
            found.append(start + (stop - start) * _even_shares(rate, int(count)))
        return np.concatenate(found)


def _even_shares(rate: Float64, count: int) -> Float64:
    """(count,) places in 0..1, the last one 1, that divide the integral of a rate at the probes evenly."""
    if count == 1:
        return np.ones(1)
    mean = float(rate.mean())
    level = np.maximum(rate / mean, EVENNESS) if mean > 0 else np.ones_like(rate)
    fine = np.linspace(0.0, 1.0, 8 * len(PROBES) + 1)
    height = np.interp(fine, PROBES, level)
    total = np.append(0.0, np.cumsum((height[1:] + height[:-1]) / 2))
    places = np.interp(np.arange(1, count + 1) / count, total / total[-1], fine)
    places[-1] = 1.0
    return np.asarray(places)


def probes_of(breaks: Float64) -> Float64:
    """((B - 1) * P,) the parameters at which the pieces between breaks are looked at."""
    return np.asarray((breaks[:-1, None] + np.diff(breaks)[:, None] * PROBES).ravel())


def curve_density(curve: Curve, chord: float, turn: float = TURN) -> Density:
    """What a curve in space asks for: its bend keeps the bound, uneven speed along it a wider one.

    Args:
        chord: m
        turn: radians
    """
    breaks = curve.basis.breaks
    _, first, second = (value[:, :3] for value in curve.derivatives(probes_of(breaks), 2))
    square = np.maximum((first**2).sum(axis=1), 1e-300)
    across = np.linalg.norm(np.cross(first, second), axis=1)
    along = np.abs((first * second).sum(axis=1))
    sag = np.maximum(across, along / SLIDE) / np.sqrt(square)
    rate = np.maximum(np.sqrt(sag / (8 * chord)), across / square / turn)
    return Density(breaks, rate.reshape(-1, len(PROBES)))


def surface_densities(surface: Surface, chord: float, turn: float = TURN) -> tuple[Density, Density]:
    """What a surface asks for along u and along v.

    Args:
        chord: m
        turn: radians
    """
    breaks_u, breaks_v = surface.basis_u.breaks, surface.basis_v.breaks
    probes_v = probes_of(breaks_v)
    rates_u, twists = [], []
    rate_v = np.zeros(len(probes_v))
    for row in np.split(probes_of(breaks_u), len(breaks_u) - 1):  # a row of patches at a time bounds the memory
        at = surface.partials(row, probes_v, [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)])
        su, sv, suu, suv, svv = at[1, 0], at[0, 1], at[2, 0], at[1, 1], at[0, 2]
        cross = np.cross(su, sv, axis=0)
        area = np.sqrt((cross**2).sum(axis=0))
        size = np.sqrt((su**2).sum(axis=0) * (sv**2).sum(axis=0))
        known = area > 1e-9 * float(size.max(initial=0.0))
        normal = cross / np.where(known, area, 1.0)
        turn_u = _turn(np.cross(suu, sv, axis=0) + np.cross(su, suv, axis=0), normal, area, known)
        turn_v = _turn(np.cross(suv, sv, axis=0) + np.cross(su, svv, axis=0), normal, area, known)
        bend_u, bend_v = (np.sqrt(np.linalg.norm(part, axis=0) / (8 * ALONG * chord)) for part in (suu, svv))
        rates_u.append(np.maximum(bend_u, turn_u / turn).max(axis=1))
        rate_v = np.maximum(rate_v, np.maximum(bend_v, turn_v / turn).max(axis=0))
        twist = np.abs((suv * normal).sum(axis=0)).max(axis=0)
        twists.append(twist.reshape(-1, len(PROBES)).max(axis=1))
    density_u = Density(breaks_u, np.stack(rates_u))
    density_v = Density(breaks_v, rate_v.reshape(-1, len(PROBES)))
    step_u = np.diff(breaks_u) / np.maximum(density_u.steps, 1.0)
    step_v = np.diff(breaks_v) / np.maximum(density_v.steps, 1.0)
    error = np.stack(twists) * step_u[:, None] * step_v / 4
    finer = np.sqrt(np.maximum(error / (ACROSS * chord), 1.0))
    return _finer(density_u, finer.max(axis=1)), _finer(density_v, finer.max(axis=0))


def _turn(cross_rate: Float64, normal: Float64, area: Float64, known: Bools) -> Float64:
    """How fast (U, V) the unit normal turns, from the rate of the cross product of the partial derivatives."""
    across = cross_rate - normal * (cross_rate * normal).sum(axis=0)
    return np.asarray(np.where(known, np.sqrt((across**2).sum(axis=0)) / np.where(known, area, 1.0), 0.0))


def _finer(density: Density, factor: Float64) -> Density:
    """At least one step a piece, times the factor where that is above one."""
    width = np.diff(density.breaks)
    least = np.where(factor > 1, 1 / (width * MARGIN), 0.0)[:, None]
    return Density(density.breaks, np.maximum(density.rate, least)).scaled(factor)


def grid_parameters(
    surface: Surface, chord: float, turn: float = TURN, closed: tuple[bool, bool] = (False, False)
) -> tuple[Float64, Float64]:
    """Parameters along u and v on whose lines the surface is sampled, both ends of the domain included.

    Args:
        chord: m
        turn: radians
        closed: the surface closes on itself along u and v, and has three steps or more around
    """
    densities = surface_densities(surface, chord, turn)
    faces = float(np.prod([np.maximum(density.steps, 1).sum() for density in densities]))
    if faces > MOST_FACES:
        densities = tuple(density.scaled(np.sqrt(MOST_FACES / faces)) for density in densities)  # type: ignore[assignment]
    u, v = (density.parameters(3 if round_ else 1) for density, round_ in zip(densities, closed, strict=True))
    return u, v


def extent(points: Float64) -> float:
    """Diagonal of the box around points (..., 3)."""
    flat = points.reshape(-1, points.shape[-1])[:, :3]
    return float(np.linalg.norm(np.ptp(flat, axis=0))) if len(flat) else 0.0


def smooth_normals(surface: Surface, u: Float64, v: Float64) -> Float64:
    """Unit normals (U, V, 3) as shading wants them: at creases the mean of both sides."""
    crease_u, crease_v = _creases(surface.basis_u, u), _creases(surface.basis_v, v)
    normals = surface.normals(u, v)
    if crease_u.any():
        normals[crease_u] += surface.normals(u[crease_u], v, (True, False))
    if crease_v.any():
        normals[:, crease_v] += surface.normals(u, v[crease_v], (False, True))
    if crease_u.any() and crease_v.any():
        corner = np.ix_(crease_u, crease_v)
        normals[corner] += surface.normals(u[crease_u], v[crease_v], (True, True))
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    return np.asarray(normals / np.where(length > 0, length, 1.0))


def _creases(basis: Basis, parameters: Float64) -> Bools:
    """Which parameters (T,) lie on knots within the domain at which the tangent can jump."""
    low, high = basis.domain
    inner = (parameters > low) & (parameters < high)
    return np.array([here and basis.continuity(float(t)) < 1 for t, here in zip(parameters, inner, strict=True)])
