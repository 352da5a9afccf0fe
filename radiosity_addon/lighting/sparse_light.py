# SPDX-License-Identifier: GPL-3.0-or-later
"""Unshadowed light of meshes on flat surfaces, from few of their points: away from what shines it varies smoothly.

Planes are halved into rectangles until light is a polynomial on each, known at Chebyshev points (Trefethen 2013,
"Approximation Theory and Approximation Practice", chapters 3 and 8; Fong and Darve 2009, "The black-box fast multipole
method"). Texels of those that are too small for it, and on what is not flat, ask for their light by themselves.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence

import numpy as np

from ..arrays import Bools, Float32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..columns import vectors_at
from ..geometry.texels import Texels
from .flat_cells import FlatCells, Rectangles
from .lamp_samples import TINY
from .lamps import Lamp
from .mesh_lamp import MeshLamp
from .own_faces import OwnFaces
from .terminator import horizons

POINTS = 5
"""Chebyshev points along each side of a rectangle."""

FINE = 0.003
"""Relative error of the light, if none is asked for: that of high quality."""

TAIL = 0.6
"""Most that the terms of the highest degree may add up to, as a share of the error that light may have. The first ones
that are missing are smaller by as much as these are smaller than those before."""

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
    lamps: Sequence[Lamp],
    texels: Texels,
    light: Float32,
    workers: int,
    faces: OwnFaces | None = None,
    tolerance: float = FINE,
    flat: FlatCells | None = None,
) -> Generator[float, None, None]:
    """Fill in the rows of light (L, T) of lamps that are meshes, but for their own `faces`; yields the share done.

    Args:
        tolerance: relative error that the light may have
        flat: those of the texels, halved as far as other meshes have asked; None: none have
    """
    trees: dict[int, list[int]] = {}
    for index, lamp in enumerate(lamps):
        if isinstance(lamp, MeshLamp):
            trees.setdefault(id(lamp.tree), []).append(index)
    if not trees:
        return
    flat = flat or FlatCells.of(texels, LEAST)
    for done, rows in enumerate(trees.values()):
        alike = [lamp.loosened(tolerance / FINE) for lamp in (lamps[row] for row in rows) if isinstance(lamp, MeshLamp)]
        steps = light_of_tree(alike, texels, flat, workers, faces, tolerance)
        light[rows] = yield from scaled(steps, done / len(trees), (done + 1) / len(trees))


def light_of_tree(
    lamps: Sequence[MeshLamp],
    texels: Texels,
    flat: FlatCells,
    workers: int,
    faces: OwnFaces | None = None,
    tolerance: float = FINE,
) -> Fractions[Float32]:
    """The light (L, T) of lamps of one tree at texels; 0 where they are not valid."""
    total = np.zeros((len(lamps), texels.count), np.float32)
    lamp, channels = lamps[0], [lamp.channel for lamp in lamps]
    chosen, terms, left = yield from scaled(_fitted(lamp, channels, flat, tolerance, workers), 0, 0.4)

    def spread(first: int, last: int) -> None:
        cells = chosen.only(slice(first, last))
        index, number = flat.texels(cells)
        scale = 1 / np.maximum(cells.half, TINY)
        for start in range(0, len(index), CHUNK):
            own, texel = number[start : start + CHUNK], index[start : start + CHUNK]
            place = flat.place.take(texel, axis=1)
            for k in (0, 1):
                place[k] -= cells.middle[:, k].take(own)
                place[k] *= scale[:, k].take(own)
            total[:, flat.order[texel]] = _polynomial(terms, first + own, place)

    yield from scaled(in_chunks(spread, len(chosen.start), TRIED, workers), 0.4, 0.5)
    alone = np.sort(np.concatenate([flat.order[flat.texels(left)[0]], flat.others]))
    if faces is not None:
        alone = alone[faces.emitter[texels.surfaces.front[texels.triangle[alone]]] != lamp.emitter]

    def ask(first: int, last: int) -> None:
        some = alone[first:last]
        shading = vectors_at(texels.shading_normal, some)
        normal = horizons(texels, some, shading)
        bent = None if np.array_equal(shading, normal) else normal
        total[:, some] = lamp.in_channels(channels, vectors_at(texels.position, some), shading, bent)

    yield from scaled(in_chunks(ask, len(alone), ALONE, workers), 0.5, 1)
    return total


def _fitted(
    lamp: MeshLamp, channels: list[int], flat: FlatCells, tolerance: float, workers: int
) -> Fractions[tuple[Rectangles, Float32, Rectangles]]:
    """Where the light in L channels is a polynomial.

    Returns:
        C rectangles, the terms (POINTS^2, L, C) of the light on them, and the rectangles that are left
    """
    now = flat.whole
    fitted, left = [now.only(slice(0))], [now.only(slice(0))]
    terms = [np.zeros((POINTS**2, len(channels), 0), np.float32)]

    def attempt(first: int, last: int) -> tuple[Bools, Float32]:
        own = now.only(slice(first, last))
        good = (own.length >= LEAST) & (own.length <= MOST)
        centre, radius = flat.balls(own.only(good))
        good[good] = lamp.is_clear_of(centre, radius * np.float32(CLEAR))
        own = own.only(good)
        normals = np.repeat(flat.normal[own.plane], POINTS**2, axis=0)
        light = lamp.in_channels(channels, flat.at(own, GRID).reshape(-1, 3), normals, None)
        light = light.reshape(len(channels), -1, POINTS**2)
        found = np.einsum("ij,lcj->ilc", _TERMS, light)
        smooth = np.all(np.abs(found[_HIGHEST]).sum(0) <= np.float32(TAIL * tolerance) * light.max(2), axis=0)
        good[good] = smooth
        return good, found[:, :, smooth]

    while len(now.start):
        tried = yield from scaled(in_chunks(attempt, len(now.start), TRIED, workers), 0, 1)
        good = np.concatenate([part for part, _ in tried])
        fitted.append(now.only(good))
        terms += [found for _, found in tried]
        others = now.only(~good)
        parted = (others.length >= 2 * LEAST) & others.wide
        left.append(others.only(~parted))
        now = yield from scaled(flat.halves(others.only(parted), workers), 1, 1)
    return Rectangles.joined(fitted), np.concatenate(terms, axis=2), Rectangles.joined(left)


def _polynomial(terms: Float32, number: Int64, place: Float32) -> Float32:
    """Polynomials with terms (POINTS^2, L, C), by `number` (B,), at places (2, B) in -1..1: (L, B), nowhere below 0."""
    waves = []
    for x in place:
        wave = [np.ones_like(x), x]
        while len(wave) < POINTS:
            wave.append(2 * x * wave[-1] - wave[-2])
        waves.append(wave)
    total = np.zeros((terms.shape[1], len(number)), np.float32)
    work, inner = np.empty_like(total), np.empty_like(total)
    for i, one in enumerate(waves[0]):
        for j, other in enumerate(waves[1]):
            np.take(terms[i * POINTS + j], number, axis=1, out=work if j else inner, mode="clip")
            if j:
                work *= other
                inner += work
        inner *= one
        total += inner
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
