# SPDX-License-Identifier: GPL-3.0-or-later
"""Work cut into chunks of fixed size and run on a pool of threads.

The chunks depend on the amount of work alone, never on the number of threads, and results come back in
order, so that a bake's result does not depend on the machine's load. The kernels release the GIL.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")

Fractions = Generator[float, None, T]
"""Yields the share done, 0..1; returns a result."""


def in_chunks(work: Callable[[int, int], T], count: int, chunk: int, workers: int) -> Fractions[list[T]]:
    """Run work(start, stop) over 0..count and yield the share done after each chunk.

    Closing the generator cancels what has not started and waits for what has. At most two chunks a
    worker are in flight, so memory is bounded by the chunk, not by the count.
    """
    spans = [(start, min(start + chunk, count)) for start in range(0, count, chunk)]
    results: list[T] = []
    if workers == 1 or len(spans) <= 1:
        for start, stop in spans:
            results.append(work(start, stop))
            yield stop / count
        return results
    pending: deque[Future[T]] = deque()
    waiting = deque(spans)
    pool = ThreadPoolExecutor(workers, thread_name_prefix="radiosity")
    try:
        while waiting or pending:
            while waiting and len(pending) < 2 * workers:
                pending.append(pool.submit(work, *waiting.popleft()))
            results.append(pending.popleft().result())
            yield len(results) / len(spans)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    return results


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
