# SPDX-License-Identifier: GPL-3.0-or-later
"""What is kept of a page's texels: which patch they were part of, which were invalid."""

import zlib

import numpy as np
import pytest

from radiosity_addon.errors import OutputError
from radiosity_addon.reports.texel_maps import (
    INVALID,
    PATCHED,
    UNPATCHED,
    UNUSED,
    packed,
    patch_count,
    texel_map,
    unpacked,
)
from radiosity_addon.scene import Scene, SunLight
from tests.bakes import WHITE, bake_of, floor
from tests.shapes import box


@pytest.fixture(scope="module")
def baked():
    """A block on a floor: below it texels are invalid."""
    block = box("Block", (-0.5, -0.5, 0), (0.5, 0.5, 1))
    return bake_of(Scene((floor(), block), (WHITE,), (SunLight("Sun", (1, 1, 1), (0, 0, -1)),)))


def test_a_map_tells_of_each_texel_what_the_bake_made_of_it(baked):
    texels = baked.elements
    flat = texel_map(texels, baked.patch, 0).ravel()
    own = flat[texels.pixel]
    assert (own[~texels.valid] == INVALID).all()
    grouped = texels.valid & (baked.patch >= 0)
    np.testing.assert_array_equal(own[grouped], baked.patch[grouped] + PATCHED)
    assert (own[texels.valid & (baked.patch < 0)] == UNPATCHED).all()
    assert np.count_nonzero(flat == UNUSED) == 64 * 64 - texels.count
    assert np.count_nonzero(~texels.valid) > 10


def test_patches_on_a_page_are_no_more_than_there_are(baked):
    count = patch_count([texel_map(baked.elements, baked.patch, 0)])
    assert count == len(np.unique(baked.patch[baked.patch >= 0]))
    assert 100 < count <= baked.patches


def test_packing_keeps_every_number_and_takes_little_room(baked):
    numbers = texel_map(baked.elements, baked.patch, 0)
    data = packed(numbers)
    np.testing.assert_array_equal(unpacked(data), numbers)
    assert len(data) < numbers.nbytes / 5


def test_numbers_of_any_size_survive_packing():
    numbers = np.random.default_rng(3).integers(-(2**31), 2**31, (300, 300)).astype(np.int32)
    np.testing.assert_array_equal(unpacked(packed(numbers)), numbers)


@pytest.mark.parametrize("data", [b"", b"nonsense", packed(np.zeros((4, 4), np.int32))[:-3], zlib.compress(bytes(12))])
def test_broken_bytes_are_refused_with_a_remedy(data):
    with pytest.raises(OutputError, match="Bake again"):
        unpacked(data)
