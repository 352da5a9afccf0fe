# SPDX-License-Identifier: GPL-3.0-or-later
"""What the comparison with Cycles says of times that were measured, and of those that were not."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks._versus_tables import denoised_at, ours_at, raw_at, ray_costs


def cycles(samples: int, error: float, clean: float) -> dict[str, Any]:
    """A bake of one second and a tenth a sample, and what each filter makes of it in two seconds."""
    return {
        "samples": samples,
        "seconds": 1 + 0.1 * samples,
        "error": error,
        "filters": {"RT": {"seconds": 2.0, "error": clean}, "RTLightmap": {"seconds": 2.0, "error": clean + 0.01}},
    }


FOUND: dict[str, Any] = {
    "ours": [
        {"quality": "draft", "seconds": 0.5, "error": 0.03},
        {"quality": "medium", "seconds": 1.0, "error": 0.02},
        {"quality": "high", "seconds": 4.0, "error": 0.01},
    ],
    "cycles": [cycles(count, 0.4 / count**0.5, 0.1 / count**0.5) for count in (1, 4, 16)],
}


def test_ours_is_the_fastest_quality_that_reaches_the_error() -> None:
    assert str(ours_at(FOUND, 0.025)) == "1 s, medium"


def test_what_raw_cycles_was_not_baked_to_is_extrapolated_and_marked() -> None:
    found = raw_at(FOUND, 0.01)
    assert found.seconds == pytest.approx(161.0)
    assert str(found) == "~161 s"
    assert found.over(ours_at(FOUND, 0.01)) == "~40"


def test_what_raw_cycles_was_baked_to_is_not_marked() -> None:
    assert str(raw_at(FOUND, 0.1)) == "2.6 s"


def test_raw_cycles_with_a_floor_above_the_error_never_reaches_it() -> None:
    stuck = {**FOUND, "cycles": [cycles(count, (0.16 / count + 9e-4) ** 0.5, 0.1) for count in (1, 4, 16, 64, 256)]}
    assert str(raw_at(stuck, 0.02)) == "never, floor 3.0%"


def test_the_denoiser_is_not_extrapolated() -> None:
    assert denoised_at(FOUND, 0.01).seconds is None


def test_the_denoiser_takes_its_better_filter_and_its_own_time() -> None:
    assert denoised_at(FOUND, 0.05).seconds == pytest.approx(1.4 + 2.0)


def test_costs_of_rays_are_of_the_stages_that_trace_them() -> None:
    none = {"closest": 0, "closest_seconds": 0.0, "shadow": 0, "shadow_seconds": 0.0}
    stages = [
        {**none, "name": "Unwrap", "seconds": 9.0, "processor": 9.0},
        {**none, "name": "Direct light", "seconds": 1.0, "processor": 2.0, "shadow": 10**7, "shadow_seconds": 1.0},
        {**none, "name": "Gather", "seconds": 2.0, "processor": 4.0, "closest": 10**7, "closest_seconds": 1.0},
    ]
    found = ray_costs({"stages": stages})
    assert found == pytest.approx(
        {"share": 2 / 6, "closest": 100.0, "shadow": 100.0, "numpy_closest": 300.0, "numpy_shadow": 100.0}
    )
