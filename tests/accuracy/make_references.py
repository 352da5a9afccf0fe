# SPDX-License-Identifier: GPL-3.0-or-later
"""Let Cycles measure the sample scenes at probe points, once: `python make_references.py [SCENE ...]`.

Runs on one thread for minutes; the results are committed in references/.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from tests.accuracy.probes import make_references

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]


@dataclass(frozen=True)
class Plan:
    """Probes, samples of a seed, seeds, and the box that holds the probes, m."""

    count: int
    samples: int
    seeds: int
    inside: np.ndarray | None = None


PLANS = {
    "cornell_box": Plan(400, 32768, 8),
    "window_room": Plan(400, 65536, 8, np.array([[0.0, 0.0, 0.0], [4.0, 5.3, 2.7]])),
}


def main(names: list[str]) -> None:
    for name in names or list(PLANS):
        plan = PLANS[name]
        made = make_references(
            ROOT / "sample_scenes" / f"{name}.blend",
            plan.count,
            plan.samples,
            list(range(1, plan.seeds + 1)),
            plan.inside,
        )
        made.save(HERE / "references" / f"{name}.npz")
        sys.stdout.write(
            f"{name}: {len(made.value)} probes, {made.left_out} dark ones left out, "
            f"noise {made.relative_noise:.2%}, {made.seconds.sum():.0f} s\n"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
