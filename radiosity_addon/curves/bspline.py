# SPDX-License-Identifier: GPL-3.0-or-later
"""B-spline basis functions of any degree on any knot vector.

The functions are evaluated as a banded matrix: at every parameter `degree + 1` functions differ from zero, so that a
curve is one product of basis and control points, and a tensor-product surface two. Bezier curves are the case of one
span between clamped ends; splines of Bezier curves that of inner knots as often as the degree.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Float64, Int64


@dataclass(frozen=True, eq=False)
class Basis:
    """The functions N_i of one degree on a knot vector (Cox 1972, de Boor 1972).

    There are len(knots) - degree - 1 functions. A closed spline has fewer control points than that: function i
    belongs to control point i modulo `points`, so the first `degree` points come again after the last.

    Attributes:
        degree: 0 or more; the order is one more
        knots: (K,) float64, finite, never falling
        points: number of control points

    Raises:
        ValueError: the knots fall, are too few or span nothing
    """

    degree: int
    knots: Float64
    points: int

    def __post_init__(self) -> None:
        knots = np.ascontiguousarray(self.knots, np.float64)
        object.__setattr__(self, "knots", knots)
        if self.degree < 0 or self.points < 1:
            raise ValueError("a basis needs a degree of 0 or more, and a point")
        if len(knots) < self.degree + 1 + max(self.points, self.degree + 1):
            raise ValueError(f"{len(knots)} knots are too few for {self.points} points of degree {self.degree}")
        if not np.isfinite(knots).all() or (np.diff(knots) < 0).any():
            raise ValueError("knots must be finite and never fall")
        if not knots[self.functions] > knots[self.degree]:
            raise ValueError("the knots span nothing")

    @property
    def functions(self) -> int:
        """How many basis functions there are."""
        return len(self.knots) - self.degree - 1

    @property
    def domain(self) -> tuple[float, float]:
        """The parameters between which the functions sum to one."""
        return float(self.knots[self.degree]), float(self.knots[self.functions])

    @cached_property
    def breaks(self) -> Float64:
        """(B,) the distinct knots of the domain: between two of them the spline is one polynomial."""
        return np.unique(self.knots[self.degree : self.functions + 1])

    def continuity(self, parameter: float) -> int:
        """How often the functions can be differentiated at a parameter: degree less the knot's multiplicity there."""
        return self.degree - int(np.count_nonzero(self.knots == parameter))

    def spans(self, parameters: Float64, from_left: bool = False) -> Int64:
        """Index s (T,) of the span k_s <= t < k_{s+1} of each parameter (T,), or k_s < t <= k_{s+1} `from_left`.

        Parameters beyond the domain belong to its first or last span.
        """
        low, high = self.domain
        first = int(np.searchsorted(self.knots, low, "right")) - 1
        last = int(np.searchsorted(self.knots, high, "left")) - 1
        found = np.searchsorted(self.knots, parameters, "left" if from_left else "right") - 1
        return np.asarray(np.clip(found, first, last))

    def banded(self, parameters: Float64, derivative: int = 0, from_left: bool = False) -> tuple[Int64, Float64]:
        """Values of the functions that aren't zero, or of one of their derivatives.

        The recursion of Cox and de Boor for all parameters at once (Piegl and Tiller 1997, A2.2). Within a span that
        isn't empty no denominator vanishes, which is what the convention 0/0 = 0 says.

        Args:
            parameters: (T,) float64
            derivative: which one
            from_left: the limit from below at a knot, in place of that from above

        Returns:
            (T,) int64, the first function, and (degree + 1, T) float64, the values from that one on
        """
        t = np.asarray(parameters, np.float64)
        span = self.spans(t, from_left)
        if derivative > self.degree:
            return span - self.degree, np.zeros((self.degree + 1, len(t)))
        knots = self.knots
        values = [np.ones_like(t)]
        for degree in range(1, self.degree - derivative + 1):
            raised, carried = [], np.zeros_like(t)
            for r in range(degree):
                above, below = knots[span + r + 1], knots[span + 1 - degree + r]
                share = values[r] / (above - below)
                raised.append(carried + (above - t) * share)
                carried = (t - below) * share
            values = [*raised, carried]
        for degree in range(self.degree - derivative + 1, self.degree + 1):
            slopes = [degree * values[r] / (knots[span + r + 1] - knots[span + 1 - degree + r]) for r in range(degree)]
            zero = np.zeros_like(t)
            values = [a - b for a, b in zip([zero, *slopes], [*slopes, zero], strict=True)]
        return span - self.degree, np.stack(values)

    def matrix(self, parameters: Float64, derivative: int = 0, from_left: bool = False) -> Float64:
        """The same as a dense matrix (T, points) that takes control points to the curve's points."""
        first, values = self.banded(parameters, derivative, from_left)
        result = np.zeros((len(first), self.points))
        row = np.arange(len(first))
        for k, value in enumerate(values):
            result[row, (first + k) % self.points] += value
        return result

    def blend(self, control: Float64, parameters: Float64, derivative: int = 0, from_left: bool = False) -> Float64:
        """Combinations (..., T) of control values (..., points), along the last axis."""
        first, values = self.banded(parameters, derivative, from_left)
        result = np.take(control, first % self.points, axis=-1)
        result *= values[0]
        for k in range(1, len(values)):
            part = np.take(control, (first + k) % self.points, axis=-1)
            part *= values[k]
            result += part
        return result


def uniform_knots(points: int, degree: int) -> Float64:
    """The knots 0, 1, 2 and so on of an open spline that floats free of its end points."""
    return np.arange(points + degree + 1, dtype=np.float64)


def clamped_knots(points: int, degree: int) -> Float64:
    """Uniform knots with ends repeated, so that the spline starts and ends at its end points."""
    inner = np.arange(1, points - degree, dtype=np.float64)
    return np.concatenate([np.zeros(degree + 1), inner, np.full(degree + 1, max(points - degree, 1.0))])


def periodic_basis(points: int, degree: int) -> Basis:
    """The basis of a closed uniform spline."""
    return Basis(degree, np.arange(points + 2 * degree + 1, dtype=np.float64), points)


def with_knot(basis: Basis, control: Float64, knot: float, times: int = 1) -> tuple[Basis, Float64]:
    """The same spline with a knot more (Boehm 1980).

    Args:
        control: (..., points) of an open spline, or (..., functions) of a closed one that was opened by `opened`
        knot: within the domain
        times: how often; a knot is never repeated more often than the degree

    Returns:
        the basis and its control values (..., points + times)
    """
    for _ in range(min(times, basis.degree - int(np.count_nonzero(basis.knots == knot)))):
        knots, degree = basis.knots, basis.degree
        span = int(basis.spans(np.array([knot]))[0])
        index = np.arange(basis.points + 1)
        low = np.clip(index, 0, basis.points - 1)
        width = knots[np.minimum(low + degree, len(knots) - 1)] - knots[low]
        share = np.clip((knot - knots[low]) / np.where(width > 0, width, 1.0), 0.0, 1.0)
        share = np.where(index <= span - degree, 1.0, np.where(index > span, 0.0, share))
        control = share * control[..., low] + (1 - share) * control[..., np.maximum(index - 1, 0)]
        basis = Basis(degree, np.insert(knots, span + 1, knot), basis.points + 1)
    return basis, control


def opened(basis: Basis, control: Float64) -> tuple[Basis, Float64]:
    """A closed spline as an open one, whose last control values repeat the first."""
    control = np.take(control, np.arange(basis.functions) % basis.points, axis=-1)
    return Basis(basis.degree, basis.knots, basis.functions), control


def bezier_pieces(basis: Basis, control: Float64) -> Float64:
    """Control values (B - 1, ..., degree + 1) of the Bezier curve of each span between breaks.

    Every break becomes a knot as often as the degree, the ends too; then each span has control points of its own.
    """
    breaks, degree = basis.breaks, basis.degree
    basis, control = opened(basis, control)
    for knot in breaks:
        basis, control = with_knot(basis, control, float(knot), degree)
    first, _ = basis.banded(breaks[:-1])
    return np.stack([control[..., start : start + degree + 1] for start in first])
