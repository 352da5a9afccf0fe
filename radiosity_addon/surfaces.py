# SPDX-License-Identifier: GPL-3.0-or-later
"""All meshes of a scene as one soup of triangles, with what the kernels ask of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import Bools, Float32, Float64, Int32, Int64
from .scene import Scene

OFFSET_SHARE = 2e-6
"""Ray origins are lifted by this share of the scene's radius; below 1e-6 Embree meets the surface itself."""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """F triangles, meshes one after the other.

    Attributes:
        corners: (F, 3, 3) float32, m, relative to `origin`
        normal: (F, 3) float32, unit geometric normals
        corner_normals: (F, 3, 3) float32, unit shading normals
        area: (F,) float64, m2
        mesh: (F,) int32, index into Scene.meshes
        material: (F,) int32, index into Scene.materials
        first: (M + 1,) int64, where each mesh's triangles begin
        component: (F,) int32, connected part of a mesh, counted through all meshes
        closed: (F,) bool, every edge of the component is shared by exactly two triangles
        origin: (3,) float64, m, what was subtracted from world space
        radius: half the diagonal of the bounding box, m
    """

    corners: Float32
    normal: Float32
    corner_normals: Float32
    area: Float64
    mesh: Int32
    material: Int32
    first: Int64
    component: Int32
    closed: Bools
    origin: Float64
    radius: float

    @property
    def count(self) -> int:
        return len(self.area)

    @property
    def offset(self) -> float:
        """How far ray origins are lifted off a surface, m."""
        return OFFSET_SHARE * self.radius


def flatten(scene: Scene) -> Surfaces:
    """The scene's triangles, recentred so that float32 serves far from the world's origin."""
    first = np.concatenate([[0], np.cumsum([len(mesh.triangles) for mesh in scene.meshes])]).astype(np.int64)
    used = [mesh.vertices[mesh.triangles] for mesh in scene.meshes if len(mesh.triangles)]
    corners = np.concatenate(used) if used else np.zeros((0, 3, 3))
    flat = corners.reshape(-1, 3)
    low, high = (flat.min(0), flat.max(0)) if len(flat) else (np.zeros(3), np.ones(3))
    origin = (low + high) / 2
    corners = corners - origin
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    normal = cross / np.where(length > 0, length, 1)[:, None]
    component, closed = _components(scene)
    return Surfaces(
        corners=corners.astype(np.float32),
        normal=normal.astype(np.float32),
        corner_normals=_joined([mesh.corner_normals for mesh in scene.meshes], (0, 3, 3), np.float32),
        area=length / 2,
        mesh=np.repeat(np.arange(len(scene.meshes), dtype=np.int32), np.diff(first)),
        material=_joined([mesh.material for mesh in scene.meshes], (0,), np.int32),
        first=first,
        component=component,
        closed=closed,
        origin=origin,
        radius=float(np.linalg.norm(high - low) / 2),
    )


def _joined(parts: list, empty: tuple[int, ...], dtype: type) -> np.ndarray:  # type: ignore[type-arg]
    return np.concatenate(parts).astype(dtype) if parts else np.zeros(empty, dtype)


def _components(scene: Scene) -> tuple[Int32, Bools]:
    """Connected part of each triangle, and whether that part is closed. Vertices at one place count as one."""
    parts: list[Int32] = []
    closed: list[Bools] = []
    base = 0
    for mesh in scene.meshes:
        if not len(mesh.triangles):
            continue
        _, welded = np.unique(mesh.vertices, axis=0, return_inverse=True)
        triangles = welded.reshape(-1)[mesh.triangles].astype(np.int64)
        label = np.arange(int(triangles.max()) + 1)
        while True:  # smallest vertex index of the part, by pointer jumping; rounds grow with its logarithm
            low = label[triangles].min(axis=1)
            new = label.copy()
            np.minimum.at(new, triangles.reshape(-1), np.repeat(low, 3))
            new = np.minimum(new, new[new])
            if np.array_equal(new, label):
                break
            label = new
        _, part = np.unique(label[triangles[:, 0]], return_inverse=True)
        part = part.reshape(-1)
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        _, edge, shared = np.unique(edges @ [len(label), 1], return_inverse=True, return_counts=True)
        open_edge = (shared != 2)[edge.reshape(-1)].reshape(-1, 3).any(axis=1)
        open_part = np.bincount(part, weights=open_edge) > 0
        parts.append((part + base).astype(np.int32))
        closed.append(~open_part[part])
        base += int(part.max()) + 1
    if not parts:
        return np.zeros(0, np.int32), np.zeros(0, bool)
    return np.concatenate(parts), np.concatenate(closed)
