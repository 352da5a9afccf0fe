# SPDX-License-Identifier: GPL-3.0-or-later
"""All meshes of a scene as one soup of triangles, with what the kernels ask of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arrays import Bools, Float32, Float64, Int32, Int64
from ..atlas.islands import islands, welded
from ..columns import extremes
from ..scene import Scene

OFFSET_SHARE = 2e-6
"""Ray origins are lifted by this share of the scene's radius; below 1e-6 Embree meets the surface itself."""

FLAT = 1e-4
"""Corner normals this near the geometric one are it: light can't tell, and one cosine less has to be found."""

PLANES_APART = 2e-5
"""Planes this share of the scene's radius apart are two."""

TURNED = 1 << 12
"""Normals whose components, times this, round to different numbers are of two planes."""

BLOCK = 1 << 14
"""Points are interpolated in blocks of so many, whose temporaries (64 KB each) stay in cache."""

SLIT = 1e-6
"""The rim of a slit strays from a line by less than this share of its length."""

THROUGH = np.float32(-1)
"""Terminator of triangles that light from below passes, as they stand for a smooth surface without being lifted."""

_OF_TRIANGLES = (
    "corners", "normal", "corner_normals", "area", "mesh", "material", "component", "closed", "met", "casts", "front",
    "terminator", "bend",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Surfaces:
    """F triangles, meshes one after the other; those of backs, the twins of others, last.

    Attributes:
        corners: (F, 3, 3) float32, m, relative to `origin`
        normal: (F, 3) float32, unit geometric normals
        corner_normals: (F, 3, 3) float32, unit shading normals
        area: (F,) float64, m2
        mesh: (F,) int32, index into Scene.meshes
        material: (F,) int32, index into Scene.materials
        first: (M + 1,) int64, where each mesh's triangles begin
        component: (F,) int32, connected part of a mesh, counted through all meshes
        closed: (F,) bool, every edge of the component is shared by exactly two triangles, or is of a slit's rim
        met: (F,) bool, light between surfaces meets it
        casts: (F,) bool, it stops the light of lamps
        front: (F,) int32, of a twin the triangle whose back it is, of others themselves
        terminator: (F,) float32, cosine of light below which shadow rays start on the rounder surface that the normals
            tell of; THROUGH where they pass the triangle itself instead; 0 for flat triangles
        bend: (F,) float32, light at an angle t from the shading normal counts by cos(bend t)
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
    met: Bools
    casts: Bools
    front: Int32
    terminator: Float32
    bend: Float32
    origin: Float64
    radius: float

    @property
    def count(self) -> int:
        return len(self.area)

    @cached_property
    def plane(self) -> Int64:
        """(F,) int64, a number for each plane that triangles lie on, or for two where rounding parts them."""
        height = np.einsum("ij,ij->i", self.corners[:, 0], self.normal, dtype=np.float64)
        key = np.round(height / (PLANES_APART * max(self.radius, 1e-30))).astype(np.int64)
        for k in range(3):
            key = key * (4 * TURNED) + np.round(self.normal[:, k] * TURNED).astype(np.int64)
        plane: Int64 = np.unique(key, return_inverse=True)[1].reshape(-1)
        return plane

    @cached_property
    def fronts(self) -> int:
        """Triangles before the first twin: what rays can meet."""
        return int(self.front.max(initial=-1)) + 1

    @cached_property
    def twin(self) -> Int32:
        """(F,) int32, the triangle that is the back of each, -1 for none."""
        twin = np.full(self.count, -1, np.int32)
        twin[self.front[self.fronts :]] = np.arange(self.fronts, self.count, dtype=np.int32)
        return twin

    @cached_property
    def two_sided(self) -> Bools:
        """(F,) bool, triangles that have a twin or are one."""
        return np.asarray((self.twin >= 0) | (np.arange(self.count) >= self.fronts))

    def shown_mesh(self, triangle: Int32) -> Int32:
        """Index (R,) into the meshes of the scene itself that triangles (R,) are of: of backs, that of their fronts."""
        return np.asarray(self.mesh[self.front[triangle]])

    def without_backs(self) -> Surfaces:
        """The triangles that rays can meet."""
        if self.fronts == self.count:
            return self
        some = slice(self.fronts)
        meshes = int(np.searchsorted(self.first, self.fronts, side="right"))  # backs are never of no triangles
        parts = {name: getattr(self, name)[some] for name in _OF_TRIANGLES}
        return replace(self, first=self.first[:meshes], **parts)

    @property
    def offset(self) -> float:
        """How far ray origins are lifted off a surface, m."""
        return OFFSET_SHARE * self.radius

    @cached_property
    def _corner_rows(self) -> Float32:
        return _rows(self.corners)

    @cached_property
    def _corner_normal_rows(self) -> Float32:
        return _rows(self.corner_normals)

    @cached_property
    def _normal_rows(self) -> Float32:
        return np.ascontiguousarray(self.normal.T)

    @cached_property
    def flat(self) -> Bools:
        """(F,) bool, triangles whose shading normals are their geometric one."""
        return _flat(self.corner_normals, self.normal)

    @cached_property
    def rounds(self) -> bool:
        """Whether shadow rays take triangles for a rounder surface anywhere."""
        return bool(self.terminator.any())

    @cached_property
    def bends(self) -> bool:
        """Whether light counts by another law than Lambert's anywhere."""
        return bool((self.bend != 1).any())

    @cached_property
    def slopes(self) -> Float32:
        """(6, F), m: how far corners lie above planes through others, square to the normals there.

        Corners 1 and 2 above the plane of 0, 0 and 2 above that of 1, 0 and 1 above that of 2.
        """
        pairs = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
        rows = [
            np.einsum("ij,ij->i", self.corners[:, b] - self.corners[:, a], self.corner_normals[:, a]) for a, b in pairs
        ]
        return np.stack(rows)

    def points(self, triangle: Int32, weights: Float32) -> Float32:
        """Positions (R, 3), m, at barycentric weights (R, 2) of triangles (R,). In memory x, y and z lie apart."""
        return _interpolated(self._corner_rows, triangle, weights)

    def blended_normals(self, triangle: Int32, weights: Float32) -> Float32:
        """Interpolated corner normals (R, 3), not of unit length, laid out as `points`."""
        return _interpolated(self._corner_normal_rows, triangle, weights)

    def normals(self, triangle: Int32) -> Float32:
        """Geometric normals (R, 3) of triangles (R,), laid out as `points`."""
        result = np.empty((3, len(triangle)), np.float32)
        for axis in range(3):
            np.take(self._normal_rows[axis], triangle, out=result[axis], mode="clip")
        return result.T


def flatten(scene: Scene) -> Surfaces:
    """The scene's triangles, recentred so that float32 serves far from the world's origin."""
    first = np.concatenate([[0], np.cumsum([len(mesh.triangles) for mesh in scene.meshes])]).astype(np.int64)
    used = [mesh.vertices[mesh.triangles] for mesh in scene.meshes if len(mesh.triangles)]
    corners = np.concatenate(used) if used else np.zeros((0, 3, 3))
    flat = corners.reshape(-1, 3)
    low, high = extremes(flat) if len(flat) else (np.zeros(3), np.ones(3))
    origin = (low + high) / 2
    corners = corners - origin
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    normal = cross / np.where(length > 0, length, 1)[:, None]
    component, closed = _components(scene)
    front = _fronts(scene, first)
    corner_normals = _joined([mesh.corner_normals for mesh in scene.meshes], (0, 3, 3), np.float32)
    known = [0 if mesh.terminator is None else mesh.terminator or THROUGH for mesh in scene.meshes]
    terminator = np.repeat(np.array(known, np.float32), np.diff(first))
    if terminator.any():
        terminator[_flat(corner_normals, normal.astype(np.float32))] = 0
    return Surfaces(
        corners=corners.astype(np.float32),
        normal=normal.astype(np.float32),
        corner_normals=corner_normals,
        area=length / 2,
        mesh=np.repeat(np.arange(len(scene.meshes), dtype=np.int32), np.diff(first)),
        material=_joined([mesh.material for mesh in scene.meshes], (0,), np.int32),
        first=first,
        component=component,
        closed=closed & (front == np.arange(len(front))),
        met=np.repeat(np.array([mesh.met for mesh in scene.meshes], bool), np.diff(first)),
        casts=np.repeat(np.array([mesh.casts for mesh in scene.meshes], bool), np.diff(first)),
        front=front,
        terminator=terminator,
        bend=np.repeat(np.array([mesh.bend for mesh in scene.meshes], np.float32), np.diff(first)),
        origin=origin,
        radius=float(np.linalg.norm(high - low) / 2),
    )


def on_front(surfaces: Surfaces, triangle: Int32, weights: Float32) -> tuple[Int32, Float32, Float32]:
    """Triangles and barycentrics u, v, flat, at which points of triangles, twins included, lie on fronts.

    Args:
        triangle: (...,)
        weights: (..., 2)
    """
    own = triangle.reshape(-1)
    u, v = np.ascontiguousarray(weights.reshape(-1, 2).T)
    if surfaces.fronts == surfaces.count:
        return own, u, v
    turned = own >= surfaces.fronts
    return surfaces.front[own], np.where(turned, v, u), np.where(turned, u, v)


def _flat(corner_normals: Float32, normal: Float32) -> Bools:
    gap = np.abs(corner_normals - normal[:, None])
    return np.asarray((gap < FLAT).all(axis=(1, 2)))


def _fronts(scene: Scene, first: Int64) -> Int32:
    """(F,) of each triangle of backs the one in front, of others themselves."""
    front = np.arange(first[-1], dtype=np.int32)
    for index, mesh in enumerate(scene.meshes):
        if mesh.front is not None:
            front[first[index] : first[index + 1]] = np.arange(first[mesh.front], first[mesh.front + 1])
    return front


def _joined(parts: list, empty: tuple[int, ...], dtype: type) -> np.ndarray:  # type: ignore[type-arg]
    return np.concatenate(parts).astype(dtype, copy=False) if parts else np.zeros(empty, dtype)


def _rows(corners: Float32) -> Float32:
    """(9, F): x, y, z of corner 0, then of the edges from it to corners 1 and 2. One value a row is gathered fast."""
    parts = [corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]]
    return np.ascontiguousarray(np.concatenate(parts, axis=1).T)


def _interpolated(rows: Float32, triangle: Int32, weights: Float32) -> Float32:
    """Values (R, 3) at barycentric weights (R, 2) of the `rows` (9, F) of corner values."""
    result = np.empty((3, len(triangle)), np.float32)
    for start in range(0, len(triangle), BLOCK):
        part = slice(start, start + BLOCK)
        where = triangle[part].astype(np.intp)
        u, v = np.ascontiguousarray(weights[part].T)
        for axis in range(3):
            value = np.take(rows[3 + axis], where, mode="clip")
            value *= u
            other = np.take(rows[6 + axis], where, mode="clip")
            other *= v
            value += other
            np.take(rows[axis], where, out=other, mode="clip")
            np.add(value, other, out=result[axis, part])
    return result.T


def _components(scene: Scene) -> tuple[Int32, Bools]:
    """Connected part of each triangle, and whether that part is closed. Vertices at one place count as one."""
    numbered: list[Int64] = [np.zeros((0, 3), np.int64)]
    base = 0
    for mesh in scene.meshes:
        if len(mesh.triangles):
            numbered.append(welded(mesh.vertices)[mesh.triangles] + base)
            base += len(mesh.vertices)
    triangles = np.concatenate(numbered)
    part = islands(triangles)
    keys = np.concatenate([_edge_keys(triangles[:, k], triangles[:, (k + 1) % 3], base) for k in range(3)])
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    bounds = np.flatnonzero(np.concatenate([[len(keys) > 0], keys[1:] != keys[:-1], [True]]))
    shared = np.empty(len(keys), np.int64)
    shared[order] = np.repeat(np.diff(bounds), np.diff(bounds))
    ajar = shared != 2
    rim = np.flatnonzero(shared == 1)
    if len(rim):
        triangle, corner = rim % len(triangles), rim // len(triangles)
        ends = np.stack([triangles[triangle, corner], triangles[triangle, (corner + 1) % 3]], axis=1)
        places = _joined([mesh.vertices[mesh.triangles] for mesh in scene.meshes], (0, 3, 3), np.float64)
        ajar[rim] = _wide(ends, np.stack([places[triangle, corner], places[triangle, (corner + 1) % 3]], axis=1))
    open_part = np.bincount(part, weights=ajar.reshape(3, -1).any(axis=0), minlength=1) > 0
    return part.astype(np.int32), ~open_part[part]


def _wide(edges: Int64, places: Float64) -> Bools:
    """(E,) whether the rim that an edge, with `places` (E, 2, 3) of its vertices (E, 2), is part of encloses anything.

    A rim whose vertices are on one line is a slit: triangles without area were there, as at the top of a letter T.
    """
    rim = islands(edges[:, [0, 1, 1]])
    first = places[np.unique(rim, return_index=True)[1], 0]
    gap = places - first[rim][:, None]
    order = np.lexsort((np.linalg.norm(gap, axis=2).max(1), rim))
    last = order[np.append(np.diff(rim[order]) != 0, True)]
    way = gap[last, np.linalg.norm(gap[last], axis=2).argmax(1)]
    square = np.maximum((way**2).sum(1), 1e-300)
    off = np.linalg.norm(np.cross(gap, way[rim][:, None]), axis=2).max(1) / square[rim]
    return np.asarray(np.bincount(rim, weights=off > SLIT)[rim] > 0)


def _edge_keys(start: Int64, stop: Int64, count: int) -> Int64:
    return np.asarray(np.minimum(start, stop) * count + np.maximum(start, stop))
