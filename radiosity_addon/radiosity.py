# SPDX-License-Identifier: GPL-3.0-or-later
"""The radiosity equation B = E + rho F B, solved on the traced transport.

Progressive refinement (Cohen, Chen, Wallace and Greenberg 1988): patches shoot the light that they have not shot yet
to all others, which reflect it and have unshot light in turn. Every state on the way is a picture that only lacks
later bounces. Light groups and colour channels ride along as columns.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from .arrays import Float64, Floats, Int64
from .form_factor import Transport
from .patches import Patches

SHOOTING_SHARE = 0.1
"""A step shoots each patch whose unshot power is at least this share of the largest. Higher ones send a little less
light twice, but in many more steps; at 0.1 a room takes as many steps as bounces, the fewest that are possible."""

MOST_STEPS = 500
"""Steps after which block refinement stops unfinished; a closed room of reflectance 0.99 is then at 0.7 %."""

MOST_SINGLE_SHOTS = 1_000_000
"""Shots after which one-patch refinement stops unfinished."""

Chooser: TypeAlias = Callable[[Float64], tuple[Int64, float]]
"""Given the unshot power (N,) of each patch: the patches (S,) that shoot now, and the threshold they were above."""


@dataclass(frozen=True, eq=False)
class Balance:
    """Where the light has gone so far; all (G, 3) float64, W.

    shot = reflected + absorbed + escaped and emitted + reflected = shot + unshot,
    hence emitted = unshot + absorbed + escaped.
    """

    emitted: Float64
    shot: Float64
    reflected: Float64
    absorbed: Float64
    escaped: Float64
    unshot: Float64

    @property
    def error(self) -> float:
        """Largest violation of the two equations, as a share of what is emitted."""
        shots = np.abs(self.shot - self.reflected - self.absorbed - self.escaped).sum()
        surfaces = np.abs(self.emitted + self.reflected - self.shot - self.unshot).sum()
        total = np.abs(self.emitted).sum()
        return float(max(shots, surfaces) / total) if total > 0 else 0.0


@dataclass(frozen=True, eq=False)
class SolverState:
    """The light after a step. Its arrays are the solver's own and change with the next step.

    Attributes:
        exitance: (N, G, 3) float64, W/m2, what the solver was given
        reflectance: (N, 1, 3) float64
        irradiance: (N, G, 3) float64, W/m2, received from patches so far
        unshot: (N, G, 3) float64, W/m2, part of the radiosity that was not shot yet
        shooters: (S,) int64, patches that shot in this step
        threshold: unshot power from which on patches shot, in shares of its group's emitted power, groups summed
        shots: patches shot so far, counted each time
        residual: unshot share of the emitted power, channels summed, of the group where it is largest
        balance: where the light has gone
    """

    exitance: Float64
    reflectance: Float64
    irradiance: Float64
    unshot: Float64
    shooters: Int64
    threshold: float
    shots: int
    residual: float
    balance: Balance

    @property
    def radiosity(self) -> Float64:
        """Radiosity (N, G, 3) so far, W/m2: exitance + reflectance * irradiance."""
        return self.exitance + self.reflectance * self.irradiance

    def with_ambient(self, area: Float64) -> Float64:
        """Radiosity (N, G, 3), W/m2, with a guess at the light still to come, for previews.

        The unshot light is taken as spread evenly and reflected for ever by the mean reflectance, in a room that
        nothing leaves (Cohen et al. 1988, section 5).
        """
        weight = (area / area.sum())[:, None, None]
        mean_reflectance = np.minimum((weight * self.reflectance).sum(0), 0.99)
        ambient = (weight * self.unshot).sum(0) / (1 - mean_reflectance)
        brightened: Float64 = self.radiosity + self.reflectance * ambient
        return brightened


@dataclass(frozen=True, eq=False)
class Solution:
    """What the solver ended with.

    Attributes:
        radiosity: (N, G, 3) float64, W/m2
        irradiance: (N, G, 3) float64, W/m2, received from patches; direct light that came in the exitance is not in it
        unshot: (N, G, 3) float64, W/m2
        shots: patches shot, counted each time
        residuals: the residual at the start and after every step
        converged: the residual is within the tolerance
        balance: where the light has gone
    """

    radiosity: Float64
    irradiance: Float64
    unshot: Float64
    shots: int
    residuals: tuple[float, ...]
    converged: bool
    balance: Balance


Refinement: TypeAlias = Generator[SolverState, None, Solution]
"""Yields the state after each step, returns the solution."""


def refine(
    transport: Transport, patches: Patches, exitance: Floats, tolerance: float = 1e-3, most_steps: int = MOST_STEPS
) -> Refinement:
    """Block progressive refinement: all patches above a falling threshold of unshot power shoot at once.

    Args:
        transport: exchange between the N patches
        patches: for their reflectance (N, 3)
        exitance: (N, G, 3), W/m2, what each patch emits, and reflects of the lamps' light, in each light group
        tolerance: residual at which it ends
        most_steps: steps at which it ends even so
    """
    threshold = np.inf

    def above_threshold(power: Float64) -> tuple[Int64, float]:
        nonlocal threshold
        threshold = min(threshold, SHOOTING_SHARE * float(power.max()))
        return np.flatnonzero(power >= threshold), threshold

    return _progress(transport, patches, exitance, above_threshold, tolerance, most_steps)


def southwell(
    transport: Transport,
    patches: Patches,
    exitance: Floats,
    tolerance: float = 1e-3,
    most_steps: int = MOST_SINGLE_SHOTS,
) -> Refinement:
    """One-patch progressive refinement, the reference for `refine` (same arguments).

    The patch with the most unshot power shoots alone: Southwell relaxation (Gortler, Cohen and Slusallek 1994).
    """

    def largest(power: Float64) -> tuple[Int64, float]:
        chosen = int(power.argmax())
        return np.array([chosen]), float(power[chosen])

    return _progress(transport, patches, exitance, largest, tolerance, most_steps)


def bounce(transport: Transport, patches: Patches, exitance: Floats, bounces: int) -> Refinement:
    """Jacobi iteration: all patches shoot in every step, so that step k holds the first k bounces and no more."""

    def everyone(power: Float64) -> tuple[Int64, float]:
        return np.arange(len(power)), 0.0

    return _progress(transport, patches, exitance, everyone, 0.0, bounces)


def solve_dense(transport: Transport, patches: Patches, exitance: Floats) -> Float64:
    """Radiosity (N, G, 3), W/m2, by elimination on the full matrix I - rho F; a reference for small N."""
    form_factors = transport.dense() / transport.area[:, None]
    radiosity: Float64 = np.empty(exitance.shape)
    for channel in range(3):
        reflectance = patches.reflectance[:, channel].astype(np.float64)
        matrix = np.eye(transport.count) - reflectance[:, None] * form_factors
        radiosity[:, :, channel] = np.linalg.solve(matrix, exitance[:, :, channel].astype(np.float64))
    return radiosity


def _progress(
    transport: Transport, patches: Patches, exitance: Floats, choose: Chooser, tolerance: float, most_steps: int
) -> Refinement:
    """Shoot what `choose` chooses until the residual is within `tolerance`; arrays are (N, C), C = 3 G columns."""
    count, groups = exitance.shape[:2]
    area = transport.area[:, None]
    reflectance = np.tile(patches.reflectance.astype(np.float64), (1, groups))
    first = np.array(exitance, np.float64).reshape(count, 3 * groups)
    unshot = first.copy()
    irradiance = np.zeros_like(first)
    emitted = (area * first).sum(0)
    shot, reflected, absorbed, escaped = np.zeros((4, 3 * groups))
    # Power is counted in shares of its group's, so that the order of shots does not change with a lamp's strength.
    by_group = np.abs(area * first).sum(0).reshape(groups, 3).sum(1)
    weight = np.repeat(1 / np.where(by_group > 0, by_group, np.inf), 3)
    power = area * np.abs(unshot) * weight
    residuals = [float(power.sum(0).reshape(groups, 3).sum(1).max(initial=0))]
    shots = 0
    shape = (count, groups, 3)

    def balance() -> Balance:
        parts = (emitted, shot, reflected, absorbed, escaped, (area * unshot).sum(0))
        return Balance(*(part.reshape(groups, 3).copy() for part in parts))

    for _ in range(most_steps):
        if residuals[-1] <= tolerance:
            break
        shooters, threshold = choose(power.sum(1))
        leaving = unshot[shooters]
        received = transport.scatter(shooters, leaving)
        unshot[shooters] = 0
        bounced = reflectance * received
        irradiance += received / area
        unshot += bounced / area
        leaving *= area[shooters]
        shot += leaving.sum(0)
        escaped += (leaving * transport.escaped[shooters, None]).sum(0)
        reflected += bounced.sum(0)
        absorbed += (received - bounced).sum(0)
        power = area * np.abs(unshot) * weight
        residuals.append(float(power.sum(0).reshape(groups, 3).sum(1).max()))
        shots += len(shooters)
        yield SolverState(
            exitance=first.reshape(shape),
            reflectance=reflectance.reshape(shape)[:, :1],
            irradiance=irradiance.reshape(shape),
            unshot=unshot.reshape(shape),
            shooters=shooters,
            threshold=threshold,
            shots=shots,
            residual=residuals[-1],
            balance=balance(),
        )
    return Solution(
        radiosity=(first + reflectance * irradiance).reshape(shape),
        irradiance=irradiance.reshape(shape),
        unshot=unshot.reshape(shape),
        shots=shots,
        residuals=tuple(residuals),
        converged=residuals[-1] <= tolerance,
        balance=balance(),
    )
