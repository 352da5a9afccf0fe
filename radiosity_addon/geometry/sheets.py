# SPDX-License-Identifier: GPL-3.0-or-later
"""Sheets that light passes scattered: paper, cloth, leaves, as a Translucent BSDF has them.

Each side of a sheet sends out B = rho E + tau E', of the irradiance E on it and E' on the other side. Both are one
product with the reflectance, rho + tau: B = (rho + tau) H of the mixed irradiance H = (1 - s) E + s E', where s is
tau / (rho + tau), the share that comes through. H is what Cycles' bake of diffuse light without colour holds, and what
pages, patches and rays have here wherever a sheet sends light on; only what measures light on one side tells both
apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float32, Int32, Int64
from ..indices import numbers_of
from ..scene import Material
from .appearance import Appearance
from .surfaces import on_front
from .texels import STRATA, Texels

BLOCK = 1 << 14
"""Texels whose other sides are looked up in one go."""

LEAST = 1e-6
"""A reflectance below which nothing of it is worth coming through."""


@dataclass(frozen=True, eq=False)
class Sheets:
    """K texels of sheets, of T.

    Attributes:
        texel: (K,) int32, rising
        behind: (K, STRATA) int32, the texels behind its strata; itself where there is none
        share: (K, 3) float32, of what a texel scatters that much comes from behind
    """

    texel: Int32
    behind: Int32
    share: Float32

    def mix(self, irradiance: Float32) -> Float32:
        """Turn the irradiance (T, G, 3) on texels into the mixed one, in place."""
        through = np.empty((len(self.texel), *irradiance.shape[1:]), np.float32)
        for start in range(0, len(self.texel), BLOCK):
            part = slice(start, start + BLOCK)
            through[part] = sum(irradiance[beyond] for beyond in self.behind[part].T)
        through /= np.float32(STRATA)
        through -= irradiance[self.texel]
        through *= self.share[:, None, :]
        irradiance[self.texel] += through
        return irradiance

    def mix_points(self, irradiance: Float32, texel: Int64, cell: Int32) -> Float32:
        """The mixed irradiance (P, 3 G) at points that stand at texels (P,).

        Args:
            irradiance: (P, 3 G) on the points
            cell: (T,) the point that stands for a texel, -1 for none
        """
        place = np.minimum(np.searchsorted(self.texel, texel), len(self.texel) - 1)
        point = numbers_of(self.texel[place] == texel)
        place = place[point]
        beyond = cell[self.behind[place, 0]]
        point, place, beyond = (each[beyond >= 0] for each in (point, place, beyond))
        mixed = irradiance.copy()
        groups = irradiance.shape[1] // 3
        mixed[point] += np.tile(self.share[place], (1, groups)) * (irradiance[beyond] - irradiance[point])
        return mixed


def is_sheet(materials: tuple[Material, ...]) -> Bools:
    """Which materials (M,) light passes scattered."""
    return np.array([any(each.translucence) or "translucence" in each.varies for each in materials] or [False])


def sheets_of(materials: tuple[Material, ...], texels: Texels, look: Appearance) -> Sheets | None:
    """The sheets among texels that know their other sides; None where there are none.

    Args:
        look: of surfaces as a whole
    """
    if look.translucence is None:
        return None
    surfaces = texels.surfaces
    twin = np.where(np.arange(surfaces.count) < surfaces.fronts, surfaces.twin, surfaces.front)
    passing = is_sheet(materials)[surfaces.material] & (twin >= 0)
    texel = numbers_of(passing[texels.triangle[:]] & texels.valid)
    if not len(texel):
        return None
    behind = np.empty((len(texel), STRATA), np.int32)
    for start in range(0, len(texel), BLOCK):
        own = texel[start : start + BLOCK]
        triangle, weights = texels.footprints.strata(own)
        front, u, v = on_front(surfaces, triangle, weights)
        ahead = triangle.reshape(-1) == front  # backs count corners the other way round
        other = np.where(ahead, twin[front], front)
        found = texels.at(other, np.where(ahead, v, u), np.where(ahead, u, v)).reshape(-1, STRATA)
        found[~texels.valid[found]] = -1
        known = np.where((found >= 0).any(1), found.max(1), own)
        behind[start : start + BLOCK] = np.where(found >= 0, found, known[:, None])
    reflectance = look.reflectance[texel]
    share = np.where(reflectance > LEAST, look.translucence[texel] / np.maximum(reflectance, LEAST), 0)
    return Sheets(texel, behind, np.minimum(share, 1).astype(np.float32))
