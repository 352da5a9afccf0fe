# SPDX-License-Identifier: GPL-3.0-or-later
"""Where gather rays go: half over the cosine lobe, half towards what a pilot found bright.

A pilot of stratified cosine rays is pooled over the gather points of a neighbourhood into a histogram of incoming
light over world directions. The other half of the rays is drawn from that histogram, and both halves are combined
by the balance heuristic (Veach and Guibas 1995, equation 9 with exponent 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float32, Float64, Int64
from ..sampling import hash_uniform

HEIGHTS = 16
TURNS = 32
BINS = HEIGHTS * TURNS
"""Bins of equal solid angle: equal steps in z and in angle about z (Archimedes)."""

BIN_DENSITY = BINS / (4 * np.pi)
"""Density of one sample spread evenly over one bin, 1/sr."""

START_DIMENSION = 11
GOLDEN = (np.sqrt(5) - 1) / 2
PLASTIC = 0.7548776662466927
"""Inverse of the root of x^3 = x + 1: its multiples keep away from those of the golden section."""

SPREAD = 0.15
"""Share of each bin's light given to its neighbours: the next point sees the same window from a little aside."""


def direction_bins(directions: Float32) -> Int64:
    """The bin (R,) of unit directions (R, 3)."""
    height = ((directions[:, 2] + 1) * np.float32(HEIGHTS / 2)).astype(np.int32)
    turn = np.arctan2(directions[:, 1], directions[:, 0])
    turn *= np.float32(TURNS / (2 * np.pi))
    turn += np.float32(TURNS / 2)
    return np.minimum(height, HEIGHTS - 1).astype(np.int64) * TURNS + np.minimum(turn.astype(np.int32), TURNS - 1)


def pool(groups: Int64, count: int, bins: Int64, light: Float32) -> Float32:
    """Density of each bin (count, BINS) in 1/sr from pilot rays (R,) of groups; rows integrate to 1 (0 if dark)."""
    seen = np.bincount(groups * BINS + bins, weights=light, minlength=count * BINS).reshape(count, HEIGHTS, TURNS)
    wide = (1 - SPREAD) * seen
    wide += SPREAD / 4 * (np.roll(seen, 1, axis=2) + np.roll(seen, -1, axis=2))
    wide[:, 1:] += SPREAD / 4 * seen[:, :-1]
    wide[:, :-1] += SPREAD / 4 * seen[:, 1:]
    flat = wide.reshape(count, BINS)
    total = flat.sum(1, keepdims=True)
    return (flat / np.where(total > 0, total, 1) * BIN_DENSITY).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Pools:
    """Points that share their pilots, in two halves that guide each other.

    Attributes:
        order: (P,) int64, points, pool after pool
        begin: (N + 1,) int64, where pools begin among them, and the end
    """

    order: Int64
    begin: Int64

    @classmethod
    def of(cls, keys: Int64) -> Pools:
        """Of points with equal keys (P,)."""
        order = np.argsort(keys, kind="stable")
        begin = np.flatnonzero(np.concatenate([[True], np.diff(keys[order]) != 0])[: len(keys)])
        return cls(order, np.append(begin, len(keys)))

    @property
    def size(self) -> Int64:
        """(N,) int64, points in each."""
        return np.asarray(np.diff(self.begin), np.int64)

    def sums(self, values: Int64) -> Int64:
        """Sums (N,) of values (P,) over the points of each."""
        return np.asarray(np.diff(np.append(0, np.cumsum(values[self.order]))[self.begin]), np.int64)

    def members(self, some: Int64) -> tuple[Int64, Int64, Float64]:
        """Points (K,) of some pools (M,), in which of their 2 M halves they are, and where their sweeps start."""
        size = self.size[some]
        place = np.repeat(np.arange(len(some)), size)
        rank = np.arange(len(place)) - np.repeat(np.cumsum(size) - size, size)
        half = rank % 2
        starts = sweep_starts(2 * some[place] + half, rank // 2)
        return self.order[self.begin[some][place] + rank], 2 * place + half, starts


def cut_apart(size: Int64, most: int) -> Int64:
    """Pools at which chunks begin, and N: of about `most` points, where pools hold `size` (N,), or one larger pool."""
    before = np.cumsum(size) - size
    wanted = np.arange(0, int(size.sum()), most)
    inner = np.unique(np.searchsorted(before, wanted))[:-1]
    return np.asarray(np.unique(np.concatenate([[0], inner, [len(size)]])), np.int64)


def sweep_starts(group: Int64, rank: Int64) -> Float64:
    """Where between two samples the sweeps (Q,) begin of points of this rank in their groups (Q,).

    Points one after the other begin a golden section of a step apart: their errors cancel where the fit joins them,
    while those of equal draws would stay.
    """
    return np.asarray((hash_uniform(group, START_DIMENSION) + rank * GOLDEN) % 1, np.float64)


def next_starts(begin: Float64, look: Int64) -> Float64:
    """Where sweeps (Q,) begin of points that look again for the first, second ... time (Q,)."""
    return np.asarray((begin + look * PLASTIC) % 1, np.float64)


def draw_bins(density: Float32, samples: int, row: Int64, begin: Float64) -> Int64:
    """Bins (Q, samples) drawn in proportion to the densities of rows (Q,) by one systematic sweep each; dark rows: any.

    Args:
        density: (groups, BINS), 1/sr
        begin: (Q,) in [0, 1), of `sweep_starts`
    """
    edges = np.cumsum(density.astype(np.float64) / BIN_DENSITY, axis=1)
    places = (begin[:, None] + np.arange(samples)) / samples * edges[row, -1:]
    edges += 2.0 * np.arange(len(density))[:, None]  # every row above the last, so that one search serves all
    found = np.searchsorted(edges.reshape(-1), (places + 2.0 * row[:, None]).reshape(-1), side="right")
    bins = found.reshape(places.shape) - row[:, None] * BINS
    within: Int64 = np.clip(bins, 0, BINS - 1)
    return within


def directions_in(bins: Int64, u: Float32, v: Float32) -> Float32:
    """Unit directions (R, 3) at u, v in [0, 1) within bins (R,)."""
    z = ((bins // TURNS).astype(np.float32) + u) * np.float32(2 / HEIGHTS) - 1
    turn = ((bins % TURNS).astype(np.float32) + v) * np.float32(2 * np.pi / TURNS) - np.float32(np.pi)
    radius = np.sqrt(np.maximum(1 - z * z, 0))
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)
