# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a bake's pages are from what Cycles measured at the probes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radiosity_addon.bake import Baked
from radiosity_addon.scene import Mesh, Scene
from tests.accuracy.probes import LUMINANCE, Probes, References

SAME_SIDE = 0.5
"""Least cosine between a probe's normal and its triangle's."""
FARTHEST = 5e-4
"""A probe may be this far from its surface, as a share of the distance between the outermost probes: splines that are
evaluated more finely than Blender does lie a little aside of its triangles."""
READING = 1.5
"""A bilinear reading takes in texels whose far edges are this many texels away. Where another object stands so near,
its contact shadow changes within what one texel holds, and what is read depends on how the grid happens to lie."""
LEVEL = 0.01
"""What rises less than this share of that distance over a probe's surface lies in it."""


@dataclass(frozen=True)
class Comparison:
    """Errors at N probes, as shares of the mean reference.

    All but `error` leave out probes beside which another object stands; see `READING`.

    Attributes:
        rms: root mean square error of the luminance
        bias: mean error of the luminance
        rms_rgb, bias_rgb: (3,) the same for each channel over its own mean
        percentile_99: of the luminance's absolute error
        error: (N,) luminance error of each probe
        crowded: (N,) bool, probes that are left out
        worst: a line on each of the five worst probes
        noise: the reference's own root mean square noise
    """

    rms: float
    bias: float
    rms_rgb: np.ndarray
    bias_rgb: np.ndarray
    percentile_99: float
    error: np.ndarray
    crowded: np.ndarray
    worst: tuple[str, ...]
    noise: float

    def beyond(self, share: float) -> float:
        """Share of the probes that are off by more than `share` of the mean."""
        return float(np.mean(np.abs(self.error) > share))

    def row(self) -> str:
        """A line of the suite's table."""
        every = float(np.sqrt(np.mean(self.error**2)))
        shares = (self.rms, self.bias, self.percentile_99, self.noise, self.beyond(0.2), every)
        count = f"{len(self.error):6} {np.count_nonzero(self.crowded):3} "
        return count + " ".join(f"{share:7.2%}" for share in shares)

    def __str__(self) -> str:
        channels = " ".join(f"{channel:.2%}" for channel in self.rms_rgb)
        biases = " ".join(f"{channel:+.2%}" for channel in self.bias_rgb)
        first = (
            f"RMS {self.rms:.2%} (RGB {channels}), bias {self.bias:+.2%} (RGB {biases}), "
            f"99th percentile {self.percentile_99:.2%}, noise of the reference {self.noise:.2%}, "
            f"{len(self.error)} probes, {np.count_nonzero(self.crowded)} of them crowded"
        )
        return "\n".join([first, *self.worst])


def compare(baked: Baked, scene: Scene, references: References) -> Comparison:
    """Hold a bake of `scene`, in world space, against Cycles."""
    found = page_at(baked, scene, Probes(references.object, references.position, references.normal))
    mean = references.value.mean(axis=0)
    error = (found - references.value) / mean
    luminance = (found - references.value) @ LUMINANCE / (mean @ LUMINANCE)
    crowded = beside_others(scene, references, READING * references.footprint)
    clear = np.flatnonzero(~crowded)
    worst = tuple(
        f"{luminance[probe]:+.1%} on {references.object[probe]} at {references.position[probe].round(3).tolist()}: "
        f"{found[probe].round(4).tolist()}, Cycles {references.value[probe].round(4).tolist()}"
        for probe in clear[np.argsort(-np.abs(luminance[clear]))][:5]
    )
    return Comparison(
        rms=float(np.sqrt(np.mean(luminance[clear] ** 2))),
        bias=float(luminance[clear].mean()),
        rms_rgb=np.sqrt(np.mean(error[clear] ** 2, axis=0)),
        bias_rgb=error[clear].mean(axis=0),
        percentile_99=float(np.percentile(np.abs(luminance[clear]), 99)),
        error=luminance,
        crowded=crowded,
        worst=worst,
        noise=references.relative_noise,
    )


def beside_others(scene: Scene, references: References, reach: float) -> np.ndarray:
    """(N,) bool: probes that something of another object, above their surface, is nearer to than `reach`, m."""
    crowded = np.zeros(len(references.position), bool)
    for mesh in scene.meshes:
        corners = mesh.vertices[mesh.triangles]
        low, high = mesh.vertices.min(axis=0) - reach, mesh.vertices.max(axis=0) + reach
        near = ((references.position > low) & (references.position < high)).all(axis=1) & ~crowded
        for probe in np.flatnonzero(near & (references.object != mesh.name)):
            offset = corners - references.position[probe]
            above = offset[((offset @ references.normal[probe]) > LEVEL * reach).any(axis=1)]
            crowded[probe] = bool((distances(above) < reach).any())
    return crowded


def distances(corners: np.ndarray) -> np.ndarray:
    """Distances (F,) of triangles (F, 3, 3) from the origin."""
    edge = np.roll(corners, -1, axis=1) - corners
    along = np.clip(-(corners * edge).sum(axis=2) / np.maximum((edge**2).sum(axis=2), 1e-300), 0, 1)
    to_edges = np.linalg.norm(corners + along[:, :, None] * edge, axis=2).min(axis=1)
    normal = np.cross(edge[:, 0], edge[:, 1])
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    inside = (np.einsum("fkx,fx->fk", np.cross(edge, -corners), normal) >= 0).all(axis=1)
    return np.where(inside, np.abs((corners[:, 0] * normal).sum(axis=1)) / length, to_edges)


@dataclass(frozen=True)
class Places:
    """Where N probes lie on a bake's pages: page (N,), uv (N, 2)."""

    page: np.ndarray
    uv: np.ndarray


def page_at(baked: Baked, scene: Scene, probes: Probes) -> np.ndarray:
    """(N, 3) what the pages hold at each probe, as a renderer reads them: bilinear."""
    places = places_of(baked, scene, probes)
    values = np.empty_like(probes.position)
    for page in np.unique(places.page):
        own = np.flatnonzero(places.page == page)
        values[own] = bilinear(baked.pages[page], places.uv[own])
    return values


def places_of(baked: Baked, scene: Scene, probes: Probes) -> Places:
    """Where the probes lie on the pages."""
    farthest = FARTHEST * float(np.linalg.norm(np.ptp(probes.position, axis=0)))
    pages, uvs = np.zeros(len(probes.position), int), np.empty((len(probes.position), 2))
    distance = np.full(len(pages), np.inf)
    for index, mesh in enumerate(scene.meshes):
        own = np.flatnonzero(probes.object == mesh.name)
        page = int(baked.atlas.page[index])
        if not len(own) or not 0 <= page < len(baked.pages):
            continue
        triangle, weights, away = nearest(mesh, probes.position[own], probes.normal[own])
        uv = np.einsum("nc,ncx->nx", weights, baked.atlas.uv[index][triangle].astype(np.float64))
        nearer = away < distance[own]  # instances share a name
        pages[own[nearer]], uvs[own[nearer]], distance[own[nearer]] = page, uv[nearer], away[nearer]
    for probe in np.flatnonzero(distance > farthest)[:1]:
        name = probes.object[probe]
        raise ValueError(f"{name} has a probe {distance[probe]:g} m away from any lightmap: the scene has changed")
    return Places(pages, uvs)


def nearest(mesh: Mesh, position: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The surface point at each position that faces alike: triangle (N,), barycentrics (N, 3), distance (N,), m."""
    corners = mesh.vertices[mesh.triangles]
    edge_u, edge_v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = np.cross(edge_u, edge_v)
    squared = (cross**2).sum(axis=1)
    offset = position[:, None] - corners[None, :, 0]
    u = (np.cross(offset, edge_v) * cross).sum(axis=2) / squared
    v = (np.cross(edge_u, offset) * cross).sum(axis=2) / squared
    weights = np.clip(np.stack([1 - u - v, u, v], axis=2), 0, None)
    weights /= weights.sum(axis=2, keepdims=True)
    there = np.einsum("nfc,fcx->nfx", weights, corners)
    distance = np.linalg.norm(there - position[:, None], axis=2)
    facing = normal @ cross.T / np.sqrt(squared)
    distance[facing < SAME_SIDE] = np.inf
    triangle = distance.argmin(axis=1)
    probe = np.arange(len(position))
    return triangle, weights[probe, triangle], distance[probe, triangle]


def bilinear(page: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(N, 3) values of a page (S, S, 3), row 0 at v = 0, at uv (N, 2)."""
    pixel, weight = bilinear_weights(len(page), uv)
    return np.einsum("nk,nkc->nc", weight, page.reshape(-1, page.shape[2])[pixel])


def bilinear_weights(size: int, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pixels (N, 4) of a page `size` wide that are read at uv (N, 2), row by row, and what each counts (N, 4)."""
    at = uv * size - 0.5
    low = np.floor(at).astype(int)
    share = at - low
    x, y = (np.clip(low[:, axis, None] + [0, 1], 0, size - 1) for axis in (0, 1))
    across, along = (np.stack([1 - share[:, axis], share[:, axis]], axis=1) for axis in (0, 1))
    pixel = (y[:, :, None] * size + x[:, None]).reshape(-1, 4)
    return pixel, (along[:, :, None] * across[:, None]).reshape(-1, 4)
