# SPDX-License-Identifier: GPL-3.0-or-later
"""The main path of a bake, from scene records to pages; it reads like an abstract of the method."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from .arrays import Bools, Float32, Int32, Int64
from .atlas.unwrap import Atlas, build_atlas
from .chunks import Fractions, scaled, while_aside
from .errors import SceneError
from .gather.final_gather import final_gather
from .gather.own_error import OwnError, own_error
from .geometry.appearance import Appearance, appearance_of
from .geometry.opacity import opacity_of
from .geometry.sheets import Sheets, sheets_of
from .geometry.sides import with_backs
from .geometry.surfaces import Surfaces, flatten
from .geometry.texels import Texels, rasterize
from .geometry.validity import solid_triangles, strata_inside
from .geometry.visibility import Visibility, visibility_of
from .geometry.walls import Walls, find_walls
from .lighting.beams import direct_light
from .lighting.glow import glow_of
from .lighting.lights import Lamps, lamps_of
from .lighting.sky import sky_of
from .pages.lightmap import compose, show_fronts
from .radiosity.bounces import bounce_limits, clamped
from .radiosity.exchange import Start, exchange_light
from .radiosity.facing import looking_away
from .radiosity.first_light import FirstLight
from .radiosity.illumination import (
    Illumination,
    cell_radiance,
    world_radiance,
)
from .radiosity.patches import NOTHING
from .radiosity.relaxation import Balance
from .radiosity.subdivision import patch_edges
from .scene import Scene, SunLight
from .settings import BakeSettings
from .shading import Shader
from .stages import STAGES, Progress, Stage, StageLog
from .viewing import LiveLight, Satisfied, Viewer, show_first_light


@dataclass(frozen=True, eq=False)
class Baked:
    """What a bake leaves.

    Attributes:
        atlas: where each mesh lies
        pages: (S, S, 3) float32 each, W/(m2 sr), row 0 at v = 0: H / pi
        mesh_texels: (M,) texels of each mesh
        texels: covered texels on the pages
        patches: number of patches; 0 if the bake was ended before there were any
        rays: all rays traced
        residual: unshot share of the emitted power when the solver stopped
        residuals: the same at the start and after every step
        error: what the pages' light errs by, as a check of some texels found; None where there was none
        balance: where the light between patches has gone; None if none went
        elements: the texels, those of hidden pages after the others
        patch: (T,) int32, patch of each texel, negative for none
        ended_in: the stage in which the viewer was satisfied; "" if the bake went to its end
        apart: of each light group, by name, `pages` with its light alone; empty unless asked for
    """

    atlas: Atlas
    pages: list[Float32]
    mesh_texels: Int64
    texels: int
    patches: int
    rays: int
    residual: float
    residuals: tuple[float, ...]
    error: OwnError | None
    balance: Balance | None
    elements: Texels
    patch: Int32
    stages: tuple[Stage, ...]
    warnings: tuple[str, ...]
    ended_in: str = ""
    apart: Mapping[str, list[Float32]] = field(default_factory=dict)


PAIRED_PATCHES = 1200
"""Patches where every pair is looked at: work grows with their square."""

EDGE_SHADE = 0.3
"""Of their light, what texels at the edges of patches show where patches are to be seen."""

LEAST_PATCHES = 2500
"""Patches of the smallest scenes: fewer would save no time worth having."""


def bake(
    scene: Scene,
    settings: BakeSettings,
    shade: Shader | None = None,
    viewer: Viewer | None = None,
    shares: Mapping[str, float] = STAGES,
) -> Generator[Progress, None, Baked]:
    """Bake a scene. Closing the generator cancels the bake.

    Args:
        shade: tells how surfaces look whose materials vary; without it they have their constants all over
        viewer: sees the light while it becomes better, and may end the bake with what there is
        shares: of the time, that stages are expected to take

    Raises:
        BakeError: if the scene can't be baked
    """
    if not any(mesh.lightmapped and len(mesh.triangles) for mesh in scene.meshes):
        raise SceneError("Scene", "there is no surface to bake", "Add a mesh, or enable it for rendering")
    log = StageLog(shares)
    every_side = with_backs(scene)
    atlas, first = yield from log.stage("Unwrap", _places(every_side, settings, viewer))
    surfaces = flatten(every_side)
    fronts = surfaces.without_backs()
    scene = scene.moved(-surfaces.origin)
    visibility = yield from log.stage("Transparency", _visibility(scene, fronts, atlas, shade))
    log.visibility = visibility
    solid = np.zeros(surfaces.count, bool)
    solid[: fronts.count] = solid_triangles(scene, fronts, visibility)
    texels, walls = yield from log.stage("Texels", _valid_texels(atlas, surfaces, solid, visibility, settings))
    sky = sky_of(scene.world)
    suns = () if sky is None else sky.suns
    lamps, look, warnings = yield from log.stage("Materials", _looks(scene, atlas, texels, solid, suns, shade))
    wanted = texels.pixel < atlas.page_count * atlas.size**2
    sheets = sheets_of(scene.materials, texels, look)
    live = LiveLight(viewer, first, atlas, texels, look)
    log.viewer, exchange, error, ended_in = viewer, None, None, ""
    try:
        lighting = direct_light(lamps, texels, scene, visibility, settings)
        direct, beams = yield from log.stage("Direct light", lighting)
        if sheets is not None:
            sheets.mix(direct)
        live.update(direct=lambda: direct)
        opacity = opacity_of(texels, visibility.transmittance)
        if opacity is not None:
            look = look.stopped(opacity)
        start = Start(scene, texels, walls, solid, look, opacity, sheets, lamps, sky, direct)
        exchange = yield from exchange_light(start, _patches_for(wanted, settings), visibility, settings, log)
        patches = exchange.patches
        light = Illumination(
            look=look,
            direct=clamped(direct, look.reflectance, settings.clamp_indirect),
            passes=exchange.passes,
            world=world_radiance(scene),
            sky=cell_radiance(sky, scene),
            beams=None if settings.clamp_indirect else beams,
        )
        if settings.final_gather:
            live.exchanged(lambda: light.irradiance_of_patches(patches))
            gather = final_gather(texels, patches, light, wanted, visibility, settings, live.gathered, sheets)
            indirect = yield from log.stage("Gather", gather)
        else:
            indirect = light.irradiance_of_patches(patches)
        live.update(indirect=partial(np.asarray, indirect))
        log.viewer = None  # the light is there
        counted = any(limit is not None for limit in bounce_limits(scene, settings))
        check = own_error(
            texels,
            patches,
            light,
            lamps,
            direct,
            indirect,
            counted,
            _one_sided(wanted, sheets),
            visibility,
            settings.workers,
        )
        error = yield from log.stage("Check", check)
        irradiance = clamped(direct, look.reflectance, settings.clamp_direct)
        irradiance += indirect
        del indirect
    except Satisfied as stage:
        irradiance, ended_in = live.irradiance(), str(stage)
    if settings.show_patches and exchange is not None:
        irradiance[patch_edges(exchange.patches)] *= EDGE_SHADE
    log.viewer = None
    show_fronts(irradiance, walls.behind)
    pages = yield from log.stage("Pages", _pages(texels, irradiance, atlas))
    apart: dict[str, list[Float32]] = {}
    if settings.light_groups and not ended_in and len(set(scene.groups)) > 1:
        apart = yield from log.stage("Pages", _pages_apart(scene.groups, texels, irradiance, atlas))
    warnings = (*scene.warnings, *atlas.warnings, *warnings)
    if exchange is not None:
        warnings += looking_away(exchange.patches, exchange.solution.radiosity, every_side)
        if not exchange.solution.converged and settings.most_steps is None:
            warnings += (f"The solver stopped with {log.residual:.2%} of the light unshot; lower albedos near 1",)
    if ended_in:
        warnings += (f"The bake was stopped by hand in stage {ended_in}: its light is coarse",)
    return Baked(
        atlas=atlas,
        pages=pages,
        mesh_texels=np.bincount(surfaces.mesh[texels.triangle[:]], minlength=len(every_side.meshes)),
        texels=int(np.count_nonzero(wanted)),
        patches=exchange.patches.count if exchange is not None else 0,
        rays=visibility.traced,
        residual=log.residual,
        residuals=exchange.solution.residuals if exchange is not None else (),
        balance=exchange.solution.balance if exchange is not None else None,
        error=error,
        elements=texels,
        patch=exchange.patches.of_element[: texels.count]
        if exchange is not None
        else np.full(texels.count, NOTHING, np.int32),
        stages=tuple(log.stages),
        warnings=warnings,
        ended_in=ended_in,
        apart=apart,
    )


def _places(
    scene: Scene, settings: BakeSettings, viewer: Viewer | None
) -> Generator[float, None, tuple[Atlas, FirstLight | None]]:
    """Where surfaces lie; a viewer gets something to see before, and more of it while charts are made."""
    if viewer is None:
        return (yield from build_atlas(scene, settings)), None
    showing = show_first_light(scene, viewer)
    while not next(showing):
        yield 0.0
    return (yield from while_aside(build_atlas(scene, settings), showing))


def _visibility(scene: Scene, surfaces: Surfaces, atlas: Atlas, shade: Shader | None) -> Fractions[Visibility]:
    yield 0.0
    return visibility_of(scene, surfaces, shade, float(atlas.density.max(initial=0)))


def _valid_texels(
    atlas: Atlas, surfaces: Surfaces, solid: Bools, visibility: Visibility, settings: BakeSettings
) -> Fractions[tuple[Texels, Walls]]:
    texels = yield from scaled(rasterize(atlas, surfaces, settings.workers), 0.0, 0.5)
    inside = yield from scaled(strata_inside(texels, solid, visibility, settings.workers), 0.5, 0.8)
    texels = texels.without(inside)
    walls = yield from scaled(find_walls(texels, visibility, settings.workers), 0.8, 1.0)
    return texels, walls


def _looks(
    scene: Scene, atlas: Atlas, texels: Texels, solid: Bools, suns: Sequence[SunLight], shade: Shader | None
) -> Fractions[tuple[Lamps, Appearance, tuple[str, ...]]]:
    """What shines as a lamp, how all else looks, and warnings about what can't be as it is shown."""
    yield 0.0
    fronts = texels.surfaces.without_backs()
    glow, said = glow_of(scene, fronts, shade)
    lamps = lamps_of(scene, fronts, suns, glow)
    sampled = lamps.sampled[texels.surfaces.front]
    look, warnings = yield from scaled(appearance_of(scene, atlas, texels, sampled, shade, solid), 0.3, 1.0)
    return lamps, look, said + warnings


def _one_sided(wanted: Bools, sheets: Sheets | None) -> Bools:
    """Texels whose light is that of one side."""
    if sheets is None:
        return wanted
    alone = wanted.copy()
    alone[sheets.texel] = False
    return alone


def _patches_for(wanted: Bools, settings: BakeSettings) -> int:
    """Patches to aim at: their light is smooth, so their number grows slower than that of texels."""
    if settings.form_factors == "area":
        return PAIRED_PATCHES
    return max(LEAST_PATCHES, int(settings.steps.patches * np.sqrt(np.count_nonzero(wanted) / 1e6)))


def _pages(texels: Texels, irradiance: Float32, atlas: Atlas) -> Fractions[list[Float32]]:
    yield 0.0
    return compose(texels, irradiance, atlas.page_count)


def _pages_apart(
    names: Sequence[str], texels: Texels, irradiance: Float32, atlas: Atlas
) -> Fractions[dict[str, list[Float32]]]:
    """Pages of each light group; groups that differ in the number of their bounces only are one."""
    pages: dict[str, list[Float32]] = {}
    for name in dict.fromkeys(names):
        yield len(pages) / len(names)
        members = [index for index, each in enumerate(names) if each == name]
        pages[name] = compose(texels, irradiance[:, members], atlas.page_count)
    return pages
