# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake will take, told before it: texels and pages from the area to be lit, memory and time from the texels."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from .settings import BakeSettings

FILLED = 0.77
"""Share of a page that texels of charts cover; 0.66 to 0.88 on the sample scenes, rims of charts included."""

BYTES_PER_TEXEL = 115
"""What a bake needs for each texel of its pages, at most, while gather points are placed; it keeps up to 92. Where
pictures vary over surfaces, 12 more for each kind."""

BYTES_OF_CHUNKS = 500e6
"""What it holds for a moment beyond that, at most."""

SECONDS = {"draft": (0.8, 7e-6), "medium": (2.3, 9e-6), "high": (4.3, 12e-6)}
"""Seconds that the light of a bake takes at least, and for each texel: between a Cornell box and a furnished room, on
two cores."""

SECONDS_OF_FACES = 5e-9
"""Seconds, for each texel, of each triangle that shines: from a room with glowing lamps to a gallery of neon tubes."""

MOST_FACES = 10_000
"""Of these, as many as are told apart: far ones shine together."""

FIXED_STAGES = ("Read scene", "Unwrap", "Transparency", "Write back")
"""Stages whose time follows from the scene, however many texels and rays are spent on it."""


@dataclass(frozen=True)
class Pace:
    """How fast a machine bakes a scene.

    Attributes:
        fixed: seconds of FIXED_STAGES
        slowness: how much longer all else takes than SECONDS say
    """

    fixed: float = 0.7
    slowness: float = 1.0

    @staticmethod
    def of(stages: Iterable[tuple[str, float, int]], texels: int, quality: str) -> Pace:
        """The pace of a bake with these stages: name, seconds, rays."""
        seconds = dict.fromkeys((True, False), 0.0)
        for name, each, _ in stages:
            seconds[name in FIXED_STAGES] += each
        return Pace(seconds[True], seconds[False] / _seconds(texels, quality))


@dataclass(frozen=True)
class Estimate:
    """About what a bake will take.

    Attributes:
        pages: their number
        texels: covered by surfaces, on all pages
        density: texels per metre; None where no area is known
        bytes: of memory, beside Blender itself
        seconds: from the click to lit materials
    """

    pages: int
    texels: int
    density: float | None
    bytes: float
    seconds: float


def estimate(
    area: float | None, settings: BakeSettings, groups: int = 1, pace: Pace | None = None, shining: int = 0
) -> Estimate:
    """What a bake of surfaces of this area will take.

    Args:
        area: m2, of what gets a lightmap, each surface's times its density multiplier squared; None: not known yet,
            which is enough to fill a page
        groups: page groups, each of which fills pages of its own
        pace: of machine and scene
        shining: triangles that do, as far as the pace does not know of them
    """
    pace = pace or Pace()
    page = settings.page_size**2
    pages, density = groups, settings.density
    texels = FILLED * page * groups
    if density is None:
        density = math.sqrt(texels / area) if area else None
    elif area:
        texels = area * density**2
        pages = max(groups, math.ceil(texels / (FILLED * page)))
    faces = SECONDS_OF_FACES * min(shining, MOST_FACES) * texels
    seconds = pace.fixed + pace.slowness * (_seconds(texels, settings.quality) + faces)
    return Estimate(pages, round(texels), density, memory_of(texels), seconds)


def memory_of(texels: float) -> float:
    """Bytes that a bake needs at most, beside Blender itself."""
    return texels * BYTES_PER_TEXEL + BYTES_OF_CHUNKS


def too_large(areas: Sequence[tuple[str, float]], settings: BakeSettings) -> list[str]:
    """Names of what no page can hold at the wanted density, of surfaces with their areas as in `estimate`."""
    if settings.density is None:
        return []
    room = settings.page_size**2 / settings.density**2
    return [name for name, area in areas if area > room]


def about(number: float) -> str:
    """A count as one says it: 800, 48,000, 1.2 million."""
    if number >= 999_500:
        return f"{number / 1e6:.2g} million" if number < 99.5e6 else f"{number / 1e6:,.0f} million"
    digits = max(0, len(str(int(number))) - 2)
    return f"{round(number / 10**digits) * 10**digits:,}"


def about_seconds(seconds: float) -> str:
    """A time as one says it: 3 s, 40 s, 2 min, 1.5 h."""
    if seconds < 10:
        return f"{max(round(seconds), 1)} s"
    if seconds < 55:
        return f"{5 * round(seconds / 5)} s"
    if seconds < 3300:
        return f"{round(seconds / 60) or 1} min"
    return f"{seconds / 3600:.1f} h"


def _seconds(texels: float, quality: str) -> float:
    fixed, each = SECONDS[quality]
    return fixed + each * texels
