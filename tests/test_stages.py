# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a bake is and what is left of it, told on a clock that only the test moves."""

from __future__ import annotations

from collections.abc import Generator

import pytest

from radiosity_addon import stages
from radiosity_addon.stages import STAGES, Progress, StageLog, shares_of

SECONDS = {name: 100 * share for name, share in STAGES.items()} | {"Direct light": 100.0}
"""What stages take where there are many lamps: direct light five times as long as usual, all others as usual."""
STEPS = 10


class Clock:
    """Time stands still until it is moved."""

    def __init__(self) -> None:
        self.now = 1000.0

    def perf_counter(self) -> float:
        return self.now

    def process_time(self) -> float:
        return self.now


def told(monkeypatch: pytest.MonkeyPatch, shares: dict[str, float]) -> list[tuple[Progress, float]]:
    """Everything that a bake says, each with the seconds that are truly left."""
    clock = Clock()
    monkeypatch.setattr(stages, "time", clock)
    log, end = StageLog(shares), clock.now + sum(SECONDS.values())

    def steps(seconds: float) -> Generator[float, None, None]:
        for step in range(1, STEPS + 1):
            clock.now += seconds / STEPS
            yield step / STEPS

    return [
        (progress, end - clock.now) for name, seconds in SECONDS.items() for progress in log.stage(name, steps(seconds))
    ]


def test_a_stage_that_takes_far_longer_than_usual_tells_so_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    under_way = [(said.left, left) for said, left in told(monkeypatch, STAGES) if said.stage == "Direct light"][1:]
    assert len(under_way) == STEPS
    assert [said for said, _ in under_way] == pytest.approx([left for _, left in under_way], rel=1e-6)


def test_shares_of_the_last_bake_tell_what_is_left_of_the_next_one(monkeypatch: pytest.MonkeyPatch) -> None:
    known = [(said.left, left) for said, left in told(monkeypatch, shares_of(SECONDS)) if said.left is not None]
    assert len(known) > STEPS * (len(STAGES) - 1)
    assert [said for said, _ in known] == pytest.approx([left for _, left in known], rel=0.02, abs=0.5)


def test_shares_add_up_to_one_and_leave_no_stage_without_any() -> None:
    for seconds in ({}, {"Gather": 3.0, "Read scene": 9.0}):
        shares = shares_of(seconds)
        assert list(shares) == list(STAGES)
        assert sum(shares.values()) == pytest.approx(1)
        assert min(shares.values()) > 0
