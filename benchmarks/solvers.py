# SPDX-License-Identifier: GPL-3.0-or-later
"""Unshot light against work for every solver: `python benchmarks/solvers.py [--picture FILE.png] [SCENE ...]`.

Each solver starts from the same traced transport of a sample scene. Work is counted in rows of the matrix that are
used, over the number of patches: a step of Jacobi costs 1. Solvers that take patches one by one end at a residual of
1e-3, or after the work or time that is said below.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

from benchmarks.speed import machine  # noqa: E402

SCENES = ("cornell_box", "window_room", "interior")
PAGE_SIZE = 512
TOLERANCE = 1e-6
ONE_BY_ONE = ("southwell", "overshooting")
LOOSE = 1e-3
MOST_SECONDS = 30.0
MOST_DENSE = 4000
CURVE_POINTS = 200
RESIDUALS = (0.1, 0.01, 1e-3, 1e-4, 1e-6)


@dataclass(frozen=True)
class Run:
    """Work, seconds and residual after each step."""

    solver: str
    work: np.ndarray
    seconds: np.ndarray
    residual: np.ndarray

    def needed(self, residual: float) -> str:
        """Work and seconds at which the residual is reached."""
        there = np.flatnonzero(self.residual <= residual)
        return f"{self.work[there[0]]:9.1f} {self.seconds[there[0]]:6.2f} s" if len(there) else f"{'-':>18}"


def captured(scene: str) -> tuple:
    """Transport, patches and exitance of a sample scene at medium quality, as its bake's solver gets them."""
    import bpy

    from radiosity_addon.bake import bake
    from radiosity_addon.blender.reading.extract import extract_scene
    from radiosity_addon.radiosity import solvers
    from radiosity_addon.settings import BakeSettings

    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "sample_scenes" / f"{scene}.blend"))
    found = []
    kept = solvers.SOLVERS[BakeSettings.solver]

    def spy(transport, patches, exitance, *rest):  # type: ignore[no-untyped-def]
        found.append((transport, patches, exitance))
        return kept(transport, patches, exitance, *rest)

    solvers.SOLVERS[BakeSettings.solver] = spy
    steps = bake(extract_scene(bpy.context.scene).scene, BakeSettings(page_size=PAGE_SIZE))
    try:
        while not found:
            next(steps)
    finally:
        steps.close()
        solvers.SOLVERS[BakeSettings.solver] = kept
    return found[0]


def run(name: str, transport, patches, exitance) -> Run:  # type: ignore[no-untyped-def]
    """Follow one solver to its tolerance, or its limit."""
    from radiosity_addon.radiosity.solvers import SOLVERS

    start = time.perf_counter()
    work, seconds, residual = [0.0], [0.0], [1.0]
    for state in SOLVERS[name](transport, patches, exitance, LOOSE if name in ONE_BY_ONE else TOLERANCE, 10**6):
        work.append(state.shots / transport.count)
        seconds.append(time.perf_counter() - start)
        residual.append(state.residual)
        if seconds[-1] > MOST_SECONDS:
            break
    return Run(name, np.array(work), np.array(seconds), np.array(residual))


def plot(results: dict[str, list[Run]], path: Path) -> None:
    """Curves of each scene side by side."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, len(results), figsize=(5 * len(results), 4), sharey=True, squeeze=False)
    for axis, (scene, runs) in zip(axes[0], results.items(), strict=True):
        for each in runs:
            some = np.unique(np.geomspace(1, len(each.work), CURVE_POINTS).astype(int) - 1)
            axis.plot(each.work[some], np.maximum(each.residual[some], 1e-8), label=each.solver)
        axis.set(
            xscale="symlog", yscale="log", title=scene, xlabel="rows used / patches", ylim=(1e-7, 1.5), xlim=(0, 40)
        )
        axis.grid(alpha=0.3)
    axes[0][0].set_ylabel("unshot share of the light")
    axes[0][-1].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> None:
    """Print the table and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE")
    parser.add_argument("--picture", type=Path, default=ROOT / "out" / "solvers.png")
    options = parser.parse_args()
    options.picture.parent.mkdir(parents=True, exist_ok=True)
    from radiosity_addon.radiosity.solvers import SOLVERS

    print(f"Rows used over patches, and seconds, until a residual of {RESIDUALS}; {machine()}")
    results: dict[str, list[Run]] = {}
    for scene in options.scenes:
        problem = captured(scene)
        count = problem[0].count
        names = [name for name in SOLVERS if name != "dense" or count <= MOST_DENSE]
        results[scene] = []
        print(f"{scene}, {count:,} patches", flush=True)
        for name in names:
            done = run(name, *problem)
            results[scene].append(done)
            columns = " ".join(done.needed(residual) for residual in RESIDUALS)
            print(f"  {name:20}{columns}", flush=True)
    plot(results, options.picture)
    print(f"Picture: {options.picture}")


if __name__ == "__main__":
    main()
