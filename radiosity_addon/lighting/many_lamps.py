# SPDX-License-Identifier: GPL-3.0-or-later
"""Many lamps: where each deserves shadow rays at every texel, and the light of the others, known at nodes.

Every node asks every lamp once. Where a node and those around it saw the same of a lamp, or where it gives little, the
lamp's light is fitted from the nodes; the rest is left to be treated texel by texel. How much a lamp may err is
measured against its own light group: groups add up as before, and dimming a group changes none of its decisions
(after lightcuts: Walter et al. 2005, whose bound is on a cluster's light; here it is on what a fit can miss).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Float32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..geometry.texels import STRATA, Texels
from ..geometry.visibility import Visibility
from ..sampling import hash_bits, hash_uniform
from .lamp_samples import normals_of, rows_of
from .lamps import Lamp
from .light_nodes import LightNodes, place_nodes
from .shadows import shoot
from .terminator import footing, horizons

LEAST_SPACING = 4.0
"""Texels between nodes, at least."""

PAIRS = 1 << 24
"""Pairs of a node and a lamp, about, at most: what they found takes 7 bytes each."""

LEAST_NODES = 4096
"""Nodes are not made fewer than this, however many the lamps."""

MIXED = 0.3
"""Standard error of the share of a lamp that a fit finds where nodes around differ in what they see of it."""

UNSURE = 0.04
"""The same where they agree: about ten rays may have missed something."""

BENT = 0.3
"""A fit errs by so much of a lamp's light times the square of the light's relative range among the nodes around."""

CHUNK = 64
"""Nodes judged in one go."""

BLOCK = 1 << 15
"""Nodes that ask a lamp in one go."""


@dataclass(frozen=True, eq=False)
class Survey:
    """What N nodes found of L lamps.

    Attributes:
        nodes: the nodes
        light: (N, L) float32, unshadowed, per unit strength
        share: (C, N, L) uint8, of 255, what arrives of it
        near: (L, N) bool, lamps to be treated at each texel around a node
        field: (N, G, 3) float32, W/m2, light of all others at the nodes
    """

    nodes: LightNodes
    light: Float32
    share: NDArray[np.uint8]
    near: Bools
    field: Float32

    def texels_of(self, lamp: int) -> tuple[Int64, Float32]:
        """Texels (P,), in page order, at which a lamp is to be treated, and its light (C, P) that `field` has there."""
        chosen = self.nodes.members(self.nodes.around(self.near[lamp]))
        left = np.where(self.near[lamp], 0, self.light[:, lamp] * (self.share[:, :, lamp] * np.float32(1 / 255)))
        fitted = self.nodes.at(np.ascontiguousarray(left.T), chosen).T
        alone = self.nodes.alone
        if not len(alone):
            return chosen, fitted
        texels = np.concatenate([chosen, alone])
        fitted = np.concatenate([fitted, np.zeros((len(fitted), len(alone)), np.float32)], axis=1)
        order = np.argsort(texels, kind="stable")
        return texels[order], fitted[:, order]

    def add_field(self, total: Float32, workers: int) -> Fractions[list[None]]:
        """Add the light of `field` to irradiance (T, G, 3)."""
        texels = self.nodes.members(np.ones(self.nodes.number, bool))

        def work(start: int, stop: int) -> None:
            part = texels[start:stop]
            total[part] += self.nodes.at(self.field, part)

        return in_chunks(work, len(texels), BLOCK, workers)


def survey(
    lamps: Sequence[Lamp],
    texels: Texels,
    visibility: Visibility,
    tolerance: float,
    group_count: int,
    workers: int,
) -> Fractions[Survey]:
    """Let nodes ask lamps, and decide which are to be treated at each texel.

    Args:
        tolerance: relative error that the lamps left to the nodes may add to the light of their group
    """
    wanted = min(texels.count / LEAST_SPACING**2, max(PAIRS / len(lamps), LEAST_NODES))
    spacing = float(np.sqrt(texels.count / max(wanted, 1)))
    nodes = yield from scaled(place_nodes(texels, visibility, spacing, workers), 0, 0.2)
    light = np.zeros((nodes.number, len(lamps)), np.float32)
    share = np.zeros((visibility.channels, nodes.number, len(lamps)), np.uint8)

    def ask(number: int, _: int) -> None:
        light[:, number], share[:, :, number] = _asked(lamps[number], number, nodes, visibility)

    yield from scaled(in_chunks(ask, len(lamps), 1, workers), 0.2, 0.8)
    strength = np.array([lamp.strength for lamp in lamps], np.float32)
    group = np.array([lamp.group for lamp in lamps])
    near = np.zeros((len(lamps), nodes.number), bool)
    field = np.zeros((nodes.number, group_count, 3), np.float32)

    def judge(start: int, stop: int) -> None:
        part = slice(start, stop)
        unfit = _unfit(nodes.near[part], light, share, strength, group, tolerance)
        near[:, part] = unfit.T
        left = np.where(unfit, 0, light[part])
        for channel in range(3):
            arrived = left * share[channel % len(share), part] * (strength[:, channel] / np.float32(255))
            for own in np.unique(group):
                field[part, own, channel] = arrived[:, group == own].sum(1)

    yield from scaled(in_chunks(judge, nodes.number, CHUNK, workers), 0.8, 1)
    return Survey(nodes, light, share, near, field)


def _asked(lamp: Lamp, number: int, nodes: LightNodes, visibility: Visibility) -> tuple[Float32, NDArray[np.uint8]]:
    """Unshadowed light (N,) of a lamp at the nodes, and the share (C, N), of 255, of one sample that arrives."""
    texels = nodes.texels
    light = np.empty(nodes.number, np.float32)
    arrives = np.full((visibility.channels, nodes.number), 255, np.uint8)
    stratum = hash_bits(nodes.texel, number).astype(np.int64) % STRATA
    for start in range(0, nodes.number, BLOCK):
        part = slice(start, start + BLOCK)
        own = nodes.texel[part]
        shading = texels.shading_normal[own]
        normal = horizons(texels, own, shading)
        bent = None if np.array_equal(shading, normal) else normal
        light[part] = lamp.light(texels.position[own], shading, bent)
        if not lamp.shadow:
            continue
        lit = np.flatnonzero(light[part] > 0)
        u, v = (hash_uniform(own[lit], 2 * number + k) for k in (0, 1))
        places = own[lit], stratum[part][lit]
        p = rows_of(texels.origins(*places))
        normals = normals_of(shading[lit], None if bent is None else normal[lit])
        _, share = shoot(lamp, p, normals, u, v, visibility, footing(texels, *places))
        arrives[:, part] = 0
        arrives[:, start + lit] = np.ceil(share * np.float32(255))
    return light, arrives


def _unfit(
    near: NDArray[np.int32],
    light: Float32,
    share: NDArray[np.uint8],
    strength: Float32,
    group: NDArray[np.int64],
    tolerance: float,
) -> Bools:
    """Which lamps (C, L) are not left to the fit at nodes with neighbours `near` (C, K): the weakest are.

    Args:
        light: (N, L) unshadowed
        share: (C, N, L), of 255
        strength: (L, 3)
        group: (L,)
    """
    seen = share[0] if len(share) == 1 else share.mean(0, dtype=np.float32)
    low = high = seen[near[:, 0]]
    bright = light[near[:, 0]].copy()
    dark = bright.copy()
    for column in near.T[1:]:
        own, lit = seen[column], light[column]
        low, high = np.minimum(low, own), np.maximum(high, own)
        np.maximum(bright, lit, out=bright)
        np.minimum(dark, lit, out=dark)
    error = (high.astype(np.float32) - low) * np.float32(MIXED / 255)
    np.maximum(error, np.float32(UNSURE), out=error)
    dark -= bright
    dark /= np.maximum(bright, np.float32(1e-30))
    dark *= dark
    dark *= np.float32(BENT)
    error += dark
    bright *= np.abs(strength).mean(1)
    error *= bright
    bright *= high.astype(np.float32) * np.float32(1 / 255)
    unfit = np.zeros(bright.shape, bool)
    for own in np.unique(group):
        member = np.flatnonzero(group == own)
        square = error[:, member] ** 2
        ordered = np.sort(square, axis=1)
        most = (np.float32(tolerance) * bright[:, member].sum(1)) ** 2
        left = (np.cumsum(ordered, axis=1) <= most[:, None]).sum(1)  # so many of the weakest together err that little
        least = np.where(left < len(member), ordered[np.arange(len(left)), np.minimum(left, len(member) - 1)], np.inf)
        unfit[:, member] = square >= np.maximum(least, np.float32(1e-30))[:, None]
    return unfit
