# SPDX-License-Identifier: GPL-3.0-or-later
"""Probes: a few hundred places of a scene where a bake is held against Cycles, and the light that Cycles found there.

A probe is the mean over the footprint of a texel: a square of 16 points on the surface, clipped to it. How Cycles
measures the light at such points is told in `cycles_judge`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from tests.accuracy.smooth_probes import Hosts, flat_normals

POINTS = 16
"""Points of a footprint: a rank-1 lattice, so that an edge of any direction cuts it evenly."""
LATTICE_STEP = 7
INSET = 1e-3
"""Least barycentric weight of a probe: one on an edge would reach behind the next wall."""
SAME_SIDE = 0.7
"""Least cosine between the normals of a probe and of the triangles that its footprint lies on."""
NEAR_SURFACE = 0.5
"""Those triangles lie this share of the footprint's edge off its plane, at most."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Rec.709"""


@dataclass(frozen=True)
class Surface:
    """The triangles of one object as rendered.

    Attributes:
        corners: (F, 3, 3), m, world space, anticlockwise about the front
        normals: (F, 3, 3) unit shading normals at the corners; None where they are the triangles' own
    """

    name: str
    corners: np.ndarray
    normals: np.ndarray | None = None

    @property
    def corner_normals(self) -> np.ndarray:
        """(F, 3, 3) unit"""
        return np.repeat(flat_normals(self.corners)[:, None], 3, axis=1) if self.normals is None else self.normals


@dataclass(frozen=True)
class Probes:
    """N points: object (N,) str, position on the surface (N, 3), m, unit normal (N, 3)."""

    object: np.ndarray
    position: np.ndarray
    normal: np.ndarray


@dataclass(frozen=True)
class Footprints:
    """The points of N probes.

    Attributes:
        points: (N, POINTS, 3) on the surface, m
        normals, shading: (N, POINTS, 3) unit, the surface's own normals there and its shading normals
        corners, corner_normals: (N, POINTS, 3, 3) of the triangles that they lie on, m and unit
        there: (N, POINTS) bool, points that the surface has
    """

    points: np.ndarray
    normals: np.ndarray
    shading: np.ndarray
    corners: np.ndarray
    corner_normals: np.ndarray
    there: np.ndarray

    @property
    def hosts(self) -> Hosts:
        """The triangles of the points that are there."""
        return Hosts(self.corners[self.there], self.corner_normals[self.there])


@dataclass(frozen=True)
class References:
    """What Cycles says.

    Attributes:
        object: (N,) name of the object under each probe
        position: (N, 3) point on the surface, m: the middle of the footprint
        normal: (N, 3) unit
        value: (N, 3) irradiance / pi, W/(m2 sr)
        noise: (N, 3) standard error of value, from the seeds' spread
        footprint: edge of the square that each value is the mean over, m
        scene: SHA-256 of the .blend file
        samples: of each seed and point
        seeds: (K,)
        seconds: (K,) rendering time of each
        left_out: dark points that were dropped
        blender: version that rendered
    """

    object: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    value: np.ndarray
    noise: np.ndarray
    footprint: float
    scene: str
    samples: int
    seeds: np.ndarray
    seconds: np.ndarray
    left_out: int
    blender: str

    @property
    def relative_noise(self) -> float:
        """Root mean square of the luminance's standard error, over the mean luminance."""
        return float(np.sqrt(np.mean((self.noise @ LUMINANCE) ** 2)) / np.mean(self.value @ LUMINANCE))

    def save(self, path: Path) -> None:
        np.savez_compressed(path, **asdict(self))

    @classmethod
    def load(cls, path: Path) -> References:
        with np.load(path) as stored:
            values = {field.name: stored[field.name] for field in fields(cls)}
        for name in ("footprint", "scene", "samples", "left_out", "blender"):
            values[name] = values[name].item()
        return cls(**values)


def fingerprint(blend: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(blend.read_bytes()).hexdigest()


def rendered_surfaces() -> list[Surface]:
    """The open scene's surfaces, one for each object and instance, sorted by name and place."""
    import bpy

    depsgraph = bpy.context.evaluated_depsgraph_get()
    surfaces = []
    for item in depsgraph.object_instances:
        thing = item.object
        # the faces of curves, text and the like come as instances of type MESH
        if thing.type != "MESH" or not item.show_self or thing.original.hide_render:
            continue
        matrix = np.array(item.matrix_world)
        mesh = thing.to_mesh()
        mesh.calc_loop_triangles()
        points = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", points)
        corner, loop = (np.empty(3 * len(mesh.loop_triangles), np.int32) for _ in range(2))
        mesh.loop_triangles.foreach_get("vertices", corner)
        mesh.loop_triangles.foreach_get("loops", loop)
        normals = np.empty(3 * len(mesh.loops), np.float32)
        mesh.corner_normals.foreach_get("vector", normals)
        thing.to_mesh_clear()
        world = points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
        order = [2, 1, 0] if np.linalg.det(matrix[:3, :3]) < 0 else [0, 1, 2]
        normals = (normals.reshape(-1, 3) @ np.linalg.inv(matrix[:3, :3]))[loop.reshape(-1, 3)[:, order]]
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        surfaces.append(Surface(thing.name, world[corner.reshape(-1, 3)[:, order]], normals))
    found = [surface for surface in surfaces if len(surface.corners)]
    return sorted(found, key=lambda surface: (surface.name, *surface.corners.mean(axis=(0, 1)).round(4).tolist()))


def place(
    surfaces: list[Surface], count: int, inside: np.ndarray | None = None, without: Collection[str] = ()
) -> Probes:
    """Spread `count` probes evenly over the surfaces' area, the same ones each time.

    Args:
        inside: (2, 3) lowest and highest corner, m: triangles whose centre lies outside get none
        without: names of objects that get none
    """
    corners = np.concatenate([surface.corners for surface in surfaces])
    name = np.repeat([surface.name for surface in surfaces], [len(surface.corners) for surface in surfaces])
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    if inside is not None:
        centre = corners.mean(axis=1)
        area = area * ((centre >= inside[0]) & (centre <= inside[1])).all(axis=1)
    area = area * ~np.isin(name, list(without))
    share = np.cumsum(area) / area.sum()
    index = np.arange(count)
    triangle = np.searchsorted(share, (index + 0.5) / count)
    # The R2 sequence, Roberts (2018): even in the triangles that get many probes.
    u, v = (0.5 + index * 0.7548776662466927) % 1, (0.5 + index * 0.5698402909980532) % 1
    u, v = np.where(u + v > 1, [1 - u, 1 - v], [u, v])
    weights = np.clip(np.stack([1 - u - v, u, v], axis=1), INSET, None)
    weights /= weights.sum(axis=1, keepdims=True)
    position = np.einsum("nc,ncx->nx", weights, corners[triangle])
    return Probes(name[triangle], position, cross[triangle] / np.linalg.norm(cross[triangle], axis=1, keepdims=True))


def tangents(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (N, 3) square to unit normals (N, 3) and to each other; along the axes on level surfaces."""
    helper = np.where(np.abs(normal[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    across = np.cross(normal, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return across, np.cross(normal, across)


def footprints(surfaces: list[Surface], probes: Probes, edge: float) -> Footprints:
    """The points of squares, `edge` metres wide, about probes, as far as the surface reaches."""
    across, along = tangents(probes.normal)
    step = (np.arange(POINTS)[:, None] * [1, LATTICE_STEP] % POINTS + 0.5) / POINTS - 0.5
    flat = probes.position[:, None] + edge * (step[:, :1] * across[:, None] + step[:, 1:] * along[:, None])
    found = [
        dropped(points, normal, whole(surfaces, name), NEAR_SURFACE * edge)
        for points, normal, name in zip(flat, probes.normal, probes.object, strict=True)
    ]
    return Footprints(*(np.array(part) for part in zip(*found, strict=True)))


def middles(surfaces: list[Surface], probes: Probes, squares: Footprints, lit: np.ndarray, edge: float) -> np.ndarray:
    """Points (N, 3) of the surface in the middle of the points `lit` (N, POINTS), m; probes that have none stay."""
    middle = probes.position.copy()
    for index in np.flatnonzero(lit.any(axis=1)):
        mean = squares.points[index, lit[index]].mean(axis=0, keepdims=True)
        surface = whole(surfaces, probes.object[index])
        place, *_, found = dropped(mean, probes.normal[index], surface, NEAR_SURFACE * edge)
        if found[0]:
            middle[index] = place[0]
    return middle


def whole(surfaces: list[Surface], name: str) -> Surface:
    """All surfaces of an object as one."""
    own = [surface for surface in surfaces if surface.name == name]
    corners = np.concatenate([surface.corners for surface in own])
    return Surface(name, corners, np.concatenate([surface.corner_normals for surface in own]))


def dropped(points: np.ndarray, normal: np.ndarray, surface: Surface, reach: float) -> tuple[np.ndarray, ...]:
    """Points (P, 3) moved along a normal (3,) onto the nearest triangle of a surface within `reach`, m.

    Returns:
        points (P, 3), unit normals and unit shading normals there (P, 3), corners and corner normals (P, 3, 3) of the
        triangles there, and which met one (P,)
    """
    fronts = flat_normals(surface.corners)
    alike = np.flatnonzero(fronts @ normal > SAME_SIDE)
    if not len(alike):
        none = np.zeros_like(points)
        return points, none, none, *np.zeros((2, len(points), 3, 3)), np.zeros(len(points), bool)
    corners, normals = surface.corners[alike], surface.corner_normals[alike]
    start, edge_u, edge_v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = np.cross(edge_u, edge_v)
    facing = cross @ normal
    # Moeller and Trumbore 1997, all points with all triangles
    gap = points[:, None] - start
    u = np.cross(gap, edge_v) @ normal / facing
    v = np.cross(edge_u, gap) @ normal / facing
    height = np.abs(np.einsum("pfk,fk->pf", gap, cross) / facing)
    height[(u < 0) | (v < 0) | (u + v > 1) | (height > reach)] = np.inf
    best = height.argmin(axis=1)
    row = np.arange(len(points))
    u, v = u[row, best, None], v[row, best, None]
    there = np.isfinite(height[row, best])
    moved = start[best] + u * edge_u[best] + v * edge_v[best]
    shading = (1 - u - v) * normals[best, 0] + u * normals[best, 1] + v * normals[best, 2]
    shading /= np.maximum(np.linalg.norm(shading, axis=1, keepdims=True), 1e-9)
    place = np.where(there[:, None], moved, points)
    return place, fronts[alike[best]], shading, corners[best], normals[best], there


def extent(surfaces: list[Surface]) -> float:
    """Diagonal of all surfaces' bounding box, m."""
    points = np.concatenate([surface.corners.reshape(-1, 3) for surface in surfaces])
    return float(np.linalg.norm(np.ptp(points, axis=0)))
