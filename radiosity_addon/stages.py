# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a bake is, and what its stages took."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping
from dataclasses import dataclass
from typing import TypeVar

from .geometry.visibility import Tally, Visibility
from .viewing import Satisfied, Viewer

T = TypeVar("T")

STAGES = {
    "Unwrap": 0.09,
    "Transparency": 0.01,
    "Texels": 0.06,
    "Materials": 0.01,
    "Direct light": 0.2,
    "Transport": 0.08,
    "Radiosity": 0.02,
    "Gather": 0.48,
    "Check": 0.03,
    "Pages": 0.02,
}
"""Stages and their usual shares of the time."""

LEAST_SHARE = 0.002
"""Of the time, for a stage that took none before."""

TELLING = 0.05
"""A stage that is this far on tells by itself how long it takes."""

AFTER_THE_LIGHT = ("Check", "Pages", "Write files", "Write back")
"""Stages of a whole bake in which nothing is left to be spared."""


@dataclass(frozen=True)
class Progress:
    """How far a bake is.

    Attributes:
        stage: what is being done
        fraction: of the whole bake, 0..1, an estimate
        residual: unshot share of the emitted power, once known; 1 before
        rays: traced so far
        left: seconds until the end, an estimate; None where there is none
    """

    stage: str
    fraction: float
    residual: float = 1.0
    rays: int = 0
    left: float | None = None


NO_RAYS = Tally()


@dataclass(frozen=True)
class Stage:
    """A finished stage.

    Attributes:
        seconds: it took
        rays: it traced
        processor: seconds of all threads together
        tally: of these, what passed in Embree
    """

    name: str
    seconds: float
    rays: int
    processor: float = 0.0
    tally: Tally = NO_RAYS

    def __add__(self, more: Stage) -> Stage:
        return Stage(
            self.name,
            self.seconds + more.seconds,
            self.rays + more.rays,
            self.processor + more.processor,
            self.tally + more.tally,
        )


def shares_of(seconds: Mapping[str, float]) -> dict[str, float]:
    """What share of the time each stage will take, if as much as it took before."""
    total = max(sum(seconds.get(name, 0.0) for name in STAGES), 1e-9)
    found = {name: max(seconds.get(name, 0.0) / total, LEAST_SHARE) for name in STAGES}
    return {name: share / sum(found.values()) for name, share in found.items()}


class StageLog:
    """Where a bake is, and what its stages took.

    Attributes:
        viewer: who may end a stage once there is something to show; None: nobody
    """

    def __init__(self, shares: Mapping[str, float] = STAGES) -> None:
        """Args:
        shares: of the time, that stages are expected to take
        """
        self.shares = shares
        self.stages: list[Stage] = []
        self.viewer: Viewer | None = None
        self.visibility: Visibility | None = None
        self.residual = 1.0
        self._before = 0.0
        self._start, self._processor = time.perf_counter(), time.process_time()
        self._rays, self._tally = 0, NO_RAYS

    @property
    def rays(self) -> int:
        return self.visibility.traced if self.visibility else 0

    def stage(self, name: str, steps: Generator[float, None, T]) -> Generator[Progress, None, T]:
        """Run a stage; its time is all that passed since the last one ended. One that comes again adds to the first.

        Raises:
            Satisfied: the viewer is
        """
        before = next((stage for stage in self.stages if stage.name == name), None)
        share, done = 0.0 if before else self.shares[name], 0.0
        try:
            yield Progress(name, self._before, self.residual, self.rays, self._left(share, 0.0))
            while True:
                try:
                    done = max(done, next(steps))
                except StopIteration as stop:
                    result: T = stop.value
                    break
                fraction, left = self._before + share * min(done, 1.0), self._left(share, min(done, 1.0))
                yield Progress(name, fraction, self.residual, self.rays, left)
                if self.viewer is not None and self.viewer.satisfied:
                    raise Satisfied(name)
        finally:
            steps.close()
        self._before += share
        now, processor = time.perf_counter(), time.process_time()
        tally = self.visibility.tally if self.visibility else NO_RAYS
        found = Stage(name, now - self._start, self.rays - self._rays, processor - self._processor, tally - self._tally)
        if before:
            self.stages.remove(before)
            found = before + found
        self.stages.append(found)
        self._start, self._processor, self._rays, self._tally = now, processor, self.rays, tally
        return result

    def _left(self, share: float, done: float) -> float | None:
        """Seconds until the end: a stage that is under way tells by itself how long it takes, not how long others do.

        Args:
            share: expected of the stage that is under way
            done: share of it that is done
        """
        inside, over = time.perf_counter() - self._start, sum(stage.seconds for stage in self.stages)
        reached = self._before + share * done
        if reached <= 0:
            return None
        usual = (over + inside) / reached
        whole = inside / done if done > TELLING else max(usual * share, inside)
        pace = over / self._before if self._before > TELLING else usual
        return whole - inside + pace * max(1 - self._before - share, 0.0)
