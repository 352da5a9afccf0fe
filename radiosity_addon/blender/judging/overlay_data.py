# SPDX-License-Identifier: GPL-3.0-or-later
"""What the overlays show, read from the open file and never written: surfaces in view, pages, densities.

No part of this needs a graphics card.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import bpy
import numpy as np

from ...arrays import Float32, Float64, Int32, Int64
from ...atlas.density import quantiles, surface_per_uv, texels_per_metre, world_areas
from ...atlas.islands import borders, uv_charts
from ...color.spaces import REC709
from ...reports.pictures import exposure_of, illuminance, scale_ends
from ...reports.texel_maps import INVALID, UNUSED, patch_count, unpacked
from ...scene import RGB
from ..data.names import (
    BACK_PAGE_KEY,
    BACK_UV_MAP,
    BAKE_KEY,
    PAGE_KEY,
    PLACE_KEY,
    RECIPE_KEY,
    TEXELS_KEY,
    UV_MAP,
    has_our_uv_map,
    is_baked,
    page_images,
)
from ..writing.baked_pages import mixed_light, recipe_of
from ..writing.light_mix import mixed_colors
from ..writing.originals import shows_originals

LIGHT, TEXELS, SURFACES = "light", "texels", "surfaces"
"""What an overlay needs: pages; what their texels were; nothing but a uv map."""

NEEDS = {
    "lighting": LIGHT,
    "illuminance": LIGHT,
    "density": SURFACES,
    "charts": SURFACES,
    "patches": TEXELS,
    "invalid": TEXELS,
}
"""The overlays, and what each of them needs."""

SPREAD = (0.05, 0.5, 0.95)
"""Shares of the area below the densities that a legend tells."""


@dataclass(frozen=True, eq=False)
class Shape:
    """Triangles of a mesh, in its own space, where a uv map lays them.

    Attributes:
        vertex: (F, 3) int32
        corners: (F, 3, 3) float32, m
        uv: (F, 3, 2) float32
        back_uv: the same of their backs; None where they have none of their own
    """

    vertex: Int32
    corners: Float32
    uv: Float32
    back_uv: Float32 | None = None

    @cached_property
    def ratio(self) -> Float32:
        """Surface for the whole uv square, (F, 3), m2, along the normals."""
        return surface_per_uv(self.corners, self.uv)

    @cached_property
    def _charts(self) -> tuple[Int64, Int64]:
        return uv_charts(self.vertex, self.uv)

    @property
    def chart(self) -> Int64:
        """(F,) the chart of each triangle, from 0 up."""
        return self._charts[0]

    @property
    def chart_count(self) -> int:
        """How many charts it has."""
        return int(self.chart.max(initial=-1)) + 1

    @property
    def seams(self) -> Int64:
        """(K,) edges at the borders of charts, as of `borders`."""
        return borders(self._charts[1])


def shape_of(mesh: bpy.types.Mesh, uv_map: str) -> Shape:
    """The triangles of an evaluated mesh."""
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    loops, vertex = np.empty(count * 3, np.int32), np.empty(count * 3, np.int32)
    mesh.loop_triangles.foreach_get("loops", loops)
    mesh.loop_triangles.foreach_get("vertices", vertex)
    place = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", place)

    def uv(name: str) -> Float32:
        flat = np.empty(len(mesh.loops) * 2, np.float32)
        mesh.uv_layers[name].uv.foreach_get("vector", flat)
        return flat.reshape(-1, 2)[loops].reshape(-1, 3, 2)

    back = uv(BACK_UV_MAP) if uv_map == UV_MAP and BACK_UV_MAP in mesh.uv_layers else None
    return Shape(vertex.reshape(-1, 3), place.reshape(-1, 3)[vertex].reshape(-1, 3, 3), uv(uv_map), back)


@dataclass(frozen=True, eq=False)
class Placed:
    """An object or instance in view, and where it lies.

    Attributes:
        name: of the object
        mesh: evaluated; valid until the dependency graph changes
        uv_map: that lays it on a page, or that a bake would keep
        key: the same for all that share one shape
        matrix: (4, 4), to the world
        place: its uv are scale * uv + (u, v), as (scale, u, v)
        page, back_page: index; None before a bake, or where its backs have none of their own
    """

    name: str
    mesh: bpy.types.Mesh
    uv_map: str
    key: Hashable
    matrix: Float64
    place: tuple[float, float, float] = (1.0, 0.0, 0.0)
    page: int | None = None
    back_page: int | None = None


def placed_things(depsgraph: bpy.types.Depsgraph, view: bpy.types.SpaceView3D | None = None) -> Iterator[Placed]:
    """What a view shows, as evaluated for it, that has a place on a page or a uv map that a bake would keep."""
    for item in depsgraph.object_instances:
        thing, original = item.object, item.object.original
        if not item.show_self or thing.type != "MESH" or original.mode == "EDIT":
            continue
        if view is not None and not item.is_instance and not original.visible_in_viewport_get(view):
            continue
        mesh, settings = thing.data, original.radiosity
        bent = bool(original.modifiers)
        key = ("object", original.session_uid) if bent else ("mesh", original.data.session_uid)
        matrix = np.array(item.matrix_world, np.float64)
        if PAGE_KEY in original and UV_MAP in mesh.uv_layers and has_our_uv_map(original.data):
            place = tuple(float(number) for number in original.get(PLACE_KEY, (1.0, 0.0, 0.0)))
            yield Placed(
                original.name, mesh, UV_MAP, (*key, UV_MAP), matrix, place, original[PAGE_KEY],
                original.get(BACK_PAGE_KEY),
            )  # fmt: skip
        elif settings.uv_map in mesh.uv_layers and not (settings.exclude or settings.only_casts):
            yield Placed(original.name, mesh, settings.uv_map, (*key, settings.uv_map), matrix)


@dataclass(eq=False)
class Pages:
    """The pages of a scene's bake, read when they are first asked for.

    Attributes:
        images: in order
        colors: of the light groups, where they are mixed anew
    """

    images: list[bpy.types.Image]
    colors: dict[str, RGB] = field(default_factory=dict)
    _light: dict[int, Float32] = field(default_factory=dict)

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> Pages:
        """Those of the scene; none where it is not baked."""
        own = page_images(scene[BAKE_KEY]) if is_baked(scene) else []
        return cls([image for image in own if RECIPE_KEY in image], mixed_colors(scene))

    @property
    def signature(self) -> Hashable:
        """Another one for other images, or another mix of them."""
        return tuple(image.session_uid for image in self.images), tuple(self.colors.items())

    @property
    def size(self) -> int:
        """Texels along an edge of a page."""
        return int(self.images[0].size[0]) if self.images else 0

    def light(self, page: int) -> Float32:
        """H / pi (S, S, 3) in linear Rec.709, W/(m2 sr), row 0 at v = 0.

        Raises:
            OutputError: the page's file is gone
        """
        if page not in self._light:
            image = self.images[page]
            matrix = recipe_of(image).space.to(REC709).T.astype(np.float32)
            self._light[page] = mixed_light(image, self.colors) @ matrix
        return self._light[page]

    @cached_property
    def texels(self) -> list[Int32]:
        """What each texel of each page was to the bake; none where that was not kept."""
        kept = [image.get(TEXELS_KEY) for image in self.images]
        return [] if None in kept else [unpacked(data) for data in kept]

    @cached_property
    def lux(self) -> list[Float32]:
        """Illuminance (K,) of the texels in use, of each page."""
        every = [illuminance(self.light(page), REC709) for page in range(len(self.images))]
        if not self.texels:
            return [lux.ravel() for lux in every]
        return [lux[numbers != UNUSED] for lux, numbers in zip(every, self.texels, strict=True)]

    @cached_property
    def ends(self) -> tuple[float, float]:
        """Ends of a scale for all pages, lux."""
        return scale_ends(self.lux)

    @cached_property
    def mean_lux(self) -> float:
        """Mean illuminance of the texels in use."""
        total = sum(float(lux.sum(dtype=np.float64)) for lux in self.lux)
        return total / max(sum(len(lux) for lux in self.lux), 1)

    @cached_property
    def gain(self) -> float:
        """What brings the light to where a picture of it looks right."""
        return exposure_of([self.light(page) for page in range(len(self.images))], REC709)

    @cached_property
    def counts(self) -> tuple[int, int, int]:
        """Patches, texels in use, and invalid ones among them."""
        used = sum(int(np.count_nonzero(numbers != UNUSED)) for numbers in self.texels)
        invalid = sum(int(np.count_nonzero(numbers == INVALID)) for numbers in self.texels)
        return patch_count(self.texels), used, invalid


@dataclass(frozen=True)
class Density:
    """How dense the texels of all that is in view are, texels per metre; before a bake that fills pages 1 is the mean.

    Attributes:
        spread: below which 5 %, half and 95 % of the area lie
        target: the wanted one
        known: these are texels per metre
    """

    spread: tuple[float, ...]
    target: float
    known: bool


def edge_texels(thing: Placed, shape: Shape, size: int, density: float | None) -> float:
    """Texels along an edge of a thing's uv square.

    Before a bake this is what the bake will make of it: it lays a map that is kept as a whole, so that its mean density
    is the wanted one.

    Args:
        size: texels along an edge of a page
        density: the wanted one, texels/m; None where pages are filled: then the mean stands for 1
    """
    if thing.page is not None:
        return size * thing.place[0]
    matrix = thing.matrix[:3, :3]
    area = world_areas(shape.corners, matrix)
    covered = float((area * texels_per_metre(shape.ratio, matrix, 1.0).astype(np.float64) ** 2).sum())
    return (density or 1.0) * float(np.sqrt(area.sum() / covered)) if covered > 0 else 0.0


def density_of(
    things: Sequence[tuple[Placed, Shape]], size: int, wanted: float | None, target: float | None
) -> Density:
    """Densities over all things.

    Args:
        size: texels along an edge of a page
        wanted: by the scene's settings; None where pages are filled
        target: by the overlay's settings; None takes the wanted density, or the median where there is none
    """
    values, areas = [np.zeros(0, np.float32)], [np.zeros(0)]
    for thing, shape in things:
        matrix = thing.matrix[:3, :3]
        values.append(texels_per_metre(shape.ratio, matrix, edge_texels(thing, shape, size, wanted)))
        areas.append(world_areas(shape.corners, matrix))
    spread = quantiles(np.concatenate(values), np.concatenate(areas), SPREAD)
    known = wanted is not None or any(thing.page is not None for thing, _ in things)
    return Density(spread, target or wanted or spread[1] or 1.0, known)


def missing(scene: bpy.types.Scene, overlay: str) -> str:
    """Why the scene has nothing to show in an overlay; empty if it has."""
    if is_baked(scene) and shows_originals(scene):
        return "Show Baked first: the original is in view"
    images = Pages.of(scene).images
    need = NEEDS[overlay]
    if need == SURFACES:
        kept = any(thing.type == "MESH" and thing.radiosity.uv_map in thing.data.uv_layers for thing in scene.objects)
        return "" if images or kept else "Bake first, or give an object a UV Map to keep"
    if not images:
        return "Bake first: there is no light yet"
    if need == TEXELS and not all(TEXELS_KEY in image for image in images):
        return "Bake again: this bake did not keep it"
    return ""
