# SPDX-License-Identifier: GPL-3.0-or-later
"""The room of docs/tutorial.md, as its steps build it from the default cube."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests.desktop import tutorial_steps


@pytest.fixture
def room() -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    for step in (tutorial_steps.build_room, tutorial_steps.color_cube, tutorial_steps.place_lamp):
        step()


def test_check_finds_nothing_but_the_unsaved_file(room: None) -> None:
    from radiosity_addon.blender.reading.inspection import UNSAVED, inspect

    found = inspect(bpy.context.scene, bpy.context.scene.radiosity.bake_settings())
    assert found.findings == (UNSAVED,)


def test_cube_throws_red_light_on_the_walls(room: None) -> None:
    from radiosity_addon.blender.data.names import PAGE_KEY

    scene = bpy.context.scene
    scene.radiosity.page_size, scene.radiosity.quality = 128, "draft"
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    (page,) = (image for image in bpy.data.images if PAGE_KEY in image)
    pixels = np.empty(len(page.pixels), np.float32)
    page.pixels.foreach_get(pixels)
    red, _, blue, _ = np.moveaxis(pixels.reshape(-1, 4), 1, 0)
    ratio = (red / blue)[red > 0.1 * red.max()]
    assert np.quantile(ratio, 0.01) > 1.0
    assert np.quantile(ratio, 0.99) > 1.5
