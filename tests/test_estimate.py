# SPDX-License-Identifier: GPL-3.0-or-later
from __future__ import annotations

import pytest

from radiosity_addon.estimate import Pace, about, about_seconds, estimate
from radiosity_addon.settings import QUALITIES, BakeSettings


def test_one_page_is_filled_whatever_the_area() -> None:
    known, unknown = (estimate(area, BakeSettings(page_size=1000)) for area in (100.0, None))
    assert (known.pages, known.texels) == (unknown.pages, unknown.texels) == (1, 770_000)
    assert unknown.density is None
    assert known.density == pytest.approx((770_000 / 100) ** 0.5)


def test_at_a_density_texels_follow_the_area_and_pages_the_texels() -> None:
    found = estimate(100.0, BakeSettings(page_size=100, density=20.0))
    assert (found.texels, found.density) == (40_000, 20.0)
    assert found.pages == 6, "40,000 texels on pages that hold 7,700 each"


def test_every_page_group_has_a_page_of_its_own() -> None:
    assert estimate(None, BakeSettings(page_size=100), groups=3).pages == 3
    assert estimate(0.01, BakeSettings(page_size=100, density=1.0), groups=3).pages == 3


def test_better_qualities_take_longer_and_memory_grows_with_texels() -> None:
    seconds = [estimate(None, BakeSettings(quality=name)).seconds for name in QUALITIES]
    assert seconds == sorted(seconds)
    small, large = (estimate(None, BakeSettings(page_size=size)) for size in (512, 4096))
    assert small.bytes < large.bytes
    assert small.seconds < large.seconds


def test_a_bake_tells_how_long_the_same_bake_takes() -> None:
    texels = estimate(None, BakeSettings()).texels
    stages = [("Read scene", 1.5, 0), ("Unwrap", 2.5, 0), ("Direct light", 20.0, 9), ("Gather", 10.0, 9)]
    pace = Pace.of(stages, texels, "medium")
    assert pace.fixed == 4.0
    assert estimate(None, BakeSettings(), pace=pace).seconds == pytest.approx(34.0)


def test_what_a_scene_takes_whatever_the_quality_is_not_multiplied() -> None:
    pace = Pace(fixed=60.0)
    draft, high = (estimate(None, BakeSettings(quality=name), pace=pace).seconds for name in ("draft", "high"))
    assert 60 < draft < high < 80


def test_faces_that_shine_take_time_for_each_texel_until_they_shine_together() -> None:
    """A gallery of neon tubes, 7,612 triangles: measured 28 processor seconds for 217,000 texels, 81 for 855,000."""
    small, large = (estimate(None, BakeSettings(page_size=size), shining=7612) for size in (512, 1024))
    assert 0.7 < 2 * small.seconds / 28 < 1.3
    assert 0.7 < 2 * large.seconds / 81 < 1.3
    assert estimate(None, BakeSettings(), shining=10**6).seconds < 2 * large.seconds


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (7, "7"),
        (843, "840"),
        (48_462, "48,000"),
        (999_499, "1,000,000"),
        (1_234_567, "1.2 million"),
        (1.5e8, "150 million"),
    ],
)
def test_counts_are_said_in_two_digits(number: float, words: str) -> None:
    assert about(number) == words


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.2, "1 s"), (7.6, "8 s"), (33, "35 s"), (57, "1 min"), (700, "12 min"), (5400, "1.5 h")]
)
def test_times_are_said_as_people_do(seconds: float, words: str) -> None:
    assert about_seconds(seconds) == words
