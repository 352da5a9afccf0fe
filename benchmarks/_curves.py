# SPDX-License-Identifier: GPL-3.0-or-later
"""Curves of error and of time: what noise and bias they hold, where they reach a level, how fast they grow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LAST = 3
"""Measurements with the most samples, which are extrapolated."""
SEEN = 0.5
"""Share of the last squared error that a floor must make up to be believed."""


@dataclass(frozen=True)
class NoiseFit:
    """error^2 = noise^2 / samples + floor^2.

    Attributes:
        noise: error of one sample
        floor: error that no number of samples takes away: the reading's, the reference's own noise
    """

    noise: float
    floor: float

    def error(self, samples: float) -> float:
        """What so many samples leave."""
        return math.sqrt(self.noise**2 / samples + self.floor**2)

    def samples(self, error: float) -> float | None:
        """How many reach an error; None where the floor lies above it."""
        return self.noise**2 / (error**2 - self.floor**2) if error > self.floor else None


def fit_noise(samples: Sequence[float], errors: Sequence[float]) -> NoiseFit:
    """Least squares of the squared errors, each over its own size, neither part below zero."""
    variance = np.square(np.asarray(errors, float))
    parts = np.stack([1 / np.asarray(samples, float), np.ones(len(variance))], axis=1) / variance[:, None]
    # A floor below zero, or a noise: the best fit then lies on that edge of what is allowed.
    choices = [np.linalg.lstsq(parts, np.ones(len(variance)), rcond=None)[0]] if len(variance) > 1 else []
    for kept in (0, 1):
        alone = np.zeros(2)
        alone[kept] = parts[:, kept].sum() / (parts[:, kept] ** 2).sum()
        choices.append(alone)
    allowed = [choice for choice in choices if choice.min() >= 0]
    best = min(allowed, key=lambda choice: float(np.square(parts @ choice - 1).sum()))
    return NoiseFit(math.sqrt(best[0]), math.sqrt(best[1]))


def noise_to_extrapolate(samples: Sequence[float], errors: Sequence[float]) -> NoiseFit:
    """What error to expect beyond the last measurement.

    A floor is believed only where it makes up most of the last error already, and not of a few measurements: elsewhere
    a fit finds one by chance.
    Without one, errors fall by samples^-1/2 from the last few on.
    """
    fit = fit_noise(samples, errors)
    if len(samples) > LAST + 1 and fit.floor**2 > SEEN * errors[-1] ** 2:
        return fit
    variance = np.square(np.asarray(errors[-LAST:], float)) * np.asarray(samples[-LAST:], float)
    return NoiseFit(math.sqrt(variance.mean()), 0.0)


@dataclass(frozen=True)
class Cost:
    """seconds = start + each * samples."""

    start: float
    each: float

    def seconds(self, samples: float) -> float:
        """What so many samples take."""
        return self.start + self.each * samples


def fit_cost(samples: Sequence[float], seconds: Sequence[float]) -> Cost:
    """The line through the first measurement and the last one, which is the most exact: it takes longest."""
    if len(samples) < 2 or samples[-1] == samples[0]:
        return Cost(0.0, seconds[-1] / samples[-1])
    each = max((seconds[-1] - seconds[0]) / (samples[-1] - samples[0]), 0.0)
    return Cost(max(seconds[0] - each * samples[0], 0.0), each)


def crossing(seconds: Sequence[float], errors: Sequence[float], level: float) -> float | None:
    """The least time at which a measured curve reaches an error; between two points straight in logarithms.

    Returns:
        None if no point does; the first point's time if that does already
    """
    order = np.argsort(seconds, kind="stable")
    times, found = np.asarray(seconds, float)[order], np.asarray(errors, float)[order]
    there = np.flatnonzero(found <= level)
    if not len(there):
        return None
    first = int(there[0])
    if first == 0:
        return float(times[0])
    logs = np.log(found[first - 1 : first + 1])
    share = (logs[0] - math.log(level)) / (logs[0] - logs[1])
    return float(times[first - 1] * (times[first] / times[first - 1]) ** share)


def first_reaching(seconds: Sequence[float], errors: Sequence[float], level: float) -> float | None:
    """The least time of a measured point that reaches an error: for what has no points in between."""
    reached = [time for time, error in zip(seconds, errors, strict=True) if error <= level]
    return min(reached, default=None)


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """How steeply time grows: p of seconds ~ sizes^p, by least squares of the logarithms."""
    across, up = np.log(np.asarray(sizes, float)), np.log(np.asarray(seconds, float))
    across = across - across.mean()
    return float((across * (up - up.mean())).sum() / (across**2).sum())
