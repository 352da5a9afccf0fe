# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours that carry a meaning: told apart by every eye, and at round numbers."""

import numpy as np
import pytest

from radiosity_addon.color.difference import ciede2000
from radiosity_addon.color.spaces import REC709, to_lab
from radiosity_addon.color.transfer import srgb_decode
from radiosity_addon.reports.pictures import density_scale, distinct_colors, scale_ends

WITHOUT_A_CONE = {
    "red": [[0.11238, 0.88762, 0], [0.11238, 0.88762, 0], [0.00401, -0.00401, 1]],
    "green": [[0.29275, 0.70725, 0], [0.29275, 0.70725, 0], [-0.02234, 0.02234, 1]],
}
"""What linear RGB becomes to eyes that lack a cone (Vienot, Brettel and Mollon 1999)."""


def lab(colors, eye=None):
    linear = srgb_decode(colors / 255.0)
    if eye:
        linear = np.clip(linear @ np.array(WITHOUT_A_CONE[eye]).T, 0, 1)
    return to_lab(linear @ REC709.to_xyz.T)


@pytest.mark.parametrize("eye", [None, "red", "green"])
def test_too_few_enough_and_too_many_texels_differ_to_every_eye(eye):
    loose, right, dense = lab(density_scale()[[0, 128, 255]], eye)
    for one, other in ((loose, right), (right, dense), (loose, dense)):
        assert ciede2000(one, other) > 12


def test_neighbouring_numbers_have_clearly_different_colors_and_none_is_used_twice():
    colors = distinct_colors(64)
    assert (ciede2000(lab(colors[1:]), lab(colors[:-1])) > 15).all()
    assert len(np.unique(colors, axis=0)) == 64


def test_scale_ends_hold_almost_all_light_at_thirds_of_powers_of_ten():
    light = np.geomspace(3, 700, 5000, dtype=np.float32)
    low, high = scale_ends([light[::2], light[1::2]])
    assert (low, high) == pytest.approx((10 ** (1 / 3), 1000))


def test_darkness_and_a_single_value_still_have_a_scale():
    assert scale_ends([np.zeros((4, 4), np.float32)]) == (1, 10)
    low, high = scale_ends([np.full(9, 50, np.float32)])
    assert low <= 50 < high
