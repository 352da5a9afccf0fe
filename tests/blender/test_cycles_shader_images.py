# SPDX-License-Identifier: GPL-3.0-or-later
"""What image nodes show on the page: colour spaces, interpolation, uv maps, tiles."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests.blender.shader_trees import SIZE, checkers, emitting, image, of_coordinates, of_image, pages, plane


@pytest.mark.parametrize(("space", "expected"), [("sRGB", 0.21404), ("Non-Color", 128 / 255)])
def test_images_are_decoded_by_their_colour_space(space, expected):
    shown = image("Paint", [[(0.502, 0.502, 0.502)]], space)
    plane("Floor", emitting(of_image(shown)))
    assert pages()["Floor"][32, 32] == pytest.approx([expected] * 3, abs=2e-3)


def test_closest_and_linear_interpolation_are_blenders():
    two = image("Two", [[(0, 0, 0), (1, 1, 1)]], float_buffer=True, is_data=True)
    plane("Sharp", emitting(of_image(two, interpolation="Closest", extension="EXTEND"), "Sharp"))
    plane("Soft", emitting(of_image(two, extension="EXTEND"), "Soft"))
    shown = pages()
    assert np.unique(shown["Sharp"][:, :, 0]).tolist() == [0, 1]
    expected = np.clip(2 * (np.arange(SIZE) + 0.5) / SIZE - 0.5, 0, 1)
    assert np.abs(shown["Soft"][:, :, 0] - expected).max() < 5e-3


def test_a_missing_image_is_pink():
    lost = bpy.data.images.new("lost", 4, 4)
    lost.source = "FILE"
    lost.filepath = "//nowhere.png"
    plane("Floor", emitting(of_image(lost)))
    assert pages()["Floor"][32, 32] == pytest.approx([1, 0, 1])


def add_uv_map(thing: bpy.types.Object, name: str, scale: float) -> None:
    first = np.empty(len(thing.data.loops) * 2, np.float32)
    thing.data.uv_layers["UVMap"].uv.foreach_get("vector", first)
    thing.data.uv_layers.new(name=name).uv.foreach_set("vector", scale * first)


def test_each_image_takes_the_uv_map_that_it_is_given_or_the_one_set_for_rendering():
    quarters = image("Quarters", [[(1, 0, 0), (0, 1, 0)], [(0, 0, 1), (1, 1, 0)]], float_buffer=True, is_data=True)
    given = plane("Given", emitting(of_image(quarters, "Small", interpolation="Closest"), "Given"))
    default = plane("Default", emitting(of_image(quarters, interpolation="Closest"), "Default"))
    for thing in (given, default):
        add_uv_map(thing, "Small", 0.4)
    default.data.uv_layers["UVMap"].active_render = True
    shown = pages()
    assert np.unique(shown["Given"].reshape(-1, 3), axis=0).tolist() == [[1, 0, 0]]
    assert shown["Default"][48, 48].tolist() == [1, 1, 0]
    default.data.uv_layers["Small"].active_render = True
    assert pages()["Default"][48, 48].tolist() == [1, 0, 0]


def test_eight_uv_maps_leave_room_for_the_pages():
    plane("Floor", emitting(checkers))
    thing = plane("Full", emitting(of_coordinates("UV")))
    thing.radiosity.only_casts = True
    for number in range(7):
        add_uv_map(thing, f"Map {number}", 0.1)
    assert len(thing.data.uv_layers) == 8
    assert pages()["Full"][32, 32, :2] == pytest.approx([0.5, 0.5], abs=0.01)


def test_tiles_of_a_udim_lie_side_by_side(tmp_path):
    tiled = bpy.data.images.new("Tiles", 4, 4, tiled=True, float_buffer=True, is_data=True)
    with bpy.context.temp_override(edit_image=tiled):
        tiled.tiles.new(tile_number=1002)
        for number, color in ((0, (1, 0, 0, 1)), (1, (0, 0, 1, 1))):
            tiled.tiles.active_index = number
            bpy.ops.image.tile_fill(color=color, width=4, height=4, float=True, alpha=True)
    tiled.filepath_raw, tiled.file_format = str(tmp_path / "tiles.<UDIM>.exr"), "OPEN_EXR"
    tiled.save()  # Cycles of 4.2 looks for tiles in files alone
    thing = plane("Floor", emitting(of_image(tiled, "Wide")))
    add_uv_map(thing, "Wide", 2.0)
    page = pages()["Floor"]
    assert page[16, 16] == pytest.approx([1, 0, 0], abs=1e-3)
    assert page[16, 48] == pytest.approx([0, 0, 1], abs=1e-3)
