# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps of the core's records, and receivers around them."""

from __future__ import annotations

import math

import numpy as np

from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.lighting.lamp_samples import cosine_above, lattice, rows_of
from radiosity_addon.lighting.lamps import Lamp
from radiosity_addon.lighting.lights import Lamps, lamps_of
from radiosity_addon.scene import AreaLight, Light, Material, Mesh, Scene
from tests.shapes import mesh_of, quad

WHITE = (1.0, 1.0, 1.0)


GREY = Material("Grey")


PANEL = AreaLight("panel", WHITE, (0, 0, 1), (1, 0, 0), (0, 0.7, 0), (0, 0, -1))


def unit(vectors: np.ndarray) -> np.ndarray:
    return (vectors / np.linalg.norm(vectors, axis=1)[:, None]).astype(np.float32)


def receivers(count: int = 1500) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on a floor with geometric and, bent away from them, shading normals."""
    rng = np.random.default_rng(7)
    points = rng.uniform(-2, 2, (count, 3)).astype(np.float32)
    points[:, 2] = 0
    geometric = unit(0.3 * rng.normal(size=(count, 3)) + [0, 0, 1])
    return points, unit(geometric + 0.4 * rng.normal(size=(count, 3))), geometric


def lamp_of(*lights: Light, meshes: tuple[Mesh, ...] = (), materials: tuple[Material, ...] = (GREY,)) -> Lamps:
    meshes = meshes or (mesh_of("floor", [quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))], [0]),)
    scene = Scene(meshes, materials, lights)
    surfaces = flatten(scene)
    return lamps_of(scene.moved(-surfaces.origin), surfaces)


def by_samples(lamp: Lamp, points: np.ndarray, normals: list[np.ndarray], count: int) -> np.ndarray:
    """The mean over the lamp's samples of weight times cosine."""
    p, rows = rows_of(points), [rows_of(normal) for normal in normals]
    total = np.zeros(len(points))
    for u, v in (lattice(count) + 0.5 / count) % 1:
        way, weight = lamp.aim(p, np.full(len(points), u, np.float32), np.full(len(points), v, np.float32))
        total += weight * cosine_above(way, rows)
    return total / count


def ball(radius: float, rings: int, outward: bool = True) -> Mesh:
    """A closed sphere of triangles with shared vertices."""
    tilt, turn = np.linspace(0, math.pi, rings + 1)[1:-1], np.linspace(0, 2 * math.pi, 2 * rings, endpoint=False)
    t, p = np.meshgrid(tilt, turn, indexing="ij")
    grid = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=2).reshape(-1, 3)
    vertices = radius * np.concatenate([[[0, 0, 1]], grid, [[0, 0, -1]]])
    around = 2 * rings
    k, n = np.arange(around), (np.arange(around) + 1) % around
    last = len(vertices) - 1
    triangles = [np.stack([0 * k, 1 + k, 1 + n], 1), np.stack([0 * k + last, last - around + n, last - around + k], 1)]
    for ring in range(rings - 2):
        a, b = 1 + ring * around, 1 + (ring + 1) * around
        triangles += [np.stack([a + k, b + k, b + n], 1), np.stack([a + k, b + n, a + n], 1)]
    faces = np.concatenate(triangles).astype(np.int32)
    faces = faces if outward else faces[:, ::-1].copy()
    corners = vertices[faces]
    normals = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    count = len(faces)
    numbers = np.arange(count, dtype=np.int32)
    zeros = np.zeros(count, np.int32)
    return Mesh("ball", vertices, faces, np.repeat(normals[:, None], 3, axis=1), zeros, numbers, faces.copy())
