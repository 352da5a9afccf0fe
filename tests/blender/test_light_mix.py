# SPDX-License-Identifier: GPL-3.0-or-later
"""Light groups mixed anew after a bake: what the sliders show, hand on and leave behind."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.data.names import group_images, page_images
from radiosity_addon.blender.judging.overlay_data import Pages
from radiosity_addon.blender.writing.baked_pages import baked_pages
from tests.blender.baked import quad
from tests.blender.datablocks import differences, snapshot
from tests.blender.materials import diffuse, shader
from tests.blender.test_preview import rendered

ALBEDO = 0.5
GLOW = 3.0
SKY = (0.2, 0.4, 0.8)
HALF = 2e-3
"""Relative; groups and their sum are rounded to half floats."""


@pytest.fixture
def scene() -> bpy.types.Scene:
    """A floor under a camera and a key lamp; a fill lamp and a small glowing square in a group of their own."""
    scene = bpy.context.scene
    for name in ("Key", "Fill"):
        bpy.context.view_layer.lightgroups.add(name=name)
        lamp = bpy.data.objects.new(name, bpy.data.lights.new(name, "POINT"))
        lamp.data.energy, lamp.location = 100, (0, 0, 2)
        lamp.lightgroup = name
        scene.collection.objects.link(lamp)
    bpy.data.objects["Fill"].data.color = (1.0, 0.5, 0.25)
    quad("Floor", diffuse("Grey", ALBEDO))
    sign = quad("Sign", shader("Glow", "ShaderNodeEmission", Strength=GLOW))
    sign.location, sign.lightgroup = (5, 0, 0), "Fill"
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.location.z = "ORTHO", 0.2, 1
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.radiosity.page_size, scene.radiosity.quality = 64, "draft"
    scene.radiosity.light_groups = True
    return scene


def page_of(group: str) -> np.ndarray:
    """The light of a group at the floor's middle, (3,)."""
    return np.array(middle(group_images(bpy.context.scene["radiosity_bake"], 0)[group]))


def middle(image: bpy.types.Image) -> np.ndarray:
    """What an image holds where the floor's uv map has its middle."""
    pixels = np.array(image.pixels[:]).reshape(image.size[1], image.size[0], -1)[..., :3]
    uv = bpy.data.objects["Floor"].data.uv_layers["Radiosity"].uv
    u, v = np.mean([each.vector[:] for each in uv], axis=0)
    return pixels[round(v * image.size[1]) - 2 :, round(u * image.size[0]) - 2 :][:4, :4].mean((0, 1))


def test_sliders_at_one_show_the_page_and_others_scale_each_group(scene: bpy.types.Scene, tmp_path: Path) -> None:
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    (page,) = page_images(scene["radiosity_bake"])
    key, fill = page_of("Key"), page_of("Fill")
    assert key.min() > 0.1
    assert fill.min() > 0.02
    np.testing.assert_allclose(key + fill, middle(page), rtol=HALF)
    np.testing.assert_allclose(rendered(tmp_path), ALBEDO * middle(page), rtol=0.01)
    sliders = {slider.name: slider for slider in scene.radiosity_mix}
    sliders["Key"].strength = 0.0
    np.testing.assert_allclose(rendered(tmp_path), ALBEDO * fill, rtol=0.01)
    sliders["Fill"].strength, sliders["Fill"].color = 2.0, (0.5, 1.0, 0.0)
    np.testing.assert_allclose(rendered(tmp_path), ALBEDO * 2 * fill * (0.5, 1.0, 0.0), rtol=0.01)
    scene.camera.location.x = 5
    np.testing.assert_allclose(rendered(tmp_path), [GLOW, 2 * GLOW, 0.0], rtol=1e-3)


def test_mixed_pages_are_handed_on(scene: bpy.types.Scene) -> None:
    bpy.ops.radiosity.bake()
    (as_baked,), _ = baked_pages(scene)
    sliders = {slider.name: slider for slider in scene.radiosity_mix}
    assert list(sliders) == ["Key", "Fill"], "what is in no group gives no light"
    sliders["Key"].strength = 0.0
    sliders["Fill"].strength, sliders["Fill"].color = 2.0, (0.5, 1.0, 0.0)
    (mixed,), _ = baked_pages(scene)
    fill = np.array(group_images(scene["radiosity_bake"], 0)["Fill"].pixels[:]).reshape(64, 64, -1)[..., :3]
    np.testing.assert_allclose(mixed, 2 * fill * np.float32([0.5, 1.0, 0.0]), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(Pages.of(scene).light(0), mixed, rtol=1e-3, atol=1e-5)
    bpy.context.view_layer.update()
    colors = bpy.data.node_groups["Radiosity Light Groups"].nodes
    assert [channel.default_value for channel in colors["1"].inputs] == [1.0, 2.0, 0.0]
    assert bpy.ops.radiosity.reset_mix() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert [channel.default_value for channel in colors["1"].inputs] == [1.0, 1.0, 1.0]
    assert np.array_equal(baked_pages(scene)[0][0], as_baked)


def test_a_new_bake_keeps_the_mix_and_revert_takes_it_out(scene: bpy.types.Scene) -> None:
    before = snapshot()
    bpy.ops.radiosity.bake()
    next(slider for slider in scene.radiosity_mix if slider.name == "Key").strength = 0.25
    bpy.ops.radiosity.bake()
    strengths = {slider.name: slider.strength for slider in scene.radiosity_mix}
    assert strengths == {"Key": 0.25, "Fill": 1.0}
    assert len(page_images(scene["radiosity_bake"])) == 1
    assert [image.name for image in bpy.data.images if "Key" in image.name] == ["Radiosity 1 Key"]
    bpy.ops.radiosity.revert()
    assert differences(before, snapshot()) == []


def test_the_world_that_the_camera_sees_is_mixed_with_its_group(scene: bpy.types.Scene, tmp_path: Path) -> None:
    world = sky_in_a_group(scene)
    before = snapshot()
    bpy.ops.radiosity.bake()
    light = page_of("Sky")
    scene.camera.location.x = 50  # beside all else, down into the sky
    np.testing.assert_allclose(rendered(tmp_path), SKY, rtol=1e-3)
    slider = next(slider for slider in scene.radiosity_mix if slider.name == "Sky")
    slider.strength, slider.color = 0.5, (1.0, 0.5, 0.0)
    np.testing.assert_allclose(rendered(tmp_path), 0.5 * np.array(SKY) * (1.0, 0.5, 0.0), rtol=1e-3)
    bpy.ops.radiosity.toggle()
    np.testing.assert_allclose(rendered(tmp_path), SKY, rtol=1e-3)
    assert scene.world == world
    bpy.ops.radiosity.toggle()
    bpy.ops.radiosity.bake()
    np.testing.assert_allclose(page_of("Sky"), light, rtol=HALF, err_msg="a bake reads the world as it is unmixed")
    assert [each.name for each in bpy.data.worlds if each.users] == [world.name, f"{world.name} (Light Mix)"]
    bpy.ops.radiosity.revert()
    assert scene.world == world
    assert [each for each in differences(before, snapshot()) if each.startswith(("/worlds", "/node_groups"))] == []


def sky_in_a_group(scene: bpy.types.Scene) -> bpy.types.World:
    """A world of the colour SKY, whose background lies in a node group, in the light group Sky."""
    inner = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
    inner.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    background, end = inner.nodes.new("ShaderNodeBackground"), inner.nodes.new("NodeGroupOutput")
    background.inputs["Color"].default_value, background.inputs["Strength"].default_value = (*SKY, 1.0), 1.0
    inner.links.new(background.outputs[0], end.inputs[0])
    world = scene.world = bpy.data.worlds.new("Sky")
    world.use_nodes = True  # before Blender 5
    world.node_tree.nodes.clear()
    group, output = world.node_tree.nodes.new("ShaderNodeGroup"), world.node_tree.nodes.new("ShaderNodeOutputWorld")
    group.node_tree = inner
    world.node_tree.links.new(group.outputs[0], output.inputs["Surface"])
    bpy.context.view_layer.lightgroups.add(name="Sky")
    world.lightgroup = "Sky"
    return world
