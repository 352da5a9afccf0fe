# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes and hand-laid atlases for tests of the core."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from radiosity_addon.atlas.unwrap import Atlas
from radiosity_addon.scene import AreaLight, Material, Mesh, Scene


def quad(corner, edge_u, edge_v):
    """Four corners, counter-clockwise about edge_u x edge_v."""
    corner, edge_u, edge_v = (np.array(part, float) for part in (corner, edge_u, edge_v))
    return np.array([corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v])


def mesh_of(name, quads, materials, **options):
    """A mesh of separate quads, each with its material."""
    quads = np.asarray(quads, float)
    count = len(quads)
    corner = np.array([[0, 1, 2], [0, 2, 3]])
    triangles = (corner[None] + 4 * np.arange(count)[:, None, None]).reshape(-1, 3).astype(np.int32)
    vertices = quads.reshape(-1, 3)
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return Mesh(
        name,
        vertices,
        triangles,
        np.repeat(normal[:, None], 3, axis=1).astype(np.float32),
        np.repeat(np.asarray(materials, np.int32), 2),
        np.repeat(np.arange(count, dtype=np.int32), 2),
        triangles.copy(),
        **options,
    )


def sheet(name, radius, arc, columns=96, length=1.0, **options):
    """A smooth-shaded sheet of a cylinder about y, bent by `arc` radians; of none: a plane `radius` metres wide."""
    at = np.linspace(0, 1, columns + 1)
    normal = np.stack([np.sin(at * arc), np.zeros_like(at), np.cos(at * arc)], axis=1)
    rim = radius * (normal - [0, 0, 1] if arc else at[:, None] * [1, 0, 0])
    vertices = np.concatenate([rim, rim + np.array([0, length, 0])])
    step = np.arange(columns)
    quads = np.stack([step, step + 1, step + columns + 2, step + columns + 1], axis=1)
    triangles = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3).astype(np.int32)
    corner = (4 * step[:, None, None] + [[0, 1, 2], [0, 2, 3]]).reshape(-1, 3).astype(np.int32)
    normals = np.tile(normal, (2, 1)).astype(np.float32)[triangles]
    polygon = np.repeat(step, 2).astype(np.int32)
    return Mesh(name, vertices, triangles, normals, np.zeros_like(polygon), polygon, corner, **options)


def box(name, low, high, materials=0, inward=False, **options):
    """A closed box of six quads, normals outward unless `inward`."""
    (x, y, z), (dx, dy, dz) = low, np.subtract(high, low)
    quads = [
        quad((x, y, z), (0, dy, 0), (dx, 0, 0)),
        quad((x, y, z + dz), (dx, 0, 0), (0, dy, 0)),
        quad((x, y, z), (dx, 0, 0), (0, 0, dz)),
        quad((x, y + dy, z), (0, 0, dz), (dx, 0, 0)),
        quad((x, y, z), (0, 0, dz), (0, dy, 0)),
        quad((x + dx, y, z), (0, dy, 0), (0, 0, dz)),
    ]
    if inward:
        quads = [part[::-1] for part in quads]
    return mesh_of(name, quads, np.broadcast_to(materials, 6), **options)


def sphere(name, radius=1.0, segments=32, rings=16, inward=False, **options):
    """A smooth sphere of quads, joined along the poles by thin triangles' worth of quads left out."""
    turn = np.linspace(0, 2 * np.pi, segments + 1)
    tilt = np.linspace(0.02, np.pi - 0.02, rings + 1)
    t, p = np.meshgrid(tilt, turn, indexing="ij")
    points = radius * np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=2)
    quads = np.stack([points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    if inward:
        quads = quads[:, ::-1]
    mesh = mesh_of(name, quads, np.zeros(len(quads)), **options)
    normals = mesh.vertices[mesh.triangles] / radius * (-1 if inward else 1)
    return Mesh(**{**vars(mesh), "corner_normals": normals.astype(np.float32)})


def folded_sheet(x, height, size=96):
    """A scene of strips 4 m long between lines at `x`, shaded as if level, and an atlas: one chart, flat along x."""
    strips = [
        quad((a, 0, low), (b - a, 0, high - low), (0, 4, 0))
        for (a, b), (low, high) in zip(pairwise(x), pairwise(height), strict=True)
    ]
    mesh = mesh_of("Sheet", strips, np.zeros(len(strips)))
    level = np.broadcast_to(np.float32([0, 0, 1]), (len(mesh.triangles), 3, 3))
    scene = Scene((replace(mesh, corner_normals=level),), (Material("Grey"),))
    flat = 0.05 + 0.9 * (mesh.vertices[mesh.triangles][:, :, :2] / max(*x, 4)).astype(np.float32)
    return scene, replace(cell_atlas(scene, size), uv=[flat], chart=[np.zeros(len(mesh.triangles), np.int32)])


def cell_atlas(scene, size, margin=3):
    """Each quad of every mesh in a square cell of one page."""
    quads = [len(mesh.triangles) // 2 for mesh in scene.meshes]
    across = int(np.ceil(np.sqrt(sum(quads))))
    width = size // across
    uv, chart, number = [], [], 0
    for count in quads:
        cells = number + np.arange(count)
        low = np.stack([cells % across, cells // across], axis=1)[:, None] * width + margin
        square = (low + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (width - 2 * margin)) / size
        uv.append(square[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 2).astype(np.float32))
        chart.append(np.repeat(cells, 2).astype(np.int32))
        number += count
    meshes = len(scene.meshes)
    return Atlas(
        size=size,
        page=np.zeros(meshes, np.int32),
        page_count=1,
        hidden_page_count=0,
        uv=tuple(uv),
        chart=tuple(chart),
        density=np.ones(meshes),
        fill=np.ones(1),
        warnings=(),
    )


def furnished_room():
    """A room of 5.5 m with coloured side walls, two blocks on its floor and a lamp below its ceiling."""
    white, red, green = (
        Material("White", (0.75,) * 3),
        Material("Red", (0.6, 0.06, 0.05)),
        Material("Green", (0.1, 0.4, 0.1)),
    )
    room = box("Room", (0, 0, 0), (5.5, 5.5, 5.5), [0, 0, 0, 0, 1, 2], inward=True)
    low = box("Low block", (0.8, 1, 0), (2.4, 2.6, 1.65))
    high = box("High block", (3, 2.8, 0), (4.6, 4.4, 3.3))
    lamp = AreaLight("Lamp", (15, 12, 8), (2.75, 2.75, 5.48), (1.3, 0, 0), (0, 1.05, 0), (0, 0, -1))
    return Scene((room, low, high), (white, red, green), (lamp,))
