# SPDX-License-Identifier: GPL-3.0-or-later
from __future__ import annotations

import bpy
import pytest

from radiosity_addon.blender.data.names import BAKE_KEY, UV_MAP, is_baked, is_preview, is_stand_in
from radiosity_addon.blender.writing.revert import revert
from tests.blender.baked import bake, quad
from tests.blender.datablocks import differences, snapshot
from tests.blender.materials import diffuse, shader


def furnished() -> list[bpy.types.Object]:
    """A scene with every kind of thing that a bake changes."""
    white, cloth = diffuse("White", 0.8), shader("Cloth", "ShaderNodeBsdfPrincipled", Alpha=0.5)
    wall = quad("Wall", white, uv_maps=2)
    wall.data.uv_layers.active_index = 1
    wall.data.materials.append(None)
    wall.material_slots[0].link = "OBJECT"
    wall.material_slots[0].material = cloth
    bare = quad("Bare", uv_maps=0)
    sofa = quad("Sofa", cloth)
    sofa.modifiers.new("Subdivision", "SUBSURF").render_levels = 1
    sofa.parent = wall
    cushion = quad("Cushion", cloth)
    cushion.parent = sofa
    twins = [quad("Twin", white)]
    twins.append(bpy.data.objects.new("Other Twin", twins[0].data))
    shelf = bpy.data.collections.new("Shelf")
    bpy.context.scene.collection.children.link(shelf)
    shelf.objects.link(twins[1])
    group = bpy.data.node_groups.new("Paint", "ShaderNodeTree")
    group.interface.new_socket("Surface", in_out="OUTPUT", socket_type="NodeSocketShader")
    paint, end = group.nodes.new("ShaderNodeBsdfDiffuse"), group.nodes.new("NodeGroupOutput")
    group.links.new(paint.outputs[0], end.inputs[0])
    painted = shader("Painted", "ShaderNodeBsdfDiffuse")
    tree = painted.node_tree
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    sphere = quad("Sphere", painted)
    sofa.select_set(True)
    bpy.context.view_layer.objects.active = sofa
    cushion.hide_set(True)
    bpy.context.view_layer.update()
    return [wall, bare, sofa, cushion, *twins, sphere]


PAGES = {"Wall": 0, "Bare": 1, "Sofa": 1}


@pytest.mark.parametrize("mode", ["preview", "uv"])
def test_revert_brings_back_every_datablock_exactly(tmp_path, mode):
    things = furnished()
    before = snapshot()
    bake(things, tmp_path, mode=mode, pages=PAGES)
    assert differences(before, snapshot())
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []


@pytest.mark.parametrize("modes", [("preview", "preview"), ("preview", "uv"), ("uv", "preview")])
def test_revert_after_two_bakes_brings_back_the_first_state(tmp_path, modes):
    things = furnished()
    before = snapshot()
    for mode in modes:
        bake(things, tmp_path, mode=mode, pages=PAGES)
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []


def test_revert_after_saving_and_reading_the_file_brings_back_every_datablock_exactly(tmp_path):
    things = furnished()
    path = str(tmp_path / "room.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    before = snapshot()
    bake([bpy.data.objects[name] for name in before_names(before)], tmp_path, pages=PAGES)
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert is_baked(bpy.context.scene)
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []
    assert len(things) == len(before_names(before))


def before_names(taken: dict) -> list[str]:
    return [key.partition("/")[2] for key in taken if key.startswith("objects/")]


def test_revert_of_a_scene_that_was_not_baked_changes_nothing():
    furnished()
    before = snapshot()
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []


def test_faces_of_a_mesh_without_slots_keep_their_material_index(tmp_path):
    wall = quad("Wall")
    wall.data.polygons[0].material_index = 3
    bake([wall], tmp_path)
    revert(bpy.context.scene)
    assert wall.data.polygons[0].material_index == 3


def test_revert_finds_what_was_renamed(tmp_path):
    things = furnished()
    bake(things, tmp_path, pages=PAGES)
    for kind in (bpy.data.objects, bpy.data.materials, bpy.data.images, bpy.data.meshes, bpy.data.node_groups):
        for datablock in kind:
            datablock.name = "Renamed"
    bpy.context.scene.name = "Renamed"
    counts = (len(things), 3)
    revert(bpy.context.scene)
    assert (len(bpy.data.objects), len(bpy.data.materials)) == counts
    assert not bpy.data.images
    assert len(bpy.data.node_groups) == 1
    assert not any(UV_MAP in mesh.uv_layers for mesh in bpy.data.meshes)
    assert not any(thing.hide_render for thing in bpy.data.objects)


def test_revert_goes_on_where_things_were_deleted(tmp_path):
    things = furnished()
    bake(things, tmp_path, pages=PAGES)
    bpy.data.objects.remove(bpy.data.objects["Sofa"])
    bpy.data.objects.remove(bpy.data.objects["Other Twin (Radiosity)"])
    bpy.data.materials.remove(bpy.data.materials["White"])
    bpy.data.images.remove(bpy.data.images["Radiosity 2"])
    layers = bpy.data.objects["Wall"].data.uv_layers
    layers.remove(layers[UV_MAP])
    revert(bpy.context.scene)
    assert not is_baked(bpy.context.scene)
    assert not bpy.data.images
    assert "Sofa (Radiosity)" not in bpy.data.objects
    assert not bpy.data.objects["Other Twin"].hide_render
    assert sorted(material.name for material in bpy.data.materials) == ["Cloth", "Painted"]
    assert bpy.data.objects["Twin"].material_slots[0].material is None


def test_revert_also_cleans_copies_that_the_user_made(tmp_path):
    wall = quad("Wall", diffuse("White", 0.8))
    bake([wall], tmp_path)
    copy = wall.copy()
    copy.data = wall.data.copy()
    bpy.context.scene.collection.objects.link(copy)
    revert(bpy.context.scene)
    assert copy.material_slots[0].material.name == "White"
    assert UV_MAP not in copy.data.uv_layers


def test_revert_keeps_what_the_user_did_since(tmp_path):
    wall = quad("Wall", diffuse("White", 0.8), uv_maps=2)
    bake([wall], tmp_path)
    wall.location.x = 3
    wall.data.uv_layers.active_index = 1
    wall.data.materials.append(diffuse("Red", 0.2))
    revert(bpy.context.scene)
    assert wall.location.x == 3
    assert wall.data.uv_layers.active_index == 1
    assert [slot.material.name for slot in wall.material_slots] == ["White", "Red"]


def test_a_map_that_the_user_made_active_gives_way_to_the_one_before(tmp_path):
    wall = quad("Wall", uv_maps=3)
    layers = wall.data.uv_layers
    layers.active_index, layers[2].active_render = 1, True
    bake([wall], tmp_path)
    layers = wall.data.uv_layers
    layers.active = layers[UV_MAP]
    layers[UV_MAP].active_render = True
    revert(bpy.context.scene)
    layers = wall.data.uv_layers
    assert layers.active.name == "Map 1"
    assert [layer.name for layer in layers if layer.active_render] == ["Map 2"]


def test_another_scenes_bake_stays(tmp_path):
    wall = quad("Wall", diffuse("White", 0.8))
    bake([wall], tmp_path)
    other = bpy.data.scenes.new("Other")
    first = bpy.context.scene
    bpy.context.window.scene = other
    floor = quad("Floor", diffuse("Grey", 0.4))
    bake([floor], tmp_path)
    revert(other)
    assert is_baked(first)
    assert UV_MAP in wall.data.uv_layers
    assert wall.material_slots[0].material.name == "White (Radiosity 1)"
    assert floor.material_slots[0].material.name == "Grey"


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_what_two_baked_scenes_share_is_seen_until_both_are_reverted_and_then_as_before(tmp_path, order):
    sofa = quad("Sofa", diffuse("White", 0.8))
    sofa.modifiers.new("Subdivision", "SUBSURF").render_levels = 1
    scenes = [bpy.context.scene, bpy.data.scenes.new("Other")]
    scenes[1].collection.objects.link(sofa)
    before = snapshot()
    for scene in scenes:
        bpy.context.window.scene = scene
        bake([sofa], tmp_path)
    stand_ins = [thing for thing in bpy.data.objects if is_stand_in(thing)]
    assert [thing.hide_render for thing in stand_ins] == [False, False]
    revert(scenes[order[0]])
    assert sofa.hide_render
    revert(scenes[order[1]])
    bpy.context.window.scene = scenes[0]
    assert differences(before, snapshot()) == []


@pytest.mark.parametrize("again", [False, True])
def test_what_was_joined_with_a_baked_mesh_is_baked_and_cleaned_with_it(tmp_path, again):
    wall, shelf = quad("Wall", diffuse("White", 0.8)), quad("Shelf", diffuse("Grey", 0.4))
    bake([wall], tmp_path)
    wall.select_set(True)
    shelf.select_set(True)
    bpy.context.view_layer.objects.active = shelf
    bpy.ops.object.join()
    assert UV_MAP in shelf.data.uv_layers
    if again:
        bake([shelf], tmp_path)
    revert(bpy.context.scene)
    assert [layer.name for layer in shelf.data.uv_layers] == ["Map 0"]
    assert [slot.material.name for slot in shelf.material_slots] == ["Grey", "White"]
    assert sorted(material.name for material in bpy.data.materials) == ["Grey", "White"]
    assert not list(shelf.data.keys())


def test_the_bake_that_appended_objects_bring_along_gives_way_to_the_scenes_own(tmp_path):
    cloth = diffuse("Cloth", 0.8)
    sofa = quad("Sofa", cloth)
    sofa.modifiers.new("Subdivision", "SUBSURF").render_levels = 1
    bake([sofa, quad("Wall", cloth)], tmp_path)
    library = str(tmp_path / "library.blend")
    bpy.ops.wm.save_as_mainfile(filepath=library)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(library) as (_, wanted):
        wanted.objects = ["Sofa", "Sofa (Radiosity)", "Wall"]
    for thing in wanted.objects:
        bpy.context.scene.collection.objects.link(thing)
    bake([bpy.data.objects["Sofa"], bpy.data.objects["Wall"]], tmp_path)
    assert sorted(bpy.data.objects.keys()) == ["Sofa", "Sofa (Radiosity)", "Wall"]
    assert len(bpy.data.images) == 1
    revert(bpy.context.scene)
    assert {thing.name: thing.hide_render for thing in bpy.data.objects} == {"Sofa": False, "Wall": False}
    assert list(bpy.data.materials.keys()) == ["Cloth"]
    assert not bpy.data.images


@pytest.mark.parametrize("again", [False, True])
def test_a_full_copy_of_a_baked_scene_is_reverted_and_baked_without_the_other(tmp_path, again):
    bake(furnished(), tmp_path, pages=PAGES)
    day, before = bpy.context.scene, snapshot()
    bpy.ops.scene.new(type="FULL_COPY")
    night = bpy.context.scene
    copies = [thing for thing in night.objects if not is_stand_in(thing)]
    if again:
        bake(copies, tmp_path)
        assert night[BAKE_KEY] != day[BAKE_KEY]
        assert all(image[BAKE_KEY] in (day[BAKE_KEY], night[BAKE_KEY]) for image in bpy.data.images)
        assert sum(image[BAKE_KEY] == night[BAKE_KEY] for image in bpy.data.images) == 1
    revert(night)
    assert not is_baked(night)
    assert len(night.objects) == len(copies)
    assert not any(thing.hide_render or UV_MAP in thing.data.uv_layers for thing in night.objects)
    assert not any(is_preview(slot.material) for thing in night.objects for slot in thing.material_slots)
    bpy.data.batch_remove([*night.objects, *(thing.data for thing in night.objects)])
    for group in night.collection.children_recursive:
        bpy.data.collections.remove(group)
    bpy.context.window.scene = day
    bpy.data.scenes.remove(night)
    after = snapshot()
    assert [text for text in differences(before, after) if "/users" not in text and "is new" not in text] == []
