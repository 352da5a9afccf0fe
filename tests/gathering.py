# SPDX-License-Identifier: GPL-3.0-or-later
"""Floors and sheets for the final gather, and what looks around from their texels."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from radiosity_addon.arrays import Bools, Float32, Int64
from radiosity_addon.chunks import Fractions, finish
from radiosity_addon.gather.gather_points import GatherPoints, place_points
from radiosity_addon.gather.gather_rays import GatherRays
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import Texels, rasterize
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.geometry.walls import find_walls
from radiosity_addon.radiosity.illumination import SPECIAL_ROWS
from radiosity_addon.radiosity.patches import SKY, group_patches
from radiosity_addon.scene import Material, Mesh, Scene
from radiosity_addon.settings import BakeSettings
from tests.shapes import cell_atlas, folded_sheet, mesh_of, quad

NEAR = 0.35
"""Share of the scale of change beyond which cells are split."""
FAR = 100.0
"""m; scale of change at a point in the open."""
HIGH = BakeSettings(quality="high")


def sheet(x: Sequence[float], height: Sequence[float]) -> Texels:
    """A folded sheet, shaded as if level."""
    scene, atlas = folded_sheet(x, height)
    return finish(rasterize(atlas, flatten(scene), 1))


class Blind:
    """Eyes that see what they are told: the scale of change at positions (Q, 3), m; light everywhere."""

    def __init__(self, texels: Texels, scale: Callable[[Float32], Float32]) -> None:
        self.texels, self.scale = texels, scale

    def look(self, chosen: Int64, fine: bool) -> Fractions[tuple[Float32, Float32, Float32]]:
        yield 1.0
        seen = np.broadcast_to(self.scale(self.texels.position[chosen]), len(chosen)).astype(np.float32)
        return seen, seen, np.ones(len(chosen), np.float32)

    def clearance(self, chosen: Int64) -> Fractions[Float32]:
        yield 1.0
        return np.full(len(chosen), FAR, np.float32)


def far(position: Float32) -> Float32:
    return np.full(len(position), FAR, np.float32)


def floor(*more: Mesh, size: int | None = None) -> Texels:
    """A floor of 4 x 4 m in z = 0, facing up; without `size` its texels are 4 / 58 m wide."""
    ground = mesh_of("Floor", [quad((0, 0, 0), (4, 0, 0), (0, 4, 0))], [0])
    scene = Scene((ground, *more), (Material("Grey"),))
    return finish(rasterize(cell_atlas(scene, size or 64 * (1 + bool(more))), flatten(scene), 1))


def placed(texels: Texels, base: float, scale: Callable[[Float32], Float32] = far, near: float = NEAR) -> GatherPoints:
    return finish(place_points(texels, texels.valid, base, near, 0.07, Blind(texels, scale)))


def rays_of(
    texels: Texels,
    shining: Bools | Float32 | float = 0.0,
    sky: float = 0.0,
    settings: BakeSettings = HIGH,
    near_to: float = 0.0,
) -> tuple[GatherRays, Float32]:
    """Rays of gather points, and the brightness of all elements that guides them.

    Args:
        shining: brightness of the texels, (T,) or of all
        sky: of the sky
    """
    visibility = Visibility(texels.surfaces.corners)
    walls = finish(find_walls(texels, visibility, 1))
    grey, solid = np.zeros((texels.count, 3), np.float32), np.ones(texels.surfaces.count, bool)
    patches = group_patches(texels, walls, grey, grey, solid, 500, visibility)
    bright = np.zeros(texels.count + patches.count + SPECIAL_ROWS, np.float32)
    bright[: texels.count] = shining
    bright[SKY] = sky
    return GatherRays(texels, patches, visibility, settings, bright, near_to=near_to), bright
