# SPDX-License-Identifier: GPL-3.0-or-later
"""Places for surfaces that get no lightmap: one small square cell a triangle on hidden pages.

They only carry patches for the light's transport, so no seam matters. Cells have edges of powers of two and are laid
along a Z-order curve, the largest first, which leaves no gap (Morton 1966).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float32, Float64, Int32, Int64
from ..scene import Mesh

HIDDEN_SHARE = 1 / 8
"""Density of hidden pages as a share of the lightmaps'."""

LARGEST_CELL = 64
"""Texels along the largest cell."""

SHARE_OF_PAGE = 0.25
"""Of a page's texels that one mesh may take, so that hidden pages stay few; it takes more for a texel a triangle."""


@dataclass(frozen=True, eq=False)
class Cells:
    """A mesh on a hidden page.

    Attributes:
        page: hidden page, from 0
        uv: (F, 3, 2) float32 in 0..1
        chart: (F,) int32, cell of each triangle, from 0
        density: texels per metre
    """

    page: int
    uv: Float32
    chart: Int32
    density: float


def lay_cells(meshes: list[Mesh], density: float, size: int) -> list[Cells]:
    """Places of all triangles of `meshes`, each mesh wholly on one page.

    A triangle gets a cell with a free border of one texel where that fits; a mesh of so many triangles that they
    don't fit on a page takes smaller cells, at last one texel for several triangles that are neighbours in its list.

    Args:
        density: texels per metre, 0: none is known
        size: texels along a page
    """
    grid = 1 << (size.bit_length() - 1)
    result: list[Cells] = []
    page, used = 0, 0
    for mesh in meshes:
        corners = mesh.vertices[mesh.triangles].astype(np.float64)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        edge, cell = _cell_edges(area, density * mesh.density, grid)
        _, first, index = np.unique(cell, return_index=True, return_inverse=True)
        order = np.argsort(-edge[first], kind="stable")
        rank = np.empty(len(order), np.int64)
        rank[order] = np.arange(len(order))
        cell, edge_of_cell = rank[index.reshape(-1)], edge[first][order]
        texels = int((edge_of_cell**2).sum())
        used = (
            -(-used // int(edge_of_cell[0]) ** 2) * int(edge_of_cell[0]) ** 2
        )  # cells start at multiples of their size
        if used + texels > grid**2:
            page, used = page + 1, 0
        corner = along_z_order(edge_of_cell, used)[cell]
        width = edge_of_cell[cell][:, None]
        border = np.where(width >= 4, 1.0, width / 4)
        inner = (width - 2 * border)[:, :, None]
        right_angle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        uv = ((corner + border)[:, None, :] + right_angle * inner) / size
        flat = inner[:, 0, 0] ** 2 / 2
        reached = float(np.sqrt(flat.sum() / area.sum())) if area.sum() > 0 else 0.0
        result.append(Cells(page, uv.astype(np.float32), cell.astype(np.int32), reached))
        used += texels
    return result


def along_z_order(edge: Int64, start: int = 0) -> Int64:
    """Columns and rows (N, 2) of the lower left texels of square cells, one after the other along the curve.

    Args:
        edge: (N,) texels along each cell, powers of two that nowhere grow
        start: texels of the curve before the first cell, a multiple of its area
    """
    begin = start + np.cumsum(edge**2) - edge**2
    return np.stack([_every_other_bit(begin), _every_other_bit(begin >> 1)], axis=1)


def _cell_edges(area: Float64, density: float, grid: int) -> tuple[Int64, Int64]:
    """Edge of each triangle's cell, texels, a power of two, and which triangles share cells."""
    count = len(area)
    alone = np.arange(count)
    wanted = np.sqrt(2 * area) * density + 2
    for smallest in (4, 2, 1):
        if count * smallest**2 > grid**2:
            continue
        budget = max(SHARE_OF_PAGE * grid**2, count * smallest**2)
        largest = min(LARGEST_CELL, max(grid // 4, 1))
        while True:
            edge = np.clip(2 ** np.ceil(np.log2(wanted)), smallest, max(largest, smallest)).astype(np.int64)
            if int((edge**2).sum()) <= budget or largest <= smallest:
                return edge, alone
            largest //= 2
    shared = -(-count // grid**2)
    return np.ones(count, np.int64), alone // shared


def _every_other_bit(code: Int64) -> Int64:
    """Bits 0, 2, 4, ... of each number, side by side."""
    code = code & 0x5555555555555555
    for shift, mask in (
        (1, 0x3333333333333333),
        (2, 0x0F0F0F0F0F0F0F0F),
        (4, 0x00FF00FF00FF00FF),
        (8, 0x0000FFFF0000FFFF),
        (16, 0x00000000FFFFFFFF),
    ):
        code = (code | (code >> shift)) & mask
    return code
