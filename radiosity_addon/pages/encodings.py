# SPDX-License-Identifier: GPL-3.0-or-later
"""Light in few bits: encodings of linear RGB for image files, and their decoders.

Encoders take pages (H, W, 3) float32 that are not negative; decoders return such pages. RGBM, RGBD and LogLuv are what
is often meant by these names, with the bits spent so that a colour keeps its relative precision over 16 stops.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import Float32, Float64
from ..color.spaces import RGBSpace

UInt8 = NDArray[np.uint8]
UInt16 = NDArray[np.uint16]

RGB9E5_MAX = (511 / 512) * 2.0**16
"""65408, the largest number that RGB9E5 holds."""
RGBE_MAX = (255 / 256) * 2.0**127
"""The largest number that Radiance's RGBE holds."""
LOGLUV_STOPS = 32.0
"""Range of luminance in LogLuv, from the brightest of the bake down; a step is 0.0005 stops."""
UV_MAX = 0.625
"""u' and v' of visible colours lie below this (those of the spectral locus below 0.6235 and 0.5868)."""
DARKEST_Y = 2.0**-100
"""Luminance that stands for none where it is divided by."""


def quantize(coded: Float32, bits: int, dithered: bool, first_row: int = 0) -> UInt8 | UInt16:
    """Numbers (H, W, C) in 0..1 as integers of 8 or 16 bits.

    Dithered, a number between two steps becomes the upper one in a share of the texels, the larger the closer it is to
    that step, so that a dark wall shows no bands; what lies on a step, black and white included, stays. The pattern is
    interleaved gradient noise (Jimenez 2014), shifted by a third for each channel.

    Args:
        first_row: row of the page that `coded` begins with, where it is a part of one
    """
    top = np.float32((1 << bits) - 1)
    steps = coded * top
    if dithered:
        height, width, channels = coded.shape
        row = np.arange(first_row, first_row + height, dtype=np.float64)[:, None]
        noise = 52.9829189 * ((0.06711056 * np.arange(width) + 0.00583715 * row) % 1) % 1
        for channel in range(channels):
            steps[..., channel] += ((noise + channel / 3) % 1).astype(np.float32) * np.float32(0.998) + np.float32(1e-3)
    else:
        steps += np.float32(0.5)
    held: Float32 = np.minimum(steps, top)
    return held.astype(np.uint8) if bits == 8 else held.astype(np.uint16)


def encode_rgbm(linear: Float32, brightest: float) -> UInt8:
    """RGBM (H, W, 4): square roots of shares of the brightest, over a common multiplier in alpha (Karis 2009).

    The multiplier is the smallest step that holds the largest channel, so that this one takes the upper half of its
    steps at least.
    """
    root = np.sqrt(linear / np.float32(brightest))
    multiplier = np.clip(np.ceil(root.max(axis=-1, keepdims=True) * 255 - np.float32(1e-3)), 1, 255)
    color = np.minimum(root * (np.float32(255 * 255) / multiplier) + np.float32(0.5), 255)
    return np.concatenate([color, multiplier], axis=-1).astype(np.uint8)


def decode_rgbm(coded: UInt8, brightest: float) -> Float32:
    """Linear RGB of RGBM: brightest (rgb a)^2."""
    share = coded.astype(np.float32) / np.float32(255)
    linear: Float32 = np.float32(brightest) * (share[..., :3] * share[..., 3:]) ** 2
    return linear


def encode_rgbd(linear: Float32, brightest: float) -> UInt8:
    """RGBD (H, W, 4): square roots of shares of the brightest, times a divisor in alpha, 1 to 255 (Karis 2009)."""
    root = np.sqrt(linear / np.float32(brightest))
    high = np.maximum(root.max(axis=-1, keepdims=True), np.float32(1 / 255))
    divisor = np.clip(np.floor(1 / high + np.float32(1e-4)), 1, 255)
    color = np.minimum(root * divisor * 255 + np.float32(0.5), 255)
    return np.concatenate([color, divisor], axis=-1).astype(np.uint8)


def decode_rgbd(coded: UInt8, brightest: float) -> Float32:
    """Linear RGB of RGBD: brightest (rgb / (255 a))^2."""
    color, divisor = coded[..., :3].astype(np.float32), coded[..., 3:].astype(np.float32)
    linear: Float32 = np.float32(brightest) * (color / (255 * np.maximum(divisor, 1))) ** 2
    return linear


def encode_logluv(linear: Float32, brightest: float, space: RGBSpace) -> UInt16:
    """LogLuv (H, W, 3) of 16 bits: the logarithm of luminance, u', v' (after Ward Larson 1998).

    Ward's 32 bits give u' and v' 8 each, which errs up to 3 % of a colour's largest channel; 16 bits each leave 0.04 %.

    Args:
        brightest: the highest luminance Y
    """
    x, y, z = (plane.astype(np.float32) for plane in np.moveaxis(linear @ space.to_xyz.T.astype(np.float32), -1, 0))
    stops = np.log2(np.maximum(y, np.float32(brightest * 2.0**-LOGLUV_STOPS)) / np.float32(brightest))
    light = 1 + stops / np.float32(LOGLUV_STOPS)
    below = x + 15 * y + 3 * z
    below = np.where(below > 0, below, 1)
    coded = np.stack([light, 4 * x / below / np.float32(UV_MAX), 9 * y / below / np.float32(UV_MAX)], axis=-1)
    steps: UInt16 = np.minimum(np.maximum(coded, 0) * 65535 + np.float32(0.5), 65535).astype(np.uint16)
    return steps


def decode_logluv(coded: UInt16, brightest: float, space: RGBSpace) -> Float32:
    """Linear RGB of LogLuv: Y = brightest 2^(32 (r - 1)), none at r = 0; u', v' = 0.625 g, b."""
    light, u, v = np.moveaxis(coded / 65535, -1, 0)
    y = np.where(light > 0, brightest * 2.0 ** ((light - 1) * LOGLUV_STOPS), 0)
    u, v = u * UV_MAX, np.maximum(v * UV_MAX, 1e-6)
    x, z = 9 * u / (4 * v) * y, (12 - 3 * u - 20 * v) / (4 * v) * y
    linear: Float64 = np.stack([x, y, z], axis=-1) @ space.from_xyz.T
    return np.maximum(linear, 0).astype(np.float32)


def encode_rgb9e5(linear: Float32) -> UInt8:
    """RGB9E5 (H, W, 4): nine bits a channel and five of a shared exponent, the four bytes of the word, lowest first.

    As OpenGL's EXT_texture_shared_exponent lays down: graphics cards sample these bytes as they are.
    """
    held = np.clip(linear, 0, np.float32(RGB9E5_MAX))
    high = np.maximum(np.maximum(held[..., 0], held[..., 1]), held[..., 2])
    exponent = np.clip(np.frexp(high)[1], -15, 16)  # high < 2^exponent
    exponent += np.floor(np.ldexp(high, 9 - exponent) + np.float32(0.5)).astype(np.int32) == 512  # rounded up
    mantissa = np.floor(np.ldexp(held, (9 - exponent)[..., None]) + np.float32(0.5)).astype(np.uint32)
    word = mantissa[..., 0] | mantissa[..., 1] << 9 | mantissa[..., 2] << 18 | (exponent + 15).astype(np.uint32) << 27
    return np.ascontiguousarray(word, "<u4").view(np.uint8).reshape(*word.shape, 4)


def decode_rgb9e5(coded: UInt8) -> Float32:
    """Linear RGB of RGB9E5: mantissa 2^(exponent - 24)."""
    word = np.ascontiguousarray(coded).view("<u4")[..., 0]
    mantissa = np.stack([word >> shift & 511 for shift in (0, 9, 18)], axis=-1).astype(np.float32)
    return np.ldexp(mantissa, ((word >> 27).astype(np.int32) - 24)[..., None])


def rounded_to_rgbe(linear: Float32) -> Float32:
    """The nearest colours that Radiance's RGBE holds, a trifle above them, for a writer that cuts off what is beyond.

    Eight bits a channel and a shared exponent (Ward 1991). Cut off alone, colours would darken by 0.3 % on average.
    """
    high = np.maximum(np.maximum(linear[..., 0], linear[..., 1]), linear[..., 2])
    exponent = np.frexp(np.maximum(high, np.float32(1e-37)))[1]
    exponent += np.ldexp(high, 8 - exponent) >= 255.5  # rounded up
    step = np.ldexp(np.float32(1), exponent - 8)[..., None]
    mantissa = np.floor(linear / step + np.float32(0.5))
    rounded: Float32 = (mantissa + (mantissa > 0) * np.float32(0.01)) * step
    return rounded
