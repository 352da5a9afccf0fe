# SPDX-License-Identifier: GPL-3.0-or-later
"""The main path of a bake, from scene records to pages; it reads like an abstract of the method."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np

from .appearance import Appearance, appearance_of
from .arrays import Bools, Float32, Float64, Int64
from .bounces import bounce_limits, clamped, patch_light
from .chunks import Fractions, scaled
from .errors import SceneError
from .form_factor import trace_transport
from .gather import final_gather
from .glow import glow_of
from .illumination import (
    Exitance,
    Illumination,
    PatchLight,
    cell_radiance,
    first_exitance,
    sky_irradiance,
    world_radiance,
)
from .lightmap import compose
from .lights import Lamps, direct_irradiance, lamps_of
from .opacity import opacity_of
from .patches import Patches, group_patches
from .radiosity import Solution
from .scene import Scene, SunLight
from .settings import BakeSettings
from .shading import Shader
from .sky import sky_of
from .solvers import SOLVERS
from .stages import Progress, Stage, StageLog
from .surfaces import Surfaces, flatten
from .texels import Texels, rasterize
from .transmittance import transmittance_of
from .transport import Transport
from .unwrap import Atlas, build_atlas
from .validity import solid_triangles, strata_inside
from .visibility import Visibility
from .walls import Walls, find_walls


@dataclass(frozen=True, eq=False)
class Baked:
    """What a bake leaves.

    Attributes:
        atlas: where each mesh lies
        pages: (S, S, 3) float32 each, W/(m2 sr), row 0 at v = 0: H / pi
        mesh_texels: (M,) texels of each mesh
        texels: covered texels on the pages
        patches: number of patches
        rays: all rays traced
        residual: unshot share of the emitted power when the solver stopped
    """

    atlas: Atlas
    pages: list[Float32]
    mesh_texels: Int64
    texels: int
    patches: int
    rays: int
    residual: float
    stages: tuple[Stage, ...]
    warnings: tuple[str, ...]


PAIRED_PATCHES = 1200
"""Patches where every pair is looked at: work grows with their square."""

LEAST_PATCHES = 2500
"""Patches of the smallest scenes: fewer would save no time worth having."""


def bake(scene: Scene, settings: BakeSettings, shade: Shader | None = None) -> Generator[Progress, None, Baked]:
    """Bake a scene. Closing the generator cancels the bake.

    Args:
        shade: tells how surfaces look whose materials vary; without it they have their constants all over

    Raises:
        BakeError: if the scene can't be baked
    """
    if not any(mesh.lightmapped and len(mesh.triangles) for mesh in scene.meshes):
        raise SceneError("Scene", "there is no surface to bake", "Add a mesh, or enable it for rendering")
    log = StageLog()
    atlas = yield from log.stage("Unwrap", build_atlas(scene, settings))
    surfaces = flatten(scene)
    scene = scene.moved(-surfaces.origin)
    transmittance = transmittance_of(scene, surfaces, shade, float(atlas.density.max(initial=0)))
    visibility = log.visibility = Visibility(surfaces.corners, transmittance, surfaces.offset)
    solid = solid_triangles(scene, surfaces, visibility)
    texels, walls = yield from log.stage("Texels", _valid_texels(atlas, surfaces, solid, visibility, settings))
    sky = sky_of(scene.world)
    suns = () if sky is None else sky.suns
    lamps, look, warnings = yield from log.stage("Materials", _looks(scene, atlas, texels, suns, shade))
    groups = len(scene.groups)
    direct = yield from log.stage("Direct light", direct_irradiance(lamps, texels, visibility, settings, groups))
    wanted = texels.pixel < atlas.page_count * atlas.size**2
    opacity = opacity_of(texels, transmittance)
    if opacity is not None:
        look = look.stopped(opacity)
    aimed, emission = _patches_for(wanted, settings), np.pi * look.emission
    patches = group_patches(
        texels, walls, look.reflectance, emission, solid, aimed, visibility, settings.workers, opacity
    )
    transport = yield from log.stage("Transport", trace_transport(patches, visibility, settings, sky))
    from_sky = sky_irradiance(transport, scene)
    exitance = first_exitance(patches, look, direct, from_sky, lamps, visibility, groups)
    between = _light_between(log, transport, patches, exitance, from_sky, bounce_limits(scene, settings), settings)
    solution, passes = yield from log.stage("Radiosity", between)
    bounced = clamped(direct, look.reflectance, settings.clamp_indirect)
    light = Illumination(
        look=look, direct=bounced, passes=passes, world=world_radiance(scene), sky=cell_radiance(sky, scene)
    )
    if settings.final_gather:
        indirect = yield from log.stage("Gather", final_gather(texels, patches, light, wanted, visibility, settings))
    else:
        indirect = light.irradiance_of_patches(patches)
    light_of_lamps = clamped(direct, look.reflectance, settings.clamp_direct)
    pages = yield from log.stage("Pages", _pages(texels, light_of_lamps + indirect, atlas))
    warnings = (*scene.warnings, *atlas.warnings, *warnings)
    if not solution.converged and settings.most_steps is None:
        warnings += (f"The solver stopped with {log.residual:.2%} of the light unshot; lower albedos near 1",)
    return Baked(
        atlas=atlas,
        pages=pages,
        mesh_texels=np.bincount(surfaces.mesh[texels.triangle[:, 0]], minlength=len(scene.meshes)),
        texels=int(np.count_nonzero(wanted)),
        patches=patches.count,
        rays=visibility.rays,
        residual=log.residual,
        stages=tuple(log.stages),
        warnings=warnings,
    )


def _valid_texels(
    atlas: Atlas, surfaces: Surfaces, solid: Bools, visibility: Visibility, settings: BakeSettings
) -> Fractions[tuple[Texels, Walls]]:
    texels = yield from scaled(rasterize(atlas, surfaces, settings.workers), 0.0, 0.5)
    inside = yield from scaled(strata_inside(texels, solid, visibility, settings.workers), 0.5, 0.8)
    texels = texels.without(inside)
    walls = yield from scaled(find_walls(texels, visibility, settings.workers), 0.8, 1.0)
    return texels, walls


def _looks(
    scene: Scene, atlas: Atlas, texels: Texels, suns: Sequence[SunLight], shade: Shader | None
) -> Fractions[tuple[Lamps, Appearance, tuple[str, ...]]]:
    """What shines as a lamp, how all else looks, and warnings about what can't be as it is shown."""
    yield 0.0
    glow, said = glow_of(scene, texels.surfaces, shade)
    lamps = lamps_of(scene, texels.surfaces, suns, glow)
    look, warnings = yield from scaled(appearance_of(scene, atlas, texels, lamps.sampled, shade), 0.3, 1.0)
    return lamps, look, said + warnings


def _patches_for(wanted: Bools, settings: BakeSettings) -> int:
    """Patches to aim at: their light is smooth, so their number grows slower than that of texels."""
    if settings.form_factors == "area":
        return PAIRED_PATCHES
    return max(LEAST_PATCHES, int(settings.steps.patches * np.sqrt(np.count_nonzero(wanted) / 1e6)))


def _light_between(
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


def _pages(texels: Texels, irradiance: Float32, atlas: Atlas) -> Fractions[list[Float32]]:
    yield 0.0
    return compose(texels, irradiance, atlas.page_count)
