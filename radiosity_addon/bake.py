# SPDX-License-Identifier: GPL-3.0-or-later
"""The main path of a bake, from scene records to pages; it reads like an abstract of the method."""

from __future__ import annotations

import time
from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from .arrays import Bools, Float32, Float64, Int32, Int64
from .chunks import Fractions, scaled
from .errors import SceneError
from .form_factor import Transport, trace_transport
from .gather import Illumination, final_gather
from .lightmap import compose
from .lights import Lamps, direct_irradiance, irradiance_at, lamps_of
from .patches import Patches, group_patches
from .radiosity import Solution, refine
from .scene import Scene
from .settings import BakeSettings
from .surfaces import Surfaces, flatten
from .texels import Texels, rasterize
from .unwrap import Atlas, build_atlas
from .validity import solid_triangles, strata_inside
from .visibility import Visibility

T = TypeVar("T")


@dataclass(frozen=True)
class Progress:
    """How far a bake is.

    Attributes:
        stage: what is being done
        fraction: of the whole bake, 0..1, an estimate
        residual: unshot share of the emitted power, once known; 1 before
        rays: traced so far
    """

    stage: str
    fraction: float
    residual: float = 1.0
    rays: int = 0


@dataclass(frozen=True)
class Stage:
    """A finished stage: its name, seconds it took and rays it traced."""

    name: str
    seconds: float
    rays: int


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


STAGES = {
    "Unwrap": 0.1,
    "Texels": 0.06,
    "Direct light": 0.28,
    "Transport": 0.14,
    "Radiosity": 0.05,
    "Gather": 0.34,
    "Pages": 0.03,
}
"""Stages and their usual shares of the time."""

LEAST_PATCHES = 2500
"""Patches of the smallest scenes: fewer would save no time worth having."""

BACK_SAMPLES = 4
"""Points at which the direct light on the back of a patch is taken."""


def bake(scene: Scene, settings: BakeSettings) -> Generator[Progress, None, Baked]:
    """Bake a scene. Closing the generator cancels the bake.

    Raises:
        BakeError: if the scene can't be baked
    """
    if not any(mesh.lightmapped and len(mesh.triangles) for mesh in scene.meshes):
        raise SceneError("Scene", "there is no surface to bake", "Add a mesh, or enable it for rendering")
    log = _Log()
    atlas = yield from log.stage("Unwrap", build_atlas(scene, settings))
    surfaces = flatten(scene)
    scene = scene.moved(-surfaces.origin)
    visibility = log.visibility = Visibility(surfaces.corners)
    solid = solid_triangles(scene, surfaces, visibility)
    texels = yield from log.stage("Texels", _valid_texels(atlas, surfaces, solid, visibility, settings))
    lamps = lamps_of(scene, surfaces)
    groups = len(scene.groups)
    direct = yield from log.stage("Direct light", direct_irradiance(lamps, texels, visibility, settings, groups))
    look = _appearance(scene, texels, lamps.sampled)
    wanted = texels.pixel < atlas.page_count * atlas.size**2
    patches = group_patches(texels, look.reflectance, np.pi * look.emission, solid, _patches_for(wanted, settings))
    transport = yield from log.stage("Transport", trace_transport(patches, visibility, settings))
    sky = transport.sky[:, None, None] * np.pi * _world(scene)
    exitance = _first_exitance(patches, look, direct, sky, lamps, visibility, groups)
    solution = yield from log.stage("Radiosity", _solve(log, transport, patches, exitance, settings))
    light = Illumination(
        reflectance=look.reflectance,
        emission=look.emission,
        emission_group=look.group,
        direct=direct,
        patch_irradiance=(solution.irradiance + sky).astype(np.float32),
        patch_radiosity=solution.radiosity.astype(np.float32),
        world=_world(scene),
    )
    indirect = yield from log.stage("Gather", final_gather(texels, patches, light, wanted, visibility, settings))
    pages = yield from log.stage("Pages", _pages(texels, direct + indirect, atlas))
    warnings = list(scene.warnings) + list(atlas.warnings)
    if not solution.converged:
        warnings.append(f"The solver stopped with {log.residual:.2%} of the light unshot; lower albedos near 1")
    return Baked(
        atlas=atlas,
        pages=pages,
        mesh_texels=np.bincount(surfaces.mesh[texels.triangle[:, 0]], minlength=len(scene.meshes)),
        texels=int(np.count_nonzero(wanted)),
        patches=patches.count,
        rays=visibility.rays,
        residual=log.residual,
        stages=tuple(log.stages),
        warnings=tuple(warnings),
    )


class _Log:
    """Where a bake is, and what its stages took."""

    def __init__(self) -> None:
        self.stages: list[Stage] = []
        self.visibility: Visibility | None = None
        self.residual = 1.0
        self._before = 0.0
        self._start = time.perf_counter()
        self._rays = 0

    @property
    def rays(self) -> int:
        return self.visibility.rays if self.visibility else 0

    def stage(self, name: str, steps: Generator[float, None, T]) -> Generator[Progress, None, T]:
        """Run a stage; its time is all that passed since the last one ended."""
        share, done = STAGES[name], 0.0
        try:
            yield Progress(name, self._before, self.residual, self.rays)
            while True:
                try:
                    done = max(done, next(steps))
                except StopIteration as stop:
                    result: T = stop.value
                    break
                yield Progress(name, self._before + share * min(done, 1.0), self.residual, self.rays)
        finally:
            steps.close()
        self._before += share
        now = time.perf_counter()
        self.stages.append(Stage(name, now - self._start, self.rays - self._rays))
        self._start, self._rays = now, self.rays
        return result


@dataclass(frozen=True, eq=False)
class _Appearance:
    """Reflectance (T, 3), radiance (T, 3) of emitters that are not sampled as lamps, and its light group (T,)."""

    reflectance: Float32
    emission: Float32
    group: Int32


def _appearance(scene: Scene, texels: Texels, sampled: Bools) -> _Appearance:
    triangle = texels.triangle[:, 0]
    material = texels.surfaces.material[triangle]
    emission = np.array([entry.emission for entry in scene.materials], np.float32)[material]
    emission[sampled[triangle]] = 0
    return _Appearance(
        reflectance=np.array([entry.reflectance for entry in scene.materials], np.float32)[material],
        emission=emission,
        group=np.array([entry.group for entry in scene.materials], np.int32)[material],
    )


def _valid_texels(
    atlas: Atlas, surfaces: Surfaces, solid: Bools, visibility: Visibility, settings: BakeSettings
) -> Fractions[Texels]:
    texels = yield from scaled(rasterize(atlas, surfaces, settings.workers), 0.0, 0.6)
    inside = yield from scaled(strata_inside(texels, solid, visibility, settings.workers), 0.6, 1.0)
    return texels.without(inside)


def _patches_for(wanted: Bools, settings: BakeSettings) -> int:
    """Patches to aim at: their light is smooth, so their number grows slower than that of texels."""
    return max(LEAST_PATCHES, int(settings.steps.patches * np.sqrt(np.count_nonzero(wanted) / 1e6)))


def _world(scene: Scene) -> Float32:
    """Radiance (G, 3) of the world in each light group."""
    radiance = np.zeros((len(scene.groups), 3), np.float32)
    radiance[scene.world.group] = scene.world.radiance
    return radiance


def _first_exitance(
    patches: Patches,
    look: _Appearance,
    direct: Float32,
    sky: Float64,
    lamps: Lamps,
    visibility: Visibility,
    groups: int,
) -> Float64:
    """What each patch sends out before any bounce (N, G, 3), W/m2: own light, and reflected light of lamps and sky."""
    exitance = patches.mean(direct * look.reflectance[:, None, :])
    backs = np.flatnonzero(patches.sides < 0)
    received = np.zeros((len(backs), groups, 3))
    for sample in range(BACK_SAMPLES):
        points, normals = patches.origins(backs, np.full(len(backs), sample))
        received += irradiance_at(
            lamps, points, normals, visibility, BACK_SAMPLES, backs * BACK_SAMPLES + sample, groups
        )
    exitance[backs] = received / BACK_SAMPLES * patches.reflectance[backs, None, :]
    exitance += sky * patches.reflectance[:, None, :]
    emitted = patches.emission > 0
    group = np.zeros(patches.count, np.int32)
    front = patches.of_element[: patches.texels.count]
    group[front[front >= 0]] = look.group[front >= 0]
    back = patches.back
    group[back[back >= 0]] = look.group[back >= 0]
    exitance[np.arange(patches.count), group] += np.where(emitted, patches.emission, 0)
    return exitance


def _solve(
    log: _Log, transport: Transport, patches: Patches, exitance: Float64, settings: BakeSettings
) -> Fractions[Solution]:
    """Refine to the tolerance; the share done is that of the residual's decades."""
    steps = refine(transport, patches, exitance, settings.tolerance)
    decades = -np.log(settings.tolerance)
    while True:
        try:
            log.residual = next(steps).residual
        except StopIteration as stop:
            solution: Solution = stop.value
            log.residual = solution.residuals[-1]
            return solution
        yield min(1.0, float(-np.log(max(log.residual, 1e-12)) / decades))


def _pages(texels: Texels, irradiance: Float32, atlas: Atlas) -> Fractions[list[Float32]]:
    yield 0.0
    return compose(texels, irradiance, atlas.page_count)
