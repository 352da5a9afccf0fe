# SPDX-License-Identifier: GPL-3.0-or-later
"""Point and spot lights: discs that face each receiver, or spheres, perhaps behind a cone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bools, Float32, Int64
from ..scene import RGB, PointLight, SpotLight
from .distributions import Factors
from .lamp_samples import TINY, Rows, across, disc_nodes, dot, normals_of, on_disc, rows_of
from .lamps import HORIZON_NODES, TOUCHING, Lamp, cuts
from .polygons import BLOCK, cap_light

FADE_NODES = ((0.0, (2, 6)), (0.3, (6, 18)), (5.0, (32, 64)))
"""Rings and points of each over a round lamp that a spot's fade crosses: for gentle, steep and hard fades, by how much
of the fade's width the lamp takes at least."""

SMOOTH_NODES, STEEP_NODES, SPHERE_NODES = (3, 8), (12, 36), (24, 48)
"""The same over a lamp that has a distribution, where its light varies little over it, and where much; the last where
it goes by the normals of a sphere, of which half of all are seen at once."""

THINNEST_FADE = 1e-5
"""Width of a spot's hardest fade in the cosine: Cycles has none, float32 resolves this."""


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
        factors: of a lamp whose light depends on its direction or falls off otherwise, or None
    """

    strength: RGB
    position: Float32
    radius: float
    sphere: bool
    cone: SpotCone | None
    shadow: bool
    group: int
    factors: Factors | None = None

    @property
    def extended(self) -> bool:
        return self.radius > 0

    @property
    def _by_normal(self) -> bool:
        return self.sphere and self.factors is not None and self.factors.on_sphere

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
            return self._shaped(total, away, distance)
        r2 = np.float32(self.radius**2)
        inside = square <= r2 if self.sphere else np.zeros(len(square), bool)
        sine2: Float32 = np.minimum(r2 / square, 1) if self.sphere else r2 / (r2 + square)
        if self.factors is not None:
            return self._uneven_block(self.factors, p, normals, away, distance, np.sqrt(sine2), inside)
        total = cap_light(cosines[0], sine2)
        total /= np.float32(math.pi) * r2
        uneven = np.zeros(len(total), bool)
        if len(normals) > 1:
            uneven = cuts(cosines[1], sine2)
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

    def _uneven_block(
        self,
        factors: Factors,
        p: Float32,
        normals: list[Float32],
        away: list[Float32],
        distance: Float32,
        sine: Float32,
        inside: Bools,
    ) -> Float32:
        """The same with a distribution: by few nodes where its light is even over the lamp, else by many."""
        total = np.zeros(p.shape[1], np.float32)
        lit = ~inside
        steep = np.ones(len(lit), bool) if self._by_normal else factors.vary(away, sine * distance)
        for normal in normals:
            cosine = dot(away, normal) / distance
            lit &= cosine > -sine
            steep |= np.abs(cosine) < sine
        if self.cone is not None:
            steep |= self.cone.crosses(away, np.float32(self.radius) / distance)
        for few, chosen in ((True, np.flatnonzero(lit & ~steep)), (False, np.flatnonzero(lit & steep))):
            if len(chosen):
                many = SPHERE_NODES if self._by_normal else STEEP_NODES
                nodes = SMOOTH_NODES if few else max(many, self._nodes(float(np.min(distance[chosen]))))
                above = [normal[:, chosen] for normal in normals]
                total[chosen] = self.light_by_samples(p[:, chosen], above, disc_nodes(*nodes))
        total[inside] = self._shaped(np.float32(1 / self.radius**2), away, distance)[inside]
        return total

    def _shaped(self, light: Float32 | np.float32, away: Rows, distance: Float32) -> Float32:
        """Light (B,) that a lamp alike in all directions would send along -away (3, B): what of it this one sends."""
        if self.cone is not None:
            light = light * self.cone.fade(away)
        if self.factors is not None:
            light = light * self.factors.along(away, distance)
        return np.asarray(light)

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
            return away, self._shaped(np.reciprocal(square), away, np.sqrt(square))
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
        weight: Float32 = np.maximum(dot(away, away), TOUCHING)
        weight *= np.sqrt(weight)
        np.divide(dot(away, axis), weight, out=weight)
        weight *= scale * scale
        if self.sphere:
            self._end_on_sphere(away, centre)
        if self.cone is not None:
            weight *= self.cone.fade(away)
        if self.factors is not None:
            leaving = centre - away if self._by_normal else away
            weight *= self.factors.along(leaving, np.sqrt(dot(away, away)))
        return away, weight

    def _end_on_sphere(self, away: Float32, centre: Float32) -> None:
        """Shorten ways (3, B) that end where the tangent cone touches the sphere about centres (3, B) to its surface.

        What stands inside the sphere's front would otherwise hide it: a lamp that is sunk into a wall.
        """
        square = dot(away, away)
        along = dot(away, centre)
        gap = dot(centre, centre) - np.float32(self.radius**2)
        near = along - np.sqrt(np.maximum(along * along - square * gap, 0))
        away *= np.where(gap > 0, near / np.maximum(square, TINY), 1)


def round_lamps(light: PointLight | SpotLight) -> list[RoundLamp]:
    """The lamp of a point or spot light; if its distribution is of several colours, one for each."""
    lamp = RoundLamp(
        strength=light.intensity,
        position=np.array(light.position, np.float32),
        radius=light.radius,
        sphere=not light.soft_falloff and light.radius > 0,
        cone=SpotCone.of(light.axes, light.angle, light.blend) if isinstance(light, SpotLight) else None,
        shadow=light.shadow,
        group=light.group,
    )
    if light.distribution is None:
        return [lamp]
    factors = Factors.of(light.distribution)
    if len(factors) == 1:
        return [replace(lamp, factors=factors[0])]
    red, green, blue = light.intensity
    colors = (red, 0.0, 0.0), (0.0, green, 0.0), (0.0, 0.0, blue)
    return [replace(lamp, strength=color, factors=own) for color, own in zip(colors, factors, strict=True)]
