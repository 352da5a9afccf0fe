# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps in a thread of their own, and what they ask of the main thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Generator

import pytest

from radiosity_addon.blender.background import MainThread, in_thread, take_turn
from radiosity_addon.chunks import finish
from radiosity_addon.stages import Progress

FIRST = Progress("First", 0.0)


def named() -> str:
    return threading.current_thread().name


def asked() -> Generator[None, None, str]:
    yield
    return named()


def test_steps_run_aside_and_their_errands_in_the_main_thread() -> None:
    main = MainThread()
    ask = main.runs(asked)

    def steps() -> Generator[Progress, None, tuple[str, str]]:
        yield FIRST
        return named(), ask()

    aside, errand = finish(in_thread(steps(), FIRST, main))
    assert errand == named()
    assert aside != errand


def test_no_turn_waits_for_a_long_step() -> None:
    looked = threading.Event()

    def steps() -> Generator[Progress, None, None]:
        assert looked.wait(5), "a turn waited for this step"
        yield FIRST

    turns = in_thread(steps(), FIRST)
    assert next(turns) is FIRST
    assert next(turns) is FIRST, "the same again: nothing is new"
    looked.set()
    finish(turns)


@pytest.mark.parametrize("where", ["aside", "in an errand"])
def test_what_is_raised_reaches_whoever_takes_the_turns(where: str) -> None:
    main = MainThread()

    def fail() -> Generator[None, None, None]:
        yield
        raise ZeroDivisionError

    def steps() -> Generator[Progress, None, None]:
        yield FIRST
        finish(fail()) if where == "aside" else main.runs(fail)()

    with pytest.raises(ZeroDivisionError):
        finish(in_thread(steps(), FIRST, main))


def test_an_errand_that_is_cancelled_in_the_middle_cleans_up() -> None:
    main, cleaned = MainThread(), []

    def errand() -> Generator[None, None, None]:
        try:
            while True:
                yield
        finally:
            cleaned.append(named())

    def steps() -> Generator[Progress, None, None]:
        yield FIRST
        main.runs(errand)()

    turns = in_thread(steps(), FIRST, main)
    while not main.busy:
        next(turns)
    turns.close()
    assert cleaned == [named()]


def test_closing_ends_steps_that_wait_for_an_errand() -> None:
    main, asked, closed = MainThread(), threading.Event(), threading.Event()

    def steps() -> Generator[Progress, None, None]:
        try:
            asked.set()
            main.runs(asked)()
            yield FIRST
        finally:
            closed.set()

    turns = in_thread(steps(), FIRST, main, wait=None)
    main.run_errand = lambda: None  # type: ignore[method-assign]
    next(turns)
    assert asked.wait(1)
    turns.close()
    assert closed.is_set()


def test_closing_does_not_wait_long_for_a_step() -> None:
    going = threading.Event()

    def steps() -> Generator[Progress, None, None]:
        going.wait(5)
        yield FIRST

    turns = in_thread(steps(), FIRST, wait=0.05)
    next(turns)
    begin = time.perf_counter()
    turns.close()
    assert time.perf_counter() - begin < 1
    going.set()


# turns


def steps_of(seconds: float, passed: list[float]) -> Generator[Progress, None, None]:
    """Endless steps, each of which takes so long by a clock of our own."""
    while True:
        passed[0] += seconds
        yield Progress("Read scene", 0.0)


@pytest.mark.parametrize("seconds, taken", [(0.01, 6), (0.025, 3), (0.5, 1)])
def test_a_turn_ends_with_the_step_in_which_its_time_is_up(seconds: float, taken: int) -> None:
    passed = [0.0]
    take_turn(steps_of(seconds, passed), FIRST, 0.06 - 1e-9, lambda: passed[0])
    assert passed[0] == pytest.approx(taken * seconds)


def test_a_turn_ends_when_nothing_is_new() -> None:
    """The other thread is at work, and the window may have all the time."""
    steps = iter([other := Progress("Unwrap", 0.1), other, Progress("Texels", 0.2)])
    assert take_turn(steps, FIRST, 1.0, lambda: 0.0) is other
    assert next(steps).stage == "Texels"
