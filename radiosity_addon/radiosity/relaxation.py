# SPDX-License-Identifier: GPL-3.0-or-later
"""The radiosity equation B = E + rho F B, and what every way of solving it shares.

All ways keep the same books. Of the radiosity, `shot` was sent to the other patches, which received the irradiance
H = F shot; what they have not sent on is unshot = E + rho H - shot. A step shoots light of some patches or of all,
and the solvers (solvers.py) only differ in which (Gortler, Cohen and Slusallek 1994). E + rho H is a picture that
lacks later bounces. Where light passes sheets, rho counts for the light of both their sides (crossing.py). Light groups
and colour channels ride along as columns.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ..arrays import Float64, Floats, Int64
from .patches import Patches
from .transport import Transport


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
        ambient: (G, 3) float64, W/m2, irradiance that the unshot light may bring in the end
        shooters: (S,) int64, patches that shot in this step
        shots: patches shot so far, counted each time
        residual: unshot share of the emitted power, channels summed, of the group where it is largest
        balance: where the light has gone
    """

    exitance: Float64
    reflectance: Float64
    irradiance: Float64
    unshot: Float64
    ambient: Float64
    shooters: Int64
    shots: int
    residual: float
    balance: Balance

    @property
    def radiosity(self) -> Float64:
        """Radiosity (N, G, 3) so far, W/m2: exitance + reflectance * irradiance."""
        return self.exitance + self.reflectance * self.irradiance

    @property
    def with_ambient(self) -> Float64:
        """Radiosity (N, G, 3), W/m2, with a guess at the light still to come, for previews (Cohen et al. 1988)."""
        return self.radiosity + self.reflectance * self.ambient


@dataclass(frozen=True, eq=False)
class Solution:
    """What the solver ended with.

    Attributes:
        radiosity: (N, G, 3) float64, W/m2
        irradiance: (N, G, 3) float64, W/m2, received from patches, of sheets what their reflectance counts for; direct
            light that came in the exitance is not in it
        unshot: (N, G, 3) float64, W/m2
        ambient: (G, 3) float64, W/m2, irradiance that the unshot light may bring in the end
        shots: patches shot, counted each time
        residuals: the residual at the start and after every step
        converged: the residual is within the tolerance
        balance: where the light has gone
    """

    radiosity: Float64
    irradiance: Float64
    unshot: Float64
    ambient: Float64
    shots: int
    residuals: tuple[float, ...]
    converged: bool
    balance: Balance

    def with_ambient(self, reflectance: Floats) -> Solution:
        """The same with a guess at the light still to come, for reflectances (N, 3)."""
        irradiance = self.irradiance + self.ambient
        return replace(
            self, irradiance=irradiance, radiosity=self.radiosity + reflectance[:, None].astype(float) * self.ambient
        )


TINY = 1e-30

Refinement: TypeAlias = Generator[SolverState, None, Solution]
"""Yields the state after each step, returns the solution."""


class UnshotLight:
    """The light of N patches while it is solved for; arrays are (N, C), C = 3 G columns.

    Attributes:
        transport: exchange between the patches
        reflectance: (N, C)
        exitance: (N, C), W/m2, what was given
        irradiance: (N, C), W/m2, received so far
        unshot: (N, C), W/m2
        shots: patches shot so far
    """

    def __init__(self, transport: Transport, patches: Patches, exitance: Floats) -> None:
        count, self._groups = exitance.shape[:2]
        self.transport = transport
        self.reflectance = np.tile(patches.reflectance.astype(np.float64), (1, self._groups))
        self.exitance = np.array(exitance, np.float64).reshape(count, 3 * self._groups)
        self.unshot = self.exitance.copy()
        self.irradiance = np.zeros_like(self.exitance)
        self.shots = 0
        self._area = transport.area[:, None]
        losses = transport.losses
        self._losses = losses if losses.shape[1] == 1 else np.tile(losses, (1, self._groups))
        self._emitted = (self._area * self.exitance).sum(0)
        self._shot, self._reflected, self._absorbed, self._escaped = np.zeros((4, 3 * self._groups))
        # Power is counted in shares of its group's, so that the order of shots does not change with a lamp's strength.
        by_group = np.abs(self._area * self.exitance).sum(0).reshape(self._groups, 3).sum(1)
        self._weight = np.repeat(1 / np.where(by_group > 0, by_group, np.inf), 3)

    def power(self, radiosity: Float64) -> Float64:
        """Power (N,) of radiosity (N, C), W/m2, each light group in shares of what it emits."""
        weighed: Float64 = self._area * np.abs(radiosity) * self._weight
        return weighed.sum(1)

    def ambient(self) -> Float64:
        """Irradiance (C,), W/m2, that the unshot light brings if it is spread evenly and reflected for ever by the mean
        reflectance, in a room that nothing leaves (Cohen, Chen, Wallace and Greenberg 1988, section 5).

        Patches count by the area that sees others: the outer faces of a room have no part in its light.
        """
        weight = self._area * (1 - self._losses)
        weight /= np.maximum(weight.sum(0), TINY)
        mean_reflectance = np.minimum((weight * self.reflectance).sum(0), 0.99)
        ambient: Float64 = (weight * self.unshot).sum(0) / (1 - mean_reflectance)
        return ambient

    @property
    def residual(self) -> float:
        """Unshot share of the emitted power, channels summed, of the group where it is largest."""
        columns = (self._area * np.abs(self.unshot) * self._weight).sum(0)
        return float(columns.reshape(self._groups, 3).sum(1).max(initial=0))

    def bounced(self, received: Float64) -> Float64:
        """Power (N, C), W, that patches send on of the power (N, C) that they receive."""
        if self.transport.crossing is None:
            return self.reflectance * received
        return self.reflectance * self.transport.mixed(received / self._area) * self._area

    def shoot(self, rows: Int64, amount: Float64, received: Float64 | None = None) -> None:
        """Send radiosity `amount` (S, C), W/m2, from patches `rows` (S,).

        Args:
            received: (N, C), W, what arrives of it, where that is known already
        """
        if received is None:
            received = self.transport.scatter(rows, amount)
        bounced = self.bounced(received)
        self.unshot[rows] -= amount
        self.unshot += bounced / self._area
        self.irradiance += self.transport.mixed(received / self._area)
        leaving = amount * self._area[rows]
        self._shot += leaving.sum(0)
        self._escaped += (leaving * self._losses[rows]).sum(0)
        self._reflected += bounced.sum(0)
        self._absorbed += (received - bounced).sum(0)
        self.shots += len(rows)

    def balance(self) -> Balance:
        """Where the light has gone so far."""
        unshot = (self._area * self.unshot).sum(0)
        parts = (self._emitted, self._shot, self._reflected, self._absorbed, self._escaped, unshot)
        return Balance(*(part.reshape(self._groups, 3).copy() for part in parts))

    def state(self, shooters: Int64) -> SolverState:
        """What a step of these shooters has led to."""
        shape = (len(self.exitance), self._groups, 3)
        return SolverState(
            exitance=self.exitance.reshape(shape),
            reflectance=self.reflectance.reshape(shape)[:, :1],
            irradiance=self.irradiance.reshape(shape),
            unshot=self.unshot.reshape(shape),
            ambient=self.ambient().reshape(self._groups, 3),
            shooters=shooters,
            shots=self.shots,
            residual=self.residual,
            balance=self.balance(),
        )


Step: TypeAlias = Callable[[], Int64]
"""Shoots some of the light; returns the patches (S,) that shot."""


def relax(light: UnshotLight, step: Step, tolerance: float, most_steps: int) -> Refinement:
    """Take steps until the residual is within `tolerance`, or `most_steps` are taken."""
    residuals = [light.residual]
    for _ in range(most_steps):
        if residuals[-1] <= tolerance:
            break
        state = light.state(step())
        residuals.append(state.residual)
        yield state
    last = light.state(np.zeros(0, np.int64))
    return Solution(
        radiosity=last.radiosity,
        irradiance=last.irradiance,
        unshot=last.unshot,
        ambient=last.ambient,
        shots=light.shots,
        residuals=tuple(residuals),
        converged=residuals[-1] <= tolerance,
        balance=last.balance,
    )
