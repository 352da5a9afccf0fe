# SPDX-License-Identifier: GPL-3.0-or-later
"""How texels look by themselves: constants of their materials, and pictures of what varies over a surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .arrays import Bools, Float32, Int32, Int64
from .chunks import Fractions
from .opacity import Opacity
from .scene import MAX_REFLECTANCE, Scene
from .shading import Layout, Quantity, Shader
from .texels import Texels
from .unwrap import Atlas

SHOWN: tuple[Quantity, ...] = ("reflectance", "emission")
"""What is asked for at texels."""

BLOCK = 1 << 16
"""Texels treated in one go."""


@dataclass(frozen=True, eq=False)
class Appearance:
    """How texels look by themselves.

    Attributes:
        reflectance: (T, 3) float32
        emission: (T, 3) float32, W/(m2 sr)
        group: (T,) int32, light group of the emission
    """

    reflectance: Float32
    emission: Float32
    group: Int32

    def without(self, texels: Texels, sampled: Bools) -> Appearance:
        """Leave out the glow of triangles `sampled` (F,) as lamps, so that nothing counts twice: changes this look."""
        self.emission[sampled[texels.triangle[:, 0]]] = 0
        return self

    def stopped(self, opacity: Opacity) -> Appearance:
        """How they look to light that they stop: what a surface reflects and emits as a whole, over its opacity.

        The pictures of both need not match to the texel: no more is reflected than can be.
        """
        reflectance = opacity.of_stopped(self.reflectance, MAX_REFLECTANCE)
        return replace(self, reflectance=reflectance, emission=opacity.of_stopped(self.emission))


def appearance_of(
    scene: Scene, atlas: Atlas, texels: Texels, shade: Shader | None
) -> Fractions[tuple[Appearance, tuple[str, ...]]]:
    """How texels look, and warnings about what can't be as it was shown; yields the share done.

    Args:
        shade: tells what varies; without it everything has its material's constants
    """
    material = texels.surfaces.material[texels.triangle[:, 0]]
    values: dict[Quantity, Float32] = {
        "reflectance": np.array([entry.reflectance for entry in scene.materials], np.float32)[material],
        "emission": np.array([entry.emission for entry in scene.materials], np.float32)[material],
    }
    warnings: list[str] = []
    for done, quantity in enumerate(SHOWN if shade is not None else ()):
        varies = np.array([quantity in entry.varies for entry in scene.materials], bool)
        if shade is None or not varies.any():
            continue
        yield done / len(SHOWN)
        layout = Layout(atlas.size, texels.page_count, atlas.page, atlas.uv)
        meshes = np.array([bool(varies[mesh.material].any()) for mesh in scene.meshes], bool)
        picture = shade(layout, meshes, quantity).reshape(-1, 3)
        chosen = np.flatnonzero(varies[material])
        for start in range(0, len(chosen), BLOCK):
            part = chosen[start : start + BLOCK]
            values[quantity][part] = picture[texels.pixel[part]]
        warnings += _repaired(values[quantity], quantity, chosen, scene, texels)
    group = np.array([entry.group for entry in scene.materials], np.int32)[material]
    return Appearance(values["reflectance"], values["emission"], group), tuple(warnings)


def _repaired(colors: Float32, quantity: Quantity, chosen: Int64, scene: Scene, texels: Texels) -> tuple[str, ...]:
    """Bring `colors` (T, 3) of texels `chosen` (C,) within physics, in place; returns what was wrong where."""
    shown = colors[chosen]
    broken = ~np.isfinite(shown).all(1)
    shown[broken] = 0
    messages = [(broken, "is not a finite number in places, which are taken as black")]
    messages.append(((shown < 0).any(1), "is negative in places, which are taken as black"))
    if quantity == "reflectance":
        too_much = (shown > MAX_REFLECTANCE).any(1)
        messages.append((too_much, f"is up to {shown.max(initial=0):.4g} in places and limited to {MAX_REFLECTANCE}"))
    colors[chosen] = np.clip(shown, 0, MAX_REFLECTANCE if quantity == "reflectance" else None)
    surfaces = texels.surfaces
    said = []
    for wrong, text in messages:
        triangle = texels.triangle[chosen[wrong], 0]
        pairs = np.stack([surfaces.mesh[triangle], surfaces.material[triangle]], axis=1)
        for mesh, material in np.unique(pairs, axis=0):
            name = scene.materials[material].name
            said.append(f"{scene.meshes[mesh].name}: the {quantity} of material {name!r} {text}")
    return tuple(said)
