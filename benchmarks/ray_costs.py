# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays cost beside Embree, and what a second thread can gain: `python benchmarks/ray_costs.py [--scene NAME]`.

Medium bakes of the scenes of `versus_cycles.py`, each in a process of its own. All is processor time, which a busy
machine changes little. NumPy's cost is what stages spend outside Embree, over their rays: transport's and gather's over
those that look for the nearest surface, direct light's over its shadow rays. Work of the thread that leads a bake is
shared by no other: it bounds what two threads gain, were they never in each other's way.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks._processes import answer_task, run_task  # noqa: E402
from benchmarks._versus_tables import TRACING, ray_costs  # noqa: E402
from benchmarks._versus_tasks import open_scene, settings_of  # noqa: E402
from benchmarks.speed import machine  # noqa: E402
from benchmarks.versus_cycles import MATCHES  # noqa: E402

STAGES = (*TRACING, "Direct light")


def measure(task: dict[str, Any]) -> dict[str, Any]:
    """In a process of its own: a bake, and what the leading thread did of each stage."""
    import bpy

    from radiosity_addon.bake import bake
    from radiosity_addon.blender.reading.cycles_shader import CyclesShader
    from radiosity_addon.blender.reading.extract import extract_scene

    open_scene(task["scene"])
    extraction = extract_scene(bpy.context.scene)
    steps = bake(extraction.scene, settings_of(task), CyclesShader(bpy.context.scene.name, extraction))
    leading: dict[str, float] = {}
    name, before = "Unwrap", time.thread_time()
    while True:
        try:
            name = next(steps).stage
        except StopIteration as stop:
            baked = stop.value
            break
        finally:
            now = time.thread_time()
            leading[name] = leading.get(name, 0.0) + now - before
            before = now
    stages = [
        {"name": stage.name, "processor": stage.processor, "leading": leading.get(stage.name, 0.0), **vars(stage.tally)}
        for stage in baked.stages
    ]
    return {"stages": stages}


def gain(stages: list[dict[str, Any]]) -> float:
    """How many times as fast two threads are at best."""
    whole, alone = (sum(float(stage[key]) for stage in stages) for key in ("processor", "leading"))
    return whole / (alone + (whole - alone) / 2)


def main() -> None:
    """Measure and print."""
    if answer_task(measure):
        return
    names = [match.scene for match in MATCHES]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--scene", action="append", choices=names, help="only this one; may be repeated")
    options = parser.parse_args()
    print(machine())
    for match in MATCHES:
        if match.scene not in (options.scene or names):
            continue
        task = {"scene": match.scene, "page_size": match.page_size, "density": match.density, "threads": 2}
        found = run_task(__file__, task)
        assert found is not None
        costs, stages = ray_costs(found), [stage for stage in found["stages"] if stage["name"] != "Unwrap"]
        print(
            f"\n{match.title}: {sum(stage['processor'] for stage in stages):.2f} s, {costs['share']:.0%} in Embree; "
            f"two threads gain {gain(stages):.2f} at best\n"
            f"  nearest surface: Embree {costs['closest']:.0f} ns, NumPy {costs['numpy_closest']:.0f} ns\n"
            f"  shadow:          Embree {costs['shadow']:.0f} ns, NumPy {costs['numpy_shadow']:.0f} ns"
        )
        for stage in stages:
            embree = stage["closest_seconds"] + stage["shadow_seconds"]
            times = f"{stage['processor'] / embree:7.1f} times Embree" if stage["name"] in STAGES else ""
            print(f"  {stage['name']:<14}{stage['processor']:7.2f} s, leading {stage['leading']:6.2f} s{times}")


if __name__ == "__main__":
    main()
