# SPDX-License-Identifier: GPL-3.0-or-later
"""One layout for all meshes of a shape: instances, and objects that share their data.

A uv map belongs to the data that they share, so it is the same for the whole family, and each member can only scale
and shift it to a place of its own. The charts of one member are packed once, as a block; on the pages a member is
then one rectangle, however many triangles it has.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from ..arrays import Float32, Float64, Int32
from ..scene import Mesh
from .charts import signed_area
from .packing import Items, place
from .parametrize import Flat

LEAST_SCALE = 0.5
"""Members smaller than this share of the family's mean get that share's texels: the gaps in the block are common."""

WIDTHS = 2.0 ** (np.arange(-8, 9) / 4)
"""Widths tried for a block, as shares of the edge of a square of its charts' area."""

Place: TypeAlias = tuple[float, float, float]
"""Of a member: uv on its page = scale * uv of the layout + (u, v), as (scale, u, v)."""


@dataclass(frozen=True, eq=False)
class Family:
    """Meshes that share an unwrap.

    Attributes:
        shape: their Mesh.shape
        members: K indices into the scene's meshes; the first is the one that is unwrapped
        size: (K,) float64, how much larger each is in the world than the first
        scale: (K,) float64, how much larger each is laid than the first
        flat: the first laid flat, m
    """

    shape: int
    members: tuple[int, ...]
    size: Float64
    scale: Float64
    flat: Flat

    @cached_property
    def chart_area(self) -> Float64:
        """(C,) m2, of the charts of the first."""
        return np.bincount(self.flat.chart, np.abs(signed_area(self.flat.uv)))


@dataclass(frozen=True, eq=False)
class Layout:
    """A family's layout by polygon corner.

    Attributes:
        uv: (L, 2) float32, in 0..1 of the larger edge of the block
        chart: (L,) int32, from 0, -1 at corners without a triangle
        edge: that larger edge, m
    """

    uv: Float32
    chart: Int32
    edge: float

    def place(self, scale: float, box: Float64) -> Place:
        """Where a member lies whose rectangle has these triangles (2, 3, 2) on the page, `scale` per metre."""
        u, v = box[0, 0].tolist()
        return float(scale * self.edge), u, v

    def placed(self, mesh: Mesh, place: Place) -> tuple[Float32, Int32]:
        """Uv (F, 3, 2) and chart (F,) of a member's triangles; `place` is its scale and shift."""
        scale, *shift = np.array(place, np.float32)
        uv = self.uv[mesh.corner] * scale + np.array(shift)
        return np.clip(uv, 0, 1), np.maximum(self.chart[mesh.corner].max(axis=1), 0)


def shared_shapes(meshes: Sequence[Mesh]) -> dict[int, tuple[int, ...]]:
    """Indices of the meshes with a lightmap by their shape, for each shape of two or more.

    The one with most triangles comes first: none of its faces is too flat in the world.
    """
    members: dict[int, list[int]] = defaultdict(list)
    for index, mesh in enumerate(meshes):
        if mesh.shape is not None and mesh.lightmapped and len(mesh.triangles):
            members[mesh.shape].append(index)
    return {
        shape: tuple(sorted(same, key=lambda index: -len(meshes[index].triangles)))
        for shape, same in members.items()
        if len(same) > 1
    }


def make_family(meshes: Sequence[Mesh], shape: int, members: tuple[int, ...], flat: Flat) -> Family:
    """The family of these members, the first of which is laid flat."""
    edge = np.sqrt([_area(meshes[index]) for index in members])
    wanted = edge * [meshes[index].density for index in members]
    laid = np.maximum(wanted, LEAST_SCALE * wanted.mean())
    return Family(shape, members, edge / edge[0], laid / edge[0], flat)


def lay_blocks(
    families: Sequence[Family], texels: float, size: int, padding: int
) -> Generator[None, None, list[Float64]]:
    """The charts of each family, (F, 3, 2) float64, m, in a rectangle at the origin.

    Args:
        texels: texels per metre of the pages
        size: texels along a page
        padding: texels that must be between the charts of the smallest member
    """
    blocks = []
    for family in families:
        blocks.append((yield from _lay_block(family, texels, size, padding)))
    return blocks


def _lay_block(family: Family, texels: float, size: int, padding: int) -> Generator[None, None, Float64]:
    """The block of the width at which as much of the family as a page holds fills the smallest square."""
    flat = family.flat
    if flat.rigid:
        return np.asarray(flat.uv - flat.uv.min(axis=(0, 1)))
    order = np.argsort(flat.chart, kind="stable")
    first = np.searchsorted(flat.chart[order], np.arange(int(flat.chart.max()) + 2))
    items = Items(flat.uv[order], first)
    scale = texels * float(family.scale.min())
    narrowest = int(np.ceil((items.extent.min(axis=1).max()) * scale)) + padding
    square = np.sqrt(((np.sqrt(items.area) * scale + padding) ** 2).sum())
    largest = float(family.scale.max() / family.scale.min())
    mean = float((family.scale**2).mean() / family.scale.min() ** 2)
    copies = int(np.clip(size**2 / (mean * square**2), 1, len(family.members)))
    best, least = items.points, np.inf
    for width in np.unique(np.maximum(np.ceil(WIDTHS * square), narrowest).astype(int)).tolist():
        placement = yield from place(items, scale, width, padding, height=np.inf)
        if placement is None:
            continue
        points = placement.applied(items)
        box = np.ptp(points.reshape(-1, 2), axis=0)
        edge = _square_of(copies, box + padding)
        if box.max() * largest > size - padding:
            edge += box.max() * largest * len(family.members)  # worse than any that fits, the squarer the better
        if edge < least:
            best, least = points, edge
    block = np.empty_like(best)
    block[order] = best - best.min(axis=(0, 1))
    return block / scale


def boxes(families: Sequence[Family], blocks: Sequence[Float64]) -> list[Items]:
    """What the packer places for each member of each family: rectangles that must not be turned."""
    found = []
    for family, block in zip(families, blocks, strict=True):
        width, height = block.max(axis=(0, 1))
        corners = np.array([[0, 0], [width, 0], [width, height], [0, height]])
        halves = corners[[[0, 1, 2], [0, 2, 3]]]
        found += [Items(halves * scale, np.array([0, 2]), np.ones(1, bool)) for scale in family.scale]
    return found


def layout_of(family: Family, meshes: Sequence[Mesh], block: Float64) -> Layout:
    """The layout by polygon corner, which serves members of either winding and with faces left out."""
    first = meshes[family.members[0]]
    corners = max(int(meshes[index].corner.max()) for index in family.members) + 1
    edge = float(block.max())
    uv, chart = np.zeros((corners, 2), np.float32), np.full(corners, -1, np.int32)
    uv[first.corner] = block / edge
    chart[first.corner] = family.flat.chart[:, None]
    return Layout(uv, chart, edge)


def _area(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _square_of(copies: int, box: Float64) -> float:
    """Edge of the smallest square that holds so many boxes in rows."""
    columns = np.arange(1, copies + 1)
    return float(np.maximum(columns * box[0], -(-copies // columns) * box[1]).min())
