# SPDX-License-Identifier: GPL-3.0-or-later
"""The light that leaves surfaces: before the first bounce, and as gather rays read it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float32, Float64, Int32
from ..chunks import Fractions, in_chunks, scaled
from ..columns import some, sums
from ..geometry.appearance import Appearance
from ..geometry.footprints import STRATA
from ..geometry.visibility import Visibility
from ..lighting.beams import Beams
from ..lighting.lights import MANY, Lamps, irradiance_at
from ..lighting.sky import Sky
from ..lighting.terminator import footing
from ..scene import Scene
from .patches import Patches
from .transport import Transport

BACK_SAMPLES = 4
"""Points at which the direct light on the back of a patch is taken."""

BLOCK = 1 << 14
"""Texels whose light is put into a table in one go: their arrays, 0.2 MB each, stay in cache."""

SPECIAL_ROWS = 3
"""Rows at the end of the radiance table for rays that met no element: BELOW, NOTHING and SKY, found by -3, -2, -1."""


def world_radiance(scene: Scene) -> Float32:
    """Radiance (G, 3) of the world in each light group."""
    radiance = np.zeros((len(scene.groups), 3), np.float32)
    radiance[scene.world.group] = scene.world.radiance
    return radiance


def cell_radiance(sky: Sky | None, scene: Scene) -> Float32:
    """Radiance (C, G, 3) of the sky's cells in each light group; no cells without a sky."""
    radiance = np.zeros((0 if sky is None else len(sky.radiance), len(scene.groups), 3), np.float32)
    if sky is not None:
        radiance[:, scene.world.group] = sky.radiance
        radiance += world_radiance(scene)
    return radiance


def sky_irradiance(transport: Transport, scene: Scene) -> Float64:
    """What patches get from the world (N, G, 3), W/m2: how much of their view is sky times what they see of it.

    Through sheets too.
    """
    light: Float64 = transport.sky[:, None, None] * np.pi * world_radiance(scene) * transport.sky_tint[:, None]
    light[:, scene.world.group] += transport.sky[:, None] * np.pi * transport.sky_radiance
    return transport.mixed(light.reshape(len(light), -1)).reshape(light.shape)


@dataclass(frozen=True, eq=False)
class Exitance:
    """What N patches send out before light passes between them; both (N, G, 3) float64, W/m2.

    Attributes:
        own: light of their own that is not sampled as a lamp
        total: the same and reflected light of lamps and sky
    """

    own: Float64
    total: Float64


def first_exitance(
    patches: Patches,
    look: Appearance,
    direct: Float32,
    sky: Float64,
    lamps: Lamps,
    visibility: Visibility,
    groups: int,
) -> Fractions[Exitance]:
    """What each patch sends out before any bounce: own light, and reflected light of lamps and sky."""
    exitance = patches.mean(direct, look.reflectance)
    backs = np.flatnonzero(patches.sides < 0)
    received = np.zeros((len(backs), groups, 3))
    texel = patches.any_texels()
    triangle = patches.texels.surfaces.front[patches.texels.triangle[texel[backs]]]
    count = len(lamps.lamps)
    asked, weight = [lamps] * BACK_SAMPLES, 1 / BACK_SAMPLES
    if count >= MANY:  # each from one point
        asked, weight = [lamps.of(range(sample, count, BACK_SAMPLES)) for sample in range(BACK_SAMPLES)], 1.0
    for sample, few in enumerate(asked):
        samples = np.full(len(backs), sample)
        points, normals = patches.origins(backs, samples)
        stratum = patches.stratum(backs, samples)
        stand = footing(patches.texels, stratum // STRATA, stratum & (STRATA - 1), side=-1)
        seeds = backs * BACK_SAMPLES + sample
        asking = irradiance_at(few, points, normals, visibility, BACK_SAMPLES, seeds, groups, triangle, stand)
        received += yield from scaled(asking, sample / BACK_SAMPLES, (sample + 1) / BACK_SAMPLES)
    exitance[backs] = received * weight * patches.reflectance[backs, None, :]
    exitance += sky * patches.reflectance[:, None, :]
    own = np.zeros_like(exitance)
    own[np.arange(patches.count), look.group[texel]] = np.maximum(patches.emission, 0)
    return Exitance(own, exitance + own)


@dataclass(frozen=True, eq=False)
class PatchLight:
    """The light of N patches in G light groups, as one gather pass reads it.

    Attributes:
        irradiance: (N, G, 3) float32, W/m2, from other patches and the sky
        radiosity: (N, G, 3) float32, W/m2
        reflecting: (G,) bool, groups whose light surfaces reflect; of the others only their own light is seen
    """

    irradiance: Float32
    radiosity: Float32
    reflecting: Bools


@dataclass(frozen=True, eq=False)
class Illumination:
    """The light that rays read. G light groups.

    Attributes:
        look: reflectance and own light of texels
        direct: (T, G, 3) float32, W/m2, from lamps
        passes: the light of patches, for each gather pass
        world: (G, 3) float32, W/(m2 sr), seen by rays that leave where the sky is alike everywhere
        sky: (C, G, 3) float32, W/(m2 sr), of the cells of a sky that is not; rows after the patches'
        beams: what of `direct` comes from suns on glossy texels, if any; it does not leave them as from diffuse ones
    """

    look: Appearance
    direct: Float32
    passes: tuple[PatchLight, ...]
    world: Float32
    sky: Float32
    beams: Beams | None = None

    def irradiance_of_patches(self, patches: Patches) -> Float32:
        """Irradiance (T, G, 3), W/m2, of each texel's patch, from other patches and the sky; 0 where there is none."""
        owner = patches.of_element[: patches.texels.count]
        found: Float32 = self.passes[-1].irradiance[np.maximum(owner, 0)]
        found[owner < 0] = 0
        return found

    def radiance(
        self, number: int, patches: Patches, workers: int, indirect: Float32 | None = None, at: Int32 | None = None
    ) -> Fractions[Float32]:
        """What each element sends out in a gather pass, (T + N + C + SPECIAL_ROWS, 3 G + 1) float32, W/(m2 sr).

        The last column is the sum of the others. Four numbers a row, as most scenes have them, are read fastest.

        Args:
            number: of the pass
            indirect: (P, 3 G) indirect irradiance at gather points, or None to take the patches' everywhere
            at: (T,) gather point of each texel, -1 for none; goes with `indirect`
        """
        count, groups = len(self.direct), self.direct.shape[1]
        others = self.radiance_of_others(number, patches)
        table = np.empty((count + len(others), 3 * groups + 1), np.float32)

        def work(start: int, stop: int) -> None:
            part = slice(start, stop)
            near = None if indirect is None or at is None else _near(indirect, at[part])
            table[part, :-1] = light = self.radiance_of_texels(number, patches, part, near)
            table[part, -1] = sums(light)

        yield from in_chunks(work, count, BLOCK, workers)
        table[count:, :-1] = others
        table[count:, -1] = sums(others)
        return table

    def brightness(self, patches: Patches, workers: int, apart: bool = False) -> Fractions[Float32]:
        """How much each element (T + N + C + SPECIAL_ROWS,) counts for who chooses rays by what they bring.

        The last column of `radiance` in the last pass, or, for light groups that are to be seen `apart`, the sum of
        groups made equally strong: rays that look for the sun alone would leave the lamps' own pages to chance.
        """
        last, count = len(self.passes) - 1, len(self.direct)
        weight = np.ones(3 * self.direct.shape[1], np.float32)
        if apart:
            strength = np.einsum("n,ngc->g", patches.area, self.passes[last].radiosity, dtype=np.float64)
            shines = strength > 0
            relative = np.zeros(len(strength), np.float32)
            relative[shines] = strength[shines].min(initial=np.inf) / strength[shines]
            weight = np.repeat(relative, 3)
        others = self.radiance_of_others(last, patches)
        others *= weight
        bright = np.empty(count + len(others), np.float32)

        def work(start: int, stop: int) -> None:
            light = self.radiance_of_texels(last, patches, slice(start, stop))
            light *= weight
            bright[start:stop] = sums(light)

        yield from in_chunks(work, count, BLOCK, workers)
        bright[count:] = sums(others)
        return bright

    def radiance_of_texels(
        self, number: int, patches: Patches, texels: slice | Int32, near: tuple[Bools, Float32] | None = None
    ) -> Float32:
        """What texels (K,) send out from their fronts in a gather pass, (K, 3 G) float32, W/(m2 sr).

        Args:
            number: of the pass
            near: of which of them (K,) the indirect irradiance is known, and that, (L, 3 G), W/m2; others have that of
                their patches
        """
        light, groups = self.passes[number], self.direct.shape[1]
        patch = patches.of_element[texels]
        if near is not None and near[0].all():
            received = near[1].reshape(-1, groups, 3)
        else:
            received = light.irradiance.take(patch, axis=0, mode="clip")
            if near is not None:
                received[near[0]] = near[1].reshape(-1, groups, 3)
        received += self.direct[texels]
        received *= (self.look.reflectance[texels] / np.float32(np.pi))[:, None, :]
        received[np.flatnonzero(patch < 0)] = 0
        received[:, ~light.reflecting] = 0
        emission = self.look.emission[texels]
        shining = np.flatnonzero(some(emission))
        received[shining, self.look.group[texels][shining]] += emission[shining]
        return received.reshape(len(patch), 3 * groups)

    def radiance_of_others(self, number: int, patches: Patches) -> Float32:
        """The rows of `radiance` after those of texels: backs of patches, the sky, what is no element."""
        table = np.zeros((patches.count + len(self.sky) + SPECIAL_ROWS, *self.direct.shape[1:]), np.float32)
        table[: patches.count] = self.passes[number].radiosity / np.float32(np.pi)
        table[patches.count : -SPECIAL_ROWS] = self.sky
        table[-1] = self.world
        return table.reshape(len(table), 3 * table.shape[1])


def _near(indirect: Float32, at: Int32) -> tuple[Bools, Float32]:
    known = at >= 0
    return known, indirect.take(at[known], axis=0)
