# SPDX-License-Identifier: GPL-3.0-or-later
"""How time and memory of a bake grow: `python benchmarks/growth.py [--axis NAME ...] [--largest] [--limit SECONDS]`.

A hall with sixteen balls, made as records of the core without Blender; one thing at a time grows: texels, triangles,
patches, lamps, threads. Every point has a process of its own; a point that takes longer than the limit, or more memory
than allowed, is left out, with all larger ones. Seconds are those of all processors together, which other work on the
machine hardly changes, and of the clock where threads are compared; without the unwrap, with the build of the BVH told
apart. Exponents p are those of time ~ size^p. `--largest` measures the sizes that take long instead; they have a log of
their own, and are open circles in the picture. Lamps are points without radius; the error of their direct light is
that of 300 texels of the floor against the sum over all lamps, with one shadow ray for each of 16 points of a texel.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import shutil
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

from benchmarks._curves import exponent  # noqa: E402
from benchmarks._hall import BALLS, direct_error, hall  # noqa: E402
from benchmarks._processes import answer_task, run_task, write_log  # noqa: E402
from benchmarks.speed import machine, memory  # noqa: E402
from radiosity_addon import bake as main_path  # noqa: E402
from radiosity_addon.bake import bake  # noqa: E402
from radiosity_addon.chunks import finish  # noqa: E402
from radiosity_addon.geometry.surfaces import flatten  # noqa: E402
from radiosity_addon.geometry.visibility import Visibility  # noqa: E402
from radiosity_addon.settings import BakeSettings, Quality  # noqa: E402

LOG = ROOT / "out" / "bench" / "growth.json"
PUBLISHED_LOG = ROOT / "benchmarks" / "results" / "growth.json"
PUBLISHED_LARGEST = ROOT / "benchmarks" / "results" / "growth_largest.json"
PUBLISHED_PICTURE = ROOT / "docs" / "pictures" / "growth.png"
PATCHES = (200, 5_000, 50_000, 500_000)
"""Asked for; patches that surfaces and walls part are more, and where each is a texel there are no more."""
SMALL_PAGE, LARGE_PAGE = 512, 2048
"""Pages where triangles or lamps grow, and where patches do: there must be more texels than the most of them."""


@dataclass(frozen=True)
class Point:
    """What is baked."""

    page_size: int = 1024
    triangles: int = 20_000
    patches: int = 0
    lamps: int = 0
    threads: int = 2
    balls: int = BALLS


AXES: dict[str, list[Point]] = {
    "texels": [Point(page_size=size) for size in (256, 512, 1024, 2048)],
    "triangles": [Point(page_size=SMALL_PAGE, triangles=count) for count in (1_000, 10_000, 100_000, 1_000_000)],
    "patches": [Point(page_size=LARGE_PAGE, patches=count) for count in PATCHES],
    "lamps": [Point(page_size=SMALL_PAGE, lamps=count) for count in (1, 10, 100, 1_000)],
    "threads": [Point(threads=count) for count in (1, 2)],
}
LARGEST: dict[str, list[Point]] = {
    "texels": [Point(page_size=size) for size in (4096, 8192)],
    "triangles": [Point(page_size=SMALL_PAGE, triangles=2_000_000)],
    "patches": [Point(page_size=LARGE_PAGE, patches=1_300_000)],
    "level": [Point(page_size=2400, triangles=1_000_000, balls=1024)],
}
"""Sizes that take minutes each; the level has a thousand things that xatlas has to lay flat."""


@dataclass(frozen=True)
class GrownSettings(BakeSettings):
    """Medium quality with any number of patches; 0 for its own."""

    wanted_patches: int = 0

    @property
    def steps(self) -> Quality:
        own = super().steps
        return replace(own, patches=self.wanted_patches) if self.wanted_patches else own


def measure(task: dict[str, Any]) -> dict[str, Any]:
    """In a process of its own: one bake."""
    allowed = int(task["gigabytes"] * 1e9)
    resource.setrlimit(resource.RLIMIT_AS, (allowed, allowed))
    point = Point(**task["point"])
    scene = hall(point.triangles, point.lamps, point.balls)
    before, _ = memory()
    settings = GrownSettings(page_size=point.page_size, threads=point.threads)
    if point.patches:
        main_path.LEAST_PATCHES = 1
        scale = math.sqrt(0.8 * point.page_size**2 / 1e6)  # by which a bake takes more patches on larger pages
        settings = replace(settings, wanted_patches=round(point.patches / scale))
    if task["error"]:
        return {"error": direct_error(scene, finish(bake(scene, replace(settings, bounces=0))))}
    start = time.perf_counter()
    baked = finish(bake(scene, settings))
    seconds = time.perf_counter() - start
    _, peak = memory()
    unwrap = next(stage.seconds for stage in baked.stages if stage.name == "Unwrap")
    corners = flatten(scene).corners
    start = time.process_time()
    Visibility(corners)
    tree = time.process_time() - start
    return {
        "seconds": seconds - unwrap,
        "processor_seconds": sum(stage.processor for stage in baked.stages if stage.name != "Unwrap"),
        "unwrap_seconds": unwrap,
        "tree_seconds": tree,
        "megabytes": peak,
        "megabytes_beside": peak - before,
        "texels": baked.texels,
        "triangles": len(corners),
        "patches": baked.patches,
        "lamps": len(scene.lights),
        "threads": point.threads,
        "level": len(corners),
        "rays": baked.rays,
        "stages": {stage.name: stage.seconds for stage in baked.stages},
    }


def run_axis(name: str, sizes: list[Point], limit: float, gigabytes: float) -> dict[str, Any]:
    """Measure sizes along one axis, smallest first; prints as it goes."""
    found: dict[str, Any] = {"axis": name, "points": [], "left_out": []}
    print(f"\n{name}", flush=True)
    for number, point in enumerate(sizes):
        reason = f"more than {limit:g} s"
        try:
            task = {"point": vars(point), "gigabytes": gigabytes}
            got = run_task(__file__, {**task, "error": False}, limit)
            if got and point.lamps:
                got |= run_task(__file__, {**task, "error": True}, limit) or {}
        except RuntimeError as error:
            if "MemoryError" not in str(error) and "bad_alloc" not in str(error):
                raise
            got, reason = None, f"more than {gigabytes:g} GB"
        if got is None:
            left = [size_of(name, each) for each in sizes[number:]]
            found["left_out"].append({"sizes": left, "reason": reason})
            print(f"  {left[0]:>10,}: {reason}; left out, and all larger ones", flush=True)
            break
        found["points"].append(got)
        error = f", error of direct light {got['error']:.2%}" if "error" in got else ""
        print(
            f"  {got[name]:>10,}: {got['seconds']:8.2f} s, {got['processor_seconds']:.2f} s of processors, "
            f"unwrap {got['unwrap_seconds']:.2f} s, BVH "
            f"{got['tree_seconds']:.2f} s, {got['megabytes_beside']:6.0f} MB, {got['rays']:,} rays{error}",
            flush=True,
        )
    return found


def size_of(name: str, point: Point) -> int:
    """What is asked for on an axis."""
    return point.page_size**2 if name == "texels" else int(getattr(point, "triangles" if name == "level" else name))


def summary(found: dict[str, Any]) -> str:
    """The growth along one axis in words."""
    name, points = found["axis"], found["points"]
    by_size = {point[name]: point for point in points}
    left = "".join(f"; left out: {each['sizes']}, {each['reason']}" for each in found["left_out"])
    if name == "threads":
        if {1, 2} <= set(by_size):
            return f"2 threads are {by_size[1]['seconds'] / by_size[2]['seconds']:.2f} times as fast as 1{left}"
        return f"not both measured{left}"
    if len(points) < 2:
        return f"too few points{left}"
    sizes, seconds = [point[name] for point in points], [point["processor_seconds"] for point in points]
    text = f"time ~ {name}^{exponent(sizes, seconds):.2f}, over the last step ^{exponent(sizes[-2:], seconds[-2:]):.2f}"
    if name == "triangles":
        bare = [point["processor_seconds"] - point["tree_seconds"] for point in points]
        text += f"; without the BVH's build ^{exponent(sizes, bare):.2f}"
    if name == "texels":
        text += (
            f"; {1e6 * points[-1]['megabytes_beside'] / points[-1]['texels']:.0f} bytes a texel at most at the largest"
        )
    if name == "lamps" and {10, 1000} <= set(by_size):
        ratio = by_size[1000]["processor_seconds"] / by_size[10]["processor_seconds"]
        text += f"; 1,000 lamps take {ratio:.1f} times as long as 10"
    return text + left


def markdown(log: dict[str, Any]) -> str:
    """A table for the README."""
    lines = ["| what grows | from, to | seconds | peak memory | growth |", "| --- " * 5 + "|"]
    for found in log["axes"]:
        points, name = found["points"], found["axis"]
        if points:
            first, last = points[0], points[-1]
            lines.append(
                f"| {name} | {first[name]:,}, {last[name]:,} | {first['seconds']:.2f}, {last['seconds']:.1f} | "
                f"{first['megabytes_beside']:.0f}, {last['megabytes_beside']:.0f} MB | {summary(found)} |"
            )
    return "\n".join(lines)


def draw(log: dict[str, Any], largest: dict[str, Any], picture: Path) -> None:
    """Time above, memory below, a column an axis; the largest sizes as open circles."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import FuncFormatter

    shown = [found for found in log["axes"] if found["axis"] != "threads" and len(found["points"]) > 1]
    if not shown:
        return
    figure, axes = plt.subplots(2, len(shown), figsize=(3.4 * len(shown), 5.4), squeeze=False, sharex="col")
    beyond = {found["axis"]: found["points"] for found in largest["axes"]}
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    for column, found in enumerate(shown):
        name, points = found["axis"], found["points"]
        more = beyond.get(name, [])
        sizes = np.array([point[name] for point in [*points, *more]], float)
        for row, key, color in ((0, "processor_seconds", "#23679a"), (1, "megabytes_beside", "#5b8c5a")):
            axis, values = axes[row][column], [max(point[key], 1e-3) for point in [*points, *more]]
            axis.plot(sizes, values, "o-", color=color, ms=4)
            axis.plot(sizes[len(points) :], values[len(points) :], "o", color=color, mfc="white", ms=4)
            ends = sizes[[0, -1]]
            axis.plot(
                ends, values[len(points) - 1] * ends / sizes[len(points) - 1], "--", color="0.7", lw=0.9, zorder=0
            )
            axis.set_xscale("log")
            axis.set_yscale("log")
            axis.set_ylim(min(values) / 2, max(values) * 2)
            axis.yaxis.set_major_formatter(plain)
            axis.spines[["top", "right"]].set_visible(False)
        axes[0][column].set_title(
            f"time ~ {name}$^{{{exponent(sizes[: len(points)], [p['processor_seconds'] for p in points]):.2f}}}$",
            fontsize=10,
        )
        axes[1][column].set_xlabel(name)
    axes[0][0].set_ylabel("seconds of processors, without unwrap")
    axes[1][0].set_ylabel("peak memory, MB")
    figure.text(0.995, 0.005, "dashed: linear growth", ha="right", fontsize=8, color="0.5")
    figure.tight_layout()
    picture.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(picture, dpi=120)
    plt.close(figure)


def main() -> None:
    """Measure, print, draw."""
    if answer_task(measure):
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--axis", action="append", choices=[*AXES, "level"], help="only this one; may be repeated")
    parser.add_argument("--largest", action="store_true", help="measure the sizes that take minutes each instead")
    parser.add_argument("--limit", type=float, default=300.0, metavar="SECONDS", help="of a point; default: 300")
    parser.add_argument("--memory", type=float, default=16.0, metavar="GB", help="of a point; default: 16")
    parser.add_argument("--log", type=Path, metavar="FILE.json", help="measure nothing: show what an earlier run found")
    parser.add_argument("--markdown", action="store_true", help="also as a table to paste")
    parser.add_argument("--publish", action="store_true", help="put log and picture into benchmarks/results/ and docs/")
    options = parser.parse_args()
    if options.log:
        log = json.loads(options.log.read_text(encoding="utf-8"))
    else:
        about = {"machine": machine(), "load": os.getloadavg()[0], "date": time.strftime("%Y-%m-%d")}
        log = {**about, "limit": options.limit, "axes": []}
        print(f"{log['machine']}, load {log['load']:.1f}")
        sizes = LARGEST if options.largest else AXES
        for name in options.axis or sizes:
            log["axes"].append(run_axis(name, sizes[name], options.limit, options.memory))
            write_log(log, PUBLISHED_LARGEST if options.largest else LOG)
    if options.largest:
        return
    print(f"\n{log['machine']}, {log['date']}")
    for found in log["axes"]:
        print(f"{found['axis']}: {summary(found)}")
    if options.markdown:
        print("\n" + markdown(log))
    picture = LOG.with_suffix(".png")
    known = PUBLISHED_LARGEST.exists()
    draw(log, json.loads(PUBLISHED_LARGEST.read_text(encoding="utf-8")) if known else {"axes": []}, picture)
    if options.publish:
        write_log(log, PUBLISHED_LOG)
        shutil.copyfile(picture, PUBLISHED_PICTURE)


if __name__ == "__main__":
    main()
