# SPDX-License-Identifier: GPL-3.0-or-later
"""Tasks that a benchmark measures in processes of their own, each with its own time and peak of memory; their log."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

Task = Mapping[str, Any]

CHILD = "--task"
"""The argument that makes a script do one task and print what it measured, as its last line."""


def run_task(script: str | Path, task: Task, limit: float | None = None) -> dict[str, Any] | None:
    """Do one task in a process of its own; what it found, or None if it took longer than `limit` seconds.

    Raises:
        RuntimeError: the process failed
    """
    words = json.dumps({**task, "spawned": time.time()})
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            [sys.executable, str(script), CHILD, words],
            capture_output=True,
            text=True,
            timeout=limit,
            check=False,
            env=environment,
        )
    except subprocess.TimeoutExpired:
        return None
    if done.returncode:
        raise RuntimeError(f"{words}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}")
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def answer_task(work: Callable[[dict[str, Any]], dict[str, Any]]) -> bool:
    """In a process that was started for a task: do it and print what it found. False in all others."""
    if CHILD not in sys.argv:
        return False
    task = json.loads(sys.argv[sys.argv.index(CHILD) + 1])
    print("\n" + json.dumps(work(task)), flush=True)
    return True


def write_log(log: Task, path: Path) -> None:
    """Keep what was measured."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(log, indent=1) + "\n", encoding="utf-8")
