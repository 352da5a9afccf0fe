# SPDX-License-Identifier: GPL-3.0-or-later
"""What a ray meets: a bounding volume hierarchy over all triangles (Embree, through embreex)."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np

from .arrays import Bools, Float32, Int32
from .errors import BakeError

SEGMENT_END = np.float32(1.0 - 1e-4)
"""Shadow segments stop short of their target by this share, so that a target on a surface is not its own blocker."""


@dataclass(frozen=True)
class Hits:
    """First hits of R rays.

    Attributes:
        triangle: (R,) int32, -1 where the ray leaves the scene
        u, v: (R,) float32, barycentrics of corners 1 and 2
        distance: (R,) float32, in lengths of the ray's direction; huge where it leaves
        front: (R,) bool, the geometric front was hit
    """

    triangle: Int32
    u: Float32
    v: Float32
    distance: Float32
    front: Bools


class Visibility:
    """A BVH over (F, 3, 3) float32 corners. Queries are safe from several threads and release the GIL."""

    def __init__(self, corners: Float32) -> None:
        try:
            from embreex import rtcore_scene
            from embreex.mesh_construction import TriangleMesh
        except ImportError as error:
            raise BakeError(
                "embreex", f"the ray-tracing library did not load ({error})", "Install the zip made for this platform"
            ) from error
        if not np.isfinite(corners).all() or (corners.size and np.abs(corners).max() > 1e15):
            raise ValueError("corners must be finite and below 1e15 m")
        self.rays = 0
        self._lock = threading.Lock()
        self._scene = rtcore_scene.EmbreeScene(robust=True)
        self._empty = len(corners) == 0
        if not self._empty:
            vertices = np.ascontiguousarray(corners.reshape(-1, 3), np.float32)
            indices = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
            self._keep = TriangleMesh(self._scene, vertices, indices)
            self._scene.run(vertices[:1], np.ones((1, 3), np.float32))  # builds the tree here, not in a worker

    def _count(self, origins: Float32, directions: Float32) -> None:
        if origins.shape != directions.shape or origins.ndim != 2 or origins.shape[1] != 3:
            raise ValueError("origins and directions must both be (R, 3)")
        with self._lock:
            self.rays += len(origins)

    def occluded(self, origins: Float32, segments: Float32) -> Bools:
        """Whether anything lies between origins (R, 3) and origins + segments (R, 3)."""
        self._count(origins, segments)
        if self._empty or len(origins) == 0:
            return np.zeros(len(origins), bool)
        ends = np.full(len(origins), SEGMENT_END, np.float32)
        found = self._scene.run(
            np.ascontiguousarray(origins, np.float32),
            np.ascontiguousarray(segments, np.float32),
            dists=ends,
            query="OCCLUDED",
        )
        return np.asarray(found == 0)

    def escapes(self, origins: Float32, directions: Float32) -> Bools:
        """Whether rays (R, 3) leave the scene without meeting anything."""
        self._count(origins, directions)
        if self._empty or len(origins) == 0:
            return np.ones(len(origins), bool)
        found = self._scene.run(
            np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32), query="OCCLUDED"
        )
        return np.asarray(found != 0)

    def first_hit(self, origins: Float32, directions: Float32) -> Hits:
        """The nearest surface that each ray (R, 3) meets."""
        self._count(origins, directions)
        count = len(origins)
        if self._empty or count == 0:
            nothing = np.zeros(count, np.float32)
            far = np.full(count, 1e37, np.float32)
            return Hits(np.full(count, -1, np.int32), nothing, nothing, far, np.zeros(count, bool))
        directions = np.ascontiguousarray(directions, np.float32)
        found = self._scene.run(np.ascontiguousarray(origins, np.float32), directions, output=1)
        facing = np.einsum("ij,ij->i", found["Ng"], directions) < 0
        return Hits(found["primID"], found["u"], found["v"], found["tfar"], facing)
