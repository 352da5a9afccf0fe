# SPDX-License-Identifier: GPL-3.0-or-later
"""A shader for tests of the core: paints surfaces by where they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from radiosity_addon.arrays import Bools, Float32, Float64
from radiosity_addon.scene import Scene
from radiosity_addon.shading import Layout, Quantity


@dataclass
class Painter:
    """Colours as functions of places in the world, (..., 3) to (..., 3), at the centres of texels inside triangles.

    Attributes:
        asked: what it was called for so far
    """

    scene: Scene
    colors: dict[Quantity, Callable[[Float64], Float64]]
    asked: list[Quantity] = field(default_factory=list)

    def __call__(self, layout: Layout, meshes: Bools, quantity: Quantity) -> Float32:
        self.asked.append(quantity)
        pages = np.zeros((layout.page_count, layout.size, layout.size, 3), np.float32)
        for index in np.flatnonzero(meshes):
            mesh = self.scene.meshes[index]
            for uv, corners in zip(layout.uv[index].astype(float), mesh.vertices[mesh.triangles], strict=True):
                self._paint(pages[layout.page[index]], uv * layout.size, corners, quantity)
        return pages

    def _paint(self, page: Float32, uv: Float64, corners: Float64, quantity: Quantity) -> None:
        size = len(page)
        low, high = np.floor(uv.min(0)).astype(int) - 1, np.ceil(uv.max(0)).astype(int) + 1
        (x, y), (x_end, y_end) = np.clip(low, 0, size), np.clip(high, 0, size)
        column, row = np.meshgrid(np.arange(x, x_end), np.arange(y, y_end))
        edges = (uv[1:] - uv[0]).T
        if abs(np.linalg.det(edges)) < 1e-12:
            return
        u, v = np.linalg.solve(edges, np.stack([column.ravel() + 0.5 - uv[0, 0], row.ravel() + 0.5 - uv[0, 1]]))
        near = (u > -0.05) & (v > -0.05) & (u + v < 1.05)  # a little beside, as a margin
        place = corners[0] + u[near, None] * (corners[1] - corners[0]) + v[near, None] * (corners[2] - corners[0])
        page[row.ravel()[near], column.ravel()[near]] = self.colors[quantity](place)
