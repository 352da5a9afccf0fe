# SPDX-License-Identifier: GPL-3.0-or-later
"""A bake's arithmetic in a thread of its own, so that the window stays alive however long a step takes.

Only the main thread may touch bpy: what the other one asks of Blender, it asks of the main thread, and waits.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import CancelledError, Future
from queue import SimpleQueue
from typing import ParamSpec, TypeVar

from ..chunks import Aside
from ..stages import Progress

P = ParamSpec("P")
T = TypeVar("T")

LONGEST_WAIT = 0.2
"""Seconds that a cancelled bake is waited for: it ends after the step that it is in, and cleans up by itself."""


class MainThread:
    """Errands that another thread has the main one run."""

    def __init__(self) -> None:
        self._errands: SimpleQueue[Generator[object, None, None]] = SimpleQueue()
        self._current: Generator[object, None, None] | None = None
        self._waiting: list[Future[None]] = []
        self._closed = False

    def runs(self, work: Callable[P, Generator[object, None, T]]) -> Callable[P, T]:
        """`work` for the other thread to call: the main one runs its steps, while the caller waits for the result."""

        def errand(*args: P.args, **kwargs: P.kwargs) -> T:
            found: list[T] = []
            done: Future[None] = Future()

            def run() -> Generator[object, None, None]:
                try:
                    found.append((yield from work(*args, **kwargs)))
                    done.set_result(None)
                except GeneratorExit:
                    raise
                except BaseException as failure:  # noqa: BLE001 it is raised where it was asked for
                    done.set_exception(failure)

            self._waiting.append(done)
            self._errands.put(run())
            if self._closed:
                raise CancelledError
            done.result()
            return found[0]

        return errand

    @property
    def busy(self) -> bool:
        """An errand is being run."""
        return self._current is not None

    def run_errand(self) -> None:
        """Take a step of what was asked for first, if anything was; called in the main thread."""
        if self._current is None and not self._errands.empty():
            self._current = self._errands.get()
        if self._current is not None and next(self._current, self) is self:
            self._current = None

    def close(self) -> None:
        """Turn away whoever waits, and whoever will ask; called in the main thread."""
        self._closed = True
        if self._current is not None:
            self._current.close()
        for done in self._waiting:
            done.cancel()


def take_turn(
    steps: Iterator[Progress], latest: Progress, seconds: float, clock: Callable[[], float] = time.perf_counter
) -> Progress:
    """Take steps until nothing is new, because another thread is at work, or until the time is up; the latest progress.

    The last step ends when it ends: a turn is longer than its time by as much.
    """
    end, before = clock() + seconds, None
    while latest is not before and clock() < end:
        before, latest = latest, next(steps)
    return latest


def in_thread(
    steps: Generator[Progress, None, T],
    first: Progress,
    main: MainThread | None = None,
    wait: float | None = LONGEST_WAIT,
) -> Generator[Progress, None, T]:
    """The same steps, run in a thread of their own. Never waits: yields the latest progress, the same one if it is.

    Args:
        first: what is yielded before there is any progress
        main: what the steps ask of the main thread, which is the one that calls this generator
        wait: seconds that a cancelled bake is waited for; None: to the end of the step that it is in
    """
    aside = Aside(steps)
    try:
        while not aside.outcome.done():
            if main is not None:
                main.run_errand()
            yield aside.latest or first
        return aside.outcome.result()
    finally:
        if main is not None:
            main.close()
        aside.stop(wait)
