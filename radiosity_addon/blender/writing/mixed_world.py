# SPDX-License-Identifier: GPL-3.0-or-later
"""The world that the camera sees, dimmed and tinted as its light group is: a copy stands in for it while baked."""

from __future__ import annotations

import bpy

from ..data.names import BAKE_KEY, ORIGINAL_WORLD_KEY
from ..looks.node_arithmetic import Arithmetic
from ..looks.nodes import tree_of
from .light_mix import LightMix

SHINING = ("BACKGROUND", "EMISSION")
"""Types of the nodes that light a world."""


def mix_world(scene: bpy.types.Scene, group: str, mix: LightMix) -> None:
    """Show a copy of the scene's world that is mixed with its light group; a group without any light can't be."""
    world = scene.world
    if world is None or group not in mix.groups:
        return
    copy = world.copy()
    copy[BAKE_KEY], copy[ORIGINAL_WORLD_KEY] = mix.token, world
    copy.name = f"{world.name} (Light Mix)"
    copy.use_fake_user = False
    copy.asset_clear()
    if tree_of(copy) is None:
        copy.use_nodes = True  # before Blender 5
        _show_color(copy)
    _mix_tree(copy.node_tree, group, mix, {})
    scene.world = copy


def _show_color(world: bpy.types.World) -> None:
    """Let nodes show what a world without nodes shows."""
    nodes = world.node_tree.nodes
    nodes.clear()
    background, end = nodes.new("ShaderNodeBackground"), nodes.new("ShaderNodeOutputWorld")
    background.inputs["Color"].default_value = (*world.color, 1.0)
    world.node_tree.links.new(background.outputs[0], end.inputs["Surface"])


def _mix_tree(
    tree: bpy.types.NodeTree, group: str, mix: LightMix, copies: dict[bpy.types.NodeTree, bpy.types.NodeTree]
) -> None:
    """Multiply what nodes of a tree shine, in copies of the node groups in it too."""
    sums = Arithmetic(tree)
    for node in list(tree.nodes):
        if node.type in SHINING:
            color = node.inputs["Color"]
            sums.feed(sums.multiply(sums.color(color), mix.color(sums, group)), color)
        elif node.type == "GROUP" and node.node_tree is not None and _shines(node.node_tree):
            own = node.node_tree
            if own not in copies:
                copies[own] = own.copy()
                copies[own][BAKE_KEY] = mix.token
                copies[own].use_fake_user = False
                _mix_tree(copies[own], group, mix, copies)
            node.node_tree = copies[own]


def _shines(tree: bpy.types.NodeTree) -> bool:
    return any(
        node.type in SHINING or (node.type == "GROUP" and node.node_tree is not None and _shines(node.node_tree))
        for node in tree.nodes
    )
