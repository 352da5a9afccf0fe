# SPDX-License-Identifier: GPL-3.0-or-later
"""What `versus_cycles.py` has measured, as text, tables for the README, and a picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._curves import Cost, NoiseFit, crossing, first_reaching, fit_cost, fit_noise, noise_to_extrapolate

LEVELS = (0.025, 0.015)
"""Errors at which times are compared."""
TRACING = ("Transport", "Gather")
"""Stages whose rays look for the nearest surface."""


def cost_of(bakes: list[dict[str, Any]]) -> Cost:
    """What Cycles' samples cost."""
    return fit_cost([bake["samples"] for bake in bakes], [bake["seconds"] for bake in bakes])


def noise_of(bakes: list[dict[str, Any]]) -> NoiseFit:
    """What noise raw Cycles has, to be extrapolated."""
    return noise_to_extrapolate([bake["samples"] for bake in bakes], [bake["error"] for bake in bakes])


def page_words(found: dict[str, Any]) -> str:
    """3 pages of 512 x 512."""
    pages = f"{found['pages']} page{'s' * (found['pages'] != 1)}"
    return f"{pages} of {found['page_size']} x {found['page_size']}, {found['probes']} probes"


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
        whole = fit_noise([bake["samples"] for bake in found["cycles"]], [bake["error"] for bake in found["cycles"]])
        print(f"  raw Cycles: error^2 = ({whole.noise:.1%})^2 / samples + ({whole.floor:.2%})^2 over all runs")
        print(f"  extrapolated by ({fit.noise:.1%})^2 / samples + ({fit.floor:.2%})^2")
        path = 1e9 * cost.each / found["ours"][0]["texels"]
        print(
            f"  its bakes: setup {cost.start:.2f} s (with one sample {first['seconds']:.2f} s), {path:,.0f} ns a path"
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
