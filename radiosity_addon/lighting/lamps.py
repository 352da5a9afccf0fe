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

from ..arrays import Bools, Float32, Float64, Int64
from ..scene import RGB, PointLight, SpotLight, SunLight
from .lamp_samples import TINY, Rows, across, cosine_above, disc_nodes, dot, normals_of, on_disc, rows_of
from .polygons import BLOCK, cap_light

TOUCHING = np.float32(1e-12)
"""Squared distance, m2, below which a receiver counts as this far from a lamp: light stays finite."""

FADE_NODES = ((0.0, (2, 6)), (0.3, (6, 18)), (5.0, (32, 64)))
"""Rings and points of each over a round lamp that a spot's fade crosses: for gentle, steep and hard fades, by how much
of the fade's width the lamp takes at least."""

HORIZON_NODES = (6, 18)
"""The same where a geometric horizon crosses it."""


THINNEST_FADE = 1e-5
"""Width of a spot's hardest fade in the cosine: Cycles has none, float32 resolves this."""


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
class SpotCone:
    """A spot's fade: smoothstep in the cosine, measured in the lamp's own, possibly stretched space.

    Attributes:
        axes: (3, 3) float32, rows: local x, y and the axis, each divided by the object's scale along it
        edge: cosine of half the cone's angle
        slope: 1 / the fade's width in the cosine
    """

    axes: Float32
    edge: float
    slope: float

    @classmethod
    def of(cls, axes: tuple[RGB, RGB, RGB], angle: float, blend: float) -> SpotCone:
        """The cone of a spot of full `angle`, radians, whose share `blend` fades."""
        edge = math.cos(angle / 2)
        return cls(np.array(axes, np.float32), edge, 1 / max(THINNEST_FADE, (1 - edge) * blend))

    def fade(self, away: Rows) -> Float32:
        """Share (B,) of the light that goes along -away (3, B)."""
        step = self._step(away)
        np.clip(step, 0, 1, out=step)
        smooth: Float32 = step * step * (3 - 2 * step)
        return smooth

    def crosses(self, away: Rows, reach: Float32) -> Bools:
        """Where the fade may lie within a lamp of `reach` (B,) radii over distance; errs on the safe side."""
        margin = self._margin(reach)
        step = self._step(away)
        found: Bools = (step > -margin) & (step < 1 + margin)
        return found

    def reaches(self, away: Rows, reach: Float32) -> Bools:
        """Where light of a lamp of `reach` (B,) radii over distance may come; errs on the safe side."""
        found: Bools = self._step(away) > -self._margin(reach)
        return found

    def _margin(self, reach: Float32) -> Float32:
        """How far the fade's step may vary over a lamp of `reach` (B,)."""
        scales = np.linalg.norm(self.axes, axis=1)
        margin: Float32 = reach * np.float32(math.pi / 2 * self.slope * np.max(scales) / np.min(scales))
        return margin

    def _step(self, away: Rows) -> Float32:
        """0 where the fade begins, 1 where it ends, (B,)."""
        x, y, z = (-dot(away, axis) for axis in self.axes)
        step: Float32 = z / np.sqrt(np.maximum(x * x + y * y + z * z, TINY))
        step -= np.float32(self.edge)
        step *= np.float32(self.slope)
        return step


@dataclass(frozen=True, eq=False)
class RoundLamp(Lamp):
    """A point or spot light: `strength` is its intensity, W/sr.

    Cycles' soft falloff is a disc of the radius that faces each receiver; without it the lamp is a sphere. From
    outside a sphere looks like the disc where the tangent cone touches it, so both are one case. Inside a sphere
    light comes alike from everywhere, without the spot's fade.

    Attributes:
        position: (3,) float32, m
        radius: m
        sphere: a sphere, not a disc
        cone: a spot's, or None
    """

    strength: RGB
    position: Float32
    radius: float
    sphere: bool
    cone: SpotCone | None
    shadow: bool
    group: int

    @property
    def extended(self) -> bool:
        return self.radius > 0

    def light(self, points: Float32, shading: Float32, geometric: Float32 | None) -> Float32:
        result = np.zeros(len(points), np.float32)
        for start in range(0, len(points), BLOCK):
            part = slice(start, start + BLOCK)
            p = rows_of(points[part])
            normals = normals_of(shading[part], None if geometric is None else geometric[part])
            chosen = self._reached(p, normals)
            if len(chosen) < p.shape[1]:
                result[start + chosen] = self._block(p[:, chosen], [rows[:, chosen] for rows in normals])
            else:
                result[part] = self._block(p, normals)
        return result

    def _reached(self, p: Float32, normals: list[Float32]) -> Int64:
        """Those of the points p (3, B) over whose horizons the lamp may rise, and that its cone may reach."""
        away = [self.position[k] - p[k] for k in range(3)]
        reached = dot(away, normals[0]) > np.float32(-1.001 * self.radius)
        for normal in normals[1:]:
            reached &= dot(away, normal) > np.float32(-1.001 * self.radius)
        if self.cone is not None:
            some = np.flatnonzero(reached)
            away = [row.take(some) for row in away]
            square = dot(away, away)
            distance: Float32 = np.sqrt(np.maximum(square, TOUCHING))
            lit = self.cone.reaches(away, np.float32(self.radius) / distance)
            if self.sphere:
                lit |= square <= np.float32(self.radius**2)
            return some[lit]
        return np.flatnonzero(reached)

    def _block(self, p: Float32, normals: list[Float32]) -> Float32:
        away = [self.position[k] - p[k] for k in range(3)]
        square: Float32 = np.maximum(dot(away, away), TOUCHING)
        distance: Float32 = np.sqrt(square)
        cosines = [dot(away, normal) / distance for normal in normals]
        if self.radius == 0:
            total: Float32 = np.maximum(cosines[0], 0) / square
            if len(normals) > 1:
                total[cosines[1] <= 0] = 0
            return total if self.cone is None else total * self.cone.fade(away)
        r2 = np.float32(self.radius**2)
        inside = square <= r2 if self.sphere else np.zeros(len(square), bool)
        sine2: Float32 = np.minimum(r2 / square, 1) if self.sphere else r2 / (r2 + square)
        total = cap_light(cosines[0], sine2)
        total /= np.float32(math.pi) * r2
        uneven = np.zeros(len(total), bool)
        if len(normals) > 1:
            uneven = _cut(cosines[1], sine2)
            total[(cosines[1] < 0) & ~uneven] = 0
            uneven &= cosines[0] > -np.sqrt(sine2)
        if self.cone is not None:
            total *= self.cone.fade(away)
            fading = self.cone.crosses(away, np.float32(self.radius) / distance)
            uneven |= fading & (cosines[0] > -np.sqrt(sine2))
        total[inside] = 1 / r2
        chosen = np.flatnonzero(uneven & ~inside)
        if len(chosen):
            nodes = disc_nodes(*self._nodes(float(np.min(distance[chosen]))))
            total[chosen] = self.light_by_samples(p[:, chosen], [normal[:, chosen] for normal in normals], nodes)
        return total

    def _nodes(self, nearest: float) -> tuple[int, int]:
        """Nodes that serve receivers from `nearest` on, m."""
        if self.cone is None:
            return HORIZON_NODES
        steepness = self.cone.slope * self.radius / nearest
        return next(nodes for least, nodes in reversed(FADE_NODES) if steepness >= least)

    def aim(self, p: Float32, u: Float32, v: Float32) -> tuple[Float32, Float32]:
        away: Float32 = self.position[:, None] - p
        square: Float32 = np.maximum(dot(away, away), TOUCHING)
        if self.radius == 0:
            weight: Float32 = np.reciprocal(square)
            return away, weight if self.cone is None else weight * self.cone.fade(away)
        distance: Float32 = np.sqrt(square)
        axis: Float32 = away / distance
        centre = away.copy() if self.sphere else away
        scale: Float32 | np.float32 = np.float32(1)
        if self.sphere:
            r2 = np.float32(self.radius**2)
            # from inside, a lamp that fills half the sky
            np.maximum(square, np.float32(1.001 * self.radius**2), out=square)
            away -= axis * (r2 / np.maximum(distance, np.float32(self.radius)))
            scale = np.sqrt(1 - r2 / square)
            nearest = scale * np.float32(0.03 * self.radius)
            distance = np.maximum(distance - r2 / distance, nearest)
        x, y = on_disc(u, v)
        radius = scale * np.float32(self.radius)
        x *= radius
        y *= radius
        for row, part in zip(away, across(axis, x, y), strict=True):
            row += part
        weight = np.maximum(dot(away, away), TOUCHING)
        weight *= np.sqrt(weight)
        np.divide(dot(away, axis), weight, out=weight)
        weight *= scale * scale
        if self.sphere:
            self._end_on_sphere(away, centre)
        return away, weight if self.cone is None else weight * self.cone.fade(away)

    def _end_on_sphere(self, away: Float32, centre: Float32) -> None:
        """Shorten ways (3, B) that end where the tangent cone touches the sphere about centres (3, B) to its surface.

        What stands inside the sphere's front would otherwise hide it: a lamp that is sunk into a wall.
        """
        square = dot(away, away)
        along = dot(away, centre)
        gap = dot(centre, centre) - np.float32(self.radius**2)
        near = along - np.sqrt(np.maximum(along * along - square * gap, 0))
        away *= np.where(gap > 0, near / np.maximum(square, TINY), 1)


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
        cut = np.flatnonzero(_cut(below, np.array(self.sine**2, np.float32)) & (total > 0))
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


def _cut(cosine: Float32, sine_squared: Float32) -> Bools:
    """Where a horizon cuts a cap."""
    cut: Bools = cosine * cosine < sine_squared
    return cut


def round_lamp(light: PointLight | SpotLight) -> RoundLamp:
    """The lamp of a point or spot light."""
    return RoundLamp(
        strength=light.intensity,
        position=np.array(light.position, np.float32),
        radius=light.radius,
        sphere=not light.soft_falloff and light.radius > 0,
        cone=SpotCone.of(light.axes, light.angle, light.blend) if isinstance(light, SpotLight) else None,
        shadow=light.shadow,
        group=light.group,
    )


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
