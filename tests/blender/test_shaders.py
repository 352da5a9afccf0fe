# SPDX-License-Identifier: GPL-3.0-or-later
"""What single shaders make of light: known answers, and Cycles as the judge of glossy layers."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from tests.blender.read_trees import Tree, rgb

GREY = (0.5, 0.5, 0.5)


def test_a_diffuse_shader_reflects_its_colour():
    tree = Tree()
    tree.show(tree.node("BsdfDiffuse", Color=(0.1, 0.2, 0.3)))
    assert tree.read().reflectance == rgb(0.1, 0.2, 0.3)
    assert tree.warnings == []


def test_an_emission_shader_emits_colour_times_strength_and_reflects_nothing():
    tree = Tree()
    tree.show(tree.node("Emission", Color=(1, 0.5, 0), Strength=3.0))
    material = tree.read()
    assert material.emission == rgb(3, 1.5, 0)
    assert material.reflectance == (0, 0, 0)


def test_a_principled_without_specular_is_its_base_colour():
    tree = Tree()
    tree.show(tree.node("BsdfPrincipled", Base_Color=(0.1, 0.2, 0.3), Specular_IOR_Level=0.0, Roughness=1.0))
    assert tree.read().reflectance == pytest.approx((0.1, 0.2, 0.3), abs=0.02)  # grazing Fresnel stays


def test_a_principled_emits_its_emission_colour_times_strength():
    tree = Tree()
    tree.show(tree.node("BsdfPrincipled", Emission_Color=(1, 0, 0.5), Emission_Strength=4.0))
    assert tree.read().emission == rgb(4, 0, 2)


def test_a_default_principled_reflects_a_little_more_than_its_base_and_never_all():
    for base in (0.0, 0.5, 1.0):
        tree = Tree()
        tree.show(tree.node("BsdfPrincipled", Base_Color=(base,) * 3))
        reflectance = tree.read().reflectance[0]
        assert reflectance == pytest.approx(0.06 + 0.94 * base, abs=0.002)


def test_a_metal_keeps_its_colour_as_glossy_reflectance():
    tree = Tree()
    tree.show(tree.node("BsdfPrincipled", Base_Color=(0.9, 0.6, 0.3), Metallic=1.0, Roughness=0.2))
    red, green, blue = tree.read().reflectance
    assert red == pytest.approx(0.9, abs=0.02)
    assert red > green > blue > 0.3


def test_gloss_is_told_apart_as_part_of_the_reflectance():
    tree = Tree()
    glaze = tree.node("BsdfPrincipled", Base_Color=(0, 0, 0), Roughness=0.5)
    chalk = tree.node("BsdfDiffuse", Color=(0, 0, 0))
    mix = tree.node("MixShader", Fac=0.25)
    tree.link(chalk, mix, 1)
    tree.link(glaze, mix, 2)
    tree.show(mix)
    material = tree.read()
    (gloss,) = material.glosses
    assert gloss.width == pytest.approx(0.25)
    assert gloss.albedo == pytest.approx(material.reflectance, rel=0.02)  # a little bounces between facets
    assert gloss.fresnel[-1] == pytest.approx((0.25 * 0.04,) * 3, rel=1e-3)


def test_what_lets_light_pass_has_no_gloss():
    tree = Tree()
    tree.show(tree.node("BsdfPrincipled", Roughness=0.5, Alpha=0.5))
    assert tree.read().glosses == ()


def test_a_translucent_shader_lets_its_colour_through_scattered():
    tree = Tree()
    mix = tree.node("MixShader", Fac=0.25)
    tree.link(tree.node("BsdfDiffuse", Color=(0.4, 0.8, 0.0)), mix, 1)
    tree.link(tree.node("BsdfTranslucent", Color=(0.8, 0.4, 0.2)), mix, 2)
    tree.show(mix)
    material = tree.read()
    assert material.reflectance == rgb(0.5, 0.7, 0.05)
    assert material.translucence == rgb(0.2, 0.1, 0.05)
    assert not tree.warnings


def test_a_textured_translucent_shader_varies_in_what_comes_through():
    tree = Tree()
    leaf = tree.node("BsdfTranslucent")
    tree.link(tree.node("TexChecker"), leaf, "Color")
    tree.show(leaf)
    assert tree.read().varies == {"reflectance", "translucence"}


@pytest.mark.skipif(bpy.app.version < (5, 2), reason="Thin Wall is new in Blender 5.2")
@pytest.mark.parametrize(("forward", "through"), [(0.0, 0.25), (0.5, 0.375), (-0.5, 0.125)])
def test_a_thin_wall_lets_through_what_cycles_shows_behind_it(forward, through):
    """Shares of its colour behind a principled wall under a sun, of subsurface weight 1/2, seen in Cycles."""
    tree = Tree()
    inputs = {"Subsurface_Weight": 0.5, "Subsurface_Anisotropy": forward, "Specular_IOR_Level": 0.0}
    tree.show(tree.node("BsdfPrincipled", Base_Color=(0.8, 0.5, 0.2), Thin_Wall=True, **inputs))
    material = tree.read()
    assert material.reflectance == rgb(0.8, 0.5, 0.2)
    assert material.translucence == rgb(0.8 * through, 0.5 * through, 0.2 * through)
    assert not tree.warnings


def test_an_unknown_shader_is_grey_with_a_warning():
    tree = Tree()
    tree.show(tree.node("EeveeSpecular"))
    assert tree.read().reflectance == (0.8, 0.8, 0.8)
    assert len(tree.warnings) == 1


@pytest.mark.parametrize(
    ("kind", "inputs", "text"),
    [
        ("SubsurfaceScattering", {"Color": GREY}, "leaves where it came in"),
        ("BsdfToon", {"Color": GREY}, "a diffuse surface of its colour stands in"),
        ("BsdfPrincipled", {"Subsurface_Weight": 0.5}, "light that enters Principled BSDF leaves where it came in"),
        ("BsdfPrincipled", {"Anisotropic": 0.5}, "taken as alike in all directions"),
    ],
)
def test_what_is_approximated_is_said_with_the_nodes_name(kind, inputs, text):
    tree = Tree()
    tree.show(tree.node(kind, **inputs))
    assert tree.read().reflectance[0] > 0.4
    assert len(tree.warnings) == 1
    assert text in tree.warnings[0]


# Cycles as judge


def cycles_furnace(make: Callable[[Tree], None], fronts: bool = False) -> float:
    """Radiance that meets the wall of a closed sphere whose wall emits 1: about 1 / (1 - reflectance).

    Args:
        fronts: the wall is seen from its front, not from its back
    """
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_adaptive_sampling = 64, False
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = scene.cycles.glossy_bounces = 64
    scene.cycles.sample_clamp_indirect = scene.cycles.blur_glossy = 0
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48)
    if fronts:
        bpy.context.object.data.flip_normals()
    wall = Tree("wall")
    make(wall)
    bpy.context.object.data.materials.append(wall.material)
    size = 1e-3
    mesh = bpy.data.meshes.new("probe")
    mesh.from_pydata([(-size, -size, 0), (size, -size, 0), (size, size, 0), (-size, size, 0)], [], [(0, 1, 2, 3)])
    mesh.uv_layers.new().data.foreach_set("uv", [0, 0, 1, 0, 1, 1, 0, 1])
    surface = Tree("probe")
    surface.show(surface.node("BsdfDiffuse"))
    target = surface.node("TexImage")
    target.image = bpy.data.images.new("probe", 8, 8, float_buffer=True, is_data=True)
    surface.tree.nodes.active = target
    mesh.materials.append(surface.material)
    probe = bpy.data.objects.new("probe", mesh)
    scene.collection.objects.link(probe)
    probe.location = (0, 0, -0.985)
    bpy.ops.object.select_all(action="DESELECT")
    probe.select_set(True)
    bpy.context.view_layer.objects.active = probe
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, margin=0)
    pixels = np.empty(8 * 8 * 4, np.float32)
    target.image.pixels.foreach_get(pixels)
    return float(pixels.reshape(-1, 4)[:, :3].mean())


BRIGHT = (0.2, 0.5, 0.8)


@pytest.mark.parametrize(
    ("kind", "inputs", "expected"),
    [
        ("BsdfDiffuse", {"Color": BRIGHT, "Roughness": 1.0}, (0.1677, 0.4354, 0.7485)),
        ("BsdfDiffuse", {"Color": BRIGHT, "Roughness": 0.5}, (0.1819, 0.4641, 0.7719)),
        ("BsdfDiffuse", {"Color": (0.95, 0.05, 0.5), "Roughness": 0.75}, (0.9368, 0.0434, 0.449)),
        ("BsdfSheen", {"Color": (1.0, 0.5, 0.2), "Roughness": 0.8}, (0.313, 0.1565, 0.0626)),
        ("BsdfSheen", {"Color": (1.0, 1.0, 1.0), "Roughness": 0.3}, (0.0348,) * 3),
        ("BsdfPrincipled", {"Coat_Weight": 1.0, "Coat_Tint": BRIGHT}, (0.1653, 0.2985, 0.4441)),
        ("BsdfPrincipled", {"Coat_Weight": 1.0, "Coat_Tint": (1.0, 1.0, 1.0)}, (0.5458,) * 3),
        (
            "BsdfPrincipled",
            {"Base_Color": BRIGHT, "Sheen_Weight": 1.0, "Sheen_Roughness": 0.5, "Sheen_Tint": (1.0, 0.5, 0.0)},
            (0.2945, 0.5, 0.7055),
        ),
    ],
)
def test_layers_reflect_what_a_sphere_under_a_white_sky_does_in_cycles(kind, inputs, expected):
    """Measured by the mean of a parallel view of the sphere, in 4.5 and 5.2, to 2e-4; without gloss below."""
    tree = Tree()
    below = {"Base_Color": GREY, "Specular_IOR_Level": 0.0} if kind == "BsdfPrincipled" else {}
    tree.show(tree.node(kind, **(below | inputs)))
    assert tree.read().reflectance == pytest.approx(expected, abs=0.003)
    assert tree.warnings == []


@pytest.mark.parametrize(
    "inputs",
    [
        {"Base_Color": GREY},
        {"Base_Color": (0, 0, 0), "Roughness": 0.3, "IOR": 2.0},
        {"Base_Color": (0, 0, 0), "Specular_IOR_Level": 1.0, "Specular_Tint": (0.3, 0.3, 0.3)},
        {"Base_Color": GREY, "Metallic": 1.0, "Roughness": 1.0},
        {"Base_Color": GREY, "Metallic": 0.5, "Roughness": 0.4},
    ],
)
def test_a_principleds_reflectance_is_what_cycles_returns_in_a_furnace(inputs):
    """The probe sees no grazing angles beyond 80 degrees, hence a hundredth of slack."""

    def wall(tree: Tree) -> None:
        tree.show(tree.node("BsdfPrincipled", Emission_Color=(1, 1, 1), Emission_Strength=1.0, **inputs))

    record = Tree("read")
    wall(record)
    assert 1 - 1 / cycles_furnace(wall) == pytest.approx(record.read().reflectance[0], abs=0.01)


@pytest.mark.parametrize(
    ("kind", "output", "inputs"),
    [
        ("Fresnel", "Fac", {"IOR": 1.8}),
        ("LayerWeight", "Fresnel", {"Blend": 0.4}),
        ("LayerWeight", "Facing", {"Blend": 0.3}),
        ("LayerWeight", "Facing", {"Blend": 0.8}),
    ],
)
def test_what_changes_with_the_angle_of_view_counts_as_its_mean_in_a_furnace(kind, output, inputs):
    """In a sphere light meets the wall at the angle at which it left the wall: all of them count alike."""

    def wall(tree: Tree) -> None:
        angle = tree.node(kind, **inputs)
        mix = tree.node("MixShader")
        tree.link(angle, mix, 0, output)
        tree.link(tree.node("BsdfDiffuse", Color=(0.8, 0.8, 0.8)), mix, 1)
        tree.link(tree.node("BsdfDiffuse", Color=(0.2, 0.2, 0.2)), mix, 2)
        both = tree.node("AddShader")
        tree.link(mix, both, 0)
        tree.link(tree.node("Emission", Color=(1, 1, 1), Strength=1.0), both, 1)
        tree.show(both)

    record = Tree("read")
    wall(record)
    found = record.read()
    assert found.varies == frozenset()
    assert 1 - 1 / cycles_furnace(wall, fronts=True) == pytest.approx(found.reflectance[0], abs=0.01)
