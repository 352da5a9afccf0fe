# SPDX-License-Identifier: GPL-3.0-or-later
"""Shadow rays: what share of a lamp a texel sees, and which texels need to ask."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..columns import vectors_at
from ..geometry.texels import STRATA, Texels
from ..geometry.visibility import Visibility
from .companies import ColorLamps, brightest
from .lamp_samples import cosine_above, lattice_generators, normals_of, pixel_shifts, rows_of, shifted
from .lamps import Lamp
from .shades import Shades, pooled_at, shade_codes
from .terminator import Footing, footing, horizons

TRACE_CHUNK = 1 << 12
"""Partly lit texels traced in one go, STRATA rays of each at a time."""

EDGE_RAYS = 64
"""Shadow rays of a texel where a lamp without size casts an edge: they only find the lit share of the footprint."""

AGAIN = 3
"""Further times that texels send all their rays where these find a cut-out's holes unevenly."""

UNEVEN = 0.02
"""Standard error of a share from which on they do so."""

TURN = np.float32(0.6180339887)
"""Each time the samples are shifted by so much of the lamp."""

EVEN = 1e-6
"""Variance of a share below which all samples of it were dimmed alike, as by one pane."""

FIRST = 3
"""One of so many samples comes first; where neighbours agree on them, the others are not needed."""

FEW = FIRST * STRATA
"""So few samples are traced in one go, as asking twice takes longer, but where light is dimmed: see `Tally.spread`."""


@dataclass(frozen=True, eq=False)
class Receivers:
    """B texels about to be lit.

    Attributes:
        ids: (B,) int64, texels
        normals: shading normals and, if others, those of horizons, as rows (3, B)
        shifts: (B,) float32 each, of the samples' u and v
        turn: (B,) int64, stratum of the footprint that sample 0 starts from
    """

    ids: Int64
    normals: list[Float32]
    shifts: tuple[Float32, Float32]
    turn: Int64

    @classmethod
    def of(cls, texels: Texels, ids: Int64) -> Receivers:
        """The receivers at texels `ids`. Neighbours differ in their samples so that they complement each other."""
        shading = vectors_at(texels.shading_normal, ids)
        normal = horizons(texels, ids, shading)
        pixel = texels.pixel[ids].astype(np.int64)
        return cls(
            ids=ids,
            normals=normals_of(shading, None if np.array_equal(shading, normal) else normal),
            shifts=pixel_shifts(pixel, texels.size),
            turn=pixel + 2 * (pixel // texels.size),
        )

    def only(self, chosen: Int64) -> Receivers:
        """Those at positions `chosen`."""
        if len(chosen) == len(self.ids):
            return self
        return Receivers(
            ids=self.ids[chosen],
            normals=[rows.take(chosen, axis=1) for rows in self.normals],
            shifts=(self.shifts[0][chosen], self.shifts[1][chosen]),
            turn=self.turn[chosen],
        )

    def turned(self, turn: int) -> tuple[Float32, Float32]:
        """Shifts for the time `turn` that the samples are sent."""
        u, v = (shifted(TURN * np.float32(turn) % 1, shift) if turn else shift for shift in self.shifts)
        return u, v

    def origins(self, texels: Texels, first: int, count: int) -> tuple[Float32, Footing | None]:
        """Origins (3, count * B) of each one's shadow rays from number `first` on, one sample after the other."""
        samples = np.arange(first, first + count)[:, None]
        strata = (samples + self.turn) % STRATA + samples // STRATA * STRATA
        places = np.tile(self.ids, count), strata.reshape(-1)
        return rows_of(texels.origins(*places)), footing(texels, *places)


def shoot(
    lamp: Lamp,
    p: Float32,
    normals: list[Float32],
    u: Float32,
    v: Float32,
    visibility: Visibility,
    footing: Footing | None = None,
) -> tuple[Float32, Float32]:
    """Light (B,) of the lamp's samples (u, v) at points p (3, B), and the share (C, B) of it that arrives.

    C channels, as what dims it has; (C, B) both for the lamps of several colours that share their samples. Where there
    is no light, nothing of it arrives.
    """
    way, light = lamp.aim(p, u, v)
    light *= cosine_above(way, normals, None if footing is None else footing.bend)
    if footing is not None:
        p, way = footing.lift(p, way, normals[0])
    live = np.flatnonzero(brightest(light) > 0)
    if len(live) == light.shape[-1]:
        share = visibility.transmitted(_rays(p), _rays(way))
    else:
        share = np.zeros((visibility.channels, light.shape[-1]), np.float32)
        if len(live):
            share[:, live] = visibility.transmitted(_rays(p, live), _rays(way, live))
    if isinstance(lamp, ColorLamps):
        share = share[lamp.colors if len(share) > 1 else [0] * len(light)]
    return light, share


def _rays(rows: Float32, chosen: Int64 | None = None) -> Float32:
    """Three rows, or what is chosen of them, as (R, 3)."""
    rays = np.empty((rows.shape[1] if chosen is None else len(chosen), 3), np.float32)
    for k in range(3):
        rays[:, k] = rows[k] if chosen is None else rows[k].take(chosen)
    return rays


@dataclass(frozen=True, eq=False)
class Tally:
    """What the samples of B points brought, in C channels.

    Attributes:
        total: (B,) float32, light of the samples, unshadowed; (C, B) where lamps of several colours share them
        arrived: (C, B) float32, the part of it that arrives
        squares: as `total`, squares of the unshadowed light
        partly: (C, B) float32, those squares times q (1 - q), where a sample arrives in part, to the share q
    """

    total: Float32
    arrived: Float32
    squares: Float32
    partly: Float32

    @classmethod
    def none(cls, lamp: Lamp, points: int, channels: int) -> Tally:
        total, squares = np.zeros((2, *((channels,) if isinstance(lamp, ColorLamps) else ()), points), np.float32)
        arrived, partly = np.zeros((2, channels, points), np.float32)
        return cls(total, arrived, squares, partly)

    def add(
        self,
        lamp: Lamp,
        origins: Sequence[tuple[Float32, Footing | None]],
        normals: list[Float32],
        shifts: tuple[Float32, Float32],
        generators: Float32,
        samples: Float32,
        visibility: Visibility,
    ) -> None:
        """Trace samples, some at a time.

        Args:
            origins: (3, S * B) each, and where they stand, of S samples one after the other; groups of samples take
                them in turn
            normals: (3, B) each
            shifts: (B,) each, of the samples' u and v
            generators: (B,) of the samples' lattices
            samples: (groups, S, 1), u
        """
        points = len(shifts[0])
        side = samples.shape[1]
        tiled = [np.tile(rows, (1, side)) for rows in normals]
        for number, group in enumerate(samples):
            u = shifted(group, shifts[0]).reshape(-1)
            v = group * generators + shifts[1]
            v -= np.floor(v)
            p, footing = origins[number % len(origins)]
            light, share = shoot(lamp, p, tiled, u, v.reshape(-1), visibility, footing)
            square = light * light
            pairs = [(self.total, light), (self.arrived, light * share), (self.squares, square)]
            if visibility.dims:
                pairs.append((self.partly, square * (share * (1 - share))))
            for sums, found in pairs:
                sums += found.reshape(*sums.shape[:-1], side, points).sum(-2)

    def share(self) -> Float32:
        """The part that arrives, (C, B) float32 in 0..1; 1 where no sample has any light.

        A ratio of two sums over the same samples: the shape of the integrand drops out, and what stays is the shadow.
        """
        some = self.total > 0
        share: Float32 = np.where(some, self.arrived / np.where(some, self.total, 1), np.float32(1))
        return share

    def variance(self) -> Float32:
        """Variance (C, B) of `share`, were its samples independent; uneven samples count as fewer.

        It is binomial where samples arrive or don't; those that arrive in part vary the less.
        """
        share = self.share()
        variance: Float32 = share * (1 - share) * self.squares
        variance -= self.partly
        np.maximum(variance, 0, out=variance)
        variance /= np.where(self.total > 0, self.total, 1) ** 2
        return variance

    def only(self, chosen: Int64) -> Tally:
        """A copy of those at positions `chosen`."""
        return Tally(*(sums[..., chosen] for sums in vars(self).values()))

    def spread(self, first: Tally) -> Float32:
        """Variance (C, B) of `share` by how far the `first` of its samples differ from the later ones.

        Even samples do not help where the light comes through the holes of a cut-out, and only this shows it.
        """
        later = np.where(self.total > first.total, self.total - first.total, 1)
        gap = first.share() - (self.arrived - first.arrived) / later
        # of one sample's variance s the two means have s / a and s / b, their difference both, that of all s / (a + b)
        spread: Float32 = gap * gap * (first.total * later / np.where(self.total > 0, self.total, 1) ** 2)
        return spread


def sample_groups(count: int, side: int) -> Float32:
    """The lattice of `count` samples in groups of `side`: (count / side, side, 1), u.

    Member s of a group is a sample whose number is s modulo `side`, which is the stratum it starts from. Where the
    count allows it, every `FIRST`-th sample comes first: a smaller lattice, which every stratum shares in.
    """
    number = np.arange(count)
    late = number % FIRST > 0 if stages(count) > 1 else np.zeros(count, bool)
    order = np.lexsort((number, late, number % side)).reshape(side, -1).T
    groups: Float32 = (order[:, :, None] / count).astype(np.float32)
    return groups


def whole_groups(count: float) -> int:
    """The number of samples next to `count` that makes whole groups, one sample a stratum."""
    return STRATA * max(1, round(count / STRATA))


def stages(count: int) -> int:
    """In how many goes `count` samples are traced."""
    return 2 if count % (FIRST * STRATA) == 0 else 1


def trace_partly(
    lamp: Lamp,
    texels: Texels,
    partly: Int64,
    lit: Bools,
    ratio: Float32,
    noise: Float32,
    visibility: Visibility,
    count: int,
    workers: int,
) -> Fractions[Int64]:
    """Trace up to `count` shadow rays from each of the texels `partly`: share seen to `ratio`, its variance to `noise`.

    If they are many a first third of the rays shows where a texel and all those around it agree; only the others trace
    the rest.

    Args:
        partly: (N,) int64
        lit: (T,) bool, texels that the unshadowed lamp shines on
        ratio, noise: (C, T) float32, written at `partly`
    Returns:
        the texels of a penumbra, those that have traced all rays
    """
    rays = whole_groups(count / (1 - lamp.hidden_share)) if lamp.extended else min(count, EDGE_RAYS)
    groups = sample_groups(rays, STRATA)
    parted = stages(rays) > 1 and (rays > FEW or visibility.dims)
    early = len(groups) // FIRST if parted else len(groups)
    slopes = lattice_generators(texels.pixel[partly], rays)
    tally = Tally.none(lamp, len(partly), len(ratio))

    def trace(chosen: Int64, first: int, last: int, turn: int = 0) -> Fractions[list[None]]:
        def work(start: int, stop: int) -> None:
            part = chosen[start:stop]
            receivers = Receivers.of(texels, partly[part])
            places = range(first, last) if not lamp.extended else [turn]
            origins = [receivers.origins(texels, STRATA * k, STRATA) for k in places]
            own = Tally.none(lamp, len(part), len(ratio))
            own.add(
                lamp, origins, receivers.normals, receivers.turned(turn), slopes[part], groups[first:last], visibility
            )
            for sums, more in zip(vars(tally).values(), vars(own).values(), strict=True):
                sums[..., part] += more

        return in_chunks(work, len(chosen), TRACE_CHUNK, workers)

    chosen = np.arange(len(partly))
    yield from scaled(trace(chosen, 0, early), 0, early / len(groups))
    ratio[:, partly] = tally.share()
    noise[:, partly] = tally.variance() * np.float32(lamp.unevenness)
    if early < len(groups):
        mixed = np.zeros(texels.count, bool)
        mixed[partly] = (tally.variance() > (EVEN if visibility.dims else 0)).any(0)
        code = shade_codes(ratio)
        low, high = np.where(mixed, 0, code), np.where(mixed, 255, code)
        low[~lit], high[~lit] = 255, 0
        near = yield from scaled(pooled_at(Shades(low, high), texels, partly, 1, workers), 0.3, 0.3)
        chosen = np.flatnonzero(near.disagree())
        first = tally.only(chosen)
        yield from scaled(trace(chosen, early, len(groups)), early / len(groups), 1)
        ratio[:, partly] = tally.share()
        noise[:, partly] = tally.variance() * np.float32(lamp.unevenness)
        if visibility.dims:
            spread = tally.only(chosen).spread(first)
            noise[:, partly[chosen]] = np.maximum(noise[:, partly[chosen]], spread)
            uneven = np.zeros(texels.count, np.uint8)
            uneven[partly[chosen]] = (spread > UNEVEN**2).any(0)
            near = yield from scaled(pooled_at(Shades(uneven, uneven), texels, partly[chosen], 1, workers), 1, 1)
            again = chosen[near.high > 0]
            for turn in range(1, AGAIN + 1):
                yield from scaled(trace(again, 0, len(groups), turn), 1, 1)
            ratio[:, partly[again]] = tally.only(again).share()
            noise[:, partly[again]] /= 1 + AGAIN
    return partly[chosen]
