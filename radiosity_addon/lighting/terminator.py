# SPDX-License-Identifier: GPL-3.0-or-later
"""Shadow rays at the terminator of smooth surfaces: where light grazes them, they start on the rounder surface.

Triangles with smooth normals stand for a surface that bulges over them. Seen from their own flat points, light that
grazes this surface is hidden by the next triangle, or comes from below the horizon: the shadow's edge shows the facets.
Cycles therefore lifts the origins of grazing shadow rays to the surface that the normals tell of (Object > Shading >
Shadow Terminator > Geometry Offset), and leaves it to the rays what is below the horizon.

With an offset of 0 light from below a facet comes through that very facet, and is stopped by others only: closed bodies
stay dark there, open sheets do not.

A Shading Offset counts light by the cosine of a larger angle, so that it fades out before it grazes: closed forms are
weakened by what quadrature finds that this leaves, samples weighed by it.

One thing differs. Cycles also lifts the rays that it sends to the world as to a lamp; here only bright pieces of the
sky are lamps, and the rest of it, a hundredth of which grazes, is gathered from where surfaces are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float32, Float64, Int32, Int64
from ..geometry.surfaces import THROUGH, Surfaces
from ..geometry.texels import Texels
from .lamp_samples import TINY, dot, gauss_nodes, rows_of
from .lamps import Lamp

BENT_NODES = 8
"""Gauss points along each side of a lamp by which it is found what a bent cosine leaves of its light."""

CENTRE = np.array([[0.5, 0.5, 1.0]])
"""The one node of a lamp without size."""


@dataclass(frozen=True, eq=False)
class Footing:
    """The places on surfaces that R shadow rays start from.

    Attributes:
        surfaces: the triangles
        triangle: (R,) int32
        weights: (R, 2) float32, barycentric, of corners 1 and 2
        side: 1, or -1 where the backs of the triangles are lit
    """

    surfaces: Surfaces
    triangle: Int32
    weights: Float32
    side: int = 1

    @property
    def bend(self) -> Float32 | None:
        """Of the angles of light (R,); None where light counts by Lambert's law everywhere."""
        return self.surfaces.bend.take(self.triangle) if self.surfaces.bends else None

    def only(self, chosen: Int64, samples: int = 1) -> Footing:
        """Those at positions `chosen` of each of `samples` blocks."""
        triangle = self.triangle.reshape(samples, -1)[:, chosen].reshape(-1)
        weights = self.weights.reshape(samples, -1, 2)[:, chosen].reshape(-1, 2)
        return Footing(self.surfaces, triangle, weights, self.side)

    def lift(self, p: Float32, way: Float32, shading: Float32) -> tuple[Float32, Float32]:
        """Origins and ways (3, R) to the same ends, starting on the rounder surface as far as they graze this one.

        The two cosines of light, with the shading and the geometric normal, blend it in below the triangles' limit.

        Args:
            p, way: (3, R), m
            shading: (3, R) unit shading normals
        """
        limit = self.surfaces.terminator.take(self.triangle)
        length = np.sqrt(np.maximum(dot(way, way), TINY))
        normal = rows_of(self.surfaces.normals(self.triangle)) * np.float32(self.side)
        above = dot(way, normal) / length
        cosine = dot(way, shading) / length
        through = np.flatnonzero((limit == THROUGH) & (above < 0))
        if len(through):
            p = p.copy()
            p[:, through] -= normal[:, through] * np.float32(2 * self.surfaces.offset)  # from its other side
        grazing = np.flatnonzero((limit > 0) & ((above < limit) | (cosine < limit)))
        if not len(grazing):
            return p, way
        limit, above, cosine = limit[grazing], above[grazing], cosine[grazing]
        share = np.where(cosine < limit, 2 - (above + cosine) / limit, 1 - above / limit)
        np.clip(share, 0, 1, out=share)
        lifts = rows_of(bulge(self.surfaces, self.triangle[grazing], self.weights[grazing], self.side)) * share
        p, way = p.copy(), way.copy()
        p[:, grazing] += lifts
        way[:, grazing] -= lifts
        return p, way


def footing(texels: Texels, ids: Int64 | Int32, sample: Int64 | Int32, side: int = 1) -> Footing | None:
    """Where `texels.points(ids, sample)` are; None where nothing there is rounder than its triangles or bends light."""
    surfaces = texels.surfaces
    triangle = texels.triangle[ids] if surfaces.rounds or surfaces.bends else np.zeros(0, np.int32)
    if not (surfaces.terminator.take(triangle).any() or (surfaces.bend.take(triangle) != 1).any()):
        return None
    return Footing(surfaces, *texels.places(ids, sample), side)


def bend_light(
    lamp: Lamp, light: Float32, points: Float32, normals: list[Float32], surfaces: Surfaces, triangle: Int32
) -> None:
    """Weaken a lamp's unshadowed light (P,), in place, where it counts by a cosine that is bent (Shading Offset).

    Args:
        points: (P, 3) float32, m
        normals: (3, P) each, those of `cosine_above`
        triangle: (P,) that the points are of
    """
    if not surfaces.bends:
        return
    bend = surfaces.bend.take(triangle)
    some = np.flatnonzero((bend != 1) & (light != 0))
    if not len(some):
        return
    nodes: Float64 = gauss_nodes(BENT_NODES) if lamp.extended else CENTRE
    p, above = rows_of(points[some]), [normal[:, some] for normal in normals]
    straight = lamp.light_by_samples(p, above, nodes)
    light[some] *= lamp.light_by_samples(p, above, nodes, bend[some]) / np.maximum(straight, TINY)


def bulge(surfaces: Surfaces, triangle: Int32, weights: Float32, side: int = 1) -> Float32:
    """From points of triangles to the surface (R, 3), m, that their normals tell of, as Cycles has it.

    Its height is that of the lowest of the three planes square to the corners' normals, each moved up until no corner
    is above it; but at least half of that of the parabolic patch through the corners with these normals.

    Args:
        triangle: (R,)
        weights: (R, 2) barycentric, of corners 1 and 2
        side: -1 for the surface that the backs see
    """
    slopes = surfaces.slopes.take(triangle, axis=1) * np.float32(side)
    s01, s02, s10, s12, s20, s21 = slopes
    v, w = np.ascontiguousarray(weights.T)
    u = 1 - v - w
    planes = [
        np.maximum(np.maximum(np.maximum(one, other), 0) - at_one * one - at_other * other, 0)
        for one, other, at_one, at_other in ((s01, s02, v, w), (s10, s12, u, w), (s20, s21, u, v))
    ]
    a, b, c = s20 + s02, s21 + s12, -s10 - s01
    parabola = a * u * (u - 1) + (a + b + c) * u * v + b * v * (v - 1)
    height = np.maximum(np.minimum(np.minimum(planes[0], planes[1]), planes[2]), parabola * np.float32(0.5))
    lifts: Float32 = surfaces.blended_normals(triangle, weights) * (height * np.float32(side))[:, None]
    return lifts


def horizons(texels: Texels, ids: Int64, shading: Float32) -> Float32:
    """Unit normals (B, 3) of the planes below which no light comes to texels `ids`, with shading normals (B, 3).

    Where shadow rays start on the rounder surface, or pass the triangle that they leave, they find out themselves.
    """
    normal: Float32 = texels.normal.take(ids)
    if texels.surfaces.rounds:
        rounder = texels.surfaces.terminator.take(texels.triangle[ids]) != 0
        normal[rounder] = shading[rounder]
    return normal
