# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader trees of known answers."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.looks.materials import read_material
from radiosity_addon.blender.looks.nodes import LinkCycle
from radiosity_addon.errors import SceneError
from radiosity_addon.scene import MAX_REFLECTANCE, Material
from tests.blender.read_trees import Tree, rgb

GREY = (0.5, 0.5, 0.5)


def test_mix_and_add_weigh_what_they_join():
    tree = Tree()
    dark, light = tree.node("BsdfDiffuse", Color=(0, 0, 0)), tree.node("BsdfDiffuse", Color=(0.8, 0.4, 0))
    lamp = tree.node("Emission", Color=(1, 1, 1), Strength=8.0)
    mix, add = tree.node("MixShader"), tree.node("AddShader")
    mix.inputs[0].default_value = 0.25
    tree.link(dark, mix, 1)
    tree.link(light, mix, 2)
    tree.link(mix, add, 0)
    tree.link(lamp, add, 1)
    tree.show(add)
    material = tree.read()
    assert material.reflectance == rgb(0.2, 0.1, 0)
    assert material.emission == rgb(8, 8, 8)


def test_a_mix_by_is_camera_ray_shows_what_light_meets():
    tree = Tree()
    mix = tree.node("MixShader")
    tree.link(tree.node("LightPath"), mix, 0, "Is Camera Ray")
    tree.link(tree.node("BsdfDiffuse", Color=GREY), mix, 1)
    tree.link(tree.node("Emission"), mix, 2)
    tree.show(mix)
    assert tree.read() == Material("Material", GREY)


def test_what_is_limited_lets_through_no_more_of_it():
    tree = Tree()
    add = tree.node("AddShader")
    tree.link(tree.node("BsdfDiffuse", Color=(0.9, 0.9, 0.9)), add, 0)
    tree.link(tree.node("BsdfTranslucent", Color=(0.9, 0.9, 0.9)), add, 1)
    tree.show(add)
    assert tree.read().translucence == rgb(*(MAX_REFLECTANCE / 2,) * 3)


def test_constants_are_followed_through_reroutes_and_colour_nodes():
    tree = Tree()
    colour = tree.node("RGB")
    colour.outputs[0].default_value = (0.3, 0.2, 0.1, 1)
    reroute = tree.tree.nodes.new("NodeReroute")
    diffuse = tree.node("BsdfDiffuse")
    tree.link(colour, reroute, 0)
    tree.link(reroute, diffuse, "Color")
    tree.show(diffuse)
    assert tree.read().reflectance == rgb(0.3, 0.2, 0.1)
    assert tree.warnings == []


def test_a_group_hands_its_inputs_in_and_its_shader_out():
    group = bpy.data.node_groups.new("Paint", "ShaderNodeTree")
    group.interface.new_socket("Tint", in_out="INPUT", socket_type="NodeSocketColor")
    group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    inside, diffuse, out = (
        group.nodes.new(kind) for kind in ("NodeGroupInput", "ShaderNodeBsdfDiffuse", "NodeGroupOutput")
    )
    group.links.new(inside.outputs[0], diffuse.inputs["Color"])
    group.links.new(diffuse.outputs[0], out.inputs[0])
    tree = Tree()
    user = tree.node("Group")
    user.node_tree = group
    user.inputs["Tint"].default_value = (0.1, 0.6, 0.2, 1)
    tree.show(user)
    assert tree.read().reflectance == rgb(0.1, 0.6, 0.2)
    colour = tree.node("RGB")
    colour.outputs[0].default_value = (0.7, 0.1, 0.2, 1)
    tree.link(colour, user, "Tint")
    assert tree.read().reflectance == rgb(0.7, 0.1, 0.2)


def test_a_muted_node_passes_its_first_shader_on():
    tree = Tree()
    mix = tree.node("MixShader")
    tree.link(tree.node("BsdfDiffuse", Color=GREY), mix, 1)
    tree.link(tree.node("Emission"), mix, 2)
    tree.show(mix)
    mix.mute = True
    bpy.context.view_layer.update()
    assert tree.read() == Material("Material", GREY)


def test_a_muted_link_is_no_link():
    tree = Tree()
    output = tree.show(tree.node("BsdfDiffuse"))
    output.inputs["Surface"].links[0].is_muted = True
    assert tree.read().reflectance == (0, 0, 0)


def test_the_output_is_the_one_that_cycles_takes():
    tree = Tree()
    tree.show(tree.node("BsdfDiffuse", Color=(1, 0, 0)), "EEVEE")
    tree.show(tree.node("BsdfDiffuse", Color=GREY), "CYCLES")
    assert tree.read().reflectance == rgb(*GREY)


def test_a_tree_without_output_or_surface_is_black():
    tree = Tree()
    assert tree.read() == Material("Material", (0, 0, 0))
    tree.node("OutputMaterial")
    assert tree.read() == Material("Material", (0, 0, 0))


def test_no_material_is_cycles_default_surface():
    assert read_material(None, 3, print) == Material("", (0.8, 0.8, 0.8))


@pytest.mark.skipif(bpy.app.version >= (5, 0), reason="from 5.0 every material has a node tree")
def test_a_material_without_nodes_is_its_viewport_colour():
    material = bpy.data.materials.new("plain")
    material.use_nodes = False
    material.diffuse_color = (0.1, 0.2, 0.3, 1)
    assert read_material(material, 0, print).reflectance == rgb(0.1, 0.2, 0.3)


def test_an_image_varies_around_its_mean_linear_colour():
    image = bpy.data.images.new("half", 2, 1)  # bytes, sRGB
    image.pixels.foreach_set(np.array([0, 0, 0, 1, 1, 1, 1, 1], np.float32))
    tree = Tree()
    texture, diffuse = tree.node("TexImage"), tree.node("BsdfDiffuse")
    texture.image = image
    tree.link(texture, diffuse, "Color")
    tree.show(diffuse)
    material = tree.read()
    # through 4.5's colour management white comes back as 0.9998 to 1.0002
    assert material.reflectance == pytest.approx((0.5,) * 3, abs=3e-4)
    assert material.varies == {"reflectance"}
    assert tree.warnings == []


def test_an_image_encoded_as_srgb_is_decoded_before_its_mean():
    image = bpy.data.images.new("flat", 1, 1)
    image.pixels.foreach_set(np.array([0.5, 0.5, 0.5, 1], np.float32))
    tree = Tree()
    texture, diffuse = tree.node("TexImage"), tree.node("BsdfDiffuse")
    texture.image = image
    tree.link(texture, diffuse, "Color")
    tree.show(diffuse)
    assert tree.read().reflectance[0] == pytest.approx(0.214, abs=0.003)


@pytest.mark.parametrize("kind", ["TexNoise", "TexImage"])
def test_what_blender_computes_varies_around_the_sockets_own_value(kind):
    tree = Tree()
    diffuse = tree.node("BsdfDiffuse", Color=GREY)
    tree.link(tree.node(kind), diffuse, "Color")
    tree.show(diffuse)
    assert tree.read() == Material("Material", GREY, varies=frozenset({"reflectance"}))
    assert tree.warnings == []


def test_a_computed_mix_varies_only_in_what_its_sides_do_not_share():
    tree = Tree()
    mix = tree.node("MixShader")
    tree.link(tree.node("TexNoise"), mix, 0)
    tree.link(tree.node("BsdfDiffuse", Color=GREY), mix, 1)
    tree.link(tree.node("BsdfDiffuse", Color=GREY), mix, 2)
    lamp, add = tree.node("Emission"), tree.node("AddShader")
    tree.link(tree.node("TexNoise"), lamp, "Strength")
    tree.link(mix, add, 0)
    tree.link(lamp, add, 1)
    tree.show(add)
    assert tree.read().varies == {"emission"}


def test_a_glow_that_depends_on_the_length_of_rays_is_named():
    tree = Tree()
    emission = tree.node("Emission")
    tree.link(tree.node("LightPath"), emission, "Strength", "Ray Length")
    tree.show(emission)
    tree.read()
    (warning,) = tree.warnings
    assert "length of rays" in warning


def test_bumps_and_displacement_are_named_with_the_flat_result():
    tree = Tree()
    diffuse = tree.node("BsdfDiffuse", Color=GREY)
    tree.link(tree.node("Bump"), diffuse, "Normal")
    output = tree.show(diffuse)
    tree.link(tree.node("Displacement"), output, "Displacement")
    assert tree.read() == Material("Material", GREY)
    assert tree.warnings == [
        "has displacement, which is ignored",
        "the bumps of Diffuse BSDF are ignored: it is lit as the flat surface below them",
    ]


def test_reflectance_of_one_or_more_is_clamped_with_a_warning():
    tree = Tree()
    tree.show(tree.node("BsdfDiffuse", Color=(2, 1, 0.5)))
    assert tree.read().reflectance == rgb(MAX_REFLECTANCE, MAX_REFLECTANCE, 0.5)
    assert "limited" in tree.warnings[0]


def test_emission_that_is_not_finite_is_an_error_that_names_the_material():
    tree = Tree("glow")
    tree.show(tree.node("Emission", Strength=float("nan")))
    with pytest.raises(SceneError, match="'glow': its emission is not a finite number"):
        tree.read()


def test_a_tree_that_feeds_back_is_told_from_a_deep_one():
    tree = Tree()
    shader = tree.node("BsdfDiffuse", Color=GREY)
    for _ in range(150):
        add = tree.node("AddShader")
        tree.link(shader, add, 0)
        shader = add
    tree.show(shader)
    assert tree.read().reflectance == rgb(*GREY)
    tree.link(shader, tree.tree.nodes["Add Shader"], 1)
    with pytest.raises(LinkCycle):
        tree.read()
