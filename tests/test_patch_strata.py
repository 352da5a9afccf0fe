# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs stand for the list of all strata: the same strata in the same order."""

import numpy as np
import pytest

from radiosity_addon.indices import numbers_of
from radiosity_addon.radiosity.patch_strata import PatchStrata


def listed(parts, sending, count):
    """The strata of each patch, one by one."""
    found = [[] for _ in range(count)]
    for patch, texel in parts:
        for owner, own in zip(patch, texel, strict=True):
            found[owner] += [4 * own + slot for slot in range(4) if sending[own] >> slot & 1]
    return found


@pytest.mark.parametrize("whole", [0.0, 0.9, 1.0])
@pytest.mark.parametrize("run", [1, 40])
def test_places_lead_to_the_strata_that_a_list_of_all_has_there(whole, run):
    random = np.random.default_rng(3)
    texels, count = 3000, 23
    sending = np.where(random.random(texels) < whole, 15, random.integers(1, 16, texels)).astype(np.uint8)
    front = np.flatnonzero(random.random(texels) < 0.9).astype(np.int32)
    rear = front[random.random(len(front)) < 0.5]
    parts = [
        ((random.integers(0, 12, texels // run + 1)[front // run]).astype(np.int32), front),
        ((12 + random.integers(0, count - 13, texels // run + 1)[rear // run]).astype(np.int32), rear),
    ]  # the last patch has no texel
    strata = PatchStrata.of(parts, sending, count)
    expected = listed(parts, sending, count)
    assert strata.number.tolist() == [len(own) for own in expected]
    assert strata.start.tolist() == np.concatenate([[0], np.cumsum(strata.number)[:-1]]).tolist()
    place = np.arange(strata.number.sum(), dtype=np.int32)
    assert strata.at(place).tolist() == [each for own in expected for each in own]


def test_numbers_of_elements_are_those_of_flatnonzero_in_half_the_bytes():
    chosen = np.random.default_rng(0).random(300_000) < 0.3
    assert np.array_equal(numbers_of(chosen), np.flatnonzero(chosen))
    assert numbers_of(chosen).dtype == np.int32
