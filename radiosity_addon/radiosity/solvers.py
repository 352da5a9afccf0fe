# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways of solving the radiosity equation: in which order, and how much, patches shoot.

Each is a function that says how one step shoots; all end at the same solution.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import Float64, Floats, Int64
from ..errors import SettingsError
from ..settings import SolverName
from .patches import Patches
from .relaxation import Refinement, Step, UnshotLight, relax
from .transport import Transport

SHOOTING_SHARE = 0.1
"""A step shoots each patch whose unshot power is at least this share of the largest. Higher ones send a little less
light twice, but in many more steps; at 0.1 a room takes as many steps as bounces, the fewest that are possible."""

MOST_STEPS = 500
"""Steps after which block refinement stops unfinished; a closed room of reflectance 0.99 is then at 0.7 %."""

MOST_SWEEPS = 5000
"""Steps of all patches after which the others stop unfinished."""

MOST_SINGLE_SHOTS = 1_000_000
"""Shots after which one-patch refinement stops unfinished."""

MOST_REPEATS = 2
"""Eliminations: the second mends the rounding of the first."""

MOST_DENSE = 8000
"""Patches of which a full matrix, 0.5 GB and as much again for its factors, can be thought of."""


@dataclass(frozen=True)
class Solver:
    """A way of solving the radiosity equation.

    Attributes:
        method: given the light that is to be shot, how a step shoots some of it
        most_steps: steps after which it ends even so
    """

    method: Callable[[UnshotLight], Step]
    most_steps: int

    def __call__(
        self,
        transport: Transport,
        patches: Patches,
        exitance: Floats,
        tolerance: float = 1e-3,
        most_steps: int | None = None,
    ) -> Refinement:
        """Yield the state after each step, and return the solution.

        Args:
            exitance: (N, G, 3), W/m2, what patches send out before light passes between them
            tolerance: residual at which it ends
            most_steps: None for the solver's own limit
        """
        light = UnshotLight(transport, patches, exitance)
        return relax(light, self.method(light), tolerance, self.most_steps if most_steps is None else most_steps)


def solver(most_steps: int) -> Callable[[Callable[[UnshotLight], Step]], Solver]:
    """Make a Solver of a method."""
    return lambda method: Solver(method, most_steps)


@solver(MOST_STEPS)
def progressive(light: UnshotLight) -> Step:
    """Block progressive refinement: all patches above a falling threshold of unshot power shoot at once.

    The shots are those of Cohen, Chen, Wallace and Greenberg (1988), as many in a step as serve alike.
    """
    threshold = np.inf

    def step() -> Int64:
        nonlocal threshold
        power = light.power(light.unshot)
        threshold = min(threshold, SHOOTING_SHARE * float(power.max()))
        chosen = np.flatnonzero(power >= threshold)
        light.shoot(chosen, light.unshot[chosen])
        return chosen

    return step


@solver(MOST_SINGLE_SHOTS)
def southwell(light: UnshotLight) -> Step:
    """Progressive refinement as first published: the patch with the most unshot power shoots alone.

    It is Southwell's relaxation (Gortler, Cohen and Slusallek 1994).
    """

    def step() -> Int64:
        chosen = light.power(light.unshot).argmax(keepdims=True)
        light.shoot(chosen, light.unshot[chosen])
        return chosen

    return step


@solver(MOST_SINGLE_SHOTS)
def overshooting(light: UnshotLight) -> Step:
    """One patch at a time shoots what it has and what it is likely to get (Feda and Purgathofer 1992).

    It adds its share of the ambient light, that is of all unshot light reflected for ever in a closed room of even
    brightness. It then has less than nothing left, and receives the rest in time.
    """

    def step() -> Int64:
        wanted = light.unshot + light.reflectance * light.ambient()
        chosen = light.power(wanted).argmax(keepdims=True)
        light.shoot(chosen, wanted[chosen])
        return chosen

    return step


@solver(MOST_SWEEPS)
def gauss_seidel(light: UnshotLight) -> Step:
    """Gauss-Seidel iteration, in its shooting form: in a step each patch shoots in turn, by its number.

    What a patch has received in this step it shoots too, which gathering row by row with the newest values does alike.
    """

    def step() -> Int64:
        for patch in range(len(light.unshot)):
            if light.unshot[patch].any():
                light.shoot(np.array([patch]), light.unshot[[patch]])
        return np.arange(len(light.unshot))

    return step


@solver(MOST_SWEEPS)
def jacobi(light: UnshotLight) -> Step:
    """Jacobi iteration: all patches shoot in every step, so that step k holds the first k bounces and no more."""

    def step() -> Int64:
        everyone = np.arange(len(light.unshot))
        light.shoot(everyone, light.unshot.copy())
        return everyone

    return step


@solver(MOST_SWEEPS)
def conjugate_gradient(light: UnshotLight) -> Step:
    """Conjugate gradients (Hestenes and Stiefel 1952), for rooms of high reflectance (Baranoski et al. 1995).

    A / rho - K is symmetric and positive definite: the equation times A / rho. Its diagonal as preconditioner turns the
    residual into the unshot light itself. Patches that reflect nothing shoot their exitance at first, and then rest.
    Where light passes sheets the equation is not symmetric, and least residuals are sought instead.
    """
    transport = light.transport
    if transport.crossing is not None:
        return least_residual(light)
    area = transport.area[:, None]
    weight = np.divide(area, light.reflectance, out=np.zeros_like(light.reflectance), where=light.reflectance > 0)
    direction = np.zeros_like(light.unshot)
    product = np.ones(light.unshot.shape[1])
    everyone = np.arange(len(light.unshot))
    begun = False

    def step() -> Int64:
        nonlocal direction, product, begun
        if not begun:
            begun = True
            light.shoot(everyone, light.unshot.copy())
            product = (weight * light.unshot**2).sum(0)
            direction = light.unshot.copy()
            return everyone
        received = transport.gather(direction)
        curvature = (direction * (weight * direction - received * (weight > 0))).sum(0)
        length = np.divide(product, curvature, out=np.zeros_like(product), where=curvature > 0)
        light.shoot(everyone, direction * length, received * length)
        before, product = product, (weight * light.unshot**2).sum(0)
        direction = light.unshot + direction * np.divide(product, before, out=np.zeros_like(before), where=before > 0)
        return everyone

    return step


def least_residual(light: UnshotLight) -> Step:
    """Orthomin(1) (Vinsome 1976; Eisenstat, Elman and Schultz 1983): each step makes the unshot light the least, by
    area, that its direction can, and the next direction leaves that as it is.

    It asks for no symmetry, but that what is reflected is less than what was sent.
    """
    area = light.transport.area[:, None]
    everyone = np.arange(len(light.unshot))

    def taken_by(direction: Float64, received: Float64) -> Float64:
        """What shooting a direction (N, C) that brings power `received` (N, C) takes from the unshot power."""
        return direction * area - light.bounced(received)

    def ratio(one: Float64, other: Float64) -> Float64:
        return np.divide(one, other, out=np.zeros_like(one), where=other > 0)

    direction = light.unshot.copy()
    received = light.transport.gather(direction)

    def step() -> Int64:
        nonlocal direction, received
        taken = taken_by(direction, received)
        square = (taken**2 / area).sum(0)
        length = ratio((light.unshot * taken).sum(0), square)
        light.shoot(everyone, direction * length, received * length)
        onwards = light.transport.gather(light.unshot)
        back = ratio((taken_by(light.unshot, onwards) * taken / area).sum(0), square)
        direction = light.unshot - direction * back
        received = onwards - received * back
        return everyone

    return step


@solver(MOST_REPEATS)
def dense(light: UnshotLight) -> Step:
    """Elimination on the full matrix I - rho F: one step, and a second that mends its rounding.

    Raises:
        SettingsError: there are too many patches
    """
    transport = light.transport
    if transport.count > MOST_DENSE:
        raise SettingsError(
            "Solver",
            f"a full matrix of {transport.count:,} patches is too large, it may have {MOST_DENSE:,}",
            "Choose another solver, or a lower quality",
        )

    def step() -> Int64:
        everyone = np.arange(transport.count)
        amount: Float64 = np.empty_like(light.unshot)
        for channel in range(3):
            columns = slice(channel, None, 3)
            exchange = transport.mixed(transport.dense(channel) / transport.area[:, None], channel)
            matrix = np.eye(transport.count) - light.reflectance[:, [channel]] * exchange
            amount[:, columns] = np.linalg.solve(matrix, light.unshot[:, columns])
        light.shoot(everyone, amount)
        return everyone

    return step


SOLVERS: dict[SolverName, Solver] = {
    "progressive": progressive,
    "southwell": southwell,
    "overshooting": overshooting,
    "gauss-seidel": gauss_seidel,
    "jacobi": jacobi,
    "conjugate-gradient": conjugate_gradient,
    "dense": dense,
}
"""By the names that a user gives."""
