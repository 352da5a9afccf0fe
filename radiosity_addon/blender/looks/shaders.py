# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader nodes: what each makes of its inputs, and how they are joined."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import bpy
import numpy as np

from ...arrays import Float64
from ...microfacet import (
    coat_tint,
    dielectric_albedo,
    dielectric_gloss,
    metal_albedo,
    metal_gloss,
    rough_diffuse_albedo,
    sheen_albedo,
)
from .closures import NOTHING, WHITE, Shading, clear, glass, rgb
from .nodes import LIGHT_PATH, Groups, LinkCycle, follow, known

DEFAULT_REFLECTANCE = (0.8, 0.8, 0.8)
"""Cycles' surface where there is no material."""

Warn = Callable[[str], None]
StandIn = Callable[[bpy.types.Node, str, Groups], Float64]
"""What to read of an input that is no constant, (3,)."""

LEFT_OUT = {
    "Subsurface Weight": "light that enters {} leaves where it came in: what scatters below the surface is ignored",
    "Thin Film Thickness": "the thin film of {} is ignored",
    "Anisotropic": "the gloss of {} is taken as alike in all directions",
}
"""Inputs of a Principled that bring something which has no part in diffuse light, and what is done instead."""


class ClosureReader:
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


def _principled(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
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


def _is_thin(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> bool:
    return "Thin Wall" in node.inputs and reader.share(node, "Thin Wall", groups) > 0.5


def _thin_share(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> float:
    """Share of the diffuse light of a wall without a volume that subsurface scattering lets through, as Cycles has it:
    half of it, more where it scatters forward.
    """
    if not _is_thin(reader, node, groups):
        return 0.0
    forward = min(max(reader.number(node, "Subsurface Anisotropy", groups), -1.0), 1.0)
    return reader.share(node, "Subsurface Weight", groups) * (1 + forward) / 2


def _diffuse(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    return Shading(_rough(reader, node, "Roughness", reader.color(node, "Color", groups), groups))


def _rough(reader: ClosureReader, node: bpy.types.Node, name: str, color: Float64, groups: Groups) -> Float64:
    """The albedo of a diffuse surface of a colour, whose roughness is an input (of a Principled from 4.3 on)."""
    roughness = reader.share(node, name, groups) if name in node.inputs else 0.0
    return rough_diffuse_albedo(color, roughness) if roughness > 0 else color


def _sheen(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    if node.distribution != "MICROFIBER":
        return _stand_in(reader, node, groups)
    return Shading(reader.color(node, "Color", groups) * sheen_albedo(reader.share(node, "Roughness", groups)))


def _scattering(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    reader.warn(f"light that enters {node.name} leaves where it came in: what scatters below the surface is ignored")
    return Shading(reader.color(node, "Color", groups))


def _translucent(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    color = reader.color(node, "Color", groups)
    return Shading(color, translucence=color)


def _stand_in(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    reader.warn(f"{node.name} is no {node.bl_label}: a diffuse surface of its colour stands in")
    return Shading(reader.color(node, "Color", groups))


def _portal(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    reader.warn(f"{node.name} leads no light elsewhere: it is black")
    return NOTHING


def _glossy(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    color = reader.color(node, "Color", groups)
    roughness = reader.share(node, "Roughness", groups)
    facets = (metal_gloss(roughness, rgb(WHITE)),)
    if node.distribution == "MULTI_GGX":
        return Shading(WHITE, glosses=facets) * color  # the facets' own losses are given back
    return Shading(metal_albedo(roughness, rgb(WHITE), multiscatter=False), glosses=facets) * color


def _metallic(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    if node.fresnel_type != "F82":
        reader.warn(f"{node.name} is read by its base and edge colours, not by its index of refraction")
    base, edge = (rgb(reader.color(node, name, groups)) for name in ("Base Color", "Edge Tint"))
    roughness = reader.share(node, "Roughness", groups)
    albedo = metal_albedo(roughness, base, edge, node.distribution == "MULTI_GGX")
    return Shading(albedo, glosses=(metal_gloss(roughness, base, edge),))


def _glass(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    reader.warn(f"light passes {node.name} unbent")
    return glass(reader.color(node, "Color", groups), reader.number(node, "IOR", groups))


def _refraction(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    reader.warn(f"light passes {node.name} unbent")
    return _clear(reader, node, groups)


def _clear(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    return clear(reader.color(node, "Color", groups))


def _black(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    return NOTHING


def _emission(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    return Shading(emission=reader.color(node, "Color", groups) * reader.number(node, "Strength", groups))


def _mix(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    factor = reader.share(node, "Fac" if "Fac" in node.inputs else "Factor", groups)
    first = reader.shading(node, 1, groups) if factor < 1 else NOTHING
    second = reader.shading(node, 2, groups) if factor > 0 else NOTHING
    return first * (1 - factor) + second * factor


def _add(reader: ClosureReader, node: bpy.types.Node, groups: Groups) -> Shading:
    return reader.shading(node, 0, groups) + reader.shading(node, 1, groups)


READERS: dict[str, Callable[[ClosureReader, bpy.types.Node, Groups], Shading]] = {
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
