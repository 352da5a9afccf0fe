# SPDX-License-Identifier: GPL-3.0-or-later
"""Error of each estimator of form factors over its cost: `python benchmarks/form_factors.py [--picture FILE.png]`.

Three cases with known answers, each of two unit squares cut into 8 x 8 patches: what each patch of one sends to the
whole of the other, by the closed form for a point integrated over the patch. The estimate is the raw one, before it is
balanced. Cost is the rays that were traced, and the seconds; the best of three runs.

With --bakes also whole bakes of two sample scenes by each estimator and solver, against what Cycles measured.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

from benchmarks.speed import machine  # noqa: E402
from radiosity_addon.chunks import finish  # noqa: E402
from radiosity_addon.geometry.visibility import Visibility  # noqa: E402
from radiosity_addon.lighting.polygons import convex_polygon, polygon_light  # noqa: E402
from radiosity_addon.radiosity.form_factor import HemicubeRays, NusseltRays, trace_view  # noqa: E402
from radiosity_addon.radiosity.pairs import exchange_of_pairs  # noqa: E402
from tests.rooms import Facets, joined, rectangle  # noqa: E402

CUTS = 8
SQUARE = ((0, 0, 0), (1, 0, 0), (0, 1, 0))
CASES = {
    "parallel, distance 1": ((0, 0, 1), (0, 1, 0), (1, 0, 0)),
    "parallel, distance 0.25": ((0, 0, 0.25), (0, 1, 0), (1, 0, 0)),
    "common edge": ((0, 0, 0), (0, 1, 0), (0, 0, 1)),
}
GAUSS = 12
REPEATS = 3
RAYS = (16, 64, 256, 1024, 4096)
RESOLUTIONS = (2, 4, 10, 18, 36)
POINTS = (1, 4, 16, 64, 256)


@dataclass(frozen=True)
class Point:
    """One setting of an estimator: rays, seconds, and the root mean square error of the 64 form factors."""

    rays: int
    seconds: float
    error: float


def exact(patches: Facets, target: tuple) -> np.ndarray:
    """(64,) form factor of each patch of the first square to the whole second one."""
    node, weight = np.polynomial.legendre.leggauss(GAUSS)
    node, weight = (node + 1) / 2, weight / 2
    u, v = (part.ravel() for part in np.meshgrid(node, node))
    share = np.outer(weight, weight).ravel()
    corner, edge_u, edge_v = (np.array(part, float) for part in target)
    square = convex_polygon(np.array([corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v]), True)
    found = np.empty(CUTS**2)
    for patch in range(CUTS**2):
        spots = patches.origin[patch] + u[:, None] * patches.edge_u[patch] + v[:, None] * patches.edge_v[patch]
        normals = np.repeat(patches.normal[[patch]], len(spots), axis=0)
        found[patch] = polygon_light(square, spots.astype(np.float32), normals) @ share / np.pi
    return found


def by_rays(pattern: NusseltRays | HemicubeRays, patches: Facets, visibility: Visibility) -> np.ndarray:
    """(64,) form factors to the second square, by rays."""
    view = finish(trace_view(patches, pattern, visibility, 1))[0]
    ray = np.flatnonzero(view.target >= CUTS**2)
    weight = view.weight(ray)
    met = np.bincount(view.source[ray], weights=weight, minlength=patches.count)
    return (met / view.rays)[: CUTS**2]


def by_pairs(points: int, patches: Facets, visibility: Visibility) -> np.ndarray:
    """(64,) form factors to the second square, by pairs of points."""
    first, _, exchange, _ = finish(exchange_of_pairs(patches, visibility, points, 1))
    return np.array([exchange[first[row] : first[row + 1]].sum() for row in range(CUTS**2)]) / patches.area[: CUTS**2]


def measure(estimate: Callable[[Visibility], np.ndarray], patches: Facets, expected: np.ndarray) -> Point:
    """Run one estimate a few times."""
    seconds = []
    for _ in range(REPEATS):
        visibility = Visibility(patches.corners())
        start = time.perf_counter()
        found = estimate(visibility)
        seconds.append(time.perf_counter() - start)
    return Point(visibility.rays, min(seconds), float(np.sqrt(np.mean((found - expected) ** 2)) / expected.mean()))


def plot(results: dict[str, dict[str, list[Point]]], path: Path) -> None:
    """Error over rays, a case each."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, len(results), figsize=(5 * len(results), 4), sharey=True, squeeze=False)
    for axis, (case, curves) in zip(axes[0], results.items(), strict=True):
        for name, points in curves.items():
            axis.plot([point.rays for point in points], [point.error for point in points], "o-", label=name)
        axis.set(xscale="log", yscale="log", title=case, xlabel="rays traced")
        axis.grid(alpha=0.3)
    axes[0][0].set_ylabel("error, RMS over mean")
    axes[0][-1].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=110)


BAKES = [
    *(
        ("nusselt", solver, quality)
        for solver in ("progressive", "conjugate-gradient")
        for quality in ("draft", "medium", "high")
    ),
    *(("hemicube", "progressive", quality) for quality in ("draft", "medium", "high")),
    *(("area", "progressive", quality) for quality in ("draft", "medium", "high")),
]
"""Estimator, solver and quality of whole bakes."""


def bakes() -> None:
    """Print seconds of transport, solver and whole bakes, and their errors against Cycles."""
    import bpy

    from radiosity_addon.bake import bake
    from radiosity_addon.blender.reading.extract import extract_scene
    from radiosity_addon.settings import BakeSettings
    from tests.accuracy.comparison import compare
    from tests.accuracy.probes import References

    for scene_name, size in (("cornell_box", 512), ("window_room", 512)):
        bpy.ops.wm.open_mainfile(filepath=str(ROOT / "sample_scenes" / f"{scene_name}.blend"))
        scene = extract_scene(bpy.context.scene).scene
        references = References.load(ROOT / "tests" / "accuracy" / "references" / f"{scene_name}.npz")
        print(f"{scene_name}, page {size}: seconds of transport, solver and all, error against Cycles")
        for form_factors, solver, quality in BAKES:
            settings = BakeSettings(page_size=size, quality=quality, form_factors=form_factors, solver=solver)
            runs = [finish(bake(scene, settings)) for _ in range(REPEATS)]
            seconds = [{stage.name: stage.seconds for stage in run.stages} for run in runs]
            parts = [min(each[name] for each in seconds) for name in ("Transport", "Radiosity")]
            whole = min(sum(each.values()) for each in seconds)
            found = compare(runs[0], scene, references)
            print(
                f"  {form_factors:9} {solver:19} {quality:7}{runs[0].patches:7,} patches "
                f"{parts[0]:7.2f} {parts[1]:7.2f} {whole:7.2f} s  RMS {found.rms:6.2%}, bias {found.bias:+.2%}",
                flush=True,
            )


def main() -> None:
    """Print the tables and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--picture", type=Path, default=ROOT / "out" / "form_factors.png")
    parser.add_argument("--bakes", action="store_true", help="also bake, minutes longer")
    options = parser.parse_args()
    options.picture.parent.mkdir(parents=True, exist_ok=True)
    print(f"Rays, ms and relative RMS error; {machine()}")
    results: dict[str, dict[str, list[Point]]] = {}
    for case, target in CASES.items():
        patches = Facets(*joined(rectangle(*SQUARE, CUTS), rectangle(*target, CUTS)))
        expected = exact(patches, target)
        settings: dict[str, list[Callable[[Visibility], np.ndarray]]] = {
            "nusselt": [partial(by_rays, NusseltRays(number), patches) for number in RAYS],
            "hemicube": [partial(by_rays, HemicubeRays(number), patches) for number in RESOLUTIONS],
            "area": [partial(by_pairs, number, patches) for number in POINTS],
        }
        results[case] = {
            name: [measure(each, patches, expected) for each in estimates] for name, estimates in settings.items()
        }
        print(case)
        for name, points in results[case].items():
            print(f"  {name:10}" + "  ".join(f"{p.rays:>8,} {1e3 * p.seconds:6.1f} {p.error:8.3%}" for p in points))
            order = np.polyfit(np.log([p.rays for p in points]), np.log([p.error for p in points]), 1)[0]
            print(f"  {'':10}error falls as rays^{order:.2f}")
    plot(results, options.picture)
    if options.bakes:
        bakes()
    print(f"Picture: {options.picture}")


if __name__ == "__main__":
    main()
