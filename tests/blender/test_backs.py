# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials that look otherwise from behind: read from both sides, and asked of Cycles for both."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.looks.materials import read_sides
from radiosity_addon.blender.reading.cycles_shader import CyclesShader
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.microfacet import mean_fresnel
from tests.blender.read_trees import Tree, rgb
from tests.blender.shader_trees import Tree as Shown
from tests.blender.shader_trees import checkers, layout_of, plane


def by_side(tree: Tree, front: bpy.types.Node, back: bpy.types.Node) -> bpy.types.Node:
    mix = tree.node("MixShader")
    tree.link(tree.node("NewGeometry"), mix, 0, "Backfacing")
    tree.link(front, mix, 1)
    tree.link(back, mix, 2)
    return mix


def test_a_light_panel_shines_in_front_and_reflects_behind():
    tree = Tree()
    tree.show(by_side(tree, tree.node("Emission", Strength=3.0), tree.node("BsdfDiffuse", Color=(0.1, 0.2, 0.3))))
    front, back = read_sides(tree.material, 4, tree.warnings.append)
    assert (front.emission, front.reflectance) == (rgb(3, 3, 3), (0, 0, 0))
    assert (back.emission, back.reflectance) == ((0, 0, 0), rgb(0.1, 0.2, 0.3))
    assert not front.varies
    assert (front.group, back.group) == (4, 4)
    assert tree.warnings == []


def test_what_looks_alike_from_both_sides_has_one_record():
    tree = Tree()
    tree.show(by_side(tree, *(tree.node("BsdfDiffuse", Color=(0.5, 0.5, 0.5)) for _ in range(2))))
    assert read_sides(tree.material, 0, tree.warnings.append)[1] is None
    plain = Tree()
    plain.show(plain.node("BsdfDiffuse"))
    assert read_sides(plain.material, 0, plain.warnings.append)[1] is None


def test_a_wall_that_is_clear_from_behind_stops_light_in_front():
    tree = Tree()
    tree.show(by_side(tree, tree.node("BsdfDiffuse", Color=(0.4, 0.5, 0.6)), tree.node("BsdfTransparent")))
    front, back = read_sides(tree.material, 0, tree.warnings.append)
    assert (front.reflectance, front.transmittance) == (rgb(0.4, 0.5, 0.6), (0, 0, 0))
    assert (back.reflectance, back.transmittance) == ((0, 0, 0), (1, 1, 1))


@pytest.mark.parametrize("kind", ["Fresnel", "LayerWeight"])
def test_fresnel_from_behind_is_that_of_the_outside_seen_from_within(kind: str):
    tree = Tree()
    mix = tree.node("MixShader")
    weight = tree.node("Fresnel", IOR=1.5) if kind == "Fresnel" else tree.node("LayerWeight", Blend=1 / 3)
    tree.link(weight, mix, 0)
    tree.link(tree.node("Emission"), mix, 2)
    tree.show(mix)
    front, back = read_sides(tree.material, 0, tree.warnings.append)
    assert front.emission[0] == pytest.approx(mean_fresnel(1.5), rel=1e-5)
    assert back.emission[0] == pytest.approx(1 - (1 - mean_fresnel(1.5)) / 1.5**2, rel=1e-5)


def test_cycles_shows_each_side_of_a_tree_with_groups():
    """Emission is a checker in front, behind the same times a quarter; a group tells the sides apart."""
    group = bpy.data.node_groups.new("Side", "ShaderNodeTree")
    group.interface.new_socket("Share", in_out="OUTPUT", socket_type="NodeSocketFloat")
    side, share, end = (
        group.nodes.new(kind) for kind in ("ShaderNodeNewGeometry", "ShaderNodeMath", "NodeGroupOutput")
    )
    share.operation, share.inputs[0].default_value = "POWER", 0.25
    group.links.new(side.outputs["Backfacing"], share.inputs[1])
    group.links.new(share.outputs[0], end.inputs[0])
    tree = Shown("Sides")
    user = tree.node("Group")
    user.node_tree = group
    material = tree.emit(checkers(tree))
    emission = next(node for node in material.node_tree.nodes if node.type == "EMISSION")
    tree.link(user.outputs[0], emission.inputs["Strength"])
    plane("Floor", material)
    plain = Shown("Plain")
    plane("Other", plain.emit(checkers(plain)))
    extraction = extract_scene(bpy.context.scene)
    names = [source.object_name for source in extraction.sources]
    materials = extraction.scene.materials
    front = materials[extraction.scene.meshes[names.index("Floor")].material[0]]
    back = materials[front.back]
    assert front.varies == back.varies == {"emission"}
    shade = CyclesShader(bpy.context.scene.name, extraction)
    layout, everything = layout_of(extraction), np.ones(2, bool)
    fronts = shade(layout, everything, "emission")
    backs = shade(layout, everything, "emission", behind=True)
    floor, other = names.index("Floor"), names.index("Other")
    assert fronts[floor].max() == pytest.approx(0.8, rel=1e-3)
    assert np.abs(backs[floor] - fronts[floor] / 4).max() < 1e-4
    assert np.array_equal(fronts[other], fronts[floor])
    assert not backs[other].any(), "its back is its front, which was told"
