# SPDX-License-Identifier: GPL-3.0-or-later
"""How much of the light that meets a texel it stops, and where on it light is stopped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Float32, Int32
from ..sampling import hash_uniform
from .surfaces import on_front
from .texels import STRATA, Texels
from .transmittance import NEARLY, Transmittance

CHUNK = 1 << 15
"""Texels whose strata are looked up in one go."""


@dataclass(frozen=True, eq=False)
class Opacity:
    """How much of the light T texels stop.

    Attributes:
        share: (T,) float32, mean over the texel's strata and over channels; of what does not pass both ways
        strata: (T,) uint8, bit s set if stratum s sends light: all where they are alike, of others those that stop more
        sides: (T,) float32 each, `share` of light that comes from the front and from behind; None: both alike
    """

    share: Float32
    strata: NDArray[np.uint8]
    sides: tuple[Float32, Float32] | None = None

    def of_stopped(self, values: Float32, highest: float = np.inf, behind: bool = False) -> Float32:
        """Values (T, 3) of the surface as a whole as those of the light that is stopped, limited to `highest`."""
        share = self.share if self.sides is None else self.sides[behind]
        divided = (values / np.where(share > 0, share, 1)[:, None]).astype(np.float32)
        return np.minimum(divided, np.float32(highest))


def opacity_of(texels: Texels, transmittance: Transmittance | None) -> Opacity | None:
    """What the texels stop of the light between surfaces; None where all are opaque."""
    met = texels.surfaces.met
    if transmittance is None:
        if met.all():
            return None
        return Opacity(met[texels.triangle[:]].astype(np.float32), np.full(texels.count, 15, np.uint8))
    share, front, back = np.empty((3, texels.count), np.float32)
    one_way = transmittance.behind is not None
    strata = np.empty(texels.count, np.uint8)
    for start in range(0, texels.count, CHUNK):
        part = slice(start, start + CHUNK)
        own, weights = texels.footprints.strata(np.arange(start, min(start + CHUNK, texels.count)))
        triangle, u, v = on_front(texels.surfaces, own, weights)
        stopped = _stopped(transmittance, (triangle, u, v), None, met[own])
        if one_way:
            turned = own.reshape(-1) >= texels.surfaces.fronts
            front[part] = _stopped(transmittance, (triangle, u, v), ~turned, met[own]).mean(1)
            back[part] = _stopped(transmittance, (triangle, u, v), turned, met[own]).mean(1)
        share[part] = stopped.mean(1)
        number = np.arange(start * STRATA, start * STRATA + stopped.size).reshape(-1, STRATA)
        sends = stopped > hash_uniform(number) * stopped.max(1, keepdims=True)
        strata[part] = (sends << np.arange(STRATA)).sum(1)
    return Opacity(share, strata, (front, back) if one_way else None)


def _stopped(
    transmittance: Transmittance, at: tuple[Int32, Float32, Float32], front: Bools | None, met: Bools
) -> Float32:
    """The share (N, STRATA) of light that strata stop, at triangles and barycentrics, that is `met` (N, STRATA)."""
    stopped: Float32 = 1 - transmittance.at(*at, None, front).mean(0).reshape(-1, STRATA)
    stopped[stopped < NEARLY] = 0
    stopped[~met] = 0
    return stopped
