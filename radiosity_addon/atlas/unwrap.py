# SPDX-License-Identifier: GPL-3.0-or-later
"""Gives every surface its place: charts of all meshes together on square pages."""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Float32, Float64, Int32, Int64
from ..errors import SceneError, SettingsError
from ..scene import Mesh, Scene
from ..settings import BakeSettings
from .cells import HIDDEN_SHARE, lay_cells
from .families import Family, Place, boxes, lay_blocks, layout_of, make_family, shared_shapes
from .folds import Folds
from .packing import Items, Placement, fill_page, place, scale_of_area
from .parametrize import Flat, flatten_meshes, scaled

MIPMAP_PAGE = 512
"""From this page size on charts keep the distance that the first mip level needs."""

WIDE_PADDING, PADDING = 4, 2
"""Texels between charts: two footprints of one texel, twice that for the first mip level."""

TRIES = 8
SAME_SCALE = 0.98
"""Blocks are laid anew until their gaps are at least this share of the padding."""

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
        layouts: of each Mesh.shape that several meshes share, (L, 2) float32 in 0..1, the uv of polygon corners
        places: of each mesh that takes part in one, by index: its uv are scale * layout + (u, v), as (scale, u, v)
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
    layouts: Mapping[int, Float32] = field(default_factory=dict)
    places: Mapping[int, Place] = field(default_factory=dict)


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
    meshes = Folds.of(scene.meshes, settings).finer(scene.meshes)
    shared = shared_shapes(meshes)
    led = {index for members in shared.values() for index in members[1:]}
    leaders = [i for i, mesh in enumerate(meshes) if mesh.lightmapped and len(mesh.triangles) and i not in led]
    steps = flatten_meshes([meshes[index] for index in leaders])
    flats, warnings = yield from scaled(steps, 0.0, 0.7)
    flat_of = {index: flat for index, flat in zip(leaders, flats, strict=True) if flat is not None}
    families = [
        make_family(meshes, shape, members, flat_of.pop(members[0]))
        for shape, members in shared.items()
        if members[0] in flat_of
    ]
    packs: list[_Pack] = []
    for name in sorted({meshes[index].page_group for index in [*flat_of, *(each.members[0] for each in families)]}):
        single = [index for index in flat_of if meshes[index].page_group == name]
        related = [family for family in families if meshes[family.members[0]].page_group == name]
        parts = [_items(flat_of[index], meshes[index].density) for index in single]
        packs.append((yield from scaled(_pack(meshes, single, parts, related, settings), 0.7, 0.95)))
    owners, items, pages = _all_of(packs)
    families = [family for pack in packs for family in pack.families]
    blocks = [block for pack in packs for block in pack.blocks]
    warnings += tuple(warning for pack in packs for warning in pack.warnings)

    laid = _Laid(meshes)
    layouts = [layout_of(family, meshes, block) for family, block in zip(families, blocks, strict=True)]
    member_of = {index: (number, k) for number, each in enumerate(families) for k, index in enumerate(each.members)}
    places: dict[int, Place] = {}
    fill = np.zeros(len(pages))
    for number, (objects, placement) in enumerate(pages):
        texels = placement.applied(_joined([items[which] for which in objects]))
        begin = 0
        for which in objects:
            index, end = owners[which], begin + len(items[which].points)
            spots = texels[begin:end] / settings.page_size
            assert np.abs(spots - 0.5).max() < 0.5 + 1e-4, "packed beyond the page"
            begin = end
            if index in flat_of:
                flat, covered = flat_of[index], float(items[which].area.sum())
                uv = np.empty((len(flat.chart), 3, 2), np.float32)
                uv[_item_order(flat)] = np.clip(spots, 0, 1)
                laid.put(index, number, uv, flat.chart, placement.scale * meshes[index].density)
            else:
                family, layout = families[member_of[index][0]], layouts[member_of[index][0]]
                scale, size = family.scale[member_of[index][1]], family.size[member_of[index][1]]
                covered = float(family.chart_area.sum() * scale**2)
                places[index] = layout.place(placement.scale * scale / settings.page_size, spots)
                uv, chart = layout.placed(meshes[index], places[index])
                laid.put(index, number, uv, chart, placement.scale * scale / size)
            fill[number] += covered * placement.scale**2 / settings.page_size**2
    real = laid.density[laid.density > 0]
    coarse = HIDDEN_SHARE * (float(np.median(real)) if len(real) else settings.density or 0.0)
    hidden = [index for index, mesh in enumerate(meshes) if not mesh.lightmapped and len(mesh.triangles)]
    cells = lay_cells([meshes[index] for index in hidden], coarse, settings.page_size)
    for index, cell in zip(hidden, cells, strict=True):
        laid.put(index, len(pages) + cell.page, cell.uv, cell.chart, cell.density)
    return Atlas(
        size=settings.page_size,
        page=laid.page,
        page_count=len(pages),
        hidden_page_count=max((cell.page + 1 for cell in cells), default=0),
        uv=tuple(laid.uv),
        chart=tuple(laid.chart),
        density=laid.density,
        fill=fill,
        warnings=warnings,
        layouts={family.shape: layout.uv for family, layout in zip(families, layouts, strict=True)},
        places=places,
    )


@dataclass(frozen=True, eq=False)
class _Pack:
    """A page group on its pages.

    Attributes:
        owners: indices of its meshes
        items: what was packed, one for each owner
        families: in the order in which their members own items, after all that are alone
        blocks: a family's charts, (F, 3, 2) float64, m
        pages: with indices into `items`
    """

    owners: list[int]
    items: list[Items]
    families: list[Family]
    blocks: list[Float64]
    pages: list[Packed]
    warnings: tuple[str, ...] = ()


def _pack(
    meshes: tuple[Mesh, ...], single: list[int], alone: list[Items], families: list[Family], settings: BakeSettings
) -> Generator[float, None, _Pack]:
    """A page group on pages of its own: meshes that are alone, with their items, and families."""
    owners = [*single, *(index for family in families for index in family.members)]
    size, padding = settings.page_size, WIDE_PADDING if settings.page_size >= MIPMAP_PAGE else PADDING
    if settings.density is None:
        page, blocks, warnings = yield from scaled(_one_page(alone, families, size, padding), 0.0, 1.0)
        return _Pack(owners, alone + boxes(families, blocks), families, blocks, [page], warnings)
    blocks = yield from scaled(lay_blocks(families, settings.density, size, padding), 0.0, 0.0)
    items = alone + boxes(families, blocks)
    names = [meshes[index].name for index in owners]
    pages = yield from _many_pages(items, names, settings.density, size, padding)
    return _Pack(owners, items, families, blocks, pages)


def _all_of(packs: list[_Pack]) -> tuple[list[int], list[Items], list[Packed]]:
    """Owners, items and pages of all page groups, counted through."""
    owners: list[int] = []
    items: list[Items] = []
    pages: list[Packed] = []
    for pack in packs:
        pages += [([len(items) + which for which in objects], placement) for objects, placement in pack.pages]
        owners += pack.owners
        items += pack.items
    return owners, items, pages


class _Laid:
    """Meshes put on pages one after the other; those that never are have no surface."""

    def __init__(self, meshes: tuple[Mesh, ...]) -> None:
        self.uv = [np.zeros((len(mesh.triangles), 3, 2), np.float32) for mesh in meshes]
        self.chart = [np.zeros(len(mesh.triangles), np.int32) for mesh in meshes]
        self.page = np.full(len(meshes), -1, np.int32)
        self.density = np.zeros(len(meshes))
        self.charts = 0

    def put(self, index: int, page: int, uv: Float32, chart: Int32 | Int64, density: float) -> None:
        """One mesh, its charts counted from 0."""
        self.uv[index], self.page[index], self.density[index] = uv, page, density
        self.chart[index] = (chart + self.charts).astype(np.int32)
        self.charts += int(chart.max()) + 1


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
    points, upright = (np.concatenate([getattr(part, name) for part in parts]) for name in ("points", "upright"))
    return Items(points, np.append(0, np.cumsum(counts)), upright)


def _one_page(
    alone: list[Items], families: list[Family], size: int, padding: int
) -> Generator[None, None, tuple[Packed, list[Float64], tuple[str, ...]]]:
    """Everything on one page, as dense as it goes, and the families' blocks.

    The gaps in a block are laid for texels of an expected size; that of all charts without families is its bound.
    """
    area = np.concatenate(
        [item.area for item in alone] + [np.outer(family.scale**2, family.chart_area).ravel() for family in families]
    )
    for gap in sorted({padding, PADDING}, reverse=True):
        texels = scale_of_area(area, size, gap)
        for _ in range(TRIES if texels else 0):
            blocks = yield from lay_blocks(families, texels, size, gap)
            items = alone + boxes(families, blocks)
            placement = yield from fill_page(_joined(items), size, gap)
            if placement is None:
                break
            if not families or placement.scale >= SAME_SCALE * texels:
                warning = f"{len(area)} charts on one page leave only {gap} texels between them"
                packed = list(range(len(items))), placement
                return packed, blocks, (warning,) if gap < padding else ()
            texels = placement.scale * np.sqrt(placement.scale / texels)
    cause = f"{len(area)} charts don't fit on one page of {size} texels"
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
