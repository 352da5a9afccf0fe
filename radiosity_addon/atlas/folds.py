# SPDX-License-Identifier: GPL-3.0-or-later
"""Finer texels where smooth surfaces fold: curtains, cushions, thin tubes.

Light that goes with the cosine, where the shading normal turns by an angle a within a texel, is read from a page as if
it were blurred by a^2 / 8: a texel's mean has a variance of 1/12 of its width squared, bilinear reading adds 1/6, and
half of both together times the cosine's curvature is what is lost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Float32, Float64, Int32, Int64
from ..estimate import FILLED
from ..scene import Mesh
from ..settings import BakeSettings
from .density import quantiles

FOLDED_SHARE = 0.1
"""Share of a surface's area that turns so much: for its rounded edges alone a box gets no finer."""

MOST_TURN = math.radians(15)
"""Within a texel, without need for finer ones: a^2 / 8 is 0.9 %."""

FINEST = 2.0
"""Texels become so many times finer by themselves, at most."""

MOST_MORE = 0.2
"""Share of all texels that folds get beyond their own, at most: where a page is filled, others then lie 9 % wider."""

BLOCK = 1 << 14
"""Triangles looked at in one go, so that arrays stay in cache."""


@dataclass(frozen=True, eq=False)
class Folds:
    """How surfaces turn.

    Attributes:
        turn: (M,) float64, radians that the shading normal turns by across a texel, on FOLDED_SHARE of each mesh's
            area at least, before texels become finer; 0 where there is no lightmap
        texels: (M,) float64, about how many each mesh then has
        fineness: (M,) float64, how many times finer they become, 1 to FINEST
    """

    turn: Float64
    texels: Float64
    fineness: Float64

    @staticmethod
    def of(meshes: Sequence[Mesh], settings: BakeSettings) -> Folds:
        """Those of a scene's meshes; pages of a group that they fill are as dense as their area lets them be."""
        lit = [index for index, mesh in enumerate(meshes) if mesh.lightmapped and len(mesh.triangles)]
        turn, texels, fineness = np.zeros(len(meshes)), np.zeros(len(meshes)), np.ones(len(meshes))
        if not lit:
            return Folds(turn, texels, fineness)
        rate, area = _turning_of([meshes[index] for index in lit])
        multiplier = np.array([meshes[index].density for index in lit])
        _, group = np.unique([meshes[index].page_group for index in lit], return_inverse=True)
        wanted = area * multiplier**2
        if settings.density is None:
            density = np.sqrt(FILLED * settings.page_size**2 / np.bincount(group, wanted)[group])
        else:
            density = np.full(len(lit), settings.density)
        turn[lit] = rate / (density * multiplier)
        texels[lit] = wanted * density**2
        if settings.fine_folds:
            fineness[lit] = _fineness(turn[lit], texels[lit], group)
        return Folds(turn, texels, fineness)

    @property
    def left(self) -> Float64:
        """(M,) radians that the shading normal still turns by across a finer texel."""
        return self.turn / self.fineness

    def finer(self, meshes: Sequence[Mesh]) -> tuple[Mesh, ...]:
        """The meshes, with the densities that their folds ask for."""
        pairs = zip(meshes, self.fineness.tolist(), strict=True)
        return tuple(replace(mesh, density=mesh.density * times) if times > 1 else mesh for mesh, times in pairs)


def _fineness(turn: Float64, texels: Float64, group: Int64) -> Float64:
    """(M,) of meshes with these turns and texels in page groups, each of which has so many texels to give."""
    more = np.clip(turn / MOST_TURN, 1, FINEST) ** 2 - 1
    share = np.bincount(group, more * texels) / np.maximum(np.bincount(group, texels), 1e-300)
    granted: Float64 = np.sqrt(1 + more * np.minimum(1, MOST_MORE / np.maximum(share, MOST_MORE))[group])
    return granted


def _turning_of(meshes: Sequence[Mesh]) -> tuple[Float64, Float64]:
    """Turn (M,), 1/m, and area (M,), m2, of each mesh as of `turning`; of those of one shape by their sizes."""
    found = np.empty((len(meshes), 2))
    first: dict[int, tuple[int, float]] = {}
    for index, mesh in enumerate(meshes):
        width = max(_width(mesh), 1e-30)
        leader, its_width = first.setdefault(-1 - index if mesh.shape is None else mesh.shape, (index, width))
        if leader == index:
            found[index] = turning(mesh.vertices, mesh.triangles, mesh.corner_normals)
        else:
            larger = width / its_width
            found[index] = found[leader] * [1 / larger, larger**2]
    return found[:, 0].copy(), found[:, 1].copy()


def _width(mesh: Mesh) -> float:
    """How far the vertices lie from their middle, m; the same however the mesh is turned."""
    return float(np.sqrt(((mesh.vertices - mesh.vertices.mean(axis=0)) ** 2).sum(axis=1).mean()))


def turning(vertices: Float64, triangles: Int32, corner_normals: Float32) -> tuple[float, float]:
    """By how much shading normals turn along a surface, 1/m, on FOLDED_SHARE of its area at least, and that area, m2.

    In each triangle normals change linearly. The squared rate along the way on which they change most is the larger
    eigenvalue of the surface's third fundamental form over its first.

    Args:
        vertices: (V, 3), m
        triangles: (F, 3), into vertices
        corner_normals: (F, 3, 3) unit
    """
    rate, area = np.empty(len(triangles)), np.empty(len(triangles))
    for start in range(0, len(triangles), BLOCK):
        part = slice(start, start + BLOCK)
        x, y, z = _products(vertices[triangles[part]])
        p, q, r = _products(corner_normals[part].astype(np.float64))
        squared = x * z - y * y
        solid = squared > 1e-12 * x * z
        over = 1 / np.where(solid, squared, 1)
        half = (p * z - 2 * q * y + r * x) * over / 2
        product = np.maximum(p * r - q * q, 0) * over
        largest = half + np.sqrt(np.maximum(half * half - product, 0))
        rate[part] = np.sqrt(np.where(solid, np.maximum(largest, 0), 0))
        area[part] = np.sqrt(np.maximum(squared, 0)) / 2
    return quantiles(rate, area, (1 - FOLDED_SHARE,))[0], float(area.sum())


def _products(corners: Float64) -> tuple[Float64, Float64, Float64]:
    """Of what changes along two edges of triangles (F, 3, 3): products with itself and with the other, (F,) each."""
    first, second = ((corners[:, k] - corners[:, 0]).T.copy() for k in (1, 2))
    return (first * first).sum(axis=0), (first * second).sum(axis=0), (second * second).sum(axis=0)
