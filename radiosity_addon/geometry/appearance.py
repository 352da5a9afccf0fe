# SPDX-License-Identifier: GPL-3.0-or-later
"""How texels look by themselves: constants of their materials, and pictures of what varies over a surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ..arrays import Bools, Float32, Int32, Int64
from ..atlas.unwrap import Atlas
from ..chunks import Fractions, scaled
from ..scene import MAX_REFLECTANCE, Scene
from ..shading import Layout, Quantity, Shader
from .by_triangle import ByTriangle
from .opacity import Opacity
from .surfaces import Surfaces, on_front
from .texels import Texels

SHOWN: tuple[Quantity, ...] = ("reflectance", "emission")
"""What is asked for at texels."""

Looks: TypeAlias = dict[Quantity, Float32 | ByTriangle]
"""Values of texels (T, 3) by quantity."""


@dataclass(frozen=True, eq=False)
class Appearance:
    """How texels look by themselves.

    Attributes:
        reflectance: (T, 3) float32
        emission: (T, 3) float32, W/(m2 sr)
        group: (T,) int32, light group of the emission
        behind: how they look from behind; None: all the same
        translucence: (T,) float32 as the reflectance, what of it leaves from the other side; None: nothing anywhere

    What is alike all over a triangle is kept once for it.
    """

    reflectance: Float32 | ByTriangle
    emission: Float32 | ByTriangle
    group: ByTriangle
    behind: Appearance | None = None
    translucence: Float32 | ByTriangle | None = None

    def stopped(self, opacity: Opacity, behind: bool = False) -> Appearance:
        """How they look to light that they stop: what a surface reflects and emits as a whole, over its opacity.

        The pictures of both need not match to the texel: no more is reflected than can be.
        """
        reflectance = opacity.of_stopped(self.reflectance[:], MAX_REFLECTANCE, behind)
        emission = opacity.of_stopped(self.emission[:], behind=behind)
        back = None if self.behind is None else self.behind.stopped(opacity, behind=True)
        return replace(self, reflectance=reflectance, emission=emission, behind=back)


def appearance_of(
    scene: Scene, atlas: Atlas, texels: Texels, sampled: Bools, shade: Shader | None, solid: Bools | None = None
) -> Fractions[tuple[Appearance, tuple[str, ...]]]:
    """How texels look, and warnings about what can't be as it is shown; yields the share done.

    Args:
        sampled: (F,) triangles that shine as lamps: they do not glow as well, so that nothing counts twice
        shade: tells what varies; without it everything has its material's constants
        solid: (F,) triangles whose backs nobody sees, if any
    """
    surfaces = texels.surfaces
    fronts = np.arange(surfaces.count) < surfaces.fronts
    group = np.array([entry.group for entry in scene.materials], np.int32)[surfaces.material]
    asking = _side(scene, atlas, texels, surfaces.material, fronts, sampled, shade)
    values, said = yield from scaled(asking, 0, 0.5)
    seen_behind = scene.behind[surfaces.material]
    unlike = fronts & (seen_behind != surfaces.material)
    if solid is not None:
        unlike &= ~solid
    others, behind = values, None
    if unlike.any():
        material = np.where(unlike, seen_behind, surfaces.material)
        asking = _side(scene, atlas, texels, material, unlike, sampled, shade, values)
        others, more = yield from scaled(asking, 0.5, 1)
        said += more
        behind = Appearance(others["reflectance"], others["emission"], ByTriangle(group, texels.footprints))
    _show_twins(values, others, scene, texels)
    look = Appearance(
        values["reflectance"],
        values["emission"],
        ByTriangle(group, texels.footprints),
        behind,
        values.get("translucence"),
    )
    return look, said


def _shown(scene: Scene) -> tuple[Quantity, ...]:
    passing = any(any(each.translucence) or "translucence" in each.varies for each in scene.materials)
    return (*SHOWN, "translucence") if passing else SHOWN


def _side(
    scene: Scene,
    atlas: Atlas,
    texels: Texels,
    material: Int32,
    chosen: Bools,
    sampled: Bools,
    shade: Shader | None,
    fronts: Looks | None = None,
) -> Fractions[tuple[Looks, tuple[str, ...]]]:
    """How one side looks of the materials (F,) of triangles.

    Args:
        chosen: (F,) triangles that are asked for
        fronts: of backs, what those look like that are not chosen
    """
    triangle = texels.triangle[:]
    seen = {} if fronts is None else {"behind": True}
    values: Looks = {}
    said: tuple[str, ...] = ()
    shown = _shown(scene)
    for done, quantity in enumerate(shown):
        constants = np.array([getattr(entry, quantity) for entry in scene.materials], np.float32)[material]
        if quantity == "emission":
            constants[sampled] = 0
        values[quantity] = ByTriangle(constants, texels.footprints)
        asked = chosen & np.array([quantity in entry.varies for entry in scene.materials] or [False])[material]
        if quantity == "emission":
            asked &= ~sampled
        painted = None if fronts is None else fronts[quantity]
        if isinstance(painted, np.ndarray):
            values[quantity] = np.where(chosen[triangle][:, None], values[quantity][:], painted)
        if shade is None or not asked.any():
            continue
        yield done / len(shown)
        meshes = np.bincount(texels.surfaces.mesh[asked], minlength=len(scene.meshes)) > 0
        layout = Layout(atlas.size, texels.page_count, atlas.page, atlas.uv)
        picture = shade(layout, meshes, quantity, **seen).reshape(-1, 3)
        own = np.flatnonzero(asked[triangle])
        colors, warnings = within_physics(picture[texels.pixel[own]], quantity, triangle[own], scene, texels.surfaces)
        found: Float32 = values[quantity][:]
        found[own] = colors
        values[quantity] = found
        said += warnings
    return values, said


def _show_twins(values: Looks, others: Looks, scene: Scene, texels: Texels) -> None:
    """Let twins look, in place, as what they are twins of does from behind, where that varies."""
    triangle = texels.triangle[:]
    for quantity in values:
        shown = others[quantity]
        if not isinstance(shown, np.ndarray):
            continue
        varies = np.array([quantity in entry.varies for entry in scene.materials])
        twins = np.flatnonzero(varies[texels.surfaces.material[triangle]] & (triangle >= texels.surfaces.fronts))
        _, weights = texels.footprints.at(twins, np.zeros_like(twins))
        found: Float32 = values[quantity][:]
        found[twins] = shown[texels.at(*on_front(texels.surfaces, triangle[twins], weights))]
        values[quantity] = found


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
