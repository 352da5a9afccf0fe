# SPDX-License-Identifier: GPL-3.0-or-later
"""The feet of what is sunk into open surfaces: strips below a floor that nobody sees, and whose dark must not show.

A box that is sunk by some millimetres into a floor without thickness has a last row of texels under it, which takes no
part, whichever way the floor faces. What tells such a strip from a ledge behind a wall is that it is narrow all along:
the surface ends soon after the wall, and before it there is more.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Bools, Int32, Int64
from ..atlas.islands import islands
from ..columns import dots
from .texels import STRATA, Texels
from .visibility import Visibility
from .walls import CREASED, Walls, hidden, steps

DEPTH = 0.03
"""m: what ends so near behind a wall is a foot."""

ROWS = 2
"""Texels of which a foot may consist however wide they are: one, and the one beside the chart."""

MOST = 8
"""Texels of which a foot consists at most."""

WIDER = 2
"""A foot has so many times its texels before the wall."""


def leave_out_feet(texels: Texels, walls: Walls, visibility: Visibility) -> Walls:
    """Leave feet out: changes the texels, and returns the walls that others see from behind."""
    strips = _strips(texels, walls, visibility)
    if not len(strips):
        return walls
    inside = np.zeros((texels.count, STRATA), bool)
    inside[_enclosed(texels, strips, visibility)] = True
    texels.without(inside)
    return replace(walls, behind=walls.behind[:, texels.valid[walls.behind].all(0)])


def _strips(texels: Texels, walls: Walls, visibility: Visibility) -> Int64:
    """Texels of narrow strips between a wall and the surface's end."""
    crossed = np.flatnonzero(walls.row >= 0)
    found = [np.zeros(0, np.int64)]
    for side, step in enumerate(steps(texels)):
        plane = walls.planes[:, side]
        here = crossed[plane.any(1)].astype(np.int32)
        plane = plane[plane.any(1)]
        strip = np.full((MOST, len(here)), -1, np.int32)
        onward = here
        for row in strip:
            onward = row[:] = _next(texels, onward, step)
        rows = (strip >= 0).sum(0)
        last = strip[np.maximum(rows - 1, 0), np.arange(len(here))]
        depth = -(np.einsum("cx,cx->c", plane[:, :3], texels.position[last]) + plane[:, 3])
        narrow = (rows > 0) & (rows < MOST) & ((rows <= ROWS) | (depth < DEPTH))
        before = here
        for number in range(1, WIDER * MOST):
            before = _next(texels, before, -step)
            narrow &= (before >= 0) | (number >= WIDER * rows)
        chosen = np.flatnonzero(narrow)
        goes_on = _goes_on(texels, _next(texels, here[chosen], -step), here[chosen], last[chosen], visibility)
        strip = strip[:, chosen[~goes_on]]
        found.append(strip[strip >= 0].astype(np.int64))
    return np.unique(np.concatenate(found))


def _next(texels: Texels, here: Int32 | Int64, step: int) -> Int32:
    """The valid texel of the same surface a `step` of pixels from each of some (R,), -1 for none and from none."""
    pixel = texels.pixel[here]
    other: Int32 = texels.texel_at.take(pixel + step, mode="clip")
    component = texels.surfaces.component
    there = (here >= 0) & (other >= 0) & texels.valid[other]
    there &= component[texels.triangle[other]] == component[texels.triangle[here]]
    if abs(step) == 1:
        there &= pixel // texels.size == (pixel + step) // texels.size
    return np.where(there, other, np.int32(-1))


def _goes_on(texels: Texels, before: Int32, here: Int32, last: Int32, visibility: Visibility) -> Bools:
    """Whether the surface of strips (R,) goes on after their `last` texels: there its charts end, but not itself."""
    way = texels.position[here] - texels.position[before]
    lift = texels.normal[last] * (np.sqrt(dots(way, way))[:, None] / 4)
    hits = visibility.first_hit(texels.position[last] + way + lift, lift * -2)
    component = texels.surfaces.component
    same = component[hits.triangle] == component[texels.triangle[last]]
    return np.asarray((hits.triangle >= 0) & (hits.distance < 1) & same)


def _enclosed(texels: Texels, strips: Int64, visibility: Visibility) -> Int64:
    """Of texels of strips (S,) those from which one can't get to others without going through a wall."""
    number = np.arange(len(strips))
    ways, ajar = [np.stack([number, number], axis=1)], np.zeros(len(strips), bool)
    for step in steps(texels):
        other = _next(texels, strips, step)
        near = np.flatnonzero(other >= 0)
        near = near[~hidden(texels, strips[near], other[near], visibility, CREASED)]
        there = np.minimum(np.searchsorted(strips, other[near]), len(strips) - 1)
        strip = strips[there] == other[near]
        ajar[near[~strip]] = True
        ways.append(np.stack([near[strip], there[strip]], axis=1))
    part = islands(np.concatenate(ways)[:, [0, 1, 1]])[: len(strips)]
    return strips[~np.isin(part, part[ajar])]
