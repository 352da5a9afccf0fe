# SPDX-License-Identifier: GPL-3.0-or-later
"""The check before a bake, as operator and as the command line's `info`, and what its buttons do."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest

from radiosity_addon.arguments import Verb
from radiosity_addon.blender.headless.commands import info
from radiosity_addon.blender.interface.scene_check import Checked, expected
from radiosity_addon.blender.reading.inspection import inspect, subject_of
from tests.blender.built import add_lamp, add_mesh
from tests.blender.materials import shader


def findings() -> set[tuple[str, str]]:
    found = inspect(bpy.context.scene, bpy.context.scene.radiosity.bake_settings()).findings
    return {(each.severity, each.subject) for each in found}


def test_each_thing_that_is_wrong_is_named_with_its_object() -> None:
    add_mesh("Floor")
    add_mesh("Hidden", hide_render=True)
    add_mesh("Flat", scale=(1, 1, 0))
    add_mesh("Left Out").radiosity.exclude = True
    assert findings() == {
        ("warning", ""),  # no light
        ("info", "Hidden"),
        ("warning", "Flat"),
        ("info", "Left Out"),
        ("info", ""),  # not saved
    }


def test_a_sound_saved_scene_has_nothing_to_say(tmp_path: Path) -> None:
    add_mesh("Floor")
    add_lamp("POINT")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    assert findings() == set()


def test_what_stops_a_bake_is_found_and_not_raised() -> None:
    add_mesh("Floor").radiosity.uv_map = "gone"
    (first, *_) = inspect(bpy.context.scene, bpy.context.scene.radiosity.bake_settings()).findings
    assert (first.severity, first.subject) == ("error", "Floor")
    assert bpy.ops.radiosity.check() == {"FINISHED"}
    assert Checked.of(bpy.context.scene).area is None


def test_all_that_stops_a_bake_is_listed_at_once() -> None:
    add_mesh("Floor").radiosity.uv_map = "gone"
    add_mesh("Far", location=(1e16, 0, 0))
    add_mesh("Wall").radiosity.uv_map = "gone"
    add_mesh("Sound")
    errors = {subject for severity, subject in findings() if severity == "error"}
    assert errors == {"Floor", "Far", "Wall"}
    with pytest.raises(RuntimeError, match="2 more stop the bake: Check Scene lists them"):
        bpy.ops.radiosity.bake()


def test_the_command_line_says_the_same() -> None:
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.data.flip_normals()
    add_mesh("Ground", scale=(100, 100, 1))
    add_mesh("Hidden", hide_render=True)
    told = info(Verb(name="info", scene=Path("room.blend")))
    for finding in inspect(bpy.context.scene, bpy.context.scene.radiosity.bake_settings()).findings:
        if finding.subject != "Hidden" and "not saved" not in finding.text:
            assert finding.text in told
    assert "Hidden: it is hidden in renders" in told
    assert told.count("Cube: its faces point away") == told.count("Ground reaches far") == 1


def test_the_gravest_comes_first() -> None:
    add_mesh("Floor")
    add_mesh("Hidden", hide_render=True)
    severities = [
        each.severity for each in inspect(bpy.context.scene, bpy.context.scene.radiosity.bake_settings()).findings
    ]
    assert severities == sorted(severities, key=("error", "warning", "info").index)


def test_a_check_tells_the_area_and_what_a_density_takes() -> None:
    add_mesh("Floor").radiosity.density = 2.0
    settings = bpy.context.scene.radiosity
    settings.density_enabled, settings.density, settings.page_size = True, 10.0, 64
    bpy.ops.radiosity.check()
    assert Checked.of(bpy.context.scene).area == pytest.approx(4 * 2**2)
    assert expected(bpy.context.scene).texels == 1600
    settings.density = 20.0
    assert expected(bpy.context.scene).texels == 6400, "without another check"
    assert Checked.is_stale(bpy.context.scene)


def test_a_check_knows_of_what_shines_and_that_it_takes_longer() -> None:
    add_mesh("Floor")
    before = expected(bpy.context.scene).seconds
    add_mesh("Sign").data.materials.append(shader("Glow", "ShaderNodeEmission", Strength=1.0))
    bpy.ops.radiosity.check()
    assert Checked.of(bpy.context.scene).shining == 2
    assert expected(bpy.context.scene).seconds > before


def test_moving_an_object_makes_a_check_stale_and_a_new_one_does_not_stay_so() -> None:
    floor = add_mesh("Floor")
    bpy.ops.radiosity.check()
    assert not Checked.is_stale(bpy.context.scene)
    floor.location.x = 1
    bpy.context.view_layer.update()
    assert Checked.is_stale(bpy.context.scene)
    bpy.ops.radiosity.check()
    assert not Checked.is_stale(bpy.context.scene)


def test_a_check_stays_true_while_bakes_come_and_go() -> None:
    add_mesh("Floor")
    add_lamp("POINT")
    settings = bpy.context.scene.radiosity
    settings.page_size, settings.quality = 32, "draft"
    bpy.ops.radiosity.check()
    for operator in ("bake", "toggle", "toggle", "bake", "revert"):
        assert getattr(bpy.ops.radiosity, operator)() == {"FINISHED"}
        bpy.context.view_layer.update()
        assert not Checked.is_stale(bpy.context.scene), operator


def test_another_file_knows_nothing_of_the_check() -> None:
    add_mesh("Floor")
    bpy.ops.radiosity.check()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert not Checked.found


def test_flipping_mends_what_is_inside_out_and_takes_it_off_the_list() -> None:
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    cube.data.flip_normals()
    bpy.ops.radiosity.check()
    assert [each.inside_out for each in Checked.of(bpy.context.scene).findings].count(True) == 1
    assert bpy.ops.radiosity.flip(name=cube.name) == {"FINISHED"}
    assert not any(each.inside_out for each in Checked.of(bpy.context.scene).findings)
    assert ("warning", cube.name) not in findings()


def test_selecting_makes_an_object_the_only_one_selected_and_active() -> None:
    floor, other = add_mesh("Floor"), add_mesh("Other")
    other.select_set(True)
    assert bpy.ops.radiosity.select(name="Floor") == {"FINISHED"}
    assert bpy.context.selected_objects == [floor]
    assert bpy.context.object == floor


@pytest.mark.parametrize(
    ("text", "subject"),
    [
        ("Wall: 3 triangles without area are left out", "Wall"),
        ("Wall.001 is left out: it has no faces", "Wall.001"),
        ("Lamp 'Key': its nodes are not read", "Key"),
        ("World 'Wall': its nodes are not read", ""),
        ("Wallpaper: something", ""),
        ("There is no light in the scene", ""),
    ],
)
def test_the_object_that_a_warning_names_is_found(text: str, subject: str) -> None:
    assert subject_of(text, ["Wall", "Wall.001", "Key"]) == subject
