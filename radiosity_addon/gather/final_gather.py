# SPDX-License-Identifier: GPL-3.0-or-later
"""The final gather: from the patches' solution to smooth indirect irradiance at every texel.

Rays from sparse points read the light that texels send out: direct light sharp, indirect light from the patches.
The rays are kept; a second pass over the same hits reads the indirect light of the first, which removes the patches'
steps from corners. All light groups and channels are further columns of the same sums.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import Bools, Float32, Int32
from ..chunks import Fractions, scaled
from ..geometry.sheets import Sheets
from ..geometry.texels import Texels
from ..geometry.visibility import Visibility
from ..radiosity.illumination import Illumination
from ..radiosity.patches import Patches
from ..settings import BakeSettings
from .far_light import FAR, smooth_far_light
from .gather_points import RESOLVED, coarsest_width, part_at_walls, place_points
from .gather_rays import GatherRays
from .gleams import Gleams
from .irradiance_fit import fit_irradiance
from .neighbours import find_neighbours


def final_gather(
    texels: Texels,
    patches: Patches,
    light: Illumination,
    wanted: Bools,
    visibility: Visibility,
    settings: BakeSettings,
    gathered: Callable[[Float32, Int32], None] | None = None,
    sheets: Sheets | None = None,
) -> Fractions[Float32]:
    """Indirect irradiance, W/m2, (T, G, 3) float32, at the texels `wanted` (T,), of sheets mixed.

    Args:
        gathered: is told what gather points received, (P, 3 G), and which of them stands for each texel, (T,), after
            each pass
        sheets: those that light passes scattered; None: there are none
    """
    steps, workers = settings.steps, settings.workers
    lit = wanted & texels.valid
    extent = float(texels.area[lit].sum(dtype=np.float64))
    texel_width = float(np.sqrt(extent / max(1, int(np.count_nonzero(lit & (texels.area > 0)))))) or 1.0
    aimed = min(steps.gather_points, max(1.0, np.count_nonzero(lit) / steps.gather_spacing**2))
    base = coarsest_width(max(float(np.sqrt(extent / aimed)), 1e-9), texel_width)
    gleams = None if light.beams is None else Gleams(light.beams, texels, light.direct.shape[1])
    bright = yield from scaled(light.brightness(patches, workers, settings.light_groups), 0.0, 0.0)
    near_to = RESOLVED * texel_width
    rays = GatherRays(texels, patches, visibility, settings, bright, gleams, FAR * base, near_to)
    del bright
    placing = place_points(texels, lit, base, steps.gather_split, texel_width, rays, workers)
    points = yield from scaled(placing, 0.0, 0.3)
    points = yield from scaled(part_at_walls(points, texels, patches.walls, rays, visibility, workers), 0.3, 0.3)
    tally = yield from scaled(rays.tally(points, base), 0.3, 0.6)
    irradiance = np.zeros((points.count, 0), np.float32)
    for number in range(len(light.passes)):
        low, high = (0.6 + 0.1 * each / len(light.passes) for each in (number, number + 1))
        known = irradiance if number else None
        if known is not None and sheets is not None:
            known = sheets.mix_points(known, points.texel, points.cell)
        table = yield from scaled(light.radiance(number, patches, workers, known, points.cell), low, low)
        irradiance, far = yield from scaled(tally.sum(table, workers), low, high)
        if tally.gleams is not None:
            irradiance += tally.gleams * np.repeat(light.passes[number].reflecting, 3)
        del table
        if gathered is not None:
            gathered(irradiance, points.cell)
    del tally
    neighbours = yield from scaled(find_neighbours(texels, points, visibility, workers), 0.7, 0.8)
    smoothing = smooth_far_light(irradiance, far, texels, points, neighbours, workers)
    irradiance = yield from scaled(smoothing, 0.8, 0.8)
    fitting = fit_irradiance(texels, points, neighbours, irradiance, visibility, texel_width, workers)
    fitted = (yield from scaled(fitting, 0.8, 1.0)).reshape(texels.count, -1, 3)
    return fitted if sheets is None else sheets.mix(fitted)
