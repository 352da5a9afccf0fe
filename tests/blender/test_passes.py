# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact sheets: how bright each picture is, and how they lie."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from radiosity_addon import cli
from radiosity_addon.blender.headless.passes import GAP

EDGE = 32
"""Pixels of a picture that are rendered."""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A closed grey room of 2 m with a lamp in the middle, seen from within; of its floor alone without bounces."""
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh = bpy.data.meshes.new("Room")
    mesh.from_pydata(corners, [], [side[::-1] for side in sides])
    light = bpy.data.lights.new("Lamp", "SPOT")
    light.energy, light.spot_size = 200, 1.2
    lamp = bpy.data.objects.new("Lamp", light)
    lamp.location = (0, 0, 0.5)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0, -0.9, 0), (np.pi / 2, 0, 0)
    found = bpy.context.scene
    for thing in (bpy.data.objects.new("Room", mesh), lamp, camera):
        found.collection.objects.link(thing)
    found.camera = camera
    found.view_settings.view_transform = "Standard"
    found.render.resolution_x = found.render.resolution_y = EDGE
    path = tmp_path / "room.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def sheet_of(scene: Path, picture: Path, *words: str) -> list[list[float]]:
    """Mean brightness of the lower half, free of captions, of each picture of a sheet, row by row from the top."""
    size = ("--page-size", "64", "--quality", "draft", "--quiet")
    assert cli.main(["passes", str(scene), "--picture", str(picture), *size, *words]) == 0
    image = bpy.data.images.load(str(picture))
    width, height = image.size
    pixels = np.array(image.pixels[:]).reshape(height, width, 4)[..., :3]
    across, down = (width + GAP) // (EDGE + GAP), (height + GAP) // (EDGE + GAP)
    assert (width, height) == (across * (EDGE + GAP) - GAP, down * (EDGE + GAP) - GAP)
    step = EDGE + GAP
    return [
        [float(pixels[y * step : y * step + EDGE // 2, x * step : x * step + EDGE].mean()) for x in range(across)]
        for y in reversed(range(down))
    ]


def test_each_jacobi_pass_adds_a_dimmer_bounce(scene: Path, tmp_path: Path) -> None:
    before = scene.read_bytes()
    ((direct, one, two, five),) = sheet_of(scene, tmp_path / "sheet.png")
    assert direct < one < two < five
    assert one - direct > two - one
    assert scene.read_bytes() == before


def test_progressive_shots_brighten_and_the_ambient_term_foresees_it(scene: Path, tmp_path: Path) -> None:
    words = ("--solver", "progressive", "--passes", "1,3000")
    plain, ambient = sheet_of(scene, tmp_path / "sheet.png", *words)
    assert plain[0] < plain[1]
    assert abs(ambient[0] - plain[1]) < abs(plain[0] - plain[1])
    assert ambient[1] == pytest.approx(plain[1], rel=0.2)


def test_nothing_is_left_of_a_sheet_that_can_not_be_made(scene: Path, tmp_path: Path) -> None:
    taken = tmp_path / "taken.png"
    taken.mkdir()
    assert cli.main(["passes", str(scene), "--picture", str(taken), "--passes", "1", "--quiet"]) == 1
    assert [entry.name for entry in tmp_path.iterdir() if entry.suffix == ".png"] == ["taken.png"]
