# SPDX-License-Identifier: GPL-3.0-or-later
"""The final gather: from the patches' solution to smooth indirect irradiance at every texel.

Rays from sparse points read the light that texels send out: direct light sharp, indirect light from the patches.
The rays are kept; a second pass over the same hits reads the indirect light of the first, which removes the patches'
steps from corners. All light groups and channels are further columns of the same sums.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from .arrays import Bools, Float32, Int32, Int64
from .chunks import Fractions, in_chunks, scaled
from .gather_points import GatherPoints, cell_keys, place_points
from .guiding import direction_bins, directions_in, draw_bins, pool
from .irradiance_fit import fit_irradiance
from .neighbours import find_neighbours
from .patches import NOTHING, Patches
from .sampling import cosine_directions, even_uniform
from .settings import BakeSettings
from .texels import Texels
from .visibility import Visibility

BELOW = -3
"""A direction below the horizon: it counts, and brings nothing."""

SPECIAL_ROWS = 3
"""Rows at the end of the radiance table for rays that met no element: BELOW, NOTHING and SKY, found by -3, -2, -1."""

RAYS = 1 << 15
"""Rays traced at once."""

PILOT_SHARE = 2 / 3
"""Of the rays of a point; they also serve where nothing outshines the rest."""

POOL_WIDTH = 3.0
"""Pilot rays are pooled over cells this many times as wide as the coarsest cells of gather points."""

JITTER_DIMENSIONS = (4, 5)


@dataclass(frozen=True, eq=False)
class Illumination:
    """The light that rays read. G light groups.

    Attributes:
        reflectance: (T, 3) float32
        emission: (T, 3) float32, W/(m2 sr), of emitters that are not sampled as lamps
        emission_group: (T,) light group of the emission
        direct: (T, G, 3) float32, W/m2, from lamps
        patch_irradiance: (N, G, 3), W/m2, of patches, from other patches and the sky
        patch_radiosity: (N, G, 3), W/m2
        world: (G, 3) float32, W/(m2 sr), seen by rays that leave
    """

    reflectance: Float32
    emission: Float32
    emission_group: Int32
    direct: Float32
    patch_irradiance: Float32
    patch_radiosity: Float32
    world: Float32

    def radiance(self, patches: Patches, indirect: Float32 | None, at: Int32) -> Float32:
        """What each element sends out, (T + N + SPECIAL_ROWS, 3 G) float32, W/(m2 sr).

        Args:
            indirect: (P, 3 G) indirect irradiance at gather points, or None to take the patches' everywhere
            at: (T,) gather point of each texel, -1 for none
        """
        count, groups = len(self.direct), self.direct.shape[1]
        table = np.zeros((count + patches.count + SPECIAL_ROWS, groups, 3), np.float32)
        for start in range(0, count, 1 << 16):
            part = slice(start, min(start + (1 << 16), count))
            patch = patches.of_element[part]
            received = self.patch_irradiance[np.maximum(patch, 0)].astype(np.float32)
            if indirect is not None:
                fine = at[part] >= 0
                received[fine] = indirect[at[part][fine]].reshape(-1, groups, 3)
            received += self.direct[part]
            received *= (self.reflectance[part] / np.float32(np.pi))[:, None, :]
            received[patch < 0] = 0
            received[np.arange(len(patch)), self.emission_group[part]] += self.emission[part]
            table[part] = received
        table[count : count + patches.count] = self.patch_radiosity / np.pi
        table[-1] = self.world
        return table.reshape(len(table), -1)


class _Rays:
    """The gather rays of all points so far: what they met, and what they count."""

    def __init__(self, texels: Texels, patches: Patches, visibility: Visibility, settings: BakeSettings) -> None:
        self.texels, self.patches, self.visibility, self.settings = texels, patches, visibility, settings
        self.pilots = round(settings.steps.gather_rays * PILOT_SHARE)
        self.guided = settings.steps.gather_rays - self.pilots
        self.elements: list[Int32] = []
        self.bins: list[np.ndarray] = []  # type: ignore[type-arg]

    def look(self, chosen: Int64) -> Generator[float, None, tuple[Float32, Float32]]:
        """Trace the pilot rays of texels (Q,); returns harmonic mean and least distance (Q,), m."""
        samples = self.pilots

        def work(start: int, stop: int) -> tuple[Int32, np.ndarray, Float32, Float32]:  # type: ignore[type-arg]
            texel = np.repeat(chosen[start:stop], samples)
            sample = np.tile(np.arange(samples), stop - start)
            normals = self.texels.shading_normal[texel]
            u, v = even_uniform(texel, sample, 0), even_uniform(texel, sample, 1)
            directions = cosine_directions(normals, u, v)
            element, distance = self._trace(texel, sample, directions)
            inverse = 1 / np.maximum(distance, np.float32(1e-9)).reshape(-1, samples)
            shape = (stop - start, samples)
            bins = direction_bins(directions).astype(np.uint16).reshape(shape)
            return element.reshape(shape), bins, 1 / inverse.mean(1), 1 / inverse.max(1)

        parts = yield from in_chunks(work, len(chosen), max(1, RAYS // samples), self.settings.workers)
        if not parts:
            return np.zeros(0, np.float32), np.zeros(0, np.float32)
        elements, bins, harmonic, nearest = (np.concatenate(part) for part in zip(*parts, strict=True))
        self.elements.append(elements)
        self.bins.append(bins)
        return harmonic, nearest

    def _trace(self, texel: Int64, sample: Int64, directions: Float32) -> tuple[Int32, Float32]:
        below = np.einsum("ij,ij->i", directions, self.texels.normal[texel]) <= 0
        hits = self.visibility.first_hit(self.texels.origins(texel, sample), directions)
        element = self.patches.elements(hits)
        element[below] = BELOW
        return element, hits.distance

    def weigh(self, points: GatherPoints, table: Float32, base: float) -> Fractions[tuple[Int32, Float32]]:
        """Trace the guided rays; returns elements and weights (P, rays) of all: irradiance is their weighted sum."""
        elements = np.concatenate(self.elements) if self.elements else np.zeros((0, self.pilots), np.int32)
        bins = np.concatenate(self.bins) if self.bins else np.zeros((0, self.pilots), np.uint16)
        self.elements, self.bins = [], []
        fold = _folds(cell_keys(self.texels, points.texel, base * POOL_WIDTH))
        folds = int(fold.max(initial=-1)) + 2
        bright = table.sum(1)
        owner = np.repeat(fold ^ 1, self.pilots)
        density = pool(owner, folds, bins.reshape(-1).astype(np.int64), bright[elements.reshape(-1)])
        drawn = draw_bins(density, self.guided)
        lit = density.any(1)

        def work(start: int, stop: int) -> tuple[Int32, Float32]:
            texel, mine = points.texel[start:stop], fold[start:stop]
            sample = np.tile(np.arange(self.pilots), stop - start)
            cosine = np.sqrt(1 - even_uniform(np.repeat(texel, self.pilots), sample, 0)).reshape(-1, self.pilots)
            seen = density[mine[:, None], bins[start:stop]]
            pilot_weight = self._balance(cosine, seen)
            texel = np.repeat(texel, self.guided)
            sample = np.tile(np.arange(self.guided), stop - start)
            bin_ = drawn[mine].reshape(-1)
            u, v = (even_uniform(texel, sample, dimension) for dimension in JITTER_DIMENSIONS)
            directions = directions_in(bin_, u, v)
            cosine = np.einsum("ij,ij->i", directions, self.texels.shading_normal[texel])
            wanted = (cosine > 0) & np.repeat(lit[mine], self.guided)
            element = np.full(len(texel), BELOW, np.int32)
            element[wanted] = self._trace(texel[wanted], sample[wanted], directions[wanted])[0]
            weight = self._balance(cosine, density[np.repeat(mine, self.guided), bin_])
            weight[~wanted] = 0
            shape = (stop - start, self.guided)
            return (
                np.concatenate([elements[start:stop], element.reshape(shape)], axis=1),
                np.concatenate([pilot_weight, weight.reshape(shape)], axis=1),
            )

        parts = yield from in_chunks(work, points.count, max(1, RAYS // self.guided), self.settings.workers)
        if not parts:
            return np.zeros((0, 1), np.int32), np.zeros((0, 1), np.float32)
        return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])

    def _balance(self, cosine: Float32, density: Float32) -> Float32:
        """Cosine over the summed densities of both kinds of rays: the balance heuristic's weight."""
        return np.maximum(cosine, 0) / (
            np.float32(self.pilots / np.pi) * np.maximum(cosine, 0)
            + np.float32(self.guided) * density
            + np.float32(1e-9)
        )


def _folds(keys: Int64) -> Int64:
    """Number (P,) of each point's half of its cell: 2 i and 2 i + 1 for cell i.

    Each half is guided by the pilots of the other. A ray weighed by a histogram that it helped to fill would count
    too little: 4 % of the light was missing so.
    """
    order = np.argsort(keys, kind="stable")
    first = np.concatenate([[True], np.diff(keys[order]) != 0])[: len(keys)]
    cell = np.cumsum(first) - 1
    rank = np.arange(len(keys)) - np.flatnonzero(first)[cell]
    fold: Int64 = np.empty(len(keys), np.int64)
    fold[order] = 2 * cell + rank % 2
    return fold


def _sum_rays(elements: Int32, weights: Float32, pilots: int, table: Float32, workers: int) -> Fractions[Float32]:
    """Irradiance (P, C) of points from their rays.

    The weights should add up to pi and do so only on average, and rays that met nothing that takes part are missing.
    What is missing is taken to be as bright as the dimmer part of the view (a control variate): exact where all is
    equally bright, harmless where a small window outshines the rest.
    """

    def work(start: int, stop: int) -> Float32:
        element = elements[start:stop]
        weight = weights[start:stop] * (element != NOTHING)
        radiance = table[element]
        pilot = radiance[:, :pilots]
        dim = np.minimum(pilot, pilot.mean(1, keepdims=True)).mean(1)
        light = np.einsum("pr,prc->pc", weight, radiance)
        return np.asarray(light + dim * (np.float32(np.pi) - weight.sum(1))[:, None], np.float32)

    parts = yield from in_chunks(work, len(elements), max(1, RAYS // max(1, elements.shape[1])), workers)
    return np.concatenate(parts) if parts else np.zeros((0, table.shape[1]), np.float32)


def final_gather(
    texels: Texels,
    patches: Patches,
    light: Illumination,
    wanted: Bools,
    visibility: Visibility,
    settings: BakeSettings,
) -> Fractions[Float32]:
    """Indirect irradiance, W/m2, (T, G, 3) float32, at the texels `wanted` (T,)."""
    steps, workers = settings.steps, settings.workers
    lit = wanted & texels.valid
    extent = float(texels.area[lit].sum(dtype=np.float64))
    texel_width = float(np.sqrt(extent / max(1, np.count_nonzero(lit & (texels.area > 0))))) or 1.0
    aimed = min(steps.gather_points, max(1.0, np.count_nonzero(lit) / steps.gather_spacing**2))
    base = max(float(np.sqrt(extent / aimed)), 1e-9)
    rays = _Rays(texels, patches, visibility, settings)
    points = yield from scaled(place_points(texels, lit, base, texel_width, rays.look), 0.0, 0.3)
    table = light.radiance(patches, None, points.cell)
    elements, weights = yield from scaled(rays.weigh(points, table, base), 0.3, 0.6)
    irradiance = yield from scaled(_sum_rays(elements, weights, rays.pilots, table, workers), 0.6, 0.65)
    for _ in range(1, steps.gather_passes):
        table = light.radiance(patches, irradiance, points.cell)
        irradiance = yield from scaled(_sum_rays(elements, weights, rays.pilots, table, workers), 0.65, 0.7)
    del table, elements, weights
    neighbours = yield from scaled(find_neighbours(texels, points, visibility, workers), 0.7, 0.8)
    fitted = yield from scaled(fit_irradiance(texels, points, neighbours, irradiance, visibility, workers), 0.8, 1.0)
    return fitted.reshape(texels.count, -1, 3)
