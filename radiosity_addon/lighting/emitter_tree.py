# SPDX-License-Identifier: GPL-3.0-or-later
"""A tree over the triangles of an emitter: from afar a branch shines as four points or one, with its moments.

In the manner of lightcuts (Walter et al. 2005, "Lightcuts: A Scalable Approach to Illumination"), but what stands for a
branch has its mean place, its spread along two axes, and the projected area that each direction sees, so that few
branches do for an emitter, and nothing is left to chance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bools, Float32, Float64, Int64

REACH = 4.0
"""A branch is four points from this many of its radii on: a flat one is then right to 0.1 %, 0.7 % where it grazes."""

CUT_REACH = 5.0
"""The same where a receiver's horizon may pass between its points."""

SPREAD = 0.004
"""From how far on do points stand for light that is spread otherwise than they are? Relative to its distance squared
the second moments then differ by so much."""

GATHERED = 0.001
"""From how far on does one point stand for light, not four? Relative to its distance squared its second moments, and
relative to its distance the first ones of a channel, are then so small."""

FAINT = 0.1
"""Channels of less than this share of the light that all have on average may be spread as they like."""

FLAT = 1e-4
"""A branch is flat if its mean normal is shorter than 1 by less than this."""

MISSED = 0.006
"""Branches whose projected area, as a share of all of it, is missed by more in some direction are no points. Where an
emitter is not equally bright all over they may miss more, the more there are of them: see `_share_root`."""

BENT = 0.001
"""From how far on do points stand for a branch that bulges, or shows more of itself here than there? The first-order
term of its light over the distance, which they don't have, is then such a share of its area."""

DIRECTIONS = 16
"""Directions, and their opposites, in which branches are looked at."""

PARTS = 4
"""Points that stand for a branch."""

TRIANGLE_POINTS = np.array([0.4, 0.4, 0.4, 0.0])[:, None, None]
TRIANGLE_WEIGHTS = np.array([25, 25, 25, -27]) / 48
"""Those of a leaf, from its middle towards the corners: right for cubic functions (Strang and Fix 1973)."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """K blocks of receivers, near each other.

    Attributes:
        centre: (K, 3) float32, m, of a ball about them
        radius: (K,) float32, m
        normal: (K, 3) float32, their mean normal
        turn: (K,) float32, how far their normals are from it, at most
        rise: (K,) float32, m, how far off the plane through the centre they lie
    """

    centre: Float32
    radius: Float32
    normal: Float32
    turn: Float32
    rise: Float32

    @classmethod
    def of(cls, points: Float32, normals: list[Float32]) -> Blocks:
        """Those of receivers (3, K, B) with normals (3, K, B), shading and, if there, geometric ones."""
        centre, normal = points.mean(2), normals[0].mean(2)
        gap = points - centre[:, :, None]
        radius = np.sqrt(np.einsum("kij,kij->ij", gap, gap).max(1))
        turn = np.zeros_like(radius)
        for own in normals:
            off = own - normal[:, :, None]
            np.maximum(turn, np.sqrt(np.einsum("kij,kij->ij", off, off).max(1)), out=turn)
        rise = np.abs(np.einsum("kij,ki->ij", gap, normal)).max(1)
        return cls(np.ascontiguousarray(centre.T), radius, np.ascontiguousarray(normal.T), turn, rise)


@dataclass(frozen=True, eq=False)
class EmitterTree:
    """A binary tree over triangles, halved across the longest extent; its leaves are the triangles.

    Node 1 is the root, nodes 2 k and 2 k + 1 are the halves of node k, leaves are the last nodes. In direction w a
    node's front has the projected area (vector . w + sqrt(w . square w)) / 2, both faces have the root alone: that of
    flat pieces, of ellipsoids, and of tubes. C channels of light share the points, each with its own weights.

    Attributes:
        corners: (leaves, 3, 3) float32, m; empty leaves are zero
        brightness: (C, leaves) float32, radiance as a share of the emitter's
        centre: (N, 3) float32, m, mean place of the light
        radius: (N,) float32, m, of a ball about it
        reach: (N,) float32, m, distance from which on points stand for the node; infinite where they never do
        alone: (N,) float32, m, distance from which on one point, the centre, does
        points: (PARTS, 3, N) float32, m, with the mean and the largest second moments of where the light is
        weights: (C, PARTS, N) float32, m2, of them in each channel: its area times brightness, at its own mean place
        vector: (3, N) float32, mean normal
        square: (6, N) float32: xx, yy, zz, 2 xy, 2 yz, 2 zx
        flat: (N,) bool
        axis: (N, 3) float32, unit, the normal of flat nodes; 0 for others
        filled: (N,) bool, there are triangles in it
        leaves: number of the first leaf
        cut_reach: as `CUT_REACH`
    """

    corners: Float32
    brightness: Float32
    centre: Float32
    radius: Float32
    reach: Float32
    alone: Float32
    points: Float32
    weights: Float32
    vector: Float32
    square: Float32
    flat: Bools
    axis: Float32
    filled: Bools
    leaves: int
    cut_reach: float = CUT_REACH

    @classmethod
    def over(cls, triangles: Float64, brightness: Float64 | None = None) -> EmitterTree:
        """A tree over triangles (M, 3, 3) of a `brightness` (M, C), shares of the mean radiance, or all alike."""
        depth = max(len(triangles) - 1, 1).bit_length()
        leaves = 1 << depth
        nodes = 2 * leaves
        origin = triangles.mean((0, 1))
        varies = brightness is not None
        if brightness is None:
            brightness = np.ones((len(triangles), 1))
        corners, light = np.zeros((leaves, 3, 3)), np.zeros((leaves, brightness.shape[1]))
        place = halved(triangles.mean(1), depth)
        corners[place] = triangles - origin
        light[place] = brightness
        middle = corners.mean(1)
        spokes = corners - middle[:, None]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        area = np.linalg.norm(cross, axis=1)
        normal = cross / np.maximum(area, 1e-300)[:, None]
        powers = area[:, None] * light
        power = powers.sum(1)
        second = np.einsum("nci,ncj->nij", spokes, spokes) / 12 + middle[:, :, None] * middle[:, None]
        each, moment, moments, vector, square, shown = (
            _combined(np.add, own, nodes)
            for own in (
                powers,
                powers[:, :, None] * middle[:, None],
                powers[:, :, None, None] * second[:, None],
                normal * power[:, None],
                normal[:, :, None] * normal[:, None] * power[:, None, None],
                np.abs(normal @ _directions()).mean(1) * power,
            )
        )
        total = each.sum(1)
        filled = total > 0
        weight = np.where(filled, total, 1)
        centre = moment.sum(1) / weight[:, None]
        off = moment - each[:, :, None] * centre[:, None]
        moments -= off[:, :, :, None] * centre[:, None, None] + centre[:, None, :, None] * moment[:, :, None]
        points, weights = _four_points(moments.sum(1) / weight[:, None, None], each, off)
        least = np.maximum(each, FAINT * weight[:, None] / each.shape[1])
        alone = np.sqrt((np.linalg.norm(moments, axis=(2, 3)) / least).max(1) / GATHERED)
        np.maximum(alone, (np.linalg.norm(off, axis=2) / least).max(1) / GATHERED, out=alone)
        other = moments - np.einsum("cpn,pni,pnj->ncij", weights, points, points)
        other = np.linalg.norm(other, axis=(2, 3)) / least
        points += centre
        points[:, leaves:] = middle + TRIANGLE_POINTS * np.concatenate([spokes.transpose(1, 0, 2), middle[None]])
        weights[:, :, leaves:] = powers.T[:, None] * TRIANGLE_WEIGHTS[:, None]
        vector, square = vector / weight[:, None], square / weight[:, None, None]
        square *= _even(square, shown / weight)[:, None, None]
        misses, bend = _misses(normal, middle, powers, vector, square, centre, each)
        if varies:
            misses *= _share_root(each)
        share = np.linalg.norm(vector, axis=1)
        flat = share > 1 - FLAT
        axis = np.where(flat[:, None], vector / np.where(flat, share, 1)[:, None], 0)
        full = area[:, None] > 0
        low = _combined(np.minimum, np.where(full, corners.min(1), np.inf), nodes)
        high = _combined(np.maximum, np.where(full, corners.max(1), -np.inf), nodes)
        radius = np.linalg.norm(np.where(filled[:, None], np.maximum(high - centre, centre - low), 0), axis=1)
        reach = np.maximum(REACH * np.maximum(radius, 1e-30), np.sqrt(other.max(1) / SPREAD))
        np.maximum(reach, np.where(flat, 0, bend / BENT), out=reach)
        reach[~flat & (misses.max(1) > MISSED)] = np.inf
        reach[leaves:] = REACH * radius[leaves:]
        i, j = [0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0]
        return cls(
            corners=(corners + np.where(full, origin, 0)[:, None]).astype(np.float32),
            brightness=np.ascontiguousarray(light.T, np.float32),
            centre=(centre + origin).astype(np.float32),
            radius=radius.astype(np.float32),
            reach=np.where(filled, reach, 0).astype(np.float32),
            alone=np.where(filled, np.maximum(alone, reach), 0).astype(np.float32),
            points=np.ascontiguousarray((points + origin).transpose(0, 2, 1), np.float32),
            weights=weights.astype(np.float32),
            vector=np.ascontiguousarray(vector.T, np.float32),
            square=np.ascontiguousarray((square[:, i, j] * [1, 1, 1, 2, 2, 2]).T, np.float32),
            flat=flat,
            axis=axis.astype(np.float32),
            filled=filled,
            leaves=leaves,
        )

    def loosened(self, times: float) -> EmitterTree:
        """The same tree where points may err so many times as much: what they lack falls with the distance squared."""
        nearer = 1 / math.sqrt(times)
        closer = {name: getattr(self, name) * np.float32(nearer) for name in ("reach", "alone")}
        return replace(self, **closer, cut_reach=CUT_REACH * nearer)

    def cut(self, blocks: Blocks) -> tuple[Int64, Int64, Int64]:
        """For each block the nodes that stand for what of the emitter is above its horizon.

        Returns:
            pairs of block and node, by block, and as how many points nodes are to be taken; near leaves as none
        """
        block = np.arange(len(blocks.centre), dtype=np.int64)
        node = np.ones_like(block)
        found = []
        while len(block):
            gap = self.centre[node] - blocks.centre[block]
            distance = np.sqrt(np.einsum("ij,ij->i", gap, gap))
            height = np.einsum("ij,ij->i", gap, blocks.normal[block])
            radius = self.radius[node]
            slack = self.extent(node, blocks.normal[block])
            slack += blocks.rise[block] + blocks.turn[block] * (distance + radius)
            reach = self.reach[node]
            cut = np.abs(height) < slack
            reach = np.where(cut, np.maximum(reach, radius * np.float32(self.cut_reach)), reach)
            distance -= blocks.radius[block]
            far = distance > reach
            seen = (height >= -slack) & self.filled[node]
            done = seen & (far | (node >= self.leaves))
            points = np.where(distance > self.alone[node], 1, PARTS)
            found.append((block[done], node[done], np.where(far, points, 0)[done]))
            block, node = np.repeat(block[seen & ~done], 2), _halves(node[seen & ~done])
        block, node, points = (np.concatenate(parts) for parts in zip(*found, strict=True))
        order = np.argsort(block, kind="stable")
        return block[order], node[order], points[order]

    def extent(self, node: Int64, normal: Float32) -> Float32:
        """How far nodes (K,) may reach, m, along normals (K, 3) from their centres."""
        cosine = np.einsum("ij,ij->i", self.axis[node], normal)
        reach: Float32 = self.radius[node] * np.sqrt(np.maximum(1 - cosine * cosine, np.float32(1e-6)))
        return reach

    def is_clear_of(self, centre: Float32, radius: Float32) -> Bools:
        """Whether no triangle, as a ball about it, reaches into balls (K, 3), (K,)."""
        clear = np.ones(len(centre), bool)
        ball = np.arange(len(centre), dtype=np.int64)
        node = np.ones_like(ball)
        while len(ball):
            gap = self.centre[node] - centre[ball]
            reached = np.sqrt(np.einsum("ij,ij->i", gap, gap)) < radius[ball] + self.radius[node]
            reached &= self.filled[node]
            clear[ball[reached & (node >= self.leaves)]] = False
            reached &= clear[ball] & (node < self.leaves)
            ball, node = np.repeat(ball[reached], 2), _halves(node[reached])
        return clear


def _halves(node: Int64) -> Int64:
    halves: Int64 = (2 * node[:, None] + np.arange(2)).reshape(-1)
    return halves


def _combined(combine: np.ufunc, own: Float64, nodes: int) -> Float64:
    """What leaves have (leaves, ...), combined for the branches: (nodes, ...)."""
    found = np.zeros((nodes, *own.shape[1:]))
    found[nodes // 2 :] = own
    level = nodes // 4
    while level:
        both = found[2 * level : 4 * level]
        found[level : 2 * level] = combine(both[0::2], both[1::2])
        level //= 2
    return found


def _directions() -> Float64:
    """(3, DIRECTIONS) unit, even over half a sphere."""
    number = np.arange(DIRECTIONS)
    z = (number + 0.5) / DIRECTIONS
    turn = number * (np.pi * (3 - np.sqrt(5)))
    ways: Float64 = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
    return ways


def _even(square: Float64, shown: Float64) -> Float64:
    """What `square` (N, 3, 3) is to be multiplied by so that areas seen are right (N,) on average over directions."""
    ways = _directions()
    seen = np.sqrt(np.maximum(np.einsum("nij,id,jd->nd", square, ways, ways), 0)).mean(1)
    factor: Float64 = (shown / np.maximum(seen, 1e-300)) ** 2
    return factor


def _misses(
    normal: Float64, middle: Float64, powers: Float64, vector: Float64, square: Float64, centre: Float64, each: Float64
) -> tuple[Float64, Float64]:
    """What points at nodes' centres miss of the light of their triangles, at most, over all directions and channels.

    From direction w and a distance d the light of faces with normals n at places x off the centre is, to first order,
    sum A (n . w) + sum A (3 (n . w) (x . w) - n . x) / d.

    Args:
        normal, middle, powers: of the leaves, (leaves, 3), (leaves, 3), (leaves, C)
        vector, square, centre, each: of the nodes, (N, 3), (N, 3, 3), (N, 3), (N, C)

    Returns:
        of the projected area in each channel, (N, C), and of the first-order term, as shares of the area, (N,) m
    """
    channels, power = powers.shape[1], powers.sum(1)
    shares = np.where(each > 0, each, 1)
    weight = np.where(each.sum(1) > 0, each.sum(1), 1)[:, None]
    misses, bend = np.zeros(each.shape), np.zeros(len(each))
    for way in np.concatenate([_directions(), -_directions()], axis=1).T:
        cosine = normal @ way
        lit = np.where((cosine > 0)[:, None], powers, 0) * cosine[:, None]
        front = np.where(cosine > 0, power, 0)
        first = 3 * cosine * (middle @ way) - np.einsum("ij,ij->i", normal, middle)
        sums = _combined(np.add, np.column_stack([lit, front * first, front[:, None] * normal]), len(each))
        seen, turned, facing = sums[:, :channels], sums[:, channels:][:, :1] / weight, sums[:, channels + 1 :] / weight
        shown = np.sqrt(np.maximum(np.einsum("nij,i,j->n", square, way, way), 0))
        np.maximum(misses, np.abs((vector @ way + shown)[:, None] / 2 - seen / shares), out=misses)
        about = 3 * (seen.sum(1) / weight[:, 0]) * (centre @ way) - np.einsum("ij,ij->i", facing, centre)
        np.maximum(bend, np.abs(turned[:, 0] - about), out=bend)
    return misses, bend


def _share_root(each: Float64) -> Float64:
    """How much of what nodes miss of their light, (N, C) in each channel, counts where brightness varies.

    They stand for the emitter together, and what they miss has all signs: the variances add up to that of one node
    for all if each may miss as much as the root of its share is smaller. A channel that is faint has no less than that.
    """
    whole = np.maximum(each[1], FAINT * each[1].mean())
    root: Float64 = np.sqrt(each / whole)
    return root


def _four_points(spread: Float64, light: Float64, off: Float64) -> tuple[Float64, Float64]:
    """Four points that all channels share, two on each of the longer principal axes, and their weights in each.

    Args:
        spread: (N, 3, 3) second moments of all light about its mean place
        light: (N, C) of each channel
        off: (N, C, 3) its first moments about the mean place of all

    Returns:
        (PARTS, N, 3) about that place, with the two largest second moments; (C, PARTS, N), with the first moments
    """
    moments, axes = np.linalg.eigh(spread)
    points = np.zeros((PARTS, *light.shape[:1], 3))
    weights = np.repeat(light.T[:, None], PARTS, axis=1) / PARTS
    for part, k, side in ((0, 2, 1), (1, 2, -1), (2, 1, 1), (3, 1, -1)):
        reach = np.sqrt(2 * np.maximum(moments[:, k], 0))
        points[part] = side * reach[:, None] * axes[:, :, k]
        weights[:, part] += side * np.einsum("nck,nk->cn", off, axes[:, :, k]) / np.where(reach > 0, 2 * reach, np.inf)
    return points, weights


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
