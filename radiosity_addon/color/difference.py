# SPDX-License-Identifier: GPL-3.0-or-later
"""How different two colours look: CIEDE2000."""

from __future__ import annotations

import numpy as np

from ..arrays import Float64, Floats

OPPOSITE = 1e-9
"""Hues within so many radians of a half turn are opposite: the mean of such must not hang on the last bit."""


def ciede2000(first: Floats, second: Floats) -> Float64:
    """Colour difference (...) of L*, a*, b* (..., 3), all weights 1; about 1 is just seen (CIE 142-2001).

    Notation and the treatment of hues as in Sharma, Wu and Dalal 2005.
    """
    light_1, a_1, b_1 = np.moveaxis(np.asarray(first, np.float64), -1, 0)
    light_2, a_2, b_2 = np.moveaxis(np.asarray(second, np.float64), -1, 0)
    stretch = 1.5 - 0.5 * _of_chroma((np.hypot(a_1, b_1) + np.hypot(a_2, b_2)) / 2)
    chroma_1, chroma_2 = np.hypot(stretch * a_1, b_1), np.hypot(stretch * a_2, b_2)
    hue_1, hue_2 = np.arctan2(b_1, stretch * a_1) % (2 * np.pi), np.arctan2(b_2, stretch * a_2) % (2 * np.pi)
    grey = chroma_1 * chroma_2 == 0
    turn = np.where(grey, 0.0, hue_2 - hue_1)
    apart = np.abs(turn) > np.pi + OPPOSITE
    turn = np.where(apart, turn - np.copysign(2 * np.pi, turn), turn)
    hue = np.where(grey, hue_1 + hue_2, (hue_1 + hue_2) / 2 + np.where(apart, np.pi, 0.0))
    light, chroma = (light_1 + light_2) / 2, (chroma_1 + chroma_2) / 2
    weight = (
        1
        - 0.17 * np.cos(hue - np.radians(30))
        + 0.24 * np.cos(2 * hue)
        + 0.32 * np.cos(3 * hue + np.radians(6))
        - 0.20 * np.cos(4 * hue - np.radians(63))
    )
    from_blue = (np.degrees(hue) % 360 - 275) / 25
    rotation = -2 * _of_chroma(chroma) * np.sin(np.radians(60) * np.exp(-(from_blue**2)))
    lightness = (light_2 - light_1) / (1 + 0.015 * (light - 50) ** 2 / np.sqrt(20 + (light - 50) ** 2))
    saturation = (chroma_2 - chroma_1) / (1 + 0.045 * chroma)
    tint = 2 * np.sqrt(chroma_1 * chroma_2) * np.sin(turn / 2) / (1 + 0.015 * chroma * weight)
    squares = lightness**2 + saturation**2 + tint**2 + rotation * saturation * tint
    difference: Float64 = np.sqrt(np.maximum(squares, 0))
    return difference


def _of_chroma(chroma: Float64) -> Float64:
    """sqrt(C^7 / (C^7 + 25^7)): 0 near grey, 1 for vivid colours."""
    seventh = chroma**7
    return np.sqrt(seventh / (seventh + 25.0**7))
