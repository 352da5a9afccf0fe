# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake and revert as operators, from a script; the desktop's tests press the buttons."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest

from radiosity_addon import blender
from radiosity_addon.blender.data.names import BAKE_KEY
from radiosity_addon.blender.interface import operators
from radiosity_addon.errors import SceneError
from radiosity_addon.stages import STAGES
from tests.blender.datablocks import differences, snapshot


@pytest.fixture(autouse=True)
def scene() -> bpy.types.Scene:
    """A floor under a lamp, quick to bake."""
    bpy.ops.mesh.primitive_plane_add(size=2)
    bpy.context.object.name = "Floor"
    lamp = bpy.data.lights.new("Lamp", "POINT")
    lamp.energy = 100
    holder = bpy.data.objects.new("Lamp", lamp)
    holder.location = (0, 0, 2)
    bpy.context.collection.objects.link(holder)
    settings = bpy.context.scene.radiosity
    settings.page_size, settings.quality = 32, "draft"
    return bpy.context.scene


def pages() -> list[bpy.types.Image]:
    return [image for image in bpy.data.images if image.is_float]


def save(folder: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "room.blend"))


def test_a_bake_of_an_unsaved_file_is_packed_and_survives_saving(tmp_path: Path) -> None:
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    assert [image.packed_file is not None for image in pages()] == [True]
    save(tmp_path)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "room.blend"))
    assert max(pages()[0].pixels[:3]) > 0
    assert [path.name for path in tmp_path.iterdir()] == ["room.blend"]


def test_a_bake_of_a_saved_file_puts_its_pages_beside_it(tmp_path: Path) -> None:
    save(tmp_path)
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    assert pages()[0].filepath == "//room_textures/room_radiosity_1.exr"
    assert [path.name for path in (tmp_path / "room_textures").iterdir()] == ["room_radiosity_1.exr"]


def test_each_scene_of_a_file_keeps_pages_of_its_own(tmp_path: Path, scene: bpy.types.Scene) -> None:
    save(tmp_path)
    night = bpy.data.scenes.new("Night / 2")
    night.radiosity.page_size, night.radiosity.quality = 32, "draft"
    bpy.context.window.scene = night
    bpy.ops.mesh.primitive_cube_add()
    for each in (scene, night, scene, night):
        bpy.context.window.scene = each
        assert bpy.ops.radiosity.bake() == {"FINISHED"}
    names = {image[BAKE_KEY]: Path(image.filepath).name for image in pages()}
    assert names[scene[BAKE_KEY]] == "room_radiosity_1.exr"
    assert names[night[BAKE_KEY]].startswith("room_Night _ 2")
    assert sorted(path.name for path in (tmp_path / "room_textures").iterdir()) == sorted(names.values())


def test_a_chosen_folder_is_taken_as_blender_writes_paths(tmp_path: Path, scene: bpy.types.Scene) -> None:
    save(tmp_path)
    scene.radiosity.textures = "//light/maps/"
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    assert (tmp_path / "light" / "maps" / "room_radiosity_1.exr").is_file()


def test_revert_leaves_the_file_as_it_was_before_the_bake() -> None:
    before = snapshot()
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    assert differences(before, snapshot())
    assert bpy.ops.radiosity.revert() == {"FINISHED"}
    assert differences(before, snapshot()) == []


def test_revert_is_not_offered_where_nothing_is_baked() -> None:
    assert not bpy.ops.radiosity.revert.poll()


def test_what_can_not_be_baked_is_reported_and_changes_nothing() -> None:
    bpy.data.objects["Floor"].radiosity.exclude = True
    before = snapshot()
    with pytest.raises(RuntimeError, match="nothing is left to bake"):
        bpy.ops.radiosity.bake()
    assert differences(before, snapshot()) == []


def test_a_folder_that_can_not_be_written_is_reported(tmp_path: Path, scene: bpy.types.Scene) -> None:
    save(tmp_path)
    scene.radiosity.textures = "//room.blend/"
    with pytest.raises(RuntimeError, match=r"room\.blend"):
        bpy.ops.radiosity.bake()
    assert [path.name for path in tmp_path.iterdir()] == ["room.blend"]


@pytest.mark.parametrize("stage", ["Read scene", *STAGES, "Write files", "Write back"])
def test_a_bake_cancelled_in_any_stage_leaves_no_trace(stage: str, tmp_path: Path, scene: bpy.types.Scene) -> None:
    save(tmp_path)
    before = snapshot()
    steps = operators.bake_in_place(scene)
    assert any(progress.stage == stage for progress in steps), "the stage came up"
    steps.close()
    assert differences(before, snapshot()) == []
    assert [path.name for path in tmp_path.iterdir()] == ["room.blend"]


def test_a_scene_deleted_during_the_bake_is_an_error(scene: bpy.types.Scene) -> None:
    steps = operators.bake_in_place(scene)
    for progress in steps:
        if progress.stage == "Write files":
            break
    bpy.data.scenes.new("Other")
    bpy.data.scenes.remove(scene)
    with pytest.raises(SceneError, match="renamed or deleted"):
        list(steps)


def test_the_extension_can_be_taken_out_and_put_back() -> None:
    blender.unregister()
    assert not hasattr(bpy.types.Scene, "radiosity")
    assert not hasattr(bpy.types, "RADIOSITY_OT_bake")
    blender.register()
    assert hasattr(bpy.types.Scene, "radiosity")


def test_within_registered_it_stays_registered() -> None:
    with blender.registered():
        pass
    assert hasattr(bpy.types.Scene, "radiosity")
