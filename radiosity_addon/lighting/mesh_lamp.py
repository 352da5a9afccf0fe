# SPDX-License-Identifier: GPL-3.0-or-later
"""Emissive meshes of many triangles: far branches of their tree shine as points, near leaves as polygons."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bools, Float32, Int64
from ..columns import vectors_at
from .area_lamps import PanelLamp
from .emitter_tree import Blocks, EmitterTree
from .lamp_samples import dot, outside
from .lamps import TOUCHING
from .polygons import signed_light

BLOCK = 32
"""Receivers, near each other, that share a cut through the tree."""

TOGETHER = 1 << 12
"""Receivers treated in one go."""

PAIRS = 1 << 14
"""Pairs of receivers and nodes treated in one go: 64 kB a temporary."""

CURVE_BITS = 10
"""Bits of a place along each axis, for the order of receivers."""


@dataclass(frozen=True, eq=False)
class MeshLamp(PanelLamp):
    """An emissive mesh: samples as PanelLamp has them, unshadowed light over a tree.

    Attributes:
        tree: over the triangles of all lamps that share it
        channel: of the tree's, the lamp's own
        tint: (M,) float32, how bright cells are in the lamp's channel beside what samples fall on them by; None: alike
    """

    tree: EmitterTree | None = None
    channel: int = 0
    tint: Float32 | None = None

    def aim(self, p: Float32, u: Float32, v: Float32) -> tuple[Float32, Float32]:
        way, weight, cell = self.aim_at_cells(p, u, v)
        if self.tint is not None:
            weight *= self.tint.take(cell)
        return way, weight

    def light(self, points: Float32, shading: Float32, geometric: Float32 | None) -> Float32:
        found: Float32 = self.in_channels([self.channel], points, shading, geometric)[0]
        return found

    def in_channels(self, channels: list[int], points: Float32, shading: Float32, geometric: Float32 | None) -> Float32:
        """As `light`, in C channels of the tree, (C, P): what they share is found once."""
        total = np.empty((len(channels), len(points)), np.float32)
        order = _along_curve(points) if len(points) else np.zeros(0, np.int64)
        for start in range(0, len(points), TOGETHER):
            own = order[start : start + TOGETHER]
            slots = np.arange(-(-len(own) // BLOCK) * BLOCK).reshape(-1, BLOCK)
            own = own[np.minimum(slots, len(own) - 1)]  # the last one fills its block
            normals = [shading] if geometric is None else [shading, geometric]
            p, *normals = (vectors_at(part, own.reshape(-1)).T.reshape(3, -1, BLOCK) for part in (points, *normals))
            total[:, own] = self._of_blocks(channels, p, normals)
        return total

    def loosened(self, times: float) -> MeshLamp:
        """The same lamp where its unshadowed light may err so many times as much."""
        assert self.tree is not None
        return self if times == 1 else replace(self, tree=self.tree.loosened(times))

    def is_clear_of(self, centre: Float32, radius: Float32) -> Bools:
        """Whether no triangle reaches into balls (K, 3), (K,)."""
        assert self.tree is not None
        return self.tree.is_clear_of(centre, radius)

    def _of_blocks(self, channels: list[int], p: Float32, normals: list[Float32]) -> Float32:
        """Light (C, K, B) at receivers (3, K, B)."""
        assert self.tree is not None
        total = np.zeros((len(channels), *p.shape[1:]), np.float32)
        both = np.full(p.shape[1:], self.two_sided)
        if self.two_sided and self.box is not None:
            both = ~outside(self.box, p.reshape(3, -1)).reshape(both.shape)
        block, node, points = self.tree.cut(Blocks.of(p, normals))
        step = max(PAIRS // p.shape[2], 1)
        for alone in (np.flatnonzero(points == 1), np.flatnonzero(points != 1)):
            for start in range(0, len(alone), step):
                part = alone[start : start + step]
                own, nodes = block[part], node[part]
                there = p[:, own]
                above = [normal[:, own] for normal in normals]
                light = self._as_points(channels, nodes, there, above, both[own], points[part[0]] == 1)
                near = np.flatnonzero(points[part] == 0)
                if len(near):
                    self._as_polygons(channels, light, near, nodes[near], there, above, both[own])
                first = np.flatnonzero(np.diff(own, prepend=-1))
                total[:, own[first]] += np.add.reduceat(light, first, axis=1)
        return np.maximum(total, 0, out=total)

    def _as_points(
        self, channels: list[int], nodes: Int64, p: Float32, normals: list[Float32], both: Bools, alone: bool
    ) -> Float32:
        """Light (C, K, B) of nodes (K,), each alone one point, at receivers (3, K, B); `both` (K, B) see both faces."""
        assert self.tree is not None
        total = np.zeros((len(channels), *p.shape[1:]), np.float32)
        weights, points = self.tree.weights[channels][:, :, nodes], self.tree.points[:, :, nodes]
        if alone:
            weights, points = weights.sum(1, keepdims=True), self.tree.centre[nodes].T[None]
        for number, point in enumerate(points):
            way = [point[k][:, None] - p[k] for k in range(3)]
            square = dot(way, way)
            np.maximum(square, TOUCHING, out=square)
            light = dot(way, normals[0])
            np.maximum(light, 0, out=light)
            for normal in normals[1:]:
                light *= dot(way, normal) > 0
            light *= self._seen(way, nodes, both)
            square *= square
            light /= square
            for channel, weight in enumerate(weights[:, number]):
                total[channel] += light * weight[:, None]
        return total

    def _seen(self, way: list[Float32], nodes: Int64, both: Bools) -> Float32:
        """Projected area of nodes (K,), as a share of their own, seen along -way (3, K, B), times the way's length."""
        assert self.tree is not None
        facing = dot(way, -self.tree.vector[:, nodes][:, :, None])
        if self.tree.flat[nodes].all():
            return np.where(both, np.abs(facing), np.maximum(facing, 0))
        xx, yy, zz, xy, yz, zx = self.tree.square[:, nodes][:, :, None]
        x, y, z = way
        area: Float32 = (xx * x + xy * y) * x
        area += (yy * y + yz * z) * y
        area += (zz * z + zx * x) * z
        np.maximum(area, 0, out=area)
        np.sqrt(area, out=area)
        return np.where(both, area, (area + facing) / 2)

    def _as_polygons(
        self,
        channels: list[int],
        light: Float32,
        rows: Int64,
        nodes: Int64,
        p: Float32,
        normals: list[Float32],
        both: Bools,
    ) -> None:
        """Replace, in place, in rows of light (C, K, B) that of leaves that are near their receivers."""
        assert self.tree is not None
        gap = self.tree.centre[nodes].T[:, :, None] - p[:, rows]
        square = dot(gap, gap)
        near = square < (self.tree.reach[nodes] ** 2)[:, None]
        cut = square < (self.tree.radius[nodes] * np.float32(self.tree.cut_reach))[:, None] ** 2
        axis, radius = self.tree.axis[nodes].T[:, :, None], self.tree.radius[nodes][:, None]
        for normal in normals:
            own = normal[:, rows]
            cosine, height = dot(axis, own), dot(gap, own)
            near |= cut & (height * height <= radius * radius * (np.float32(1 + 1e-6) - cosine * cosine))
        row, column = np.nonzero(near)
        if not len(row):
            return
        leaf = nodes[row] - self.tree.leaves
        corners = np.ascontiguousarray(self.tree.corners[leaf].transpose(1, 2, 0))
        row = rows[row]
        found = signed_light(corners, p[:, row, column], [normal[:, row, column] for normal in normals])
        found = np.where(both[row, column], np.abs(found), np.maximum(found, 0))
        light[:, row, column] = found * self.tree.brightness[channels][:, leaf]


def _along_curve(points: Float32) -> Int64:
    """The order (P,) of points (P, 3) along a curve that keeps neighbours together (Morton 1966)."""
    low = points.min(0)
    size = max(float(np.max(points.max(0) - low)), 1e-30)
    place = ((points - low) * np.float32(((1 << CURVE_BITS) - 1) / size)).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(CURVE_BITS):
        for k in range(3):
            code |= ((place[:, k] >> bit) & 1) << (3 * bit + k)
    return np.argsort(code, kind="stable")
