# SPDX-License-Identifier: GPL-3.0-or-later
"""Lays the surfaces of meshes flat: charts in metres, each in a plane of its own."""

from __future__ import annotations

from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from ..arrays import Bools, Float64, Int64
from ..scene import Mesh
from .charts import Faces, measure, signed_area, tidy
from .islands import islands, rough_share, welded
from .kept_uv import kept_uv
from .xatlas_process import Cut, Job, cut_into_charts

LARGE = 3000
"""Triangles of a connected surface from which on its charts are limited: xatlas' time grows with their square."""

CHART_WORK = 2e7
"""Triangles of a surface times triangles of a chart: about 1.5 s of xatlas' time on a rough surface."""

SMALLEST_LIMIT = 400
"""Charts are never limited to fewer triangles than this."""

ROUGH_COUNT = 100_000
"""Triangles of a connected rough surface from which on xatlas is too slow."""

ROUGH_COSINE = 0.87
ROUGH_SHARE = 0.3
"""A surface is rough if at this share of its edges it turns by more than 30 degrees."""

PLAIN_CHART = 500
"""Triangles of a chart of the plain unwrap."""

BATCH = 20_000
"""Triangles that are tidied at once."""

BOXY = 0.95
"""A chart that covers this share of its box needs no other direction tried."""

ANGLES = 24
"""Directions tried for the narrowest box around a chart, besides that of its longest edge."""


YIELD_SECONDS = 0.02

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Flat:
    """A mesh laid flat.

    Attributes:
        uv: (F, 3, 2) float64, m
        chart: (F,) int64, from 0; without `rigid` each chart lies in a plane of its own
        rigid: the charts keep their places to one another
    """

    uv: Float64
    chart: Int64
    rigid: bool


@dataclass(frozen=True, eq=False)
class _Surface:
    """What is known of a mesh: corners (F, 3, 3) about its centre, m, area (F,), m2, and solid (F,) bool."""

    corners: Float64
    area: Float64
    solid: Bools


def flatten_meshes(meshes: list[Mesh]) -> Generator[float, None, tuple[list[Flat | None], tuple[str, ...]]]:
    """Lays meshes of finite positions flat and returns what went unusually; None for a mesh without any area.

    Raises:
        UvMapError: a map that can't be kept
        BakeError: xatlas can't be loaded
    """
    given, meshes = meshes, []
    for mesh in given:
        meshes.append(mesh.laid_flat())
        yield 0.0
    surfaces = [_surface(mesh) for mesh in meshes]
    warnings: list[str] = []
    result: list[Flat | None] = [None] * len(meshes)
    jobs: list[Job] = []
    job_of: list[tuple[int, Int64]] = []
    plain: list[tuple[int, Int64]] = []
    cut: list[int] = []
    for which, (mesh, surface) in enumerate(zip(meshes, surfaces, strict=True)):
        if not surface.solid.any():
            warnings.append(f"{mesh.name}: all its faces are degenerate, it gets no lightmap")
        elif mesh.uv is not None and mesh.chart is not None:
            cut.append(which)
        elif mesh.uv is not None:
            uv, chart = yield from _meanwhile(partial(kept_uv, mesh, surface.area, surface.solid), 0.0)
            result[which] = Flat(uv, chart, rigid=True)
        else:
            cut.append(which)
            for job, triangles, rough in (yield from _meanwhile(partial(_jobs, mesh, surface), 0.0)):
                if rough:
                    warnings.append(f"{mesh.name}: {len(triangles)} rough faces, unwrapped plainly")
                    plain.append((which, triangles))
                else:
                    jobs.append(job)
                    job_of.append((which, triangles))
        yield 0.0
    cuts: list[Cut | None] = []
    if jobs:
        cuts = yield from scaled(cut_into_charts(jobs), 0.0, 0.8)

    raw = {which: _RawCharts.empty(len(meshes[which].triangles)) for which in cut}
    for which in cut:
        laid, pieces = meshes[which].uv, meshes[which].chart
        if laid is not None and pieces is not None:
            raw[which].add(np.arange(len(pieces)), laid.astype(np.float64), pieces.astype(np.int64))
    for (which, triangles), found in zip(job_of, cuts, strict=True):
        if found is None:
            warnings.append(f"{meshes[which].name}: xatlas did not finish, {len(triangles)} faces unwrapped plainly")
            plain.append((which, triangles))
        else:
            raw[which].add(triangles, found[0].astype(np.float64), found[1].astype(np.int64))
    for which, triangles in plain:
        raw[which].add(triangles, *_plain(meshes[which], surfaces[which], triangles))
        yield 0.8
    done = 0
    for batch in _batches(cut, [len(mesh.triangles) for mesh in meshes]):
        share = 0.8 + 0.2 * done / len(cut)
        for which, flat in (yield from _meanwhile(partial(_tidied, batch, meshes, surfaces, raw), share)):
            result[which] = flat
        done += len(batch)
        yield 0.8 + 0.2 * done / len(cut)
    return result, tuple(warnings)


def _meanwhile(work: Callable[[], T], share: float) -> Generator[float, None, T]:
    """Does some work in a thread and yields `share` until it is done: a large mesh takes seconds of NumPy."""
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(work)
        while True:
            done, _ = wait([future], YIELD_SECONDS)
            if done:
                return future.result()
            yield share


def scaled(steps: Generator[object, None, T], low: float, high: float) -> Generator[float, None, T]:
    """Runs steps that yield a share done, or nothing, and yields the share of the whole."""
    try:
        while True:
            share = next(steps)
            yield low + (high - low) * share if isinstance(share, float) else low
    except StopIteration as stop:
        result: T = stop.value
        return result
    finally:
        steps.close()


@dataclass
class _RawCharts:
    """uv (F, 3, 2) and chart (F,), -1: none, of a mesh as they come in job by job; `count` charts so far."""

    uv: Float64
    chart: Int64
    count: int = 0

    @classmethod
    def empty(cls, triangles: int) -> _RawCharts:
        return cls(np.zeros((triangles, 3, 2)), np.full(triangles, -1, np.int64))

    def add(self, triangles: Int64, uv: Float64, chart: Int64) -> None:
        self.uv[triangles] = uv
        self.chart[triangles] = np.where(chart >= 0, chart + self.count, -1)
        self.count += int(chart.max(initial=-1)) + 1


def _surface(mesh: Mesh) -> _Surface:
    corners = mesh.vertices[mesh.triangles].astype(np.float64)
    flat = corners.reshape(-1, 3)
    low, high = flat.min(axis=0), flat.max(axis=0)
    corners = corners - (low + high) / 2
    area, solid = measure(corners, np.full(len(corners), np.linalg.norm(high - low) / 2))
    return _Surface(corners, area, solid)


def _jobs(mesh: Mesh, surface: _Surface) -> list[tuple[Job, Int64, bool]]:
    """Parts of a mesh for xatlas, their triangles, and whether they are too rough for it.

    Every large connected part is one; the small ones go together.
    """
    triangles = np.flatnonzero(surface.solid)
    vertex = mesh.triangles[triangles].astype(np.int64)
    if len(triangles) <= LARGE:
        return [(Job(surface.corners[triangles], vertex), triangles, False)]
    vertex = welded(mesh.vertices)[vertex]
    part = islands(vertex)
    counts = np.bincount(part)
    jobs = []
    for large in np.flatnonzero(counts > LARGE):
        inside = part == large
        own, own_vertex = triangles[inside], vertex[inside]
        limit = float(np.clip(CHART_WORK / len(own), SMALLEST_LIMIT, LARGE)) / len(own) * float(surface.area[own].sum())
        rough = len(own) > ROUGH_COUNT and rough_share(own_vertex, _normals(surface.corners[own]), ROUGH_COSINE)
        jobs.append((Job(surface.corners[own], own_vertex, limit), own, rough > ROUGH_SHARE))
    small = counts[part] <= LARGE
    if small.any():
        jobs.append((Job(surface.corners[triangles[small]], vertex[small]), triangles[small], False))
    return jobs


def _normals(corners: Float64) -> Float64:
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(cross / np.maximum(np.linalg.norm(cross, axis=1), 1e-300)[:, None])


def _plain(mesh: Mesh, surface: _Surface, triangles: Int64) -> tuple[Float64, Int64]:
    """Charts without xatlas: faces of a cell of space that look along the same axis, seen along that axis."""
    corners = surface.corners[triangles]
    _, polygon = np.unique(mesh.polygon[triangles], return_inverse=True)
    polygon = polygon.reshape(-1)
    normal = np.zeros((int(polygon.max()) + 1, 3))
    np.add.at(normal, polygon, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    axis = np.abs(normal).argmax(axis=1)
    negative = np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] < 0
    place = np.zeros((len(normal), 3))
    place[polygon] = corners[:, 0]
    edge = np.sqrt(PLAIN_CHART * surface.area[triangles].sum() / len(triangles))
    cell = np.floor(place / edge).astype(np.int64)
    _, group = np.unique(np.column_stack([cell, axis, negative]), axis=0, return_inverse=True)
    group = group.reshape(-1)[polygon]
    vertex = welded(mesh.vertices)[mesh.triangles[triangles]]
    chart = islands(vertex * (int(group.max()) + 1) + group[:, None])
    u, v = (axis + 1) % 3, (axis + 2) % 3
    uv = np.stack([np.take_along_axis(corners, way[polygon][:, None, None], axis=2)[..., 0] for way in (u, v)], axis=2)
    uv[negative[polygon], :, 0] *= -1
    return uv, chart


def _batches(which: list[int], triangles: list[int]) -> list[list[int]]:
    batches: list[list[int]] = []
    size = BATCH
    for index in which:
        if size + triangles[index] > BATCH:
            batches.append([])
            size = 0
        batches[-1].append(index)
        size += triangles[index]
    return batches


def _tidied(
    batch: list[int], meshes: list[Mesh], surfaces: list[_Surface], raw: dict[int, _RawCharts]
) -> list[tuple[int, Flat]]:
    """The meshes of a batch with their charts tidied and turned into narrow boxes."""
    counts = np.array([len(meshes[which].triangles) for which in batch])
    owner = np.repeat(np.arange(len(batch)), counts)
    polygon = _numbered(owner, np.concatenate([meshes[which].polygon for which in batch]).astype(np.int64))
    corner = np.concatenate([meshes[which].corner for which in batch]).astype(np.int64).reshape(-1)
    loop = _numbered(np.repeat(polygon, 3), corner)
    loops = int(loop.max()) + 1
    position, vertex, loop_polygon = np.zeros((loops, 3)), np.zeros(loops, np.int64), np.zeros(loops, np.int64)
    position[loop] = np.concatenate([surfaces[which].corners for which in batch]).reshape(-1, 3)
    base = np.cumsum([0] + [len(meshes[which].vertices) for which in batch])[:-1]
    vertices = [meshes[which].triangles + first for which, first in zip(batch, base, strict=True)]
    vertex[loop] = np.concatenate(vertices).reshape(-1)
    loop_polygon[loop] = np.repeat(polygon, 3)
    faces = Faces(
        position=position,
        vertex=vertex,
        loop=loop.reshape(-1, 3),
        polygon=polygon,
        polygons=int(polygon.max()) + 1,
        loop_polygon=loop_polygon,
        area=np.concatenate([surfaces[which].area for which in batch]),
        solid=np.concatenate([surfaces[which].solid for which in batch]),
    )
    charts_before = np.cumsum([0] + [raw[which].count for which in batch])[:-1]
    chart = np.concatenate([raw[which].chart for which in batch])
    chart = np.where(chart >= 0, chart + charts_before[owner], -1)
    charts = tidy(faces, np.concatenate([raw[which].uv for which in batch]), chart)
    uv, chart = charts.uv[faces.loop], charts.chart[polygon]
    flats = []
    for number, which in enumerate(batch):
        own = owner == number
        flats.append((which, _aligned(uv[own], chart[own])))
    return flats


def _numbered(major: Int64, minor: Int64) -> Int64:
    """Pairs numbered from 0 in their sorted order."""
    minor = minor - minor.min(initial=0)
    _, number = np.unique(major * (int(minor.max(initial=0)) + 1) + minor, return_inverse=True)
    return np.asarray(number.reshape(-1))


def _aligned(uv: Float64, chart: Int64) -> Flat:
    """Charts (F,) turned so that the box around each is narrow; faces without a place join the first chart."""
    lost = (chart < 0) | ~np.isfinite(uv).all(axis=(1, 2))
    spare = int(np.flatnonzero(~lost)[0])
    uv, chart = uv.copy(), np.where(lost, chart[spare], chart)
    uv[lost] = uv[spare].mean(axis=0)
    _, chart = np.unique(chart, return_inverse=True)
    chart = chart.reshape(-1)
    angle = _narrowest(uv, chart)
    cosine, sine = np.cos(angle)[chart][:, None], np.sin(angle)[chart][:, None]
    x, y = uv[..., 0], uv[..., 1]
    return Flat(np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=2), chart, rigid=False)


def _narrowest(uv: Float64, chart: Int64) -> Float64:
    """Angle of each chart by which it must be turned for the box around it to be small."""
    order = np.argsort(chart, kind="stable")
    points, index = uv[order], chart[order]
    first = np.searchsorted(index, np.arange(int(chart.max()) + 1))
    edges = (np.roll(points, -1, axis=1) - points).reshape(-1, 2)
    by_length = np.lexsort(((edges**2).sum(axis=1), np.repeat(index, 3)))
    longest = edges[by_length[np.append(first[1:], len(order)) * 3 - 1]]
    angle = -np.arctan2(longest[:, 1], longest[:, 0])
    area = _box(points, first, angle)
    round_ones = np.add.reduceat(np.abs(signed_area(points)), first) < BOXY * area
    inside = round_ones[index]
    if not inside.any():
        return np.asarray(angle)
    points, rank = points[inside], np.cumsum(round_ones) - 1
    first = np.searchsorted(rank[index[inside]], np.arange(int(round_ones.sum())))
    best_angle, best_area = angle[round_ones], 0.99 * area[round_ones]  # the edge's direction unless another is better
    for direction in np.arange(ANGLES) * (np.pi / 2 / ANGLES):
        area = _box(points, first, np.full(len(first), direction))
        better = area < best_area
        best_angle, best_area = np.where(better, direction, best_angle), np.where(better, area, best_area)
    angle[round_ones] = best_angle
    return np.asarray(angle)


def _box(points: Float64, first: Int64, angle: Float64) -> Float64:
    """Area of the box around each chart turned by its angle."""
    count = 3 * np.diff(np.append(first, len(points)))
    cosine, sine = np.repeat(np.cos(angle), count), np.repeat(np.sin(angle), count)
    x, y = points.reshape(-1, 2).T
    turned = (cosine * x - sine * y, sine * x + cosine * y)
    wide, high = (np.maximum.reduceat(w, 3 * first) - np.minimum.reduceat(w, 3 * first) for w in turned)
    return np.asarray(wide * high)
