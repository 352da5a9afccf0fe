# SPDX-License-Identifier: GPL-3.0-or-later
"""A node group that turns the numbers of a page file into light, alike in Cycles and in Eevee."""

from __future__ import annotations

from typing import TypeAlias

import bpy

from ...arrays import Float64
from ...pages.encodings import LOGLUV_STOPS, UV_MAX
from ...pages.page_format import Recipe

Term: TypeAlias = float | bpy.types.NodeSocket
"""A number, or an output that computes one."""

COLUMN = 160.0


class DecodeNodes:
    """Adds the nodes of one recipe to an empty group."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree
        self._made = 0

    def build(self, recipe: Recipe, matrix: Float64) -> None:
        """From inputs Color and Alpha to the output Light.

        Args:
            recipe: how to decode
            matrix: (3, 3), from the recipe's space to the working space
        """
        interface = self.tree.interface
        interface.new_socket("Color", in_out="INPUT", socket_type="NodeSocketColor")
        alpha = interface.new_socket("Alpha", in_out="INPUT", socket_type="NodeSocketFloat")
        alpha.default_value = 1.0
        interface.new_socket("Light", in_out="OUTPUT", socket_type="NodeSocketColor")
        start = self._node("NodeGroupInput")
        color = self._channels(start.outputs["Color"])
        light = self._light(recipe, color, start.outputs["Alpha"])
        end, joined = self._node("NodeGroupOutput"), self._node("ShaderNodeCombineColor")
        for target, channel in zip(joined.inputs, self._product(matrix, light), strict=False):
            self._feed(channel, target)
        self.tree.links.new(joined.outputs["Color"], end.inputs["Light"])

    def _light(self, recipe: Recipe, color: list[Term], alpha: Term) -> list[Term]:
        if recipe.format == "rgbm":
            roots = [self._math("MULTIPLY", channel, alpha) for channel in color]
            return [self._times(recipe.brightest, self._math("MULTIPLY", root, root)) for root in roots]
        if recipe.format == "rgbd":
            divisor = self._math("MAXIMUM", self._times(255.0, alpha), 1.0)
            roots = [self._math("DIVIDE", channel, divisor) for channel in color]
            return [self._times(recipe.brightest, self._math("MULTIPLY", root, root)) for root in roots]
        if recipe.format == "logluv":
            return self._logluv(recipe, color)
        if recipe.format == "rgb9e5":
            return self._rgb9e5(color, alpha)
        return [self._times(recipe.scale, channel) for channel in color]

    def _logluv(self, recipe: Recipe, color: list[Term]) -> list[Term]:
        stops = self._math("MULTIPLY_ADD", color[0], LOGLUV_STOPS, -LOGLUV_STOPS)
        lit = self._math("GREATER_THAN", color[0], 0.0)
        y = self._times(recipe.brightest, self._math("MULTIPLY", self._math("POWER", 2.0, stops), lit))
        v = self._math("MAXIMUM", self._times(UV_MAX, color[2]), 1e-6)
        share = self._math("DIVIDE", y, self._times(4.0, v))
        x = self._math("MULTIPLY", self._times(9.0 * UV_MAX, color[1]), share)
        rest = self._sum(12.0, self._times(-3.0 * UV_MAX, color[1]), self._times(-20.0, v))
        xyz = [x, y, self._math("MULTIPLY", rest, share)]
        return [self._math("MAXIMUM", channel, 0.0) for channel in self._product(recipe.space.from_xyz, xyz)]

    def _rgb9e5(self, color: list[Term], alpha: Term) -> list[Term]:
        """Bits 0-8, 9-17 and 18-26 of the word, times 2 to the power of bits 27-31, less 24."""
        low, second, third, high = (
            self._math("FLOOR", self._math("MULTIPLY_ADD", channel, 255.0, 0.5)) for channel in (*color, alpha)
        )
        mantissas = [
            self._sum(low, self._times(256.0, self._math("MODULO", second, 2.0))),
            self._sum(self._halved(second, 2.0), self._times(128.0, self._math("MODULO", third, 4.0))),
            self._sum(self._halved(third, 4.0), self._times(64.0, self._math("MODULO", high, 8.0))),
        ]
        scale = self._math("POWER", 2.0, self._math("SUBTRACT", self._halved(high, 8.0), 24.0))
        return [self._math("MULTIPLY", mantissa, scale) for mantissa in mantissas]

    def _halved(self, term: Term, by: float) -> Term:
        return self._math("FLOOR", self._math("DIVIDE", term, by))

    def _channels(self, color: bpy.types.NodeSocket) -> list[Term]:
        apart = self._node("ShaderNodeSeparateColor")
        self.tree.links.new(color, apart.inputs["Color"])
        return list(apart.outputs[:3])

    def _product(self, matrix: Float64, terms: list[Term]) -> list[Term]:
        return [
            self._sum(*(self._times(float(weight), term) for weight, term in zip(row, terms, strict=True)))
            for row in matrix
        ]

    def _times(self, factor: float, term: Term) -> Term:
        if factor in (0.0, 1.0) or isinstance(term, float):
            return 0.0 if factor == 0 else term if factor == 1 else factor * term
        return self._math("MULTIPLY", factor, term)

    def _sum(self, *terms: Term) -> Term:
        total, *others = [term for term in terms if not (isinstance(term, float) and term == 0)] or [0.0]
        for term in others:
            total = self._math("ADD", total, term)
        return total

    def _math(self, operation: str, *terms: Term) -> bpy.types.NodeSocket:
        node = self._node("ShaderNodeMath")
        node.operation = operation
        for term, target in zip(terms, node.inputs, strict=False):
            self._feed(term, target)
        return node.outputs[0]

    def _feed(self, term: Term, target: bpy.types.NodeSocket) -> None:
        if isinstance(term, float):
            target.default_value = term
        else:
            self.tree.links.new(term, target)

    def _node(self, kind: str) -> bpy.types.Node:
        node = self.tree.nodes.new(kind)
        node.location = (self._made % 12 * COLUMN, -(self._made // 12) * 60.0)
        node.hide = True
        self._made += 1
        return node
