# SPDX-License-Identifier: GPL-3.0-or-later
"""Flat lamps: polygons that radiate alike in all directions, and softboxes whose spread is narrowed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arrays import Bools, Float32, Int32
from ..scene import RGB, AreaLight
from .lamp_samples import TINY, dot, gauss_nodes, normals_of, on_disc, outside, rows_of
from .lamps import TOUCHING, Lamp
from .polygons import BLOCK, Polygon, ellipse, parallelogram, polygon_light

SPREAD_NODES = 12
"""Gauss points along each side of the part of an area lamp that a narrowed spread lets a receiver see."""

CUT_NODES = 24
"""The same where a horizon cuts it: the cosine's kink there takes more (12 points err by 0.6 %, 24 by 0.03 %)."""

SLOTS = 32
"""Slots of a row of the unit square for each of its cells, on average; finding a sample's cell is then one look-up."""

HIDDEN = 0.4
"""Share of a body's samples that further ones make good: half is hidden, but they are even in two ways."""

SPREAD_LEAST = 2e-3
"""Radians. Narrower spreads are taken as this: no one sees the difference, and float32 still resolves the fade."""

FULL_SPREAD = 3.14
"""Radians. From here on a lamp is Lambertian; the softbox's formula has 0 times infinity at pi."""


@dataclass(frozen=True, eq=False)
class PanelLamp(Lamp):
    """Lambertian polygons of one emitter: `strength` is their radiance, W/(m2 sr).

    Attributes:
        polygons: for the closed form
        corner, edge_u, edge_v: (M, 3) float32, m, the cells that samples are spread over
        normal: (M, 3) float32, unit, their fronts
        ends: (M,) float32, the cells' areas added up, the last one 1
        shape: what a cell is: "parallelogram", "triangle" (at its corner) or "ellipse" (corner is its centre, the
            edges are half axes)
        area: m2
        two_sided: shines to both sides
        box: (2, 3) float32 lowest and highest corner: a closed body, which receivers outside the box see from its front
            only, those inside it from both if it is two-sided; None for others
        emitter: number of the emissive surface that it stands for; -1 for none
        leads: it is that surface's first lamp, with which goes what the surface throws on itself
    """

    strength: RGB
    polygons: tuple[Polygon, ...]
    corner: Float32
    edge_u: Float32
    edge_v: Float32
    normal: Float32
    ends: Float32
    shape: str
    area: float
    two_sided: bool
    box: Float32 | None
    shadow: bool
    group: int
    emitter: int = -1
    leads: bool = False

    @property
    def unevenness(self) -> float:
        return super().unevenness if len(self.ends) == 1 else 0.5

    @property
    def hidden_share(self) -> float:
        return 0.0 if self.box is None else HIDDEN

    def light(self, points: Float32, shading: Float32, geometric: Float32 | None) -> Float32:
        total = np.zeros(len(points), np.float32)
        for polygon in self.polygons:
            total += polygon_light(polygon, points, shading, geometric)
        if self.box is not None and self.two_sided:
            within = np.flatnonzero(~outside(self.box, points.T))
            if len(within):
                below = None if geometric is None else geometric[within]
                total[within] = 0
                for polygon in self.polygons:
                    both = replace(polygon, two_sided=True)
                    total[within] += polygon_light(both, points[within], shading[within], below)
        return total

    def aim(self, p: Float32, u: Float32, v: Float32) -> tuple[Float32, Float32]:
        way, weight, _ = self.aim_at_cells(p, u, v)
        return way, weight

    def aim_at_cells(self, p: Float32, u: Float32, v: Float32) -> tuple[Float32, Float32, Int32]:
        """As `aim`, and the cells (B,) that the samples lie in."""
        cell = np.zeros(0, np.int32)
        if len(self.ends) == 1:
            cell = np.zeros(len(u), np.int32)
            corner, edge_u, edge_v = (part[0][:, None] for part in (self.corner, self.edge_u, self.edge_v))
            normal = self.normal[0] * np.float32(-self.area)
        else:
            slots, fields = self._slots
            rows, columns = slots.shape
            u = u * np.float32(rows)
            row = u.astype(np.int32)
            u -= row
            row *= np.int32(columns)
            row += (v * np.float32(columns)).astype(np.int32)
            cell = slots.reshape(-1).take(row)
            corner, edge_u, edge_v, normal, (first, stretch) = (
                [field.take(cell) for field in fields[k : k + 3]] for k in (0, 3, 6, 9, 12)
            )
            v = np.clip((v - first) * stretch, 0, 1)
        if self.shape == "ellipse":
            u, v = on_disc(u, v)
        elif self.shape == "triangle":
            root = np.sqrt(u)
            v = root * v
            u = root - v
        way = np.empty((3, len(u)), np.float32)
        for k in range(3):
            np.multiply(edge_u[k], u, out=way[k])
            way[k] += edge_v[k] * v
            way[k] += corner[k]
            way[k] -= p[k]
        square = dot(way, way)
        np.maximum(square, TOUCHING, out=square)
        facing = dot(way, normal)
        square *= np.sqrt(square)
        facing /= square
        return way, self._shown(facing, p), cell

    @cached_property
    def _slots(self) -> tuple[Int32, Float32]:
        """Equal slots of the unit square, each with its cell, and what samples need of the cells.

        Rows of the square are bands across the longest extent, columns go around a body or along a sheet: even samples
        of the square are even on the emitter. Cells take slots by their areas; what a whole number of slots is off,
        the weight makes good.

        Returns:
            (rows, columns) int32 cells, and (14, M) float32: corner, edges, normal times the weight, first column as a
            share of all, columns by those of the cell
        """
        count = len(self.ends)
        share = np.diff(self.ends.astype(np.float64), prepend=0)
        middle = (self.corner + (self.edge_u + self.edge_v) / 3).astype(np.float64)
        middle -= share @ middle
        axes = np.argsort(-np.ptp(middle, axis=0), kind="stable")
        first, second, third = (middle[:, axis] for axis in axes)
        across = second if self.box is None else np.arctan2(third, second)
        rows = max(round(math.sqrt(count) / 2), 1)
        order = np.argsort(first, kind="stable")
        band = np.empty(count, np.int64)
        band[order] = np.minimum((np.cumsum(share[order]) - share[order] / 2) * rows, rows - 1)
        filled, band, cells = np.unique(band, return_inverse=True, return_counts=True)
        rows, columns = len(filled), SLOTS * int(np.max(cells))
        slots = np.empty((rows, columns), np.int32)
        begin = np.zeros(count)
        for row in range(rows):
            own = np.flatnonzero(band == row)
            own = own[np.argsort(across[own], kind="stable")]
            ends = np.cumsum(share[own]) / share[own].sum()
            place = np.searchsorted(ends, (np.arange(columns) + 0.5) / columns, side="right")
            slots[row] = own[np.minimum(place, len(own) - 1)]
            begin[own] = np.searchsorted(place, np.arange(len(own)))
        taken = np.bincount(slots.reshape(-1), minlength=count)
        weight = np.where(taken > 0, -self.area * share * slots.size / np.maximum(taken, 1), 0)
        fields = [*self.corner.T, *self.edge_u.T, *self.edge_v.T, *(self.normal.T * weight)]
        return slots, np.array([*fields, begin / columns, columns / np.maximum(taken, 1)], np.float32)

    def _shown(self, facing: Float32, p: Float32) -> Float32:
        if not self.two_sided:
            return np.maximum(facing, 0, out=facing)
        if self.box is None:
            return np.abs(facing, out=facing)
        return np.where(outside(self.box, p), np.maximum(facing, 0), np.abs(facing))


@dataclass(frozen=True, eq=False)
class SoftboxLamp(Lamp):
    """An area light whose spread is narrowed: `strength` is the radiance along its axis, W/(m2 sr).

    Cycles models the slats of a softbox: the radiance falls as 1 - tan(angle) / tan(half spread). A receiver sees
    light from a disc of the lamp's plane about its own foot point; that disc and the lamp overlap along chords, over
    which samples are spread.

    Attributes:
        centre: (3,) float32, m
        axis_u, axis_v: (3,) float32, unit, in the lamp's plane
        half_u, half_v: m, half the edges or axes along them
        direction: (3,) float32, unit, the way it shines
        ellipse: an ellipse, not a rectangle
        tangent: of half the spread
    """

    strength: RGB
    centre: Float32
    axis_u: Float32
    axis_v: Float32
    half_u: float
    half_v: float
    direction: Float32
    ellipse: bool
    tangent: float
    shadow: bool
    group: int

    def light(self, points: Float32, shading: Float32, geometric: Float32 | None) -> Float32:
        result = np.zeros(len(points), np.float32)
        for start in range(0, len(points), BLOCK):
            part = slice(start, start + BLOCK)
            p = rows_of(points[part])
            normals = normals_of(shading[part], None if geometric is None else geometric[part])
            _, (low, high), depth = self._seen(p)
            seen = (depth > 0) & (low < high)
            cut = self._cut(p, normals)
            for count, chosen in ((SPREAD_NODES, seen & ~cut), (CUT_NODES, seen & cut)):
                some = np.flatnonzero(chosen)
                if len(some):
                    above = [normal[:, some] for normal in normals]
                    result[start + some] = self.light_by_samples(p[:, some], above, gauss_nodes(count))
        return result

    def _cut(self, p: Float32, normals: list[Float32]) -> Bools:
        """Where a receiver's horizon may pass through the lamp, (B,)."""
        from_centre = [p[k] - self.centre[k] for k in range(3)]
        reach = np.float32(math.hypot(self.half_u, self.half_v))
        cut = np.zeros(p.shape[1], bool)
        for normal in normals:
            cut |= np.abs(dot(from_centre, normal)) < reach
        return cut

    def _seen(self, p: Float32) -> tuple[tuple[Float32, Float32], tuple[Float32, Float32], Float32]:
        """Foot point (u, v) in the lamp's plane, range of v that it sees, height over the plane; (B,) m each."""
        from_centre = [p[k] - self.centre[k] for k in range(3)]
        depth = dot(from_centre, self.direction)
        foot = dot(from_centre, self.axis_u), dot(from_centre, self.axis_v)
        reach = np.maximum(depth, 0) * np.float32(self.tangent)
        low = np.maximum(foot[1] - reach, np.float32(-self.half_v))
        high = np.minimum(foot[1] + reach, np.float32(self.half_v))
        return foot, (low, high), depth

    def aim(self, p: Float32, u: Float32, v: Float32) -> tuple[Float32, Float32]:
        foot, (low, high), depth = self._seen(p)
        reach = np.maximum(depth, 0) * np.float32(self.tangent)
        across = np.maximum(high - low, 0)
        # density falls to nothing at both ends of v, where the chords end like a square root
        y = low + across * (v * v * (3 - 2 * v))
        across *= 6 * v * (1 - v)
        chord = np.sqrt(np.maximum(reach**2 - (y - foot[1]) ** 2, 0))
        side = np.float32(self.half_u)
        if self.ellipse:
            side = side * np.sqrt(np.maximum(1 - (y / np.float32(self.half_v)) ** 2, 0))
        left = np.maximum(foot[0] - chord, -side)
        right = np.maximum(np.minimum(foot[0] + chord, side), left)
        # the fade has a kink over the foot point: there the halves of u meet
        middle = np.where((left < foot[0]) & (foot[0] < right), foot[0], (left + right) / 2)
        first = u < 0.5
        width = 2 * np.where(first, middle - left, right - middle)
        x = np.where(first, left, middle) + width * np.where(first, u, u - np.float32(0.5))
        way = np.stack([self.centre[k] + self.axis_u[k] * x + self.axis_v[k] * y - p[k] for k in range(3)])
        square = np.maximum(dot(way, way), TOUCHING)
        rho = np.sqrt((x - foot[0]) ** 2 + (y - foot[1]) ** 2)
        fade = np.maximum(1 - rho / np.maximum(reach, TINY), 0)
        return way, fade * np.maximum(depth, 0) * across * width / (square * np.sqrt(square))


def area_lamp(light: AreaLight) -> Lamp:
    """The lamp of an area light, by shape and spread."""
    u, v, centre = (np.array(vector, np.float64) for vector in (light.edge_u, light.edge_v, light.position))
    direction = np.array(light.direction, np.float64)
    if np.cross(u, v) @ direction < 0:
        v = -v
    width, height = float(np.linalg.norm(u)), float(np.linalg.norm(v))
    if light.spread < FULL_SPREAD:
        return SoftboxLamp(
            strength=light.radiance,
            centre=centre.astype(np.float32),
            axis_u=(u / width).astype(np.float32),
            axis_v=(v / height).astype(np.float32),
            half_u=width / 2,
            half_v=height / 2,
            direction=direction.astype(np.float32),
            ellipse=light.ellipse,
            tangent=math.tan(max(light.spread, SPREAD_LEAST) / 2),
            shadow=light.shadow,
            group=light.group,
        )
    if light.ellipse:
        polygon = ellipse(centre, u / 2, v / 2)
        corner, edges = centre, (u / 2, v / 2)
    else:
        polygon = parallelogram(centre - (u + v) / 2, u, v)
        corner, edges = centre - (u + v) / 2, (u, v)
    return PanelLamp(
        strength=light.radiance,
        polygons=(polygon,),
        corner=corner[None].astype(np.float32),
        edge_u=edges[0][None].astype(np.float32),
        edge_v=edges[1][None].astype(np.float32),
        normal=polygon.normal[None].astype(np.float32),
        ends=np.ones(1, np.float32),
        shape="ellipse" if light.ellipse else "parallelogram",
        area=polygon.area,
        two_sided=False,
        box=None,
        shadow=light.shadow,
        group=light.group,
    )
