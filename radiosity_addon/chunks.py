# SPDX-License-Identifier: GPL-3.0-or-later
"""Work cut into chunks of fixed size and run on a pool of threads, and work that a thread does aside.

The chunks depend on the amount of work alone, never on the number of threads, and results come back in
order, so that a bake's result does not depend on the machine's load. The kernels release the GIL.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import FIRST_EXCEPTION, CancelledError, Future, ThreadPoolExecutor, wait
from typing import Generic, TypeVar

S = TypeVar("S")
T = TypeVar("T")
U = TypeVar("U")

Fractions = Generator[float, None, T]
"""Yields the share done, 0..1; returns a result."""

LONGEST_WAIT = 0.02
"""Seconds that threads are waited for before the share done is yielded again, for whoever may cancel."""


def in_chunks(work: Callable[[int, int], T], count: int, chunk: int, workers: int) -> Fractions[list[T]]:
    """Run work(start, stop) over 0..count and yield the share done from time to time.

    A thread that is through with a chunk takes the next one by itself, so that none waits for another. Closing the
    generator cancels what has not started and waits for what has. One chunk a worker is in flight, so memory is
    bounded by the chunk, not by the count.
    """
    spans = [(start, min(start + chunk, count)) for start in range(0, count, chunk)]
    if workers == 1 or len(spans) <= 1:
        done: list[T] = []
        for start, stop in spans:
            done.append(work(start, stop))
            yield stop / count
        return done
    results: dict[int, T] = {}
    waiting = deque(enumerate(spans))

    def labour() -> None:
        while True:
            try:
                number, span = waiting.popleft()
            except IndexError:
                return
            results[number] = work(*span)

    pool = ThreadPoolExecutor(workers, thread_name_prefix="radiosity")
    try:
        busy = {pool.submit(labour) for _ in range(min(workers, len(spans)))}
        while busy:
            ended, busy = wait(busy, LONGEST_WAIT, FIRST_EXCEPTION)
            for each in ended:
                each.result()
            yield len(results) / len(spans)
    finally:
        waiting.clear()
        pool.shutdown(wait=True)
    return [results[number] for number in range(len(spans))]


def side_by_side(work: Callable[[int], Fractions[T]], count: int, workers: int) -> Fractions[list[T]]:
    """Take the steps of work(0), work(1), ... with a thread for each, and yield the share done.

    Closing the generator closes those that are under way after the steps that they are in.
    """
    if workers == 1:
        found = []
        for number in range(count):
            found.append((yield from scaled(work(number), number / count, (number + 1) / count)))
        return found
    stopped = threading.Event()

    def whole(number: int, _: int) -> T:
        steps = work(number)
        try:
            while not stopped.is_set():
                next(steps)
        except StopIteration as stop:
            result: T = stop.value
            return result
        finally:
            steps.close()
        raise CancelledError

    running = in_chunks(whole, count, 1, workers)
    try:
        while True:
            try:
                share = next(running)
            except StopIteration as stop:
                results: list[T] = stop.value
                return results
            yield share
    finally:
        stopped.set()
        running.close()


def finish(steps: Generator[object, None, T]) -> T:
    """Run a generator to its end and return its result."""
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            result: T = stop.value
            return result


def scaled(steps: Generator[float, None, T], low: float, high: float) -> Generator[float, None, T]:
    """The same steps, their shares mapped to low..high."""
    try:
        while True:
            try:
                share = next(steps)
            except StopIteration as stop:
                result: T = stop.value
                return result
            yield low + (high - low) * share
    finally:
        steps.close()


class Aside(Generic[S, T]):
    """A generator that a thread of its own runs to its end.

    Attributes:
        latest: what it yielded last, None before
        outcome: its result, or what it raised
    """

    def __init__(self, steps: Generator[S, None, T]) -> None:
        self.latest: S | None = None
        self.outcome: Future[T] = Future()
        self._steps = steps
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="radiosity aside")
        self._thread.start()

    def _run(self) -> None:
        try:
            while not self._stopped.is_set():
                self.latest = next(self._steps)
        except StopIteration as stop:
            self.outcome.set_result(stop.value)
        except BaseException as failure:  # noqa: BLE001 it is raised where the outcome is asked for
            self.outcome.set_exception(failure)
        finally:
            self._steps.close()

    def stop(self, seconds: float | None = None) -> None:
        """Close the generator after the step that it is in, and wait for that, but no longer than some seconds."""
        self._stopped.set()
        self._thread.join(seconds)


def while_aside(steps: Generator[S, None, T], work: Generator[object, None, U]) -> Generator[S, None, tuple[T, U]]:
    """The same steps, while a thread does other work; the results of both."""
    aside = Aside(work)
    try:
        result = yield from steps
        return result, aside.outcome.result()
    finally:
        steps.close()
        aside.stop()
