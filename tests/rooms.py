# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes of flat facets for the tests of light transport; each facet is a patch."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from radiosity_addon.chunks import finish
from radiosity_addon.geometry.visibility import Hits, Visibility
from radiosity_addon.radiosity.form_factor import trace_transport
from radiosity_addon.radiosity.transport import Transport
from radiosity_addon.sampling import even_uniform
from radiosity_addon.settings import BakeSettings, Quality

LIFT = np.float32(2e-5)


@dataclass(frozen=True)
class Rays(BakeSettings):
    """Bake settings with any number of rays a patch."""

    patch_rays: int = 128

    @property
    def steps(self) -> Quality:
        return replace(super().steps, patch_rays=self.patch_rays)


class Facets:
    """Parallelograms (or, folded, triangles) that stand in for Patches: one patch each, front side only."""

    def __init__(self, origin, edge_u, edge_v, triangular=False, reflectance=0.5, emission=0.0) -> None:
        self.origin, self.edge_u, self.edge_v = (np.asarray(x, np.float32) for x in (origin, edge_u, edge_v))
        cross = np.cross(np.asarray(edge_u, float), np.asarray(edge_v, float))
        length = np.linalg.norm(cross, axis=1)
        self.normal = (cross / length[:, None]).astype(np.float32)
        self.triangular = triangular
        self.area = length / 2 if triangular else length
        self.reflectance = np.broadcast_to(np.float32(reflectance), (self.count, 3)).astype(np.float32)
        self.emission = np.broadcast_to(np.float32(emission), (self.count, 3)).astype(np.float32)

    @property
    def count(self) -> int:
        return len(self.origin)

    def corners(self) -> np.ndarray:
        a, b, d = self.origin, self.origin + self.edge_u, self.origin + self.edge_v
        first = np.stack([a, b, d], axis=1)
        return (
            first if self.triangular else np.stack([first, np.stack([b, b + self.edge_v, d], 1)], 1).reshape(-1, 3, 3)
        )

    def origins(self, ids: np.ndarray, sample: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u, v = even_uniform(ids, sample, 2), even_uniform(ids, sample, 3)
        if self.triangular:
            outside = u + v > 1
            u, v = np.where(outside, 1 - u, u), np.where(outside, 1 - v, v)
        normals = self.normal[ids]
        places = self.origin[ids] + u[:, None] * self.edge_u[ids] + v[:, None] * self.edge_v[ids] + LIFT * normals
        return places, normals

    def at(self, hits: Hits) -> np.ndarray:
        patch = hits.triangle if self.triangular else hits.triangle >> 1
        return np.where(hits.triangle < 0, -1, np.where(hits.front, patch, -2)).astype(np.int32)

    def settings(self, rays: int = 128, workers: int = 1, form_factors: str = "nusselt") -> BakeSettings:
        return Rays(patch_rays=rays, threads=workers, form_factors=form_factors)

    def transport(self, rays: int = 128, workers: int = 1, form_factors: str = "nusselt") -> Transport:
        settings = self.settings(rays, workers, form_factors)
        return finish(trace_transport(self, Visibility(self.corners()), settings))


def rectangle(origin, edge_u, edge_v, across: int = 1, along: int | None = None) -> tuple[np.ndarray, ...]:
    """A rectangle cut into across x along parallelograms: origins, edges u and v, each (across * along, 3)."""
    along = along or across
    origin, edge_u, edge_v = np.array(origin, float), np.array(edge_u, float) / across, np.array(edge_v, float) / along
    i, j = (x.reshape(-1, 1) for x in np.meshgrid(np.arange(across), np.arange(along), indexing="ij"))
    return origin + i * edge_u + j * edge_v, np.tile(edge_u, (len(i), 1)), np.tile(edge_v, (len(i), 1))


def joined(*rectangles: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    return tuple(np.concatenate(parts) for parts in zip(*rectangles, strict=True))


def box(size=(1.0, 1.0, 1.0), cuts: int = 1, **properties) -> Facets:
    """The inside of a box; its walls, cut into cuts x cuts, in the order floor, ceiling, x = 0, x = w, y = 0, y = d."""
    w, d, h = size
    x, y, z = (w, 0, 0), (0, d, 0), (0, 0, h)
    walls = [
        ((0, 0, 0), x, y),
        ((0, 0, h), y, x),
        ((0, 0, 0), y, z),
        ((w, 0, 0), z, y),
        ((0, 0, 0), z, x),
        ((0, d, 0), x, z),
    ]
    return Facets(*joined(*(rectangle(*wall, cuts) for wall in walls)), **properties)


def sphere(rings: int = 16, radius: float = 1.0, **properties) -> Facets:
    """The inside of a sphere of triangles of much the same size: an octahedron, refined and blown up."""
    k = np.arange(rings)
    i, j = (x.reshape(-1) for x in np.meshgrid(k, k, indexing="ij"))
    up = i + j < rings
    down = i + j < rings - 1
    lower = np.stack([np.stack([i, j], 1), np.stack([i + 1, j], 1), np.stack([i, j + 1], 1)], 1)[up]
    upper = np.stack([np.stack([i + 1, j + 1], 1), np.stack([i, j + 1], 1), np.stack([i + 1, j], 1)], 1)[down]
    corners = np.concatenate([lower, upper]) / rings
    corners = np.concatenate([corners, 1 - corners.sum(2, keepdims=True)], axis=2)
    signs = np.array([[x, y, z] for x in (1, -1) for y in (1, -1) for z in (1, -1)])
    faces = (corners[None] * signs[:, None, None]).reshape(-1, 3, 3)
    faces /= np.linalg.norm(faces, axis=2, keepdims=True)
    outward = np.einsum("ij,ij->i", np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]), faces[:, 0]) > 0
    faces[outward] = faces[outward][:, ::-1]
    faces *= radius
    return Facets(faces[:, 0], faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0], triangular=True, **properties)
