# SPDX-License-Identifier: GPL-3.0-or-later
"""Light between surfaces: texels are grouped into patches, which exchange light until none is left unshot."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bools, Float32, Float64, Int32
from ..chunks import Fractions, scaled
from ..geometry.appearance import Appearance
from ..geometry.opacity import Opacity
from ..geometry.sheets import Sheets
from ..geometry.texels import Texels
from ..geometry.visibility import Visibility
from ..geometry.walls import Walls
from ..lighting.lamp_samples import evenly_bent_share
from ..lighting.lights import Lamps
from ..lighting.sky import Sky
from ..scene import Scene
from ..settings import BakeSettings
from ..stages import Progress, StageLog
from .bounces import bounce_limits, patch_light
from .crossing import crossing_of
from .form_factor import trace_transport
from .illumination import Exitance, PatchLight, first_exitance, sky_irradiance
from .patches import Patches, group_patches
from .relaxation import Solution
from .solvers import SOLVERS
from .subdivision import split, steep_patches
from .transport import Transport


@dataclass(frozen=True, eq=False)
class Start:
    """Surfaces as they are before light passes between them.

    Attributes:
        scene: with positions relative to the surfaces' origin
        texels, walls: where light is received, and what parts it
        solid: (F,) bool, triangles without a back side
        look, opacity: how texels look, and what they stop
        sheets: those that light passes scattered; None: there are none
        lamps, sky: where light comes from
        direct: (T, G, 3) float32, W/m2, irradiance from lamps, of sheets mixed
    """

    scene: Scene
    texels: Texels
    walls: Walls
    solid: Bools
    look: Appearance
    opacity: Opacity | None
    sheets: Sheets | None
    lamps: Lamps
    sky: Sky | None
    direct: Float32


@dataclass(frozen=True, eq=False)
class Exchange:
    """The patches, their light as each gather pass reads it, and how the solver ended."""

    patches: Patches
    passes: tuple[PatchLight, ...]
    solution: Solution


def exchange_light(
    start: Start, aimed: int, visibility: Visibility, settings: BakeSettings, log: StageLog
) -> Generator[Progress, None, Exchange]:
    """Let light pass between about `aimed` patches; where it is asked for, patches are split and all is done again."""
    levels = None
    for number in range(settings.subdivisions + 1):
        aimed_now = max(1, aimed >> settings.subdivisions)
        exchange = yield from _exchange(start, aimed_now, levels, visibility, settings, log)
        if number < settings.subdivisions:
            patches, light = exchange.patches, exchange.passes[-1]
            steep = steep_patches(patches, start.look, start.direct, light.irradiance)
            levels = split(np.zeros(start.texels.count, np.int32) if levels is None else levels, patches, steep)
    return exchange


def _exchange(
    start: Start,
    aimed: int,
    levels: Int32 | None,
    visibility: Visibility,
    settings: BakeSettings,
    log: StageLog,
) -> Generator[Progress, None, Exchange]:
    scene, look, workers = start.scene, start.look, settings.workers
    glow, rear = np.pi * look.emission, None
    if look.behind is not None:
        rear = look.behind.reflectance, np.pi * look.behind.emission
    patches = group_patches(
        start.texels,
        start.walls,
        look.reflectance,
        glow,
        start.solid,
        aimed,
        visibility,
        workers,
        start.opacity,
        levels,
        rear,
    )
    transport = yield from log.stage("Transport", trace_transport(patches, visibility, settings, start.sky))
    transport = replace(transport, crossing=crossing_of(patches, start.sheets))
    sky = sky_irradiance(transport, scene)
    surfaces, bent = start.texels.surfaces, None
    if surfaces.bends:  # the light of other patches comes from all around
        bent = evenly_bent_share(surfaces.bend[start.texels.triangle[patches.any_texels()]])

    def between() -> Fractions[tuple[Solution, tuple[PatchLight, ...]]]:
        counted = sky if bent is None else sky * bent[:, None, None]
        asking = first_exitance(patches, look, start.direct, counted, start.lamps, visibility, len(scene.groups))
        exitance = yield from scaled(asking, 0, 0.3)
        dimmed = patches if bent is None else replace(patches, reflectance=patches.reflectance * bent[:, None])
        solving = _solve(log, transport, dimmed, exitance, sky, bounce_limits(scene, settings), settings)
        return (yield from scaled(solving, 0.3, 1))

    solution, passes = yield from log.stage("Radiosity", between())
    if bent is not None:
        passes = tuple(replace(each, irradiance=each.irradiance * bent[:, None, None]) for each in passes)
    return Exchange(patches, passes, solution)


def _solve(
    log: StageLog,
    transport: Transport,
    patches: Patches,
    exitance: Exitance,
    sky: Float64,
    limits: tuple[int | None, ...],
    settings: BakeSettings,
) -> Fractions[tuple[Solution, tuple[PatchLight, ...]]]:
    """Refine to the tolerance, the share done by the residual's decades; then the bounces that are counted."""
    endless = np.array([limit is None for limit in limits])[:, None]
    limit = {} if settings.most_steps is None else {"most_steps": settings.most_steps}
    steps = SOLVERS[settings.solver](transport, patches, exitance.total * endless, settings.tolerance, **limit)
    decades = -np.log(settings.tolerance)
    while True:
        try:
            log.residual = next(steps).residual
        except StopIteration as stop:
            solution: Solution = stop.value
            log.residual = solution.residuals[-1]
            break
        yield 0.9 * min(1.0, float(-np.log(max(log.residual, 1e-12)) / decades))
    if settings.ambient:
        solution = solution.with_ambient(patches.reflectance)
    counted = patch_light(transport, patches, exitance, sky, solution, limits, settings.steps.gather_passes)
    return solution, (yield from scaled(counted, 0.9, 1.0))
