# SPDX-License-Identifier: GPL-3.0-or-later
"""How texels look by themselves: constants of their materials, and pictures of what varies over a surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bools, Float32, Int32, Int64
from ..atlas.unwrap import Atlas
from ..chunks import Fractions
from ..scene import MAX_REFLECTANCE, Scene
from ..shading import Layout, Quantity, Shader
from .by_triangle import ByTriangle
from .opacity import Opacity
from .surfaces import Surfaces, on_front
from .texels import Texels

SHOWN: tuple[Quantity, ...] = ("reflectance", "emission")
"""What is asked for at texels."""


@dataclass(frozen=True, eq=False)
class Appearance:
    """How texels look by themselves.

    Attributes:
        reflectance: (T, 3) float32
        emission: (T, 3) float32, W/(m2 sr)
        group: (T,) int32, light group of the emission

    What is alike all over a triangle is kept once for it.
    """

    reflectance: Float32 | ByTriangle
    emission: Float32 | ByTriangle
    group: ByTriangle

    def stopped(self, opacity: Opacity) -> Appearance:
        """How they look to light that they stop: what a surface reflects and emits as a whole, over its opacity.

        The pictures of both need not match to the texel: no more is reflected than can be.
        """
        reflectance = opacity.of_stopped(self.reflectance[:], MAX_REFLECTANCE)
        return replace(self, reflectance=reflectance, emission=opacity.of_stopped(self.emission[:]))


def appearance_of(
    scene: Scene, atlas: Atlas, texels: Texels, sampled: Bools, shade: Shader | None
) -> Fractions[tuple[Appearance, tuple[str, ...]]]:
    """How texels look, and warnings about what can't be as it is shown; yields the share done.

    Args:
        sampled: (F,) triangles that shine as lamps: they do not glow as well, so that nothing counts twice
        shade: tells what varies; without it everything has its material's constants
    """
    triangle = texels.triangle[:]
    material = texels.surfaces.material
    constants: dict[Quantity, Float32] = {
        "reflectance": np.array([entry.reflectance for entry in scene.materials], np.float32)[material],
        "emission": np.array([entry.emission for entry in scene.materials], np.float32)[material],
    }
    constants["emission"][sampled] = 0
    values: dict[Quantity, Float32 | ByTriangle] = {
        quantity: ByTriangle(each, texels.footprints) for quantity, each in constants.items()
    }
    said: tuple[str, ...] = ()
    for done, quantity in enumerate(SHOWN):
        varies = np.array([quantity in entry.varies for entry in scene.materials] or [False])
        asked = varies[texels.surfaces.material]
        behind = np.flatnonzero(asked[triangle] & (triangle >= texels.surfaces.fronts))
        asked[texels.surfaces.fronts :] = False  # backs look like the fronts
        if quantity == "emission":
            asked &= ~sampled
        if shade is None or not asked.any():
            continue
        yield done / len(SHOWN)
        meshes = np.bincount(texels.surfaces.mesh[asked], minlength=len(scene.meshes)) > 0
        picture = shade(Layout(atlas.size, texels.page_count, atlas.page, atlas.uv), meshes, quantity).reshape(-1, 3)
        chosen = np.flatnonzero(asked[triangle])
        colors, warnings = within_physics(
            picture[texels.pixel[chosen]], quantity, triangle[chosen], scene, texels.surfaces
        )
        found: Float32 = values[quantity][:]
        found[chosen] = colors
        _, weights = texels.footprints.at(behind, np.zeros_like(behind))
        front = texels.at(*on_front(texels.surfaces, triangle[behind], weights))
        found[behind] = found[front]
        values[quantity] = found
        said += warnings
    group = np.array([entry.group for entry in scene.materials], np.int32)[material]
    return Appearance(values["reflectance"], values["emission"], ByTriangle(group, texels.footprints)), said


def within_physics(
    colors: Float32, quantity: Quantity, triangle: Int32 | Int64, scene: Scene, surfaces: Surfaces
) -> tuple[Float32, tuple[str, ...]]:
    """Colours (C, 3) that can be, in place, and warnings that say what was wrong where.

    Args:
        triangle: (C,) on which each was seen
    """
    broken = ~np.isfinite(colors).all(1)
    colors[broken] = 0
    wrong = [
        (broken, "is not a finite number in places, which are taken as black"),
        ((colors < 0).any(1), "is negative in places, which are taken as black"),
    ]
    if quantity == "reflectance":
        wrong.append(((colors > MAX_REFLECTANCE).any(1), "is up to {:.4g} in places and limited to {}"))
    said = []
    for where, text in wrong:
        pairs = np.stack([surfaces.mesh[triangle[where]], surfaces.material[triangle[where]]], axis=1)
        found, pair = np.unique(pairs, axis=0, return_inverse=True)
        most = np.zeros(len(found), np.float32)
        np.maximum.at(most, pair.ravel(), colors[where].max(axis=1, initial=0))
        for (mesh, material), highest in zip(found, most, strict=True):
            name, what = scene.materials[material].name, text.format(highest, MAX_REFLECTANCE)
            said.append(f"{scene.meshes[mesh].name}: the {quantity} of material {name!r} {what}")
    np.clip(colors, 0, MAX_REFLECTANCE if quantity == "reflectance" else None, out=colors)
    return colors, tuple(said)
