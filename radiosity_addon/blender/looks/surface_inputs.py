# SPDX-License-Identifier: GPL-3.0-or-later
"""What node trees ask of the surface that they lie on: coordinates, attributes, properties of its object.

Surfaces of many objects are shaded as one mesh, which has coordinates and properties of its own. So what trees ask is
read from each object beforehand and carried by the joined mesh as attributes, and the trees ask for those instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import bpy

Kind = Literal[
    "generated", "object", "normal", "uv", "attribute", "colour attribute",
    "object property", "instancer property", "layer property",
    "location", "colour", "index", "material index", "random", "instancer generated", "instancer uv",
]  # fmt: skip


OF_STAND_INS: frozenset[Kind] = frozenset({"random", "instancer property", "instancer generated", "instancer uv"})
"""What an object answers otherwise than the instance, or the object of another name, that it stands in for."""


class Input(NamedTuple):
    """One thing that trees ask for; `name` is that of a uv map, attribute or property, "" for the active one."""

    kind: Kind
    name: str = ""


@dataclass(frozen=True)
class Asking:
    """What a node tree and the groups in it ask of their surfaces.

    Attributes:
        own_space: directions in the space of the object
        islands: connected parts of the object
        unanswered: a line on each node that asks what is not told
    """

    inputs: frozenset[Input]
    own_space: bool
    islands: bool
    unanswered: tuple[str, ...]

    @classmethod
    def of(cls, tree: bpy.types.NodeTree) -> Asking:
        """What this tree asks."""
        nodes = [node for part in trees_within(tree) for node in part.nodes]
        linked = {asked for node in nodes for output, asked, _ in _asking(node) if output.is_linked}
        unlinked = {UNLINKED[node.type] for node in nodes if _lacks_vector(node)}
        return cls(
            inputs=frozenset(linked | unlinked),
            own_space=any(map(_asks_own_space, nodes)),
            islands=any(map(_asks_islands, nodes)),
            unanswered=tuple(f"{node.name} {UNANSWERED[node.type]}" for node in nodes if node.type in UNANSWERED),
        )


UNANSWERED = {
    "AMBIENT_OCCLUSION": "finds only surfaces around it whose materials vary",
    "BEVEL": "rounds no edges",
    "HAIR_INFO": "is not followed: it gives 0",
    "PARTICLE_INFO": "is not followed: it gives 0",
    "POINT_INFO": "is not followed: it gives 0",
    "SCRIPT": "is not run: it gives 0",
    "TANGENT": "follows the lightmap's own directions",
}
"""What becomes of nodes that ask what a joined mesh can't tell."""


def property_of(asked: Input) -> str:
    """Name of the custom property by which a stand-in answers."""
    return f"radiosity {asked.kind} {asked.name}".strip()[:63]


UNLINKED: dict[str, Input] = {"TEX_IMAGE": Input("uv")} | dict.fromkeys(
    ("TEX_BRICK", "TEX_CHECKER", "TEX_GABOR", "TEX_GRADIENT", "TEX_MAGIC", "TEX_NOISE", "TEX_SKY", "TEX_VORONOI",
     "TEX_WAVE"), Input("generated"))  # fmt: skip
"""What texture nodes take for a Vector that is not linked."""

PROPERTIES: dict[str, Kind] = {
    "GEOMETRY": "attribute",
    "OBJECT": "object property",
    "INSTANCER": "instancer property",
    "VIEW_LAYER": "layer property",
}
"""What an Attribute node asks for, by its type."""


def trees_within(tree: bpy.types.NodeTree) -> Iterator[bpy.types.NodeTree]:
    """A tree and all groups in it, once each."""
    found = [tree]
    for outer in found:
        yield outer
        inner = [node.node_tree for node in outer.nodes if node.type == "GROUP" and node.node_tree is not None]
        found.extend(group for group in dict.fromkeys(inner) if group not in found)


def asks_ray_length(tree: bpy.types.NodeTree) -> bool:
    """Whether something in a tree is driven by how far a ray has come."""
    paths = (node for part in trees_within(tree) for node in part.nodes if node.type == "LIGHT_PATH")
    return any(node.outputs["Ray Length"].is_linked for node in paths)


def _asks_own_space(node: bpy.types.Node) -> bool:
    if node.type == "VECT_TRANSFORM":
        return "OBJECT" in (node.convert_from, node.convert_to)
    return node.type == "TEX_IMAGE" and node.projection == "BOX"


def _asks_islands(node: bpy.types.Node) -> bool:
    return node.type == "NEW_GEOMETRY" and bool(node.outputs["Random Per Island"].is_linked)


TELL_SIDES = {"NEW_GEOMETRY": "Backfacing", "FRESNEL": "Fac", "LAYER_WEIGHT": "Fresnel"}
"""Outputs that are others from behind, by type of their nodes."""


def tells_sides(tree: bpy.types.NodeTree) -> bool:
    """Whether a tree or a group in it may look otherwise from behind."""
    return any(
        output.is_linked and output.identifier == TELL_SIDES.get(node.type)
        for part in trees_within(tree)
        for node in part.nodes
        for output in node.outputs
    )


def ask_attributes(
    tree: bpy.types.NodeTree, names: Mapping[Input, str], kind: Literal["GEOMETRY", "OBJECT"] = "GEOMETRY"
) -> None:
    """Let a tree, not the groups in it, take what it asks for from attributes of these names, the rest as before.

    Args:
        kind: attributes of the mesh, or properties of the object
    """
    for node in list(tree.nodes):
        for output, asked, identifier in _asking(node):
            targets = [link.to_socket for link in output.links]
            if targets and asked in names:
                source = _attribute(tree, kind, names[asked], identifier, asked)
                for target in targets:
                    tree.links.new(source, target)
        if _lacks_vector(node) and UNLINKED[node.type] in names:
            asked = UNLINKED[node.type]
            tree.links.new(_attribute(tree, kind, names[asked], "Vector", asked), node.inputs["Vector"])


def _attribute(tree: bpy.types.NodeTree, kind: str, name: str, identifier: str, asked: Input) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_type, node.attribute_name = kind, name
    output = next(output for output in node.outputs if output.identifier == identifier)
    if asked.kind != "normal":
        return output
    unit = tree.nodes.new("ShaderNodeVectorMath")
    unit.operation = "NORMALIZE"
    tree.links.new(output, unit.inputs[0])
    return unit.outputs["Vector"]


def _lacks_vector(node: bpy.types.Node) -> bool:
    if node.type not in UNLINKED:
        return False
    vector = node.inputs["Vector"]
    return vector.enabled and all(link.is_muted for link in vector.links)


def _asking(node: bpy.types.Node) -> Iterator[tuple[bpy.types.NodeSocket, Input, str]]:
    """A node's outputs that ask for something, what, and the output of an Attribute node that gives the like."""
    for output in node.outputs:
        found = _asked(node, output.identifier)
        if found is not None:
            yield output, *found


def _asked(node: bpy.types.Node, output: str) -> tuple[Input, str] | None:
    match node.type, output:
        case "TEX_COORD", "Generated":
            return Input("instancer generated" if node.from_instancer else "generated"), "Vector"
        case ("TEX_COORD", "UV") if node.from_instancer:
            return Input("instancer uv"), "Vector"
        case "TEX_COORD", "UV":
            return Input("uv"), "Vector"
        case "TEX_COORD", "Normal":
            return Input("normal"), "Vector"
        case ("TEX_COORD", "Object") if node.object is None:
            return Input("object"), "Vector"
        case ("UVMAP", _) if node.from_instancer:
            return Input("instancer uv"), "Vector"
        case "UVMAP", _:
            return Input("uv", node.uv_map), "Vector"
        case "VERTEX_COLOR", _:
            return Input("colour attribute", node.layer_name), output
        case "ATTRIBUTE", _:
            return Input(PROPERTIES[node.attribute_type], node.attribute_name), output
        case "OBJECT_INFO", "Location":
            return Input("location"), "Vector"
        case "OBJECT_INFO", ("Color" | "Alpha"):
            return Input("colour"), output
        case "OBJECT_INFO", "Object Index":
            return Input("index"), "Fac"
        case "OBJECT_INFO", "Material Index":
            return Input("material index"), "Fac"
        case "OBJECT_INFO", "Random":
            return Input("random"), "Fac"
    return None
