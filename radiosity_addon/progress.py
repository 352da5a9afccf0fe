# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress of a bake as a person at a terminal, or a log file, wants to read it."""

from __future__ import annotations

import shutil
import time
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from .stages import Progress

BAR_WIDTH = 24
REDRAW_SECONDS = 0.1
ESTIMATE_SECONDS = 1.0
ESTIMATE_SHARE = 0.05
"""A remaining time is not guessed before a bake has run this long and come this far."""
LINE_SECONDS = 10.0
"""Where there is no terminal, a long stage says this often how far it is."""


class Meter:
    """Shows progress: one line redrawn in place on a terminal, plain lines elsewhere, nothing if quiet."""

    def __init__(self, stream: TextIO, quiet: bool = False) -> None:
        self._stream = stream
        self._quiet = quiet
        self._terminal = stream.isatty()
        self._start = self._drawn = time.perf_counter()
        self._stage = ""
        self._width = 0

    def show(self, progress: Progress) -> None:
        """Draw the state of the bake, not more often than an eye can follow."""
        now = time.perf_counter()
        wait = REDRAW_SECONDS if self._terminal else LINE_SECONDS
        if self._quiet or (progress.stage == self._stage and now - self._drawn < wait):
            return
        self._drawn, self._stage = now, progress.stage
        text = describe(progress, now - self._start)
        if self._terminal:
            filled = round(BAR_WIDTH * min(max(progress.fraction, 0.0), 1.0))
            self._redraw(f"[{'#' * filled}{'-' * (BAR_WIDTH - filled)}] {text}")
        else:
            self._stream.write(f"{text}\n")
            self._stream.flush()

    def say(self, line: str) -> None:
        """Print one line that stays."""
        if not self._quiet:
            self.clear()
            self._stream.write(f"{line}\n")
            self._stream.flush()

    def clear(self) -> None:
        """Take the bar off the terminal."""
        if self._width:
            self._redraw("")
            self._stream.write("\r")
            self._stream.flush()
            self._width = 0

    def _redraw(self, line: str) -> None:
        line = line[: shutil.get_terminal_size().columns - 1]
        self._stream.write(f"\r{line:<{self._width}}")
        self._stream.flush()
        self._width = len(line)


def describe(progress: Progress, seconds: float, brief: bool = False) -> str:
    """Stage, share, residual, rays per second and time left, as far as they are known after some seconds.

    In `brief`, for a narrow place, without the two in the middle.
    """
    parts = [f"{progress.fraction:4.0%} {progress.stage}"]
    if 0 < progress.residual < 1 and not brief:
        parts.append(f"residual {progress.residual:.2g}")
    if progress.rays and seconds > 0 and not brief:
        parts.append(f"{short_count(progress.rays / seconds)} rays/s")
    if ESTIMATE_SHARE < progress.fraction < 1 and seconds > ESTIMATE_SECONDS:
        left = seconds * (1 / progress.fraction - 1) if progress.left is None else progress.left
        parts.append(f"{duration(left)} left")
    return ", ".join(parts)


def short_count(number: float) -> str:
    """A large count in few characters: 950, 12.5k, 3.2M."""
    for unit, size in (("G", 1e9), ("M", 1e6), ("k", 1e3)):
        if number >= size:
            return f"{number / size:.1f}{unit}"
    return f"{number:.0f}"


def duration(seconds: float) -> str:
    """Seconds as 0:07, 12:30 or 1:02:03."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
