# SPDX-License-Identifier: GPL-3.0-or-later
"""Node trees, and what is read of them."""

from __future__ import annotations

import bpy
import pytest

from radiosity_addon.blender.looks.materials import read_material
from radiosity_addon.scene import Material
from tests.blender.materials import bare


class Tree:
    """A material made node by node."""

    def __init__(self, name: str = "Material") -> None:
        self.material = bare(name)
        self.tree = self.material.node_tree
        self.warnings: list[str] = []

    def node(self, kind: str, **inputs: object) -> bpy.types.ShaderNode:
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for name, value in inputs.items():
            socket = node.inputs[name.replace("_", " ")]
            socket.default_value = (*value, 1) if isinstance(value, tuple) else value
        return node

    def link(self, source: bpy.types.Node, target: bpy.types.Node, name: str | int, output: str | int = 0) -> None:
        self.tree.links.new(source.outputs[output], target.inputs[name])

    def show(self, shader: bpy.types.Node, target: str = "ALL") -> bpy.types.Node:
        output = self.node("OutputMaterial")
        output.target = target
        self.link(shader, output, "Surface")
        return output

    def read(self) -> Material:
        return read_material(self.material, 0, self.warnings.append)


def rgb(*values: float) -> object:
    return pytest.approx(values, rel=1e-5)
