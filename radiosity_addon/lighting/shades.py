# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether neighbouring texels see the same of a lamp: what a few samples of each found, pooled over the page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Float32, Int64
from ..chunks import Fractions, in_chunks
from ..geometry.texels import Texels
from ..geometry.visibility import Visibility
from .lamp_samples import TINY

Bytes: TypeAlias = NDArray[np.uint8]

POOL = 2
"""Probes are pooled over this many texels to every side."""

BAND = 512
"""Rows of a page whose samples are pooled in one go."""


def shade_codes(share: Float32) -> Bytes:
    """A number (R,) for each share (C, R) of light: 0 for none, 255 for all, alike for like shares between.

    Few colours look alike to the weights of its channels.
    """
    mixed = share[0]
    if len(share) > 1:
        mixed = share[0] * np.float32(0.51) + share[1] * np.float32(0.28) + share[2] * np.float32(0.21)
    codes: Bytes = np.ceil(mixed * np.float32(254)).astype(np.uint8)
    codes[share.min(0) >= 1] = 255
    return codes


SPARSE = 16
"""Pages on which one of so many pixels, or fewer, is a texel are not looked at as a whole."""

SPARSE_CHUNK = 1 << 14
"""Texels that look around in one go."""


@dataclass(frozen=True, eq=False)
class Shades:
    """What samples of T texels, or of the squares of pixels about them, saw of a lamp.

    Attributes:
        low, high: (T,) uint8, least and greatest of the samples' `shade_codes`; 255 and 0 where there are none
    """

    low: Bytes
    high: Bytes

    def disagree(self) -> Bools:
        """(T,) bool, where some samples saw more of the lamp than others."""
        mixed: Bools = self.low < self.high
        return mixed


@dataclass(frozen=True, eq=False)
class Probes:
    """What a batch of L lamps and their probe rays have found.

    Attributes:
        light: (L, T) float32, unshadowed
        low, high: (L, T) uint8, the probes' `Shades`
        share: (L, C, T) float32 part of the light of the probes that arrived; None where light arrives or does not
    """

    light: Float32
    low: Bytes
    high: Bytes
    share: Float32 | None

    @classmethod
    def none(cls, lamps: int, texels: int, visibility: Visibility) -> Probes:
        shape = (lamps, texels)
        light = np.zeros(shape, np.float32)
        low, high = np.full(shape, 255, np.uint8), np.zeros(shape, np.uint8)
        return cls(
            light, low, high, np.zeros((lamps, visibility.channels, texels), np.float32) if visibility.dims else None
        )

    @staticmethod
    def bytes_each(visibility: Visibility) -> int:
        """What a pair of a lamp and a texel takes."""
        return 6 + (4 * visibility.channels if visibility.dims else 0)

    def put(self, lamp: int, ids: Int64, light: Float32, share: Float32) -> None:
        """Keep what probes (count, B) of texels (B,) found: their light, and the share (C, count, B) that arrived."""
        codes = shade_codes(share.reshape(len(share), -1)).reshape(light.shape)
        shot = light > 0
        self.low[lamp, ids] = np.where(shot, codes, 255).min(0)
        self.high[lamp, ids] = np.where(shot, codes, 0).max(0)
        if self.share is not None:
            self.share[lamp][:, ids] = (light * share).sum(1) / np.maximum(light.sum(0), TINY)


def undecided(
    probes: Probes, members: list[int], channels: int, texels: Texels, workers: int
) -> Fractions[tuple[Float32, Int64]]:
    """The share (C, T) of a lamp's light that arrives where probes around agree, and the texels where they don't.

    Args:
        members: the lamp, or all those that share its samples
        channels: C, of all of them
    """
    own = Shades(probes.low[members].min(0), probes.high[members].max(0))
    near = yield from pooled(own, texels, POOL, workers)
    share = np.repeat(((near.high > 0) | (near.low > 0)).astype(np.float32)[None], channels, axis=0)
    asked = near.disagree()
    if probes.share is not None:
        dimmed = ~asked & (near.low > 0) & (near.high > 0) & (near.high < 255)
        asked |= dimmed & (own.low > own.high)  # its neighbours are dimmed, it has no probe of its own
        dims = probes.share[members[0]] if len(members) == 1 else probes.share[members, 0]
        share[:, dimmed] = dims[:, dimmed]
    return share, np.flatnonzero(asked & (probes.light[members] > 0).any(0))


def pooled(shades: Shades, texels: Texels, reach: int, workers: int) -> Fractions[Shades]:
    """The shades in squares of `2 reach + 1` pixels of a page."""
    size = texels.size
    bands = -(-size // BAND)
    near = Shades(np.empty_like(shades.low), np.empty_like(shades.high))
    if texels.count * SPARSE < len(texels.texel_at):
        return (yield from pooled_at(shades, texels, np.arange(texels.count), reach, workers))

    def work(start: int, stop: int) -> None:
        page, band = divmod(start, bands)
        first, last = band * BAND, min((band + 1) * BAND, size)
        low, high = max(first - reach, 0), min(last + reach, size)
        base = page * size * size
        ends = [texels.before(base + row * size) for row in (low, first, last, high)]
        place = texels.pixel[ends[0] : ends[3]] - (base + low * size)
        own = slice(ends[1] - ends[0], ends[2] - ends[0])
        for extreme, none, codes, found in (
            (np.minimum, 255, shades.low, near.low),
            (np.maximum, 0, shades.high, near.high),
        ):
            image = np.full((high - low) * size, none, np.uint8)
            image[place] = codes[ends[0] : ends[3]]
            found[ends[1] : ends[2]] = _over_squares(extreme, image.reshape(-1, size), reach).reshape(-1)[place[own]]

    yield from in_chunks(work, texels.page_count * bands, 1, workers)
    return near


def pooled_at(shades: Shades, texels: Texels, ids: Int64, reach: int, workers: int) -> Fractions[Shades]:
    """As `pooled`, of texels `ids` (N,) alone, by looking around each: for few, or where pages hold few."""
    size = texels.size
    low, high = np.append(shades.low, np.uint8(255)), np.append(shades.high, np.uint8(0))
    near = Shades(shades.low[ids], shades.high[ids])
    span = range(-reach, reach + 1)

    def work(start: int, stop: int) -> None:
        pixel = texels.pixel[ids[start:stop]]
        row, column = (pixel // size) % size, pixel % size
        inner = (row >= reach) & (row < size - reach) & (column >= reach) & (column < size - reach)
        rim = np.flatnonzero(~inner)
        row, column = row[rim], column[rim]
        for dy, dx in ((dy, dx) for dy in span for dx in span):
            other = texels.texel_at.take(pixel + (dy * size + dx), mode="clip")
            beyond = (row + dy < 0) | (row + dy >= size) | (column + dx < 0) | (column + dx >= size)
            other[rim[beyond]] = -1
            np.minimum(near.low[start:stop], low.take(other), out=near.low[start:stop])
            np.maximum(near.high[start:stop], high.take(other), out=near.high[start:stop])

    yield from in_chunks(work, len(ids), SPARSE_CHUNK, workers)
    return near


def _over_squares(extreme: np.ufunc, image: Bytes, reach: int) -> Bytes:
    """Least or greatest values in squares of 2 reach + 1 pixels."""
    for axis in (0, 1):
        found = image.copy()
        ahead, behind = np.moveaxis(found, axis, 0), np.moveaxis(image, axis, 0)
        for step in range(1, reach + 1):
            extreme(ahead[step:], behind[:-step], out=ahead[step:])
            extreme(ahead[:-step], behind[step:], out=ahead[:-step])
        image = found
    return image
