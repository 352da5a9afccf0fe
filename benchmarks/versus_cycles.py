# SPDX-License-Identifier: GPL-3.0-or-later
"""Time against error of our bakes and of Cycles', raw and denoised by OIDN: `python benchmarks/versus_cycles.py`.

Both bake the same scenes, in the same run, onto the same pages with the same uv map, ours; both pages are read alike at
the probes of tests/accuracy/, and errors are the suite's: root mean squares of the luminance's errors over the probes,
as shares of the mean, without probes that another object stands beside. Every bake has a process of its own.

Ours are the three qualities, median of the repeats, without the unwrap. Cycles runs as fast as it can: one bake for all
surfaces (see _cycles_pages.py), light tree, Russian roulette, nothing clamped, 128 bounces; adaptive sampling changes
nothing in bakes. Its samples double until the next bake would take longer than the budget. Beyond, raw Cycles is
extrapolated by samples^-1/2 from its last three bakes, and marked so (~); a floor of its error, which the reading of
texels and the reference's noise make, only counts where its last bake is nearly there. OIDN is never extrapolated.
Denoised are pages after each of its two filters, the better one counts. Between measured sample counts both are
interpolated; our qualities are not.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks._processes import answer_task, run_task, write_log  # noqa: E402
from benchmarks._versus_tables import cost_of, draw, markdown, page_words, show  # noqa: E402
from benchmarks._versus_tasks import REFERENCES, bake_cycles, bake_ours, errors_of, prepare  # noqa: E402
from benchmarks.speed import machine  # noqa: E402
from radiosity_addon.settings import QUALITIES  # noqa: E402
from tests.accuracy.make_references import PLANS  # noqa: E402
from tests.accuracy.probes import References, fingerprint  # noqa: E402

MOST_SAMPLES = 1 << 14
TASKS = {"prepare": prepare, "ours": bake_ours, "cycles": bake_cycles}
LOG = ROOT / "out" / "bench" / "versus_cycles.json"
PUBLISHED_LOG = ROOT / "benchmarks" / "results" / "versus_cycles.json"
PUBLISHED_PICTURE = ROOT / "docs" / "pictures" / "versus_cycles.png"


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
    Match("level", "level", 512, 16.5),
    Match("court", "outdoors", 1024),
    Match("studio", "textures", 768),
)
QUICK = Match("cornell_box", "Cornell box", 256)


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


def row_of(name: str, bake: dict[str, Any]) -> str:
    """A line while it runs."""
    text = f"{name:<16}{bake['seconds']:9.2f} s   error {bake['error']:7.2%}, bias {bake['bias']:+.2%}"
    if "process_seconds" in bake:
        beside = f"{bake['megabytes_beside']:.0f} MB beside Blender"
        text += f"; process {bake['process_seconds']:.1f} s, {bake['megabytes']:.0f} MB, {beside}"
    return text


def main() -> None:
    """Measure, print, draw."""
    if answer_task(lambda task: TASKS[task["work"]](task)):
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
