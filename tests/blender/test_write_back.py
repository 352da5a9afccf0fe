# SPDX-License-Identifier: GPL-3.0-or-later
from __future__ import annotations

import math

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from radiosity_addon.blender.data.names import UV_MAP, is_baked, is_stand_in
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.blender.writing import write_back as module
from radiosity_addon.blender.writing.revert import revert
from radiosity_addon.blender.writing.write_back import write_back
from radiosity_addon.chunks import finish
from radiosity_addon.errors import OutputError, SceneError
from tests.blender.baked import atlas_for, bake, extract, page_file, quad
from tests.blender.datablocks import differences, snapshot
from tests.blender.materials import diffuse


def uv_of(mesh: bpy.types.Mesh, name: str = UV_MAP) -> np.ndarray:
    uv = np.empty(len(mesh.loops) * 2, np.float32)
    mesh.uv_layers[name].uv.foreach_get("vector", uv)
    return uv.reshape(-1, 2)


def curve(name: str) -> bpy.types.Object:
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions = "3D"
    spline = data.splines.new("POLY")
    spline.points.add(1)
    spline.points[1].co = (1, 2, 3, 1)
    data.bevel_depth = 0.2
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def test_the_uv_map_holds_the_atlas_at_each_loop(tmp_path):
    wall = quad("Wall")
    bake([wall], tmp_path)
    expected = np.arange(4) / 4
    np.testing.assert_allclose(uv_of(wall.data), np.stack([expected, 1 - expected], axis=1), atol=1e-6)


def test_the_users_active_and_rendered_uv_maps_stay_so(tmp_path):
    wall = quad("Wall", uv_maps=3)
    wall.data.uv_layers.active_index = 1
    wall.data.uv_layers[2].active_render = True
    bake([wall], tmp_path)
    layers = wall.data.uv_layers
    assert [layer.name for layer in layers] == ["Map 0", "Map 1", "Map 2", UV_MAP]
    assert layers.active.name == "Map 1"
    assert [layer.name for layer in layers if layer.active_render] == ["Map 2"]


def test_rows_name_source_object_page_and_density_in_order(tmp_path):
    wall, sofa = quad("Wall"), quad("Sofa")
    sofa.modifiers.new("Subdivision", "SUBSURF")
    objects, pages = bake([wall, sofa], tmp_path, pages={"Wall": 1, "Sofa": 0})
    assert objects == [
        {"source": "Wall", "object": "Wall", "page": 1, "density": 64.0},
        {"source": "Sofa", "object": "Sofa (Radiosity)", "page": 0, "density": 64.0},
    ]
    assert pages == [
        {"image": "Radiosity 1", "file": str(tmp_path / "radiosity_1.exr"), "size": [8, 8]},
        {"image": "Radiosity 2", "file": str(tmp_path / "radiosity_2.exr"), "size": [8, 8]},
    ]


def test_an_object_without_a_page_is_left_alone(tmp_path):
    wall, probe = quad("Wall"), quad("Probe", diffuse("White", 0.8))
    objects, _ = bake([wall, probe], tmp_path, pages={"Probe": -1})
    assert [row["source"] for row in objects] == ["Wall"]
    assert UV_MAP not in probe.data.uv_layers
    assert probe.material_slots[0].material.name == "White"


def test_a_modified_mesh_is_shown_by_its_evaluated_mesh_at_render_settings(tmp_path):
    sofa = quad("Sofa", diffuse("Cloth", 0.3))
    subdivision = sofa.modifiers.new("Subdivision", "SUBSURF")
    subdivision.levels, subdivision.render_levels = 1, 3
    bake([sofa], tmp_path, mode="uv")
    stand_in = bpy.data.objects["Sofa (Radiosity)"]
    assert len(stand_in.data.polygons) == 64
    assert not stand_in.modifiers
    assert [slot.material.name for slot in stand_in.material_slots] == ["Cloth"]
    assert [layer.name for layer in stand_in.data.uv_layers] == ["Map 0", UV_MAP]
    assert sofa.hide_render
    assert sofa.hide_viewport
    assert UV_MAP not in sofa.data.uv_layers
    assert stand_in.visible_get()


def test_a_curve_is_shown_by_a_mesh_that_carries_the_uv_map(tmp_path):
    bake([curve("Cable")], tmp_path)
    stand_in = bpy.data.objects["Cable (Radiosity)"]
    assert stand_in.type == "MESH"
    assert len(uv_of(stand_in.data)) == len(stand_in.data.loops) > 0


def test_objects_that_share_a_mesh_but_no_unwrap_get_a_stand_in_for_all_but_one(tmp_path):
    first = quad("First")
    second = bpy.data.objects.new("Second", first.data)
    bpy.context.scene.collection.objects.link(second)
    objects, _ = bake([first, second], tmp_path)
    assert [row["object"] for row in objects] == ["First", "Second (Radiosity)"]
    assert second.hide_render


def test_the_faces_of_a_stand_in_have_their_own_materials(tmp_path):
    """Blender sets them all to the first where a mesh's slots are cleared."""
    pair = quad("Pair", diffuse("White", 0.8))
    pair.data.materials.append(diffuse("Black", 0.1))
    pair.data.polygons[0].material_index = 1
    pair.modifiers.new("Array", "ARRAY")
    bake([pair], tmp_path)
    stand_in = bpy.data.objects["Pair (Radiosity)"]
    assert [polygon.material_index for polygon in stand_in.data.polygons] == [1, 1]
    assert [slot.material.name for slot in stand_in.material_slots] == ["White (Radiosity 1)", "Black (Radiosity 1)"]


def test_a_stand_in_has_the_originals_sheared_world_matrix_and_collections(tmp_path):
    parent, sofa = quad("Parent"), quad("Sofa")
    parent.scale, sofa.rotation_euler = (1, 3, -0.5), (0.3, 0.4, 0.5)
    sofa.parent = parent
    sofa.modifiers.new("Subdivision", "SUBSURF")
    shelf = bpy.data.collections.new("Shelf")
    bpy.context.scene.collection.children.link(shelf)
    shelf.objects.link(sofa)
    bake([sofa], tmp_path)
    bpy.context.view_layer.update()
    stand_in = bpy.data.objects["Sofa (Radiosity)"]
    expected = Matrix.Diagonal((1, 3, -0.5, 1)) @ sofa.rotation_euler.to_matrix().to_4x4()
    np.testing.assert_allclose(stand_in.matrix_world, expected, atol=1e-6)
    assert set(stand_in.users_collection) == {shelf, bpy.context.scene.collection}
    assert stand_in.name in bpy.context.view_layer.objects


def test_a_stand_in_is_seen_by_the_same_rays(tmp_path):
    glass = quad("Glass")
    glass.modifiers.new("Subdivision", "SUBSURF")
    glass.visible_shadow, glass.visible_camera, glass["tint"] = False, False, 0.25
    bake([glass], tmp_path)
    stand_in = bpy.data.objects["Glass (Radiosity)"]
    assert (stand_in.visible_shadow, stand_in.visible_camera, stand_in.visible_diffuse) == (False, False, True)
    assert stand_in["tint"] == 0.25
    assert not stand_in.hide_render


def test_a_stand_in_has_the_originals_generated_coordinates(tmp_path):
    sofa = quad("Sofa")
    sofa.data.use_auto_texspace = False
    sofa.data.texspace_location = (1, 2, 3)
    sofa.modifiers.new("Subdivision", "SUBSURF")
    bake([sofa], tmp_path)
    assert bpy.data.objects["Sofa (Radiosity)"].data.texspace_location[:] == (1, 2, 3)


@pytest.mark.parametrize("kind", ["CURVE", "SURFACE", "FONT", "META", "MESH"])
def test_what_the_extractor_reads_of_each_kind_fits_its_stand_in(tmp_path, kind):
    thing = curve("Thing") if kind == "CURVE" else quad("Thing")
    if kind == "MESH":
        thing.modifiers.new("Mirror", "MIRROR")
        thing.modifiers.new("Bevel", "BEVEL")
    elif kind != "CURVE":
        bpy.data.objects.remove(thing)
        {
            "SURFACE": bpy.ops.surface.primitive_nurbs_surface_sphere_add,
            "FONT": bpy.ops.object.text_add,
            "META": bpy.ops.object.metaball_add,
        }[kind]()
        thing = bpy.context.object
        thing.name = "Thing"
    extraction = extract_scene(bpy.context.scene)
    finish(write_back(bpy.context.scene, extraction, atlas_for(extraction), [page_file(tmp_path / "page.exr", 1)]))
    mesh = bpy.data.objects["Thing (Radiosity)"].data
    corner = extraction.scene.meshes[0].corner
    vertices = np.array([mesh.vertices[mesh.loops[loop].vertex_index].co for loop in corner.ravel()])
    read = extraction.scene.meshes[0]
    np.testing.assert_allclose(vertices, read.vertices[read.triangles].reshape(-1, 3), atol=1e-5)


def test_a_library_override_gets_a_stand_in_as_its_mesh_can_not_be_edited(tmp_path):
    quad("Wall")
    library = tmp_path / "library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, target):
        target.objects = ["Wall"]
    wall = bpy.data.objects["Wall"].override_create()
    bpy.context.scene.collection.objects.link(wall)
    extraction = extract_scene(bpy.context.scene)
    finish(write_back(bpy.context.scene, extraction, atlas_for(extraction), [page_file(tmp_path / "page.exr", 1)]))
    assert wall.hide_render
    assert UV_MAP in bpy.data.objects["Wall (Radiosity)"].data.uv_layers
    revert(bpy.context.scene)
    assert not wall.hide_render


def test_images_hold_unscaled_data_and_have_users(tmp_path):
    bake([quad("Wall")], tmp_path, value=0.25, mode="uv")
    image = bpy.data.images["Radiosity 1"]
    assert image.colorspace_settings.is_data
    assert image.use_fake_user
    assert image.pixels[0] == pytest.approx(0.25)


def test_images_of_a_saved_file_have_a_relative_path(tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    bake([quad("Wall")], tmp_path)
    image = bpy.data.images["Radiosity 1"]
    assert image.filepath == "//radiosity_1.exr"
    assert image.packed_file is None


def test_images_of_an_unsaved_file_are_packed_and_survive_the_loss_of_the_page(tmp_path):
    bake([quad("Wall")], tmp_path, value=0.25, mode="uv")
    (tmp_path / "radiosity_1.exr").unlink()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "room.blend"))
    assert bpy.data.images["Radiosity 1"].pixels[0] == pytest.approx(0.25)


def test_uv_mode_leaves_materials_alone(tmp_path):
    wall = quad("Wall", diffuse("White", 0.8))
    before = snapshot()
    bake([wall], tmp_path, mode="uv")
    after = snapshot()
    assert [name for name in after if name.startswith("materials/")] == ["materials/White"]
    assert differences(before["materials/White"], after["materials/White"]) == []
    assert wall.material_slots[0].material.name == "White"


def test_a_second_bake_replaces_the_first_without_leftovers(tmp_path):
    wall, sofa = quad("Wall", diffuse("White", 0.8)), quad("Sofa", diffuse("Cloth", 0.3))
    sofa.modifiers.new("Subdivision", "SUBSURF")
    pages = {"Wall": 0, "Sofa": 1}
    bake([wall, sofa], tmp_path, pages=pages)
    once = snapshot()
    bake([wall, sofa], tmp_path, pages=pages)
    twice = snapshot()
    assert sorted(once) == sorted(twice)


def test_a_second_bake_of_fewer_pages_removes_the_rest(tmp_path):
    wall, sofa = quad("Wall"), quad("Sofa")
    bake([wall, sofa], tmp_path, pages={"Sofa": 1})
    bake([wall, sofa], tmp_path)
    assert [image.name for image in bpy.data.images] == ["Radiosity 1"]


def test_a_users_reference_to_a_page_follows_the_second_bake(tmp_path):
    wall = quad("Wall", diffuse("White", 0.8))
    bake([wall], tmp_path, mode="uv")
    node = wall.material_slots[0].material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images["Radiosity 1"]
    bake([wall], tmp_path, value=0.75, mode="uv")
    assert node.image == bpy.data.images["Radiosity 1"]
    assert node.image.pixels[0] == pytest.approx(0.75)


def test_edit_mode_is_left_and_its_changes_count(tmp_path):
    wall = quad("Wall")
    bpy.context.view_layer.objects.active = wall
    wall.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    bake([wall], tmp_path)
    assert wall.mode == "OBJECT"
    assert UV_MAP in wall.data.uv_layers


def refused(things, tmp_path, error=SceneError, **options) -> str:
    """The message of a bake that must fail and leave everything as it was."""
    before = snapshot()
    with pytest.raises(error) as caught:
        bake(things, tmp_path, **options)
    assert differences(before, snapshot()) == []
    assert not is_baked(bpy.context.scene)
    return str(caught.value)


def test_eight_uv_maps_are_refused_by_name(tmp_path):
    message = refused([quad("Floor"), quad("Wall", uv_maps=8)], tmp_path)
    assert "Wall" in message
    assert "8 uv maps" in message


def test_a_users_own_map_of_our_name_is_refused(tmp_path):
    wall = quad("Wall")
    wall.data.uv_layers[0].name = UV_MAP
    assert "Rename" in refused([wall], tmp_path)


def test_a_linked_mesh_is_refused_with_make_local(tmp_path):
    quad("Wall")
    library = tmp_path / "library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, target):
        target.objects = ["Wall"]
    wall = bpy.data.objects["Wall"]
    bpy.context.scene.collection.objects.link(wall)
    assert "local" in refused([wall], tmp_path)


def test_an_object_deleted_during_the_bake_is_an_error_that_names_it(tmp_path):
    wall = quad("Wall")
    extraction = extract([wall])
    bpy.data.objects.remove(wall)
    with pytest.raises(SceneError, match="Wall"):
        finish(write_back(bpy.context.scene, extraction, atlas_for(extraction), [page_file(tmp_path / "p.exr", 1)]))
    assert not bpy.data.images


def test_a_mesh_that_lost_faces_during_the_bake_is_an_error_that_names_it(tmp_path):
    wall = quad("Wall")
    extraction = extract([wall])
    wall.data.clear_geometry()
    with pytest.raises(SceneError, match="Wall"):
        finish(write_back(bpy.context.scene, extraction, atlas_for(extraction), [page_file(tmp_path / "p.exr", 1)]))


@pytest.mark.parametrize("content", [None, b"no picture"])
def test_an_unreadable_page_leaves_the_scene_as_it_was(tmp_path, content):
    wall = quad("Wall")
    extraction = extract([wall])
    page = tmp_path / "page.exr"
    if content is not None:
        page.write_bytes(content)
    before = snapshot()
    with pytest.raises(OutputError, match=r"page\.exr"):
        finish(write_back(bpy.context.scene, extraction, atlas_for(extraction), [page]))
    assert differences(before, snapshot()) == []


@pytest.mark.parametrize("step", ["_make_stand_ins", "swap_in", "_show_preview"])
def test_a_failure_in_any_step_leaves_the_scene_as_it_was(tmp_path, monkeypatch, step):
    wall, sofa = quad("Wall", diffuse("White", 0.8)), quad("Sofa", diffuse("Cloth", 0.3))
    sofa.modifiers.new("Subdivision", "SUBSURF")
    working = getattr(module, step)

    def failing(*arguments):
        working(*arguments)
        raise MemoryError

    monkeypatch.setattr(module, step, failing)
    refused([wall, sofa], tmp_path, MemoryError)


def test_a_failure_before_the_switch_keeps_the_earlier_bake(tmp_path, monkeypatch):
    sofa = quad("Sofa", diffuse("Cloth", 0.3))
    sofa.modifiers.new("Subdivision", "SUBSURF")
    bake([sofa], tmp_path)
    before = snapshot()

    def failing(*arguments):
        raise MemoryError

    monkeypatch.setattr(module, "_write_uv", failing)
    with pytest.raises(MemoryError):
        bake([sofa], tmp_path)
    assert differences(before, snapshot()) == []
    assert any(is_stand_in(thing) for thing in bpy.data.objects)


def test_a_mirrored_object_keeps_its_matrix(tmp_path):
    wall = quad("Wall")
    wall.scale = (-1, 1, 1)
    wall.rotation_euler[2] = math.radians(30)
    bpy.context.view_layer.update()
    before = wall.matrix_world.copy()
    bake([wall], tmp_path)
    bpy.context.view_layer.update()
    np.testing.assert_array_equal(wall.matrix_world, before)
