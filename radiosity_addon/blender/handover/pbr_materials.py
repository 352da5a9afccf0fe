# SPDX-License-Identifier: GPL-3.0-or-later
"""The user's materials as glTF can hold them: one Principled BSDF of constants and pictures, one copy a lightmap.

A Principled that an output shows stays as it is. Any other tree is read as the colours that it reflects, emits and lets
through, by the reader that lit materials are made with, and becomes a Principled without gloss. Colours that are
computed otherwise than by a picture alone are painted onto pages like those of the light; what else is, is a constant.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import bpy
import numpy as np

from ...arrays import Float64
from ...shading import Quantity
from ..data.names import BAKE_KEY, PREVIEW_KEY
from ..looks.closures import rgb
from ..looks.materials import read_varying
from ..looks.node_arithmetic import BLACK, Color
from ..looks.nodes import Groups, LinkCycle, approximate, follow, known, tree_of
from ..looks.preview_nodes import ShaderReader
from ..looks.shaders import DEFAULT_REFLECTANCE

HELD = ("TEX_IMAGE", "VERTEX_COLOR", "ATTRIBUTE")
"""Nodes that glTF has: pictures and colours of vertices."""
SHAPE = ("Normal", "Coat Normal", "Tangent")
"""Inputs that are no colours and no numbers."""
PAINTED: dict[str, Quantity] = {
    "Base Color": "reflectance",
    "Emission Color": "emission",
    "Emission Strength": "emission",
}
"""What stands for an input where it is computed."""

Side = Literal["both", "front", "back"]


@dataclass(frozen=True)
class LitBy:
    """Where a material finds its light.

    Attributes:
        page: index
        place: the lightmap's uv are scale * uv + (u, v), as (scale, u, v); None where the uv map says it all
        side: of the faces; of two-sided objects each has a lightmap of its own
    """

    page: int
    place: tuple[float, float, float] | None = None
    side: Side = "both"


class PbrMaterials:
    """Copies of materials for one export.

    Attributes:
        names: by the name of each copy, that of the user's material
        lit: by the name of each copy, where it finds its light
        painted: by the name of each copy, which of its colours are to be painted onto pages
        warnings: what glTF can't hold, each said once
    """

    def __init__(self, token: str) -> None:
        """Args:
        token: all that is made carries it
        """
        self.token = token
        self.names: dict[str, str] = {}
        self.lit: dict[str, LitBy] = {}
        self.painted: dict[str, set[Quantity]] = {}
        self.warnings: dict[str, None] = {}
        self._made: dict[tuple[int, LitBy | None], bpy.types.Material] = {}

    def of(self, material: bpy.types.Material | None, lit_by: LitBy | None) -> bpy.types.Material:
        """The material's copy for a lightmap, or for none; for an empty slot one in the grey that Cycles gives it."""
        key = (0 if material is None else material.session_uid, lit_by)
        if key not in self._made:
            copy = self._made[key] = self._make(material, lit_by is not None and lit_by.side != "back")
            self.names[copy.name] = "Empty" if material is None else material.name
            if lit_by is not None:
                self.lit[copy.name] = lit_by
                copy.use_backface_culling = copy.use_backface_culling or lit_by.side != "both"
        return self._made[key]

    def _make(self, material: bpy.types.Material | None, paintable: bool) -> bpy.types.Material:
        copy = bpy.data.materials.new("Empty") if material is None else material.copy()
        copy[BAKE_KEY], copy[PREVIEW_KEY] = self.token, True
        copy.use_fake_user = False
        copy.asset_clear()
        tree = tree_of(copy)
        if material is None or tree is None:
            self._plain(copy, DEFAULT_REFLECTANCE if material is None else tuple(copy.diffuse_color[:3]))
            return copy
        try:
            painted = self._fit(tree, material.name, paintable)
        except LinkCycle:
            self._plain(copy, DEFAULT_REFLECTANCE)
            return copy
        if painted:
            self.painted[copy.name] = painted
        return copy

    def _plain(self, copy: bpy.types.Material, albedo: Color) -> None:
        if tree_of(copy) is None:
            copy.use_nodes = True
        tree = copy.node_tree
        tree.nodes.clear()
        end = tree.nodes.new("ShaderNodeOutputMaterial")
        _show(ShaderReader(tree, self.token), end, albedo, BLACK, BLACK)

    def _fit(self, tree: bpy.types.NodeTree, name: str, paintable: bool) -> set[Quantity]:
        """Let a tree's output show a Principled that glTF can hold; returns what is to be painted for it."""
        end = tree.get_output_node("CYCLES") or tree.get_output_node("EEVEE")
        if end is None:
            end = tree.nodes.new("ShaderNodeOutputMaterial")
        mean, varies = read_varying(tree, lambda message: None)
        may_paint = varies if paintable else frozenset()
        shown, groups = follow(end.inputs["Surface"], ())
        if not (shown.is_output and shown.node.type == "BSDF_PRINCIPLED" and not groups):
            reader = ShaderReader(tree, self.token)
            look = reader.look(end.inputs["Surface"])
            _show(reader, end, look.albedo, look.emission, look.through)
            shown, groups = follow(end.inputs["Surface"], ())
            means = {
                "Base Color": np.maximum(mean.reflectance, 0),
                "Emission Color": np.maximum(mean.emission, 0),
                "Alpha": 1 - np.clip(mean.transmittance, 0, 1),
            }
            for name_of_input, about in means.items():
                if shown.node.inputs[name_of_input].is_linked:
                    _hold(shown.node.inputs[name_of_input], about)
        end.is_active_output = True
        linked = [socket for socket in shown.node.inputs if socket.is_linked and socket.name not in SHAPE]
        painted = {self._settle(socket, groups, name, may_paint) for socket in linked} - {None}
        if "emission" in painted:
            _unlink(shown.node.inputs["Emission Color"], np.zeros(3))
        return painted

    def _settle(
        self, socket: bpy.types.NodeSocket, groups: Groups, name: str, may_paint: Collection[Quantity]
    ) -> Quantity | None:
        """Put a constant in the place of what glTF can't compute; returns what is to be painted in its place."""
        value = known(socket, groups)
        if value is None:
            source = follow(socket, groups)[0].node
            if source.type in HELD:
                return None
            paint = PAINTED.get(socket.name)
            if paint in may_paint:
                _unlink(socket, np.ones(3))
                return paint
            if _has_picture(socket):
                self._warn(name, f"{socket.name} is exported as its picture alone, without {source.bl_label}")
                return None
            value = approximate(socket.node, socket.name, groups, lambda message: self._warn(name, message))
        _unlink(socket, value)
        return None

    def _warn(self, name: str, message: str) -> None:
        self.warnings[f"Material {name!r}: {message}"] = None


def _show(reader: ShaderReader, end: bpy.types.Node, albedo: Color, emission: Color, through: Color) -> None:
    """Let an output show a Principled of these colours, which reflects diffusely."""
    shader = reader.node("ShaderNodeBsdfPrincipled")
    shader.inputs["Roughness"].default_value = 1.0
    shader.inputs["Specular IOR Level"].default_value = 0.0
    reader.feed(albedo, shader.inputs["Base Color"])
    reader.feed(emission, shader.inputs["Emission Color"])
    shader.inputs["Emission Strength"].default_value = 1.0
    opacity = reader.complement(through)
    if isinstance(opacity, tuple):
        shader.inputs["Alpha"].default_value = float(np.clip(np.mean(opacity), 0, 1))
    else:
        reader.tree.links.new(opacity, shader.inputs["Alpha"])
    reader.tree.links.new(shader.outputs[0], end.inputs["Surface"])


def _has_picture(socket: bpy.types.NodeSocket) -> bool:
    return any(_behind(link.from_node) for link in socket.links if not link.is_muted)


def _behind(node: bpy.types.Node) -> bool:
    """Whether a picture, or colours of vertices, take part in what a node computes."""
    waiting, seen = [node], set()
    while waiting:
        node = waiting.pop()
        if node.type in HELD:
            return True
        seen.add(node)
        if node.type == "GROUP" and node.node_tree is not None:
            waiting += [inner for inner in node.node_tree.nodes if inner not in seen]
        waiting += [link.from_node for socket in node.inputs for link in socket.links if link.from_node not in seen]
    return False


def _unlink(socket: bpy.types.NodeSocket, value: Float64) -> None:
    """Give an input a constant in place of its link."""
    for link in list(socket.links):
        socket.id_data.links.remove(link)
    _hold(socket, value)


def _hold(socket: bpy.types.NodeSocket, value: Float64) -> None:
    held = (*rgb(value), 1.0)
    socket.default_value = float(value.mean()) if socket.type == "VALUE" else held[: len(socket.default_value)]
