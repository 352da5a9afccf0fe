# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets: those that come along are complete and sound, and a user's own come back."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import bpy
import pytest

from radiosity_addon.blender.interface.presets import ROOT, VALUES

SHIPPED = sorted((ROOT / "presets" / "radiosity").glob("*.py"))


def run(path: Path) -> None:
    assert bpy.ops.script.execute_preset(filepath=str(path), menu_idname="RADIOSITY_PT_presets") == {"FINISHED"}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_preset_sets_everything_and_can_be_baked_with(path: Path) -> None:
    run(path)
    settings = bpy.context.scene.radiosity
    assert settings.bake_settings()
    assert settings.files.page_format()
    assert tuple(re.findall(r"^(settings\.[\w.]+) = ", path.read_text(), re.MULTILINE)) == VALUES


def test_presets_differ_from_one_another() -> None:
    assert len({path.read_text() for path in SHIPPED}) == len(SHIPPED) >= 4


def test_blender_finds_those_that_come_along() -> None:
    assert str(SHIPPED[0].parent) in [str(Path(path)) for path in bpy.utils.preset_paths("radiosity")]


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A place for presets of one's own that no other test sees."""
    monkeypatch.setattr(bpy.utils, "user_resource", lambda kind, path="", create=False: str(made(tmp_path / path)))
    return tmp_path


def made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def test_a_preset_of_ones_own_brings_all_settings_back(own: Path) -> None:
    settings = bpy.context.scene.radiosity
    settings.quality, settings.density, settings.files.format = "high", 17.0, "rgbd"
    assert bpy.ops.radiosity.preset_add(name="Mine") == {"FINISHED"}
    settings.quality, settings.density, settings.files.format = "draft", 3.0, "exr"
    (kept,) = own.rglob("*.py")
    run(kept)
    assert (settings.quality, settings.density, settings.files.format) == ("high", 17.0, "rgbd")


def test_a_preset_of_ones_own_can_be_removed_and_one_that_came_along_can_not(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bpy.ops.radiosity.preset_add(name="Mine")
    (kept,) = own.rglob("*.py")
    monkeypatch.setattr(bpy.utils, "preset_find", lambda name, *_, **__: str(kept if name == "Mine" else SHIPPED[0]))
    bpy.ops.radiosity.preset_add(name="Mine", remove_name=True)
    bpy.ops.radiosity.preset_add(name=SHIPPED[0].stem, remove_name=True)
    assert (kept.exists(), SHIPPED[0].exists()) == (False, True)
