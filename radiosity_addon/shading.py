# SPDX-License-Identifier: GPL-3.0-or-later
"""What only the modelling program can tell: how surfaces look where their materials vary.

The core lays surfaces out on pages and asks for one quantity at a time; Blender's side answers with pictures.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, get_args

from .arrays import Bools, Float32, Int32

Quantity = Literal["reflectance", "emission", "transmittance", "translucence"]
"""What is asked for, each a colour, of the surface as a whole: a half clear surface reflects half as much.

reflectance: diffuse plus glossy albedo, of what leaves from either side
emission: W/(m2 sr)
transmittance: share of the light that goes straight on, as through clear or coloured glass
translucence: part of the reflectance that leaves from the other side, as through paper
"""

QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)


@dataclass(frozen=True, eq=False)
class Layout:
    """Where M meshes lie on square pages.

    Attributes:
        size: texels along an edge of a page
        page_count: pages
        page: (M,) int32, page of each mesh, -1 for none
        uv: a mesh's (F, 3, 2) float32 in 0..1 of its page, v up
    """

    size: int
    page_count: int
    page: Int32
    uv: tuple[Float32, ...]


class Shader(Protocol):
    """Answers how surfaces look."""

    def __call__(self, layout: Layout, meshes: Bools, quantity: Quantity, behind: bool = False) -> Float32:
        """Colours (page_count, size, size, 3), linear, row 0 at v = 0.

        Args:
            layout: where the meshes of the scene lie
            meshes: (M,) which of them are wanted; elsewhere the pages are black
            quantity: what is wanted, at the centre of each texel or, beside a chart, of the texel nearest to it
            behind: of the backs, of materials that look otherwise from there
        """
        ...
