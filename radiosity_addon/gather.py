# SPDX-License-Identifier: GPL-3.0-or-later
"""The final gather: from the patches' solution to smooth indirect irradiance at every texel.

Rays from sparse points read the light that texels send out: direct light sharp, indirect light from the patches.
The rays are kept; a second pass over the same hits reads the indirect light of the first, which removes the patches'
steps from corners. All light groups and channels are further columns of the same sums.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import Bools, Float32, Int32
from .chunks import Fractions, scaled
from .gather_points import place_points
from .gather_rays import GatherRays
from .irradiance_fit import fit_irradiance
from .neighbours import find_neighbours
from .patches import Patches
from .settings import BakeSettings
from .texels import Texels
from .visibility import Visibility

SPECIAL_ROWS = 3
"""Rows at the end of the radiance table for rays that met no element: BELOW, NOTHING and SKY, found by -3, -2, -1."""


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

    def radiance(self, patches: Patches, indirect: Float32 | None = None, at: Int32 | None = None) -> Float32:
        """What each element sends out, (T + N + SPECIAL_ROWS, 3 G) float32, W/(m2 sr).

        Args:
            indirect: (P, 3 G) indirect irradiance at gather points, or None to take the patches' everywhere
            at: (T,) gather point of each texel, -1 for none; goes with `indirect`
        """
        count, groups = len(self.direct), self.direct.shape[1]
        table = np.zeros((count + patches.count + SPECIAL_ROWS, groups, 3), np.float32)
        for start in range(0, count, 1 << 16):
            part = slice(start, min(start + (1 << 16), count))
            patch = patches.of_element[part]
            received = self.patch_irradiance[np.maximum(patch, 0)].astype(np.float32)
            if indirect is not None and at is not None:
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
    texel_width = float(np.sqrt(extent / max(1, int(np.count_nonzero(lit & (texels.area > 0)))))) or 1.0
    aimed = min(steps.gather_points, max(1.0, np.count_nonzero(lit) / steps.gather_spacing**2))
    base = max(float(np.sqrt(extent / aimed)), 1e-9)
    table = light.radiance(patches)
    rays = GatherRays(texels, patches, visibility, settings, table.sum(1))
    points = yield from scaled(place_points(texels, lit, base, texel_width, rays), 0.0, 0.3)
    tally = yield from scaled(rays.tally(points, base), 0.3, 0.6)
    irradiance = yield from scaled(tally.sum(table, workers), 0.6, 0.65)
    for _ in range(1, steps.gather_passes):
        table = light.radiance(patches, irradiance, points.cell)
        irradiance = yield from scaled(tally.sum(table, workers), 0.65, 0.7)
    del table, tally
    neighbours = yield from scaled(find_neighbours(texels, points, visibility, workers), 0.7, 0.8)
    fitted = yield from scaled(fit_irradiance(texels, points, neighbours, irradiance, visibility, workers), 0.8, 1.0)
    return fitted.reshape(texels.count, -1, 3)
