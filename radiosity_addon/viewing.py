# SPDX-License-Identifier: GPL-3.0-or-later
"""Someone looks on while a scene is baked: what there is to see, and when it is good enough.

Nothing here enters a bake that nobody looks on at, nor the pages of one that is not ended early.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Protocol, TypeAlias

import numpy as np

from .arrays import Float32, Int32, Int64
from .atlas.unwrap import Atlas
from .geometry.appearance import Appearance
from .geometry.texels import Texels
from .radiosity.first_light import FirstLight, first_light
from .scene import Scene

MOST_SHOWN = 1 << 22
"""Texels of all pages that are shown; larger ones are shown at a half, a quarter ... of their size."""


@dataclass(frozen=True, eq=False)
class LitVertices:
    """Radiance at the vertices of triangles.

    Attributes:
        position: (V, 3) float32, m, in the world
        radiance: (V, 3) float32, W/(m2 sr)
        pieces: (K, 3) int64, into these
        mesh: (K,) int32, index into Scene.meshes; those of backs lie beyond
    """

    position: Float32
    radiance: Float32
    pieces: Int64
    mesh: Int32


@dataclass(frozen=True, eq=False)
class LitPages:
    """Radiance on pages.

    Attributes:
        corners: (F, 3, 3) float32, m, in the world
        uv: (F, 3, 2) float32, 0..1 of their page
        page: (F,) int32, -1 for triangles without a lightmap
        mesh: (F,) int32, as in LitVertices
        images: (S, S, 3) float32 each, W/(m2 sr), row 0 at v = 0
    """

    corners: Float32
    uv: Float32
    page: Int32
    mesh: Int32
    images: list[Float32]


View: TypeAlias = LitVertices | LitPages
Found: TypeAlias = Callable[[], Float32]


class Viewer(Protocol):
    """Who looks on. A bake calls from whichever thread it runs in."""

    @property
    def satisfied(self) -> bool:
        """The bake may end with the light as it was shown last."""
        ...

    def show(self, view: View) -> None:
        """A better look."""
        ...


class Satisfied(Exception):
    """Ends a bake early; the message is the stage in which that was."""


def show_first_light(scene: Scene, viewer: Viewer) -> Generator[bool, None, FirstLight]:
    """The first light of a scene, backs included, shown as soon as it is there; yields whether it was."""
    steps = first_light(scene)
    try:
        while True:
            glimpse = next(steps)
            if glimpse is not None:
                viewer.show(_at_vertices(scene, glimpse))
            yield glimpse is not None
    except StopIteration as stop:
        light: FirstLight = stop.value
    viewer.show(_at_vertices(scene, light))
    return light


def _at_vertices(scene: Scene, light: FirstLight) -> LitVertices:
    vertices = light.vertices
    surfaces = vertices.surfaces
    position = surfaces.points(vertices.triangle, vertices.weights) + surfaces.origin.astype(np.float32)
    pieces, triangle = vertices.pieces()
    mesh = surfaces.mesh[triangle]
    shown = np.array([each.lightmapped for each in scene.meshes])[mesh]
    return LitVertices(position, light.radiance[vertices.sample], pieces[shown], mesh[shown])


class LiveLight:
    """The light of a bake at its texels as far as it is known: first light where nothing better is."""

    def __init__(
        self, viewer: Viewer | None, first: FirstLight | None, atlas: Atlas, texels: Texels, look: Appearance
    ) -> None:
        """Shows first light at texels. Without a viewer nothing is ever done."""
        self._viewer = viewer
        if viewer is None or first is None:
            return
        self._first, self._texels = first, texels
        self._reflectance = look.reflectance
        self._emission = np.maximum(look.emission[:], first.emission_at(texels))  # lamps are shown as they shine
        self._direct, self._indirect = first.at(texels)
        surfaces = texels.surfaces
        page = atlas.page[surfaces.mesh]
        self._view = LitPages(
            corners=surfaces.corners + surfaces.origin.astype(np.float32),
            uv=np.concatenate(atlas.uv),
            page=np.where(page < atlas.page_count, page, -1),
            mesh=surfaces.mesh,
            images=[],
        )
        part = 1
        while atlas.page_count * (atlas.size // part) ** 2 > MOST_SHOWN:
            part *= 2
        size = -(-atlas.size // part)
        count = texels.before(atlas.page_count * atlas.size**2)
        number, pixel = np.divmod(texels.pixel[:count], atlas.size**2)
        row, column = np.divmod(pixel, atlas.size)
        self._pixel = (number * size + row // part) * size + column // part
        self._shape = (atlas.page_count, size, size, 3)
        self._show()

    def irradiance(self) -> Float32:
        """What is known, (T, 1, 3), W/m2, light groups added up."""
        return (self._direct + self._indirect)[:, None]

    def update(self, direct: Found | None = None, indirect: Found | None = None) -> None:
        """Keep and show what was found.

        Args:
            direct, indirect: give irradiance (T, G, 3), W/m2, from lamps and from everything else; not asked if nobody
                looks on
        """
        if self._viewer is None:
            return
        if direct is not None:
            self._direct = self._with_hidden(direct().sum(1), self._direct)
        if indirect is not None:
            self._indirect = self._with_hidden(indirect().sum(1), self._indirect)
        self._show()

    def exchanged(self, irradiance: Found) -> None:
        """Take what patches received, at texels (T, G, 3), W/m2; their edges are not to be seen."""
        if self._viewer is not None:
            self._indirect = self._first.smoothed(self._texels, irradiance().sum(1))
            self._show()

    def gathered(self, irradiance: Float32, point: Int32) -> None:
        """Take what gather points received, (P, 3 G), for the texels (T,) that each stands for, -1: none."""
        if self._viewer is not None:
            found = irradiance[point].reshape(len(point), -1, 3).sum(1)
            self._indirect = self._with_hidden(found, self._indirect)
            self._show()

    def _with_hidden(self, found: Float32, before: Float32) -> Float32:
        """What was found (T, 3), and at texels inside solids, where nothing is found, what was shown before."""
        hidden = np.flatnonzero(~self._texels.valid)
        found[hidden] = before[hidden]
        return found

    def _show(self) -> None:
        assert self._viewer is not None
        count = len(self._pixel)
        radiance = self._direct[:count] + self._indirect[:count]
        radiance *= self._reflectance[:count]
        radiance *= np.float32(1 / np.pi)
        radiance += self._emission[:count]
        pages = np.zeros(self._shape, np.float32)
        pages.reshape(-1, 3)[self._pixel] = radiance
        self._viewer.show(replace(self._view, images=list(pages)))
