# SPDX-License-Identifier: GPL-3.0-or-later
"""Let Cycles measure the sample scenes at probe points, once: `python make_references.py [SCENE ...]`.

Runs on one thread for minutes; the results are committed in references/.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from tests.accuracy.cycles_judge import measure
from tests.accuracy.probes import (
    LUMINANCE,
    POINTS,
    Probes,
    References,
    extent,
    fingerprint,
    footprints,
    middles,
    place,
    rendered_surfaces,
)

DARK_SHARE = 5e-3
"""Points below this share of the mean lie under something that stands on the surface, and are left out."""
HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]


@dataclass(frozen=True)
class Plan:
    """How a scene is measured.

    Attributes:
        footprint: edge of a texel at the page size that the suite bakes with, m
        samples: of a seed and point
        count: probes
        seeds: their number
        inside: (2, 3), the box that holds the probes, m, or None; of rooms with a window, the room: on its reveal and
            outside it is day, and a share of the room's mean would say nothing
        without: objects that get no probes
        folder: where the .blend lies
    """

    footprint: float
    samples: int
    count: int = 200
    seeds: int = 4
    inside: np.ndarray | None = None
    without: tuple[str, ...] = ()
    folder: Path = HERE / "scenes"


SAMPLES = ROOT / "sample_scenes"

MONITORS = ("Monitor", *(f"Monitor {number}" for number in range(2, 7)))
"""Their fronts lie inside of lit screens, where it is not dark."""

PLANS = {
    "cornell_box": Plan(0.016, 1024, folder=SAMPLES),
    "window_room": Plan(0.016, 1024, count=160, folder=SAMPLES, inside=np.array([[0.0, 0.0, 0.0], [4.0, 5.0, 2.7]])),
    "interior": Plan(
        0.0125, 1024, count=300, folder=SAMPLES, inside=np.array([[-0.2, -0.01, -0.01], [6.01, 5.01, 2.81]])
    ),
    "attic": Plan(0.017, 512, inside=np.array([[-0.01, -0.01, -0.01], [5.01, 6.01, 3.31]])),
    "office": Plan(0.026, 512, count=160, without=(*MONITORS, "Desk Lamp Hood 1", "Desk Lamp Hood 2")),
    "gallery": Plan(0.025, 768, count=160),
    "stair_hall": Plan(0.017, 384, count=160),
    "studio": Plan(0.0155, 384, count=160),
    "pergola": Plan(0.01, 512, without=("Leaves", "Stained Glass", "Curtain", "Case")),
    "court": Plan(0.0335, 384, count=180, inside=np.array([[0.0, 0.0, -0.1], [12.0, 12.0, 4.3]])),
    "bar": Plan(0.016, 384, count=160),
    "dining": Plan(0.0255, 384, count=200),
    "pavilion": Plan(0.0165, 384, count=180),
    "aces_box": Plan(0.016, 384, count=160),
    "level": Plan(1 / 16.5, 1024, count=250, inside=np.array([[0.0, 0.0, -0.003], [18.61, 24.01, 3.21]])),
}


def make_references(
    blend: Path,
    count: int,
    footprint: float,
    samples: int,
    seeds: list[int],
    inside: np.ndarray | None = None,
    without: Collection[str] = (),
) -> References:
    """Open a .blend and let Cycles measure the light at `count` places of it.

    Args:
        footprint: edge of the square that each is the mean over, m
        samples: of a seed and point; there are POINTS points to a place
        inside, without: as for `place`
    """
    import bpy

    bpy.ops.wm.open_mainfile(filepath=str(blend))
    surfaces = rendered_surfaces()
    probes = place(surfaces, count, inside, without)
    squares = footprints(surfaces, probes, footprint)
    there = squares.there
    name = np.repeat(probes.object[:, None], POINTS, axis=1)
    flat = Probes(name[there], squares.points[there], squares.normals[there])
    shading, edge = squares.shading[there], footprint / math.sqrt(POINTS)
    measured, seconds = measure(flat, extent(surfaces), samples, seeds, 1, shading, squares.hosts, edge)
    values = np.zeros((len(seeds), *squares.points.shape))
    values[:, there] = measured
    luminance = values.mean(axis=0) @ LUMINANCE
    lit = there & (luminance > DARK_SHARE * luminance[there].mean())
    kept = lit.any(axis=1)
    means = (values * lit[:, :, None]).sum(axis=2)[:, kept] / lit.sum(axis=1)[kept, None]
    return References(
        object=probes.object[kept],
        position=middles(surfaces, probes, squares, lit, footprint)[kept],
        normal=probes.normal[kept],
        value=means.mean(axis=0),
        noise=means.std(axis=0, ddof=1) / math.sqrt(len(seeds)),
        footprint=footprint,
        scene=fingerprint(blend),
        samples=samples,
        seeds=np.array(seeds),
        seconds=np.array(seconds),
        left_out=int((~kept).sum()),
        blender=bpy.app.version_string,
    )


def main(names: list[str]) -> None:
    for name in names or list(PLANS):
        plan = PLANS[name]
        made = make_references(
            plan.folder / f"{name}.blend",
            plan.count,
            plan.footprint,
            plan.samples,
            list(range(1, plan.seeds + 1)),
            plan.inside,
            plan.without,
        )
        made.save(HERE / "references" / f"{name}.npz")
        sys.stdout.write(
            f"{name}: {len(made.value)} probes, {made.left_out} dark ones left out, "
            f"noise {made.relative_noise:.2%}, {made.seconds.sum():.0f} s\n"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
