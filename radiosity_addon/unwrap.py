# SPDX-License-Identifier: GPL-3.0-or-later
"""Gives every surface its place: charts of all meshes together on square pages."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from .arrays import Float32, Float64, Int32, Int64
from .cells import HIDDEN_SHARE, lay_cells
from .errors import SceneError, SettingsError
from .packing import Items, Placement, fill_page, place
from .parametrize import Flat, flatten_meshes, scaled
from .scene import Mesh, Scene
from .settings import BakeSettings

MIPMAP_PAGE = 512
"""From this page size on charts keep the distance that the first mip level needs."""

WIDE_PADDING, PADDING = 4, 2
"""Texels between charts: two footprints of one texel, twice that for the first mip level."""

FILL_STEPS = 5
"""Halvings in the search for the objects that a page holds."""

SURELY_FITS = 0.2
"""Objects that need a smaller share of a page, in charts of half its edge at most, fit on one without being tried."""

Packed = tuple[list[int], Placement]
"""Objects on one page, by their index in a list, and where their items lie."""


@dataclass(frozen=True, eq=False)
class Atlas:
    """Where the meshes of a scene, in its order, lie on pages.

    The first `page_count` pages are lightmaps. `hidden_page_count` more hold the surfaces that get no lightmap: they
    take part in the light's transport with coarse texels of their own and are never written to files.

    Attributes:
        size: texels along an edge of a page
        page: (M,) int32, page of each mesh; -1: none, it has no surface
        uv: a mesh's (F, 3, 2) float32 in 0..1 of its page, v up
        chart: a mesh's (F,) int32, connected piece of the plane, counted through the whole atlas
        density: (M,) float64, texels per metre reached; 0 without a page
        fill: (page_count,) float64, share of each page that charts cover
        warnings: what did not go as usual
    """

    size: int
    page: Int32
    page_count: int
    hidden_page_count: int
    uv: tuple[Float32, ...]
    chart: tuple[Int32, ...]
    density: Float64
    fill: Float64
    warnings: tuple[str, ...]


def build_atlas(scene: Scene, settings: BakeSettings) -> Generator[float, None, Atlas]:
    """Unwraps and packs a scene. Yields the share done; closing the generator ends the child process too.

    Raises:
        SceneError: positions that aren't finite, a density multiplier that isn't positive; as UvMapError with the
            attribute `polygons`: an existing uv map that can't be kept
        SettingsError: an object is too large for a page at the wanted density, or there are too many charts for a page
        BakeError: xatlas can't be loaded
    """
    for mesh in scene.meshes:
        _check(mesh)
    meshes = [index for index, mesh in enumerate(scene.meshes) if mesh.lightmapped and len(mesh.triangles)]
    steps = flatten_meshes([scene.meshes[index] for index in meshes])
    flats, warnings = yield from scaled(steps, 0.0, 0.7)
    flat_of = {index: flat for index, flat in zip(meshes, flats, strict=True) if flat is not None}
    owners = list(flat_of)
    items = [_items(flat_of[index], scene.meshes[index].density) for index in owners]
    padding = WIDE_PADDING if settings.page_size >= MIPMAP_PAGE else PADDING
    pages: list[Packed] = []
    if settings.density is not None:
        names = [scene.meshes[index].name for index in owners]
        pages = yield from scaled(_many_pages(items, names, settings.density, settings.page_size, padding), 0.7, 0.95)
    elif items:
        page, narrower = yield from scaled(_one_page(items, settings.page_size, padding), 0.7, 0.95)
        pages, warnings = [page], warnings + narrower

    count = len(scene.meshes)
    atlas_uv = [np.zeros((len(mesh.triangles), 3, 2), np.float32) for mesh in scene.meshes]
    atlas_chart = [np.zeros(len(mesh.triangles), np.int32) for mesh in scene.meshes]
    page_of, density = np.full(count, -1, np.int32), np.zeros(count)
    fill = np.zeros(len(pages))
    charts = 0
    for number, (objects, placement) in enumerate(pages):
        together = _joined([items[which] for which in objects])
        texels = placement.applied(together)
        fill[number] = together.area.sum() * placement.scale**2 / settings.page_size**2
        begin = 0
        for which in objects:
            index = owners[which]
            flat = flat_of[index]
            end = begin + len(flat.chart)
            spots = texels[begin:end] / settings.page_size
            assert np.abs(spots - 0.5).max() < 0.5 + 1e-4, "packed beyond the page"
            atlas_uv[index][_item_order(flat)] = np.clip(spots, 0, 1)
            atlas_chart[index] = (flat.chart + charts).astype(np.int32)
            charts += int(flat.chart.max()) + 1
            begin = end
            page_of[index] = number
            density[index] = placement.scale * scene.meshes[index].density
    real = density[density > 0]
    coarse = HIDDEN_SHARE * (float(np.median(real)) if len(real) else settings.density or 0.0)
    hidden = [index for index, mesh in enumerate(scene.meshes) if not mesh.lightmapped and len(mesh.triangles)]
    cells = lay_cells([scene.meshes[index] for index in hidden], coarse, settings.page_size)
    for index, cell in zip(hidden, cells, strict=True):
        page_of[index] = len(pages) + cell.page
        atlas_uv[index], density[index] = cell.uv, cell.density
        atlas_chart[index] = cell.chart + np.int32(charts)
        charts += int(cell.chart.max()) + 1
    return Atlas(
        size=settings.page_size,
        page=page_of,
        page_count=len(pages),
        hidden_page_count=max((cell.page + 1 for cell in cells), default=0),
        uv=tuple(atlas_uv),
        chart=tuple(atlas_chart),
        density=density,
        fill=fill,
        warnings=warnings,
    )


def _check(mesh: Mesh) -> None:
    if not np.isfinite(mesh.vertices[mesh.triangles]).all():
        raise SceneError(mesh.name, "it has vertices that are not finite numbers", "Repair its mesh or modifiers")
    if not (math.isfinite(mesh.density) and mesh.density > 0):
        raise SceneError(mesh.name, f"its density multiplier is {mesh.density:g}", "Give a positive number")


def _item_order(flat: Flat) -> Int64:
    """Triangles by item: a rigid map is one item, else every chart is."""
    return np.arange(len(flat.chart)) if flat.rigid else np.argsort(flat.chart, kind="stable")


def _items(flat: Flat, multiplier: float) -> Items:
    order = _item_order(flat)
    chart = np.zeros(len(order), np.int64) if flat.rigid else flat.chart[order]
    first = np.searchsorted(chart, np.arange(int(chart.max()) + 2))
    return Items(flat.uv[order] * multiplier, first)


def _joined(parts: list[Items]) -> Items:
    counts = np.concatenate([np.diff(part.first) for part in parts])
    return Items(np.concatenate([part.points for part in parts]), np.append(0, np.cumsum(counts)))


def _one_page(items: list[Items], size: int, padding: int) -> Generator[None, None, tuple[Packed, tuple[str, ...]]]:
    """Everything on one page, as dense as it goes."""
    together = _joined(items)
    for gap in sorted({padding, PADDING}, reverse=True):
        placement = yield from fill_page(together, size, gap)
        if placement is not None:
            warning = f"{together.count} charts on one page leave only {gap} texels between them"
            return (list(range(len(items))), placement), (warning,) if gap < padding else ()
    cause = f"{together.count} charts don't fit on one page of {size} texels"
    raise SettingsError("Page size", cause, "Choose larger pages, or a density to use several")


def _many_pages(
    items: list[Items], names: list[str], density: float, size: int, padding: int
) -> Generator[float, None, list[Packed]]:
    """As many pages as the objects need at a density, texels per metre; the largest objects first."""
    area = np.array([_padded_area(item, density, padding) for item in items])
    yield from _refuse_too_large(items, names, density, size, padding, area)
    left = sorted(range(len(items)), key=lambda which: (-area[which], which))
    pages: list[Packed] = []
    while left:
        best: Packed | None = None
        low, high = 0.0, 1.0
        for step in range(FILL_STEPS + 1):
            target = high if step == 0 else (low + high) / 2
            chosen = _greedy(left, area, target * size**2)
            if best is not None and len(chosen) <= len(best[0]) and set(chosen) <= set(best[0]):
                low = target
                continue
            placement = yield from scaled(place(_joined([items[i] for i in chosen]), density, size, padding), 0, 0)
            if placement is None:
                high = target
                continue
            best, low = (chosen, placement), target
            if step == 0:
                break
        if best is None:
            placement = yield from scaled(place(items[left[0]], density, size, padding), 0, 0)
            assert placement is not None, "was tried alone before"
            best = ([left[0]], placement)
        pages.append(best)
        left = [which for which in left if which not in set(best[0])]
        yield 1 - len(left) / len(items)
    return pages


def _padded_area(item: Items, density: float, padding: int) -> float:
    """Texels that an object needs at least."""
    edges = np.sqrt(item.area) * density
    return float(((edges + padding) ** 2).sum())


def _greedy(left: list[int], area: Float64, room: float) -> list[int]:
    """The largest objects that go into the room one after the other, at least the first."""
    chosen = [left[0]]
    room -= area[left[0]]
    for which in left[1:]:
        if area[which] <= room:
            chosen.append(which)
            room -= area[which]
    return chosen


def _refuse_too_large(
    items: list[Items], names: list[str], density: float, size: int, padding: int, area: Float64
) -> Generator[float, None, None]:
    """Raises a SettingsError if an object alone doesn't fit on a page, with the largest density at which all do."""
    fits, name = density, ""
    for which, item in enumerate(items):
        if area[which] < SURELY_FITS * size**2 and item.extent.max() * density < size / 2:
            continue
        if (yield from scaled(place(item, fits, size, padding), 0, 0)) is not None:
            continue
        placement = yield from scaled(fill_page(item, size, padding), 0, 0)
        if placement is None:
            raise SettingsError(
                "Density", f"{names[which]} has more charts than a page of {size} texels holds", "Choose larger pages"
            )
        if placement.scale < fits:
            fits, name = placement.scale, names[which]
    if name:
        rounded = math.floor(fits * 100) / 100 if fits >= 1 else fits * 0.999
        raise SettingsError(
            "Density",
            f"{name} does not fit on a page of {size} texels at {density:g} texels per metre",
            f"The largest density that fits is {rounded:.4g}; or choose larger pages",
        )
