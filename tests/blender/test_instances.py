# SPDX-License-Identifier: GPL-3.0-or-later
"""Instances, and objects that share a mesh: each has its own light, nothing is made single-user."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from radiosity_addon.blender.data.names import PLACE_KEY, UV_MAP, is_preview, is_stand_in
from radiosity_addon.blender.writing.revert import revert
from radiosity_addon.errors import SceneError
from tests.blender.datablocks import differences, snapshot
from tests.blender.instance_bakes import picture, pixels_of
from tests.blender.instanced import (
    KINDS,
    SPOTS,
    add,
    bake,
    collections,
    holder,
    library,
    light,
    nodes,
    objects,
    particles,
    singles,
    stage,
    wedge,
)
from tests.blender.materials import diffuse

ROOT = Path(__file__).parents[2]


kinds = pytest.mark.parametrize("kind", KINDS)


NOISE = 0.03
"""Two unwraps of one scene differ by this, relative to the mean, in the root mean square."""


@kinds
def test_the_light_is_that_of_objects_of_their_own(kind):
    stage()
    KINDS[kind]()
    bpy.context.view_layer.update()
    alone = singles()
    where, found = light(bake(page_size=256))
    bpy.context.window.scene = alone
    where_alone, expected = light(bake(alone, page_size=256))
    apart = np.linalg.norm(where[:, None] - where_alone[None], axis=2)
    match = apart.argmin(axis=1)
    assert sorted(match) == list(range(len(where_alone)))
    assert apart.min(axis=1).max() < 1e-5
    error = (found - expected[match]) / expected.mean()
    assert np.sqrt((error**2).mean()) < NOISE
    assert found.std() > found.mean(), "the light should differ much from instance to instance"


@kinds
def test_revert_brings_back_every_datablock_exactly(kind):
    stage()
    KINDS[kind]()
    before = snapshot()
    bake()
    assert differences(before, snapshot())
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []


@pytest.mark.parametrize("modes", [("preview", "preview"), ("preview", "uv"), ("uv", "preview")])
def test_revert_after_two_bakes_brings_back_the_first_state(modes):
    stage()
    for make in (collections, objects, particles):
        make()
    before = snapshot()
    for mode in modes:
        bake(mode=mode, page_size=128)
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []


def test_revert_after_saving_and_reading_the_file_brings_back_every_datablock_exactly(tmp_path):
    stage()
    for make in (collections, objects, nodes, particles):
        make()
    path = str(tmp_path / "room.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    before = snapshot()
    bake(page_size=128)
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []


@pytest.mark.parametrize("kind", ["collections", "nested", "objects"])
def test_cycles_shows_each_its_own_light(kind, tmp_path):
    stage()
    KINDS[kind]()
    bpy.context.view_layer.update()
    alone = singles()
    bake(page_size=512)
    found = picture(tmp_path)
    bpy.context.window.scene = alone
    bake(alone, page_size=512)
    expected = picture(tmp_path)
    assert expected.std() > expected.mean() / 2
    assert np.abs(found - expected).mean() < 0.01 * expected.mean()


def show_places() -> None:
    """Let the preview materials emit where on the page they look, in place of the light there."""
    for material in filter(is_preview, bpy.data.materials):
        nodes = material.node_tree.nodes
        look = next(node for node in nodes if node.type == "TEX_IMAGE").inputs["Vector"].links[0].from_socket
        emission = next(node for node in nodes if node.type == "EMISSION")
        material.node_tree.links.new(look, emission.inputs["Color"])


EEVEE_SCENE = """
import sys
from pathlib import Path
import bpy
from radiosity_addon import blender
from tests.blender.instanced import bake, collections, stage
from tests.blender.test_instances import picture, show_places
blender.register()
bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
stage()
collections()
bake()
show_places()
picture(Path(sys.argv[1]), "BLENDER_EEVEE_NEXT" if bpy.app.version < (5, 0) else "BLENDER_EEVEE")
"""


@pytest.mark.slow
def test_eevee_looks_at_the_same_places(tmp_path):
    """In a process of its own: without OpenGL Blender ends it. Places, not light: software OpenGL does not know the
    slope of an object's property at the rim of a face, and takes a wrong mip level there."""
    subprocess.run([sys.executable, "-c", EEVEE_SCENE, str(tmp_path)], cwd=ROOT, timeout=300, check=False)
    if not (tmp_path / "picture.exr").exists():
        pytest.skip("Eevee needs OpenGL, which this machine does not offer to a program without a screen")
    found = pixels_of(tmp_path / "picture.exr")
    stage()
    collections()
    bake()
    show_places()
    expected = picture(tmp_path)
    assert np.abs(found - expected).mean() < 0.02 * expected.mean()
    assert np.median(np.abs(found - expected)) < 2e-3


def test_an_instancer_is_hidden_and_its_stand_ins_are_in_a_collection_of_its_name():
    stage()
    collections()
    report = bake()
    instancer, group = bpy.data.objects["Holder 0"], bpy.data.collections["Holder 0 (Radiosity)"]
    assert instancer.hide_render
    assert instancer.hide_viewport
    assert [thing.name for thing in group.objects] == ["Holder 0 Instances (Radiosity)", "Wedge (Radiosity)"]
    assert group.name in bpy.context.scene.collection.children
    stand_ins = [bpy.data.objects[row.object] for row in report.objects if row.instancer]
    assert len({stand_in.data for stand_in in stand_ins}) == 1
    assert report.skipped == ()
    assert not report.warnings
    rows = {row.instancer: row for row in report.objects}
    assert rows["Holder 1"].source == "Wedge"
    assert rows["Holder 1"].index == (0,)
    np.testing.assert_allclose(rows["Holder 1"].matrix, bpy.data.objects["Holder 1"].matrix_world, atol=1e-6)


def test_stand_ins_follow_what_made_the_instances():
    stage()
    collections()
    bake()
    instancer, stand_in = bpy.data.objects["Holder 2"], bpy.data.objects["Wedge (Radiosity).002"]
    instancer.location.z += 2
    bpy.context.view_layer.update()
    np.testing.assert_allclose(stand_in.matrix_world, instancer.matrix_world, atol=1e-6)


def test_objects_that_share_a_mesh_go_on_sharing_it():
    stage()
    objects()
    report = bake(page_size=128)
    first, second = bpy.data.objects["Wedge"], bpy.data.objects["Second"]
    assert first.data == second.data
    assert UV_MAP in first.data.uv_layers
    assert [slot.link for slot in first.material_slots] == ["OBJECT", "OBJECT"]
    assert all(is_preview(slot.material) for slot in second.material_slots)
    assert not any(is_preview(material) for material in first.data.materials)
    rows = {row.source: row for row in report.objects}
    for thing in (first, second):
        row = rows[thing.name]
        assert row.object == thing.name
        np.testing.assert_allclose(thing[PLACE_KEY], [row.uv_scale[0], *row.uv_offset])
    assert rows["Third"].object == "Third (Radiosity)", "stretched six times, it needs an unwrap of its own"


def test_what_slots_of_objects_held_beside_the_meshs_materials_comes_back():
    """A slot that is linked to the mesh remembers the object's own material."""
    stage()
    objects()
    thing, kept = bpy.data.objects["Wedge"], diffuse("Kept", 0.2)
    thing.material_slots[0].link, thing.material_slots[0].material = "OBJECT", kept
    thing.material_slots[0].link = "DATA"
    bake()
    revert(bpy.context.scene)
    assert thing.material_slots[0].link == "DATA"
    thing.material_slots[0].link = "OBJECT"
    assert thing.material_slots[0].material == kept


def test_a_material_that_the_user_gave_a_slot_since_stays_there():
    stage()
    objects()
    bake()
    thing, new = bpy.data.objects["Wedge"], diffuse("New", 0.2)
    thing.material_slots[0].material = new
    revert(bpy.context.scene)
    assert thing.material_slots[0].material == new
    assert thing.material_slots[1].link == "DATA"
    assert thing.material_slots[1].material.name == "Wedge Roof"


def test_uv_maps_without_materials_say_places_in_the_report():
    stage()
    collections()
    report = bake(mode="uv")
    row = next(row for row in report.objects if row.instancer)
    stand_in = bpy.data.objects[row.object]
    assert [slot.material.name for slot in stand_in.material_slots] == ["Wedge Wall", "Wedge Roof"]
    np.testing.assert_allclose(stand_in[PLACE_KEY], [row.uv_scale[0], *row.uv_offset])


def test_what_an_instancer_shows_beside_baked_surfaces_stays_in_sight():
    stage()
    group = library(wedge())
    bulb = add(bpy.data.objects.new("Bulb", bpy.data.lights.new("Bulb", "POINT")), group)
    bulb.location.z = 2
    shade = add(wedge("Shade"), group)
    shade.radiosity.only_casts = True
    holder(group, "Holder", Matrix.Translation((1, 2, 3)))
    before = snapshot()
    report = bake()
    assert sorted(row.source for row in report.objects) == ["Floor", "Wedge"]
    group = bpy.data.collections["Holder (Radiosity)"]
    bpy.context.view_layer.update()
    bulb = next(thing for thing in group.objects if thing.type == "LIGHT")
    assert bulb.matrix_world.translation[:] == (1, 2, 5)
    assert bulb.data == bpy.data.lights["Bulb"]
    shade = group.objects["Shade (Radiosity)"]
    assert [slot.material.name for slot in shade.material_slots] == ["Shade Wall", "Shade Roof"]
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []


def test_instances_of_a_baked_object_that_get_no_light_of_their_own_keep_their_look():
    """They would show the object's place on its page."""
    stage()
    thing = add(wedge())
    holder(library(thing), "Holder", Matrix.Translation((2, 0, 0))).radiosity.only_casts = True
    report = bake()
    assert sorted(row.source for row in report.objects) == ["Floor", "Wedge"]
    stand_in = bpy.data.collections["Holder (Radiosity)"].objects["Wedge (Radiosity)"]
    assert [slot.material.name for slot in stand_in.material_slots] == ["Wedge Wall", "Wedge Roof"]


@pytest.mark.parametrize("setting, expected", [("exclude", 1), ("only_casts", 1)])
def test_an_empty_decides_for_all_that_it_shows(setting, expected):
    stage()
    collections()
    for name in ("Holder 0", "Holder 1"):
        setattr(bpy.data.objects[name].radiosity, setting, True)
    report = bake()
    assert [row.instancer for row in report.objects if row.instancer] == ["Holder 2"]
    assert not bpy.data.objects["Holder 0"].hide_render


def test_an_instancer_can_be_chosen_by_name():
    stage()
    collections()
    report = bake(objects=("Holder 1",))
    assert [row.instancer for row in report.objects] == ["Holder 1"]


def test_an_instancers_own_surface_stays_in_sight_without_a_lightmap():
    stage()
    particles()
    bpy.data.objects["Emitter"].radiosity.only_casts = True
    report = bake()
    assert sorted({row.source for row in report.objects}) == ["Floor", "Wedge"]
    stand_in = bpy.data.objects["Emitter (Radiosity)"]
    assert not stand_in.hide_render
    assert UV_MAP not in stand_in.data.uv_layers
    assert bpy.data.objects["Emitter"].hide_render


def linked(tmp_path: Path, make) -> None:
    """Saves what `make` returns as a library, and opens a file with a floor."""
    path = str(tmp_path / "library.blend")
    name = make().name
    bpy.data.collections[name].use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    stage()
    with bpy.data.libraries.load(path, link=True) as (_, target):
        target.collections = [name]


def test_a_linked_collection_is_baked_where_it_is_instanced(tmp_path):
    linked(tmp_path, lambda: library(wedge()))
    for number, spot in enumerate(SPOTS):
        holder(bpy.data.collections["Library"], f"Holder {number}", Matrix.Translation(spot))
    before = snapshot()
    report = bake()
    assert [row.source for row in report.objects if row.instancer] == ["Wedge"] * 3
    assert bpy.data.objects[report.objects[-1].object].data.library is None
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []


def test_instances_of_what_is_baked_in_its_own_file_are_baked_as_they_look_there(tmp_path):
    """The stand-in of a modified object is then all that is seen of it."""

    def baked() -> bpy.types.Collection:
        stage()
        group = bpy.data.collections.new("Library")
        bpy.context.scene.collection.children.link(group)
        add(wedge(), group).modifiers.new("Bevel", "BEVEL")
        bake()
        return group

    linked(tmp_path, baked)
    holder(bpy.data.collections["Library"], "Holder", Matrix())
    before = snapshot()
    report = bake()
    assert [row.source for row in report.objects] == ["Floor", "Wedge (Radiosity)"]
    shown = bpy.data.objects[report.objects[-1].object]
    assert {slot.material.name for slot in shown.material_slots} == {
        f"Wedge {part} (Radiosity 1)" for part in ("Wall", "Roof")
    }
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []


def test_a_linked_instancer_is_refused_by_name(tmp_path):
    def nested() -> bpy.types.Collection:
        group = bpy.data.collections.new("Holders")
        holder(library(wedge()), "Holder", Matrix(), group)
        return group

    linked(tmp_path, nested)
    bpy.context.scene.collection.children.link(bpy.data.collections["Holders"])
    with pytest.raises(SceneError, match="Holder: it is linked from another file"):
        bake()


def test_another_scenes_bake_of_the_same_mesh_stays():
    """A mesh has one map of ours, and it belongs to the scene that was baked first."""
    stage()
    first = add(wedge())
    bake()
    before = np.array([loop.vector for loop in first.data.uv_layers[UV_MAP].uv])
    other = bpy.data.scenes.new("Other")
    bpy.context.window.scene = other
    other.collection.objects.link(bpy.data.objects["Lamp"])
    second = bpy.data.objects.new("Second", first.data)
    other.collection.objects.link(second)
    report = bake(other)
    assert report.objects[0].object == "Second (Radiosity)"
    assert np.array_equal(before, [loop.vector for loop in first.data.uv_layers[UV_MAP].uv])


def test_modifiers_and_shape_keys_of_what_is_instanced_are_kept_in_shape():
    stage()
    thing = wedge()
    thing.shape_key_add(name="Basis")
    thing.shape_key_add(name="Tall").data[4].co.z = 2
    thing.data.shape_keys.key_blocks["Tall"].value = 1
    thing.modifiers.new("Mirror", "MIRROR")
    holder(library(thing), "Holder", Matrix())
    before = snapshot()
    bake()
    mesh = bpy.data.objects["Wedge (Radiosity)"].data
    assert max(vertex.co.z for vertex in mesh.vertices) == pytest.approx(2)
    assert len(mesh.polygons) == 10
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []


def test_the_eye_that_is_closed_on_an_instancer_is_closed_on_its_stand_ins():
    stage()
    collections()
    bpy.data.objects["Holder 0"].hide_set(True)
    bake()
    group = bpy.data.collections["Holder 0 (Radiosity)"]
    assert all(thing.hide_get() for thing in group.objects if thing.type == "MESH")
    assert not bpy.data.objects["Wedge (Radiosity).001"].hide_get()


def test_rays_that_do_not_see_the_instancer_do_not_see_its_stand_ins():
    stage()
    collections()
    bpy.data.objects["Holder 0"].visible_camera = False
    bake()
    assert not bpy.data.objects["Wedge (Radiosity)"].visible_camera
    assert bpy.data.objects["Wedge (Radiosity).001"].visible_camera


def test_a_bake_that_fails_leaves_no_trace_of_stand_ins(monkeypatch):
    stage()
    collections()
    before = snapshot()
    monkeypatch.setattr("radiosity_addon.blender.writing.write_back.PreviewMaterials.of", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        bake()
    assert differences(before, snapshot()) == []
    assert not any(is_stand_in(thing) for thing in bpy.data.objects)


def test_points_that_only_carry_instances_are_no_reason_to_warn():
    stage()
    nodes()
    report = bake()
    assert report.skipped == ()
    assert not report.warnings
