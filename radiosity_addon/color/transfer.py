# SPDX-License-Identifier: GPL-3.0-or-later
"""Transfer functions: linear light to the numbers that displays and files take, and back.

Odd in their argument: -x becomes -f(x), so that values outside a gamut survive the way there and back. Single precision
stays single.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from ..arrays import Float32, Float64

F = TypeVar("F", Float32, Float64)

REC709_ALPHA, REC709_BETA = 1.09929682680944, 0.018053968510807
"""The constants of BT.709 and BT.2020 with the digits at which both branches meet smoothly (BT.2020-2, table 4)."""


def srgb_encode(linear: F) -> F:
    """Linear light to sRGB (IEC 61966-2-1), which Display P3 shares."""
    size = np.abs(linear)
    coded: F = np.where(size <= 0.0031308, 12.92 * size, 1.055 * np.maximum(size, 0.0031308) ** (1 / 2.4) - 0.055)
    return np.copysign(coded, linear)


def srgb_decode(coded: F) -> F:
    """SRGB to linear light."""
    size = np.abs(coded)
    linear: F = np.where(size <= 12.92 * 0.0031308, size / 12.92, ((size + 0.055) / 1.055) ** 2.4)
    return np.copysign(linear, coded)


def rec709_encode(linear: F) -> F:
    """Scene light to the signal of a camera by BT.709 and BT.2020."""
    size = np.abs(linear)
    power = REC709_ALPHA * np.maximum(size, REC709_BETA) ** 0.45 - (REC709_ALPHA - 1)
    coded: F = np.where(size < REC709_BETA, 4.5 * size, power)
    return np.copysign(coded, linear)


def rec709_decode(coded: F) -> F:
    """The signal of a camera by BT.709 and BT.2020 to scene light."""
    size = np.abs(coded)
    power = ((size + (REC709_ALPHA - 1)) / REC709_ALPHA) ** (1 / 0.45)
    linear: F = np.where(size < 4.5 * REC709_BETA, size / 4.5, power)
    return np.copysign(linear, coded)
