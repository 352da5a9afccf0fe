# SPDX-License-Identifier: GPL-3.0-or-later
"""Node trees that give the light of a lamp a shape."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

Tree = Callable[[bpy.types.NodeTree, bpy.types.Node], None]
"""Builds nodes in a lamp's tree before its Emission node."""

IES = """IESNA:LM-63-2002
[TEST] a downlight that is not alike on all sides
TILT=NONE
1 1000 1 10 5 1 2 0.1 0.1 0
1 1 50
0 10 20 30 40 50 60 75 90 180
0 45 90 135 180
1000 950 800 600 300 100 20 5 0 0
1000 940 780 500 200 80 20 5 0 0
1000 900 700 400 120 60 10 5 0 0
1000 940 780 500 200 80 20 5 0 0
1000 990 900 700 500 300 100 20 0 0
"""


def node_tree(light: bpy.types.Light) -> bpy.types.NodeTree:
    if bpy.app.version < (5, 0):
        light.use_nodes = True
    return light.node_tree


def emission_of(tree: bpy.types.NodeTree) -> bpy.types.Node:
    return next(node for node in tree.nodes if node.type == "EMISSION")


def ies_node(tree: bpy.types.NodeTree) -> bpy.types.Node:
    node = tree.nodes.new("ShaderNodeTexIES")
    node.mode = "INTERNAL"
    node.ies = bpy.data.texts.new("downlight.ies")
    node.ies.write(IES)
    node.inputs["Strength"].default_value = 0.02
    return node


def ies(tree: bpy.types.NodeTree, emission: bpy.types.Node) -> None:
    tree.links.new(ies_node(tree).outputs["Fac"], emission.inputs["Strength"])


def missing_ies(tree: bpy.types.NodeTree, emission: bpy.types.Node) -> None:
    node = ies_node(tree)
    node.ies, node.mode, node.filepath = None, "EXTERNAL", "/nowhere/lost.ies"
    tree.links.new(node.outputs["Fac"], emission.inputs["Strength"])


def turned_ies(tree: bpy.types.NodeTree, emission: bpy.types.Node) -> None:
    node, mapping = ies_node(tree), tree.nodes.new("ShaderNodeMapping")
    where = tree.nodes.new("ShaderNodeTexCoord")
    mapping.inputs["Rotation"].default_value = (0.5, 0.2, 0.9)
    tree.links.new(where.outputs["Normal"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], node.inputs["Vector"])
    tree.links.new(node.outputs["Fac"], emission.inputs["Strength"])


def by_geometry(output: str) -> Tree:
    """Coloured bands by a vector of the Geometry node, which is the world's."""

    def build(tree: bpy.types.NodeTree, emission: bpy.types.Node) -> None:
        where, waves = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeTexNoise")
        waves.inputs["Scale"].default_value = 1.5
        tree.links.new(where.outputs[output], waves.inputs["Vector"])
        tree.links.new(waves.outputs["Color"], emission.inputs["Color"])

    return build


def gobo(tree: bpy.types.NodeTree, emission: bpy.types.Node) -> None:
    """A picture in front of a spot: the normal divided by its z, as usual."""
    image = bpy.data.images.new("gobo", 32, 32, float_buffer=True, is_data=True)
    pixels = np.ones((32, 32, 4), np.float32)
    y, x = np.mgrid[:32, :32]
    pixels[:, :, 0] = 0.5 + 0.5 * np.sin(x / 3)
    pixels[:, :, 1] = (x // 8 + y // 8) % 2
    pixels[:, :, 2] = y / 31
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    where, parts = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeSeparateXYZ")
    divide, place = tree.nodes.new("ShaderNodeVectorMath"), tree.nodes.new("ShaderNodeMapping")
    picture = tree.nodes.new("ShaderNodeTexImage")
    divide.operation, picture.image, picture.extension = "DIVIDE", image, "EXTEND"
    place.inputs["Location"].default_value = (0.5, 0.5, 0)
    tree.links.new(where.outputs["Normal"], parts.inputs[0])
    tree.links.new(where.outputs["Normal"], divide.inputs[0])
    tree.links.new(parts.outputs["Z"], divide.inputs[1])
    tree.links.new(divide.outputs[0], place.inputs["Vector"])
    tree.links.new(place.outputs[0], picture.inputs["Vector"])
    tree.links.new(picture.outputs["Color"], emission.inputs["Color"])


def falloff(output: str, smooth: float = 0.0) -> Tree:
    def build(tree: bpy.types.NodeTree, emission: bpy.types.Node) -> None:
        node = tree.nodes.new("ShaderNodeLightFalloff")
        node.inputs["Strength"].default_value, node.inputs["Smooth"].default_value = 2.0, smooth
        tree.links.new(node.outputs[output], emission.inputs["Strength"])

    return build


def ies_of_linear_falloff(tree: bpy.types.NodeTree, emission: bpy.types.Node) -> None:
    node = tree.nodes.new("ShaderNodeLightFalloff")
    tree.links.new(ies_node(tree).outputs["Fac"], node.inputs["Strength"])
    tree.links.new(node.outputs["Linear"], emission.inputs["Strength"])


def by_light_path(output: str) -> Tree:
    def build(tree: bpy.types.NodeTree, emission: bpy.types.Node) -> None:
        path, plus = tree.nodes.new("ShaderNodeLightPath"), tree.nodes.new("ShaderNodeMath")
        plus.inputs[1].default_value = 0.5
        tree.links.new(path.outputs[output], plus.inputs[0])
        tree.links.new(plus.outputs[0], emission.inputs["Strength"])

    return build


POINT, SOFT = {"shadow_soft_size": 0.0}, {"shadow_soft_size": 0.3}
BALL = {"shadow_soft_size": 0.3, "use_soft_falloff": False}
STRETCHED = {"scale": (1, 2, 0.5), "rotation_euler": (0.6, -0.3, 0.4)}
SPOT = {"shadow_soft_size": 0.05, "spot_size": 1.6, "spot_blend": 0.3}

SHAPED: dict[str, tuple[str, dict[str, object], Tree]] = {
    "IES": ("POINT", POINT, ies),
    "missing IES": ("POINT", POINT, missing_ies),
    "soft IES": ("POINT", SOFT, ies),
    "IES of a sphere": ("POINT", BALL, ies),
    "mirrored IES": ("POINT", POINT | STRETCHED | {"scale": (-1, 1, 1)}, ies),
    "IES turned by nodes": ("POINT", POINT | STRETCHED, turned_ies),
    "IES of a sphere turned by nodes": ("POINT", BALL | STRETCHED, turned_ies),
    "IES of a stretched spot": ("SPOT", SPOT | STRETCHED, ies),
    "stretched gobo": ("SPOT", SPOT | {"shadow_soft_size": 0.0, "spot_size": 1.2, "scale": (1, 1.3, 0.9)}, gobo),
    "colours by the normal of a sphere": ("POINT", BALL | STRETCHED, by_geometry("Normal")),
    "constant falloff": ("SPOT", SPOT, falloff("Constant")),
    "smooth linear falloff of a sphere": ("POINT", BALL, falloff("Linear", 0.5)),
    "IES of linear falloff": ("POINT", SOFT, ies_of_linear_falloff),
    "ray length": ("POINT", POINT, by_light_path("Ray Length")),
    "diffuse rays": ("POINT", POINT, by_light_path("Is Diffuse Ray")),
}
