# SPDX-License-Identifier: GPL-3.0-or-later
"""Material copies that show albedo x lightmap + emission, alike in Cycles and in Eevee.

The copy emits its outgoing radiance and reflects nothing. So no lamp and no world lights it a second time, its picture
is free of noise, and it still lights what was not baked, as the real surface would. A page holds the light of a
surface's front; the back shows the same, so that a lone plane is not black from behind.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from ..data.names import BACK_UV_MAP, BAKE_KEY, ORIGINAL_MATERIAL_KEY, PLACE_KEY, PREVIEW_KEY, UV_MAP
from ..looks.node_arithmetic import BLACK, WHITE, Color
from ..looks.nodes import is_only_volume, tree_of
from ..looks.preview_nodes import Look, ShaderReader
from ..looks.shaders import DEFAULT_REFLECTANCE
from ..looks.surface_inputs import OF_STAND_INS, Asking, Input, ask_attributes, property_of
from .light_mix import LightMix
from .page_images import light_of

ENGINES = ("CYCLES", "EEVEE")


class PreviewMaterials:
    """The preview materials of one bake: one for each material and page."""

    def __init__(self, token: str, images: list[bpy.types.Image], mix: LightMix | None = None) -> None:
        """Args:
        token: the bake's, which every material and node group gets
        images: of the pages
        mix: shows the light groups in their place
        """
        self.token = token
        self.images = images
        self.mix = mix
        self._made: dict[tuple[int, int, bool, int | None, bool, str], bpy.types.Material] = {}
        self._groups: dict[int, bpy.types.NodeTree] = {}

    def of(
        self,
        material: bpy.types.Material | None,
        page: int,
        placed: bool,
        back: int | None = None,
        stand_in: bool = False,
        group: str = "",
    ) -> bpy.types.Material:
        """The material's copy for a page; for an empty slot one in the grey that Cycles gives it.

        Args:
            placed: for objects that share a uv map, each with a place of its own
            back: page of the backs of a two-sided object
            stand_in: for stand-ins, which have by properties what they can't answer themselves
            group: light group of what it emits
        """
        tree = tree_of(material) if material is not None else None
        answers = stand_in and tree is not None and bool(_asked_of_stand_ins(tree))
        shines = group if self.mix is not None else ""
        key = (0 if material is None else material.session_uid, page, placed, back, answers, shines)
        if key not in self._made:
            lightmap = Lightmap(self.images, page, placed, back, self.mix, group)
            self._made[key] = self._make(material, lightmap, answers)
        return self._made[key]

    def _make(self, material: bpy.types.Material | None, lightmap: Lightmap, answers: bool) -> bpy.types.Material:
        copy = bpy.data.materials.new("Empty") if material is None else material.copy()
        copy[BAKE_KEY] = self.token  # first: what has the token is taken out again should anything fail
        copy[PREVIEW_KEY] = True
        if material is not None:
            copy[ORIGINAL_MATERIAL_KEY] = material
        copy.name = f"{'Empty' if material is None else material.name} ({lightmap.images[lightmap.page].name})"
        copy.use_fake_user = False
        copy.asset_clear()
        if answers:
            self._ask_properties(tree_of(copy))
        emits = _show(copy, material is None, lightmap, self.token)
        if not emits and hasattr(copy, "cycles"):
            copy.cycles.emission_sampling = "NONE"  # reflected light: no lamp to aim shadow rays at
        return copy

    def _ask_properties(self, tree: bpy.types.NodeTree) -> None:
        """Let a tree and copies of the groups in it ask properties for what stand-ins can't answer."""
        names = {asked: property_of(asked) for asked in _asked_of_stand_ins(tree)}
        ask_attributes(tree, names, "OBJECT")
        for node in tree.nodes:
            if node.type == "GROUP" and node.node_tree is not None and _asked_of_stand_ins(node.node_tree):
                node.node_tree = self._asking_group(node.node_tree)

    def _asking_group(self, group: bpy.types.NodeTree) -> bpy.types.NodeTree:
        if group.session_uid not in self._groups:
            copy = self._groups[group.session_uid] = group.copy()
            copy[BAKE_KEY] = self.token
            copy.use_fake_user = False
            self._ask_properties(copy)
        return self._groups[group.session_uid]


def _asked_of_stand_ins(tree: bpy.types.NodeTree) -> list[Input]:
    return sorted(asked for asked in Asking.of(tree).inputs if asked.kind in OF_STAND_INS)


@dataclass(frozen=True)
class Lightmap:
    """Where a material finds its light.

    Attributes:
        images: of all pages
        page: index of its page
        placed: the uv map is shared, the object knows its place
        back: index of the page of the backs of a two-sided object
        mix: shows the light groups in place of the pages' images
        group: light group of what the material emits
    """

    images: list[bpy.types.Image]
    page: int
    placed: bool
    back: int | None = None
    mix: LightMix | None = None
    group: str = ""


def _show(material: bpy.types.Material, empty: bool, lightmap: Lightmap, token: str) -> bool:
    """Rewire a copy to show its lightmap; returns whether it emits light of its own."""
    if empty or tree_of(material) is None:
        plain = Look(albedo=DEFAULT_REFLECTANCE if empty else tuple(material.diffuse_color[:3]))
        if tree_of(material) is None:
            material.use_nodes = True
        material.node_tree.nodes.clear()
        end = material.node_tree.nodes.new("ShaderNodeOutputMaterial")
        _emit(ShaderReader(material.node_tree, token), plain, end, lightmap)
        return False
    tree = material.node_tree
    reader = ShaderReader(tree, token)
    emits = False
    for end in {end.name: end for end in map(tree.get_output_node, ENGINES) if end is not None}.values():
        look = Look(through=WHITE) if is_only_volume(end) else reader.look(end.inputs["Surface"])
        _emit(reader, look, end, lightmap)
        emits = emits or look.emission != BLACK
    return emits


def _emit(reader: ShaderReader, look: Look, end: bpy.types.Node, lightmap: Lightmap) -> None:
    """Link an output's surface to albedo x lightmap + emission, and to what passes through."""
    radiance = reader.add(reader.multiply(look.albedo, _light(reader, lightmap)), _emitted(reader, look, lightmap))
    emission = reader.node("ShaderNodeEmission")
    reader.feed(radiance, emission.inputs["Color"])
    shader = emission.outputs[0]
    if look.through != BLACK:
        transparent, both = reader.node("ShaderNodeBsdfTransparent"), reader.node("ShaderNodeAddShader")
        reader.feed(look.through, transparent.inputs["Color"])
        reader.tree.links.new(shader, both.inputs[0])
        reader.tree.links.new(transparent.outputs[0], both.inputs[1])
        shader = both.outputs[0]
    reader.tree.links.new(shader, end.inputs["Surface"])


def _emitted(reader: ShaderReader, look: Look, lightmap: Lightmap) -> Color:
    """What a surface shines by itself, as its light group is mixed."""
    if lightmap.mix is None or look.emission == BLACK:
        return look.emission
    return reader.multiply(look.emission, lightmap.mix.color(reader, lightmap.group))


def _light(reader: ShaderReader, lightmap: Lightmap) -> Color:
    front = _page(reader, lightmap, lightmap.page, UV_MAP, lightmap.placed)
    if lightmap.back is None:
        return front
    behind = reader.node("ShaderNodeNewGeometry").outputs["Backfacing"]
    return reader.mix(behind, front, _page(reader, lightmap, lightmap.back, BACK_UV_MAP, False))


def _page(reader: ShaderReader, lightmap: Lightmap, page: int, uv_map: str, placed: bool) -> bpy.types.NodeSocket:
    """The light that a page holds where a uv map says."""
    uv = reader.node("ShaderNodeUVMap")
    uv.uv_map = uv_map
    where = _placed(reader, uv.outputs["UV"]) if placed else uv.outputs["UV"]
    if lightmap.mix is not None:
        return lightmap.mix.light(reader, page, where)
    texture = reader.node("ShaderNodeTexImage")
    texture.image, texture.extension = lightmap.images[page], "EXTEND"
    reader.tree.links.new(where, texture.inputs["Vector"])
    return light_of(reader.tree, texture, reader.token)


def _placed(reader: ShaderReader, uv: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """The shared uv scaled and shifted to the object's own place."""
    place, parts, shift, sum_ = (
        reader.node(f"ShaderNode{kind}") for kind in ("Attribute", "SeparateXYZ", "CombineXYZ", "VectorMath")
    )
    place.attribute_type, place.attribute_name = "OBJECT", PLACE_KEY
    reader.tree.links.new(place.outputs["Vector"], parts.inputs[0])
    reader.tree.links.new(parts.outputs["Y"], shift.inputs["X"])
    reader.tree.links.new(parts.outputs["Z"], shift.inputs["Y"])
    sum_.operation = "MULTIPLY_ADD"
    for source, target in zip((uv, parts.outputs["X"], shift.outputs[0]), sum_.inputs, strict=False):
        reader.tree.links.new(source, target)
    return sum_.outputs["Vector"]
