# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures for people: pages as a camera would show them, false colours, the tongue of all chromaticities."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Float32, Float64
from ..color.gamut import GamutMap
from ..color.oklab import from_oklab, to_oklab
from ..color.spaces import REC709, RGBSpace, xy_of, xyz_of
from ..color.spectra import observer
from ..color.transfer import srgb_decode, srgb_encode
from ..pages.encodings import UInt8, quantize
from ..pages.png import png_bytes, srgb_chunks
from .overview import data_uri

LUMENS_PER_WATT = 683.0
"""Lumens of a watt of luminance, as Blender's glTF exporter counts them: 1 W of white light is 683 lm, as if all of it
were green at 555 nm. A real lamp that draws 1 W gives 15 to 150 lm."""
SHOWN_AS_WHITE = 0.9
"""Share of texels that a picture shows below white."""
SCALE_STEPS = 256
DARK_END, BRIGHT_END = 0.005, 0.999
"""Shares of texels below the ends of a scale of light."""
MOST_SCALE = 1e4
"""Ratio of the ends of a scale of light, at most: 13 stops."""
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
"""Steps by it never meet an earlier step, and part the circle evenly."""
LOOSE_COLOR, RIGHT_COLOR, DENSE_COLOR = (213, 60, 0), (20, 165, 105), (20, 105, 235)
"""Too few texels, as many as wanted, too many, sRGB: vermilion, bluish green and blue, which eyes that lack a cone tell
apart by their yellow and blue, as those of Okabe and Ito (2008) are chosen."""


def shrunk(page: Float32, edge: int) -> Float32:
    """A page (H, W, 3), or a plane (H, W), averaged over squares of texels to at most `edge` pixels."""
    step = -(-len(page) // edge)
    height, width = (side // step * step for side in page.shape[:2])
    squares = page[:height, :width].reshape(height // step, step, width // step, step, *page.shape[2:])
    mean: Float32 = squares.mean(axis=(1, 3), dtype=np.float32)
    return mean


def exposure_of(pages: list[Float32], space: RGBSpace) -> float:
    """The gain at which pictures of these pages look right: most texels below white."""
    light = np.concatenate([(page @ space.luminance_weights.astype(np.float32)).ravel() for page in pages])
    lit = light[light > 0]
    return 0.8 / float(np.quantile(lit, SHOWN_AS_WHITE)) if len(lit) else 1.0


def as_seen(page: Float32, space: RGBSpace, gain: float) -> UInt8:
    """A page as sRGB (H, W, 3), exposed by a gain; what a screen can't show goes by "perceptual"."""
    mapping = GamutMap(space, REC709, "perceptual", peak=1.0, gain=gain)
    mapped = mapping.apply(page, mapping.survey([page]))
    return quantize(srgb_encode(mapped), 8, dithered=True).astype(np.uint8)


def illuminance(page: Float32, space: RGBSpace) -> Float32:
    """Lux (H, W) of H / pi (H, W, 3)."""
    lux: Float32 = page @ (np.pi * LUMENS_PER_WATT * space.luminance_weights).astype(np.float32)
    return lux


@cache
def color_scale() -> UInt8:
    """(256, 3) sRGB: dark violet over blue, green and orange to pale yellow.

    A walk through Oklab in which lightness rises evenly, so that it reads in grey print and for eyes that lack a cone.
    """
    share = np.linspace(0, 1, SCALE_STEPS)
    hue = np.radians(np.interp(share, [0, 0.3, 0.55, 0.8, 1], [300, 255, 165, 65, 100]))
    chroma = np.interp(share, [0, 0.15, 0.5, 0.8, 1], [0.08, 0.15, 0.13, 0.16, 0.10])
    lightness = 0.20 + 0.75 * share
    lab = np.stack([lightness, chroma * np.cos(hue), chroma * np.sin(hue)], axis=-1)
    wanted = from_oklab(lab, REC709).astype(np.float32)[None]
    mapping = GamutMap(REC709, REC709, "relative", peak=1.0)
    shown = srgb_encode(mapping.apply(wanted, mapping.survey([wanted])))[0]
    scale: UInt8 = np.round(shown * 255).astype(np.uint8)
    return scale


def false_colors(values: Float32 | Float64, low: float, high: float, *, logarithmic: bool) -> UInt8:
    """Values (H, W) as colours (H, W, 3) of the scale, from low to high."""
    if logarithmic:
        share = np.log(np.maximum(values, low) / low) / np.log(high / low)
    else:
        share = (values - low) / (high - low)
    index = np.clip(share * (SCALE_STEPS - 1) + 0.5, 0, SCALE_STEPS - 1).astype(np.int64)
    colors: UInt8 = color_scale()[index]
    return colors


def scale_ends(values: Sequence[Float32]) -> tuple[float, float]:
    """Ends of a logarithmic scale, thirds of powers of ten, between which almost all of these arrays of light lie."""
    every = np.concatenate([part.ravel() for part in values]) if values else np.zeros(0, np.float32)
    lit = every[every > 0]
    if not len(lit):
        return 1.0, 10.0
    low, high = np.quantile(lit, [DARK_END, BRIGHT_END])
    low = max(float(low), float(high) / MOST_SCALE)
    low, high = np.floor(np.log10(low) * 3) / 3, np.ceil(np.log10(max(high, low * 2)) * 3) / 3
    return float(10**low), float(10**high)


@cache
def density_scale() -> UInt8:
    """(256, 3) sRGB: too few texels, the wanted density in the middle, too many."""
    share = np.linspace(0, 1, SCALE_STEPS)
    stops = np.array([LOOSE_COLOR, RIGHT_COLOR, DENSE_COLOR], np.float64) / 255
    lab = to_oklab(srgb_decode(stops.astype(np.float32)), REC709)
    mixed = np.stack([np.interp(share, [0, 0.5, 1], lab[:, k]) for k in range(3)], axis=-1)
    shown = srgb_encode(np.clip(from_oklab(mixed, REC709), 0, 1).astype(np.float32))
    scale: UInt8 = np.round(shown * 255).astype(np.uint8)
    return scale


@cache
def distinct_colors(count: int) -> UInt8:
    """(count, 3) sRGB: hues a golden angle apart, on three levels of lightness, so that neighbours differ in both."""
    number = np.arange(count)
    hue = number * GOLDEN_ANGLE
    lightness = np.array([0.62, 0.78, 0.70])[number % 3]
    lab = np.stack([lightness, 0.11 * np.cos(hue), 0.11 * np.sin(hue)], axis=-1)
    shown = srgb_encode(np.clip(from_oklab(lab, REC709), 0, 1).astype(np.float32))
    colors: UInt8 = np.round(shown * 255).astype(np.uint8)
    return colors


def marked(gray: Float32, mask: Bools) -> UInt8:
    """A picture (H, W, 3) in grey, 0 to 1, in which what the mask marks stands out in magenta; both (H, W)."""
    calm = np.repeat((60 + 130 * np.clip(gray, 0, 1))[..., None], 3, axis=-1)
    return np.where(mask[..., None], np.array([255, 0, 160]), calm).astype(np.uint8)


def masked(colors: UInt8, coverage: Float32) -> UInt8:
    """A picture (H, W, 3) that is clear, (H, W, 4), where a map of coverage (h, w) of any size is 0."""
    row, column = (np.arange(n) * m // n for n, m in zip(colors.shape[:2], coverage.shape, strict=True))
    there = (coverage > 0)[row[:, None], column]
    return np.concatenate([colors, np.where(there, 255, 0).astype(np.uint8)[..., None]], axis=-1)


def spectral_locus(count: int = 200) -> Float64:
    """(K, 2), x and y of monochromatic light from 390 to 700 nm."""
    return xy_of(observer(np.linspace(390, 700, count)))


def tongue(edge: int, top: tuple[float, float]) -> UInt8:
    """The chromaticities from (0, 0) to `top` as colours (edge, edge, 3), the largest y first.

    No screen shows those outside of its gamut: their hue is right, their saturation is not.
    """
    x, y = np.meshgrid(np.linspace(0, top[0], edge), np.linspace(top[1], 1e-3, edge))
    rgb = xyz_of(np.stack([x, y], axis=-1)) @ REC709.from_xyz.T
    lifted = rgb - np.minimum(rgb.min(axis=-1, keepdims=True), 0)
    shown = srgb_encode(lifted / lifted.max(axis=-1, keepdims=True))
    return np.round(shown * 255).astype(np.uint8)


def picture_uri(pixels: NDArray[np.uint8]) -> str:
    """A picture (H, W, C), the first row on top, as an address that holds it."""
    return data_uri(b"".join(png_bytes(np.ascontiguousarray(pixels), srgb_chunks())))
