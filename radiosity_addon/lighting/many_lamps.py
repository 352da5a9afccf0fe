# SPDX-License-Identifier: GPL-3.0-or-later
"""Many lamps: where each deserves shadow rays at every texel, and the light of the others, known at nodes.

Every node asks every lamp once. Where a node and those around it saw the same of a lamp, or where it gives little, the
lamp's light is fitted from the nodes; the rest is left to be treated texel by texel, with few rays where it gives
little. How much a lamp may err is measured against its own light group: groups add up as before, and dimming a group
changes none of its decisions (after lightcuts: Walter et al. 2005, whose bound is on a cluster's light; here it is on
what a fit can miss).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Float32, Int32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..columns import vectors_at
from ..geometry.texels import STRATA, Texels
from ..geometry.visibility import Visibility
from ..sampling import hash_bits, hash_uniform
from .area_lamps import PanelLamp
from .lamp_samples import rows_of
from .lamps import Lamp
from .light_nodes import LightNodes, place_nodes
from .own_faces import OwnFaces
from .shadows import shoot
from .terminator import Footing, bend_light, footing, horizons

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

FEW = 0.1
"""Standard error of the share of a lamp that one ray from each stratum of a texel finds where nodes around differ."""

JUDGED = 1 << 16
"""Pairs of a node and a lamp that are judged in one go."""

BLOCK = 1 << 15
"""Nodes that ask a lamp in one go."""

FITTED, WEAK, STRONG = range(3)
"""What is done about a lamp at the texels of a node: its light is fitted, or traced by few rays, or by all."""


@dataclass(frozen=True, eq=False)
class Survey:
    """What is to be done about L lamps at the texels of N nodes.

    Attributes:
        nodes: the nodes
        rank: (L, N) uint8, `FITTED`, `WEAK` or `STRONG`
    """

    nodes: LightNodes
    rank: NDArray[np.uint8]

    def texels_of(self, lamp: int) -> tuple[Int64, Bools]:
        """Texels (P,), in page order, at which a lamp is to be treated, and at which of them it is weak."""
        texels, node = self.nodes.members(self.rank[lamp] > FITTED)
        weak = self.rank[lamp, node] == WEAK
        alone = self.nodes.alone
        if not len(alone):
            return texels, weak
        texels = np.concatenate([texels, alone])
        weak = np.concatenate([weak, np.zeros(len(alone), bool)])
        order = np.argsort(texels, kind="stable")
        return texels[order], weak[order]


def survey(
    lamps: Sequence[Lamp],
    texels: Texels,
    visibility: Visibility,
    tolerance: float,
    total: Float32,
    own: OwnFaces,
    workers: int,
) -> Fractions[Survey]:
    """Let nodes ask lamps, decide which are to be treated at each texel, and add the light of the others.

    Args:
        tolerance: relative error that the lamps left to the nodes may add to the light of their group
        total: (T, G, 3) float32, W/m2, irradiance that the fitted light is added to
        own: faces that no lamp of theirs lights
    """
    wanted = min(texels.count / LEAST_SPACING**2, max(PAIRS / len(lamps), LEAST_NODES))
    spacing = float(np.sqrt(texels.count / max(wanted, 1)))
    nodes = yield from scaled(place_nodes(texels, visibility, spacing, workers), 0, 0.2)
    light = np.zeros((nodes.number, len(lamps)), np.float32)
    share = np.zeros((visibility.channels, nodes.number, len(lamps)), np.uint8)
    stands = [_Stand.of(texels, nodes.texel[start : start + BLOCK]) for start in range(0, nodes.number, BLOCK)]

    def ask(number: int, _: int) -> None:
        for block, stand in enumerate(stands):
            part = slice(block * BLOCK, (block + 1) * BLOCK)
            light[part, number], share[:, part, number] = stand.ask(lamps[number], number, own, visibility)

    yield from scaled(in_chunks(ask, len(lamps), 1, workers), 0.2, 0.8)
    strength = np.array([lamp.strength for lamp in lamps], np.float32)
    members = _members([lamp.group for lamp in lamps])
    rank = np.zeros((len(lamps), nodes.number), np.uint8)

    def judge(start: int, stop: int) -> None:
        near = nodes.near[start:stop]
        found = _ranks(near, light, share, strength, members, tolerance)
        rank[:, start:stop] = found.T
        fitted = (found == FITTED).astype(np.float32)
        fitted *= np.float32(1 / 255)
        field = np.zeros((*near.shape, *total.shape[1:]), np.float32)
        for column in range(near.shape[1]):
            left = light[near[:, column]] * fitted
            for channel in range(3):
                if channel < len(share):
                    arrived = left * share[channel, near[:, column]]
                for own, member in members.items():
                    some = arrived if len(members) == 1 else arrived[:, member]
                    field[:, column, own, channel] = np.einsum("nl,l->n", some, strength[member, channel])
        nodes.add(field, start, total)

    yield from scaled(in_chunks(judge, nodes.number, max(JUDGED // len(lamps), 1), workers), 0.8, 1)
    return Survey(nodes, rank)


def _members(groups: Sequence[int]) -> dict[int, Int64]:
    """The lamps of each light group."""
    return {own: np.flatnonzero(np.array(groups) == own) for own in sorted(set(groups))}


@dataclass(frozen=True, eq=False)
class _Stand:
    """Where B nodes ask lamps from.

    Attributes:
        texel: (B,) int64
        triangle: (B,) int32, of fronts
        position: (B, 3) float32, m, of the texels
        shading: (B, 3) float32, unit normals
        horizon: (B, 3) float32, unit normals of horizons, None where they are the shading normals
        normals: the same as rows (3, B)
        origins: (3, B * STRATA) float32, m, of shadow rays from each stratum
        footing: where the rays start, likewise
    """

    texel: Int64
    triangle: Int32
    position: Float32
    shading: Float32
    horizon: Float32 | None
    normals: list[Float32]
    origins: Float32
    footing: Footing | None

    @classmethod
    def of(cls, texels: Texels, texel: Int64) -> _Stand:
        shading = vectors_at(texels.shading_normal, texel)
        normal = horizons(texels, texel, shading)
        horizon = None if np.array_equal(shading, normal) else normal
        normals = [rows_of(part) for part in (shading, horizon) if part is not None]
        places = np.repeat(texel, STRATA), np.tile(np.arange(STRATA), len(texel))
        origins = rows_of(texels.origins(*places))
        triangle, stand = texels.surfaces.front[texels.triangle[texel]], footing(texels, *places)
        return cls(texel, triangle, vectors_at(texels.position, texel), shading, horizon, normals, origins, stand)

    def ask(
        self, lamp: Lamp, number: int, faces: OwnFaces, visibility: Visibility
    ) -> tuple[Float32, NDArray[np.uint8]]:
        """Unshadowed light (B,) of a lamp, and the share (C, B), of 255, of one sample that arrives."""
        light = lamp.light(self.position, self.shading, self.horizon)
        if self.footing is not None:
            bend_light(lamp, light, self.position, self.normals, self.footing.surfaces, self.triangle)
        if isinstance(lamp, PanelLamp):
            faces.put_out(lamp.emitter, light, self.triangle)
        arrives = np.full((visibility.channels, len(light)), 0 if lamp.shadow else 255, np.uint8)
        if lamp.shadow:
            lit = np.flatnonzero(light > 0)
            own = self.texel[lit]
            u, v = (hash_uniform(own, 2 * number + k) for k in (0, 1))
            place = lit * STRATA + hash_bits(own, number).astype(np.int64) % STRATA
            stand = None if self.footing is None else self.footing.only(place)
            normals = [rows.take(lit, axis=1) for rows in self.normals]
            _, share = shoot(lamp, self.origins.take(place, axis=1), normals, u, v, visibility, stand)
            arrives[:, lit] = np.ceil(share * np.float32(255))
        return light, arrives


def _ranks(
    near: NDArray[np.int32],
    light: Float32,
    share: NDArray[np.uint8],
    strength: Float32,
    members: Mapping[int, Int64],
    tolerance: float,
) -> NDArray[np.uint8]:
    """Ranks (C, L) of lamps at nodes with neighbours `near` (C, K).

    Args:
        light: (N, L) unshadowed
        share: (C, N, L), of 255
        strength: (L, 3)
        members: lamps of each light group
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
    mixed = high.astype(np.float32) - low
    mixed *= np.float32(1 / 255)
    error = mixed * np.float32(MIXED)
    np.maximum(error, np.float32(UNSURE), out=error)
    dark -= bright
    dark /= np.maximum(bright, np.float32(1e-30))
    dark *= dark
    dark *= np.float32(BENT)
    error += dark
    bright *= np.abs(strength).mean(1)
    error *= bright
    bright *= high.astype(np.float32) * np.float32(1 / 255)
    mixed *= bright
    mixed *= np.float32(FEW)
    rank = np.full(bright.shape, FITTED, np.uint8)
    for member in members.values():
        most = (np.float32(tolerance) * bright[:, member].sum(1)) ** 2
        weak = _weakest(mixed[:, member] ** 2, most)
        fitted = _weakest(error[:, member] ** 2, most)
        rank[:, member] = np.where(fitted, FITTED, np.where(weak, WEAK, STRONG))
    return rank


def _weakest(square: Float32, most: Float32) -> Bools:
    """As many (C, L) of the least of squared errors (C, L) as together are `most` (C,) or less."""
    ordered = np.sort(square, axis=1)
    count = (np.cumsum(ordered, axis=1) <= most[:, None]).sum(1)
    last = square.shape[1] - 1
    least = np.where(count <= last, ordered[np.arange(len(count)), np.minimum(count, last)], np.inf)
    weakest: Bools = square < np.maximum(least, np.float32(1e-30))[:, None]
    return weakest
