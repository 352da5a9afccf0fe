# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader trees read as what radiosity knows: how much a surface reflects, emits, and lets straight through.

Constants are read here; where a texture or anything else that Blender computes takes part, the record says what varies.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import bpy
import numpy as np

from ...arrays import Float64
from ...errors import SceneError
from ...microfacet import (
    coat_tint,
    dielectric_albedo,
    dielectric_gloss,
    mean_pane_transmittance,
    metal_albedo,
    metal_gloss,
    rough_diffuse_albedo,
    sheen_albedo,
)
from ...scene import MAX_REFLECTANCE, RGB, Gloss, Material
from ...shading import QUANTITIES, Quantity
from .nodes import (
    BEHIND,
    LIGHT_PATH,
    SHADOW_PATH,
    Groups,
    LinkCycle,
    approximate,
    follow,
    is_only_volume,
    known,
    likely,
)
from .surface_inputs import asks_ray_length, tells_sides

BLACK = np.zeros(3)
WHITE = np.ones(3)
DEFAULT_REFLECTANCE = (0.8, 0.8, 0.8)
"""Cycles' surface where there is no material."""

ALIKE = 1e-3
"""Transmittances that differ by less are the same."""

FROM_FRONT: Mapping[str, float] = {}
"""As `nodes.BEHIND`, of rays that meet a surface from the front."""

GOLDEN = (5**0.5 - 1) / 2

Warn = Callable[[str], None]
StandIn = Callable[[bpy.types.Node, str, Groups], Float64]
"""What to read of an input that is no constant, (3,)."""


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


def tree_of(owner: bpy.types.Material | bpy.types.World | bpy.types.Light) -> bpy.types.NodeTree | None:
    """The node tree in use."""
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", DeprecationWarning
        )  # `use_nodes` goes away in Blender 6, where trees are always on
        return owner.node_tree if getattr(owner, "use_nodes", True) else None


def read_tree(tree: bpy.types.NodeTree, warn: Warn) -> Shading:
    """What the output that Cycles takes shows, one constant where it varies.

    Raises:
        LinkCycle: the tree feeds back into itself
    """
    return _surface(tree, _Reader(warn, partial(approximate, warn=warn)))


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

    return _surface(tree, _Reader(refuse, refuse, path))


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
    shown = _surface(tree, _Reader(warn or _say_nothing, stand_in, {**LIGHT_PATH, **side}))
    passed = _surface(tree, _Reader(_say_nothing, stand_in, {**SHADOW_PATH, **side}))
    through = {"transmittance": passed.transmittance, "refracted": passed.refracted}
    return replace(shown, **through, indirect=shown.transmittance)


def _surface(tree: bpy.types.NodeTree, reader: _Reader) -> Shading:
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


def rgb(values: Float64) -> RGB:
    """A triple of plain numbers."""
    return (float(values[0]), float(values[1]), float(values[2]))


def _finite(values: Float64, subject: str, what: str) -> Float64:
    if not np.isfinite(values).all():
        raise SceneError(subject, f"its {what} is not a finite number", "Give its shader finite colours and strengths")
    return values


class _Reader:
    """Walks a tree from its output; the nodes being read tell a cycle."""

    def __init__(self, warn: Warn, stand_in: StandIn, path: Mapping[str, float] = LIGHT_PATH) -> None:
        self.warn = warn
        self.stand_in = stand_in
        self.path = path
        self.reading: list[tuple[str, ...]] = []

    def shading(self, node: bpy.types.Node, name: str | int, groups: Groups) -> Shading:
        """What the shader linked to an input gives; nothing if there is none."""
        end, inner = follow(node.inputs[name], groups)
        if not end.is_output:
            return NOTHING
        place = (*(group.name for group in inner), end.node.name)
        if place in self.reading:
            raise LinkCycle
        if "Normal" in end.node.inputs and follow(end.node.inputs["Normal"], inner)[0].is_output:
            self.warn(f"the bumps of {end.node.name} are ignored: it is lit as the flat surface below them")
        read = READERS.get(end.node.type)
        if read is None:
            self.warn(f"{end.node.bl_label} is not read; a grey diffuse surface stands in")
            return Shading(np.array(DEFAULT_REFLECTANCE))
        self.reading.append(place)
        shading = read(self, end.node, inner)
        self.reading.pop()
        return shading

    def color(self, node: bpy.types.Node, name: str, groups: Groups) -> Float64:
        constant = known(node.inputs[name], groups, self.path)
        return self.stand_in(node, name, groups) if constant is None else constant

    def number(self, node: bpy.types.Node, name: str, groups: Groups) -> float:
        return float(self.color(node, name, groups).sum()) / 3

    def share(self, node: bpy.types.Node, name: str, groups: Groups) -> float:
        return min(max(self.number(node, name, groups), 0.0), 1.0)


def _principled(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    """Layers from the base up, each dimmed by what the ones above reflect (Cycles' albedo scaling)."""
    base = reader.color(node, "Base Color", groups)
    roughness = reader.share(node, "Roughness", groups)
    tint = reader.color(node, "Specular Tint", groups)
    multiscatter = node.distribution == "MULTI_GGX"
    metallic = reader.share(node, "Metallic", groups)
    transmission = reader.share(node, "Transmission Weight", groups)
    shading = NOTHING
    if metallic < 1:
        ior = max(reader.number(node, "IOR", groups), 1.0)
        level = max(reader.number(node, "Specular IOR Level", groups), 0.0)
        gloss = dielectric_albedo(roughness, ior, rgb(tint), 2 * level, multiscatter)
        facets = (dielectric_gloss(roughness, ior, rgb(tint), 2 * level),)
        diffuse = (1 - gloss.max()) * _rough(reader, node, "Diffuse Roughness", base, groups)
        through = diffuse * _thin_share(reader, node, groups)
        shading = Shading(gloss + diffuse, translucence=through, glosses=facets) * (1 - transmission)
        # what goes in and comes out again passes two surfaces, and is coloured once
        pane = glass(np.sqrt(np.clip(base, 0, 1)), ior)
        shading = shading + replace(pane, reflectance=pane.reflectance.max() * WHITE) * transmission
    if metallic > 0:
        facets = (metal_gloss(roughness, rgb(base), rgb(tint)),)
        metal = Shading(metal_albedo(roughness, rgb(base), rgb(tint), multiscatter), glosses=facets)
        shading = metal * metallic + shading * (1 - metallic)
    emission = reader.number(node, "Emission Strength", groups) * reader.color(node, "Emission Color", groups)
    shading = shading + Shading(emission=emission)
    coat = reader.share(node, "Coat Weight", groups)
    if coat > 0:
        rough, ior = reader.share(node, "Coat Roughness", groups), reader.number(node, "Coat IOR", groups)
        gloss = coat * dielectric_albedo(rough, max(ior, 1.0), multiscatter=False)
        facets = (dielectric_gloss(rough, max(ior, 1.0)),)
        tinted = 1 - coat + coat * coat_tint(reader.color(node, "Coat Tint", groups), max(ior, 1.0))
        shading = shading * (tinted * (1 - gloss))
        shading = shading + Shading(gloss, glosses=(Shading(glosses=facets) * coat).glosses)
    sheen = reader.share(node, "Sheen Weight", groups)
    if sheen > 0:
        white = sheen * sheen_albedo(reader.share(node, "Sheen Roughness", groups))
        fibres = white * reader.color(node, "Sheen Tint", groups)
        shading = shading * (1 - min(fibres.max(), 1.0)) + Shading(fibres)
    if transmission > 0:
        reader.warn(f"light passes {node.name} unbent")
    for name, text in LEFT_OUT.items():
        if name == "Subsurface Weight" and _is_thin(reader, node, groups):
            continue
        if name in node.inputs and reader.number(node, name, groups) > 0:
            reader.warn(text.format(node.name))
    alpha = reader.share(node, "Alpha", groups)
    return shading * alpha + clear((1 - alpha) * WHITE)


def _is_thin(reader: _Reader, node: bpy.types.Node, groups: Groups) -> bool:
    return "Thin Wall" in node.inputs and reader.share(node, "Thin Wall", groups) > 0.5


def _thin_share(reader: _Reader, node: bpy.types.Node, groups: Groups) -> float:
    """Share of the diffuse light of a wall without a volume that subsurface scattering lets through, as Cycles has it:
    half of it, more where it scatters forward.
    """
    if not _is_thin(reader, node, groups):
        return 0.0
    forward = min(max(reader.number(node, "Subsurface Anisotropy", groups), -1.0), 1.0)
    return reader.share(node, "Subsurface Weight", groups) * (1 + forward) / 2


LEFT_OUT = {
    "Subsurface Weight": "light that enters {} leaves where it came in: what scatters below the surface is ignored",
    "Thin Film Thickness": "the thin film of {} is ignored",
    "Anisotropic": "the gloss of {} is taken as alike in all directions",
}
"""Inputs of a Principled that bring something which has no part in diffuse light, and what is done instead."""


def _diffuse(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    return Shading(_rough(reader, node, "Roughness", reader.color(node, "Color", groups), groups))


def _rough(reader: _Reader, node: bpy.types.Node, name: str, color: Float64, groups: Groups) -> Float64:
    """The albedo of a diffuse surface of a colour, whose roughness is an input (of a Principled from 4.3 on)."""
    roughness = reader.share(node, name, groups) if name in node.inputs else 0.0
    return rough_diffuse_albedo(color, roughness) if roughness > 0 else color


def _sheen(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    if node.distribution != "MICROFIBER":
        return _stand_in(reader, node, groups)
    return Shading(reader.color(node, "Color", groups) * sheen_albedo(reader.share(node, "Roughness", groups)))


def _scattering(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    reader.warn(f"light that enters {node.name} leaves where it came in: what scatters below the surface is ignored")
    return Shading(reader.color(node, "Color", groups))


def _translucent(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    color = reader.color(node, "Color", groups)
    return Shading(color, translucence=color)


def _stand_in(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    reader.warn(f"{node.name} is no {node.bl_label}: a diffuse surface of its colour stands in")
    return Shading(reader.color(node, "Color", groups))


def _portal(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    reader.warn(f"{node.name} leads no light elsewhere: it is black")
    return NOTHING


def _glossy(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    color = reader.color(node, "Color", groups)
    roughness = reader.share(node, "Roughness", groups)
    facets = (metal_gloss(roughness, rgb(WHITE)),)
    if node.distribution == "MULTI_GGX":
        return Shading(WHITE, glosses=facets) * color  # the facets' own losses are given back
    return Shading(metal_albedo(roughness, rgb(WHITE), multiscatter=False), glosses=facets) * color


def _metallic(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    if node.fresnel_type != "F82":
        reader.warn(f"{node.name} is read by its base and edge colours, not by its index of refraction")
    base, edge = (rgb(reader.color(node, name, groups)) for name in ("Base Color", "Edge Tint"))
    roughness = reader.share(node, "Roughness", groups)
    albedo = metal_albedo(roughness, base, edge, node.distribution == "MULTI_GGX")
    return Shading(albedo, glosses=(metal_gloss(roughness, base, edge),))


def _glass(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    reader.warn(f"light passes {node.name} unbent")
    return glass(reader.color(node, "Color", groups), reader.number(node, "IOR", groups))


def _refraction(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    reader.warn(f"light passes {node.name} unbent")
    return _clear(reader, node, groups)


def _clear(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    return clear(reader.color(node, "Color", groups))


def _black(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    return NOTHING


def _emission(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    return Shading(emission=reader.color(node, "Color", groups) * reader.number(node, "Strength", groups))


def _mix(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    factor = reader.share(node, "Fac" if "Fac" in node.inputs else "Factor", groups)
    first = reader.shading(node, 1, groups) if factor < 1 else NOTHING
    second = reader.shading(node, 2, groups) if factor > 0 else NOTHING
    return first * (1 - factor) + second * factor


def _add(reader: _Reader, node: bpy.types.Node, groups: Groups) -> Shading:
    return reader.shading(node, 0, groups) + reader.shading(node, 1, groups)


READERS: dict[str, Callable[[_Reader, bpy.types.Node, Groups], Shading]] = {
    "BSDF_PRINCIPLED": _principled,
    "BSDF_DIFFUSE": _diffuse,
    "BSDF_TOON": _stand_in,
    "BSDF_SHEEN": _sheen,
    "BSDF_HAIR": _stand_in,
    "BSDF_HAIR_PRINCIPLED": _stand_in,
    "BSDF_TRANSLUCENT": _translucent,
    "BSDF_RAY_PORTAL": _portal,
    "SUBSURFACE_SCATTERING": _scattering,
    "BSDF_GLOSSY": _glossy,
    "BSDF_METALLIC": _metallic,
    "BSDF_GLASS": _glass,
    "BSDF_REFRACTION": _refraction,
    "BSDF_TRANSPARENT": _clear,
    "HOLDOUT": _black,
    "EMISSION": _emission,
    "BACKGROUND": _emission,
    "MIX_SHADER": _mix,
    "ADD_SHADER": _add,
}
