# SPDX-License-Identifier: GPL-3.0-or-later
"""Work in chunks: in order, bounded, cancelled when closed."""

import threading
import time

import pytest

from radiosity_addon.chunks import LONGEST_WAIT, finish, in_chunks, scaled, side_by_side, while_aside


def shares(steps):
    """Shares that a generator yields, and its result."""
    seen = []
    while True:
        try:
            seen.append(next(steps))
        except StopIteration as stop:
            return seen, stop.value


def spans(start, stop):
    return start, stop


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_chunks_cover_the_work_in_order_whatever_the_threads(workers):
    assert finish(in_chunks(spans, 10, 4, workers)) == [(0, 4), (4, 8), (8, 10)]


@pytest.mark.parametrize("workers", [1, 3])
def test_results_come_in_order_even_if_later_chunks_end_first(workers):
    def work(start, stop):
        time.sleep(0.02 if start == 0 else 0)
        return start

    assert finish(in_chunks(work, 6, 1, workers)) == list(range(6))


@pytest.mark.parametrize("workers", [1, 2])
def test_the_share_rises_to_one(workers):
    seen, _ = shares(in_chunks(spans, 7, 2, workers))
    assert seen == sorted(seen)
    assert seen[-1] == 1


@pytest.mark.parametrize("workers", [1, 2])
def test_no_work_gives_no_results(workers):
    assert shares(in_chunks(spans, 0, 4, workers)) == ([], [])


def test_closing_cancels_what_has_not_started():
    ran = []
    gate = threading.Event()

    def work(start, stop):
        ran.append(start)
        gate.wait(5)

    steps = in_chunks(work, 100, 1, 2)
    next(steps)
    threading.Timer(0.05, gate.set).start()
    steps.close()
    assert sorted(ran) == [0, 1]


def test_no_more_than_one_chunk_a_worker_is_in_flight():
    lock = threading.Lock()
    now, most = 0, 0

    def work(start, stop):
        nonlocal now, most
        with lock:
            now += 1
            most = max(most, now)
        time.sleep(0.001)
        with lock:
            now -= 1

    finish(in_chunks(work, 50, 1, 2))
    assert most == 2


def test_a_long_chunk_keeps_no_other_thread_waiting():
    others = threading.Event()
    count = 50

    def work(start, stop):
        if start == 0:
            return others.wait(5)
        if start == count - 1:
            others.set()
        return True

    assert finish(in_chunks(work, count, 1, 2))[0]


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_in_a_chunk_reaches_the_caller(workers):
    def work(start, stop):
        if start == 3:
            raise RuntimeError("third")

    with pytest.raises(RuntimeError, match="third"):
        finish(in_chunks(work, 9, 1, workers))


def test_whoever_takes_the_steps_has_a_turn_while_a_chunk_takes_long():
    gate = threading.Event()

    def work(start, stop):
        assert gate.wait(5)
        return start

    steps = in_chunks(work, 2, 1, 2)
    begin = time.perf_counter()
    assert next(steps) == 0
    assert time.perf_counter() - begin < 10 * LONGEST_WAIT
    gate.set()
    assert finish(steps) == [0, 1]


def halves(number):
    yield 0.5
    return number


@pytest.mark.parametrize("workers", [1, 2])
def test_steps_are_taken_side_by_side_and_their_results_come_in_order(workers):
    seen, results = shares(side_by_side(halves, 5, workers))
    assert results == [0, 1, 2, 3, 4]
    assert seen == sorted(seen)
    assert 0 < seen[-1] <= 1


def test_closing_ends_what_goes_on_side_by_side_after_the_steps_that_it_is_in():
    closed = []

    def endless(number):
        try:
            while True:
                time.sleep(0.01)
                yield 0.0
        finally:
            closed.append(number)

    steps = side_by_side(endless, 5, 2)
    next(steps)
    begin = time.perf_counter()
    steps.close()
    assert time.perf_counter() - begin < 1
    assert sorted(closed) == [0, 1]


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_in_what_goes_on_side_by_side_reaches_the_caller(workers):
    def failing(number):
        yield 0.5
        if number == 3:
            raise RuntimeError("third")

    with pytest.raises(RuntimeError, match="third"):
        finish(side_by_side(failing, 5, workers))


def test_scaled_maps_shares_and_hands_the_result_on():
    seen, result = shares(scaled(in_chunks(spans, 4, 2, 1), 0.2, 0.6))
    assert seen == pytest.approx([0.4, 0.6])
    assert result == [(0, 2), (2, 4)]


def test_closing_scaled_closes_what_is_inside():
    closed = []

    def steps():
        try:
            yield 0.5
            yield 1.0
        finally:
            closed.append(True)

    outer = scaled(steps(), 0, 1)
    next(outer)
    outer.close()
    assert closed == [True]


def slowly(count, seen, raises=None):
    for step in range(count):
        seen.append(step)
        time.sleep(0.01)
        yield
    if raises is not None:
        raise raises
    return "done"


def test_work_is_done_aside_while_steps_are_taken():
    seen = []
    steps, result = shares(while_aside(iter_steps(), slowly(3, seen)))
    assert steps == [0.5, 1.0]
    assert result == ("stepped", "done")
    assert seen == [0, 1, 2]


def iter_steps():
    yield 0.5
    yield 1.0
    return "stepped"


def test_what_is_raised_aside_is_raised_in_the_end():
    with pytest.raises(ZeroDivisionError):
        finish(while_aside(iter_steps(), slowly(1, [], raises=ZeroDivisionError())))


def test_closing_ends_what_is_done_aside():
    seen = []
    work = slowly(1000, seen)
    steps = while_aside(iter_steps(), work)
    next(steps)
    steps.close()
    assert len(seen) < 1000
    assert work.gi_frame is None, "it was closed"
