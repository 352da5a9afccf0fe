# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads a shader node tree as three colours: what it reflects, what it emits and what passes straight through.

The colours are constants where the tree has constants, and sockets of the tree where it computes them, so that
textures, ramps and everything else that an artist built keep working. Shaders are linear in their closures: mixing
and adding shaders is mixing and adding these colours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import bpy
import numpy as np

from ..arrays import Float64
from ..scene import RGB
from .materials import READERS, rgb
from .names import BAKE_KEY, UV_MAP
from .nodes import Groups, likely

Color: TypeAlias = RGB | bpy.types.NodeSocket
"""Linear RGB: a constant, or an output socket that computes it."""

BLACK: RGB = (0.0, 0.0, 0.0)
WHITE: RGB = (1.0, 1.0, 1.0)
SCALAR_SOCKETS = {"VALUE", "INT", "BOOLEAN"}
NEW_NODE_WIDTH = 180.0


@dataclass(frozen=True)
class Look:
    """What a shader does with light, as far as a lightmap can show it.

    Attributes:
        albedo: share of the incoming light that leaves again
        emission: emitted radiance, W/(m2 sr)
        through: share of the light from behind that passes straight through
    """

    albedo: Color = BLACK
    emission: Color = BLACK
    through: Color = BLACK

    @property
    def colors(self) -> tuple[Color, Color, Color]:
        return self.albedo, self.emission, self.through


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
        """The colour a where share is 0, b where it is 1."""
        return self.add(self.multiply(self.complement(share), a), self.multiply(share, b))

    def color(self, socket: bpy.types.NodeSocket) -> Color:
        """What a colour input receives."""
        link = incoming(socket)
        if link is not None and not (link.from_node.type == "RGB" and not link.from_node.mute):
            return link.from_socket
        value = (socket if link is None else link.from_socket).default_value
        if socket.type in SCALAR_SOCKETS:
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


class Sampler:
    """Asks the extractor what a closure reflects, some of its inputs held at given values.

    The textures behind its other inputs count by their means, as they do in transport.
    """

    def __init__(self, groups: Groups) -> None:
        self.groups = groups
        self._held: dict[str, RGB] = {}
        self._means: dict[str, Float64] = {}

    def reflectance(self, node: bpy.types.Node, held: dict[str, RGB]) -> RGB:
        """Diffuse and glossy albedo of an opaque closure."""
        self._held = {**held, "Alpha": WHITE}
        return rgb(READERS[node.type](self, node, self.groups).reflectance)

    def transmittance(self, node: bpy.types.Node, held: dict[str, RGB]) -> RGB:
        """What a closure of full alpha lets straight through."""
        self._held = {**held, "Alpha": WHITE}
        return rgb(READERS[node.type](self, node, self.groups).transmittance)

    def warn(self, message: str) -> None:
        """Stay silent: the extractor has said it."""

    def color(self, node: bpy.types.Node, name: str, groups: Groups) -> Float64:
        """An input's colour, (3,)."""
        if name in self._held:
            return np.array(self._held[name])
        if name not in self._means:
            self._means[name] = likely(node.inputs[name], groups)
        return self._means[name]

    def number(self, node: bpy.types.Node, name: str, groups: Groups) -> float:
        """An input's number."""
        return float(self.color(node, name, groups).mean())

    def share(self, node: bpy.types.Node, name: str, groups: Groups) -> float:
        """An input's number, held within 0..1."""
        return min(max(self.number(node, name, groups), 0.0), 1.0)


class ShaderReader(Arithmetic):
    """Reads the shaders of one node tree, and of the groups in it, which it copies before it adds nodes to them."""

    def __init__(
        self,
        tree: bpy.types.NodeTree,
        token: str,
        outer: ShaderReader | None = None,
        group: bpy.types.Node | None = None,
    ) -> None:
        """Args:
        tree: may be changed: nodes are added
        token: the bake's, for the copies of groups
        outer: in a group: the reader of the tree around it
        group: in a group: the node in that tree that holds it
        """
        super().__init__(tree)
        self.token = token
        self.groups: Groups = (*outer.groups, group) if outer and group else ()
        self.outer = outer
        self.group = group
        self._looks: dict[tuple[str, str], Look] = {}
        self._inner: dict[str, ShaderReader] = {}

    def look(self, socket: bpy.types.NodeSocket) -> Look:
        """What arrives at a shader input; nothing at all where it is not linked or linked in a circle."""
        link = incoming(socket)
        if link is None:
            return Look()
        node, output = link.from_node, link.from_socket
        key = (node.name, output.identifier)
        if key not in self._looks:
            self._looks[key] = Look()  # what a circle of links finds
            self._looks[key] = self._read(node, output)
        return self._looks[key]

    def _read(self, node: bpy.types.Node, output: bpy.types.NodeSocket) -> Look:
        if node.mute:
            through = [link.from_socket for link in node.internal_links if link.to_socket == output]
            return self.look(through[0]) if through else Look()
        if node.type == "REROUTE":
            return self.look(node.inputs[0])
        if node.type == "GROUP":
            return self._read_group(node, output)
        if node.type == "GROUP_INPUT":
            return self._read_outside(node, output)
        if node.type == "MIX_SHADER":
            share = self.clamped(self.number(node.inputs[0]))
            first, second = self.look(node.inputs[1]), self.look(node.inputs[2])
            return Look(*(self.mix(share, a, b) for a, b in zip(first.colors, second.colors, strict=True)))
        if node.type == "ADD_SHADER":
            first, second = self.look(node.inputs[0]), self.look(node.inputs[1])
            return Look(*(self.add(a, b) for a, b in zip(first.colors, second.colors, strict=True)))
        return self._read_closure(node)

    def _read_closure(self, node: bpy.types.Node) -> Look:
        if node.type == "BSDF_TRANSPARENT":
            return Look(through=self.color(node.inputs["Color"]))
        colors = [socket for socket in node.inputs if socket.type == "RGBA"]
        if node.type not in READERS:
            return Look(albedo=self.color(colors[0])) if colors else Look()
        if not colors:
            return Look()
        alpha = self.clamped(self.number(node.inputs["Alpha"])) if "Alpha" in node.inputs else WHITE
        albedo = self._albedo(node, colors[0])
        look = Look(albedo, self._emission(node), self._transmission(node, colors[0]))
        if alpha == WHITE:
            return look
        passing = self.add(self.multiply(look.through, alpha), self.complement(alpha))
        return Look(self.multiply(look.albedo, alpha), self.multiply(look.emission, alpha), passing)

    def _albedo(self, node: bpy.types.Node, color: bpy.types.NodeSocket) -> Color:
        """Reflectance as transport has it: exact for constants, linear in a colour and in metalness that vary."""
        base = self.color(color)
        metallic = self.clamped(self.number(node.inputs["Metallic"])) if "Metallic" in node.inputs else BLACK
        read = Sampler(self.groups)
        if isinstance(base, tuple) and isinstance(metallic, tuple):
            return read.reflectance(node, {color.name: base, "Metallic": metallic})

        def of_base(metalness: RGB) -> Color:
            if isinstance(base, tuple):
                return read.reflectance(node, {color.name: base, "Metallic": metalness})
            dark = read.reflectance(node, {color.name: BLACK, "Metallic": metalness})
            bright = read.reflectance(node, {color.name: WHITE, "Metallic": metalness})
            slope = (bright[0] - dark[0], bright[1] - dark[1], bright[2] - dark[2])
            return self.add(self.multiply(base, slope), dark)

        if isinstance(metallic, tuple):
            return of_base(metallic)
        return self.mix(metallic, of_base(BLACK), of_base(WHITE))

    def _emission(self, node: bpy.types.Node) -> Color:
        if node.type == "BSDF_PRINCIPLED":
            color, strength = node.inputs["Emission Color"], node.inputs["Emission Strength"]
        elif node.type in ("EMISSION", "BACKGROUND"):
            color, strength = node.inputs["Color"], node.inputs["Strength"]
        else:
            return BLACK
        return self.multiply(self.color(color), self.number(strength))

    def _transmission(self, node: bpy.types.Node, color: bpy.types.NodeSocket) -> Color:
        """What glass lets pass, unbent: a pane in front of a baked room is looked through. Two surfaces colour once."""
        if node.type == "BSDF_REFRACTION":
            return self.color(color)
        if node.type == "BSDF_GLASS":
            return self.multiply(self.color(color), Sampler(self.groups).transmittance(node, {color.name: WHITE}))
        if node.type == "BSDF_PRINCIPLED":
            weight = self.clamped(self.number(node.inputs["Transmission Weight"]))
            if weight == BLACK:
                return BLACK
            dielectric = self.complement(self.clamped(self.number(node.inputs["Metallic"])))
            held = {color.name: WHITE, "Metallic": BLACK, "Transmission Weight": WHITE, "Coat Weight": BLACK}
            passed = Sampler(self.groups).transmittance(node, held)
            passed = self.multiply(self.root(self.clamped(self.color(color))), passed)
            return self.multiply(self.multiply(weight, dielectric), passed)
        return BLACK

    def _read_group(self, node: bpy.types.Node, output: bpy.types.NodeSocket) -> Look:
        if node.node_tree is None:
            return Look()
        if node.name not in self._inner:
            node.node_tree = node.node_tree.copy()
            node.node_tree.use_fake_user = False
            node.node_tree[BAKE_KEY] = self.token
            self._inner[node.name] = ShaderReader(node.node_tree, self.token, self, node)
        inside = self._inner[node.name]
        end = active_group_output(inside.tree)
        if end is None:
            return Look()
        look = inside.look(input_of(end, output.identifier))

        def outwards(color: Color) -> Color:
            if isinstance(color, tuple):
                return color
            identifier = inside.new_socket("OUTPUT")
            inside.tree.links.new(color, input_of(end, identifier))
            return output_of(node, identifier)

        return Look(*(outwards(color) for color in look.colors))

    def _read_outside(self, node: bpy.types.Node, output: bpy.types.NodeSocket) -> Look:
        outer, group = self.outer, self.group
        if outer is None or group is None:
            return Look()

        def inwards(color: Color) -> Color:
            if isinstance(color, tuple):
                return color
            identifier = self.new_socket("INPUT")
            outer.feed(color, input_of(group, identifier))
            return output_of(node, identifier)

        return Look(*(inwards(color) for color in outer.look(input_of(group, output.identifier)).colors))

    def new_socket(self, direction: str) -> str:
        """Give the group a colour socket more and return its identifier."""
        interface = self.tree.interface
        return interface.new_socket(UV_MAP, in_out=direction, socket_type="NodeSocketColor").identifier


def incoming(socket: bpy.types.NodeSocket) -> bpy.types.NodeLink | None:
    """The link that feeds an input, or None."""
    return next((link for link in socket.links if not link.is_muted), None)


def input_of(node: bpy.types.Node, identifier: str) -> bpy.types.NodeSocket:
    """A node's input by identifier: names may repeat."""
    return next(socket for socket in node.inputs if socket.identifier == identifier)


def output_of(node: bpy.types.Node, identifier: str) -> bpy.types.NodeSocket:
    """A node's output by identifier."""
    return next(socket for socket in node.outputs if socket.identifier == identifier)


def active_group_output(tree: bpy.types.NodeTree) -> bpy.types.Node | None:
    """The group output that counts."""
    ends = [node for node in tree.nodes if node.type == "GROUP_OUTPUT"]
    return next((node for node in ends if node.is_active_output), ends[0] if ends else None)
