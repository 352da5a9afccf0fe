# SPDX-License-Identifier: GPL-3.0-or-later
"""Light with limits. All bounces are the default; Cycles may count them, and clamp bright samples.

The light of patches after all bounces, or after as many as a light group is allowed.

A lightmap of k bounces holds direct light and k reflections. The last gather reads what surfaces send out after k - 1
of them, and each gather before it one less, since its result is read by the next. Where nothing is reflected yet,
surfaces only show light of their own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import Float32, Float64
from ..chunks import Fractions
from ..geometry.by_triangle import ByTriangle
from ..scene import Scene
from ..settings import BakeSettings
from .illumination import Exitance, PatchLight
from .patches import Patches
from .relaxation import Solution
from .transport import Transport

NONE_REFLECTED = -1
"""Bounces at which surfaces only show light of their own."""


BLOCK = 1 << 14
"""Texels clamped in one go."""

TINY = np.float32(1e-30)

ENDLESS = 256
"""From this limit on there is none: of light that 0.99 is reflected of, 8 % are left."""


def bounce_limits(scene: Scene, settings: BakeSettings) -> tuple[int | None, ...]:
    """Most bounces of each light group: the lower of the scene's and the settings' limits, None where there is none."""
    own = 0 if settings.final_gather else 1  # patches then show what the gather would have added

    def lower(limit: int | None) -> int | None:
        given = [each for each in (limit, settings.bounces) if each is not None and each < ENDLESS]
        return min(given) + own if given else None

    return tuple(lower(scene.bounces.get(group)) for group in range(len(scene.groups)))


def clamped(irradiance: Float32, reflectance: Float32 | ByTriangle, limit: float) -> Float32:
    """Irradiance (T, G, 3) from lamps, W/m2, dimmed so that what is reflected of it is no brighter than `limit`.

    Cycles dims each light sample so, by the mean of its channels. What a lamp that is seen whole brings is such a
    sample, all alike: then this is exact. Where several lamps add up it is near; light that has been reflected more
    than once is dim enough to be left as it is.

    Args:
        reflectance: (T, 3)
        limit: W/(m2 sr), 0 for none
    """
    if not limit:
        return irradiance
    result = np.empty_like(irradiance)
    for start in range(0, len(irradiance), BLOCK):
        part = slice(start, start + BLOCK)
        total = np.abs(irradiance[part] * reflectance[part, None]).sum(axis=(1, 2))
        share = np.minimum(1, np.float32(3 * np.pi * limit) / np.maximum(total, TINY))
        result[part] = irradiance[part] * share[:, None, None]
    return result


def patch_light(
    transport: Transport,
    patches: Patches,
    exitance: Exitance,
    sky: Float64,
    solution: Solution,
    limits: Sequence[int | None],
    passes: int,
) -> Fractions[tuple[PatchLight, ...]]:
    """What each of `passes` gather passes reads; yields the share done.

    Args:
        sky: (N, 1 or G, 3), W/m2, irradiance from the sky
        solution: with all bounces, of the groups that have no limit; zeros in the others
        limits: most bounces of each group, None for all
    """
    unlimited = (solution.irradiance + sky).astype(np.float32), solution.radiosity.astype(np.float32)
    groups = np.array([group for group, limit in enumerate(limits) if limit is not None], np.int64)
    if not len(groups):
        return (PatchLight(*unlimited, np.ones(len(limits), bool)),) * passes
    last = np.array([limits[group] for group in groups], np.int64) - 1
    level = np.maximum(last - np.arange(passes - 1, -1, -1)[:, None], NONE_REFLECTED)  # (passes, limited groups)
    reflectance = patches.reflectance[:, None].astype(np.float64)
    own, first = exitance.own[:, groups], exitance.total[:, groups]
    sky = np.broadcast_to(sky, exitance.own.shape)[:, groups]
    result = []
    for row in level:
        reflecting = np.ones(len(limits), bool)
        reflecting[groups] = row >= 0
        result.append(PatchLight(unlimited[0].copy(), unlimited[1].copy(), reflecting))
        result[-1].irradiance[:, groups] = 0
        result[-1].radiosity[:, groups] = own
    leaving, steps = own, int(level.max(initial=NONE_REFLECTED)) + 1
    for bounce in range(steps):
        power = transport.gather(leaving.reshape(len(leaving), -1))
        received = transport.mixed(power / transport.area[:, None]).reshape(leaving.shape)
        leaving = first + reflectance * received
        for light, row in zip(result, level, strict=True):
            here = np.flatnonzero(row == bounce)
            light.irradiance[:, groups[here]] = (received + sky)[:, here]
            light.radiosity[:, groups[here]] = leaving[:, here]
        yield (bounce + 1) / steps
    return tuple(result)
