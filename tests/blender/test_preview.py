# SPDX-License-Identifier: GPL-3.0-or-later
"""What preview materials show, rendered."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.looks.materials import read_material
from tests.blender.baked import bake, quad
from tests.blender.materials import diffuse, shader, volume

ROOT = Path(__file__).resolve().parents[2]
PAGE = 0.5
"""What every texel of the page holds."""
WORLD = 7.0
"""Radiance of the world, which baked surfaces must ignore."""


def light_and_camera() -> tuple[bpy.types.Object, bpy.types.Object, bpy.types.World]:
    """A camera above the square's middle, a strong lamp and a strong world."""
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 1.0
    camera.location.z = 2
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN"))
    lamp.data.energy = 10
    world = bpy.data.worlds.new("World")
    if world.node_tree is None:
        world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = WORLD
    scene.world, scene.camera = world, camera
    for thing in (camera, lamp):
        scene.collection.objects.link(thing)
    return camera, lamp, world


def rendered(folder: Path, samples: int = 1) -> np.ndarray:
    """Mean linear RGB of a small picture by Cycles."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = samples, False
    scene.render.resolution_x = scene.render.resolution_y = 4
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(folder / "picture.exr")
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(scene.render.filepath)
    picture.colorspace_settings.is_data = True
    return np.array(picture.pixels[:]).reshape(16, -1)[:, :3].mean(axis=0)


def shown(material: bpy.types.Material | None, folder: Path) -> np.ndarray:
    wall = quad("Wall", material)
    bake([wall], folder, value=PAGE)
    light_and_camera()
    return rendered(folder)


def tree_of(material: bpy.types.Material) -> tuple[bpy.types.NodeTree, bpy.types.Node, bpy.types.Node]:
    """The tree, its first shader and its output."""
    end = next(node for node in material.node_tree.nodes if node.type == "OUTPUT_MATERIAL")
    return material.node_tree, end.inputs["Surface"].links[0].from_node, end


def combined(kind: str, factor: float | None = None) -> bpy.types.Material:
    """A diffuse surface of albedo 0.8 and an emission of 3, mixed or added."""
    material = diffuse("Material", 0.8)
    tree, first, end = tree_of(material)
    second, both = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new(kind)
    second.inputs["Strength"].default_value = 3.0
    shaders = both.inputs[-2:]
    if factor is not None:
        both.inputs[0].default_value = factor
    tree.links.new(first.outputs[0], shaders[0])
    tree.links.new(second.outputs[0], shaders[1])
    tree.links.new(both.outputs[0], end.inputs["Surface"])
    return material


def textured(material: bpy.types.Material, socket: str, color: tuple[float, float, float]) -> bpy.types.Material:
    """The same material with an image behind one of its inputs."""
    image = bpy.data.images.new("Paint", 2, 2, float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.tile(np.float32([*color, 1]), 4))
    image.pack()
    tree, node, _ = tree_of(material)
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    tree.links.new(texture.outputs["Color"], node.inputs[socket])
    return material


def grouped() -> bpy.types.Material:
    """A group that mixes half of the shader it is given with a diffuse surface of a colour that it is given."""
    group = bpy.data.node_groups.new("Half", "ShaderNodeTree")
    group.interface.new_socket("Surface", in_out="OUTPUT", socket_type="NodeSocketShader")
    group.interface.new_socket("Other", in_out="INPUT", socket_type="NodeSocketShader")
    group.interface.new_socket("Paint", in_out="INPUT", socket_type="NodeSocketColor")
    start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    paint, mix = group.nodes.new("ShaderNodeBsdfDiffuse"), group.nodes.new("ShaderNodeMixShader")
    group.links.new(start.outputs["Paint"], paint.inputs["Color"])
    group.links.new(start.outputs["Other"], mix.inputs[1])
    group.links.new(paint.outputs[0], mix.inputs[2])
    group.links.new(mix.outputs[0], end.inputs[0])
    material = diffuse("Material", 0.8)
    textured(material, "Color", (0.6, 0.4, 0.2))
    tree, first, output = tree_of(material)
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    node.inputs["Paint"].default_value = (0.2, 0.4, 0.6, 1)
    tree.links.new(first.outputs[0], node.inputs["Other"])
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return material


def muted() -> bpy.types.Material:
    material = combined("ShaderNodeMixShader", 0.25)
    next(node for node in material.node_tree.nodes if node.type == "MIX_SHADER").mute = True
    return material


def rerouted() -> bpy.types.Material:
    material = diffuse("Material", 0.8)
    tree, first, end = tree_of(material)
    bend = tree.nodes.new("NodeReroute")
    tree.links.new(first.outputs[0], bend.inputs[0])
    tree.links.new(bend.outputs[0], end.inputs["Surface"])
    return material


def circular() -> bpy.types.Material:
    """Half a diffuse surface, half itself."""
    material = combined("ShaderNodeMixShader", 0.5)
    tree, mix, _ = tree_of(material)
    bend = tree.nodes.new("NodeReroute")
    tree.links.new(mix.outputs[0], bend.inputs[0])
    tree.links.new(bend.outputs[0], mix.inputs[2])
    return material


def of_cycles_output() -> bpy.types.Material:
    """One surface for Cycles and another for Eevee."""
    material = diffuse("Material", 0.8)
    tree, _, end = tree_of(material)
    end.target = "CYCLES"
    other, black = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    other.target = "EEVEE"
    black.inputs["Color"].default_value = (0, 0, 0, 1)
    tree.links.new(black.outputs[0], other.inputs["Surface"])
    return material


def without_surface() -> bpy.types.Material:
    material = diffuse("Material", 0.8)
    material.node_tree.links.clear()
    return material


CASES: dict[str, tuple[Callable[[], bpy.types.Material | None], tuple[float, float, float]]] = {
    "diffuse": (lambda: diffuse("Material", 0.8), (0.4, 0.4, 0.4)),
    "coloured": (lambda: shader("Material", "ShaderNodeBsdfDiffuse", Color=(0.8, 0.2, 0.1, 1)), (0.4, 0.1, 0.05)),
    "emission": (lambda: shader("Material", "ShaderNodeEmission", Strength=3.0), (3.0, 3.0, 3.0)),
    "mix": (lambda: combined("ShaderNodeMixShader", 0.25), (1.05, 1.05, 1.05)),
    "add": (lambda: combined("ShaderNodeAddShader"), (3.4, 3.4, 3.4)),
    "image": (lambda: textured(diffuse("Material", 0.8), "Color", (0.6, 0.4, 0.2)), (0.3, 0.2, 0.1)),
    "group": (grouped, (0.2, 0.2, 0.2)),
    "muted": (muted, (0.4, 0.4, 0.4)),
    "rerouted": (rerouted, (0.4, 0.4, 0.4)),
    "Cycles' own output": (of_cycles_output, (0.4, 0.4, 0.4)),
    "no surface": (without_surface, (0.0, 0.0, 0.0)),
    "no slot": (lambda: None, (0.4, 0.4, 0.4)),
    "transparent": (lambda: shader("Material", "ShaderNodeBsdfTransparent"), (WORLD, WORLD, WORLD)),
}


def test_faces_that_only_bound_a_volume_are_clear(tmp_path):
    """They are baked where others of their mesh are surfaces. Black ones are clear to Cycles, not to Eevee."""
    wall = quad("Wall", volume("Fog", "ShaderNodeVolumeScatter", Density=0.0))
    bake([wall], tmp_path, value=PAGE)
    _, shown, end = tree_of(wall.material_slots[0].material)
    assert end.inputs["Volume"].links
    assert "BSDF_TRANSPARENT" in [socket.links[0].from_node.type for socket in shown.inputs if socket.links]


@pytest.mark.parametrize("case", CASES)
def test_albedo_times_lightmap_plus_emission_is_what_cycles_shows(tmp_path, case):
    make, expected = CASES[case]
    np.testing.assert_allclose(shown(make(), tmp_path), expected, rtol=1e-3, atol=1e-4)


def test_an_empty_slot_is_shown_in_cycles_default_grey(tmp_path):
    wall = quad("Wall")
    wall.data.materials.append(None)
    bake([wall], tmp_path, value=PAGE)
    light_and_camera()
    np.testing.assert_allclose(rendered(tmp_path), 0.4, rtol=1e-3)


def test_the_back_shows_the_same_as_the_front(tmp_path):
    bake([quad("Wall", diffuse("White", 0.8))], tmp_path, value=PAGE)
    camera, _, _ = light_and_camera()
    camera.location.z, camera.rotation_euler[0] = -2, np.pi
    np.testing.assert_allclose(rendered(tmp_path), 0.4, rtol=1e-3)


def test_a_half_transparent_surface_shows_half_of_what_is_behind(tmp_path):
    material = shader("Pane", "ShaderNodeEmission", Strength=2.0)
    tree, first, end = tree_of(material)
    mix, clear = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfTransparent")
    tree.links.new(first.outputs[0], mix.inputs[1])
    tree.links.new(clear.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], end.inputs["Surface"])
    np.testing.assert_allclose(shown(material, tmp_path), (2 + WORLD) / 2, rtol=1e-3)


def test_a_pane_of_glass_is_looked_through(tmp_path):
    material = shader("Pane", "ShaderNodeBsdfGlass", Roughness=0.0, IOR=1.5)
    reflected = np.array(read_material(material, 0, lambda text: None).reflectance)
    assert 0.04 < reflected[0] < 0.1
    np.testing.assert_allclose(shown(material, tmp_path), reflected * PAGE + (1 - reflected) * WORLD, rtol=2e-3)


PRINCIPLED = {
    "default": {},
    "coloured": {"Base_Color": (0.8, 0.3, 0.1, 1), "Roughness": 0.2},
    "metal": {"Base_Color": (0.9, 0.6, 0.2, 1), "Metallic": 1.0, "Roughness": 0.3},
    "half metal": {"Base_Color": (0.9, 0.6, 0.2, 1), "Metallic": 0.5},
    "coated": {"Base_Color": (0.2, 0.3, 0.4, 1), "Coat_Weight": 1.0},
    "shining": {"Emission_Color": (1, 0.5, 0.25, 1), "Emission_Strength": 2.0},
}


@pytest.mark.parametrize("case", PRINCIPLED)
def test_a_principled_surface_reflects_as_in_transport(tmp_path, case):
    material = shader("Material", "ShaderNodeBsdfPrincipled", **PRINCIPLED[case])
    record = read_material(material, 0, lambda text: None)
    expected = np.array(record.reflectance) * PAGE + record.emission
    np.testing.assert_allclose(shown(material, tmp_path), expected, rtol=2e-3)


@pytest.mark.parametrize("case", ["default", "coated"])
def test_a_principled_surface_with_a_texture_reflects_as_its_colours_would(tmp_path, case):
    color = (0.6, 0.4, 0.2)
    values = {**PRINCIPLED[case], "Base_Color": (*color, 1)}
    expected = np.array(read_material(shader("Plain", "ShaderNodeBsdfPrincipled", **values), 0, print).reflectance)
    material = textured(shader("Material", "ShaderNodeBsdfPrincipled", **values), "Base Color", color)
    np.testing.assert_allclose(shown(material, tmp_path), expected * PAGE, rtol=2e-3)


def test_a_texture_of_metalness_blends_between_paint_and_metal(tmp_path):
    values = {"Base_Color": (0.9, 0.6, 0.2, 1), "Metallic": 0.25}
    expected = np.array(read_material(shader("Plain", "ShaderNodeBsdfPrincipled", **values), 0, print).reflectance)
    material = textured(shader("Material", "ShaderNodeBsdfPrincipled", **values), "Metallic", (0.25, 0.25, 0.25))
    np.testing.assert_allclose(shown(material, tmp_path), expected * PAGE, rtol=5e-3)


def test_what_was_not_baked_is_lit_by_the_baked_surface(tmp_path):
    """Under the middle of a square of 2 m that emits 2 all over, 2 m away: F = 0.2394565."""
    ceiling = quad("Ceiling", shader("Glow", "ShaderNodeEmission", Strength=2.0))
    ceiling.location.z = 2.0
    floor = quad("Floor", diffuse("White", 0.8))
    bake([ceiling, floor], tmp_path, pages={"Floor": -1})
    camera, lamp, world = light_and_camera()
    camera.location.z, camera.data.ortho_scale = 1.0, 0.1
    lamp.data.energy = 0
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    np.testing.assert_allclose(rendered(tmp_path, samples=1024), 0.8 * 2.0 * 0.2394565, rtol=0.03)


@pytest.mark.skipif(bpy.app.version >= (5, 0), reason="materials always have nodes from Blender 5.0 on")
def test_a_material_that_does_not_use_its_nodes_shows_its_plain_colour(tmp_path):
    material = diffuse("Material", 0.1)
    material.use_nodes = False
    material.diffuse_color = (0.8, 0.4, 0.2, 1)
    np.testing.assert_allclose(shown(material, tmp_path), (0.4, 0.2, 0.1), rtol=1e-3)


EEVEE_SCENE = """
import sys
from pathlib import Path
import bpy
from tests.blender.baked import bake, quad
from tests.blender.test_preview import EEVEE_CASES, CASES, PAGE, light_and_camera
bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
walls = []
for index, case in enumerate(EEVEE_CASES):
    walls.append(quad(case, CASES[case][0]()))
    walls[-1].location.x = 2 * index - len(EEVEE_CASES) + 1
bake(walls, Path(sys.argv[1]), value=PAGE)
camera, _, _ = light_and_camera()
camera.data.ortho_scale = 2 * len(EEVEE_CASES)
scene = bpy.context.scene
scene.render.engine = "BLENDER_EEVEE_NEXT" if bpy.app.version < (5, 0) else "BLENDER_EEVEE"
scene.eevee.taa_render_samples = 1
scene.render.resolution_x, scene.render.resolution_y = 8 * len(EEVEE_CASES), 8
scene.render.resolution_percentage = 100
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
scene.render.filepath = str(Path(sys.argv[1]) / "eevee.exr")
bpy.ops.render.render(write_still=True)
"""
EEVEE_CASES = ("diffuse", "mix", "image", "group", "transparent")


@pytest.mark.slow
def test_eevee_shows_the_same(tmp_path):
    """In a process of its own: without OpenGL Blender ends it."""
    subprocess.run([sys.executable, "-c", EEVEE_SCENE, str(tmp_path)], cwd=ROOT, timeout=300, check=False)
    if not (tmp_path / "eevee.exr").exists():
        pytest.skip("Eevee needs OpenGL, which this machine does not offer to a program without a screen")
    picture = bpy.data.images.load(str(tmp_path / "eevee.exr"))
    picture.colorspace_settings.is_data = True
    pixels = np.array(picture.pixels[:]).reshape(8, len(EEVEE_CASES), 8, -1)[4, :, 4, :3]
    np.testing.assert_allclose(pixels, [CASES[case][1] for case in EEVEE_CASES], rtol=2e-3)


def test_a_circle_of_links_comes_to_an_end(tmp_path):
    bake([quad("Wall", circular())], tmp_path)
    assert "Material (Radiosity 1)" in bpy.data.materials


def test_one_copy_serves_all_objects_of_a_material_and_page(tmp_path):
    white = diffuse("White", 0.8)
    walls = [quad(f"Wall {index}", white) for index in range(3)]
    bake(walls, tmp_path, pages={"Wall 2": 1})
    assert [wall.material_slots[0].material.name for wall in walls] == [
        "White (Radiosity 1)",
        "White (Radiosity 1)",
        "White (Radiosity 2)",
    ]


def test_the_albedos_own_nodes_stay_in_the_copy(tmp_path):
    material = textured(diffuse("Paint", 0.8), "Color", (0.6, 0.4, 0.2))
    bake([quad("Wall", material)], tmp_path)
    copy = bpy.data.materials["Paint (Radiosity 1)"]
    assert {node.name for node in material.node_tree.nodes} <= {node.name for node in copy.node_tree.nodes}
    assert copy.node_tree != material.node_tree


def test_reflected_light_is_no_lamp_to_cycles_but_emission_stays_one(tmp_path):
    wall, lamp = quad("Wall", diffuse("White", 0.8)), quad("Lamp", shader("Glow", "ShaderNodeEmission"))
    bake([wall, lamp], tmp_path)
    assert wall.material_slots[0].material.cycles.emission_sampling == "NONE"
    assert lamp.material_slots[0].material.cycles.emission_sampling == "AUTO"
