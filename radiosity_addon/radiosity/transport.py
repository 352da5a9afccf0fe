# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator on which the radiosity equation is solved: how patches exchange light.

What is estimated for F[i, j] and for F[j, i] contradicts each other within its noise. The solvers need an operator that
is reciprocal and keeps energy, so both estimates of a pair are joined and the whole is balanced.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..arrays import Float16, Float32, Float64, Int32, Int64
from ..chunks import Fractions, finish, in_chunks
from .crossing import Crossing
from .patches import NOTHING, SKY

MERGED_HITS = 1 << 20
"""Hits that are sorted at once, 20 MB."""

SUMMED_ENTRIES = 1 << 18
"""Entries of the exchange that one thread takes at a time: 1 ms of work."""

BLOCK_ENTRIES = 1 << 15
"""Entries of the exchange that are multiplied at once: 0.6 MB, in cache; larger ones cost four times as much."""

SMALL_SHARE = 0.25
"""Below this share of all entries, light is sent along the rows that shoot; above, every patch gathers."""

MOST_SWEEPS = 60
"""Sweeps of the balancing; a room takes about 20, a few patches that hardly see each other take more."""

BALANCED = 1e-7
"""Relative error of the row sums at which balancing stops; float32 entries hold no more."""

STALL_SWEEPS = 4
STALLED = 0.9
"""Balancing ends, after four times as many sweeps, when so many have not brought the error below this share of what it
was: two patches in a narrow gap that see each other alone, of unlike areas, can't both be right, and never will."""

BALANCING_POWER = 0.75
"""Exponent of a balancing step. Errors shrink by 1 - power (1 + w) for eigenvalues w of F: 1/2 settles alternating
errors in one step, but smooth ones (w near 0) slowly; 3/4 treats w in [-1/3, 1], where those of rooms lie, alike."""

SLACK_RAYS = 8
"""A row's sum may give way in balancing as if by so many rays. 8 to 16 serve alike; more make the sky's share noisy."""


@dataclass(frozen=True, eq=False)
class Transport:
    """How N patches exchange light: K = A F, symmetric and sparse, row by row.

    K[i, j] = area[i] F[i, j], with F[i, j] the share of what leaves patch i that reaches patch j.

    Attributes:
        area: (N,) float64, m2
        first: (N + 1,) int64, where the entries of each row begin
        column: (P,) int32, rising within a row
        exchange: (P,) float32, m2, entries of K
        escaped: (N,) float64, share of what leaves a patch that reaches no patch: 1 less its row's sum of F
        sky: (N,) float64, share of a patch's view that is sky: as `escaped`, but 0 where a patch is buried
        rays: (N,) float64, rays that a row was estimated from
        workers: threads
        sky_tint: (N, 3) float64, what the sky's light on a patch is multiplied with, on average, for passing surfaces
        sky_radiance: (N, 3) float64, W/(m2 sr), mean of the sky's cells over the rays of a patch that left
        crossing: which patches lie behind which, and how much comes through; None: no light passes scattered. It has
            no part in what patches receive here, but in what they make of it
        tint: (3, P) float32, what coloured glass between two patches multiplies each channel with, 1 on average over
            the channels; None: nothing between them is coloured
    """

    area: Float64
    first: Int64
    column: Int32
    exchange: Float32
    escaped: Float64
    sky: Float64
    rays: Float64
    workers: int = 1
    sky_tint: Float64 = field(default_factory=lambda: np.ones((1, 3)))
    sky_radiance: Float64 | float = 0.0
    tint: Float32 | None = None
    crossing: Crossing | None = None

    @property
    def count(self) -> int:
        return len(self.area)

    @cached_property
    def losses(self) -> Float64:
        """`escaped` by channel, (N, 1), or (N, 3) where some entries are tinted.

        What glass stops counts alike for all channels: of a colour that passes it more than the others do, too much is
        counted as absorbed there and as much too little, even less than none, as escaped.
        """
        if self.tint is None:
            return self.escaped[:, None]
        reached = _row_sums(self.first, self.column, self.exchange, np.ones((3, self.count)), self.workers, self.tint)
        return 1 - reached.T / self.area[:, None]

    def mixed(self, irradiance: Float64, channel: int | None = None) -> Float64:
        """The irradiance (N, C), W/m2, that reflectances count for, of the irradiance (N, C) on each patch.

        Args:
            channel: of all columns; None: they are red, green and blue in turn
        """
        return irradiance if self.crossing is None else self.crossing.mixed(irradiance, channel)

    def gather(self, radiosity: Float64) -> Float64:
        """Power (N, C), W, that every patch receives when all leave `radiosity` (N, C), W/m2: K @ radiosity.

        Columns are red, green and blue in turn, where entries are tinted.

        Each row is summed in float64 in its own order, whatever the number of threads.
        """
        columns = np.ascontiguousarray(radiosity.T, np.float64)
        return _row_sums(self.first, self.column, self.exchange, columns, self.workers, self.tint).T

    def scatter(self, rows: Int64, radiosity: Float64) -> Float64:
        """Power (N, C), W, that every patch receives when `rows` (S,) leave `radiosity` (S, C), W/m2."""
        lengths = self.first[rows + 1] - self.first[rows]
        total = int(lengths.sum())
        if total > SMALL_SHARE * len(self.column):
            everywhere = np.zeros((self.count, radiosity.shape[1]))
            everywhere[rows] = radiosity
            return self.gather(everywhere)
        entries = np.arange(total) + np.repeat(self.first[rows] - (np.cumsum(lengths) - lengths), lengths)
        column, exchange = self.column[entries], self.exchange[entries]
        received = []
        for number, channel in enumerate(np.asarray(radiosity, np.float64).T):
            power = exchange * np.repeat(channel, lengths)
            if self.tint is not None:
                power *= self.tint[number % 3, entries]
            received.append(np.bincount(column, weights=power, minlength=self.count))
        return np.stack(received, axis=1)

    def dense(self, channel: int | None = None) -> Float64:
        """K as an (N, N) matrix, m2, of one channel or of their mean; for small N."""
        matrix = np.zeros((self.count, self.count))
        tint = 1 if self.tint is None or channel is None else self.tint[channel]
        matrix[np.repeat(np.arange(self.count), np.diff(self.first)), self.column] = self.exchange * tint
        return matrix


@dataclass(frozen=True, eq=False)
class View:
    """What the rays of N patches met.

    Attributes:
        rays: (N,) int64, rays of each patch
        target: (R,) int32, what they met, patch after patch: a patch, SKY or NOTHING
        weights: (C,) float64, what each ray of a patch counts, 1 on average, where all patches have C; None: 1 each
        tint: (R, 3) float16, what colours the light on the way of a ray, 1 on average over channels; None: nothing
    """

    rays: Int64
    target: Int32
    weights: Float64 | None = None
    tint: Float16 | None = None

    @cached_property
    def source(self) -> Int32:
        """(R,) the patch that sent each ray."""
        return np.repeat(np.arange(len(self.rays), dtype=np.int32), self.rays)

    def weight(self, ray: Int64) -> Float64 | None:
        """Weights (Q,) of rays (Q,); None for 1 each."""
        return None if self.weights is None else self.weights[ray % len(self.weights)]

    def share(self, met: int) -> Float64:
        """Rays (N,) that met one thing, as many as they count for."""
        ray = np.flatnonzero(self.target == met)
        found = np.bincount(self.source[ray], weights=self.weight(ray), minlength=len(self.rays))
        return found.astype(np.float64)


class Rows(NamedTuple):
    """A symmetric sparse matrix, its parts as in Transport."""

    first: Int64
    column: Int32
    exchange: Float32
    tint: Float32 | None = None


def join_hits(area: Float64, view: View, workers: int) -> Fractions[Rows]:
    """A_i F_ij of N patches, m2, from what their rays met: both estimates of a pair, weighed by rays per area.

    Args:
        area: (N,) float64, m2
        view: what their rays met
        workers: threads
    """
    count = len(area)
    rays, target = view.rays, view.target
    source = view.source
    per_area = (rays - view.share(NOTHING)) / area
    begin = np.concatenate([[0], np.cumsum(rays)])
    bits = np.uint32(max(1, int(count - 1).bit_length()))

    def join(start: int, stop: int) -> tuple[Int64, Int32, Float32, Float32]:
        """Entries of rows start to stop: how many in each, their columns, exchange and tint."""
        own = slice(begin[start], begin[stop])
        sent = np.flatnonzero(target[own] >= 0) + begin[start]
        # As unsigned numbers, patches before `start` are huge: one comparison finds start <= target < stop.
        came = np.flatnonzero((target - np.int32(start)).view(np.uint32) < stop - start)
        row = np.concatenate([source[sent], target[came]]) - np.int32(start)
        keys = row.astype(np.uint32) << bits
        keys |= np.concatenate([target[sent], source[came]]).astype(np.uint32)
        rays_here = np.concatenate([sent, came])
        weight = view.weight(rays_here)
        if weight is None and view.tint is None:
            keys.sort()
        else:
            order = np.argsort(keys, kind="stable")
            keys, rays_here = keys[order], rays_here[order]
            weight = np.ones(len(keys)) if weight is None else weight[order]
        new = np.ones(len(keys) + 1, bool)
        np.not_equal(keys[1:], keys[:-1], out=new[1:-1])
        runs = np.flatnonzero(new)
        keys = keys[runs[:-1]]
        row, column = (keys >> bits).astype(np.int32), (keys & ((np.uint32(1) << bits) - np.uint32(1))).astype(np.int32)
        met = np.diff(runs) if weight is None else np.add.reduceat(np.append(weight, 0), runs[:-1])
        exchange = met / (per_area[row + start] + per_area[column])
        tint = np.empty((0, len(met)), np.float32)
        if view.tint is not None and weight is not None:
            colored = np.append(weight[:, None] * view.tint[rays_here], np.zeros((1, 3)), axis=0)
            tint = (np.add.reduceat(colored, runs[:-1]) / met[:, None]).T.astype(np.float32)
        return np.bincount(row, minlength=stop - start), column, exchange.astype(np.float32), tint

    chunk = min(max(1, MERGED_HITS * count // max(1, 2 * len(target))), 1 << (32 - int(bits)))
    parts = yield from in_chunks(join, count, chunk, workers)
    first, column, exchange = (
        np.concatenate([np.zeros(0, kind), *(part[k] for part in parts)])
        for k, kind in enumerate((np.int64, np.int32, np.float32))
    )
    tints = (
        None if view.tint is None else np.concatenate([np.zeros((3, 0), np.float32), *(p[3] for p in parts)], axis=1)
    )
    return Rows(np.concatenate([[0], np.cumsum(first)]), column, exchange, tints)


def closed(area: Float64, view: View, rows: Rows, workers: int) -> Generator[float, None, Transport]:
    """The balanced Transport of N patches from their exchange, changed in place, and from what escapes their rays."""
    first, column, exchange, tint = rows
    counted, gone = view.rays - view.share(NOTHING), view.share(SKY)
    yield from balance(area, counted - gone, counted, first, column, exchange, workers)
    reached = _row_sums(first, column, exchange, np.ones((1, len(area))), workers)[0]
    escaped = 1 - reached / area
    sky = np.where(gone > 0, np.maximum(escaped, 0), 0)
    return Transport(area, first, column, exchange, escaped, sky, counted, workers, tint=tint)


def balance(
    area: Float64, hits: Float64, rays: Float64, first: Int64, column: Int32, exchange: Float32, workers: int
) -> Generator[float, None, None]:
    """Scale the symmetric `exchange`, in place, so that each row sums to what its patch was counted to see.

    Finds d with d_i (sum_j K_ij d_j + slack_i) = seen_i + slack_i, by damped steps of the symmetric scaling of Sinkhorn
    and Knopp (Knight, Ruiz and Ucar 2014); K_ij becomes d_i K_ij d_j. Without slack two plates that face each other
    and count differently what escapes them could not both be right. The slack falls with the rays, as the variance of
    the count does, and is no more than what escapes: rows of closed rooms sum to their area, and no row to more.

    Args:
        area: (N,) float64, m2
        hits, rays: (N,) how many of a patch's rays met a patch
        first, column, exchange: rows as in Transport
        workers: threads
    """
    scale = np.ones(len(area))
    joined = np.minimum(_row_sums(first, column, exchange, scale[None], workers)[0], area)
    seen = np.where(hits > 0, area * hits / np.maximum(rays, 1), joined)  # others may have met who met none
    slack = np.minimum(area * SLACK_RAYS / np.maximum(rays, SLACK_RAYS), area - seen)
    goal = seen + slack
    errors: list[float] = []
    for sweep in range(MOST_SWEEPS):
        sums = scale * (_row_sums(first, column, exchange, scale[None], workers)[0] + slack)
        ratio = sums / goal  # never 0: a row without entries has slack
        errors.append(float(np.abs(ratio - 1).max(initial=0)))
        stalled = sweep >= 4 * STALL_SWEEPS and errors[-1] > STALLED * errors[-1 - STALL_SWEEPS]
        if errors[-1] < BALANCED or stalled:
            break
        scale *= ratio**-BALANCING_POWER
        yield sweep / MOST_SWEEPS
    _scale_entries(first, column, exchange, np.multiply, scale)
    reached = _row_sums(first, column, exchange, np.ones((1, len(area))), workers)[0]
    if (reached > area * (1 + 2 * BALANCED)).any():  # rows that can't be balanced must at least make no light
        _scale_entries(first, column, exchange, np.minimum, np.minimum(1, area / np.maximum(reached, area)))


def _scale_entries(first: Int64, column: Int32, exchange: Float32, joined: np.ufunc, scale: Float64) -> None:
    """Multiply each entry i, j by joined(scale_i, scale_j), in blocks of rows."""
    for start, stop in _row_blocks(first, 0, len(first) - 1):
        entries = slice(first[start], first[stop])
        of_row = np.repeat(scale[start:stop], np.diff(first[start : stop + 1]))
        exchange[entries] = exchange[entries] * joined(of_row, scale[column[entries]])


def _row_sums(
    first: Int64, column: Int32, exchange: Float32, values: Float64, workers: int, tint: Float32 | None = None
) -> Float64:
    """Sums (C, N) float64 over each row of its entries times values (C, N), C in turn of the tint's channels."""
    count = len(first) - 1
    sums: Float64 = np.zeros(values.shape)
    lit = np.flatnonzero(values.any(axis=1))  # light groups are often dark, or have run dry

    def add(start: int, stop: int) -> None:
        for low, high in _row_blocks(first, start, stop):
            entries = slice(first[low], first[high])
            where, factor = column[entries].astype(np.intp), exchange[entries]
            lengths = np.diff(first[low : high + 1])
            filled = np.flatnonzero(lengths)  # reduceat can't sum nothing
            begin = first[low + filled] - first[low]
            for channel in lit:
                products = np.take(values[channel], where, mode="clip")
                products *= factor
                if tint is not None:
                    products *= tint[channel % 3, entries]
                sums[channel, low + filled] = np.add.reduceat(products, begin) if len(filled) else 0

    rows = max(1, SUMMED_ENTRIES * count // max(1, int(first[-1])))
    finish(in_chunks(add, count, rows, workers))
    return sums


def _row_blocks(first: Int64, start: int, stop: int) -> list[tuple[int, int]]:
    """Rows start to stop in blocks of about BLOCK_ENTRIES entries."""
    entries = int(first[stop] - first[start])
    rows = max(1, BLOCK_ENTRIES * (stop - start) // max(1, entries))
    return [(low, min(low + rows, stop)) for low in range(start, stop, rows)]
