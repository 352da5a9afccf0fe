# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads a shader node tree as three colours: what it reflects, what it emits and what passes straight through.

The colours are constants where the tree has constants, and sockets of the tree where it computes them, so that
textures, ramps and everything else that an artist built keep working. Shaders are linear in their closures: mixing
and adding shaders is mixing and adding these colours.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import bpy
import numpy as np

from ...arrays import Float64
from ...scene import RGB
from ...shading import Quantity
from ..data.names import BAKE_KEY, UV_MAP
from .closures import Shading, rgb
from .node_arithmetic import BLACK, NEGLIGIBLE, WHITE, Arithmetic, Color, incoming
from .nodes import Groups, likely
from .shaders import DEFAULT_REFLECTANCE, READERS

COLORS = ("Base Color", "Color", "Emission Color")
LINEAR = (*COLORS, "Emission Strength", "Strength")
"""Inputs that closures are linear in, whatever their values."""
SHARES = ("Metallic", "Transmission Weight", "Coat Weight", "Specular IOR Level", "Subsurface Weight")
"""Inputs that closures are linear in, or bend little, from 0 to 1."""
SEEN: tuple[Quantity, ...] = ("reflectance", "emission", "transmittance")
"""What shows: a page holds the light of both sides of a sheet."""
GREY: RGB = (0.5, 0.5, 0.5)
ROUGHNESS = "Roughness"
ROUGHNESSES = tuple(step / 8 for step in range(9))
"""Where closures are tabulated."""


@dataclass(frozen=True)
class Look:
    """What a shader does with light, as far as a lightmap can show it.

    Attributes:
        albedo: share of the incoming light that leaves again, on either side
        emission: emitted radiance, W/(m2 sr)
        through: share of the light from behind that passes straight through
        translucence: what of the albedo leaves on the side that was not lit
    """

    albedo: Color = BLACK
    emission: Color = BLACK
    through: Color = BLACK
    translucence: Color = BLACK

    @property
    def colors(self) -> tuple[Color, Color, Color, Color]:
        return self.albedo, self.emission, self.through, self.translucence


class Sampler:
    """Asks the extractor what a closure reflects, some of its inputs held at given values.

    The textures behind its other inputs count by their means, as they do in transport.
    """

    def __init__(self, groups: Groups) -> None:
        self.groups = groups
        self._held: dict[str, RGB] = {}
        self._means: dict[str, Float64] = {}

    def shading(self, node: bpy.types.Node, held: dict[str, RGB]) -> Shading:
        """What an opaque closure reflects and emits."""
        self._held = {**held, "Alpha": WHITE}
        return READERS[node.type](self, node, self.groups)

    def reflectance(self, node: bpy.types.Node, held: dict[str, RGB]) -> RGB:
        """Diffuse and glossy albedo of an opaque closure."""
        return rgb(self.shading(node, held).reflectance)

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
        wanted: Collection[Quantity] = SEEN,
    ) -> None:
        """Args:
        tree: may be changed: nodes are added
        token: the bake's, for the copies of groups
        outer: in a group: the reader of the tree around it
        group: in a group: the node in that tree that holds it
        wanted: what to read of closures; the rest is black
        """
        super().__init__(tree)
        self.token = token
        self.groups: Groups = (*outer.groups, group) if outer and group else ()
        self.outer = outer
        self.group = group
        self.wanted = wanted
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
            return Look(albedo=DEFAULT_REFLECTANCE)
        if not colors:
            return Look()
        alpha = self.clamped(self.number(node.inputs["Alpha"])) if "Alpha" in node.inputs else WHITE
        look = Look(
            self._told(node, "reflectance") if "reflectance" in self.wanted else BLACK,
            self._told(node, "emission") if "emission" in self.wanted else BLACK,
            self._transmission(node, colors[0]) if "transmittance" in self.wanted else BLACK,
            self._told(node, "translucence") if "translucence" in self.wanted else BLACK,
        )
        if alpha == WHITE:
            return look
        passing = BLACK
        if "transmittance" in self.wanted:
            passing = self.add(self.multiply(look.through, alpha), self.complement(alpha))
        albedo, emission, _, translucence = (self.multiply(color, alpha) for color in look.colors)
        return Look(albedo, emission, passing, translucence)

    def _computes(self, node: bpy.types.Node, name: str) -> bool:
        """Whether the tree computes an input."""
        return not isinstance(self.color(node.inputs[name]), tuple)

    def _told(self, node: bpy.types.Node, quantity: Literal["reflectance", "emission", "translucence"]) -> Color:
        """What transport has of a closure, by inputs that vary.

        It is linear in most colours and shares, so its values at 0 and 1 tell it; in others it bends, and its value
        halfway tells how much; over roughness it is tabulated. Other inputs, all of them of gloss, count by their mean.
        """
        read = Sampler(self.groups)
        computed = [
            name for name in (*LINEAR, *SHARES, ROUGHNESS) if name in node.inputs and self._computes(node, name)
        ]

        def at(held: dict[str, RGB]) -> RGB:
            return rgb(getattr(read.shading(node, held), quantity))

        def along(name: str) -> list[Float64]:
            """What an input does, at 0, halfway and 1, for two values of all others."""
            others = [dict.fromkeys(computed, (value,) * 3) for value in (0.3, 0.8)]
            return [np.array([at({**held, name: value}) for held in others]) for value in (BLACK, GREY, WHITE)]

        told = {name: along(name) for name in computed}
        bent = {
            name for name, (low, middle, high) in told.items() if np.abs(low + high - 2 * middle).max() > NEGLIGIBLE
        }
        varying = {}
        for name, (low, _, high) in told.items():
            if name in bent or (low != high).any():
                color = self.color(node.inputs[name]) if name in COLORS else self.number(node.inputs[name])
                varying[name] = color if name in LINEAR else self.clamped(color)
        linear = [name for name in varying if name != ROUGHNESS]

        def over(names: list[str], held: dict[str, RGB]) -> Color:
            if names:
                first, *rest = names
                values = (BLACK, GREY, WHITE) if first in bent else (BLACK, WHITE)
                shown = [over(rest, {**held, first: value}) for value in values]
                return (self.bent if first in bent else self.mix)(varying[first], *shown)
            if ROUGHNESS not in varying:
                return at(held)
            return self.ramp(varying[ROUGHNESS], [at({**held, ROUGHNESS: (step,) * 3}) for step in ROUGHNESSES])

        return over(linear, {})

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
            self._inner[node.name] = ShaderReader(node.node_tree, self.token, self, node, self.wanted)
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
