# SPDX-License-Identifier: GPL-3.0-or-later
"""Gamut mapping: light brought inside what a file or a display can hold, by one of four rendering intents.

A gamut is the colours that a space makes with channels from 0 to a peak: 1 for pictures of low dynamic range, no bound
for encodings of high. The names of the intents follow the lectures that this project grew out of, which use them more
loosely than the ICC does. (Every space here is adapted to one white: no paper white tells "absolute" from "relative".)

absolute    colorimetric: what is outside goes to the nearest point of the gamut, nearest in its own linear RGB
relative    colorimetric: what is outside is desaturated, its hue and lightness kept, until it is inside; what is
            lighter than white is first taken to white's lightness
perceptual  the saturations and the brightness of the whole bake are bent by one smooth curve each, which leaves low
            ones as they are and takes the highest in the bake to the boundary
saturation  the saturations of the whole bake are scaled by one factor, so that they keep their ratios; brightness is
            bent as in "perceptual"

Hue, lightness L and saturation C / L are those of Oklab. A colour's saturation is taken relative to the highest that
the gamut has at its hue, which by Oklab's homogeneity does not depend on brightness.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias, TypeVar, get_args

import numpy as np

from ..arrays import Bools, Float32, Float64
from ..chunks import finish, in_chunks
from .oklab import TO_LAB, lms_matrix, to_oklab
from .spaces import RGBSpace

Intent: TypeAlias = Literal["absolute", "relative", "perceptual", "saturation"]
INTENTS: tuple[str, ...] = get_args(Intent)

TOLERANCE = 1e-6
"""How far a channel may leave the gamut, relative to the colour's largest: the rounding of a matrix in float32."""
KNEE = 0.8
"""Relative saturation and brightness up to which "perceptual" leaves colours as they are."""
DARK = 2.0**-12
"""Colours darker than this share of the brightest do not decide how saturated the bake is: theirs is noise."""
HUES = 1 << 14
"""Hues at which the highest saturation is looked up; between them it is linear."""
EDGE_POINTS = 400
"""Colours on half an edge of a gamut at which its highest saturation is known; between them it is linear in hue."""
BISECTIONS = 14
"""Halvings that find the boundary, to 6e-5 of a colour's chroma."""
TEXEL_BLOCK = 1 << 14
"""Texels mapped in one go: a plane of them is 64 KB, so that a few stay in cache."""
CHUNK = 1 << 18
"""Texels of a thread's task."""

T = TypeVar("T")

Planes: TypeAlias = list[Float32]
"""Three channels of n texels, each on its own."""

_TO_LAB, _FROM_LAB = TO_LAB.astype(np.float32), np.linalg.inv(TO_LAB).astype(np.float32)


@dataclass(frozen=True)
class Extent:
    """What a whole bake asks of a gamut.

    Attributes:
        saturation: highest saturation, relative to the gamut's at the same hue
        brightness: highest channel, relative to the peak
        outside: share of the texels that lie outside
    """

    saturation: float = 0.0
    brightness: float = 0.0
    outside: float = 0.0


@dataclass(frozen=True, eq=False)
class GamutMap:
    """A way from one space into the gamut of another.

    Attributes:
        source: space of the light
        target: space whose gamut it has to fit in
        intent: what happens to what does not
        peak: highest channel of the gamut, None for no bound
        gain: factor on the light before all else
    """

    source: RGBSpace
    target: RGBSpace
    intent: Intent = "relative"
    peak: float | None = None
    gain: float = 1.0

    @cached_property
    def _matrix(self) -> Float32:
        return (self.gain * self.source.to(self.target)).astype(np.float32)

    @cached_property
    def _to_lms(self) -> Float32:
        return lms_matrix(self.target).astype(np.float32)

    @cached_property
    def _from_lms(self) -> Float32:
        return np.linalg.inv(lms_matrix(self.target)).astype(np.float32)

    @cached_property
    def _limits(self) -> Float32:
        """(HUES + 2,), highest saturation at hues from -pi on, and again at the first ones."""
        hues = (np.arange(HUES + 2) / HUES * 2 - 1) * np.pi
        return np.interp(hues, *highest_saturation(self.target)).astype(np.float32)

    def survey(self, pages: Sequence[Float32], workers: int = 1) -> Extent:
        """What all pages (H, W, 3) of a bake together ask for."""
        brightest = max((float(page.max(initial=0)) for page in pages), default=0.0) * self.gain
        found = [part for page in pages for part in self._by_chunk(page, workers, self._survey(brightest))]
        texels = sum(page.size // 3 for page in pages)
        return Extent(
            saturation=max((part[0] for part in found), default=0.0),
            brightness=max((part[1] for part in found), default=0.0) / (self.peak or np.inf),
            outside=sum(part[2] for part in found) / max(texels, 1),
        )

    def apply(self, page: Float32, extent: Extent, workers: int = 1) -> Float32:
        """A page (H, W, 3) in the target's linear RGB, inside its gamut.

        Args:
            page: in the source's linear RGB
            extent: that of all pages of the bake
        """
        result = np.empty_like(page, np.float32)
        flat = result.reshape(-1, 3)

        def fill(planes: Planes, start: int) -> None:
            fitted = self._fit(planes, extent)
            top = np.float32(np.inf if self.peak is None else self.peak)
            for channel, plane in enumerate(fitted):
                flat[start : start + len(plane), channel] = np.minimum(np.maximum(plane, 0), top)

        self._by_chunk(page, workers, fill)
        return result

    def outside(self, page: Float32, workers: int = 1) -> Bools:
        """(H, W) bool, where the light of a page (H, W, 3) lies outside the gamut."""
        mask = np.empty(page.shape[:-1], bool)
        flat = mask.reshape(-1)

        def fill(planes: Planes, start: int) -> None:
            flat[start : start + len(planes[0])] = self._is_outside(planes)

        self._by_chunk(page, workers, fill)
        return mask

    def _by_chunk(self, page: Float32, workers: int, work: Callable[[Planes, int], T]) -> list[T]:
        """What work(planes in the target's RGB, index of the first) returned for each block of texels."""
        flat = page.reshape(-1, 3)

        def run(start: int, stop: int) -> list[T]:
            found = []
            for begin in range(start, stop, TEXEL_BLOCK):
                block = flat[begin : min(begin + TEXEL_BLOCK, stop)]
                found.append(work(times(self._matrix, [np.ascontiguousarray(block[:, c]) for c in range(3)]), begin))
            return found

        return [one for chunk in finish(in_chunks(run, len(flat), CHUNK, workers)) for one in chunk]

    def _survey(self, brightest: float) -> Callable[[Planes, int], tuple[float, float, int]]:
        def look(planes: Planes, start: int) -> tuple[float, float, int]:
            high = np.maximum(np.maximum(planes[0], planes[1]), planes[2])
            low = np.minimum(np.minimum(planes[0], planes[1]), planes[2])
            outside = int(np.count_nonzero(self._is_outside(planes)))
            saturation = 0.0
            if self.intent in ("perceptual", "saturation"):
                vivid = np.flatnonzero((low < -TOLERANCE * high) & (high > DARK * brightest))
                light, a, b = self._lab([plane[vivid] for plane in planes])
                saturation = float(self._relative_saturation(light, a, b).max(initial=0))
            return saturation, float(high.max(initial=0)), outside

        return look

    def _is_outside(self, planes: Planes) -> Bools:
        low = np.minimum(np.minimum(planes[0], planes[1]), planes[2])
        high = np.maximum(np.maximum(planes[0], planes[1]), planes[2])
        outside: Bools = low < -TOLERANCE * np.abs(high)
        if self.peak is not None:
            outside |= high > self.peak * (1 + TOLERANCE)
        return outside

    def _fit(self, planes: Planes, extent: Extent) -> Planes:
        if self.intent == "absolute":
            return planes  # holding each channel within bounds is the nearest point of a box
        if self.intent == "relative":
            outside = np.flatnonzero(self._is_outside(planes))
            if len(outside):
                for plane, inside in zip(planes, self._desaturated([plane[outside] for plane in planes]), strict=True):
                    plane[outside] = inside
            return planes
        if extent.saturation > 1:
            planes = self._less_saturated(planes, extent)
        if self.peak is not None and extent.brightness > 1:
            high = np.maximum(np.maximum(planes[0], planes[1]), planes[2])
            share = (high / np.float32(self.peak)).astype(np.float32, copy=False)
            kept = _ratio(shoulder(share, extent.brightness), share)
            planes = [plane * kept for plane in planes]
        return planes

    def _desaturated(self, planes: Planes) -> Planes:
        """At each colour's hue and lightness the highest chroma, up to its own, that is inside; white has none."""
        light, a, b = self._lab(planes)
        top = np.float32(np.inf if self.peak is None else np.cbrt(self.peak))
        held = np.minimum(np.maximum(light, 0), top)
        fitted = [held * held * held for _ in planes]
        between = np.flatnonzero((held > 0) & (held < top))
        colors = self._most_colorful(held[between], a[between], b[between])
        for plane, inside in zip(fitted, colors, strict=True):
            plane[between] = inside
        return fitted

    def _most_colorful(self, light: Float32, a: Float32, b: Float32) -> Planes:
        """By bisection: a channel at share t of the chroma is sum_i w_i (L + t p_i)^3, a cubic in t."""
        p = times(_FROM_LAB, [np.zeros_like(light), a, b])
        grey = light * light * light
        first = times(self._from_lms, [3 * light * light * q for q in p])
        second = times(self._from_lms, [3 * light * q * q for q in p])
        third = times(self._from_lms, [q * q * q for q in p])

        def at(share: Float32) -> Planes:
            return [((third[c] * share + second[c]) * share + first[c]) * share + grey for c in range(3)]

        highest = np.float32(np.inf if self.peak is None else self.peak)
        inside, step = np.zeros_like(light), np.float32(1)
        for _ in range(BISECTIONS):
            step *= np.float32(0.5)
            tried = at(inside + step)
            low = np.minimum(np.minimum(tried[0], tried[1]), tried[2])
            high = np.maximum(np.maximum(tried[0], tried[1]), tried[2])
            inside += step * ((low >= 0) & (high <= highest))
        return at(inside)

    def _less_saturated(self, planes: Planes, extent: Extent) -> Planes:
        light, a, b = self._lab(planes)
        saturation = self._relative_saturation(light, a, b)
        if self.intent == "perceptual":
            wanted = shoulder(np.minimum(saturation, np.float32(extent.saturation)), extent.saturation)
        else:
            wanted = np.minimum(saturation / np.float32(extent.saturation), np.float32(1))
        kept = _ratio(wanted, saturation)
        root = times(_FROM_LAB, [np.maximum(light, 0), a * kept, b * kept])
        return times(self._from_lms, [plane * plane * plane for plane in root])

    def _lab(self, planes: Planes) -> Planes:
        return times(_TO_LAB, [np.cbrt(plane) for plane in times(self._to_lms, planes)])

    def _relative_saturation(self, light: Float32, a: Float32, b: Float32) -> Float32:
        """C / L as a share of the gamut's highest at the same hue."""
        place = (np.arctan2(b, a) + np.float32(np.pi)) * np.float32(HUES / (2 * np.pi))
        index = place.astype(np.int32)
        share = place - index
        limit = self._limits[index] * (1 - share) + self._limits[index + 1] * share
        relative: Float32 = np.hypot(a, b) / np.maximum(light * limit, np.float32(1e-12))
        return relative


def shoulder(value: Float32, top: float) -> Float32:
    """A smooth rising curve: the value up to KNEE, 1 at `top`, which is above 1 (Reinhard et al. 2002, equation 4)."""
    white = np.float32((top - KNEE) / (1 - KNEE))
    over = np.maximum((value - np.float32(KNEE)) / np.float32(1 - KNEE), 0)
    bent = over * (1 + over / (white * white)) / (1 + over)
    curve: Float32 = np.minimum(np.minimum(value, np.float32(KNEE)) + np.float32(1 - KNEE) * bent, 1)
    return curve


def highest_saturation(space: RGBSpace) -> tuple[Float64, Float64]:
    """The most saturated colours of a space, which lack a primary: hue (K,), rising, and Oklab's C / L (K,).

    They are spaced by share of a primary, not by hue, since the boundary is all but radial beside blue. There it even
    turns back, by 0.2 degrees in Rec.709 and 0.6 in ACEScg: the outermost colour of each hue is kept.
    """
    share = np.linspace(0, 1, EDGE_POINTS) ** 2
    edge = np.concatenate([share / 2, 1 - share[::-1] / 2])[:, None]
    primary = np.eye(3)
    hues, saturations = [], []
    for first, second in ((0, 1), (1, 2), (2, 0)):  # from red over green and blue, in rising hue
        light, a, b = to_oklab((1 - edge) * primary[first] + edge * primary[second], space).T
        hue = np.unwrap(np.arctan2(b, a))
        forward = np.append(True, hue[1:] > np.maximum.accumulate(hue)[:-1]) & (hue < hue[-1])
        hues.append(hue[forward])
        saturations.append((np.hypot(a, b) / light)[forward])
    hue, saturation = np.unwrap(np.concatenate(hues)), np.concatenate(saturations)
    turn = 2 * np.pi
    return np.concatenate([hue - turn, hue, hue + turn]), np.tile(saturation, 3)


def _ratio(part: Float32, whole: Float32) -> Float32:
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)


def times(matrix: Float32, planes: Planes) -> Planes:
    """A matrix (3, 3) times colours."""
    return [row[0] * planes[0] + row[1] * planes[1] + row[2] * planes[2] for row in matrix]
