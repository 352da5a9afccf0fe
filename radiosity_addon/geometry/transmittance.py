# SPDX-License-Identifier: GPL-3.0-or-later
"""What surfaces let straight through: constants, and for cut-outs, leaves and stained glass pictures of their own.

The pictures have nothing to do with the lightmap's pages: each triangle that varies gets a right-angled cell on one
square page, fine enough for the shadows that lightmap texels can show, and the Shader fills them at one go.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bools, Float32, Float64, Int32, Int64
from ..atlas.cells import along_z_order
from ..microfacet import mean_pane_transmittance, pane_transmittance
from ..scene import Material, Scene
from ..shading import Layout, Shader
from .surfaces import BLOCK, Surfaces

BUDGET = 1 << 22
"""Texels of all pictures; only where triangles are so many that each gets four texels it takes more."""

FINER = 4.0
"""Texels of a picture for each one of the lightmap, along an edge: a sharp shadow is then right to a quarter texel."""

LEAST_EDGE = 16
"""Texels along the edge of a cell, at least, while the budget allows it: the mean of a leaf must be right."""

NEARLY = 1e-3
"""Transmittances this near to 0, to 1, or to grey are taken to be so."""


@dataclass(frozen=True, eq=False)
class Transmittance:
    """The share of light that goes straight through F triangles, in C channels: 1, or 3 where some are coloured.

    Attributes:
        value: (C, F) float32, of triangles without a picture
        lowest, highest: (F,) float32, over a triangle and its channels
        ior: (F,) float32, index of refraction of clear glass, 1 for others
        mean: (F,) float32, what such glass passes on average over directions
        picture: (F,) int32, number among the K triangles with a picture, -1 for others
        lookup: (6, K) float32, texel coordinates x0, y0, dx/du, dx/dv, dy/du, dy/dv of each
        texels: (C, size * size) float32
        size: texels along the page
        unlike: (F,) bool, triangles that let other light through from behind
        behind: what those let through there; None: there are none
    """

    value: Float32
    lowest: Float32
    highest: Float32
    ior: Float32
    mean: Float32
    picture: Int32
    lookup: Float32
    texels: Float32
    size: int
    unlike: Bools
    behind: Transmittance | None = None

    @property
    def channels(self) -> int:
        return len(self.value)

    @property
    def opaque(self) -> Bools:
        """(F,) bool, triangles that let nothing through."""
        opaque = self.highest < NEARLY
        return np.asarray(opaque if self.behind is None else opaque & (self.behind.opaque | ~self.unlike))

    @property
    def clear(self) -> Bools:
        """(F,) bool, triangles that let everything through: to light they are not there."""
        clear = self.lowest > 1 - NEARLY
        return np.asarray(clear if self.behind is None else clear & (self.behind.clear | ~self.unlike))

    def at(
        self,
        triangle: Int32 | Int64,
        u: Float32,
        v: Float32,
        cosine: Float32 | None = None,
        front: Bools | None = None,
    ) -> Float32:
        """Shares (C, R) at barycentrics u, v (R,) of triangles (R,), pictures interpolated linearly.

        Args:
            cosine: (R,) between ray and normal; None: the mean over directions
            front: (R,) whether the light is met from the front; None: the share that passes both ways
        """
        share = self.value.take(triangle, axis=1)
        number = self.picture[triangle]
        shown = np.flatnonzero(number >= 0)
        for start in range(0, len(shown), BLOCK):
            part = shown[start : start + BLOCK]
            share[:, part] = self._interpolated(number[part], u[part], v[part])
        if cosine is not None:
            glass = np.flatnonzero(self.ior[triangle] > 1)
            which = triangle[glass]
            follows = pane_transmittance(cosine[glass], self.ior[which]) / self.mean[which]
            share[:, glass] = np.minimum(share[:, glass] * follows, 1)
        if self.behind is not None:
            turned = np.flatnonzero(self.unlike[triangle] if front is None else self.unlike[triangle] & ~front)
            slant = None if cosine is None else cosine[turned]
            other = self.behind.at(triangle[turned], u[turned], v[turned], slant)
            share[:, turned] = other if front is not None else np.minimum(share[:, turned], other)
        return share

    def _interpolated(self, number: Int32, u: Float32, v: Float32) -> Float32:
        place = []
        for base, by_u, by_v in ((0, 2, 3), (1, 4, 5)):
            along = self.lookup[by_u].take(number) * u
            along += self.lookup[by_v].take(number) * v
            along += self.lookup[base].take(number)
            place.append(along - np.float32(0.5))
        column, row = (np.clip(along, 0, self.size - 2).astype(np.int32) for along in place)
        right, up = place[0] - column, place[1] - row
        corner = row * np.int32(self.size) + column
        total = np.zeros((self.channels, len(number)), np.float32)
        for channel, texels in enumerate(self.texels):
            lower, upper = (
                texels.take(corner + step) * (1 - right) + texels.take(corner + step + 1) * right
                for step in (0, self.size)
            )
            total[channel] = lower * (1 - up) + upper * up
        return total


def for_indirect_light(scene: Scene) -> Scene:
    """The scene as light meets it that does not come from lamps; itself, where its materials make no difference."""
    if all(material.indirect_transmittance is None for material in scene.materials):
        return scene
    materials = (
        replace(material, transmittance=material.indirect_transmittance or material.transmittance)
        for material in scene.materials
    )
    return replace(scene, materials=tuple(materials))


def transmittance_of(scene: Scene, surfaces: Surfaces, shader: Shader | None, density: float) -> Transmittance | None:
    """What the scene's triangles let through, or None where all are opaque.

    Args:
        shader: tells what varies; without one its mean serves
        density: texels per metre of the lightmap
    """
    materials = scene.materials
    constant = np.array([material.transmittance for material in materials] or [(0, 0, 0)], np.float32)
    varies = np.array(["transmittance" in material.varies for material in materials] or [False])
    chosen = np.flatnonzero(varies[surfaces.material]) if shader is not None else np.zeros(0, np.int64)
    if not len(chosen) and constant.max(initial=0) < NEARLY:
        return None
    cells = _Cells.of(surfaces.area[chosen], density)
    unlike = np.array([passes_unlike(materials, material) for material in materials])[surfaces.material]
    pages = [np.zeros((3, cells.size**2), np.float32)] * 2
    if shader is not None and len(chosen):
        pages = [_asked(scene, surfaces, shader, chosen, cells)] * 2
        turned = unlike[chosen]
        if turned.any():
            pages[1] = _asked(scene, surfaces, shader, chosen, cells, turned)
            gap = np.abs(pages[1] - pages[0]).max(0)
            unlike[chosen] &= cells.range_of(np.maximum, gap) >= NEARLY
    front, colored = _side(scene, surfaces, surfaces.material, chosen, cells, pages[0], unlike)
    found = [front]
    if unlike.any():
        material = np.where(unlike, scene.behind[surfaces.material], surfaces.material)
        back, also = _side(scene, surfaces, material, chosen, cells, pages[1], unlike)
        found, colored = [front, back], colored or also
    if not colored:
        found = [replace(side, value=side.value[:1].copy(), texels=side.texels[:1].copy()) for side in found]
    return replace(found[0], behind=found[1]) if len(found) > 1 else found[0]


def _side(
    scene: Scene,
    surfaces: Surfaces,
    material: Int32,
    chosen: Int64,
    cells: _Cells,
    texels: Float32,
    unlike: Bools,
) -> tuple[Transmittance, bool]:
    """What triangles of materials (F,) let through, those `chosen` by pictures, and whether that is coloured."""
    constant = np.array([entry.transmittance for entry in scene.materials], np.float32)
    value = constant[material].T
    lowest, highest = value.min(0), value.max(0)
    picture = np.full(surfaces.count, -1, np.int32)
    picture[chosen] = np.arange(len(chosen))
    value[:, chosen] = 0
    least, most = _over_channels(np.minimum, texels), _over_channels(np.maximum, texels)
    lowest[chosen], highest[chosen] = cells.range_of(np.minimum, least), cells.range_of(np.maximum, most)
    colored = max(float(np.ptp(value, axis=0).max(initial=0)), float((most - least).max())) >= NEARLY
    means = [mean_pane_transmittance(entry.ior) for entry in scene.materials]
    side = Transmittance(
        value=np.ascontiguousarray(value),
        lowest=lowest,
        highest=highest,
        ior=np.array([entry.ior for entry in scene.materials], np.float32)[material],
        mean=np.array(means, np.float32)[material],
        picture=picture,
        lookup=cells.lookup,
        texels=texels,
        size=cells.size,
        unlike=unlike,
    )
    return side, colored


def passes_unlike(materials: Sequence[Material], front: Material) -> bool:
    """Whether light may pass one of the materials otherwise from behind."""
    if front.back is None or "transmittance" in front.varies:
        return front.back is not None
    back = materials[front.back]
    return (front.transmittance, front.ior) != (back.transmittance, back.ior)


def _asked(
    scene: Scene, surfaces: Surfaces, shader: Shader, chosen: Int64, cells: _Cells, behind: Bools | None = None
) -> Float32:
    """Pictures (3, size * size) of the `chosen` triangles, in 0..1; of some of them, from `behind` (K,)."""
    asked = np.ones(len(chosen), bool) if behind is None else behind
    meshes = np.zeros(len(scene.meshes), bool)
    meshes[surfaces.mesh[chosen[asked]]] = True
    outside = np.full((surfaces.count, 3, 2), -1.0, np.float32)  # triangles that don't vary lie beside the page
    outside[chosen[asked]] = cells.uv[asked]
    layout = Layout(
        size=cells.size,
        page_count=1,
        page=np.where(meshes, 0, -1).astype(np.int32),
        uv=tuple(outside[first:last] for first, last in zip(surfaces.first[:-1], surfaces.first[1:], strict=True)),
    )
    seen = {} if behind is None else {"behind": True}
    page = shader(layout, meshes, "transmittance", **seen)[0].reshape(-1, 3)
    # channels by rows in memory too: a look-up in a row with gaps copies all of it first
    shares: Float32 = np.ascontiguousarray(np.clip(np.nan_to_num(page.T), 0, 1), np.float32)
    for channel in shares:
        cells.mirror(channel)
    return shares


@dataclass(frozen=True, eq=False)
class _Cells:
    """Square cells of K triangles on one page.

    Attributes:
        size: texels along the page, a power of two
        edge: (K,) int64, texels along each cell, a power of two
        corner: (K, 2) int64, column and row of its lower left texel
    """

    size: int
    edge: Int64
    corner: Int64

    @classmethod
    def of(cls, area: Float64, density: float) -> _Cells:
        """Cells for triangles of `area` (K,), m2, finer than a lightmap of `density`, texels per metre."""
        if not len(area):
            return cls(2, np.zeros(0, np.int64), np.zeros((0, 2), np.int64))
        wanted = np.maximum(np.sqrt(2 * area) * density * FINER + 2, LEAST_EDGE)
        budget = max(BUDGET, 4 * len(area))
        while True:
            edge = np.maximum(2 ** np.ceil(np.log2(wanted)), 2).astype(np.int64)
            texels = int((edge**2).sum())
            if texels <= budget:
                break
            wanted = np.maximum(wanted / 2, 2)
        order = np.argsort(-edge, kind="stable")
        corner = np.empty((len(area), 2), np.int64)
        corner[order] = along_z_order(edge[order])
        return cls(1 << max(1, -(-(texels - 1).bit_length() // 2)), edge, corner)

    @property
    def _border(self) -> Float64:
        return np.asarray(np.where(self.edge >= 4, 1.0, self.edge / 4))

    @property
    def uv(self) -> Float32:
        """(K, 3, 2) float32 in 0..1 of the page."""
        right_angle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        inner = (self.edge - 2 * self._border)[:, None, None]
        corner = (self.corner + self._border[:, None])[:, None, :]
        return ((corner + right_angle * inner) / self.size).astype(np.float32)

    @property
    def lookup(self) -> Float32:
        """As `Transmittance.lookup`."""
        inner, none = self.edge - 2 * self._border, np.zeros(len(self.edge))
        x, y = (self.corner + self._border[:, None]).T
        return np.stack([x, y, inner, none, none, inner]).astype(np.float32)

    def mirror(self, texels: Float32) -> None:
        """Continue what triangles show of `texels` (size * size,) beyond their longest edge, in place.

        The Shader does so for the texels next to it only, all that interpolation reaches.
        """
        page = texels.reshape(self.size, self.size)
        for edge in np.unique(self.edge):
            y, x = np.nonzero(np.add.outer(np.arange(edge), np.arange(edge)) > edge)
            own = self.corner[self.edge == edge]
            step = max(1, BLOCK // max(len(x), 1))
            for start in range(0, len(own), step):
                column, row = (part[:, None] for part in own[start : start + step].T)
                page[row + y, column + x] = page[row + edge - 1 - x, column + edge - 1 - y]

    def range_of(self, extreme: np.ufunc, texels: Float32) -> Float32:
        """Lowest or highest value (K,) of `texels` (size * size,) in each cell, by halving the page again and again."""
        result: Float32 = np.zeros(len(self.edge), np.float32)
        page: Float32 = texels.reshape(self.size, self.size)
        for level in range(1, self.size.bit_length()):
            page = extreme(extreme(page[::2, ::2], page[1::2, ::2]), extreme(page[::2, 1::2], page[1::2, 1::2]))
            own = np.flatnonzero(self.edge == 1 << level)
            result[own] = page[self.corner[own, 1] >> level, self.corner[own, 0] >> level]
        return result


def _over_channels(extreme: np.ufunc, texels: Float32) -> Float32:
    """Least or greatest (P,) of three channels (3, P)."""
    found: Float32 = extreme(extreme(texels[0], texels[1]), texels[2])
    return found
