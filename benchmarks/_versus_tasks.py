# SPDX-License-Identifier: GPL-3.0-or-later
"""What `versus_cycles.py` has done in processes of their own: our bake, Cycles' bake, and what both need of a scene."""

from __future__ import annotations

import hashlib
import pickle
import statistics
import time
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.speed import memory
from radiosity_addon.atlas.unwrap import Atlas
from radiosity_addon.scene import Mesh, Scene
from tests.accuracy.comparison import compare
from tests.accuracy.make_references import PLANS
from tests.accuracy.probes import References

ROOT = Path(__file__).resolve().parents[1]
REFERENCES = ROOT / "tests" / "accuracy" / "references"


@dataclass(frozen=True)
class Prepared:
    """What Cycles' processes and the reading of pages get to know; the meshes are the scene's and their backs."""

    scene: Scene
    atlas: Atlas
    meshes: tuple[Mesh, ...]

    @classmethod
    def load(cls, path: str | Path) -> Prepared:
        """What `prepare` has written."""
        with open(path, "rb") as file:
            found: Prepared = pickle.load(file)
        return found


def open_scene(scene: str) -> None:
    """Open the .blend of a match in this process."""
    import bpy

    bpy.ops.wm.open_mainfile(filepath=str(PLANS[scene].folder / f"{scene}.blend"))


def settings_of(task: dict[str, Any], quality: str = "medium") -> Any:
    """The settings of our bake."""
    from radiosity_addon.settings import BakeSettings

    pages = {"page_size": task["page_size"], "density": task["density"]}
    return BakeSettings(quality=quality, threads=task["threads"], **pages)


def signature(atlas: Any) -> str:
    """The same for atlases that are the same."""
    parts = [np.asarray(atlas.page).tobytes(), *(uv.tobytes() for uv in atlas.uv)]
    return hashlib.sha256(b"".join(parts)).hexdigest()


def prepare(task: dict[str, Any]) -> dict[str, Any]:
    """In a process of its own: the scene's records and our atlas, for Cycles and for the reading of pages."""
    import bpy

    from radiosity_addon.atlas.unwrap import build_atlas
    from radiosity_addon.blender.reading.extract import extract_scene
    from radiosity_addon.chunks import finish
    from radiosity_addon.geometry.sides import with_backs

    open_scene(task["scene"])
    scene = extract_scene(bpy.context.scene).scene
    sides = with_backs(scene)
    start = time.perf_counter()
    atlas = finish(build_atlas(sides, settings_of(task)))
    seconds = time.perf_counter() - start
    with open(task["file"], "wb") as file:
        pickle.dump(Prepared(scene, atlas, sides.meshes), file)
    return {
        "unwrap_seconds": seconds,
        "triangles": sum(len(mesh.triangles) for mesh in scene.meshes),
        "pages": atlas.page_count,
        "atlas": signature(atlas),
    }


def bake_ours(task: dict[str, Any]) -> dict[str, Any]:
    """In a process of its own: our bake, and how long it takes when it is repeated."""
    import bpy

    from radiosity_addon.bake import bake
    from radiosity_addon.blender.reading.cycles_shader import CyclesShader
    from radiosity_addon.blender.reading.extract import extract_scene
    from radiosity_addon.chunks import finish

    open_scene(task["scene"])
    before, _ = memory()
    settings = settings_of(task, task["quality"])
    runs = []
    for repeat in range(task["repeat"]):
        extraction = extract_scene(bpy.context.scene)
        runs.append(finish(bake(extraction.scene, settings, CyclesShader(bpy.context.scene.name, extraction))))
        if repeat == 0:
            np.save(task["file"], np.stack(runs[0].pages))
            whole, peak = time.time() - task["spawned"], memory()[1]
    seconds = [sum(stage.seconds for stage in run.stages if stage.name != "Unwrap") for run in runs]
    middle = runs[int(np.argsort(seconds)[(len(seconds) - 1) // 2])]
    return {
        "quality": task["quality"],
        "seconds": statistics.median_low(seconds),
        "all_seconds": seconds,
        "process_seconds": whole,
        "megabytes": peak,
        "megabytes_beside": peak - before,
        "texels": middle.texels,
        "patches": middle.patches,
        "rays": middle.rays,
        "atlas": signature(middle.atlas),
        "stages": [
            {
                "name": stage.name,
                "seconds": stage.seconds,
                "processor": stage.processor,
                "closest": stage.tally.closest,
                "closest_seconds": stage.tally.closest_seconds,
                "shadow": stage.tally.shadow,
                "shadow_seconds": stage.tally.shadow_seconds,
            }
            for stage in middle.stages
        ],
    }


def bake_cycles(task: dict[str, Any]) -> dict[str, Any]:
    """In a process of its own: Cycles' bake, and what OIDN makes of it."""
    from benchmarks._cycles_pages import FILTERS, bake_pages, configure, denoised, receivers

    prepared = Prepared.load(task["prepared"])
    open_scene(task["scene"])
    atlas = prepared.atlas
    images = receivers(prepared.meshes, atlas.uv, atlas.page, atlas.page_count, atlas.size)
    configure(task["samples"], task["threads"])
    before, _ = memory()
    pages, seconds = bake_pages(images)
    np.save(task["file"], np.stack(pages))
    found = {
        "samples": task["samples"],
        "seconds": seconds,
        "process_seconds": time.time() - task["spawned"],
        "megabytes": memory()[1],
        "megabytes_beside": memory()[1] - before,
        "filters": {},
    }
    for name in FILTERS:
        clean, more = denoised(pages, name)
        np.save(f"{task['file']}.{name}.npy", np.stack(clean))
        found["filters"][name] = {"seconds": more, "megabytes": memory()[1]}
    return found


def errors_of(pages: Path, prepared: Path, references: References) -> dict[str, float]:
    """The suite's figures for pages that were saved."""
    known = Prepared.load(prepared)
    baked = SimpleNamespace(atlas=known.atlas, pages=list(np.load(pages)))
    found = compare(baked, known.scene, references)
    return {"error": found.rms, "bias": found.bias, "percentile_99": found.percentile_99, "noise": found.noise}
