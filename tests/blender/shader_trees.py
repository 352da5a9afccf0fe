# SPDX-License-Identifier: GPL-3.0-or-later
"""Node trees, surfaces and layouts for the tests of what Cycles is asked for."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

from radiosity_addon.arrays import Float32
from radiosity_addon.blender.reading.cycles_shader import CyclesShader
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.blender.reading.extraction import Extraction
from radiosity_addon.shading import Layout, Quantity
from tests.blender.materials import bare

SIZE = 64


class Tree:
    """A material made node by node."""

    def __init__(self, name: str = "Material") -> None:
        self.material = bare(name)
        self.tree = self.material.node_tree

    def node(self, kind: str, **inputs: object) -> bpy.types.ShaderNode:
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for name, value in inputs.items():
            node.inputs[name.replace("_", " ")].default_value = value
        return node

    def link(self, output: bpy.types.NodeSocket, target: bpy.types.NodeSocket) -> None:
        self.tree.links.new(output, target)

    def emit(self, color: bpy.types.NodeSocket) -> bpy.types.Material:
        emission, end = self.node("Emission"), self.node("OutputMaterial")
        self.link(color, emission.inputs["Color"])
        self.link(emission.outputs[0], end.inputs["Surface"])
        return self.material


def emitting(make: Callable[[Tree], bpy.types.NodeSocket], name: str = "Material") -> bpy.types.Material:
    tree = Tree(name)
    return tree.emit(make(tree))


def plane(name: str, material: bpy.types.Material) -> bpy.types.Object:
    bpy.ops.mesh.primitive_plane_add(size=2)
    bpy.context.object.name = name
    bpy.context.object.data.materials.append(material)
    return bpy.context.object


def layout_of(extraction: Extraction, uv_map: str = "UVMap") -> Layout:
    """Each mesh by its own uv map on a page of its own."""
    uv = []
    for source, mesh in zip(extraction.sources, extraction.scene.meshes, strict=True):
        data = bpy.data.objects[source.object_name].data
        loops = np.empty((len(data.loops), 2), np.float32)
        data.uv_layers[uv_map].uv.foreach_get("vector", loops.ravel())
        uv.append(loops[mesh.corner])
    count = len(uv)
    return Layout(SIZE, count, np.arange(count, dtype=np.int32), tuple(uv))


def pages(quantity: Quantity = "emission", layout: Layout | None = None) -> dict[str, Float32]:
    """The page of each object, by its name."""
    extraction = extract_scene(bpy.context.scene)
    layout = layout or layout_of(extraction)
    shade = CyclesShader(bpy.context.scene.name, extraction)
    shown = shade(layout, np.ones(len(extraction.scene.meshes), bool), quantity)
    return {source.object_name: page for source, page in zip(extraction.sources, shown, strict=True)}


def of_coordinates(output: str) -> Callable[[Tree], bpy.types.NodeSocket]:
    return lambda tree: tree.node("TexCoord").outputs[output]


def checkers(tree: Tree) -> bpy.types.NodeSocket:
    """Two colours in four fields, by the uv map."""
    node = tree.node("TexChecker", Scale=2.0, Color1=(0.1, 0.3, 0.6, 1), Color2=(0.8, 0.2, 0.1, 1))
    tree.link(tree.node("TexCoord").outputs["UV"], node.inputs["Vector"])
    return node.outputs["Color"]


def image(name: str, colors: object, space: str = "", **options: object) -> bpy.types.Image:
    """An image of rows and columns of colours, row 0 at the bottom; of 8 bits a channel, or of floats."""
    values = np.ones((*np.shape(colors)[:2], 4), np.float32)
    values[..., :3] = colors
    made = bpy.data.images.new(name, values.shape[1], values.shape[0], **options)
    if space:
        made.colorspace_settings.name = space  # would drop pixels
    made.pixels.foreach_set(values.ravel())
    return made


def of_image(
    shown: bpy.types.Image | None, uv_map: str = "", **values: object
) -> Callable[[Tree], bpy.types.NodeSocket]:
    def make(tree: Tree) -> bpy.types.NodeSocket:
        node = tree.node("TexImage")
        node.image = shown
        for key, value in values.items():
            setattr(node, key, value)
        if uv_map:
            place = tree.node("UVMap")
            place.uv_map = uv_map
            tree.link(place.outputs["UV"], node.inputs["Vector"])
        return node.outputs["Color"]

    return make
