# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps that send their shadow rays together: the colours of one picture, whose samples are the same."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Float32
from ..geometry.visibility import Visibility
from ..scene import RGB
from .lamps import Lamp
from .mesh_lamp import MeshLamp


@dataclass(frozen=True, eq=False)
class ColorLamps(Lamp):
    """The lamps of C channels of one picture. Their light, and the weights of samples, are (C, P).

    Attributes:
        lamps: one a channel, each with a tint
    """

    strength: RGB
    shadow: bool
    group: int
    lamps: tuple[MeshLamp, ...]

    @property
    def colors(self) -> list[int]:
        """Which of red, green and blue each shines in."""
        return [int(np.argmax(np.abs(lamp.strength))) for lamp in self.lamps]

    @property
    def unevenness(self) -> float:
        return self.lamps[0].unevenness

    @cached_property
    def hidden_share(self) -> float:
        """Also of the samples that fall where a colour is dark: as many more as its own samples would be the fewer."""
        first = self.lamps[0]
        share = np.diff(first.ends.astype(np.float64), prepend=0)
        squares = max(float(share @ lamp.tint.astype(np.float64) ** 2) for lamp in self.lamps if lamp.tint is not None)
        return 1 - (1 - first.hidden_share) / max(squares, 1.0)

    def light(self, points: Float32, shading: Float32, geometric: Float32 | None) -> Float32:
        return self.lamps[0].in_channels([lamp.channel for lamp in self.lamps], points, shading, geometric)

    def aim(self, p: Float32, u: Float32, v: Float32) -> tuple[Float32, Float32]:
        way, weight, cell = self.lamps[0].aim_at_cells(p, u, v)
        return way, np.stack([weight * lamp.tint.take(cell) for lamp in self.lamps if lamp.tint is not None])


@dataclass(frozen=True, eq=False)
class Company:
    """Lamps that send their shadow rays together, mostly one alone.

    Attributes:
        members: their numbers
        lamp: what sends the rays
    """

    members: list[int]
    lamp: Lamp

    def channels(self, visibility: Visibility) -> int:
        """Rows of the share of their light that arrives: of one lamp the colours that anything dims apart."""
        return visibility.channels if len(self.members) == 1 else len(self.members)

    def of_each(self, light: Float32) -> list[tuple[int, Float32]]:
        """The members, and of their light (C, ...) the rows of each."""
        if len(self.members) == 1:
            return [(self.members[0], light)]
        return [(index, light[row : row + 1]) for row, index in enumerate(self.members)]


def companies_of(lamps: Sequence[Lamp], apart: Container[int]) -> list[Company]:
    """The companies of lamps; those whose numbers are in `apart` stay alone."""
    found: dict[int, list[int]] = {}
    colors: dict[int, list[MeshLamp]] = {}
    for index, lamp in enumerate(lamps):
        key = -1 - index
        if isinstance(lamp, MeshLamp) and lamp.tint is not None and index not in apart:
            key = id(lamp.tree)
            colors.setdefault(key, []).append(lamp)
        found.setdefault(key, []).append(index)
    companies = []
    for key, members in found.items():
        lamp = lamps[members[0]]
        if len(members) > 1:
            lamp = ColorLamps((0, 0, 0), lamp.shadow, lamp.group, tuple(colors[key]))
        companies.append(Company(members, lamp))
    return companies


def brightest(light: Float32) -> Float32:
    """Light (P,), that of the brightest colour if it is that of several (C, P)."""
    return light if light.ndim == 1 else np.asarray(light.max(0))
