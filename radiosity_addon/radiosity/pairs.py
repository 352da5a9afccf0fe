# SPDX-License-Identifier: GPL-3.0-or-later
"""Form factors as what they are by definition: the double-area integral over every pair of patches.

A_i F_ij is the integral of cos_i cos_j V / (pi r^2) over both areas. Each patch is taken as S points with a share of
its area; a point with a share a is seen as a disc is, which keeps the integrand finite where patches touch (Wallace,
Elmquist and Haines 1989, equation 13): cos_i cos_j / (pi r^2 + a). Work grows with the square of the patches: a
reference for small scenes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arrays import Float64, Int32
from ..chunks import Fractions, in_chunks
from ..geometry.visibility import Visibility
from ..sampling import hash_uniform
from .patches import Patches
from .transport import Rows

ORDERS = 64
"""Orders in which the points of one patch meet those of the other: one alone would pair them alike everywhere."""

PAIRS = 1 << 17
"""Pairs of points that are looked at in one go."""


def exchange_of_pairs(patches: Patches, visibility: Visibility, samples: int, workers: int) -> Fractions[Rows]:
    """A_i F_ij of all pairs of N patches that see each other, as rows of a symmetric matrix; yields the share done.

    Args:
        samples: points of a patch; each meets one of the other patch, in an order that differs from pair to pair

    Returns:
        first (N + 1,), column (P,), exchange (P,), m2, and tint (3, P) or None, as in Transport
    """
    count = patches.count
    everyone = np.arange(count, dtype=np.int32)
    points, normals = np.empty((2, samples, count, 3), np.float32)
    for sample in range(samples):
        points[sample], normals[sample] = patches.origins(everyone, np.full(count, sample, np.int32))
    orders = np.stack([np.argsort(hash_uniform(np.arange(samples), order)) for order in range(ORDERS)])
    cuts = list(_cuts(count))

    def work(start: int, stop: int) -> tuple[Int32, Int32, Float64]:
        rows = np.arange(cuts[start], cuts[stop])
        others = count - 1 - rows
        one = np.repeat(rows, others).astype(np.int32)
        other = np.arange(len(one)) - np.repeat(np.cumsum(others) - others, others) + one + 1
        total = np.zeros((visibility.channels, len(one)))
        mean_area = np.sqrt(patches.area[one] * patches.area[other])
        for sample in range(samples):
            chosen = orders[(31 * one + other) % ORDERS, sample]
            there = points[chosen, other]
            gap = there - points[sample, one]
            cosine = np.einsum("ij,ij->i", gap, normals[sample, one])
            cosine *= -np.einsum("ij,ij->i", gap, normals[chosen, other])
            facing = np.flatnonzero((cosine > 0) & (np.einsum("ij,ij->i", gap, normals[sample, one]) > 0))
            squared = np.einsum("ij,ij->i", gap[facing], gap[facing]).astype(np.float64)
            seen = visibility.transmitted(points[sample, one[facing]], gap[facing], both_ways=True)
            # cosines are still times the distance, both
            total[:, facing] += seen * cosine[facing] / squared / (np.pi * squared + mean_area[facing] / samples)
        kept = np.flatnonzero(total.any(0))
        one, other = one[kept], other[kept].astype(np.int32)
        return one, other, total[:, kept] * patches.area[one] * patches.area[other] / samples

    parts = yield from in_chunks(work, len(cuts) - 1, 1, workers)
    return _rows(parts, count, visibility.channels)


def _cuts(count: int) -> Iterator[int]:
    """Rows in chunks of about PAIRS pairs; row i has the pairs with all later ones."""
    before = np.concatenate([[0], np.cumsum(count - 1 - np.arange(count))]) if count else np.zeros(1, np.int64)
    wanted = np.arange(0, before[-1] + PAIRS, PAIRS)
    yield from np.unique(np.append(np.searchsorted(before, wanted).clip(0, count), [0, count]))


def _rows(parts: list[tuple[Int32, Int32, Float64]], count: int, channels: int) -> Rows:
    """Rows of the full matrix from its upper triangle, which comes row by row."""
    one, other = (np.concatenate([np.zeros(0, np.int32), *(part[k] for part in parts)]) for k in (0, 1))
    values = np.concatenate([np.zeros((channels, 0)), *(part[2] for part in parts)], axis=1)
    row = np.concatenate([other, one])
    order = np.argsort(row, kind="stable")  # the mirrored entries come first: their columns are the smaller ones
    first = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=count))]).astype(np.int64)
    mean = values.mean(0)
    tint = None if channels == 1 else np.tile(values / mean, 2)[:, order].astype(np.float32)
    return Rows(first, np.concatenate([one, other])[order], np.tile(mean, 2)[order].astype(np.float32), tint)
