# SPDX-License-Identifier: GPL-3.0-or-later
"""What looks wrong in a scene before it is baked, as far as its records tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from .arrays import Bools
from .atlas.charts import measure
from .atlas.folds import FINEST, MOST_TURN, Folds
from .atlas.kept_uv import UvMapError, kept_uv
from .estimate import too_large
from .geometry.surfaces import Surfaces, flatten
from .scene import Mesh, Scene, SunLight
from .settings import BakeSettings

DOMINANT = 0.8
"""Share of the lightmap from which on one object leaves too little to all others."""

FAR = 4.0
"""Times larger than all else together: no wall of a room is, a ground plane up to the horizon is."""

WHOLE = 0.999
"""Share of an object's area from which on it is all of it."""

FULL = 0.5
"""Share of its box that a room modelled as one closed shell encloses; walls with a thickness fill less."""

BLOTCHY = math.radians(30)
"""A normal that turns so far within a texel: 3.4 % of light that goes with its cosine is lost, see `atlas.folds`."""

SEEN = 0.01
"""Share of all texels from which on an object's folds are worth a word."""

MENDED_BY = 4.0
"""Greatest density to advise: what folds within less than a texel looks like a line, not like blotches."""

Severity = Literal["error", "warning", "info"]


@dataclass(frozen=True)
class Finding:
    """Something worth knowing before a bake.

    Attributes:
        severity: error: it can't be baked so; warning: it will look wrong; info: it may be meant so
        text: a sentence, or more of them, without a full stop at the end
        subject: name of the object that it is about, "" for the scene
        inside_out: flipping the normals of the whole object mends it
    """

    severity: Severity
    text: str
    subject: str = ""
    inside_out: bool = False


def check(scene: Scene, settings: BakeSettings) -> list[Finding]:
    """All that is found, in no order of importance."""
    folds = Folds.of(scene.meshes, settings)
    areas = lit_areas(folds.finer(scene.meshes))
    too_dense = [
        Finding("error", f"{name} is too large for a page at this density; lower it, or choose larger pages", name)
        for name in too_large(areas, settings)
    ]
    return [
        *_kept_maps(scene),
        *too_dense,
        *_dominant(scene, areas, settings),
        *_inside_out(scene),
        *_coarse_folds(scene.meshes, folds, settings),
    ]


def lit_areas(meshes: Sequence[Mesh]) -> list[tuple[str, float]]:
    """Of each mesh with a lightmap its name and its area, m2, times its density multiplier squared, of both sides."""
    return [
        (mesh.name, _area(mesh) * mesh.density**2 * (2 if mesh.two_sided else 1))
        for mesh in meshes
        if mesh.lightmapped and len(mesh.triangles)
    ]


def shining_faces(scene: Scene) -> int:
    """How many triangles emit light."""
    shines = np.array([any(material.emission) for material in scene.materials], bool)
    shines |= shines[scene.behind]
    return sum(int(shines[mesh.material].sum()) for mesh in scene.meshes if len(mesh.material))


def _area(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _kept_maps(scene: Scene) -> list[Finding]:
    """Uv maps that are to be kept and can't be."""
    found: dict[str, Finding] = {}
    for mesh in scene.meshes:
        if mesh.uv is None or mesh.chart is not None or not mesh.lightmapped or mesh.name in found:
            continue
        corners = mesh.vertices[mesh.triangles]
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        radius = np.full(len(corners), np.linalg.norm(high - low) / 2)
        try:
            kept_uv(mesh, *measure(corners - (low + high) / 2, radius))
        except UvMapError as error:
            text = f"{mesh.name}: {error.cause}; repair the map, or let the object be unwrapped anew"
            found[mesh.name] = Finding("error", text, mesh.name)
    return list(found.values())


def _dominant(scene: Scene, areas: Sequence[tuple[str, float]], settings: BakeSettings) -> list[Finding]:
    """A ground that reaches far beyond all else, and takes nearly all of the page that they share."""
    total = sum(area for _, area in areas)
    of: dict[str, float] = {}
    for name, area in areas:
        of[name] = of.get(name, 0.0) + area
    largest = max(of, key=lambda name: of[name], default="")
    if settings.density is not None or len(of) < 2 or of[largest] <= DOMINANT * total:
        return []
    own = [mesh for mesh in scene.meshes if mesh.name == largest and len(mesh.triangles)]
    others = [mesh for mesh in scene.meshes if mesh.name != largest and len(mesh.triangles)]
    if _extent(own) <= FAR * _extent(others):
        return []
    share = f"{of[largest] / total:.0%} of the lightmap"
    text = f"{largest} reaches far beyond all else and takes {share}; a lower density leaves more to others"
    return [Finding("info", text, largest)]


def _coarse_folds(meshes: Sequence[Mesh], folds: Folds, settings: BakeSettings) -> list[Finding]:
    """Surfaces of some size whose folds are too narrow for their texels, even if those become finer by themselves."""
    advised = folds.turn / MOST_TURN / (FINEST if settings.fine_folds else 1.0)
    large = folds.texels >= SEEN * folds.texels.sum()
    found: dict[str, Finding] = {}
    for index in np.flatnonzero(large & (folds.left > BLOTCHY)).tolist():
        name, density = meshes[index].name, meshes[index].density * float(advised[index])
        if density > MENDED_BY:
            continue
        turn = f"{math.degrees(folds.left[index]):.0f} degrees within a texel, too far to look smooth"
        ways = "" if settings.fine_folds else "turn on Finer Folds, or "
        remedy = f"{ways}set its Density to {density:.1f}, or choose larger pages"
        found.setdefault(name, Finding("info", f"{name}: its folds turn by {turn}; {remedy}", name))
    return list(found.values())


def _extent(meshes: Sequence[Mesh]) -> float:
    """Diagonal of the box around them, m."""
    low = np.min([mesh.vertices.min(axis=0) for mesh in meshes], axis=0)
    high = np.max([mesh.vertices.max(axis=0) for mesh in meshes], axis=0)
    return float(np.linalg.norm(high - low))


def _inside_out(scene: Scene) -> list[Finding]:
    """Closed surfaces whose lightmaps would show the side that nobody sees."""
    surfaces = flatten(scene)
    bad = _seen_from_behind(scene, surfaces)
    area = np.bincount(surfaces.mesh, surfaces.area, minlength=len(scene.meshes))
    wrong = np.bincount(surfaces.mesh, surfaces.area * bad[surfaces.component], minlength=len(scene.meshes))
    found: dict[str, Finding] = {}
    for index in np.flatnonzero(wrong > 0):
        mesh = scene.meshes[index]
        if not mesh.lightmapped or mesh.two_sided or mesh.name in found:
            continue
        whole = bool(wrong[index] > WHOLE * area[index])
        part = "its faces" if whole else "some of its faces"
        text = f"{mesh.name}: {part} point away from where they are seen; flip their normals, or set it two-sided"
        found[mesh.name] = Finding("warning", text, mesh.name, inside_out=whole)
    return list(found.values())


def _seen_from_behind(scene: Scene, surfaces: Surfaces) -> Bools:
    """(C,) bool: components that are closed and turned the wrong way.

    Solids that face inward, unless they are the hollow of another solid of their mesh or a room with something in it;
    and rooms that face outward: full boxes with a lamp and most other objects in them.
    """
    count = int(surfaces.component.max(initial=-1)) + 1
    corners = surfaces.corners.astype(np.float64)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, surfaces.component, corners.min(axis=1))
    np.maximum.at(high, surfaces.component, corners.max(axis=1))
    a, b, c = np.moveaxis(corners, 1, 0)
    volume = np.bincount(surfaces.component, np.einsum("fi,fi->f", a, np.cross(b, c)) / 6, minlength=count)
    closed, mesh = np.zeros(count, bool), np.zeros(count, np.int64)
    closed[surfaces.component], mesh[surfaces.component] = surfaces.closed, surfaces.mesh
    origins = [np.asarray(light.position) for light in scene.lights if not isinstance(light, SunLight)]
    lamps = np.asarray(origins, np.float64).reshape(-1, 3) - surfaces.origin
    lit = np.zeros(count, bool)
    for lamp in lamps:
        lit |= ((lamp > low) & (lamp < high)).all(axis=1)
    full = volume > FULL * np.prod(high - low, axis=1)
    bad = np.zeros(count, bool)
    for box in np.flatnonzero(closed & ((volume < 0) | (full & lit))):
        others = mesh != mesh[box]
        within = others & (low >= low[box]).all(axis=1) & (high <= high[box]).all(axis=1)
        if volume[box] < 0:
            around = closed & (volume > 0) & ~others
            hollow = (around & (low <= low[box]).all(axis=1) & (high >= high[box]).all(axis=1)).any()
            bad[box] = not (hollow or within.any() or lit[box])
        else:
            bad[box] = 2 * within.sum() >= others.sum()
    return bad
