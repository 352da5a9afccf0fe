# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a material lets light through: transparent shaders, alpha, glass."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.microfacet import mean_pane_transmittance, pane_transmittance
from tests.blender.read_trees import Tree, rgb


def test_a_transparent_shader_lets_its_colour_through():
    tree = Tree()
    tree.show(tree.node("BsdfTransparent", Color=(1, 0.5, 0.25)))
    material = tree.read()
    assert material.transmittance == rgb(1, 0.5, 0.25)
    assert material.reflectance == (0, 0, 0)
    assert tree.warnings == []


def test_alpha_lets_the_rest_through_and_leaves_its_share_of_all_else():
    tree = Tree()
    tree.show(
        tree.node("BsdfPrincipled", Alpha=0.25, Emission_Color=(1, 1, 1), Emission_Strength=4.0, Specular_IOR_Level=0.0)
    )
    material = tree.read()
    assert material.transmittance == rgb(0.75, 0.75, 0.75)
    assert material.emission == rgb(1, 1, 1)
    assert material.reflectance[0] == pytest.approx(0.2, abs=0.01)
    assert tree.warnings == []


@pytest.mark.parametrize("kind", ["BsdfGlass", "BsdfPrincipled"])
def test_two_surfaces_of_glass_let_through_what_cycles_does(kind):
    """Measured in Cycles: a wide slab of this glass lets 0.928, 0.464 and 0.232 of light from above through."""
    tree = Tree()
    colour = {"Color": (1, 0.5**0.5, 0.5)} if kind == "BsdfGlass" else {"Base_Color": (1, 0.5, 0.25)}
    glass = tree.node(kind, IOR=1.5, Roughness=0.0, **colour)
    if kind == "BsdfPrincipled":
        glass.inputs["Transmission Weight"].default_value = 1.0
    tree.show(glass)
    material = tree.read()
    from_above = pane_transmittance(np.ones(1), material.ior) / mean_pane_transmittance(material.ior)
    assert np.square(material.transmittance * from_above) == pytest.approx((0.928, 0.464, 0.232), rel=0.007)
    for passed, reflected in zip(material.transmittance, material.reflectance, strict=True):
        assert passed + reflected <= 1 + 1e-9
    assert tree.warnings == [f"light passes {glass.name} unbent"]


def test_a_mix_with_transparent_for_shadow_rays_lets_the_light_of_lamps_through():
    tree = Tree()
    path, mix = tree.node("LightPath"), tree.node("MixShader")
    tree.link(path, mix, 0, "Is Shadow Ray")
    tree.link(tree.node("BsdfDiffuse", Color=(0.5, 0.5, 0.5)), mix, 1)
    tree.link(tree.node("BsdfTransparent"), mix, 2)
    tree.show(mix)
    material = tree.read()
    assert material.transmittance == (1, 1, 1)
    assert material.indirect_transmittance == (0, 0, 0)
    assert material.reflectance == rgb(0.5, 0.5, 0.5)


@pytest.mark.parametrize(("operation", "shown"), [("MAXIMUM", True), ("MINIMUM", False)])
def test_light_paths_that_a_math_node_joins_are_constants(operation, shown):
    """The mix that lets diffuse rays through as well, as often made: to light it is not there."""
    tree = Tree()
    path, join, mix = tree.node("LightPath"), tree.node("Math"), tree.node("MixShader")
    join.operation = operation
    tree.link(path, join, 0, "Is Shadow Ray")
    tree.link(path, join, 1, "Is Diffuse Ray")
    tree.link(join, mix, 0)
    tree.link(tree.node("BsdfDiffuse", Color=(0.5, 0.5, 0.5)), mix, 1)
    tree.link(tree.node("BsdfTransparent"), mix, 2)
    tree.show(mix)
    material = tree.read()
    assert material.varies == frozenset()
    assert material.indirect_transmittance is None
    assert material.transmittance == ((1, 1, 1) if shown else (0, 0, 0))
    assert material.reflectance == ((0, 0, 0) if shown else rgb(0.5, 0.5, 0.5))


def test_a_picture_of_holes_varies_in_what_passes():
    tree = Tree()
    leaf, holes = tree.node("BsdfPrincipled"), tree.node("TexChecker")
    tree.link(holes, leaf, "Alpha", "Fac")
    tree.show(leaf)
    assert tree.read().varies == {"reflectance", "transmittance"}
