# SPDX-License-Identifier: GPL-3.0-or-later
"""Arithmetic with colours in a node tree: constants where all is constant, nodes where the tree computes."""

from __future__ import annotations

from typing import TypeAlias

import bpy

from ...scene import RGB

Color: TypeAlias = RGB | bpy.types.NodeSocket
"""Linear RGB: a constant, or an output socket that computes it."""

BLACK: RGB = (0.0, 0.0, 0.0)
WHITE: RGB = (1.0, 1.0, 1.0)
SCALAR_SOCKETS = {"VALUE", "INT", "BOOLEAN"}
NEGLIGIBLE = 1e-4
"""A bend that shows no one."""
NEW_NODE_WIDTH = 180.0


class Arithmetic:
    """Adds nodes to a tree that compute with colours; what is constant is computed at once."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree
        self._made = 0

    def node(self, kind: str) -> bpy.types.Node:
        """A new node, placed in a row below the rest."""
        node = self.tree.nodes.new(kind)
        node.location = (self._made * NEW_NODE_WIDTH - 600.0, -900.0)
        node.hide = True
        node.select = False
        self._made += 1
        return node

    def feed(self, color: Color, target: bpy.types.NodeSocket) -> None:
        """Set or link `target`, a colour or vector input."""
        if isinstance(color, tuple):
            target.default_value = color if target.type == "VECTOR" else (*color, 1.0)
        else:
            self.tree.links.new(color, target)

    def _math(self, operation: str, *colors: Color) -> bpy.types.NodeSocket:
        node = self.node("ShaderNodeVectorMath")
        node.operation = operation
        for color, target in zip(colors, node.inputs, strict=False):
            self.feed(color, target)
        return node.outputs["Vector"]

    def multiply(self, a: Color, b: Color) -> Color:
        """The product of two colours."""
        if isinstance(a, tuple) and isinstance(b, tuple):
            return a[0] * b[0], a[1] * b[1], a[2] * b[2]
        if a == BLACK or b == BLACK:
            return BLACK
        if a == WHITE or b == WHITE:
            return b if a == WHITE else a
        return self._math("MULTIPLY", a, b)

    def add(self, a: Color, b: Color) -> Color:
        """The sum of two colours."""
        if isinstance(a, tuple) and isinstance(b, tuple):
            return a[0] + b[0], a[1] + b[1], a[2] + b[2]
        if a == BLACK or b == BLACK:
            return b if a == BLACK else a
        return self._math("ADD", a, b)

    def complement(self, a: Color) -> Color:
        """1 - a."""
        if isinstance(a, tuple):
            return 1 - a[0], 1 - a[1], 1 - a[2]
        return self._math("SUBTRACT", WHITE, a)

    def root(self, a: Color) -> Color:
        """The square root of a colour."""
        if isinstance(a, tuple):
            return a[0] ** 0.5, a[1] ** 0.5, a[2] ** 0.5
        node = self.node("ShaderNodeGamma")
        node.inputs["Gamma"].default_value = 0.5
        self.tree.links.new(a, node.inputs["Color"])
        return node.outputs["Color"]

    def clamped(self, a: Color) -> Color:
        """The colour, each channel held within 0..1."""
        if isinstance(a, tuple):
            return min(max(a[0], 0.0), 1.0), min(max(a[1], 0.0), 1.0), min(max(a[2], 0.0), 1.0)
        return self._math("MINIMUM", self._math("MAXIMUM", a, BLACK), WHITE)

    def mix(self, share: Color, a: Color, b: Color) -> Color:
        """The colour a where share is 0, b where it is 1, each channel on its own, and on along the line beyond."""
        return a if a == b else self.add(self.multiply(self.complement(share), a), self.multiply(share, b))

    def bent(self, share: Color, a: Color, middle: Color, b: Color) -> Color:
        """As `mix`, but through `middle` halfway: a parabola between 0 and 1."""
        straight = self.mix(share, a, b)
        half = self.multiply(self.add(a, b), (-0.5, -0.5, -0.5))
        off = self.multiply(self.add(middle, half), (4.0, 4.0, 4.0))
        if isinstance(off, tuple) and max(map(abs, off)) < NEGLIGIBLE:
            return straight
        within = self.clamped(share)
        return self.add(straight, self.multiply(self.multiply(within, self.complement(within)), off))

    def ramp(self, share: Color, colors: list[RGB]) -> Color:
        """Colours at even steps of a share of 0..1, and between them."""
        if all(color == colors[0] for color in colors):
            return colors[0]
        node = self.node("ShaderNodeValToRGB")
        elements = node.color_ramp.elements
        for step in range(1, len(colors) - 1):
            elements.new(step / (len(colors) - 1))
        for element, color in zip(elements, colors, strict=True):
            element.color = (*color, 1.0)
        self.feed(share, node.inputs[0])
        return node.outputs["Color"]

    def color(self, socket: bpy.types.NodeSocket) -> Color:
        """What a colour input receives."""
        link = incoming(socket)
        if link is not None and not (link.from_node.type in ("RGB", "VALUE") and not link.from_node.mute):
            return link.from_socket
        value = (socket if link is None else link.from_socket).default_value
        if isinstance(value, (int, float)):
            return float(value), float(value), float(value)
        return float(value[0]), float(value[1]), float(value[2])

    def number(self, socket: bpy.types.NodeSocket) -> Color:
        """What a number input receives, the same in all three channels."""
        color = self.color(socket)
        if isinstance(color, tuple) or color.type in SCALAR_SOCKETS:
            return color
        node = self.node("ShaderNodeMath")  # turns a colour into its luminance, as the number input would
        node.operation = "ADD"
        node.inputs[1].default_value = 0.0
        self.tree.links.new(color, node.inputs[0])
        return node.outputs[0]


def incoming(socket: bpy.types.NodeSocket) -> bpy.types.NodeLink | None:
    """The link that feeds an input, or None."""
    return next((link for link in socket.links if not link.is_muted), None)
