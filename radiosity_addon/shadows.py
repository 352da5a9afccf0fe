# SPDX-License-Identifier: GPL-3.0-or-later
"""Shadow rays: what share of a lamp a texel sees, and which texels need to ask."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .arrays import Float32, Int64
from .chunks import Fractions, in_chunks
from .lamp_samples import cosine_above, lattice, normals_of, pixel_shifts, rows_of, shifted
from .lamps import Lamp
from .texels import STRATA, Texels
from .visibility import Visibility

Bytes: TypeAlias = NDArray[np.uint8]

TRACE_CHUNK = 1 << 13
"""Partly lit texels traced in one go."""

BAND = 512
"""Rows of a page whose probes are pooled in one go."""

POOL = 2
"""Probes are pooled over this many texels to every side."""

EDGE_RAYS = 64
"""Shadow rays of a texel where a lamp without size casts an edge: they only find the lit share of the footprint."""


@dataclass(frozen=True, eq=False)
class Receivers:
    """B texels about to be lit.

    Attributes:
        ids: (B,) int64, texels
        points: (B, 3) float32, m
        shading: (B, 3) float32, unit normals
        geometric: the same of the surface, None where all are the shading normals
        normals: shading and, if there, geometric normals as rows (3, B)
        shifts: (B,) float32 each, of the samples' u and v
        turn: (B,) int64, stratum of the footprint that sample 0 starts from
    """

    ids: Int64
    points: Float32
    shading: Float32
    geometric: Float32 | None
    normals: list[Float32]
    shifts: tuple[Float32, Float32]
    turn: Int64

    @classmethod
    def of(cls, texels: Texels, ids: Int64) -> Receivers:
        """The receivers at texels `ids`. Neighbours differ in their samples so that they complement each other."""
        shading, normal = texels.shading_normal[ids], texels.normal[ids]
        geometric = None if np.array_equal(shading, normal) else normal
        pixel = texels.pixel[ids]
        return cls(
            ids=ids,
            points=texels.position[ids],
            shading=shading,
            geometric=geometric,
            normals=normals_of(shading, geometric),
            shifts=pixel_shifts(pixel, texels.size),
            turn=pixel + 2 * (pixel // texels.size),
        )

    def origins(self, texels: Texels, sample: int) -> Float32:
        """Origins (3, B) of each one's shadow ray number `sample`."""
        turned = (sample + self.turn) % STRATA + sample // STRATA * STRATA
        return rows_of(texels.origins(self.ids, turned))

    def only(self, chosen: Int64) -> Receivers:
        """Those at positions `chosen`."""
        if len(chosen) == len(self.ids):
            return self
        return Receivers(
            ids=self.ids[chosen],
            points=self.points[chosen],
            shading=self.shading[chosen],
            geometric=None if self.geometric is None else self.geometric[chosen],
            normals=[rows[:, chosen] for rows in self.normals],
            shifts=(self.shifts[0][chosen], self.shifts[1][chosen]),
            turn=self.turn[chosen],
        )


def shoot(
    lamp: Lamp, p: Float32, normals: list[Float32], u: Float32, v: Float32, visibility: Visibility
) -> tuple[Float32, Float32]:
    """Light of the lamp's samples (u, v) at points p (3, B): all of it and the part that arrives, (B,) each."""
    way, weight = lamp.aim(p, u, v)
    weight *= cosine_above(way, normals)
    arrived = weight.copy()
    live = np.flatnonzero(weight > 0)
    if len(live) == len(weight):
        arrived[visibility.occluded(rays_of(p), rays_of(way))] = 0
    elif len(live):
        arrived[live[visibility.occluded(rays_of(p[:, live]), rays_of(way[:, live]))]] = 0
    return weight, arrived


def rays_of(rows: Float32) -> Float32:
    """Three rows as (B, 3)."""
    return np.ascontiguousarray(rows.T)


def visible_share(
    lamp: Lamp,
    origins: Sequence[Float32],
    normals: list[Float32],
    shifts: tuple[Float32, Float32],
    count: int,
    visibility: Visibility,
) -> tuple[Float32, Float32]:
    """The part of a lamp's light that arrives, (B,) float32 in 0..1, and its variance if its samples were
    independent, told by two halves of them; 1 and 0 where no sample has any light.

    A ratio of two sums over the same samples: the shape of the integrand drops out, and what stays is the shadow.

    Args:
        origins: rows (3, B), taken in turn
        shifts: (B,) each, of the sample lattice
        count: samples
    """
    total, arrived = np.zeros((2, 2, len(shifts[0])), np.float32)
    for k, (u, v) in enumerate(lattice(count)):
        p = origins[k % len(origins)]
        weight, part = shoot(lamp, p, normals, shifted(u, shifts[0]), shifted(v, shifts[1]), visibility)
        half = k // STRATA % 2  # both halves go through all strata of the footprint
        total[half] += weight
        arrived[half] += part
    one, two = (_share(arrived[half], total[half]) for half in (0, 1))
    variance: Float32 = np.square((one - two) * np.float32(0.5))
    return _share(arrived.sum(0), total.sum(0)), variance


def _share(part: Float32, whole: Float32) -> Float32:
    share: Float32 = np.where(whole > 0, part / np.where(whole > 0, whole, 1), np.float32(1))
    return share


def trace_partly(
    lamp: Lamp,
    texels: Texels,
    partly: Int64,
    ratio: Float32,
    noise: Float32,
    visibility: Visibility,
    count: int,
    workers: int,
) -> Fractions[list[None]]:
    """Trace `count` shadow rays from each of the texels `partly`: the share seen to `ratio`, its variance to `noise`.

    Args:
        partly: (N,) int64
        ratio, noise: (T,) float32, written at `partly`
    """
    rays = round(count / (1 - lamp.hidden_share)) if lamp.extended else min(count, EDGE_RAYS)
    distinct = STRATA if lamp.extended else rays

    def work(start: int, stop: int) -> None:
        receivers = Receivers.of(texels, partly[start:stop])
        origins = [receivers.origins(texels, k) for k in range(distinct)]
        seen, variance = visible_share(lamp, origins, receivers.normals, receivers.shifts, rays, visibility)
        ratio[receivers.ids] = seen
        noise[receivers.ids] = variance * np.float32(lamp.unevenness)

    return in_chunks(work, len(partly), TRACE_CHUNK, workers)


def pool_probes(
    seen: Bytes,
    shot: Bytes,
    texels: Texels,
    ratio: Float32,
    workers: int,
) -> Fractions[list[Int64]]:
    """Decide from the probes of each 5 x 5 neighbourhood on a page who is lit.

    Args:
        seen, shot: (T,) uint8, probes that reached the lamp, and all probes
        ratio: (T,) float32, set to 0 for the fully shadowed and to 1 for the others
    Returns:
        texels that are partly lit, in chunks; a texel whose light no probe could try is one of them
    """
    size = texels.size
    bands = -(-size // BAND)

    def work(start: int, stop: int) -> Int64:
        page, band = divmod(start, bands)
        first, last = band * BAND, min((band + 1) * BAND, size)
        low, high = max(first - POOL, 0), min(last + POOL, size)
        base = page * size * size
        ends = np.searchsorted(texels.pixel, [base + row * size for row in (low, first, last, high)])
        place = texels.pixel[ends[0] : ends[3]] - (base + low * size)
        sums = []
        for counts in (seen, shot):
            image = np.zeros((high - low) * size, np.uint8)
            image[place] = counts[ends[0] : ends[3]]
            sums.append(_box_sum(image.reshape(-1, size)).reshape(-1)[place[ends[1] - ends[0] : ends[2] - ends[0]]])
        own = slice(ends[1], ends[2])
        ratio[own] = (sums[0] > 0) | (sums[1] == 0)
        partly: Int64 = ends[1] + np.flatnonzero((sums[0] < sums[1]) & (sums[0] > 0))
        return partly

    return in_chunks(work, texels.page_count * bands, 1, workers)


def _box_sum(image: Bytes) -> Bytes:
    """Sums over squares of 2 POOL + 1 pixels; uint8 holds 25 times 10 probes."""
    for axis in (0, 1):
        total = image.copy()
        ahead, behind = np.moveaxis(total, axis, 0), np.moveaxis(image, axis, 0)
        for step in range(1, POOL + 1):
            ahead[step:] += behind[:-step]
            ahead[:-step] += behind[step:]
        image = total
    return image
