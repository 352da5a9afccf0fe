# SPDX-License-Identifier: GPL-3.0-or-later
"""Work for Cycles: done in this process, or by a second Blender where a window is to stay alive meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Protocol, TypeVar

from ...chunks import finish
from .second_blender import Failed, SecondBlender
from .subject import Subject, hand_over

T = TypeVar("T")


class InMainThread(Protocol):
    """Has the main thread take steps, while the caller waits for their result."""

    def __call__(self, work: Callable[[], Generator[object, None, T]]) -> Callable[[], T]: ...


def at_once(work: Callable[[], Generator[object, None, T]]) -> Callable[[], T]:
    """Where the caller is the main thread."""
    return lambda: finish(work())


class Cycles:
    """Who is asked to render and to bake. What is asked changes nothing of the open file."""

    def __init__(self, main: InMainThread = at_once, second: SecondBlender | None = None) -> None:
        """Args:
        main: for what only the main thread can
        second: does the work as long as it can
        """
        self._main = main
        self._second = second

    def prepare(self) -> None:
        """There will be work: a second Blender may start already."""
        if self._second is not None:
            try:
                self._second.start()
            except Failed:
                self._second = None

    def end(self) -> None:
        """There will be no more work."""
        if self._second is not None:
            self._second.end()

    def ask(
        self, subject: Callable[[], Subject], work: Callable[..., Generator[object, None, T]], *arguments: object
    ) -> T:
        """The result of `work(subject(), *arguments)`, the same to the bit whoever does it.

        Args:
            subject: called in the main thread
            work: a function of this package that takes steps in the main thread, of whatever Blender
            arguments: whatever can be pickled
        """
        if self._second is not None:
            path = self._second.path
            try:
                handed = self._main(lambda: hand_over(subject(), path))()
                if handed is not None:
                    return self._second.ask(work, handed, *arguments)
            except (Failed, OSError):
                self._second = None  # whatever is wrong with the work shows here too
        return self._main(lambda: work(subject(), *arguments))()
