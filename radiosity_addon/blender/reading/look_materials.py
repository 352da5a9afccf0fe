# SPDX-License-Identifier: GPL-3.0-or-later
"""Material copies that emit how they look, one quantity as one colour, for Cycles to bake."""

from __future__ import annotations

import uuid
from collections.abc import Sequence

import bpy

from ...shading import Quantity
from ..data.names import BAKE_KEY
from ..looks.nodes import BEHIND, LIGHT_PATH, SEE_ANGLES, SHADOW_PATH, from_all_around, tree_of
from ..looks.preview_nodes import Color, Look, ShaderReader
from ..looks.surface_inputs import Input, ask_attributes


class LookMaterials:
    """Copies for one quantity; `remove` takes them out again."""

    def __init__(self, quantity: Quantity, asked: Sequence[Input], behind: bool) -> None:
        """Args:
        quantity: what the copies emit
        asked: all that their trees ask for
        behind: as what they cover looks from there
        """
        self.quantity = quantity
        self.behind = behind
        self.names = {wanted: f"radiosity input {number}" for number, wanted in enumerate(asked)}
        self.token = uuid.uuid4().hex
        self._groups: dict[int, bpy.types.NodeTree] = {}
        self._made: dict[int, bpy.types.Material] = {}

    def of(self, material: bpy.types.Material) -> bpy.types.Material:
        """The material's copy."""
        if material.session_uid not in self._made:
            self._made[material.session_uid] = self._make(material)
        return self._made[material.session_uid]

    def aim(self, image: bpy.types.Image) -> None:
        """Let bakes of all copies go into an image."""
        for material in self._made.values():
            material.node_tree.nodes.active.image = image

    def remove(self) -> None:
        """Take all copies out."""
        for kind in (bpy.data.materials, bpy.data.node_groups):
            for made in [datablock for datablock in kind if datablock.get(BAKE_KEY) == self.token]:
                kind.remove(made)

    def _make(self, material: bpy.types.Material) -> bpy.types.Material:
        copy = material.copy()
        copy[BAKE_KEY] = self.token
        copy.use_fake_user = False
        copy.asset_clear()
        tree = tree_of(copy)
        self._prepare(tree)
        reader = ShaderReader(tree, self.token, wanted=(self.quantity,))
        end = tree.get_output_node("CYCLES")
        shown = _color(reader.look(end.inputs["Surface"]), self.quantity)
        emission = tree.nodes.new("ShaderNodeEmission")
        reader.feed(shown, emission.inputs["Color"])
        for socket in end.inputs:
            for link in list(socket.links):
                tree.links.remove(link)
        tree.links.new(emission.outputs[0], end.inputs["Surface"])
        tree.nodes.active = tree.nodes.new("ShaderNodeTexImage")
        return copy

    def _prepare(self, tree: bpy.types.NodeTree) -> None:
        """Let a tree and copies of the groups in it ask the joined mesh, and see the rays of a bake."""
        ask_attributes(tree, self.names)
        values = SHADOW_PATH if self.quantity == "transmittance" else LIGHT_PATH
        for node in list(tree.nodes):
            if node.type == "LIGHT_PATH":
                for output in node.outputs:
                    _hold(tree, output, values.get(output.name, 0.0))
            elif node.type in SEE_ANGLES:
                for output in node.outputs:
                    mean = from_all_around(output, behind=self.behind)
                    if mean is not None:
                        _hold(tree, output, float(mean[0]))
            elif node.type == "NEW_GEOMETRY" and self.behind:
                _hold(tree, node.outputs["Backfacing"], BEHIND["Backfacing"])
            elif node.type == "GROUP" and node.node_tree is not None:
                node.node_tree = self._group(node.node_tree)

    def _group(self, group: bpy.types.NodeTree) -> bpy.types.NodeTree:
        if group.get(BAKE_KEY) == self.token:
            return group
        if group.session_uid not in self._groups:
            copy = self._groups[group.session_uid] = group.copy()
            copy[BAKE_KEY] = self.token
            copy.use_fake_user = False
            self._prepare(copy)
        return self._groups[group.session_uid]


def _color(look: Look, quantity: Quantity) -> Color:
    shown = zip(("reflectance", "emission", "transmittance", "translucence"), look.colors, strict=True)
    return dict(shown)[quantity]


def _hold(tree: bpy.types.NodeTree, output: bpy.types.NodeSocket, value: float) -> None:
    """Give a constant to whatever an output feeds."""
    targets = [link.to_socket for link in output.links]
    if targets:
        constant = tree.nodes.new("ShaderNodeValue")
        constant.outputs[0].default_value = value
        for target in targets:
            tree.links.new(constant.outputs[0], target)
