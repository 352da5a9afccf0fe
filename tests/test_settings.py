# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user may choose, and what is refused with a remedy."""

from __future__ import annotations

import math
import os
from dataclasses import FrozenInstanceError, fields, replace

import pytest

from radiosity_addon.errors import SettingsError
from radiosity_addon.settings import MAX_PAGE_SIZE, QUALITIES, QUALITY_STEPS, BakeSettings, Quality, usable_processors


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *[("density", value) for value in (0, -1, math.nan, math.inf, -math.inf)],
        *[("page_size", value) for value in (0, 15, MAX_PAGE_SIZE + 1, -1024)],
        *[("quality", value) for value in ("", "ultra", "Medium")],
        *[("tolerance", value) for value in (0, -1e-4, 1, 2, math.nan, math.inf, 1e-9)],
        *[("threads", value) for value in (-1, 1025)],
    ],
)
def test_a_value_out_of_range_is_refused_by_name_with_a_remedy(name: str, value: object) -> None:
    with pytest.raises(SettingsError) as error:
        BakeSettings(**{name: value})
    assert error.value.subject.lower() == name.replace("_", " ")
    assert str(value) in error.value.cause
    assert error.value.remedy


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *[("density", value) for value in (None, 1e-3, 1e6)],
        *[("page_size", value) for value in (16, 100, MAX_PAGE_SIZE)],
        *[("quality", value) for value in QUALITIES],
        *[("tolerance", value) for value in (1e-8, 0.999)],
        *[("threads", value) for value in (0, 1, 1024)],
    ],
)
def test_the_ends_of_each_range_are_taken(name: str, value: object) -> None:
    assert getattr(BakeSettings(**{name: value}), name) == value


def test_values_are_checked_again_when_one_is_replaced() -> None:
    with pytest.raises(SettingsError, match="Page size"):
        replace(BakeSettings(), page_size=3)


def test_settings_can_not_be_changed_during_a_bake() -> None:
    with pytest.raises(FrozenInstanceError):
        BakeSettings().tolerance = 0.5


def test_no_number_of_threads_means_all_processors_that_may_be_used() -> None:
    assert BakeSettings().workers == usable_processors()
    assert BakeSettings(threads=3).workers == 3
    assert 1 <= usable_processors() <= (os.cpu_count() or 1)


def test_every_quality_has_numbers_and_a_better_one_never_smaller_ones() -> None:
    assert list(QUALITY_STEPS) == list(QUALITIES)
    finer = {"gather_spacing": -1, "lamp_error": -1}  # less is more
    for field in fields(Quality):
        if field.name == "gather_split":
            continue  # points of high quality are close together; split sooner, they would get too few rays each
        values = [finer.get(field.name, 1) * getattr(QUALITY_STEPS[name], field.name) for name in QUALITIES]
        assert values == sorted(values), field.name
    assert all(BakeSettings(quality=name).steps is QUALITY_STEPS[name] for name in QUALITIES)
