# SPDX-License-Identifier: GPL-3.0-or-later
"""Unshadowed light of meshes on flat surfaces, from few of their points: away from what shines it varies smoothly.

Planes are halved into rectangles until light is a polynomial on each, known at Chebyshev points (Trefethen 2013,
"Approximation Theory and Approximation Practice", chapters 3 and 8; Fong and Darve 2009, "The black-box fast multipole
method"). Texels of those that are too small for it, and on what is not flat, ask for their light by themselves.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence

import numpy as np

from ..arrays import Float32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..geometry.texels import Texels
from .flat_cells import FlatCells
from .lamp_samples import TINY
from .lamps import Lamp
from .mesh_lamp import MeshLamp
from .own_faces import OwnFaces
from .terminator import horizons

POINTS = 5
"""Chebyshev points along each side of a rectangle."""

TAIL = 2e-3
"""Most that the terms of the highest degree may add up to, as a share of the light. The first ones that are missing
are smaller by as much as these are smaller than those before."""

LEAST = 2 * POINTS**2
"""Texels of a rectangle, at least."""

MOST = 1 << 12
"""Texels of a rectangle, at most, that is tried; larger ones are halved at once."""

CLEAR = 1.5
"""Nothing that shines is nearer to a rectangle's middle than this many times half its diagonal."""

TRIED = 64
"""Rectangles tried in one go."""

CHUNK = 1 << 14
"""Texels that get the light of their rectangles in one go."""

ALONE = 1 << 12
"""Texels that ask by themselves in one go."""


def light_of_meshes(
    lamps: Sequence[Lamp], texels: Texels, light: Float32, workers: int, faces: OwnFaces | None = None
) -> Generator[float, None, None]:
    """Fill in the rows of light (L, T) of lamps that are meshes, but for their own `faces`; yields the share done."""
    trees: dict[int, list[int]] = {}
    for index, lamp in enumerate(lamps):
        if isinstance(lamp, MeshLamp):
            trees.setdefault(id(lamp.tree), []).append(index)
    if not trees:
        return
    flat = FlatCells.of(texels, LEAST)
    for done, rows in enumerate(trees.values()):
        alike = [lamp for lamp in (lamps[row] for row in rows) if isinstance(lamp, MeshLamp)]
        steps = light_of_tree(alike, texels, flat, workers, faces)
        light[rows] = yield from scaled(steps, done / len(trees), (done + 1) / len(trees))


def light_of_tree(
    lamps: Sequence[MeshLamp], texels: Texels, flat: FlatCells, workers: int, faces: OwnFaces | None = None
) -> Fractions[Float32]:
    """The light (L, T) of lamps of one tree at texels; 0 where they are not valid."""
    total = np.zeros((len(lamps), texels.count), np.float32)
    lamp, channels = lamps[0], [lamp.channel for lamp in lamps]
    chosen, terms, left = yield from scaled(_fitted(lamp, channels, flat, workers), 0, 0.4)

    def spread(first: int, last: int) -> None:
        index, number = flat.texels(chosen[first:last])
        for start in range(0, len(index), CHUNK):
            part = slice(start, start + CHUNK)
            own = first + number[part]
            place = flat.place[:, index[part]]
            place -= flat.cells.middle[chosen[own]].T
            place /= np.maximum(flat.cells.half[chosen[own]].T, TINY)
            total[:, flat.order[index[part]]] = _polynomial(terms[:, own], place)

    yield from scaled(in_chunks(spread, len(chosen), TRIED, workers), 0.4, 0.5)
    alone = np.sort(np.concatenate([flat.order[flat.texels(left)[0]], flat.others]))
    if faces is not None:
        alone = alone[faces.emitter[texels.surfaces.front[texels.triangle[alone]]] != lamp.emitter]

    def ask(first: int, last: int) -> None:
        some = alone[first:last]
        shading = texels.shading_normal.take(some, axis=0)
        normal = horizons(texels, some, shading)
        bent = None if np.array_equal(shading, normal) else normal
        total[:, some] = lamp.in_channels(channels, texels.position.take(some, axis=0), shading, bent)

    yield from scaled(in_chunks(ask, len(alone), ALONE, workers), 0.5, 1)
    return total


def _fitted(
    lamp: MeshLamp, channels: list[int], flat: FlatCells, workers: int
) -> Fractions[tuple[Int64, Float32, Int64]]:
    """Where the light in L channels is a polynomial.

    Returns:
        rectangles (C,), its terms (L, C, POINTS^2) on them, and the rectangles that are left
    """
    none = np.zeros(0, np.int64)
    fitted, left = [none], [none]
    terms = [np.zeros((len(channels), 0, POINTS**2), np.float32)]
    now = np.arange(len(flat.normal))

    def attempt(first: int, last: int) -> tuple[Int64, Float32]:
        own = trying[first:last]
        centre, radius = flat.balls(own)
        own = own[lamp.is_clear_of(centre, radius * np.float32(CLEAR))]
        normals = np.repeat(flat.normal[flat.cells.plane[own]], POINTS**2, axis=0)
        light = lamp.in_channels(channels, flat.at(own, GRID).reshape(-1, 3), normals, None)
        light = light.reshape(len(channels), -1, POINTS**2)
        found = np.einsum("ij,lcj->lci", _TERMS, light)
        good = np.all(np.abs(found[:, :, _HIGHEST]).sum(2) <= np.float32(TAIL) * light.max(2), axis=0)
        return own[good], found[:, good]

    while len(now):
        length = flat.cells.stop[now] - flat.cells.start[now]
        trying = now[(length >= LEAST) & (length <= MOST)]
        for own, found in (yield from scaled(in_chunks(attempt, len(trying), TRIED, workers), 0, 1)):
            fitted.append(own)
            terms.append(found)
        others = np.setdiff1d(now, np.concatenate(fitted))
        halves = flat.cells.halves[others]
        left.append(others[halves < 0])
        now = np.concatenate([halves[halves >= 0], halves[halves >= 0] + 1])
    return np.concatenate(fitted), np.concatenate(terms, axis=1), np.concatenate(left)


def _polynomial(terms: Float32, place: Float32) -> Float32:
    """Polynomials of terms (L, B, POINTS^2) at places (2, B) in -1..1: (L, B), nowhere below 0."""
    waves = []
    for x in place:
        wave = [np.ones_like(x), x]
        while len(wave) < POINTS:
            wave.append(2 * x * wave[-1] - wave[-2])
        waves.append(wave)
    total = np.zeros(terms.shape[:2], np.float32)
    for i, one in enumerate(waves[0]):
        inner = np.zeros_like(total)
        for j, other in enumerate(waves[1]):
            inner += other * terms[:, :, i * POINTS + j]
        total += one * inner
    return np.maximum(total, 0, out=total)


def _chebyshev() -> tuple[Float32, Float32]:
    """The points (POINTS^2, 2) in -1..1, and the matrix that makes terms of values at them."""
    turn = (np.arange(POINTS) + 0.5) * (np.pi / POINTS)
    terms = np.cos(np.arange(POINTS)[:, None] * turn) * (2 / POINTS)
    terms[0] /= 2
    s, t = (grid.ravel() for grid in np.meshgrid(np.cos(turn), np.cos(turn), indexing="ij"))
    return np.stack([s, t], axis=1).astype(np.float32), np.kron(terms, terms).astype(np.float32)


GRID, _TERMS = _chebyshev()
_HIGHEST = np.maximum(*np.divmod(np.arange(POINTS**2), POINTS)) == POINTS - 1
