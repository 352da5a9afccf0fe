# SPDX-License-Identifier: GPL-3.0-or-later
"""A second Blender without a window, which works while the first one's window stays alive.

It does the very work that would be done here, by the same functions of the same package, and ends with this process.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Generator
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import bpy

from .second_blender_worker import READY
from .subject import Handed

T = TypeVar("T")

WORKER = Path(__file__).with_name("second_blender_worker.py")
PACKAGE = __package__.rpartition(".blender")[0]
HOME = Path(__file__).parents[2]
"""Where our package lies; the worker imports it under the same name, whatever that is."""

START_SECONDS = 60.0
"""A Blender that takes longer to start is stuck: some 0.7 s are usual."""


class Failed(Exception):
    """The second Blender could not be started, or has not done its work."""


class SecondBlender:
    """Started when it is first needed; leaving the context ends it and takes away its files."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="radiosity-blender-", ignore_cleanup_errors=True)
        self._child: subprocess.Popen[bytes] | None = None
        self._ready = self._ended = False
        self._lock = threading.Lock()

    @property
    def path(self) -> Path:
        """Of the file to hand subjects over in."""
        return Path(self._folder.name, "subject.blend")

    def start(self) -> None:
        """Start it, unless it was; what it is asked first waits for it.

        Raises:
            Failed: it can't be, or has ended
        """
        with self._lock:
            if self._ended:
                raise Failed("it has ended")
            if self._child is None:
                self._child = self._started()

    def _started(self) -> subprocess.Popen[bytes]:
        blender = [sys.executable, "-P"]  # modules beside the worker have names of others
        if not bpy.app.module:
            blender = [bpy.app.binary_path, "--background", "--factory-startup", "-noaudio", "--python"]
        folder = self._folder.name
        try:
            return subprocess.Popen(
                [*blender, str(WORKER), "--", PACKAGE, str(HOME), folder],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=os.environ | dict.fromkeys(("TMPDIR", "TEMP", "TMP"), folder),
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            raise Failed(str(error)) from error

    def ask(self, work: Callable[..., Generator[object, None, T]], subject: Handed, *arguments: object) -> T:
        """The result of `work(subject, *arguments)`, done there; called in a thread, which waits for it.

        Args:
            work: a function of this package
            arguments: whatever can be pickled

        Raises:
            Failed: there is none; nor will there be for what is asked later
        """
        self.start()
        child = self._child
        try:
            self._await(child)
            pickle.dump((work, subject, arguments), child.stdin, pickle.HIGHEST_PROTOCOL)
            child.stdin.flush()
            done, result = pickle.load(child.stdout)
        except (OSError, EOFError, ValueError, pickle.UnpicklingError) as error:
            self.end()
            raise Failed(str(error)) from error
        if not done:
            self.end()
            raise Failed(result)
        return result

    def _await(self, child: subprocess.Popen[bytes]) -> None:
        """Until it is ready, past what Blender prints while it starts."""
        if self._ready:
            return
        deadline = threading.Timer(START_SECONDS, child.kill)
        deadline.start()
        try:
            if not any(line.strip() == READY for line in child.stdout):
                raise EOFError("it did not start")
        finally:
            deadline.cancel()
        self._ready = True

    def end(self) -> None:
        """Kill it, whatever it is doing; whoever waits for it hears that it failed."""
        with self._lock:
            self._ended = True
            if self._child is not None:
                self._child.kill()
                self._child.wait()
        self._folder.cleanup()

    def __enter__(self) -> SecondBlender:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()
