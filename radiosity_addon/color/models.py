# SPDX-License-Identifier: GPL-3.0-or-later
"""Other coordinates of an RGB cube: HSV, HSL, CMY, CMYK. All channels (..., 3) or (..., 4) in 0..1."""

from __future__ import annotations

import numpy as np

from ..arrays import Float64, Floats


def rgb_to_hsv(rgb: Floats) -> Float64:
    """Hue, saturation, value of RGB (Smith 1978); the hue of grey is 0."""
    hue, low, high = _hue(rgb)
    return np.stack([hue, _share(high - low, high), high], axis=-1)


def hsv_to_rgb(hsv: Floats) -> Float64:
    """RGB of hue, saturation, value."""
    hue, saturation, value = np.moveaxis(np.asarray(hsv, np.float64), -1, 0)
    return _wheel(hue, value * (1 - saturation), value)


def rgb_to_hsl(rgb: Floats) -> Float64:
    """Hue, saturation, lightness of RGB (Joblove and Greenberg 1978); the hue of grey is 0."""
    hue, low, high = _hue(rgb)
    lightness = (high + low) / 2
    return np.stack([hue, _share(high - low, 1 - np.abs(2 * lightness - 1)), lightness], axis=-1)


def hsl_to_rgb(hsl: Floats) -> Float64:
    """RGB of hue, saturation, lightness."""
    hue, saturation, lightness = np.moveaxis(np.asarray(hsl, np.float64), -1, 0)
    reach = saturation * (1 - np.abs(2 * lightness - 1)) / 2
    return _wheel(hue, lightness - reach, lightness + reach)


def rgb_to_cmy(rgb: Floats) -> Float64:
    """Cyan, magenta, yellow of RGB: what ink takes away; the way back is the same."""
    return 1 - np.asarray(rgb, np.float64)


def rgb_to_cmyk(rgb: Floats) -> Float64:
    """Cyan, magenta, yellow, black (..., 4) of RGB, as much of it black as can be."""
    cmy = rgb_to_cmy(rgb)
    black = cmy.min(axis=-1, keepdims=True)
    return np.concatenate([_share(cmy - black, 1 - black), black], axis=-1)


def cmyk_to_rgb(cmyk: Floats) -> Float64:
    """RGB of cyan, magenta, yellow, black (..., 4)."""
    ink = np.asarray(cmyk, np.float64)
    return (1 - ink[..., :3]) * (1 - ink[..., 3:])


def _hue(rgb: Floats) -> tuple[Float64, Float64, Float64]:
    """Hue in turns, least and greatest channel."""
    channels = np.asarray(rgb, np.float64)
    red, green, blue = np.moveaxis(channels, -1, 0)
    low, high = channels.min(axis=-1), channels.max(axis=-1)
    reach = high - low
    sixth = np.where(
        high == red,
        _share(green - blue, reach),
        np.where(high == green, 2 + _share(blue - red, reach), 4 + _share(red - green, reach)),
    )
    return np.where(reach == 0, 0.0, sixth / 6 % 1), low, high


def _share(part: Float64, whole: Float64) -> Float64:
    """Part / whole, 0 where there is no whole."""
    return np.where(whole == 0, 0.0, part / np.where(whole == 0, 1, whole))


def _wheel(hue: Float64, low: Float64, high: Float64) -> Float64:
    """RGB of a hue, in turns, between the least and the greatest channel."""
    sixth = hue[..., None] % 1 * 6
    red = np.abs(sixth - 3) - 1
    green_blue = 2 - np.abs(sixth - np.array([2, 4]))
    share = np.clip(np.concatenate([red, green_blue], axis=-1), 0, 1)
    rgb: Float64 = low[..., None] + (high - low)[..., None] * share
    return rgb
