# SPDX-License-Identifier: GPL-3.0-or-later
"""Emissive meshes of many triangles: a tree whose far branches shine as points and whose near leaves as polygons."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from ..arrays import Bools, Float32, Float64, Int64
from .area_lamps import PanelLamp
from .far_field import FarField
from .lamp_samples import dot, normals_of, outside, rows_of
from .lamps import TOUCHING
from .polygons import signed_light

POINT = 5.0
"""A branch is a point from this many of its radii on: with the second-order term of a disc, right to half a percent."""

FAR = 5.0
"""Receivers so many radii of an emitter away look its light up in a table."""

TABULATED = 256
"""Nodes that make the table, at least, if there are so many: a table can afford finer ones than each receiver can."""

LOOK_UP = 1 << 14
"""Receivers looked up in one go."""

COHERENT = 0.97
"""Least length of a branch's summed normals over its area: a cone of 20 degrees. Wider ones are split."""

BLOCK = 256
"""Receivers, near each other, that share a cut through the tree."""

PAIRS = 1 << 14
"""Pairs of receivers and triangles treated in one go."""


@dataclass(frozen=True, eq=False)
class EmitterTree:
    """A binary tree over triangles, halved across the longest extent; its leaves are the triangles.

    Node 1 is the root, nodes 2 k and 2 k + 1 are the halves of node k, leaves are the last nodes.

    Attributes:
        corners: (leaves, 3, 3) float32, m; empty leaves are zero
        centre: (N, 3) float32, m, area-weighted
        radius: (N,) float32, m
        normal: (N, 3) float32, unit, mean
        area: (N,) float32, m2
        projected: (N,) float32, m2, the area seen along the mean normal
        spread: (N,) float32, half width of the even spread of cosines that has the variance of the normals, along
            the direction square to `normal` in which they vary least
        turn: (N, 3) float32, the direction in which they vary most, as long as adds to `spread`, squared, what it has
            there; a tube's normals turn about its axis only
        coherent: (N,) bool, all faces look nearly one way
        brightness: (N,) float32, mean radiance as a share of the emitter's, or None where all shine alike
        leaves: number of the first leaf
    """

    corners: Float32
    centre: Float32
    radius: Float32
    normal: Float32
    area: Float32
    projected: Float32
    spread: Float32
    turn: Float32
    coherent: Bools
    brightness: Float32 | None
    leaves: int

    @classmethod
    def over(cls, triangles: Float64, brightness: Float64 | None = None) -> EmitterTree:
        """A tree over triangles (M, 3, 3) of a `brightness` (M,), shares of the mean radiance, or all alike."""
        depth = max(len(triangles) - 1, 1).bit_length()
        leaves = 1 << depth
        nodes = 2 * leaves
        corners = np.zeros((leaves, 3, 3))
        place = halved(triangles.mean(1), depth)
        corners[place] = triangles
        light = np.ones(leaves)
        if brightness is not None:
            light[place] = brightness
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        area, power, vector, moment = np.zeros(nodes), np.zeros(nodes), np.zeros((nodes, 3)), np.zeros((nodes, 3))
        square = np.zeros((nodes, 3, 3))
        low, high = np.full((nodes, 3), np.inf), np.full((nodes, 3), -np.inf)
        own = slice(leaves, nodes)
        area[own], vector[own] = np.linalg.norm(cross, axis=1), cross
        power[own] = area[own] * light
        moment[own] = corners.mean(1) * power[own, None]
        square[own] = cross[:, :, None] * cross[:, None] / np.maximum(area[own], 1e-300)[:, None, None]
        full = area[own, None] > 0
        low[own], high[own] = np.where(full, corners.min(1), np.inf), np.where(full, corners.max(1), -np.inf)
        level = leaves // 2
        while level:
            node = slice(level, 2 * level)
            left, right = slice(2 * level, 4 * level, 2), slice(2 * level + 1, 4 * level, 2)
            for total in (area, power, vector, moment, square):
                total[node] = total[left] + total[right]
            low[node], high[node] = np.minimum(low[left], low[right]), np.maximum(high[left], high[right])
            level //= 2
        filled = area > 0
        centre = moment / np.where(filled, power, 1)[:, None]
        length = np.linalg.norm(vector, axis=1)
        share = np.minimum(length / np.where(filled, area, 1), 1)
        normal = vector / np.maximum(length, 1e-300)[:, None]
        scale = np.where(filled, area, 1) * np.maximum(share, COHERENT) ** 2  # others are never points
        spread, turn = _cone(normal, square / scale[:, None, None])
        reach = np.where(filled[:, None], np.maximum(high - centre, centre - low), 0)
        return cls(
            corners=corners.astype(np.float32),
            centre=centre.astype(np.float32),
            radius=np.linalg.norm(reach, axis=1).astype(np.float32),
            normal=normal.astype(np.float32),
            area=area.astype(np.float32),
            projected=length.astype(np.float32),
            spread=spread.astype(np.float32),
            turn=turn.astype(np.float32),
            coherent=filled & (share > COHERENT),
            brightness=None if brightness is None else (power / np.where(filled, area, 1)).astype(np.float32),
            leaves=leaves,
        )

    def cut(self, centre: Float32, radius: Float32) -> tuple[Int64, Int64]:
        """For each ball of receivers (K, 3), (K,) the nodes that stand for the emitter: pairs of ball and node.

        A leaf that is still too near to be a point stays in; `is_point` tells.
        """
        ball = np.arange(len(centre), dtype=np.int64)
        node = np.ones_like(ball)
        balls, nodes = [], []
        while len(ball):
            done = self.is_point(centre[ball], radius[ball], node) & self.coherent[node]
            done |= node >= self.leaves
            balls.append(ball[done])
            nodes.append(node[done])
            ball, node = np.repeat(ball[~done], 2), self._halves(node[~done])
            kept = self.area[node] > 0
            ball, node = ball[kept], node[kept]
        joined: Int64 = np.concatenate(balls)
        order = np.argsort(joined, kind="stable")
        return joined[order], np.concatenate(nodes)[order]

    def far_nodes(self, first: int = 1) -> Int64:
        """The nodes, from number `first` on, that stand for the emitter for all receivers from `FAR` radii on."""
        first = min(first, self.leaves)
        node = np.ones(1, np.int64)
        nodes = []
        while len(node):
            gap = self.centre[node] - self.centre[1]
            distance = np.float32(FAR) * self.radius[1] - np.sqrt(np.einsum("ij,ij->i", gap, gap))
            done = (distance > np.float32(POINT) * self.radius[node]) & self.coherent[node] & (node >= first)
            done |= node >= self.leaves
            nodes.append(node[done])
            node = self._halves(node[~done])
            node = node[self.area[node] > 0]
        return np.concatenate(nodes)

    def is_point(self, centre: Float32, radius: Float32, node: Int64) -> Bools:
        """Whether nodes are far enough from balls of receivers to be points."""
        gap = self.centre[node] - centre
        distance = np.sqrt(np.einsum("ij,ij->i", gap, gap)) - radius
        far: Bools = distance > np.float32(POINT) * self.radius[node]
        return far

    @staticmethod
    def _halves(node: Int64) -> Int64:
        halves: Int64 = (2 * node[:, None] + np.arange(2)).reshape(-1)
        return halves


@dataclass(frozen=True, eq=False)
class MeshLamp(PanelLamp):
    """An emissive mesh: samples as PanelLamp has them, closed forms over a tree.

    Attributes:
        tree: over the same triangles as the cells
    """

    tree: EmitterTree | None = None

    @cached_property
    def _far_nodes(self) -> Int64:
        assert self.tree is not None
        return self.tree.far_nodes()

    @cached_property
    def _far_field(self) -> FarField:
        assert self.tree is not None
        centre, radius = self.tree.centre[1], float(self.tree.radius[1])
        nodes = self.tree.far_nodes(TABULATED)
        return FarField.of(partial(self._vector, nodes), centre, radius, FAR)

    def light(self, points: Float32, shading: Float32, geometric: Float32 | None) -> Float32:
        """As `Lamp` has it: far receivers that see the emitter as a whole look its light up, others sum over nodes."""
        assert self.tree is not None
        total = np.zeros(len(points), np.float32)
        centre, radius = self.tree.centre[1], self.tree.radius[1]
        for start in range(0, len(points), LOOK_UP):
            part = slice(start, start + LOOK_UP)
            p = rows_of(points[part])
            normals = normals_of(shading[part], None if geometric is None else geometric[part])
            away = [centre[k] - p[k] for k in range(3)]
            height = dot(away, normals[0])
            for normal in normals[1:]:
                np.minimum(height, dot(away, normal), out=height)
            far = dot(away, away) > (np.float32(FAR) * radius) ** 2
            whole = np.flatnonzero(far & (height > radius))
            if len(whole):
                total[start + whole] = self._far_field.light(p[:, whole], normals[0][:, whole])
            cut = np.flatnonzero(far & (np.abs(height) <= radius))
            step = max(PAIRS // len(self._far_nodes), 1)
            for first in range(0, len(cut), step):
                some = cut[first : first + step]
                total[start + some] = self._points(self._far_nodes, p[:, some], [rows[:, some] for rows in normals])
            near = np.flatnonzero(~far)
            if len(near):
                own = start + near
                below = None if geometric is None else geometric[own]
                total[own] = self._over_tree(points[own], shading[own], below)
        return total

    def _over_tree(self, points: Float32, shading: Float32, geometric: Float32 | None) -> Float32:
        """Light at near receivers, (B,): blocks of them share their cuts through the tree."""
        assert self.tree is not None
        total = np.zeros(len(points), np.float32)
        cell = halved(points, max(len(points) // BLOCK, 1).bit_length() - 1)
        order = np.argsort(cell, kind="stable")
        blocks = np.split(order, np.flatnonzero(np.diff(cell[order])) + 1)
        balls = [_ball(points[block]) for block in blocks]
        centre = np.array([middle for middle, _ in balls], np.float32).reshape(-1, 3)
        radius = np.array([reach for _, reach in balls], np.float32)
        ball, node = self.tree.cut(centre, radius)
        far = self.tree.is_point(centre[ball], radius[ball], node)
        ends = np.searchsorted(ball, np.arange(len(blocks) + 1))
        for number, block in enumerate(blocks):
            own = slice(ends[number], ends[number + 1])
            p = rows_of(points[block])
            normals = normals_of(shading[block], None if geometric is None else geometric[block])
            points_there, step = node[own][far[own]], max(PAIRS // len(block), 1)
            for start in range(0, len(points_there), step):
                total[block] += self._points(points_there[start : start + step], p, normals)
            total[block] += self._near(node[own][~far[own]] - self.tree.leaves, p, normals)
        return total

    def _both(self, p: Float32) -> Bools:
        """Which receivers p (3, B) see both sides of the faces."""
        return np.ones(p.shape[1], bool) if self.box is None else ~outside(self.box, p)

    def _points(self, nodes: Int64, p: Float32, normals: list[Float32]) -> Float32:
        """Far nodes as points, (B,)."""
        way, light = self._rays(nodes, p)
        cosine = way[0] * normals[0][0] + way[1] * normals[0][1] + way[2] * normals[0][2]
        light *= np.maximum(cosine, 0, out=cosine)
        for other in normals[1:]:
            light *= (way[0] * other[0] + way[1] * other[1] + way[2] * other[2]) > 0
        total: Float32 = light.sum(0)
        return total

    def _vector(self, nodes: Int64, p: Float32) -> Float32:
        """Light vector (3, B) of far nodes at points p (3, B)."""
        total = np.zeros_like(p)
        step = max(PAIRS // len(nodes), 1)
        for start in range(0, p.shape[1], step):
            part = slice(start, start + step)
            way, light = self._rays(nodes, p[:, part])
            for k in range(3):
                total[k, part] = (way[k] * light).sum(0)
        return total

    def _rays(self, nodes: Int64, p: Float32) -> tuple[list[Float32], Float32]:
        """Ways from points p (3, B) to nodes seen as points, and their light by way's length, (K, B) each.

        A node's normals fill a cone: its light does not end where the mean normal's cosine does, it fades over the
        cone, as that of a sphere's cap or of a strip of a tube does. Its extent is that of a disc, to second order.
        """
        assert self.tree is not None
        centre, normal = self.tree.centre[nodes][:, :, None], self.tree.normal[nodes][:, :, None]
        area, turn = self.tree.projected[nodes][:, None], self.tree.turn[nodes][:, :, None]
        way = [centre[:, k] - p[k] for k in range(3)]
        square = way[0] * way[0] + way[1] * way[1] + way[2] * way[2]
        np.maximum(square, TOUCHING, out=square)
        facing = -(way[0] * normal[:, 0] + way[1] * normal[:, 1] + way[2] * normal[:, 2])
        distance = np.sqrt(square)
        facing /= distance
        spread = way[0] * turn[:, 0] + way[1] * turn[:, 1] + way[2] * turn[:, 2]
        spread /= distance
        spread *= spread
        spread += self.tree.spread[nodes][:, None] ** 2
        np.sqrt(spread, out=spread)
        both = self._both(p)
        if both.any():
            facing = np.where(both, np.abs(facing), facing)
        light = np.clip(facing, -spread, spread)
        light += spread
        light *= light
        light /= 4 * spread
        np.maximum(facing, light, out=light)
        if both.any():
            light = np.where(both, 2 * light - facing, light)  # those of both signs
        light *= area
        extent = 3 * facing * facing
        extent -= 2
        extent *= area / np.float32(np.pi)
        extent += square
        extent *= distance
        light /= extent
        if self.tree.brightness is not None:
            light *= self.tree.brightness[nodes][:, None]
        return way, light

    def _near(self, triangles: Int64, p: Float32, normals: list[Float32]) -> Float32:
        """Near triangles as polygons, (B,)."""
        assert self.tree is not None
        receivers, both = p.shape[1], self._both(p)
        total = np.zeros(receivers, np.float32)
        step = max(PAIRS // receivers, 1)
        for start in range(0, len(triangles), step):
            part = triangles[start : start + step]
            corners = np.repeat(self.tree.corners[part].transpose(1, 2, 0), receivers, axis=2)
            tiled = [np.tile(rows, (1, len(part))) for rows in (p, *normals)]
            light = signed_light(corners, tiled[0], tiled[1:]).reshape(len(part), receivers)
            light = np.where(both, np.abs(light), np.maximum(light, 0))
            if self.tree.brightness is not None:
                light *= self.tree.brightness[self.tree.leaves + part][:, None]
            total += light.sum(0)
        return total


def _cone(normal: Float64, square: Float64) -> tuple[Float64, Float64]:
    """How unit normals spread about their mean: `EmitterTree.spread` and `turn`.

    An even spread of cosines of half width w has the variance w^2 / 3.

    Args:
        normal: (N, 3), the mean's direction
        square: (N, 3, 3), mean of the normals' outer products over the mean's squared length
    """
    across = np.eye(3) - normal[:, :, None] * normal[:, None]
    variance, axes = np.linalg.eigh(across @ square @ across)
    least, most = variance[:, 1], variance[:, 2]  # the first one is along the normal
    spread = np.sqrt(np.maximum(3 * least, 1e-8))
    return spread, axes[:, :, 2] * np.sqrt(3 * np.maximum(most - least, 0))[:, None]


def _ball(points: Float32) -> tuple[Float32, np.float32]:
    """Centre and radius of a ball around points (P, 3)."""
    middle: Float32 = points.mean(0, dtype=np.float32)
    return middle, np.float32(np.max(np.linalg.norm(points - middle, axis=1)))


def halved(points: Float32 | Float64, depth: int) -> Int64:
    """Cells (P,), 0 to 2^depth - 1, of points (P, 3) halved again and again across their longest extent."""
    cell = np.zeros(len(points), np.int64)
    for _ in range(depth):
        order = np.argsort(cell, kind="stable")
        starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
        low = np.minimum.reduceat(points[order], starts, axis=0)
        high = np.maximum.reduceat(points[order], starts, axis=0)
        group = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(points)))
        axis = np.argmax(high - low, axis=1)[group]
        order = order[np.lexsort((points[order, axis], group))]
        size = np.diff(starts, append=len(points))
        upper = np.arange(len(points)) - starts[group] >= (size[group] + 1) // 2
        cell[order] = 2 * cell[order] + upper
    return cell
