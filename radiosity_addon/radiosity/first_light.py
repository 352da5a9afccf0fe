# SPDX-License-Identifier: GPL-3.0-or-later
"""First light: a coarse solution of the whole scene in a moment, before any surface has its place on a page.

Radiosity as it began (Cohen and Greenberg 1985): light is taken at vertices, bounces between patches of them, and is
shown by their colours. It shows a room while charts are made, and tells what is not known yet of a bake that is ended
early; nothing of it enters one that is not.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from ..arrays import Float32, Int32, Int64
from ..chunks import finish
from ..geometry.sides import seen_side
from ..geometry.surfaces import flatten
from ..geometry.texels import Texels
from ..geometry.visibility import Visibility, visibility_of
from ..lighting.glow import glow_of
from ..lighting.lights import Lamps, irradiance_at, lamps_of
from ..lighting.sky import Sky, cells, sky_of
from ..sampling import cosine_directions, even_uniform
from ..scene import Scene
from .vertices import Vertices, cell_names, place_vertices

BLOCK = 1 << 16
"""Texels whose light is taken from samples in one go."""

SPACINGS = 3000
"""Squares of a vertex spacing that all surfaces together hold."""

MOST_SAMPLES = 24_000
"""Samples of the light, at most."""

SAMPLES_AT_ONCE = 8192
"""Samples lit in one go: a tenth of a second in a room of some lamps."""

GLIMPSE_SHADOWS, SHADOW_RAYS = 2, 4
"""Of a sample and lamp, for a first look and for good."""

GLIMPSE_WIDTH, PATCH_WIDTH = 3.0, 2.0
"""Of patches, in vertex spacings; for a first look they are wide, and hold what faces alike whatever it belongs to."""

GLIMPSE = 24_000, 8, 64
RAYS = 128_000, 48, 256
"""Rays of all patches together, and fewest and most of each, for a first look, for which lamps are asked at one sample
of each patch, and for good: few patches can afford many."""

BOUNCES = 12


@dataclass(frozen=True, eq=False)
class FirstLight:
    """Light at S samples, light groups added up.

    Attributes:
        vertices: where the samples are
        direct, indirect: (S, 3) float32, W/m2, irradiance from lamps and from everything else
        reflectance: (S, 3) float32
        emission: (S, 3) float32, W/(m2 sr)
    """

    vertices: Vertices
    direct: Float32
    indirect: Float32
    reflectance: Float32
    emission: Float32

    @property
    def radiance(self) -> Float32:
        """What the samples send out, (S, 3), W/(m2 sr)."""
        return (self.direct + self.indirect) * self.reflectance / np.float32(np.pi) + self.emission

    def at(self, texels: Texels) -> tuple[Float32, Float32]:
        """Direct and indirect irradiance at texels, (T, 3) each, W/m2."""
        return self._between(self.direct, texels), self._between(self.indirect, texels)

    def emission_at(self, texels: Texels) -> Float32:
        """What texels emit, lamps or not, (T, 3), W/(m2 sr)."""
        return self.emission[self._samples(texels)]

    def smoothed(self, texels: Texels, values: Float32) -> Float32:
        """Values (T, 3) of texels as means about each vertex, linear in between; first light where there are none."""
        sample = self._samples(texels)
        means = self.indirect.copy()
        number = np.bincount(sample, texels.valid, self.vertices.count)
        known = number > 0
        for channel, found in zip(values.T, means.T, strict=True):
            found[known] = np.bincount(sample, channel * texels.valid, self.vertices.count)[known] / number[known]
        return self._between(means, texels)

    def _samples(self, texels: Texels) -> Int32:
        found = np.empty(texels.count, np.int32)
        for part, triangle, weights in _first_strata(texels):
            found[part] = self.vertices.at(triangle, weights)
        return found

    def _between(self, values: Float32, texels: Texels) -> Float32:
        found = np.empty((texels.count, *values.shape[1:]), np.float32)
        for part, triangle, weights in _first_strata(texels):
            found[part] = self.vertices.between(values, triangle, weights)
        return found


def _first_strata(texels: Texels) -> Iterator[tuple[slice, Int32, Float32]]:
    """Triangles and barycentrics of the first strata of all texels, some at a time."""
    for start in range(0, texels.count, BLOCK):
        own = np.arange(start, min(start + BLOCK, texels.count))
        yield slice(start, start + len(own)), *texels.footprints.at(own, np.zeros_like(own))


def first_light(scene: Scene) -> Generator[FirstLight | None, None, FirstLight]:
    """The light of a scene, backs included, at the vertices of its triangles; materials are alike all over.

    Yields nothing between its steps, and the same light from fewer samples and rays as soon as there is some.
    """
    surfaces = flatten(scene)
    fronts = surfaces.without_backs()
    scene = scene.moved(-surfaces.origin)
    yield None
    visibility = visibility_of(scene, fronts, None, 0.0)
    yield None
    sky = sky_of(scene.world)
    lamps = lamps_of(scene, fronts, () if sky is None else sky.suns, glow_of(scene, fronts, None)[0])
    yield None
    spacing = float(np.sqrt(surfaces.area.sum() / SPACINGS))
    vertices = place_vertices(surfaces, spacing, MOST_SAMPLES)
    yield None
    triangle = vertices.triangle[vertices.seat]
    material = surfaces.material[triangle]
    reflectance = np.array([entry.reflectance for entry in scene.materials], np.float32)[material]
    emission = np.array([entry.emission for entry in scene.materials], np.float32)[material]
    glow = emission * ~lamps.sampled[surfaces.front[triangle]][:, None]

    def lit(patches: _Patches, direct: Float32, rays: tuple[int, int, int]) -> FirstLight:
        leaving = patches.mean(direct * reflectance + np.float32(np.pi) * glow)
        received = patches.exchange(leaving, patches.mean(reflectance), visibility, scene, sky, rays)
        return FirstLight(vertices, direct, patches.between(received), reflectance, emission)

    light_at = partial(_direct, lamps, vertices, visibility, len(scene.groups))
    wide = _Patches.of(vertices, GLIMPSE_WIDTH * spacing, apart=False)
    few = yield from light_at(wide.middles(), GLIMPSE_SHADOWS)
    yield lit(wide, wide.between(few), GLIMPSE)
    direct = yield from light_at(np.arange(vertices.count), SHADOW_RAYS)
    return lit(_Patches.of(vertices, PATCH_WIDTH * spacing), direct, RAYS)


def _direct(
    lamps: Lamps, vertices: Vertices, visibility: Visibility, groups: int, ids: Int64, rays: int
) -> Generator[None, None, Float32]:
    """Irradiance (R, 3) from lamps at samples (R,), by so many shadow rays to each."""
    points, normals = (part[ids] for part in vertices.points())
    triangle = vertices.triangle[vertices.seat[ids]]
    points += vertices.surfaces.normals(triangle) * np.float32(vertices.surfaces.offset)
    front = vertices.surfaces.front[triangle]
    light = np.zeros((len(ids), 3), np.float32)
    for start in range(0, len(ids), SAMPLES_AT_ONCE):
        part = slice(start, start + SAMPLES_AT_ONCE)
        asking = irradiance_at(
            lamps, points[part], normals[part], visibility.of_lamps, rays, ids[part], groups, front[part]
        )
        light[part] = finish(asking).sum(1)
        yield
    return light


@dataclass(frozen=True, eq=False)
class _Patches:
    """P patches: the samples of a cell.

    Attributes:
        vertices: the samples
        width: of the cells, m
        apart: connected surfaces are told apart
        names: (P,) int64, of the cells, ascending
        owner: (S,) int64, patch of each sample
        position, normal: (S, 3) float32, of the samples
    """

    vertices: Vertices
    width: float
    apart: bool
    names: Int64
    owner: Int64
    position: Float32
    normal: Float32

    @classmethod
    def of(cls, vertices: Vertices, width: float, apart: bool = True) -> _Patches:
        position, normal = vertices.points()
        triangle = vertices.triangle[vertices.seat]
        names = cell_names(vertices.surfaces, triangle, position, normal, width, apart=apart)
        found, owner = np.unique(names, return_inverse=True)
        return cls(vertices, width, apart, found, owner.reshape(-1), position, normal)

    def middles(self) -> Int64:
        """Of each patch, the sample (P,) nearest to the middle of all."""
        gap = self.position - self.mean(self.position)[self.owner]
        nearest = np.lexsort((np.einsum("ij,ij->i", gap, gap), self.owner))
        return nearest[np.searchsorted(self.owner[nearest], np.arange(len(self.names)))]

    def mean(self, values: Float32) -> Float32:
        """Means (P, 3) over the samples of each patch."""
        sums = [np.bincount(self.owner, channel, len(self.names)) for channel in values.T]
        return (np.stack(sums, axis=1) / np.bincount(self.owner, minlength=len(self.names))[:, None]).astype(np.float32)

    def exchange(
        self,
        leaving: Float32,
        reflectance: Float32,
        visibility: Visibility,
        scene: Scene,
        sky: Sky | None,
        allowed: tuple[int, int, int],
    ) -> Float32:
        """Irradiance (P, 3), W/m2, from other patches and the sky after some bounces of what first leaves patches.

        Args:
            allowed: rays of all patches together, and fewest and most of each
        """
        surfaces = self.vertices.surfaces
        count, own = len(self.names), np.argsort(self.owner, kind="stable")
        number = np.bincount(self.owner, minlength=count)
        in_all, fewest, most = allowed
        rays = min(max(in_all // count, fewest), most)
        patch = np.repeat(np.arange(count), rays)
        ray = np.tile(np.arange(rays), count)
        sender = own[(np.cumsum(number) - number)[patch] + ray * number[patch] // rays]
        normal = surfaces.normals(self.vertices.triangle[self.vertices.seat[sender]])
        ways = cosine_directions(normal, even_uniform(patch, ray, 0), even_uniform(patch, ray, 1))
        origins = self.position[sender] + normal * np.float32(surfaces.offset)
        hits = seen_side(surfaces, visibility.first_hit(origins, ways))
        left = hits.triangle < 0
        seen = self.owner[self.vertices.at(np.maximum(hits.triangle, 0), np.stack([hits.u, hits.v], axis=1))]
        seen[left | ~hits.front] = count  # a patch that sends nothing
        outside = np.zeros((3, count * rays), np.float32)
        outside[:, left] = np.pi * np.array(scene.world.radiance)[:, None]
        if sky is not None:
            outside[:, left] += np.float32(np.pi) * sky.radiance[cells(ways[left])].T
        first = _mean_of_rays(outside, rays)
        radiosity = np.append(leaving.T, np.zeros((3, 1), np.float32), axis=1)
        for _ in range(BOUNCES):
            received = first + _mean_of_rays(np.take(radiosity, seen, axis=1), rays)
            radiosity[:, :-1] = leaving.T + reflectance.T * received
        return np.ascontiguousarray(received.T)

    def between(self, values: Float32) -> Float32:
        """Values of patches (P, 3) at the samples (S, 3), linear between the middles of cells of one surface."""
        triangle = self.vertices.triangle[self.vertices.seat]
        place = self.position / np.float32(self.width) - np.float32(0.5)
        share = place - np.floor(place)
        low = (place + np.float32(0.5)) - np.floor(place + np.float32(0.5)) < 0.5  # the next middle lies behind
        total = np.zeros((len(place), 3), np.float32)
        weights = np.zeros(len(place), np.float32)
        for step in product((0, 1), repeat=3):
            shift = np.array(step) - low
            names = cell_names(
                self.vertices.surfaces, triangle, self.position, self.normal, self.width, shift, self.apart
            )
            found = np.minimum(np.searchsorted(self.names, names), len(self.names) - 1)
            weight = np.where(step, share, 1 - share).prod(1) * (self.names[found] == names)
            total += values[found] * weight[:, None]
            weights += weight
        alone = weights < 1e-3
        total[alone], weights[alone] = values[self.owner[alone]], 1
        return total / weights[:, None]


def _mean_of_rays(values: Float32, rays: int) -> Float32:
    """Means (3, P) over the rays of each patch, (3, P * rays)."""
    means: Float32 = values.reshape(3, -1, rays).mean(2, dtype=np.float32)
    return means
