# SPDX-License-Identifier: GPL-3.0-or-later
"""What a surface does to light: how much it reflects, emits and lets straight through, and mixtures of such."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...arrays import Float64
from ...microfacet import mean_pane_transmittance
from ...scene import RGB, Gloss

BLACK = np.zeros(3)
WHITE = np.ones(3)


@dataclass(frozen=True, eq=False)
class Shading:
    """What a shader socket gives: reflectance, emitted radiance, W/(m2 sr), and transmittance, (3,) each.

    `refracted` is the transmittance times the index of refraction of what lets light pass; `translucence` and `glosses`
    are part of the reflectance; `indirect` is the transmittance of light that does not come from lamps, where that was
    asked for.
    """

    reflectance: Float64 = field(default_factory=lambda: BLACK)
    emission: Float64 = field(default_factory=lambda: BLACK)
    transmittance: Float64 = field(default_factory=lambda: BLACK)
    refracted: Float64 = field(default_factory=lambda: BLACK)
    translucence: Float64 = field(default_factory=lambda: BLACK)
    glosses: tuple[Gloss, ...] = ()
    indirect: Float64 | None = None

    def __add__(self, other: Shading) -> Shading:
        sums = (one + two for one, two in zip(self._parts, other._parts, strict=True))
        return Shading(*sums, glosses=self.glosses + other.glosses)

    def __mul__(self, factor: float | Float64) -> Shading:
        share = rgb(np.broadcast_to(factor, 3))
        return Shading(*(part * factor for part in self._parts), glosses=tuple(gloss * share for gloss in self.glosses))

    @property
    def _parts(self) -> tuple[Float64, ...]:
        return self.reflectance, self.emission, self.transmittance, self.refracted, self.translucence

    def unlike(self, other: Shading) -> frozenset[str]:
        """Names of what is not the same."""
        names = ("reflectance", "emission", "transmittance", "refracted", "translucence")
        parts = zip(names, self._parts, other._parts, strict=True)
        return frozenset(name for name, one, two in parts if (one != two).any())


NOTHING = Shading()


def glass(color: Float64, ior: float) -> Shading:
    """One surface of clear glass: what it does not let pass it reflects, both coloured."""
    passed = mean_pane_transmittance(max(ior, 1.0))
    return Shading(color * (1 - passed), transmittance=color * passed, refracted=color * passed * max(ior, 1.0))


def clear(color: Float64) -> Shading:
    """What light passes as if it were not there, but coloured."""
    return Shading(transmittance=color, refracted=color)


def rgb(values: Float64) -> RGB:
    """A triple of plain numbers."""
    return (float(values[0]), float(values[1]), float(values[2]))
