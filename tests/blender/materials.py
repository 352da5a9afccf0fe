# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials of few nodes, alike in every Blender."""

from __future__ import annotations

import bpy


def bare(name: str) -> bpy.types.Material:
    """A material whose node tree is empty."""
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # before Blender 5
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material


def shader(name: str, kind: str, **values: object) -> bpy.types.Material:
    """A material of one shader node."""
    material = bare(name)
    tree = material.node_tree
    node, end = tree.nodes.new(kind), tree.nodes.new("ShaderNodeOutputMaterial")
    for key, value in values.items():
        node.inputs[key.replace("_", " ")].default_value = value
    tree.links.new(node.outputs[0], end.inputs["Surface"])
    return material


def volume(name: str, kind: str, **values: object) -> bpy.types.Material:
    """A material of one node that fills what the surface encloses."""
    material = shader(name, kind, **values)
    tree = material.node_tree
    surface = tree.links[0]
    tree.links.new(surface.from_socket, surface.to_node.inputs["Volume"])
    tree.links.remove(surface)
    return material


def diffuse(name: str, grey: float) -> bpy.types.Material:
    return shader(name, "ShaderNodeBsdfDiffuse", Color=(grey, grey, grey, 1))
