# SPDX-License-Identifier: GPL-3.0-or-later
"""Which strata of texels lie inside solid objects, where no light can be and none may be fetched from."""

from __future__ import annotations

import numpy as np

from ..arrays import Bools, Float32, Int64
from ..chunks import Fractions, in_chunks
from ..columns import some
from ..sampling import cosine_directions, hash_uniform
from ..scene import Scene, SunLight
from .sheets import is_sheet
from .surfaces import Surfaces
from .texels import STRATA, Texels
from .visibility import Visibility

LAMP_RAYS = 64
"""Rays that ask whether a lamp stands inside a closed surface."""

EMITTERS = 4096
"""Emissive triangles, at most, that are asked the same; a surface full of them is found from any."""

CHUNK = 1 << 15


def solid_triangles(scene: Scene, surfaces: Surfaces, visibility: Visibility) -> Bools:
    """(F,) bool: triangles that bound a solid: a closed opaque surface, facing outward, that no lamp stands inside.

    No light reaches the inside of such a surface. A closed surface around a lamp is a room instead, whatever open
    surfaces stand between, and so is one that light passes; one that faces inward is a room seen from within.
    """
    closed = np.flatnonzero(surfaces.closed)
    if not len(closed):
        return surfaces.closed
    shells = Visibility(surfaces.corners[closed])
    origins = [np.asarray(light.position) for light in scene.lights if not isinstance(light, SunLight)]
    points = np.asarray(origins, np.float32).reshape(-1, 3)
    count = len(points)
    ids = np.repeat(np.arange(count), LAMP_RAYS)
    up = np.where(np.arange(count * LAMP_RAYS) % 2, 1, -1).astype(np.float32)
    axes = np.stack([np.zeros_like(up), np.zeros_like(up), up], axis=1)
    emission = np.array([material.emission for material in scene.materials] or [(0, 0, 0)])
    shines = (emission > 0).any(1)
    seen_behind = scene.behind[surfaces.material]
    fronts = np.flatnonzero(shines[surfaces.material])
    backs = np.flatnonzero(shines[seen_behind] & (seen_behind != surfaces.material))
    glowing = np.append(fronts, backs)
    side = np.where(np.arange(len(glowing)) < len(fronts), np.float32(1), np.float32(-1))
    step = max(1, len(glowing) // EMITTERS)
    glowing = glowing[::step]
    ways = surfaces.normal[glowing] * side[::step, None]
    lifted = surfaces.corners[glowing].mean(1) + ways * np.float32(surfaces.offset)
    starts = np.concatenate([points[ids], np.repeat(lifted, 4, axis=0)])
    normals = np.concatenate([axes, np.repeat(ways, 4, axis=0)])
    rays = np.arange(len(starts))
    hits = shells.first_hit(starts, cosine_directions(normals, hash_uniform(rays, 0), hash_uniform(rays, 1)))
    visibility.include(shells)
    behind = closed[hits.triangle[(hits.triangle >= 0) & ~hits.front]]
    source = np.concatenate([ids, count + np.repeat(np.arange(len(glowing)), 4)])[(hits.triangle >= 0) & ~hits.front]
    around = surfaces.component[behind]
    # a lamp is inside when most of its rays meet the same surface from behind; one stray ray proves nothing
    pairs, seen = np.unique(np.stack([source, around], axis=1), axis=0, return_counts=True)
    needed = np.where(pairs[:, 0] < count, LAMP_RAYS // 2, 3)
    rooms = pairs[seen >= needed, 1]
    rooms = np.concatenate([rooms, surfaces.component[~(surfaces.met & surfaces.casts)]])
    sheet = is_sheet(scene.materials)
    sheet |= sheet[scene.behind]
    rooms = np.concatenate([rooms, surfaces.component[sheet[surfaces.material]]])
    for transmittance in (visibility.transmittance, visibility.of_lamps.transmittance):
        if transmittance is not None:
            rooms = np.concatenate([rooms, surfaces.component[~transmittance.opaque]])
    return surfaces.closed & _facing_outward(surfaces) & ~np.isin(surfaces.component, rooms)


def _facing_outward(surfaces: Surfaces) -> Bools:
    """(F,) bool: the triangle's component, if closed, encloses a positive volume."""
    a, b, c = np.moveaxis(surfaces.corners.astype(np.float64), 1, 0)
    volume = np.bincount(surfaces.component, weights=np.einsum("fi,fi->f", a, np.cross(b, c)), minlength=1)
    return np.asarray(volume[surfaces.component] > 0)


def strata_inside(texels: Texels, solid: Bools, visibility: Visibility, workers: int) -> Fractions[Bools]:
    """(T, 4) bool: strata from which the ray along the normal meets a solid from behind.

    The rays see solids alone: a floor and the ceiling above it, with a wall through both, would hide the wall's inside.
    Closed surfaces that face inward are seen too: they are the hollows of solids.
    One stratum is asked first, of all texels at the rims of charts and of every second one elsewhere, as on a
    chessboard; then all four where a texel of the 3 x 3 neighbourhood is inside.
    """
    inside = np.zeros((texels.count, STRATA), bool)
    if not solid.any():
        return inside
    surfaces = texels.surfaces
    shells = np.flatnonzero(solid | (surfaces.closed & ~_facing_outward(surfaces)))
    bounding = solid[shells]
    solids = Visibility(surfaces.corners[shells])

    def met(ids: Int64, slot: Int64) -> Bools:
        origins, triangle = texels.points(ids, slot)
        directions: Float32 = surfaces.normals(triangle)
        origins += directions * np.float32(surfaces.offset)
        hits = solids.first_hit(origins, directions)
        return (hits.triangle >= 0) & ~hits.front & bounding[hits.triangle]

    def first(start: int, stop: int) -> None:
        row, column = np.divmod(texels.pixel[start:stop], texels.size)
        rim = texels.covered[start:stop] != (1 << STRATA) - 1
        ids = start + np.flatnonzero(rim | (((row + column) & 1) == 0))
        slot = (ids >> 1) & (STRATA - 1)
        inside[ids, slot] = met(ids, slot)

    yield from in_chunks(first, texels.count, CHUNK, workers)
    asked = np.flatnonzero(_near(some(inside), texels))

    def every(start: int, stop: int) -> None:
        ids = np.repeat(asked[start:stop], STRATA)
        slot = np.tile(np.arange(STRATA), stop - start)
        inside[ids, slot] = met(ids, slot)

    yield from in_chunks(every, len(asked), CHUNK // STRATA, workers)
    visibility.include(solids)
    return inside


def _near(chosen: Bools, texels: Texels) -> Bools:
    """Texels within one texel, on the page, of a chosen one."""
    pages: Bools = np.zeros(len(texels.texel_at), bool)
    pages[texels.pixel[chosen]] = True
    pages = pages.reshape(-1, texels.size, texels.size)
    tall = pages.copy()
    tall[:, 1:] |= pages[:, :-1]
    tall[:, :-1] |= pages[:, 1:]
    wide = tall.copy()
    wide[:, :, 1:] |= tall[:, :, :-1]
    wide[:, :, :-1] |= tall[:, :, 1:]
    return wide.reshape(-1)[texels.pixel]
