# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds of each stage, rays, memory and error of a few bakes: `python benchmarks/speed.py [--repeat N]`.

Every case runs in a process of its own, for its own peak of memory. Times are the best of the repeats. Memory
is the peak of the process after the first bake less what it held with the scene open, Blender included; xatlas, a
child process, apart.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))


@dataclass(frozen=True)
class Case:
    """A scene, the edge of its one page in texels, and the limits that the project set itself, if any."""

    scene: str
    page_size: int
    seconds: float | None = None
    megabytes: float | None = None


CASES = [
    Case("cornell_box", 256, 0.5, 500.0),
    Case("cornell_box", 512),
    Case("window_room", 1024),
    Case("interior", 1024, 8.0, 500.0),
]
QUALITY = "medium"


def machine() -> str:
    """Processor, processors that this process may use, system and Python."""
    name = platform.processor() or platform.machine()
    about = Path("/proc/cpuinfo")
    if about.exists():
        names = [line.split(":", 1)[1].strip() for line in about.read_text().splitlines() if "model name" in line]
        name = names[0] if names else name
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{name}, {usable} processors, {platform.system()}, Python {platform.python_version()}"


def memory() -> tuple[float, float]:
    """What this process holds, and the most it ever held, MB; zeros where the system does not say."""
    about = Path("/proc/self/status")
    if not about.exists():
        return 0.0, 0.0
    fields = dict(line.split(":", 1) for line in about.read_text().splitlines())
    return tuple(float(fields[name].split()[0]) / 1000 for name in ("VmRSS", "VmHWM"))


def measure(case: Case, repeat: int) -> dict[str, object]:
    """Bake one case `repeat` times, in this process."""
    import bpy

    from radiosity_addon.bake import bake
    from radiosity_addon.blender.reading.extract import extract_scene
    from radiosity_addon.chunks import finish
    from radiosity_addon.settings import BakeSettings
    from tests.accuracy.comparison import compare
    from tests.accuracy.probes import References, fingerprint

    blend = ROOT / "sample_scenes" / f"{case.scene}.blend"
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    before, _ = memory()
    scene = extract_scene(bpy.context.scene).scene
    settings = BakeSettings(page_size=case.page_size, quality=QUALITY)
    runs = [finish(bake(scene, settings))]
    _, peak = memory()
    runs += [finish(bake(scene, settings)) for _ in range(repeat - 1)]

    def seconds_of(run: object) -> float:
        return sum(stage.seconds for stage in run.stages if stage.name != "Unwrap")

    best = min(runs, key=seconds_of)
    stored = ROOT / "tests" / "accuracy" / "references" / f"{case.scene}.npz"
    error = ""
    if stored.exists():
        references = References.load(stored)
        if references.scene == fingerprint(blend):
            error = str(compare(best, scene, references)).splitlines()[0]
    return {
        "stages": [(stage.name, stage.seconds, stage.rays) for stage in best.stages],
        "seconds": seconds_of(best),
        "rays": best.rays,
        "texels": best.texels,
        "patches": best.patches,
        "pages": len(best.pages),
        "triangles": sum(len(mesh.triangles) for mesh in scene.meshes),
        "megabytes": peak - before,
        "error": error,
    }


def limit(value: float | None, unit: str) -> str:
    """The project's own limit in words."""
    return "" if value is None else f" (limit {value:g} {unit})"


def show(case: Case, found: dict) -> None:
    """Print what was measured."""
    print(f"\n{case.scene}, {found['pages']} page of {case.page_size} x {case.page_size}, {QUALITY}")
    print(f"  {found['triangles']:,} triangles, {found['texels']:,} texels, {found['patches']:,} patches")
    for name, seconds, rays in found["stages"]:
        print(f"  {name:<14}{seconds:8.2f} s" + (f"{rays:>14,} rays" if rays else ""))
    seconds, megabytes = limit(case.seconds, "s"), limit(case.megabytes, "MB")
    print(f"  without unwrap{found['seconds']:8.2f} s{found['rays']:>14,} rays{seconds}")
    print(f"  peak memory   {found['megabytes']:8.0f} MB beside Blender{megabytes}")
    if found["error"]:
        print(f"  against Cycles: {found['error']}")


def main() -> None:
    """Measure all cases, each in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="bakes of each case, best shown; default: 3")
    parser.add_argument("--case", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case is not None:
        found = measure(CASES[options.case], options.repeat)
        print("\n" + json.dumps(found), flush=True)
        return
    print(machine())
    for number, case in enumerate(CASES):
        command = [sys.executable, __file__, "--case", str(number), "--repeat", str(options.repeat)]
        output = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        show(case, json.loads(output.splitlines()[-1]))


if __name__ == "__main__":
    main()
