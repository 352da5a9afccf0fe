# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials as radiosity knows them, read from their trees.

Constants are read here; where a texture or anything else that Blender computes takes part, the record says what varies.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import bpy
import numpy as np

from ...arrays import Float64
from ...errors import SceneError
from ...scene import MAX_REFLECTANCE, Material
from ...shading import QUANTITIES, Quantity
from .closures import NOTHING, WHITE, Shading, clear, rgb
from .nodes import BEHIND, LIGHT_PATH, SHADOW_PATH, Groups, approximate, is_only_volume, likely, tree_of
from .shaders import DEFAULT_REFLECTANCE, ClosureReader, StandIn, Warn
from .surface_inputs import asks_ray_length, tells_sides

ALIKE = 1e-3
"""Transmittances that differ by less are the same."""

FROM_FRONT: Mapping[str, float] = {}
"""As `nodes.BEHIND`, of rays that meet a surface from the front."""

GOLDEN = (5**0.5 - 1) / 2


def read_sides(material: bpy.types.Material | None, group: int, warn: Warn) -> tuple[Material, Material | None]:
    """A material's records: from the front and, if it looks otherwise there, from behind.

    Raises as `read_material`.
    """
    front = read_material(material, group, warn)
    tree = None if material is None else tree_of(material)
    if tree is None or not tells_sides(tree):
        return front, None
    back = read_material(material, group, warn, BEHIND)
    if back == front and not front.varies:
        return front, None
    shared = {"varies": front.varies | back.varies, "group": max(front.group, back.group)}
    return replace(front, **shared), replace(back, **shared)


def read_material(
    material: bpy.types.Material | None, group: int, warn: Warn, side: Mapping[str, float] = FROM_FRONT
) -> Material:
    """A material's record; `warn` hears what had to be approximated.

    Args:
        side: what the rays are besides, by output of the Geometry node

    Raises:
        SceneError: it emits NaN or infinity
        LinkCycle: its node tree feeds back into itself
    """
    if material is None:
        return Material("", DEFAULT_REFLECTANCE)
    tree = tree_of(material)
    varies: frozenset[Quantity] = frozenset()
    if tree is None:
        shading = Shading(np.array(material.diffuse_color[:3], np.float64))
    else:
        shading, varies = read_varying(tree, warn, side)
        if asks_ray_length(tree):
            warn("looks otherwise from near than from afar by the length of rays, which is taken as 0")
    subject = f"Material {material.name!r}"
    emission = _finite(shading.emission, subject, "emission")
    reflectance = _finite(shading.reflectance, subject, "reflectance")
    transmittance = _finite(shading.transmittance, subject, "transparency")
    if reflectance.max() > MAX_REFLECTANCE and "reflectance" not in varies:
        warn(f"reflects {reflectance.max():.4g} of the light and is limited to {MAX_REFLECTANCE}")
    if min(reflectance.min(), emission.min()) < 0:
        warn("has a negative colour, which is taken as black")
    indirect = shading.indirect
    if indirect is not None and ("transmittance" in varies or np.abs(indirect - transmittance).max() < ALIKE):
        indirect = None
    held = np.clip(reflectance, 0, MAX_REFLECTANCE)
    through = np.divide(shading.translucence, reflectance, out=np.zeros(3), where=reflectance > 0)
    translucence = held * np.clip(through, 0, 1)
    passes = (
        (transmittance if indirect is None else indirect).any()
        or translucence.any()
        or varies & {"transmittance", "translucence"}
    )
    return Material(
        name=material.name,
        reflectance=rgb(held),
        emission=rgb(np.maximum(emission, 0)),
        group=group if emission.any() or "emission" in varies else 0,
        transmittance=rgb(np.clip(transmittance, 0, 1)),
        indirect_transmittance=None if indirect is None else rgb(np.clip(indirect, 0, 1)),
        ior=float(np.clip(shading.refracted.sum() / max(transmittance.sum(), 1e-9), 1, None))
        if transmittance.any()
        else 1.0,
        glosses=() if passes else shading.glosses,
        translucence=rgb(translucence),
        varies=varies,
    )


def read_tree(tree: bpy.types.NodeTree, warn: Warn) -> Shading:
    """What the output that Cycles takes shows, one constant where it varies.

    Raises:
        LinkCycle: the tree feeds back into itself
    """
    return _surface(tree, ClosureReader(warn, partial(approximate, warn=warn)))


class Computed(Exception):
    """A tree's output is no constant."""


def read_constant(tree: bpy.types.NodeTree, path: Mapping[str, float] = LIGHT_PATH) -> Shading:
    """What the output that Cycles takes shows, if that is one constant.

    Raises:
        Computed: it is not, or only Cycles knows
        LinkCycle: the tree feeds back into itself
    """

    def refuse(*_: object) -> Float64:
        raise Computed

    return _surface(tree, ClosureReader(refuse, refuse, path))


def read_varying(
    tree: bpy.types.NodeTree, warn: Warn, side: Mapping[str, float] = FROM_FRONT
) -> tuple[Shading, frozenset[Quantity]]:
    """What the output that Cycles takes shows on average, and which of it varies over the surface.

    A quantity varies if it is not the same for two guesses at what is computed.

    Raises:
        LinkCycle: the tree feeds back into itself
    """
    guesses = _Guesses(0), _Guesses(1)
    first = _as_rays_meet_it(tree, side, guesses[0], warn)
    if not guesses[0].made:
        return first, frozenset()
    second = _as_rays_meet_it(tree, side, guesses[1])
    differ = first.unlike(second)
    mean = _as_rays_meet_it(tree, side, lambda node, name, groups: likely(node.inputs[name], groups))
    mean = replace(mean, glosses=mean.glosses if first.glosses == second.glosses else ())
    return mean, frozenset(quantity for quantity in QUANTITIES if quantity in differ)


def _as_rays_meet_it(
    tree: bpy.types.NodeTree, side: Mapping[str, float], stand_in: StandIn, warn: Warn | None = None
) -> Shading:
    """What shadow rays are let through, and what others see."""
    shown = _surface(tree, ClosureReader(warn or _say_nothing, stand_in, {**LIGHT_PATH, **side}))
    passed = _surface(tree, ClosureReader(_say_nothing, stand_in, {**SHADOW_PATH, **side}))
    through = {"transmittance": passed.transmittance, "refracted": passed.refracted}
    return replace(shown, **through, indirect=shown.transmittance)


def _surface(tree: bpy.types.NodeTree, reader: ClosureReader) -> Shading:
    output = tree.get_output_node("CYCLES")
    if output is None:
        return NOTHING
    for name, text in (("Volume", "a volume, which is"), ("Displacement", "displacement, which is")):
        if name in output.inputs and output.inputs[name].links:
            reader.warn(f"has {text} ignored")
    return clear(WHITE) if is_only_volume(output) else reader.shading(output, "Surface", ())


def _say_nothing(message: str) -> None:
    """For readings whose warnings were given before."""


class _Guesses:
    """Guesses at inputs that are computed: no two the same, none 0 or 1, where shaders turn branches off."""

    def __init__(self, row: int) -> None:
        self.row = row
        self.made = 0

    def __call__(self, node: bpy.types.Node, name: str, groups: Groups) -> Float64:
        self.made += 1
        steps = 3 * self.made + np.arange(3)
        return np.asarray(0.2 + 0.6 * ((GOLDEN * steps + self.row / np.pi) % 1))


def _finite(values: Float64, subject: str, what: str) -> Float64:
    if not np.isfinite(values).all():
        raise SceneError(subject, f"its {what} is not a finite number", "Give its shader finite colours and strengths")
    return values
