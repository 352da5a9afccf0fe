# SPDX-License-Identifier: GPL-3.0-or-later
"""Direct light, with that of suns on glossy surfaces apart: these throw it in one direction more than in others."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

import numpy as np

from ..arrays import Bools, Float32, Int32
from ..chunks import Fractions, scaled
from ..geometry.texels import Texels
from ..geometry.visibility import Visibility
from ..scene import Material, Scene
from ..settings import BakeSettings
from .lamps import SunLamp
from .lights import Lamps, direct_irradiance

MOST_BEAMS = 8
"""Suns whose light is told apart, the scene's before the bright pieces of its sky; gloss reflects others diffusely."""


@dataclass(frozen=True, eq=False)
class Beams:
    """The light of B suns on K glossy texels.

    Attributes:
        row: (T,) int32, place of each texel among the K, -1 for none
        light: (B, K, 3) float32, W/m2, irradiance
        direction: (B, 3) float32, unit, towards the sun
        group: (B,) light groups
        materials: the scene's
    """

    row: Int32
    light: Float32
    direction: Float32
    group: tuple[int, ...]
    materials: tuple[Material, ...]


def direct_light(
    lamps: Lamps, texels: Texels, scene: Scene, visibility: Visibility, settings: BakeSettings
) -> Fractions[tuple[Float32, Beams | None]]:
    """Irradiance (T, G, 3) float32, W/m2, of all lamps, and that of suns on glossy texels once more."""
    groups = len(scene.groups)
    glossy = _glossy(scene.materials, texels)
    suns = {index: lamp for index, lamp in enumerate(lamps.lamps) if isinstance(lamp, SunLamp)}
    suns = dict(islice(suns.items(), MOST_BEAMS))
    if not suns or not glossy.any():
        return (yield from direct_irradiance(lamps, texels, visibility, settings, groups)), None
    chosen = np.flatnonzero(glossy)
    others = lamps.of([index for index in range(len(lamps.lamps)) if index not in suns])
    share = 1 / (1 + len(suns))
    total = yield from scaled(direct_irradiance(others, texels, visibility, settings, groups), 0, share)
    found = []
    for done, (index, sun) in enumerate(suns.items(), 1):
        alone = direct_irradiance(lamps.of([index]), texels, visibility, settings, groups)
        light = yield from scaled(alone, done * share, (done + 1) * share)
        total += light
        found.append(light[chosen, sun.group])
    light = np.stack(found)
    lit = light.any(axis=(0, 2))
    row = np.full(texels.count, -1, np.int32)
    row[chosen[lit]] = np.arange(np.count_nonzero(lit), dtype=np.int32)
    towards = np.stack([sun.direction for sun in suns.values()])
    return total, Beams(row, light[:, lit], towards, tuple(sun.group for sun in suns.values()), scene.materials)


def _glossy(materials: tuple[Material, ...], texels: Texels) -> Bools:
    """(T,) bool: texels of materials with gloss."""
    glossy = np.array([bool(material.glosses) for material in materials] or [False])
    return np.asarray(texels.valid & glossy[texels.surfaces.material[texels.triangle[:]]])
