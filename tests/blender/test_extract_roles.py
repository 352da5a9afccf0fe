# SPDX-License-Identifier: GPL-3.0-or-later
"""What takes part in a bake and how, what is left out, and which scenes are refused, by scenes made with bpy."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.data.names import ORIGINAL_MATERIAL_KEY, PREVIEW_KEY, STAND_IN_KEY
from radiosity_addon.blender.data.stand_in import swap_in
from radiosity_addon.errors import SceneError
from tests.blender.added import add_cube, snapshot
from tests.blender.built import QUAD, add, add_lamp, add_mesh, emission, extract
from tests.blender.materials import bare, diffuse, volume

# what takes part


def test_visibility_is_the_renders():
    add_mesh("seen")
    add_mesh("hidden in renders", hide_render=True)
    add_mesh("hidden in the viewport", hide_viewport=True)
    add_mesh("eye closed").hide_set(True)
    group = bpy.data.collections.new("group")
    bpy.context.scene.collection.children.link(group)
    group.objects.link(bpy.data.objects.new("excluded", bpy.data.meshes["seen"]))
    bpy.context.view_layer.layer_collection.children["group"].exclude = True
    extraction = extract()
    assert {mesh.name for mesh in extraction.scene.meshes} == {"seen", "hidden in the viewport", "eye closed"}
    assert dict(extraction.skipped) == {
        "hidden in renders": "it is hidden in renders",
        "excluded": "it is hidden in renders",
    }


def test_ray_visibility_is_followed_and_what_a_bake_can_not_show_is_said():
    add_mesh("ordinary")
    add_mesh("no bounce").visible_diffuse = False
    add_mesh("no shadow").visible_shadow = False
    add_mesh("catcher").is_shadow_catcher = True
    add_mesh("hole").is_holdout = True
    extraction = extract()
    rays = {mesh.name: (mesh.met, mesh.casts) for mesh in extraction.scene.meshes}
    assert rays["ordinary"] == rays["catcher"] == rays["hole"] == (True, True)
    assert rays["no bounce"] == (False, True)
    assert rays["no shadow"] == (True, False)
    said = [text for text in extraction.warnings if "ordinary surface" in text]
    assert [text.split()[0] for text in said] == ["catcher", "hole"]


def test_what_only_bounds_a_volume_is_left_out_and_its_faces_let_light_pass():
    """Cycles traces on through faces of a volume without a surface; of nothing at all it makes black."""
    fog, plain, nothing = volume("fog", "ShaderNodeVolumePrincipled"), diffuse("plain", 0.5), bare("nothing")
    no_volume = volume("no volume", "ShaderNodeBsdfDiffuse")
    switched_off = volume("switched off", "ShaderNodeVolumeScatter")
    next(node for node in switched_off.node_tree.nodes if node.type == "VOLUME_SCATTER").mute = True
    add_mesh("floor").data.materials.append(plain)
    add_mesh("domain").data.materials.append(fog)
    both = add_mesh("both", faces=[(0, 1, 2), (0, 2, 3)])
    for material in (fog, plain):
        both.data.materials.append(material)
    both.data.polygons[1].material_index = 1
    for material in (nothing, no_volume, switched_off):
        add_mesh(material.name).data.materials.append(material)
    extraction = extract()
    names = [mesh.name for mesh in extraction.scene.meshes]
    assert sorted(names) == ["both", "floor", "no volume", "nothing", "switched off"]
    assert dict(extraction.skipped) == {"domain": "its materials show a volume and no surface"}
    passes = {material.name: material.transmittance for material in extraction.scene.materials}
    assert passes.pop("fog") == (1, 1, 1)
    assert set(passes.values()) == {(0, 0, 0)}


def test_hair_of_particles_is_named_unless_it_shows_objects():
    fur, grass = add_mesh("fur"), add_mesh("grass")
    for thing, shows in ((fur, "PATH"), (grass, "OBJECT")):
        thing.modifiers.new("Strands", "PARTICLE_SYSTEM")
        settings = thing.particle_systems[0].settings
        settings.type, settings.render_type = "HAIR", shows
    assert [text for text in extract().warnings if "hair" in text] == [
        "fur: the hair of 'Strands' is ignored; convert it to hair curves"
    ]


def test_objects_keep_the_terminator_offset_that_they_are_set_to():
    add_mesh("as it comes")
    off, shaded = add_mesh("off"), add_mesh("shaded")
    if bpy.app.version < (4, 3):
        off.cycles.shadow_terminator_geometry_offset, shaded.cycles.shadow_terminator_offset = 0.0, 0.2
    else:
        off.shadow_terminator_geometry_offset, shaded.shadow_terminator_shading_offset = 0.0, 0.2
    extraction = extract()
    found = {mesh.name: round(mesh.terminator, 6) for mesh in extraction.scene.meshes}
    assert found == {"as it comes": 0.1, "off": 0.0, "shaded": 0.1}
    bends = {mesh.name: round(mesh.bend, 6) for mesh in extraction.scene.meshes}
    assert bends == {"as it comes": 1.0, "off": 1.0, "shaded": round(1 / 0.9, 6)}


def test_only_the_chosen_objects_get_lightmaps_and_the_others_still_take_part():
    add_mesh("a")
    add_mesh("b")
    extraction = extract(only=["b"])
    assert {mesh.name: mesh.lightmapped for mesh in extraction.scene.meshes} == {"a": False, "b": True}


def test_instances_are_surfaces_of_one_shape_that_know_what_makes_them():
    group = bpy.data.collections.new("group")
    group.objects.link(bpy.data.objects.new("chair", add_mesh("floor").data))
    for x in (0, 3):
        empty = bpy.data.objects.new(f"place {x}", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", group
        add(empty, location=(x, 0, 1))
    extraction = extract()
    chairs = [mesh for mesh in extraction.scene.meshes if mesh.name == "chair"]
    assert [mesh.lightmapped for mesh in chairs] == [True, True]
    assert chairs[0].shape == chairs[1].shape is not None
    assert [mesh.vertices[:, 0].mean() for mesh in chairs] == [0, 3]
    matrices = [source.matrix for source in extraction.sources]
    assert matrices[0] is None
    assert [matrix[0, 3] for matrix in matrices[1:]] == [0, 3]
    assert [(source.instancer, source.index) for source in extraction.sources[1:]] == [
        ("place 0", (0,)),
        ("place 3", (0,)),
    ]
    assert extraction.skipped == ()


def test_one_mesh_stretched_in_different_ways_is_several_shapes():
    mesh = add_mesh("cube").data
    sizes = [(1, 1, 1), (-2, 2, 2), (1, 1.4, 1), (1, 1.6, 1), (3, 1, 1), (3, 1, 1.2)]
    for number, size in enumerate(sizes[1:]):
        add(bpy.data.objects.new(f"cube {number}", mesh), scale=size)
    shapes = [mesh.shape for mesh in extract().scene.meshes]
    assert shapes == [0, 0, 0, 1, 2, 2]


def test_meshes_that_keep_different_uv_maps_are_different_shapes():
    mesh = add_mesh("cube").data
    mesh.uv_layers.new(name="Kept")
    mesh.uv_layers.new(name="Other")
    for name in ("Kept", "Other", "Other"):
        thing = add(bpy.data.objects.new(name, mesh))
        thing.radiosity.uv_map = name
    assert [mesh.shape for mesh in extract().scene.meshes] == [0, 1, 2, 2]


def test_an_instanced_lamp_shines():
    add_mesh()
    group = bpy.data.collections.new("group")
    group.objects.link(bpy.data.objects.new("bulb", bpy.data.lights.new("bulb", "POINT")))
    empty = bpy.data.objects.new("holder", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", group
    add(empty, location=(0, 0, 7))
    assert [light.position for light in extract().scene.lights] == [(0, 0, 7)]


def test_triangles_get_their_slots_material_and_indices_beyond_the_slots_the_last():
    thing = add_mesh(vertices=[*QUAD, *[(x, y, 1) for x, y, _ in QUAD]], faces=[(0, 1, 2, 3), (4, 5, 6, 7)])
    for name, grey in (("dark", 0.1), ("light", 0.7)):
        thing.data.materials.append(diffuse(name, grey))
    thing.data.polygons.foreach_set("material_index", [0, 9])
    extraction = extract()
    mesh = extraction.scene.meshes[0]
    names = [extraction.scene.materials[index].name for index in mesh.material]
    assert names == ["dark", "dark", "light", "light"]
    assert extraction.sources[0].materials == ("dark", "light")


def test_no_slot_and_an_empty_slot_are_cycles_default_surface():
    add_mesh("none")
    add_mesh("empty").data.materials.append(None)
    scene = extract().scene
    assert [scene.materials[mesh.material[0]].reflectance for mesh in scene.meshes] == [(0.8, 0.8, 0.8)] * 2


def test_an_empty_slot_of_the_object_itself_shows_what_cycles_does():
    thing = add_mesh("own")
    thing.data.materials.append(diffuse("red", 0.5))
    other = bpy.data.objects.new("other", thing.data)
    bpy.context.scene.collection.objects.link(other)
    other.material_slots[0].link = "OBJECT"
    scene = extract().scene
    shown = {mesh.name: scene.materials[mesh.material[0]].name for mesh in scene.meshes}
    assert shown == {"own": "red", "other": "" if bpy.app.version >= (5, 0) else "red"}


def test_objects_invisible_to_every_ray_are_left_out():
    add_mesh("seen")
    probe = add_mesh("probe")
    for ray in ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        setattr(probe, f"visible_{ray}", False)
    assert [mesh.name for mesh in extract().scene.meshes] == ["seen"]


def test_the_settings_of_an_object_decide_its_part():
    for name in ("excluded", "only casts", "dense"):
        add_mesh(name)
    bpy.data.objects["excluded"].radiosity.exclude = True
    bpy.data.objects["only casts"].radiosity.only_casts = True
    bpy.data.objects["dense"].radiosity.density = 2.5
    extraction = extract()
    found = {mesh.name: (mesh.lightmapped, mesh.density) for mesh in extraction.scene.meshes}
    assert found == {"only casts": (False, 1.0), "dense": (True, 2.5)}
    assert set(dict(extraction.skipped)) == {"excluded", "only casts"}


def test_a_kept_uv_map_is_read_by_corner_also_when_mirrored():
    thing = add_mesh(scale=(-1, 1, 1))
    layer = thing.data.uv_layers.new(name="mine")
    corners = np.array([(0.1, 0.2), (0.8, 0.2), (0.8, 0.9), (0.1, 0.9)], np.float32)
    layer.uv.foreach_set("vector", corners.ravel())
    thing.radiosity.uv_map = "mine"
    mesh = extract().scene.meshes[0]
    assert np.array_equal(mesh.uv, corners[mesh.corner])
    thing.radiosity.uv_map = "gone"
    with pytest.raises(SceneError, match="no uv map named 'gone'"):
        extract()


def test_an_object_behind_its_stand_in_is_read_in_its_place():
    thing = add_cube("original")
    thing.modifiers.new("s", "SUBSURF").render_levels = 1
    stand_in = bpy.data.objects.new("stand-in", bpy.data.meshes.new("stand-in"))
    stand_in[STAND_IN_KEY] = thing
    swap_in(thing, stand_in, "token", instances=False)
    extraction = extract()
    assert [(mesh.name, len(mesh.triangles)) for mesh in extraction.scene.meshes] == [("original", 48)]
    assert extraction.skipped == ()
    assert (thing.hide_render, thing.hide_viewport, stand_in.hide_render) == (True, True, False)


def test_a_stand_in_without_the_object_that_it_shows_is_named():
    """As it comes out of another file alone."""
    add_mesh("floor")
    shown = bpy.data.objects.new("shown", bpy.data.meshes.new("shown"))
    stand_in = add_mesh("stand-in")
    stand_in[STAND_IN_KEY] = shown
    stand_in.constraints.new("COPY_TRANSFORMS").target = shown
    reason = "it shows the bake of an object that is not in the scene"
    assert dict(extract().skipped) == {"stand-in": reason}
    add(shown)
    assert "stand-in" not in dict(extract().skipped)


def test_a_preview_material_is_read_as_the_users_own():
    preview = emission("preview", 5)
    preview[PREVIEW_KEY], preview[ORIGINAL_MATERIAL_KEY] = True, diffuse("own", 0.25)
    add_mesh().data.materials.append(preview)
    scene = extract().scene
    assert [(material.name, material.reflectance) for material in scene.materials] == [("own", (0.25, 0.25, 0.25))]


# bad input


def test_a_scene_without_faces_is_an_error_that_says_so():
    with pytest.raises(SceneError, match="no object with faces"):
        extract()


def test_an_unknown_name_is_an_error():
    add_mesh()
    with pytest.raises(SceneError, match="no such object"):
        extract(only=["nobody"])


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: add_mesh("bad", vertices=[(0, 0, float("nan")), (1, 0, 0), (0, 1, 0)], faces=[(0, 1, 2)]), "finite"),
        (lambda: add_mesh("bad", scale=(1, 1, 0)), "scale is zero"),
        (lambda: add_mesh("bad", faces=[]), "no faces"),
        (lambda: add_mesh("bad", vertices=[(0, 0, 0), (1, 0, 0), (2, 0, 0)], faces=[(0, 1, 2)]), "no area"),
    ],
)
def test_a_bad_object_is_skipped_by_name_and_the_rest_is_read(make, reason):
    add_mesh("good")
    make()
    extraction = extract()
    assert [mesh.name for mesh in extraction.scene.meshes] == ["good"]
    assert reason in dict(extraction.skipped)["bad"]


@pytest.mark.parametrize(
    ("make", "cause"),
    [
        (lambda: add_mesh("bad", vertices=[(1e16, 0, 0), (0, 0, 0), (0, 1, 0)], faces=[(0, 1, 2)]), "1e\\+15"),
        (lambda: add_mesh("bad", location=(float("nan"), 0, 0)), "transform"),
        (lambda: add_lamp("POINT", "bad", energy=float("inf")), "power"),
    ],
)
def test_what_can_not_be_baked_is_an_error_that_names_the_object(make, cause):
    add_mesh("good")
    make()
    before = snapshot()
    with pytest.raises(SceneError, match=cause) as error:
        extract()
    assert "bad" in error.value.subject
    assert snapshot() == before


def test_eight_uv_maps_are_an_error_and_seven_are_not():
    thing = add_mesh()
    for _ in range(7):
        thing.data.uv_layers.new()
    assert extract().scene.meshes[0].lightmapped
    thing.data.uv_layers.new()
    with pytest.raises(SceneError, match="all 8 uv maps"):
        extract()


def test_linked_objects_are_an_error_unless_they_only_cast(tmp_path):
    add_mesh("from elsewhere")
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {bpy.data.objects["from elsewhere"]})
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_mesh("local")
    with bpy.data.libraries.load(path, link=True) as (_, into):
        into.objects = ["from elsewhere"]
    bpy.context.scene.collection.objects.link(into.objects[0])
    with pytest.raises(SceneError, match="linked") as error:
        extract()
    assert error.value.subject == "from elsewhere"
    assert [mesh.lightmapped for mesh in extract(only=["local"]).scene.meshes].count(True) == 1


def test_a_cyclic_material_skips_its_object_by_name():
    add_mesh("good")
    material = diffuse("loop", 0.5)
    nodes, link = material.node_tree.nodes, material.node_tree.links.new
    a, b = nodes.new("ShaderNodeAddShader"), nodes.new("ShaderNodeAddShader")
    link(a.outputs[0], b.inputs[0])
    link(b.outputs[0], a.inputs[0])
    link(a.outputs[0], next(node for node in nodes if node.type == "OUTPUT_MATERIAL").inputs["Surface"])
    add_mesh("bad").data.materials.append(material)
    extraction = extract()
    assert [mesh.name for mesh in extraction.scene.meshes] == ["good"]
    assert "feeds back" in dict(extraction.skipped)["bad"]
