# SPDX-License-Identifier: GPL-3.0-or-later
"""Shapes to unwrap, and what holds for every atlas."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from radiosity_addon.atlas.unwrap import Atlas, build_atlas
from radiosity_addon.chunks import finish
from radiosity_addon.scene import Material, Mesh, Scene
from radiosity_addon.settings import BakeSettings

FINE = 4
"""Samples along a texel where pages are checked by rasterising."""


def make_mesh(name, vertices, polygons, **more):
    """A mesh whose polygons are fans from their first corner."""
    triangles, polygon, corner, base = [], [], [], 0
    for number, ring in enumerate(polygons):
        for i in range(1, len(ring) - 1):
            triangles.append((ring[0], ring[i], ring[i + 1]))
            corner.append((base, base + i, base + i + 1))
            polygon.append(number)
        base += len(ring)
    count = len(triangles)
    return Mesh(
        name=name,
        vertices=np.asarray(vertices, np.float64),
        triangles=np.array(triangles, np.int32).reshape(-1, 3),
        corner_normals=np.zeros((count, 3, 3), np.float32),
        material=np.zeros(count, np.int32),
        polygon=np.array(polygon, np.int32),
        corner=np.array(corner, np.int32).reshape(-1, 3),
        **more,
    )


def make_box(name="box", size=(1.0, 1.0, 1.0), at=(0.0, 0.0, 0.0), **more):
    vertices = np.array(list(itertools.product((-0.5, 0.5), repeat=3))) * size + at
    rings = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return make_mesh(name, vertices, rings, **more)


def rings_of(rows, columns, across, around=True):
    """Quads of a grid of rows of vertices."""
    last = across if around else across - 1
    return [
        (i * across + j, i * across + (j + 1) % across, (i + 1) * across + (j + 1) % across, (i + 1) * across + j)
        for i in range(rows - 1)
        for j in range(last)
    ]


def make_tube(name="tube", rows=40, around=12, radius=0.2):
    """A bent, twisting tube of quads that aren't flat, as a NURBS tube is evaluated."""
    t, a = np.linspace(0, 4, rows), np.linspace(0, 2 * np.pi, around, endpoint=False)
    angle = a[None, :] + 0.5 * t[:, None]
    out = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    thickness = radius * (1 + 0.3 * np.sin(3 * t))[:, None, None]
    up = np.array([0, 0, 1.0])
    centre = np.stack([np.cos(t), np.sin(t), 0.4 * t], axis=1)
    ring = np.cos(angle)[..., None] * out[:, None] + np.sin(angle)[..., None] * up
    return make_mesh(name, (centre[:, None] + thickness * ring).reshape(-1, 3), rings_of(rows, around, around))


def make_sphere(name="sphere", rows=12, radius=0.5, at=(0, 0, 0)):
    w, u = np.linspace(0.05, np.pi - 0.05, rows), np.linspace(0, 2 * np.pi, 2 * rows, endpoint=False)
    w, u = np.meshgrid(w, u, indexing="ij")
    points = radius * np.stack([np.sin(w) * np.cos(u), np.sin(w) * np.sin(u), -np.cos(w)], axis=2).reshape(-1, 3) + at
    return make_mesh(name, points, rings_of(rows, 2 * rows, 2 * rows))


def make_grid(name="grid", cells=10, height=0.0, size=1.0, **more):
    x, y = np.meshgrid(np.linspace(0, size, cells + 1), np.linspace(0, size, cells + 1))
    z = np.random.default_rng(0).random(x.shape) * height * size / cells
    points = np.stack([x, y, z], axis=2).reshape(-1, 3)
    return make_mesh(name, points, rings_of(cells + 1, cells + 1, cells + 1, around=False), **more)


def make_bevelled_box(name="bevel"):
    """A box whose edges are cut off: quads, thin quads and triangles."""
    points, index = [], {}
    for corner in itertools.product((-1, 1), repeat=3):
        for axis in range(3):
            point = np.array(corner) * 0.4
            point[axis] = corner[axis] * 0.5
            index[corner, axis] = len(points)
            points.append(point)
    points = np.array(points)
    rings = []
    for axis, sign in itertools.product(range(3), (-1, 1)):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        ring = []
        for du, dv in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            corner = [0, 0, 0]
            corner[axis], corner[u], corner[v] = sign, du, dv
            ring.append(index[tuple(corner), axis])
        rings.append(ring if sign > 0 else ring[::-1])
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for du, dv in itertools.product((-1, 1), repeat=2):
            low, high = [0, 0, 0], [0, 0, 0]
            low[axis], high[axis] = -1, 1
            low[u] = high[u] = du
            low[v] = high[v] = dv
            ring = [index[tuple(low), u], index[tuple(high), u], index[tuple(high), v], index[tuple(low), v]]
            rings.append(ring)
    for corner in itertools.product((-1, 1), repeat=3):
        rings.append([index[corner, axis] for axis in range(3)])
    outward = []
    for ring in rings:
        a, b, c = points[ring[:3]]
        outward.append(ring if np.cross(b - a, c - a) @ (a + b + c) > 0 else ring[::-1])
    return make_mesh(name, points, outward)


def atlas_of(meshes, **settings):
    return finish(build_atlas(Scene(tuple(meshes), (Material("grey"),)), BakeSettings(**settings)))


def world_area(mesh):
    p = mesh.vertices[mesh.triangles]
    return np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1) / 2


def flat_area(uv):
    a, b = np.moveaxis(uv.astype(np.float64), 1, 0)[1:] - uv[:, 0].astype(np.float64)
    return (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2


def sampled(atlas: Atlas, page: int):
    """Chart at FINE x FINE samples of each texel (-1: none) and how many samples several triangles cover."""
    size = atlas.size * FINE
    owner, doubles = np.full((size, size), -1), 0
    for mesh in np.flatnonzero(atlas.page == page):
        for uv, chart in zip(atlas.uv[mesh].astype(np.float64) * size, atlas.chart[mesh], strict=True):
            low, high = np.maximum(np.floor(uv.min(0)), 0).astype(int), np.ceil(uv.max(0)).astype(int)
            x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
            inside = np.ones(x.shape, bool)
            for p, q in zip(uv, np.roll(uv, -1, axis=0), strict=True):
                length = np.hypot(*(q - p))
                inside &= (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) > 1e-3 * length
            here = owner[low[1] : high[1], low[0] : high[0]]
            doubles += int((inside & (here >= 0)).sum())
            here[inside] = chart
    return owner, doubles


def reach_of(owner, texels):
    """Samples within `texels` of two charts, and whether a chart is that near the border."""
    radius = int(texels * FINE) - 1
    most, least = owner.copy(), np.where(owner < 0, 1 << 30, owner)
    for axis in (0, 1):
        pad = [(radius, radius) if k == axis else (0, 0) for k in (0, 1)]
        window = np.lib.stride_tricks.sliding_window_view
        most = window(np.pad(most, pad, constant_values=-1), 2 * radius + 1, axis).max(-1)
        least = window(np.pad(least, pad, constant_values=1 << 30), 2 * radius + 1, axis).min(-1)
    rim = np.ones(owner.shape, bool)
    rim[radius:-radius, radius:-radius] = False
    return int(((most >= 0) & (most != least)).sum()), bool((owner[rim] >= 0).any())


def assert_sound(atlas: Atlas, meshes, gap):
    """Everything that may be promised about any atlas."""
    for index, mesh in enumerate(meshes):
        uv, area = atlas.uv[index], world_area(mesh)
        assert uv.shape == (len(mesh.triangles), 3, 2)
        assert uv.dtype == np.float32
        assert np.isfinite(uv).all()
        assert uv.min() >= 0
        assert uv.max() <= 1
        solid = area > 1e-9 * area.max()
        flat = flat_area(uv)
        assert (flat[solid] > 0).all(), "a triangle is turned over or has no area"
        assert np.sqrt(flat.sum() / area.sum()) * atlas.size == pytest.approx(atlas.density[index], rel=0.02)
        key = np.stack([np.repeat(mesh.polygon, 3), mesh.corner.reshape(-1)], axis=1)
        _, corner = np.unique(key, axis=0, return_inverse=True)
        corner = corner.reshape(-1)
        first = np.full((corner.max() + 1, 2), np.nan, np.float32)
        first[corner] = uv.reshape(-1, 2)
        assert np.array_equal(first[corner], uv.reshape(-1, 2)), "a polygon corner has two places"
        chart = np.full(mesh.polygon.max() + 1, -1)
        chart[mesh.polygon] = atlas.chart[index]
        assert np.array_equal(chart[mesh.polygon], atlas.chart[index]), "a polygon is in two charts"
    for page in range(atlas.page_count):
        owner, doubles = sampled(atlas, page)
        assert doubles == 0, "triangles lie on one another"
        assert reach_of(owner, gap / 2) == (0, False), "charts are too near to one another or to the border"
