# SPDX-License-Identifier: GPL-3.0-or-later
"""How surfaces glow whose emission varies: screens, neon, windows painted on a wall.

Pictures of their own tell it, far finer than a lightmap: each triangle gets half of a square cell, whose texels lie
evenly over it. An emitter is cut into small triangles, each as bright as the texels in it are on average.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bools, Float32, Float64, Int32, Int64
from ..geometry.appearance import within_physics
from ..geometry.surfaces import Surfaces
from ..scene import RGB, Scene
from ..shading import Layout, Shader

PAGE = 1024
"""Texels along the page of the pictures, while every triangle gets a few."""

EDGES = (128, 64, 32, 16, 8, 4)
"""Texels along a cell: the largest that goes onto the page."""

PIECES = 4096
"""Pieces that an emitter is cut into, at most, unless it has more triangles."""

TEXELS_ALONG = 4
"""Texels along a piece, at least."""

ALIKE = 1e-3
"""What differs by no more than this share of the brightest is the same."""


@dataclass(frozen=True, eq=False)
class Glow:
    """What K triangles emit.

    Attributes:
        triangle: (K,) which triangles of the scene, ascending
        edge: texels along a triangle's legs
        radiance: (K, S, 3) float32, W/(m2 sr), at points spread evenly over each
        u, v: (S,) barycentrics of the points
        backs: what the same triangles emit behind; None: all the same
    """

    triangle: Int64
    edge: int
    radiance: Float32
    u: Float64
    v: Float64
    backs: Glow | None = None

    @property
    def bright(self) -> Bools:
        """(K,) which of them emit anything on either side."""
        shines: Bools = self.radiance.any((1, 2))
        return shines if self.backs is None else shines | self.backs.bright

    def extent(self, triangles: Int64, area: Float64) -> float:
        """The area, m2, of an even emitter whose light is as much concentrated: small if little of a wall is bright.

        Args:
            triangles: (N,) of those that glow
            area: (F,) m2, of all triangles
        """
        level = self.radiance[np.searchsorted(self.triangle, triangles)].mean(2, dtype=np.float64)
        light, square = float(area[triangles] @ level.mean(1)), float(area[triangles] @ (level**2).mean(1))
        return light**2 / max(square, 1e-300)

    def constant(self, triangles: Int64) -> RGB | None:
        """What triangles (N,) of those that glow emit if it is the same all over, W/(m2 sr)."""
        shown = self.radiance[np.searchsorted(self.triangle, triangles)].reshape(-1, 3)
        if np.ptp(shown, axis=0).max() > ALIKE * shown.max():
            return None
        red, green, blue = shown.mean(0, dtype=np.float64)
        return float(red), float(green), float(blue)

    def at(self, triangle: Int32, u: Float32, v: Float32) -> Float32:
        """Radiance (R, 3), W/(m2 sr), at barycentrics u, v of triangles (R,) that glow."""
        leg = np.float32(self.edge - 0.5)
        column, row = (np.clip(part * leg, 0, self.edge - 2).astype(np.int64) for part in (u, v))
        column = np.minimum(column, self.edge - 2 - row)
        point = row * (self.edge - 1) - row * (row - 1) // 2 + column  # rows are the shorter the higher they are
        found: Float32 = self.radiance[np.searchsorted(self.triangle, triangle), point]
        return found

    def pieces(self, triangles: Int64, corners: Float64) -> tuple[Float64, Float64, Int64]:
        """Small triangles that make up triangles, those without light left out.

        Args:
            triangles: (N,) of those that glow
            corners: (N, 3, 3), m, of them
        Returns:
            (P, 3, 3), m, wound alike; (P, 3), W/(m2 sr), their mean radiance; (P,) which of `triangles` they are of
        """
        cuts = max(1, min(int(np.sqrt(PIECES / len(triangles))), self.edge // TEXELS_ALONG))
        column, row = np.floor(self.u * cuts), np.floor(self.v * cuts)
        upper = self.u * cuts - column + self.v * cuts - row > 1
        piece = ((row * cuts + column) * 2 + upper).astype(np.int64)
        own = np.searchsorted(self.triangle, triangles)
        slots = 2 * cuts**2
        count = np.bincount(piece, minlength=slots)
        index = (np.arange(len(own))[:, None] * slots + piece).ravel()
        sums = [np.bincount(index, self.radiance[own, :, k].ravel(), len(own) * slots) for k in range(3)]
        mean = np.stack(sums, axis=1).reshape(len(own), slots, 3) / np.maximum(count, 1)[:, None]
        number = np.arange(slots)
        low = np.stack([number // 2 % cuts, number // 2 // cuts], axis=1)
        offsets = np.where((number % 2 == 1)[:, None, None], [[1, 1], [0, 1], [1, 0]], [[0, 0], [1, 0], [0, 1]])
        weights = (low[:, None] + offsets) / cuts
        edges = corners[:, 1:] - corners[:, :1]
        cut = corners[:, None, :1] + np.einsum("sck,nkx->nscx", weights, edges)
        bright = (count > 0) & (mean.max(2) > 0)
        return cut[bright], mean[bright], np.nonzero(bright)[0]


def glow_of(scene: Scene, surfaces: Surfaces, shade: Shader | None) -> tuple[Glow | None, tuple[str, ...]]:
    """What triangles emit whose emission varies, None if none does, and warnings about what can't be as it is shown.

    Args:
        shade: tells what varies; without it everything has its material's constants
    """
    varies = np.array(["emission" in material.varies for material in scene.materials] or [False])
    chosen = np.flatnonzero(varies[surfaces.material] & (surfaces.area > 0))
    if shade is None or not len(chosen):
        return None, ()
    edge = next((edge for edge in EDGES if len(chosen) <= (PAGE // edge) ** 2), EDGES[-1])
    across = max(PAGE // edge, 1 << int(np.ceil(np.log2(np.sqrt(len(chosen))))))
    size = across * edge
    corner = np.stack([np.arange(len(chosen)) % across, np.arange(len(chosen)) // across], axis=1) * edge
    leg = edge - 0.5  # so that the texels within, edge (edge - 1) / 2 of them, have just its area
    uv = np.full((surfaces.count, 3, 2), -1.0, np.float32)  # what does not vary lies beside the page
    uv[chosen] = (corner[:, None] + np.array([[0, 0], [leg, 0], [0, leg]])) / size
    meshes = np.zeros(len(scene.meshes), bool)
    meshes[surfaces.mesh[chosen]] = True
    layout = Layout(
        size=size,
        page_count=1,
        page=np.where(meshes, 0, -1).astype(np.int32),
        uv=tuple(uv[first:last] for first, last in zip(surfaces.first[:-1], surfaces.first[1:], strict=True)),
    )
    column, row = (part.ravel() for part in np.meshgrid(np.arange(edge), np.arange(edge)))
    column, row = column[column + row <= edge - 2], row[column + row <= edge - 2]
    u, v = ((place + 0.5).astype(np.float64) / leg for place in (column, row))

    def seen(page: Float32, those: Int64) -> tuple[Float32, tuple[str, ...]]:
        """What a page shows of some of the chosen triangles, (N, S, 3)."""
        shown = page[corner[those, 1:] + row, corner[those, :1] + column]
        owner = np.repeat(chosen[those], len(row))
        radiance, said = within_physics(shown.reshape(-1, 3), "emission", owner, scene, surfaces)
        return radiance.reshape(shown.shape), said

    radiance, warnings = seen(shade(layout, meshes, "emission")[0], np.arange(len(chosen)))
    glow = Glow(chosen, edge, radiance, u, v)
    unlike = np.flatnonzero((scene.behind != np.arange(len(scene.materials)))[surfaces.material[chosen]])
    if len(unlike):
        meshes = np.bincount(surfaces.mesh[chosen[unlike]], minlength=len(meshes)) > 0
        behind = radiance.copy()
        behind[unlike], more = seen(shade(layout, meshes, "emission", behind=True)[0], unlike)
        if not np.array_equal(behind, radiance):
            glow, warnings = replace(glow, backs=replace(glow, radiance=behind)), warnings + more
    return glow, warnings
