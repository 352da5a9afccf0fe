# SPDX-License-Identifier: GPL-3.0-or-later
"""Page files of every format, shown by Cycles by their colour space and node group, hold the light that was baked."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.data.working_space import working_space
from radiosity_addon.blender.writing.page_images import light_of, load_page
from radiosity_addon.color.spaces import ACESCG, REC709, REC2020, RGBSpace
from radiosity_addon.files import Transaction
from radiosity_addon.pages.page_files import page_paths, write_pages
from radiosity_addon.pages.page_format import FORMATS, PageFormat
from tests.blender.materials import bare

SIZE = 16
WORKING = {"Linear Rec.709": REC709, "Linear Rec.2020": REC2020, "ACEScg": ACESCG}
CHOOSES_WORKING_SPACE = hasattr(bpy.data, "colorspace")  # from 5.0


def stops(count: int = 10) -> np.ndarray:
    """Colours inside Rec.709 over some stops, up to 8 W/(m2 sr)."""
    random = np.random.default_rng(11)
    shares = 0.15 + 0.85 * random.random((SIZE, SIZE, 3))
    return (8 * shares * 2.0 ** -(random.random((SIZE, SIZE, 1)) * count)).astype(np.float32)


def set_working_space(name: str) -> None:
    if CHOOSES_WORKING_SPACE:
        bpy.ops.wm.set_working_color_space(working_space=name, convert_colors=False)
    elif name != "Linear Rec.709":
        pytest.skip("this Blender works in Rec.709 alone")


def seen_by_cycles(image: bpy.types.Image, token: str, tmp_path: Path) -> np.ndarray:
    """What Cycles renders of a plane that shows the page, one pixel a texel, in the working space."""
    scene = bpy.context.scene
    mesh = bpy.data.meshes.new("plane")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    mesh.uv_layers.new().uv.foreach_set("vector", np.float32([0, 0, 1, 0, 1, 1, 0, 1]))
    material = bare("page")
    tree = material.node_tree
    texture, emission = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new("ShaderNodeEmission")
    end = tree.nodes.new("ShaderNodeOutputMaterial")
    texture.image, texture.interpolation = image, "Closest"
    tree.links.new(light_of(tree, texture, token), emission.inputs["Color"])
    tree.links.new(emission.outputs[0], end.inputs["Surface"])
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("plane", mesh))
    camera = bpy.data.cameras.new("camera")
    camera.type, camera.ortho_scale = "ORTHO", 2.0
    eye = bpy.data.objects.new("camera", camera)
    eye.location = 0, 0, 2
    scene.collection.objects.link(eye)
    scene.camera = eye
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = 1, False, False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR", "32"
    settings.color_management = "OVERRIDE"
    settings.linear_colorspace_settings.name = "scene_linear" if CHOOSES_WORKING_SPACE else "Linear Rec.709"
    scene.render.filepath = str(tmp_path / "seen.exr")
    bpy.ops.render.render(write_still=True)
    seen = bpy.data.images.load(scene.render.filepath)
    seen.colorspace_settings.is_data = True
    pixels = np.empty(SIZE * SIZE * 4, np.float32)
    seen.pixels.foreach_get(pixels)
    return pixels.reshape(SIZE, SIZE, 4)[..., :3]


def shown(page: np.ndarray, wanted: PageFormat, working: RGBSpace, tmp_path: Path) -> np.ndarray:
    paths = page_paths(tmp_path, "room", 1, wanted.suffix)
    with Transaction() as files:
        done = write_pages([page], paths, wanted, working, files)
        files.commit()
    image = load_page(paths[0], 0, "token", done.recipe, pack=False)
    return seen_by_cycles(image, "token", tmp_path)


TOLERANCES = {
    "exr": 1e-3,
    "hdr": 5e-3,
    "png8": 0.035,
    "png16": 1e-3,
    "rgbm": 1e-2,
    "rgbd": 1e-2,
    "logluv": 2e-3,
    "rgb9e5": 3e-3,
}
"""Error of a colour's largest channel: the format's own, of png8 a whole step, and a little for Cycles' half floats."""


def check(name: str, working: str, tmp_path: Path, space: str | None = None) -> None:
    set_working_space(working)
    is_picture = name in ("png8", "png16")
    in_rec709 = np.clip(stops(), 0.25, None) if is_picture else stops()
    page = (in_rec709 @ REC709.to(WORKING[working]).T).astype(np.float32)
    wanted = PageFormat(name, exposure=-3.0 if is_picture else 0.0, space=space)
    found = shown(page, wanted, working_space(), tmp_path)
    error = np.abs(found - page) / page.max(axis=-1, keepdims=True)
    assert error.max() < TOLERANCES[name]


@pytest.mark.parametrize("name", FORMATS)
def test_cycles_sees_the_light_of_every_format(name: str, tmp_path: Path) -> None:
    check(name, "Linear Rec.709", tmp_path)


@pytest.mark.parametrize("working", ["Linear Rec.2020", "ACEScg"])
@pytest.mark.parametrize(
    ("name", "space"),
    [("exr", None), ("exr", "rec709"), ("png16", None), ("png16", "p3"), ("rgbm", "rec709"), ("logluv", None)],
)
def test_cycles_sees_the_light_in_other_working_spaces(name: str, space: str, working: str, tmp_path: Path) -> None:
    check(name, working, tmp_path, space)


@pytest.mark.parametrize("name", ["Linear Rec.709", "Linear Rec.2020", "ACEScg"])
def test_the_working_space_is_the_one_that_blender_has(name: str) -> None:
    set_working_space(name)
    space = working_space()
    assert space.name == name
    digit = 1e-6 if CHOOSES_WORKING_SPACE else 3e-4  # 4.5 rounds D65 in another one
    np.testing.assert_allclose(space.to_xyz, WORKING[name].to_xyz, atol=digit)


@pytest.mark.parametrize(
    ("wanted", "colorspace"),
    [
        (PageFormat("exr"), "Non-Color"),
        (PageFormat("exr", space="rec2020"), "Linear Rec.2020"),
        (PageFormat("png8"), "sRGB"),
        (PageFormat("png8", space="p3"), "Display P3"),
        (PageFormat("png16", transfer="linear"), "Non-Color"),
        (PageFormat("rgbm"), "Non-Color"),
    ],
    ids=["EXR", "EXR in Rec.2020", "sRGB", "Display P3", "linear PNG", "RGBM"],
)
def test_an_image_gets_the_colour_space_of_its_numbers(wanted, colorspace: str, tmp_path: Path) -> None:
    paths = page_paths(tmp_path, "room", 1, wanted.suffix)
    with Transaction() as files:
        done = write_pages([stops()], paths, wanted, working_space(), files)
        files.commit()
    image = load_page(paths[0], 0, "token", done.recipe, pack=False)
    assert image.colorspace_settings.name == colorspace


def test_alpha_that_is_a_number_is_not_multiplied_in(tmp_path: Path) -> None:
    paths = page_paths(tmp_path, "room", 1, ".png")
    with Transaction() as files:
        done = write_pages([stops()], paths, PageFormat("rgbd"), REC709, files)
        files.commit()
    assert load_page(paths[0], 0, "token", done.recipe, pack=False).alpha_mode == "CHANNEL_PACKED"


def test_pages_of_a_bake_share_one_node_group(tmp_path: Path) -> None:
    paths = page_paths(tmp_path, "room", 2, ".png")
    with Transaction() as files:
        done = write_pages([stops(), stops()], paths, PageFormat("rgbm"), REC709, files)
        files.commit()
    material = bare("both")
    for page, path in enumerate(paths):
        texture = material.node_tree.nodes.new("ShaderNodeTexImage")
        texture.image = load_page(path, page, "token", done.recipe, pack=False)
        light_of(material.node_tree, texture, "token")
    assert len(bpy.data.node_groups) == 1
