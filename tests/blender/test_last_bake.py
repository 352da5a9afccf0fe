# SPDX-License-Identifier: GPL-3.0-or-later
"""What stays of a bake's report on its scene."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest

from radiosity_addon.blender import last_bake
from radiosity_addon.blender.last_bake import pace, summary, warnings, write_last_report
from radiosity_addon.errors import SceneError
from radiosity_addon.estimate import Pace
from tests.blender.built import add_lamp, add_mesh


@pytest.fixture(autouse=True)
def scene() -> bpy.types.Scene:
    add_mesh("Floor")
    add_mesh("Flat", scale=(1, 1, 0))
    add_lamp("POINT", energy=100)
    settings = bpy.context.scene.radiosity
    settings.page_size, settings.quality = 32, "draft"
    return bpy.context.scene


def test_a_bake_leaves_its_summary_and_warnings_until_it_is_reverted(scene: bpy.types.Scene) -> None:
    assert summary(scene) == ""
    bpy.ops.radiosity.bake()
    assert summary(scene).startswith("Baked 1 object on 1 page of 32 x 32")
    assert warnings(scene) == ["Flat is left out: its scale is zero along an axis"]
    bpy.ops.radiosity.revert()
    assert (summary(scene), warnings(scene)) == ("", [])


@pytest.mark.parametrize("saved", [False, True])
def test_the_report_shows_the_pages_wherever_the_file_was_moved(
    saved: bool, scene: bpy.types.Scene, tmp_path: Path
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    blend = "room.blend"
    if saved:
        bpy.ops.wm.save_as_mainfile(filepath=str(first / blend))
    bpy.ops.radiosity.bake()
    bpy.ops.wm.save_as_mainfile(filepath=str(first / blend))
    first.rename(second)
    bpy.ops.wm.open_mainfile(filepath=str(second / blend))
    page = write_last_report(bpy.context.scene, tmp_path)
    html = page.read_text(encoding="utf-8")
    assert html.count("data:image/png;base64") >= 1, "the page's picture"
    assert "Floor" in html


def test_without_a_bake_there_is_no_report(scene: bpy.types.Scene, tmp_path: Path) -> None:
    assert not bpy.ops.radiosity.show_report.poll()
    with pytest.raises(SceneError, match="no report"):
        write_last_report(scene, tmp_path)


def test_the_operator_writes_the_page_where_blender_cleans_up(scene: bpy.types.Scene) -> None:
    bpy.ops.radiosity.bake()
    assert bpy.ops.radiosity.show_report() == {"FINISHED"}
    assert (Path(bpy.app.tempdir) / "radiosity_report.html").stat().st_size > 1000


def test_how_slow_a_bake_was_is_known_for_its_scene_and_learned_for_others(
    scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "speed.json"
    monkeypatch.setattr(last_bake, "_machine", {})
    monkeypatch.setattr(last_bake, "_machine_file", lambda create: file)
    monkeypatch.setattr(last_bake, "TELLING", 1)
    assert pace(scene) == Pace()
    bpy.ops.radiosity.bake()
    of_scene = pace(scene)
    assert of_scene.slowness != 1.0
    other = bpy.data.scenes.new("Other")
    learned = Pace().fixed, pytest.approx(of_scene.slowness**0.5)  # half way, on a scale of ratios
    assert (pace(other).fixed, pace(other).slowness) == learned
    last_bake._machine.clear()
    assert (pace(other).fixed, pace(other).slowness) == learned, "from the file"
    file.write_text("not JSON")
    last_bake._machine.clear()
    assert pace(other) == Pace()


def test_a_tiny_bake_tells_next_to_nothing_of_the_machine(
    scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(last_bake, "_machine", {"slowness": 1.0})
    bpy.ops.radiosity.bake()
    assert last_bake._machine["slowness"] == pytest.approx(1.0, abs=0.01)
