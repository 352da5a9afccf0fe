# SPDX-License-Identifier: GPL-3.0-or-later
"""The hand-over: lightmap files in any format, what belongs where, nothing changed and nothing half-written."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import bpy
import pytest

from radiosity_addon import cli
from radiosity_addon.blender.handover import gltf
from radiosity_addon.blender.handover.export import Exported, Handover, export_lightmaps
from radiosity_addon.blender.interface import export_panel
from radiosity_addon.errors import BakeError, OutputError, SceneError
from radiosity_addon.files import Transaction
from radiosity_addon.pages.page_files import read_page
from radiosity_addon.pages.page_format import PageFormat, Recipe
from tests.blender.baked import bake, quad
from tests.blender.datablocks import differences, snapshot
from tests.blender.materials import diffuse, shader


def export(folder: Path, wanted: str = "exr", gltf: bool = True) -> Exported:
    with Transaction() as files:
        exported = export_lightmaps(bpy.context.scene, Handover(folder, "room", PageFormat(wanted), gltf), files)
        files.commit()
    return exported


def files_in(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """Two squares on two pages that hold 0.5 everywhere, saved; the folder of the exports."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    things = [quad("Floor", diffuse("Grey", 0.25)), quad("Wall", shader("Red", "ShaderNodeBsdfPrincipled"))]
    bake(things, tmp_path, 0.5, pages={"Wall": 1})
    return tmp_path / "out"


@pytest.mark.parametrize("wanted", ["exr", "hdr", "png16", "rgbm", "rgb9e5"])
def test_every_format_holds_the_light_of_the_bake_by_what_its_sidecar_says(room: Path, wanted: str) -> None:
    exported = export(room, wanted, gltf=False)
    known = json.loads(exported.sidecar.read_text())
    assert known["pages"] == [path.name for path in exported.pages]
    for page in exported.pages:
        assert read_page(page, Recipe.from_dict(known)) == pytest.approx(0.5, rel=0.01)


def test_the_sidecar_tells_the_page_of_every_lit_object(room: Path) -> None:
    quad("Unlit")
    rows = json.loads(export(room).sidecar.read_text())["objects"]
    assert [(row["object"], row["page"]) for row in rows] == [
        ("Floor", "room_radiosity_1.exr"),
        ("Wall", "room_radiosity_2.exr"),
    ]
    assert {(row["uv_map"], *row["uv_scale"], *row["uv_offset"]) for row in rows} == {("Radiosity", 1, 1, 0, 0)}


def test_packed_pages_are_exported_too(tmp_path: Path) -> None:
    bake([quad("Floor")], tmp_path, 0.5, pack=True)
    (tmp_path / "radiosity_1.exr").unlink()
    exported = export(tmp_path / "out", gltf=False)
    recipe = Recipe.from_dict(json.loads(exported.sidecar.read_text()))
    assert read_page(exported.pages[0], recipe) == pytest.approx(0.5)


def test_an_export_leaves_the_file_as_it_was(room: Path) -> None:
    bpy.data.scenes.new("Another")
    bpy.data.scenes.new("Zoo")
    window = bpy.context.window
    window.view_layer = window.scene.view_layers.new("Second")
    window.view_layer.objects.active = bpy.data.objects["Wall"]
    before, shown = snapshot(), (window.scene, window.view_layer)
    export(room)
    assert differences(before, snapshot()) == []
    assert (window.scene, window.view_layer) == shown


def test_a_scene_that_shows_its_originals_is_exported_lit_and_shows_them_again(room: Path) -> None:
    bent = quad("Bent", diffuse("Grey", 0.25))
    bent.modifiers.new("Array", "ARRAY")
    things = [bpy.data.objects[name] for name in ("Floor", "Wall")]
    bake([*things, bent], room.parent, 0.5)
    bpy.ops.radiosity.toggle()
    before = snapshot()
    rows = json.loads(export(room).sidecar.read_text())["objects"]
    assert {row["object"] for row in rows} == {"Floor", "Wall", "Bent"}
    assert differences(before, snapshot()) == []


def test_blenders_exporter_is_enabled_for_the_export_alone(room: Path) -> None:
    import addon_utils

    addon_utils.disable(gltf.ADDON, default_set=True)
    bpy.context.preferences.is_dirty = False
    try:
        assert export(room).gltf.is_file()
        assert not bpy.context.preferences.is_dirty
        assert gltf.ADDON not in bpy.context.preferences.addons
    finally:
        addon_utils.enable(gltf.ADDON, default_set=True)


def test_a_failed_export_leaves_old_files_and_the_scene_alone(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    export(room)
    before, scene = files_in(room), snapshot()
    monkeypatch.setattr(gltf._Lightmaps, "gather_material_hook", lambda *asked: None)
    with pytest.raises(OutputError, match="0 of its 2 lit materials"):
        export(room, "rgbm")
    assert files_in(room) == before
    assert differences(scene, snapshot()) == []


def lose_a_page() -> None:
    Path(bpy.path.abspath(bpy.data.images["Radiosity 2"].filepath)).unlink()


def delete_an_image() -> None:
    bpy.data.images.remove(bpy.data.images["Radiosity 1"])


def delete_a_uv_map() -> None:
    layers = bpy.data.meshes["Wall"].uv_layers
    layers.remove(layers["Radiosity"])


def forget_the_bake() -> None:
    bpy.ops.radiosity.revert()


@pytest.mark.parametrize(
    ("damage", "kind", "said"),
    [
        (lose_a_page, OutputError, "the file of 'Radiosity 2' is missing"),
        (delete_an_image, SceneError, "the image of one of its lightmaps was deleted"),
        (delete_a_uv_map, SceneError, "Wall: its uv map 'Radiosity' is gone"),
        (forget_the_bake, SceneError, "it is not baked"),
    ],
)
def test_what_is_missing_is_named_and_nothing_is_written(
    room: Path, damage: Callable[[], None], kind: type[BakeError], said: str
) -> None:
    damage()
    with pytest.raises(kind, match=said):
        export(room)
    assert not room.exists()


def test_a_file_in_the_place_of_the_folder_is_an_error(room: Path) -> None:
    room.write_text("a file")
    with pytest.raises(OutputError, match="it is a file, not a folder"):
        export(room)


def test_the_operator_exports_beside_the_file(room: Path) -> None:
    assert bpy.ops.radiosity.export() == {"FINISHED"}
    assert sorted(files_in(room.with_name("room_export"))) == [
        "room.glb",
        "room_radiosity.json",
        "room_radiosity_1.exr",
        "room_radiosity_2.exr",
    ]


def test_an_unsaved_file_asks_for_a_folder(tmp_path: Path) -> None:
    bake([quad("Floor")], tmp_path)
    with pytest.raises(RuntimeError, match="the file is not saved"):
        bpy.ops.radiosity.export()
    bpy.context.scene.radiosity_export.folder = str(tmp_path / "out")
    assert bpy.ops.radiosity.export() == {"FINISHED"}


def test_the_operator_is_greyed_out_without_a_bake() -> None:
    assert not bpy.ops.radiosity.export.poll()


def test_every_setting_and_button_has_a_tooltip() -> None:
    settings = export_panel.RadiosityExportSettings.bl_rna.properties
    assert all(settings[name].description for name in ("folder", "gltf", "files"))
    assert export_panel.RADIOSITY_OT_export.__doc__


def test_the_command_line_exports_a_baked_file(room: Path, capfd: pytest.CaptureFixture[str]) -> None:
    blend = room.with_name("room.blend")
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    assert cli.main(["export", str(blend), "-o", str(room), "--format", "rgbm", "--no-gltf"]) == 0
    assert sorted(files_in(room)) == ["room_radiosity.json", "room_radiosity_1.png", "room_radiosity_2.png"]
    assert capfd.readouterr().out.splitlines()[-1] == f"Exported 2 lightmaps to {room}"
