# SPDX-License-Identifier: GPL-3.0-or-later
"""Two-sided objects: a uv map for each side, previews that show both, and nothing left of them after revert."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.errors import SceneError
from tests.blender.datablocks import differences, snapshot
from tests.blender.materials import bare, diffuse

SUN = 3.0
"""W/m2; a surface that faces it holds 3 / pi."""


@pytest.fixture(autouse=True)
def leaf() -> bpy.types.Object:
    """A leaf of 2 m that faces up, under the sun, white on both sides, in front of nothing."""
    bpy.ops.mesh.primitive_plane_add(size=2)
    thing = bpy.context.object
    thing.name = "Leaf"
    thing.data.materials.append(diffuse("White", 0.5))
    thing.radiosity.two_sided = True
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy = SUN
    bpy.context.collection.objects.link(bpy.data.objects.new("Sun", sun))
    settings = bpy.context.scene.radiosity
    settings.page_size, settings.quality = 64, "draft"
    return thing


def middle_of(thing: bpy.types.Object, uv_map: str) -> float:
    """What the page holds in the middle of an object."""
    uv = np.mean([entry.vector for entry in thing.data.uv_layers[uv_map].uv], axis=0)
    image = next(image for image in bpy.data.images if image.is_float)
    width, height = image.size
    pixels = np.array(image.pixels[:]).reshape(height, width, -1)
    return float(pixels[int(uv[1] * height), int(uv[0] * width), 0])


def seen(above: bool, folder: Path) -> float:
    """Radiance in the middle of the leaf, from above or below, in a Cycles render."""
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    camera.location = (0.1, 0.1, 3 if above else -3)
    camera.rotation_euler = (0 if above else np.pi, 0, 0)
    scene.camera, scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = camera, "CYCLES", 4, False
    scene.render.resolution_x = scene.render.resolution_y = 16
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.filepath = str(folder / f"seen{above}.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    image.colorspace_settings.is_data = True
    pixels = np.array(image.pixels[:]).reshape(16, 16, -1)
    bpy.data.images.remove(image)
    bpy.data.objects.remove(camera)
    return float(pixels[8, 8, 0])


def test_each_side_holds_its_own_light_and_the_preview_shows_it(leaf: bpy.types.Object, tmp_path: Path) -> None:
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    assert [layer.name for layer in leaf.data.uv_layers][-2:] == ["Radiosity", "Radiosity Back"]
    assert middle_of(leaf, "Radiosity") == pytest.approx(SUN / np.pi, rel=0.005)
    assert middle_of(leaf, "Radiosity Back") == pytest.approx(0, abs=1e-4)
    bpy.data.objects.remove(bpy.data.objects["Sun"])
    assert seen(True, tmp_path) == pytest.approx(0.5 * SUN / np.pi, rel=0.01)
    assert seen(False, tmp_path) == pytest.approx(0, abs=1e-3)


def test_light_from_below_is_on_the_back(leaf: bpy.types.Object, tmp_path: Path) -> None:
    bpy.data.objects["Sun"].rotation_euler = (np.pi, 0, 0)
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    assert middle_of(leaf, "Radiosity Back") == pytest.approx(SUN / np.pi, rel=0.005)
    assert middle_of(leaf, "Radiosity") == pytest.approx(0, abs=1e-4)
    bpy.data.objects.remove(bpy.data.objects["Sun"])
    assert seen(False, tmp_path) == pytest.approx(0.5 * SUN / np.pi, rel=0.01)


def test_a_mirrored_modified_leaf_has_its_sides_the_right_way_round(leaf: bpy.types.Object, tmp_path: Path) -> None:
    leaf.scale = (-1, 1, 1)
    leaf.modifiers.new("Subdivision", "SUBSURF").subdivision_type = "SIMPLE"
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    shown = bpy.data.objects["Leaf (Radiosity)"]
    light = sorted(middle_of(shown, name) for name in ("Radiosity", "Radiosity Back"))
    assert light == pytest.approx([0, SUN / np.pi], rel=0.005, abs=1e-4)
    bpy.data.objects.remove(bpy.data.objects["Sun"])
    assert seen(True, tmp_path) == pytest.approx(0.5 * SUN / np.pi, rel=0.01)
    assert seen(False, tmp_path) == pytest.approx(0, abs=1e-3)


def test_revert_takes_both_maps_out_again() -> None:
    before = snapshot()
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    assert bpy.ops.radiosity.bake() == {"FINISHED"}, "again, over the first"
    assert bpy.ops.radiosity.revert() == {"FINISHED"}
    assert not differences(before, snapshot())


def test_two_sides_need_room_for_two_uv_maps(leaf: bpy.types.Object) -> None:
    while len(leaf.data.uv_layers) < 7:
        leaf.data.uv_layers.new()
    with pytest.raises(SceneError, match="two sides take two"):
        extract_scene(bpy.context.scene)
    leaf.radiosity.two_sided = False
    assert not extract_scene(bpy.context.scene).scene.meshes[0].two_sided


def test_paper_is_two_sided_by_itself_and_shows_the_light_that_comes_through(
    leaf: bpy.types.Object, tmp_path: Path
) -> None:
    """rho = 0.1, tau = 0.4: each side holds its share of the sun on the upper one, the preview half of it."""
    leaf.radiosity.two_sided = False
    paper = bare("Paper")
    nodes, links = paper.node_tree.nodes, paper.node_tree.links
    both, end = nodes.new("ShaderNodeAddShader"), nodes.new("ShaderNodeOutputMaterial")
    for place, (kind, grey) in enumerate((("Diffuse", 0.1), ("Translucent", 0.4))):
        closure = nodes.new(f"ShaderNodeBsdf{kind}")
        closure.inputs["Color"].default_value = (grey, grey, grey, 1)
        links.new(closure.outputs[0], both.inputs[place])
    links.new(both.outputs[0], end.inputs["Surface"])
    leaf.data.materials[0] = paper
    before = snapshot()
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    assert middle_of(leaf, "Radiosity") == pytest.approx(0.2 * SUN / np.pi, rel=0.005)
    assert middle_of(leaf, "Radiosity Back") == pytest.approx(0.8 * SUN / np.pi, rel=0.005)
    sun = bpy.data.objects["Sun"]
    sun.hide_render = True
    assert seen(True, tmp_path) == pytest.approx(0.1 * SUN / np.pi, rel=0.01)
    assert seen(False, tmp_path) == pytest.approx(0.4 * SUN / np.pi, rel=0.01)
    sun.hide_render = False
    assert bpy.ops.radiosity.revert() == {"FINISHED"}
    assert not [each for each in differences(before, snapshot()) if "Leaf" in each or "Paper" in each]
