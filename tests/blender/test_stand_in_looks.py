# SPDX-License-Identifier: GPL-3.0-or-later
"""Stand-ins of instances look as their instances did, whatever their materials ask of them."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.writing.revert import revert
from tests.blender.datablocks import differences, snapshot
from tests.blender.instance_bakes import picture
from tests.blender.instanced import (
    bake,
    collections,
    nodes,
    stage,
)
from tests.blender.materials import bare


def emission_of(kind: str, output: str, name: str = "", nested: bool = False) -> bpy.types.Material:
    """A material that emits what a node tells of its instance, in a group or not."""
    material = bare("Asking")
    nodes = material.node_tree
    emission, end = nodes.nodes.new("ShaderNodeEmission"), nodes.nodes.new("ShaderNodeOutputMaterial")
    nodes.links.new(emission.outputs[0], end.inputs["Surface"])
    inside = nodes
    if nested:
        inside = bpy.data.node_groups.new("Group", "ShaderNodeTree")
        inside.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    node = inside.nodes.new(kind)
    if kind == "ShaderNodeAttribute":
        node.attribute_type, node.attribute_name = "INSTANCER", name
    source = node.outputs[output]
    if nested:
        inside.links.new(source, inside.nodes.new("NodeGroupOutput").inputs[0])
        group = nodes.nodes.new("ShaderNodeGroup")
        group.node_tree = inside
        source = group.outputs[0]
    nodes.links.new(source, emission.inputs["Color"])
    return material


def tinted(as_attribute: bool) -> None:
    """Instances by nodes that hold a colour of their own, or whose instancer has it as a property."""
    nodes()
    host = bpy.data.objects["Points"]
    host["tint"] = (0.2, 0.5, 0.8)
    if as_attribute:
        group = bpy.data.node_groups["Nodes"]
        store, where = group.nodes.new("GeometryNodeStoreNamedAttribute"), group.nodes.new("GeometryNodeInputPosition")
        store.data_type, store.domain = "FLOAT_VECTOR", "INSTANCE"
        store.inputs["Name"].default_value = "tint"
        absolute = group.nodes.new("ShaderNodeVectorMath")
        absolute.operation = "ABSOLUTE"
        end = next(node for node in group.nodes if node.type == "GROUP_OUTPUT")
        source = end.inputs[0].links[0].from_socket
        group.links.new(source, store.inputs["Geometry"])
        group.links.new(where.outputs[0], absolute.inputs[0])
        group.links.new(absolute.outputs[0], store.inputs["Value"])
        group.links.new(store.outputs[0], end.inputs[0])


@pytest.mark.parametrize(
    "make, kind, output, nested",
    [
        (collections, "ShaderNodeObjectInfo", "Random", False),
        (collections, "ShaderNodeObjectInfo", "Random", True),
        (lambda: tinted(False), "ShaderNodeAttribute", "Color", False),
        pytest.param(
            lambda: tinted(True),
            *("ShaderNodeAttribute", "Color", False),
            marks=pytest.mark.skipif(
                bpy.app.version < (4, 5), reason="Blender tells instances' attributes from 4.5 on"
            ),
        ),
    ],
)
def test_stand_ins_look_as_what_their_instances_alone_would_know(make, kind, output, nested, tmp_path):
    stage()
    make()
    mesh = bpy.data.objects["Wedge"].data
    for index in (0, 1):
        mesh.materials[index] = emission_of(kind, output, "tint", nested)
    bpy.data.objects["Floor"].hide_render = True
    expected = picture(tmp_path)
    before = snapshot()
    assert len(np.unique(expected[..., 0].round(3))) > 3
    bake(page_size=128)
    np.testing.assert_allclose(picture(tmp_path), expected, atol=2e-3)
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []
