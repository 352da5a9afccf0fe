# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps as Cycles has them: unshadowed light in closed form, and points on them that shadow rays aim at.

Every lamp has a `strength` (RGB) and a scalar part that depends on the receiver alone, so that light groups,
colours and strengths never change a sample. The scalar part is defined twice, and the two must agree:
`light()` is the closed form, and the mean of `aim()`'s weight times the receiver's cosine over the unit square is
the same number. Points are blocks of three rows (x, y, z) where rays are made, (P, 3) where a caller hands them in.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float32, Float64
from ..scene import RGB, SunLight
from .lamp_samples import across, cosine_above, disc_nodes, dot, normals_of
from .polygons import BLOCK, cap_light

TOUCHING = np.float32(1e-12)
"""Squared distance, m2, below which a receiver counts as this far from a lamp: light stays finite."""

HORIZON_NODES = (6, 18)
"""Rings and points of each over a round lamp that a geometric horizon crosses."""


class Lamp(ABC):
    """Something that shines on receivers.

    Attributes:
        strength: what `light()` is multiplied with to give irradiance, W/m2
        shadow: casts shadows
        group: light group
    """

    strength: RGB
    shadow: bool
    group: int

    @property
    def extended(self) -> bool:
        """Has a size, so that its shadows have penumbrae."""
        return True

    @property
    def unevenness(self) -> float:
        """Variance of a visible share over the one of independent samples.

        Even samples err less: to 0.1 of it on average over the directions of a shadow's edge, 0.3 for the worst.
        """
        return 0.5

    @property
    def hidden_share(self) -> float:
        """Share of the samples to make good because the lamp's own body is before them."""
        return 0.0

    @abstractmethod
    def light(self, points: Float32, shading: Float32, geometric: Float32 | None) -> Float32:
        """Unshadowed irradiance per unit strength at points (P, 3) with unit normals (P, 3): (P,) float32.

        Geometric normals are None where they are the shading normals.
        """

    @abstractmethod
    def aim(self, p: Float32, u: Float32, v: Float32) -> tuple[Float32, Float32]:
        """Ways (3, B) from points p (3, B) to the lamp's samples (u, v) in [0, 1)^2, and their weights (B,)."""

    def light_by_samples(
        self, p: Float32, normals: list[Float32], nodes: Float64, bend: Float32 | None = None
    ) -> Float32:
        """`light()` as a sum over nodes (K, 3): u, v and weight; normals and bend are those of `cosine_above`."""
        total = np.empty(p.shape[1], np.float32)
        step = max(BLOCK // len(nodes), 1)
        for start in range(0, len(total), step):
            part = slice(start, start + step)
            count = len(total[part])
            u, v, share = np.repeat(nodes.T.astype(np.float32), count, axis=1)
            away, weight = self.aim(np.tile(p[:, part], len(nodes)), u, v)
            bent = None if bend is None else np.tile(bend[part], len(nodes))
            weight *= cosine_above(away, [np.tile(normal[:, part], len(nodes)) for normal in normals], bent)
            weight *= share
            total[part] = weight.reshape(-1, count).sum(0)
        return total


@dataclass(frozen=True, eq=False)
class SunLamp(Lamp):
    """A disc at infinity: `strength` is the irradiance on a plane that faces it, W/m2.

    Attributes:
        direction: (3,) float32, unit, towards the sun
        sine: of half the angular diameter
        reach: length of shadow rays, m: beyond the whole scene
    """

    strength: RGB
    direction: Float32
    sine: float
    reach: float
    shadow: bool
    group: int

    @property
    def extended(self) -> bool:
        return self.sine > 0

    def light(self, points: Float32, shading: Float32, geometric: Float32 | None) -> Float32:
        cosine = dot(shading.T, self.direction)
        if self.sine == 0:
            total: Float32 = np.maximum(cosine, 0)
        else:
            sine2 = np.array(self.sine**2, np.float32)
            total = cap_light(cosine, sine2) / (np.float32(math.pi) * sine2)
        if geometric is None:
            return total
        below = dot(geometric.T, self.direction)
        cut = np.flatnonzero(cuts(below, np.array(self.sine**2, np.float32)) & (total > 0))
        total[below <= 0] = 0
        if len(cut):
            normals = normals_of(shading[cut], geometric[cut])
            total[cut] = self.light_by_samples(np.zeros_like(normals[0]), normals, disc_nodes(*HORIZON_NODES))
        return total

    def aim(self, p: Float32, u: Float32, v: Float32) -> tuple[Float32, Float32]:
        way = np.repeat((self.direction * np.float32(self.reach))[:, None], p.shape[1], axis=1)
        if self.sine == 0:
            return way, np.ones(p.shape[1], np.float32)
        # uniform in solid angle: the height over the disc's plane is uniform between cos and 1
        height = 1 - u * np.float32(1 - math.sqrt(1 - self.sine**2))
        radius = np.sqrt((1 - height) * (1 + height)) * np.float32(self.reach)
        turn = v * np.float32(2 * math.pi)
        way *= height
        for row, part in zip(way, across(self.direction, np.cos(turn) * radius, np.sin(turn) * radius), strict=True):
            row += part
        share = 2 / (1 + math.sqrt(1 - self.sine**2))  # the cap's solid angle over its projection
        return way, np.full(p.shape[1], share, np.float32)


def cuts(cosine: Float32, sine_squared: Float32) -> Bools:
    """Where a horizon cuts a cap."""
    cut: Bools = cosine * cosine < sine_squared
    return cut


def sun_lamp(light: SunLight, reach: float) -> SunLamp:
    """The lamp of a sun; shadow rays are `reach` long, m."""
    return SunLamp(
        strength=light.irradiance,
        direction=-np.array(light.direction, np.float32),
        sine=math.sin(min(light.angle, math.pi) / 2),
        reach=reach,
        shadow=light.shadow,
        group=light.group,
    )
