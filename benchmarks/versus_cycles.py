# SPDX-License-Identifier: GPL-3.0-or-later
"""Time against error of our bakes and of Cycles', raw and denoised by OIDN: `python benchmarks/versus_cycles.py`.

Both bake the same scenes, in the same run, onto the same pages with the same uv map, ours; both pages are read alike at
the probes of tests/accuracy/, and errors are the suite's: root mean squares of the luminance's errors over the probes,
as shares of the mean, without probes that another object stands beside, and without those on metal, which Cycles bakes
no diffuse light on. Every bake has a process of its own.

Ours are the three qualities, median of the repeats, without the unwrap. Cycles runs as fast as it can: one bake for all
surfaces (see _cycles_pages.py), light tree, Russian roulette, nothing clamped, 128 bounces; adaptive sampling changes
nothing in bakes. Its samples double until the next bake would take longer than the budget. Beyond, raw Cycles is
extrapolated by error^2 = noise^2 / samples + floor^2, and marked so (~); OIDN never is. Denoised are pages after each
of OIDN's two filters, the better one counts. Between measured sample counts both are interpolated; our qualities not.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import pickle
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

from benchmarks._curves import Cost, NoiseFit, crossing, first_reaching, fit_cost, fit_noise  # noqa: E402
from benchmarks._processes import answer_task, run_task  # noqa: E402
from benchmarks.speed import machine, memory  # noqa: E402
from radiosity_addon.atlas.unwrap import Atlas  # noqa: E402
from radiosity_addon.scene import Mesh, Scene  # noqa: E402
from radiosity_addon.settings import QUALITIES  # noqa: E402
from tests.accuracy.comparison import compare  # noqa: E402
from tests.accuracy.make_references import PLANS  # noqa: E402
from tests.accuracy.probes import References, fingerprint  # noqa: E402

LEVELS = (0.025, 0.015)
"""Errors at which times are compared."""
MOST_SAMPLES = 1 << 14
LOG = ROOT / "out" / "bench" / "versus_cycles.json"
PUBLISHED_LOG = ROOT / "benchmarks" / "results" / "versus_cycles.json"
PUBLISHED_PICTURE = ROOT / "docs" / "pictures" / "versus_cycles.png"
REFERENCES = ROOT / "tests" / "accuracy" / "references"
MOST_LEFT_OUT = 0.02
"""Share of the probes that may lie on objects that can't be joined; where more do, Cycles bakes on a white mesh."""
TRACING = ("Transport", "Gather")
"""Stages whose rays look for the nearest surface."""


@dataclass(frozen=True)
class Match:
    """A scene of the accuracy suite, what it stands for, and its pages."""

    scene: str
    title: str
    page_size: int
    density: float | None = None


MATCHES = (
    Match("cornell_box", "Cornell box", 512),
    Match("interior", "interior", 1024),
    Match("level", "level", 512, 15.0),
    Match("court", "outdoors", 1024),
    Match("studio", "textures", 768),
)
QUICK = Match("cornell_box", "Cornell box", 256)


@dataclass(frozen=True)
class Prepared:
    """What Cycles' processes and the reading of pages get to know of a scene; see `_cycles_pages.join`.

    Attributes:
        unread: names of objects whose light Cycles does not bake: their probes count for neither side
    """

    scene: Scene
    atlas: Atlas
    meshes: tuple[Mesh, ...]
    kept: list[int]
    materials: list[str] | None
    replaced: list[str]
    unread: list[str]

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

    from benchmarks._cycles_pages import joinable
    from radiosity_addon.atlas.unwrap import build_atlas
    from radiosity_addon.blender.extract import extract_scene
    from radiosity_addon.chunks import finish
    from radiosity_addon.geometry.sides import with_backs

    open_scene(task["scene"])
    extraction = extract_scene(bpy.context.scene)
    scene = extraction.scene
    sides = with_backs(scene)
    start = time.perf_counter()
    atlas = finish(build_atlas(sides, settings_of(task)))
    seconds = time.perf_counter() - start
    own = joinable(extraction)
    others = [mesh.name for mesh, joined in zip(scene.meshes, own, strict=True) if not joined]
    probed = References.load(REFERENCES / f"{task['scene']}.npz").object
    joined = bool(np.isin(probed, others).mean() <= MOST_LEFT_OUT)
    baked = Prepared(
        scene=scene,
        atlas=atlas,
        meshes=sides.meshes,
        kept=[
            index
            for index, page in enumerate(atlas.page)
            if 0 <= page < atlas.page_count and (not joined or (index < len(own) and own[index]))
        ],
        materials=list(extraction.materials) if joined else None,
        replaced=sorted({source.object_name for source, taken in zip(extraction.sources, own, strict=True) if taken})
        if joined
        else [],
        unread=others if joined else [],
    )
    with open(task["file"], "wb") as file:
        pickle.dump(baked, file)
    return {
        "joined": joined,
        "unread_probes": int(np.isin(probed, baked.unread).sum()),
        "unwrap_seconds": seconds,
        "triangles": sum(len(mesh.triangles) for mesh in scene.meshes),
        "pages": atlas.page_count,
        "atlas": signature(atlas),
    }


def bake_ours(task: dict[str, Any]) -> dict[str, Any]:
    """In a process of its own: our bake, and how long it takes when it is repeated."""
    import bpy

    from radiosity_addon.bake import bake
    from radiosity_addon.blender.cycles_shader import CyclesShader
    from radiosity_addon.blender.extract import extract_scene
    from radiosity_addon.chunks import finish

    open_scene(task["scene"])
    before, _ = memory()
    settings = settings_of(task, task["quality"])
    runs = []
    for repeat in range(task["repeat"]):
        extraction = extract_scene(bpy.context.scene)
        runs.append(finish(bake(extraction.scene, settings, CyclesShader(bpy.context.scene, extraction))))
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
    from benchmarks._cycles_pages import FILTERS, bake_pages, configure, denoised, join

    prepared = Prepared.load(task["prepared"])
    open_scene(task["scene"])
    images = join(prepared.meshes, prepared.kept, prepared.atlas, prepared.materials, prepared.replaced)
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
    read = ~np.isin(references.object, known.unread)
    parts = {name: getattr(references, name)[read] for name in ("object", "position", "normal", "value", "noise")}
    baked = SimpleNamespace(atlas=known.atlas, pages=list(np.load(pages)))
    found = compare(baked, known.scene, replace(references, **parts))
    return {"error": found.rms, "bias": found.bias, "percentile_99": found.percentile_99, "noise": found.noise}


def run_match(match: Match, budget: float, repeat: int, threads: int) -> dict[str, Any]:
    """Measure one scene; prints as it goes."""
    blend = PLANS[match.scene].folder / f"{match.scene}.blend"
    references = References.load(REFERENCES / f"{match.scene}.npz")
    if fingerprint(blend) != references.scene:
        raise SystemExit(f"{blend.name} has changed: run tests/accuracy/make_references.py {match.scene}")
    with tempfile.TemporaryDirectory() as folder:
        prepared, pages = Path(folder) / "prepared.pickle", Path(folder) / "pages.npy"
        shared = {**vars(match), "threads": threads}
        found: dict[str, Any] = {
            **vars(match),
            **task_done({**shared, "work": "prepare", "file": str(prepared)}),
            "probes": len(references.value),
            "ours": [],
            "cycles": [],
        }
        print(f"\n{match.title} ({match.scene}): {found['triangles']:,} triangles, {page_words(found)}", flush=True)
        print(f"  Cycles bakes {'joined surfaces' if found['joined'] else 'on a white mesh'}", flush=True)
        for quality in QUALITIES:
            task = {**shared, "work": "ours", "quality": quality, "repeat": repeat, "file": str(pages)}
            bake = task_done(task)
            if bake["atlas"] != found["atlas"]:
                raise SystemExit(f"{match.scene}: two unwraps of the same scene differ")
            bake |= errors_of(pages, prepared, references)
            found["ours"].append(bake)
            print(f"  {row_of(quality, bake)}, {bake['rays']:,} rays", flush=True)
        samples = 1
        while samples <= MOST_SAMPLES and expected_seconds(found["cycles"], samples) <= budget:
            task = {**shared, "work": "cycles", "prepared": str(prepared), "samples": samples, "file": str(pages)}
            bake = task_done(task)
            bake |= errors_of(pages, prepared, references)
            print(f"  {row_of(f'Cycles, {samples}', bake)}", flush=True)
            for name, clean in bake["filters"].items():
                clean |= errors_of(Path(f"{pages}.{name}.npy"), prepared, references)
                print(f"    {row_of(name, {**clean, 'seconds': clean['seconds'] + bake['seconds']})}", flush=True)
            found["cycles"].append(bake)
            samples *= 2
    return found


def task_done(task: dict[str, Any]) -> dict[str, Any]:
    """A task that has no limit of time."""
    found = run_task(__file__, task)
    assert found is not None
    return found


def expected_seconds(bakes: list[dict[str, Any]], samples: int) -> float:
    """What a bake of so many samples will take; nothing is known of the first ones."""
    return cost_of(bakes).seconds(samples) if bakes else 0.0


def cost_of(bakes: list[dict[str, Any]]) -> Cost:
    """What Cycles' samples cost."""
    return fit_cost([bake["samples"] for bake in bakes], [bake["seconds"] for bake in bakes])


def noise_of(bakes: list[dict[str, Any]]) -> NoiseFit:
    """What noise raw Cycles has."""
    return fit_noise([bake["samples"] for bake in bakes], [bake["error"] for bake in bakes])


def page_words(found: dict[str, Any]) -> str:
    """3 pages of 512 x 512."""
    pages = f"{found['pages']} page{'s' * (found['pages'] != 1)}"
    unread = f", {found['unread_probes']} of them unread" if found["unread_probes"] else ""
    return f"{pages} of {found['page_size']} x {found['page_size']}, {found['probes']} probes{unread}"


def row_of(name: str, bake: dict[str, Any]) -> str:
    """A line while it runs."""
    text = f"{name:<16}{bake['seconds']:9.2f} s   error {bake['error']:7.2%}, bias {bake['bias']:+.2%}"
    if "process_seconds" in bake:
        beside = f"{bake['megabytes_beside']:.0f} MB beside Blender"
        text += f"; process {bake['process_seconds']:.1f} s, {bake['megabytes']:.0f} MB, {beside}"
    return text


@dataclass(frozen=True)
class Reached:
    """How long a side takes to an error: seconds or None for never, extrapolated or not, and by which settings."""

    seconds: float | None
    extrapolated: bool = False
    how: str = ""

    def __str__(self) -> str:
        if self.seconds is None:
            return f"never{self.how}"
        return f"{'~' * self.extrapolated}{short(self.seconds)} s{self.how}"

    def over(self, ours: Reached) -> str:
        """The ratio to our time, if there is one."""
        if self.seconds is None or ours.seconds is None:
            return "-"
        return f"{'~' * self.extrapolated}{short(self.seconds / ours.seconds)}"


def short(number: float) -> str:
    """Two or three digits that count."""
    return f"{number:.2g}" if number < 10 else f"{number:,.0f}"


def ours_at(found: dict[str, Any], level: float) -> Reached:
    """Our fastest quality that reaches an error."""
    bakes = found["ours"]
    seconds = first_reaching([bake["seconds"] for bake in bakes], [bake["error"] for bake in bakes], level)
    quality = next((bake["quality"] for bake in bakes if bake["seconds"] == seconds), "")
    return Reached(seconds, how=f", {quality}" if quality else "")


def raw_at(found: dict[str, Any], level: float) -> Reached:
    """Raw Cycles, beyond what was measured by its noise."""
    bakes = found["cycles"]
    measured = crossing([bake["seconds"] for bake in bakes], [bake["error"] for bake in bakes], level)
    if measured is not None:
        return Reached(measured)
    fit = noise_of(bakes)
    samples = fit.samples(level)
    if samples is None:
        return Reached(None, how=f", floor {fit.floor:.1%}")
    samples = max(samples, bakes[-1]["samples"])
    return Reached(cost_of(bakes).seconds(samples), extrapolated=True)


def denoised_points(found: dict[str, Any]) -> list[tuple[float, float, int, str]]:
    """Seconds, error, samples and filter of the better filter at each sample count."""
    points = []
    for bake in found["cycles"]:
        name, clean = min(bake["filters"].items(), key=lambda item: item[1]["error"])
        points.append((bake["seconds"] + clean["seconds"], clean["error"], bake["samples"], name))
    return points


def denoised_at(found: dict[str, Any], level: float) -> Reached:
    """Cycles with OIDN, within what was measured."""
    points = denoised_points(found)
    seconds = crossing([point[0] for point in points], [point[1] for point in points], level)
    if seconds is None:
        best = min(points, key=lambda point: point[1])
        return Reached(None, how=f", {best[1]:.1%} at best, {best[2]} samples")
    samples = next(point[2] for point in sorted(points) if point[1] <= level)
    return Reached(seconds, how=f", at most {samples} samples")


def levels_of(found: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """The errors to compare at, with their names: the fixed ones, and what our default quality has."""
    for level in LEVELS:
        yield f"{level:.1%}", level
    medium = next(bake for bake in found["ours"] if bake["quality"] == "medium")
    yield f"{medium['error']:.2%}, our medium", medium["error"]


def ray_costs(bake: dict[str, Any]) -> dict[str, float]:
    """Shares and nanoseconds of processor time a ray, of one of our bakes.

    NumPy's cost is what stages spend outside Embree, over their rays: direct light's over its shadow rays, transport's
    and gather's over those that look for the nearest surface. Closed forms, fits and the like are in it.
    """
    stages = [stage for stage in bake["stages"] if stage["name"] != "Unwrap"]
    tracing = [stage for stage in stages if stage["name"] in TRACING]
    direct = [stage for stage in stages if stage["name"] == "Direct light"]

    def total(parts: list[dict[str, Any]], *names: str) -> float:
        return float(sum(stage[name] for stage in parts for name in names))

    def outside(parts: list[dict[str, Any]]) -> float:
        return total(parts, "processor") - total(parts, "closest_seconds", "shadow_seconds")

    return {
        "share": total(stages, "closest_seconds", "shadow_seconds") / total(stages, "processor"),
        "closest": 1e9 * total(stages, "closest_seconds") / max(total(stages, "closest"), 1),
        "shadow": 1e9 * total(stages, "shadow_seconds") / max(total(stages, "shadow"), 1),
        "numpy_closest": 1e9 * outside(tracing) / max(total(tracing, "closest"), 1),
        "numpy_shadow": 1e9 * outside(direct) / max(total(direct, "shadow"), 1),
    }


def show(log: dict[str, Any]) -> None:
    """Print the comparison."""
    print(f"\n{log['machine']}; budget {log['budget']:g} s a bake; {log['date']}")
    for found in log["scenes"]:
        fit, cost, first = noise_of(found["cycles"]), cost_of(found["cycles"]), found["cycles"][0]
        print(f"\n{found['title']} ({found['scene']}), {page_words(found)}, {found['ours'][0]['texels']:,} texels")
        print(f"  raw Cycles: error^2 = ({fit.noise:.1%})^2 / samples + ({fit.floor:.2%})^2")
        print(
            f"  its bakes: {cost.each:.3f} s a sample; of one sample {first['seconds']:.2f} s, setup {cost.start:.2f} s"
        )
        print(f"  unwrap {found['unwrap_seconds']:.2f} s, apart, for both")
        for bake in found["ours"]:
            costs = ray_costs(bake)
            print(
                f"  {bake['quality']:<7}{bake['rays']:>12,} rays, {costs['share']:.0%} of processor time in Embree, "
                f"{costs['closest']:.0f} and {costs['shadow']:.0f} ns a closest hit and shadow ray; "
                f"NumPy {costs['numpy_closest']:.0f} and {costs['numpy_shadow']:.0f} ns"
            )
        print(f"  {'error':<18}{'ours':<18}{'Cycles raw':<22}{'ratio':<9}{'Cycles with OIDN':<36}{'ratio':<8}")
        for name, level in levels_of(found):
            ours, raw, clean = ours_at(found, level), raw_at(found, level), denoised_at(found, level)
            print(f"  {name:<18}{ours!s:<18}{raw!s:<22}{raw.over(ours):<9}{clean!s:<36}{clean.over(ours):<8}")


def markdown(log: dict[str, Any]) -> str:
    """Tables for the README."""
    lines = ["| scene, texels | error | ours | Cycles | ratio | Cycles and OIDN | ratio |", "| --- " * 7 + "|"]
    for found in log["scenes"]:
        scene = f"{found['title']}, {found['ours'][0]['texels']:,}"
        for name, level in levels_of(found):
            ours, raw, clean = ours_at(found, level), raw_at(found, level), denoised_at(found, level)
            cells = (scene, name, ours, raw, raw.over(ours), clean, clean.over(ours))
            lines.append("| " + " | ".join(str(cell) for cell in cells) + " |")
            scene = ""
    lines += ["", "| scene | side | bake | process | peak memory, beside Blender | error, bias |", "| --- " * 6 + "|"]
    for found in log["scenes"]:
        sides = [(f"ours, {bake['quality']}", bake) for bake in found["ours"]]
        sides.append((f"Cycles, {found['cycles'][-1]['samples']} samples", found["cycles"][-1]))
        for name, bake in sides:
            lines.append(
                f"| {found['title']} | {name} | {short(bake['seconds'])} s | {short(bake['process_seconds'])} s | "
                f"{bake['megabytes']:.0f} MB, {bake['megabytes_beside']:.0f} MB | "
                f"{bake['error']:.2%}, {bake['bias']:+.2%} |"
            )
    lines += ["", "| scene, medium | rays | in Embree | ns a closest hit, NumPy's | ns a shadow ray, NumPy's |"]
    lines.append("| --- " * 5 + "|")
    for found in log["scenes"]:
        bake = next(bake for bake in found["ours"] if bake["quality"] == "medium")
        costs = ray_costs(bake)
        lines.append(
            f"| {found['title']} | {bake['rays']:,} | {costs['share']:.0%} | {costs['closest']:.0f}, "
            f"{costs['numpy_closest']:.0f} | {costs['shadow']:.0f}, {costs['numpy_shadow']:.0f} |"
        )
    return "\n".join(lines)


def draw(log: dict[str, Any], picture: Path) -> None:
    """Time against error, a panel a scene."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import FuncFormatter

    scenes = log["scenes"]
    across = min(len(scenes), 3)
    down = -(-len(scenes) // across)
    figure, axes = plt.subplots(down, across, figsize=(4.2 * across, 3.7 * down), squeeze=False, sharey=True)
    for axis in axes.flat[len(scenes) :]:
        axis.axis("off")
    for axis, found in zip(axes.flat, scenes, strict=False):
        raw = [(bake["seconds"], 100 * bake["error"]) for bake in found["cycles"]]
        fit, cost = noise_of(found["cycles"]), cost_of(found["cycles"])
        last = found["cycles"][-1]["samples"]
        more = np.geomspace(last, max(1.0, fit.samples(LEVELS[-1]) or 64 * last, last), 40)
        axis.plot([cost.seconds(n) for n in more], [100 * fit.error(n) for n in more], ":", color="#b0413e", lw=1.4)
        axis.plot(*zip(*raw, strict=True), "o-", color="#b0413e", ms=3.5, label="Cycles (dotted: extrapolated)")
        clean = [(point[0], 100 * point[1]) for point in denoised_points(found)]
        axis.plot(*zip(*clean, strict=True), "s-", color="#d98e2b", ms=3.5, label="Cycles, denoised by OIDN")
        ours = [(bake["seconds"], 100 * bake["error"]) for bake in found["ours"]]
        axis.plot(*zip(*ours, strict=True), "D-", color="#23679a", ms=5.5, label="ours: draft, medium, high")
        for level in LEVELS:
            axis.axhline(100 * level, color="0.75", lw=0.8, zorder=0)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_title(f"{found['title']}, {found['ours'][0]['texels'] / 1000:,.0f}k texels", fontsize=10)
        plain = FuncFormatter(lambda value, _: f"{value:g}")
        axis.xaxis.set_major_formatter(plain)
        axis.set_yticks([0.5, 1, 1.5, 2.5, 5, 10, 20, 50])
        axis.yaxis.set_major_formatter(plain)
        axis.minorticks_off()
        axis.spines[["top", "right"]].set_visible(False)
        axis.set_xlabel("seconds of a bake")
    for row in axes:
        row[0].set_ylabel("RMS error, % of the mean")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncols=across, frameon=False, fontsize=9)
    figure.tight_layout(rect=(0, 0, 1, 1 - (0.15 + 0.2 * (3 / across)) / (3.7 * down)))
    picture.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(picture, dpi=130)
    plt.close(figure)


def write_log(log: dict[str, Any], path: Path) -> None:
    """Keep what was measured."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(log, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Measure, print, draw."""
    if answer_task(lambda task: {"prepare": prepare, "ours": bake_ours, "cycles": bake_cycles}[task["work"]](task)):
        return
    names = [match.scene for match in MATCHES]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--scene", action="append", choices=names, help="only this one; may be repeated")
    parser.add_argument("--budget", type=float, default=300.0, metavar="SECONDS", help="of a bake of Cycles, at most")
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="bakes of ours, the median counts")
    parser.add_argument("--threads", type=int, default=2, metavar="N", help="of both sides; default: 2")
    parser.add_argument("--quick", action="store_true", help="the Cornell box on a small page, a budget of 10 s")
    parser.add_argument("--log", type=Path, metavar="FILE.json", help="measure nothing: show what an earlier run found")
    parser.add_argument("--markdown", action="store_true", help="also as tables to paste")
    parser.add_argument("--publish", action="store_true", help="put log and picture into benchmarks/results/ and docs/")
    options = parser.parse_args()
    if options.log:
        log = json.loads(options.log.read_text(encoding="utf-8"))
    else:
        budget = min(options.budget, 10.0) if options.quick else options.budget
        matches = [match for match in MATCHES if match.scene in (options.scene or names)]
        log = {"machine": machine(), "date": time.strftime("%Y-%m-%d"), "budget": budget, "threads": options.threads}
        log["scenes"] = []
        for match in [QUICK] if options.quick else matches:
            log["scenes"].append(run_match(match, budget, options.repeat, options.threads))
            write_log(log, LOG)
    show(log)
    if options.markdown:
        print("\n" + markdown(log))
    picture = LOG.with_suffix(".png")
    draw(log, picture)
    print(f"\nPicture: {picture}" + ("" if options.log else f"\nLog:     {LOG}"))
    if options.publish:
        write_log(log, PUBLISHED_LOG)
        shutil.copyfile(picture, PUBLISHED_PICTURE)


if __name__ == "__main__":
    main()
