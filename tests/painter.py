# SPDX-License-Identifier: GPL-3.0-or-later
"""A Shader for tests of the core: looks painted over world space by a function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from radiosity_addon.arrays import Bools, Float32, Float64
from radiosity_addon.scene import Scene
from radiosity_addon.shading import Layout, Quantity

BORDER = 1
"""Texels beside a triangle that are painted as well."""


@dataclass
class Painter:
    """Colours (P, 3) at points (P, 3), m, of the scene's world space, by quantity; keeps what it was asked for."""

    scene: Scene
    colors: dict[Quantity, Callable[[Float64], Float64]]

    def __post_init__(self) -> None:
        self.asked: list[tuple[Quantity, int]] = []

    def __call__(self, layout: Layout, meshes: Bools, quantity: Quantity) -> Float32:
        self.asked.append((quantity, layout.size))
        pages = np.zeros((layout.page_count, layout.size, layout.size, 3), np.float32)
        varies = np.array([quantity in material.varies for material in self.scene.materials])
        for index in np.flatnonzero(meshes):
            mesh = self.scene.meshes[index]
            for face in np.flatnonzero(varies[mesh.material]):
                corners = mesh.vertices[mesh.triangles[face]]
                uv = layout.uv[index][face].astype(np.float64) * layout.size
                low = np.maximum(np.floor(uv.min(0)).astype(int) - BORDER, 0)
                high = np.minimum(np.ceil(uv.max(0)).astype(int) + BORDER, layout.size)
                x, y = (
                    part.ravel() + 0.5
                    for part in np.meshgrid(*(np.arange(a, b) for a, b in zip(low, high, strict=True)))
                )
                edges = np.stack([uv[1] - uv[0], uv[2] - uv[0]], axis=1)
                u, v = np.linalg.solve(edges, np.stack([x, y]) - uv[0][:, None])
                own = (u > -0.5) & (v > -0.5)
                points = corners[0] + u[:, None] * (corners[1] - corners[0]) + v[:, None] * (corners[2] - corners[0])
                color = self.colors[quantity](points[own])
                page = pages[layout.page[index]]
                inside = own & (u + v <= 1)
                beside = own & (page[(y - 0.5).astype(int), (x - 0.5).astype(int)].sum(1) == 0)
                kept = (inside | beside)[own]
                page[(y[own][kept] - 0.5).astype(int), (x[own][kept] - 0.5).astype(int)] = color[kept]
        return pages
