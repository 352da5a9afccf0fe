# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs xatlas in a child process that can be killed, and survives its crashes."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arrays import Float32, Float64, Int32, Int64
from ..errors import BakeError
from .xatlas_worker import CANNOT_LOAD, RECORD_BYTES

WORKER = Path(__file__).with_name("xatlas_worker.py")
RADIUS = 1000.0
"""Jobs are scaled to this radius: xatlas drops triangles of less than 1.2e-7 square units without a word."""

POLL_SECONDS = 0.01
DEADLINE_SECONDS = 60.0
DEADLINE_PER_TRIANGLE = 1e-4
"""Of one job. An emergency only; what is known to be slow doesn't come here. It depends on the machine's load."""

PAUSE_SECONDS = 3.0
"""Most between two jobs. A child that takes longer is stuck, not slow; the next one goes on where it was."""


@dataclass(frozen=True, eq=False)
class Job:
    """One surface to be cut into charts.

    Attributes:
        corners: (F, 3, 3) float64, m, finite; no degenerate triangles
        vertex: (F, 3) int64, equal where corners are the same vertex
        max_area: m2, largest area of a chart; 0 is no limit
    """

    corners: Float64
    vertex: Int64
    max_area: float = 0.0


Cut = tuple[Float32, Int32]
"""(F, 3, 2) uv of a job's triangles, each chart scaled along u and v in some way, and (F,) chart, -1: none."""


def cut_into_charts(jobs: list[Job]) -> Generator[float, None, list[Cut | None]]:
    """Charts of each job by xatlas, None for one that xatlas crashed on or did not finish in time.

    Yields the share done at least every 20 ms or so. Closing the generator kills the child.

    Raises:
        BakeError: xatlas can't be loaded
    """
    counts = np.array([len(job.corners) for job in jobs], np.int64)
    failed: set[int] = set()
    with tempfile.TemporaryDirectory(prefix="radiosity-", ignore_cleanup_errors=True) as folder:
        source, output = Path(folder, "jobs.npz"), Path(folder, "charts.bin")
        _write_jobs(source, jobs)
        output.touch()
        ends = np.cumsum(counts + 1) * RECORD_BYTES
        start = 0
        while start < len(jobs):
            child = _start(source, output, start, Path(folder, "messages.txt"))
            try:
                finished, begun = yield from _watch(child, output, ends, counts, start)
            finally:
                child.kill()
                child.wait()
            if child.returncode == CANNOT_LOAD:
                raise _missing(Path(folder, "messages.txt").read_text(errors="replace").strip())
            if finished < len(jobs) and (begun or finished == start):  # a gap for the job that failed
                failed.add(finished)
                finished += 1
            start = finished
            with output.open("r+b") as file:
                file.truncate(int(ends[start - 1]))
        records = np.fromfile(output, dtype=[("uv", "<f4", (3, 2)), ("chart", "<i4")])
    parts = [part[1:] for part in np.split(records, np.cumsum(counts + 1)[:-1])] if jobs else []
    return [None if i in failed else (part["uv"].copy(), part["chart"].copy()) for i, part in enumerate(parts)]


def _watch(
    child: subprocess.Popen[bytes], output: Path, ends: Int64, counts: Int64, start: int
) -> Generator[float, None, tuple[int, bool]]:
    """Waits for the child and returns how many jobs are finished, and whether the next one was begun."""
    seen, since = (start, False), time.monotonic()
    while True:
        running = child.poll() is None
        written = output.stat().st_size
        finished = int(np.searchsorted(ends, written, side="right"))
        begun = written > (ends[finished - 1] if finished else 0)
        if (finished, begun) != seen:
            seen, since = (finished, begun), time.monotonic()
        if not running or finished == len(counts):
            return finished, begun
        between = finished > start and not begun
        deadline = PAUSE_SECONDS if between else DEADLINE_SECONDS + DEADLINE_PER_TRIANGLE * counts[finished]
        if time.monotonic() - since > deadline:
            return finished, begun
        yield float(finished / len(counts))
        time.sleep(POLL_SECONDS)


def _start(source: Path, output: Path, first: int, messages: Path) -> subprocess.Popen[bytes]:
    sites = []
    for name in ("numpy", "xatlas"):
        found = importlib.util.find_spec(name)
        if found is None or found.origin is None:
            raise _missing(f"no module named {name}")
        place = Path(found.origin).parent
        sites.append(str(place.parent if found.submodule_search_locations else place))
    arguments = [sys.executable, "-I", "-S", str(WORKER), str(source), str(output), str(first), *dict.fromkeys(sites)]
    try:
        with messages.open("wb") as file:
            return subprocess.Popen(
                arguments,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=file,
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
    except OSError as error:
        raise _missing(str(error)) from error


def _missing(cause: str) -> BakeError:
    return BakeError("xatlas", f"it can't be started ({cause})", "Install the extension again for this platform")


def _write_jobs(path: Path, jobs: list[Job]) -> None:
    positions, triangles, vertex_counts = [], [], []
    for job in jobs:
        _, first, index = np.unique(job.vertex.reshape(-1), return_index=True, return_inverse=True)
        points = job.corners.reshape(-1, 3)[first]
        low, high = points.min(axis=0), points.max(axis=0)
        radius = np.linalg.norm(high - low) / 2
        positions.append(((points - (low + high) / 2) * (RADIUS / radius)).astype(np.float32))
        triangles.append(index.reshape(-1, 3).astype(np.uint32))
        vertex_counts.append((len(points), radius))
    np.savez(
        path,
        positions=np.concatenate(positions),
        triangles=np.concatenate(triangles),
        vertex_first=np.cumsum([0] + [count for count, _ in vertex_counts]),
        triangle_first=np.cumsum([0] + [len(part) for part in triangles]),
        max_area=np.array(
            [job.max_area * (RADIUS / radius) ** 2 for job, (_, radius) in zip(jobs, vertex_counts, strict=True)]
        ),
    )
