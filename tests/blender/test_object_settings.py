# SPDX-License-Identifier: GPL-3.0-or-later
from __future__ import annotations

import bpy
import pytest

from radiosity_addon.blender.interface.object_settings import SETTINGS, differing
from tests.blender.built import add_lamp, add_mesh, extract


@pytest.fixture
def three() -> list[bpy.types.Object]:
    """Three selected meshes, the first active, and a lamp selected with them."""
    things = [add_mesh(name, location=(x, 0, 0)) for x, name in enumerate("ABC")]
    for thing in (*things, add_lamp("POINT")):
        thing.select_set(True)
    bpy.context.view_layer.objects.active = things[0]
    return things


def test_one_setting_is_copied_to_all_selected_objects(three: list[bpy.types.Object]) -> None:
    a, b, c = three
    a.radiosity.density, a.radiosity.page_group = 3.0, "hero"
    c.radiosity.exclude = True
    assert bpy.ops.radiosity.copy_settings(name="density") == {"FINISHED"}
    assert [thing.radiosity.density for thing in three] == [3.0, 3.0, 3.0]
    assert (b.radiosity.page_group, c.radiosity.exclude) == ("", True), "the others stay"


def test_all_settings_are_copied_without_a_name(three: list[bpy.types.Object]) -> None:
    a = three[0].radiosity
    a.exclude, a.only_casts, a.density, a.two_sided, a.uv_map = True, True, 0.5, True, "Mine"
    a.page_group, a.tube_radius = "props", 0.25
    assert bpy.ops.radiosity.copy_settings() == {"FINISHED"}
    for other in three[1:]:
        assert [getattr(other.radiosity, name) for name in SETTINGS] == [getattr(a, name) for name in SETTINGS]


def test_what_is_not_selected_stays(three: list[bpy.types.Object]) -> None:
    three[2].select_set(False)
    three[0].radiosity.density = 2.0
    bpy.ops.radiosity.copy_settings(name="density")
    assert [thing.radiosity.density for thing in three] == [2.0, 2.0, 1.0]


def test_selected_objects_that_differ_are_counted_by_setting(three: list[bpy.types.Object]) -> None:
    _, b, c = three
    assert not any(differing(bpy.context).values())
    b.radiosity.density, c.radiosity.exclude = 2.0, True
    assert differing(bpy.context)[""] == [b, c]
    assert differing(bpy.context)["density"] == [b]


def test_an_unknown_setting_is_refused(three: list[bpy.types.Object]) -> None:
    with pytest.raises(RuntimeError, match="no setting named 'size'"):
        bpy.ops.radiosity.copy_settings(name="size")


def test_instances_of_one_mesh_in_different_page_groups_have_layouts_of_their_own() -> None:
    first = add_mesh("First")
    for x, group in enumerate(("", "hero", "hero"), 1):
        twin = bpy.data.objects.new(f"Twin {x}", first.data)
        twin.location.x, twin.radiosity.page_group = 3.0 * x, group
        bpy.context.scene.collection.objects.link(twin)
    meshes = {mesh.name: mesh for mesh in extract().scene.meshes}
    assert [meshes[name].page_group for name in ("First", "Twin 1", "Twin 2")] == ["", "", "hero"]
    assert meshes["First"].shape == meshes["Twin 1"].shape
    assert meshes["Twin 2"].shape == meshes["Twin 3"].shape != meshes["First"].shape
