# SPDX-License-Identifier: GPL-3.0-or-later
"""The glTF file of a hand-over, read back by hand and by Blender: materials, uv maps, lightmaps, instances."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from radiosity_addon.blender.data.names import PLACE_KEY
from radiosity_addon.blender.handover.export import Handover, export_lightmaps, light_pictures
from radiosity_addon.blender.interface import operators
from radiosity_addon.chunks import finish
from radiosity_addon.color.spaces import REC709
from radiosity_addon.color.transfer import srgb_decode
from radiosity_addon.files import Transaction
from tests.blender.baked import bake, quad
from tests.blender.glb import Glb, corners, read
from tests.blender.materials import diffuse, shader

CORNELL = Path(__file__).parents[2] / "sample_scenes" / "cornell_box.blend"
LIGHT = 0.5
"""H / pi of the pages, W/(m2 sr)."""


def export(folder: Path) -> tuple[Glb, list[str]]:
    with Transaction() as files:
        exported = export_lightmaps(bpy.context.scene, Handover(folder / "out", "room"), files)
        files.commit()
    return read(exported.gltf), exported.warnings


def bake_here() -> None:
    """A whole bake, for what needs places of its own."""
    lamp = bpy.data.lights.new("Lamp", "SUN")
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Lamp", lamp))
    settings = bpy.context.scene.radiosity
    settings.page_size, settings.quality = 64, "draft"
    finish(operators.bake_in_place(bpy.context.scene))


def uv_of(mesh: bpy.types.Mesh, name: str) -> dict[tuple[float, ...], tuple[float, float]]:
    """A uv map by the position of each corner, v down as in glTF."""
    layer = mesh.uv_layers[name]
    return {
        tuple(np.round(mesh.vertices[loop.vertex_index].co, 4) + 0.0): (entry.vector[0], 1 - entry.vector[1])
        for loop, entry in zip(mesh.loops, layer.uv, strict=True)
    }


def assert_same_uv(found: dict, wanted: dict) -> None:
    assert found.keys() == wanted.keys()
    for at in found:
        assert found[at] == pytest.approx(wanted[at], abs=2e-5)


def test_every_lit_material_holds_the_irradiance_of_its_page(tmp_path: Path) -> None:
    bake([quad("Floor", diffuse("Grey", 0.25)), quad("Wall")], tmp_path, LIGHT, pages={"Wall": 1})
    glb, _ = export(tmp_path)
    assert "MOZ_lightmap" in glb.content["extensionsUsed"]
    pages = set()
    for name in ("Floor", "Wall"):
        material = glb.material_of(glb.primitive(name))
        assert material["extensions"]["MOZ_lightmap"]["texCoord"] == 1
        pages.add(material["extensions"]["MOZ_lightmap"]["index"])
        assert glb.lightmap(material, tmp_path) == pytest.approx(math.pi * LIGHT, rel=1 / 255)
    assert len(pages) == 2


def test_the_second_uv_map_is_the_lightmap_whatever_their_order_was(tmp_path: Path) -> None:
    floor = quad("Floor", uv_maps=2)
    floor.data.uv_layers["Map 1"].active_render = True
    bake([floor], tmp_path)
    glb, _ = export(tmp_path)
    primitive = glb.primitive("Floor")
    for number, name in enumerate(("Map 1", "Radiosity", "Map 0")):
        assert_same_uv(corners(glb, primitive, f"TEXCOORD_{number}"), uv_of(floor.data, name))
    assert "TEXCOORD_3" not in primitive["attributes"]


def test_an_object_without_a_uv_map_gets_a_first_one_that_is_sound(tmp_path: Path) -> None:
    floor = quad("Floor", uv_maps=0)
    bake([floor], tmp_path)
    glb, _ = export(tmp_path)
    for number in (0, 1):
        assert_same_uv(corners(glb, glb.primitive("Floor"), f"TEXCOORD_{number}"), uv_of(floor.data, "Radiosity"))


def test_an_object_without_a_lightmap_is_there_without_one(tmp_path: Path) -> None:
    unlit = quad("Unlit", diffuse("Grey", 0.25))
    unlit.data.materials[0].name = "Shared"
    bake([quad("Floor", unlit.data.materials[0])], tmp_path)
    glb, _ = export(tmp_path)
    assert "extensions" in glb.material_of(glb.primitive("Floor"))
    material = glb.material_of(glb.primitive("Unlit"))
    assert "MOZ_lightmap" not in material.get("extensions", {})
    assert material["name"] == glb.material_of(glb.primitive("Floor"))["name"] == "Shared"


@pytest.mark.parametrize("mode", ["preview", "uv"])
def test_materials_are_the_users_own_not_those_that_show_the_light(tmp_path: Path, mode: str) -> None:
    steel = shader("Steel", "ShaderNodeBsdfPrincipled", Base_Color=(0.2, 0.4, 0.6, 1), Metallic=1.0, Roughness=0.3)
    things = [quad("Floor", diffuse("Grey", 0.25)), quad("Wall", steel)]
    bake(
        [*things, quad("Glow", shader("Neon", "ShaderNodeEmission", Color=(1, 0.5, 0, 1), Strength=6.0))],
        tmp_path,
        mode=mode,
    )
    glb, warnings = export(tmp_path)
    found = {name: glb.material_of(glb.primitive(name)) for name in ("Floor", "Wall", "Glow")}
    assert [material["name"] for material in found.values()] == ["Grey", "Steel", "Neon"]
    grey, metal = (found[name]["pbrMetallicRoughness"] for name in ("Floor", "Wall"))
    assert grey["baseColorFactor"] == pytest.approx([0.25, 0.25, 0.25, 1])
    assert grey["metallicFactor"] == 0
    assert metal["baseColorFactor"] == pytest.approx([0.2, 0.4, 0.6, 1])
    assert metal["roughnessFactor"] == pytest.approx(0.3)
    strength = found["Glow"]["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
    assert np.multiply(strength, found["Glow"]["emissiveFactor"]) == pytest.approx([6, 3, 0])
    assert warnings == []


def computed(material: bpy.types.Material, node: str, output: str, into: str) -> bpy.types.Node:
    """Let a new node feed an input of a material's shader."""
    tree = material.node_tree
    source = tree.nodes.new(node)
    shown = tree.get_output_node("ALL").inputs["Surface"].links[0].from_node
    tree.links.new(source.outputs[output], shown.inputs[into])
    return source


def test_a_picture_stays_that_picture(tmp_path: Path) -> None:
    material = diffuse("Painted", 0.5)
    source = computed(material, "ShaderNodeTexImage", "Color", "Color")
    source.image = bpy.data.images.new("Picture", 4, 4)
    source.image.pack()
    bake([quad("Floor", material)], tmp_path)
    glb, warnings = export(tmp_path)
    floor = glb.material_of(glb.primitive("Floor"))["pbrMetallicRoughness"]
    texture = glb.content["textures"][floor["baseColorTexture"]["index"]]
    assert glb.content["images"][texture["source"]]["name"] == "Picture"
    assert floor["baseColorTexture"].get("texCoord", 0) == 0
    assert warnings == []


def test_what_gltf_cannot_compute_becomes_a_constant_and_a_warning_where_there_is_no_lightmap(tmp_path: Path) -> None:
    marble = shader("Marble", "ShaderNodeBsdfPrincipled", Base_Color=(0.1, 0.2, 0.3, 1))
    computed(marble, "ShaderNodeTexNoise", "Color", "Base Color")
    bake([quad("Floor")], tmp_path)
    quad("Wall", marble)
    glb, warnings = export(tmp_path)
    wall = glb.material_of(glb.primitive("Wall"))["pbrMetallicRoughness"]
    assert wall["baseColorFactor"] == pytest.approx([0.1, 0.2, 0.3, 1])
    assert len(warnings) == 1
    assert warnings[0].startswith("Material 'Marble': Base Color of Principled BSDF is driven by Noise")


@pytest.mark.parametrize("shared", [False, True])
def test_computed_colours_are_painted_where_the_light_lies(tmp_path: Path, shared: bool) -> None:
    chameleon, colors = diffuse("Chameleon", 0.5), {"First": (0.2, 0.4, 0.6), "Second": (0.8, 0.1, 0.3)}
    computed(chameleon, "ShaderNodeObjectInfo", "Color", "Color")
    first = quad("First", chameleon)
    second = bpy.data.objects.new("Second", first.data if shared else first.data.copy())
    second.location.x = 3
    bpy.context.scene.collection.objects.link(second)
    for thing in (first, second):
        thing.color = (*colors[thing.name], 1)
    bake_here()
    glb, warnings = export(tmp_path)
    for name, color in colors.items():
        assert painted(glb, glb.nodes(name)[0], tmp_path) == pytest.approx(color, abs=0.01)
    assert warnings == []


def test_each_instance_has_its_own_computed_colours(tmp_path: Path) -> None:
    places = [(0.2, 0.4, 0.6), (0.8, 0.1, 0.3), (0.5, 0.9, 0.7)]
    where = diffuse("Where", 0.5)
    computed(where, "ShaderNodeNewGeometry", "Position", "Color")
    group = bpy.data.collections.new("Group")
    tile = quad("Tile", where)
    bpy.context.scene.collection.objects.unlink(tile)
    group.objects.link(tile)
    for place in places:
        holder = bpy.data.objects.new("Holder", None)
        holder.instance_type, holder.instance_collection = "COLLECTION", group
        holder.location, holder.scale = place, (0.02, 0.02, 0.02)
        bpy.context.scene.collection.objects.link(holder)
    bake_here()
    glb, _ = export(tmp_path)
    for node in glb.nodes("Tile"):
        x, z, y = node["translation"]
        assert painted(glb, node, tmp_path) == pytest.approx([x, -y, z], abs=0.03)


def painted(glb: Glb, node: dict, folder: Path) -> np.ndarray:
    """The base colour in the middle of a node, which lies there as its light does."""
    primitive = glb.primitive_of(node)
    material = glb.material_of(primitive)
    info = material["pbrMetallicRoughness"]["baseColorTexture"]
    assert info["texCoord"] == 1
    assert info.get("extensions") == material["extensions"]["MOZ_lightmap"].get("extensions")
    transform = info.get("extensions", {}).get("KHR_texture_transform", {"scale": [1, 1], "offset": [0, 0]})
    middle = glb.attribute(primitive, "TEXCOORD_1").mean(0) * transform["scale"] + transform["offset"]
    shown = glb.texture(info["index"], folder)
    column, row = (middle * len(shown)).astype(int)
    return decoded(shown[row, column])


def decoded(shown: np.ndarray) -> np.ndarray:
    return srgb_decode(shown.astype(np.float32) / 255)


def test_computed_glow_is_painted_as_bright_as_it_is(tmp_path: Path) -> None:
    glow = shader("Glow", "ShaderNodeEmission", Strength=4.0)
    computed(glow, "ShaderNodeObjectInfo", "Color", "Color")
    lamp = quad("Lamp", glow)
    lamp.color = (0.5, 0.25, 1, 1)
    bake_here()
    glb, _ = export(tmp_path)
    material = glb.material_of(glb.primitive("Lamp"))
    strength = material["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
    shown = glb.texture(material["emissiveTexture"]["index"], tmp_path)
    brightest = decoded(shown.reshape(-1, 3).max(0)) * material["emissiveFactor"] * strength
    assert brightest == pytest.approx([2, 1, 4], rel=0.02)


def test_objects_that_share_a_mesh_share_it_in_the_file_and_each_finds_its_own_light(tmp_path: Path) -> None:
    first = quad("First", diffuse("Grey", 0.25))
    second = bpy.data.objects.new("Second", first.data)
    second.location.x = 4
    bpy.context.scene.collection.objects.link(second)
    bake_here()
    glb, _ = export(tmp_path)
    primitives = [glb.primitive(name) for name in ("First", "Second")]
    assert primitives[0]["attributes"] == primitives[1]["attributes"]
    shared = corners(glb, primitives[0], "TEXCOORD_1")
    found = []
    for thing, primitive in zip((first, second), primitives, strict=True):
        extension = glb.material_of(primitive)["extensions"]["MOZ_lightmap"]["extensions"]["KHR_texture_transform"]
        (sx, sy), (u, v) = extension["scale"], extension["offset"]
        scale, right, up = thing[PLACE_KEY]
        found.append({at: (sx * x + u, sy * y + v) for at, (x, y) in shared.items()})
        wanted = {
            at: (scale * x + right, 1 - (scale * (1 - y) + up)) for at, (x, y) in uv_of(first.data, "Radiosity").items()
        }
        assert_same_uv(found[-1], wanted)
    assert found[0] != found[1]
    assert "KHR_texture_transform" in glb.content["extensionsUsed"]


def test_instances_of_a_collection_are_nodes_at_their_places_shear_and_mirror_included(tmp_path: Path) -> None:
    group = bpy.data.collections.new("Group")
    thing = quad("Tile", diffuse("Grey", 0.25))
    bpy.context.scene.collection.objects.unlink(thing)
    group.objects.link(thing)
    parent = bpy.data.objects.new("Parent", None)
    parent.scale = (1, 3, 1)
    bpy.context.scene.collection.objects.link(parent)
    for name, parented, way in (
        ("Sheared", parent, Matrix.Rotation(0.6, 4, "Z")),
        ("Mirrored", None, Matrix.Diagonal((-1, 1, 1, 1))),
    ):
        holder = bpy.data.objects.new(name, None)
        holder.instance_type, holder.instance_collection, holder.parent = "COLLECTION", group, parented
        holder.matrix_basis = Matrix.Translation((0, 0, 1 if parented else 4)) @ way
        bpy.context.scene.collection.objects.link(holder)
    bake_here()
    glb, _ = export(tmp_path)
    tiles = glb.nodes("Tile")
    assert len(tiles) == 2
    bpy.context.view_layer.update()
    wanted = [
        np.array(bpy.data.objects[name].matrix_world) @ [*corner, 0, 1]
        for name in ("Sheared", "Mirrored")
        for corner in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "out" / "room.glb"))
    bpy.context.view_layer.update()
    found = []
    for thing in bpy.context.scene.objects:
        if thing.type == "MESH":
            found += [np.array(thing.matrix_world @ vertex.co) for vertex in thing.data.vertices]
            normal = thing.matrix_world.to_3x3().inverted().transposed() @ thing.data.polygons[0].normal
            assert abs(normal.normalized().z) == pytest.approx(1, abs=1e-4)
    rows = sorted(tuple(np.round(at[:3], 3) + 0.0) for at in wanted)
    assert np.allclose(rows, sorted(tuple(np.round(at, 3) + 0.0) for at in found), atol=2e-3)


def test_what_a_stand_in_shows_is_called_as_the_user_called_it(tmp_path: Path) -> None:
    thing = quad("Roof", diffuse("Grey", 0.25))
    thing.modifiers.new("Double", "ARRAY")
    bake([thing], tmp_path)
    glb, _ = export(tmp_path)
    assert [node["name"] for node in glb.content["nodes"]] == ["Roof"]
    assert glb.content["scenes"][0]["name"] == bpy.context.scene.name
    assert glb.content["accessors"][glb.primitive("Roof")["attributes"]["POSITION"]]["count"] >= 8


def test_both_sides_of_a_two_sided_object_have_light_of_their_own(tmp_path: Path) -> None:
    leaf = quad("Leaf", diffuse("White", 0.5))
    leaf.radiosity.two_sided = True
    bake_here()
    glb, _ = export(tmp_path)
    sides = [glb.primitive_of(node) for node in glb.nodes("Leaf")]
    assert [glb.attribute(side, "NORMAL")[0].round().tolist() for side in sides] == [[0, 1, 0], [0, -1, 0]]
    for side, name in zip(sides, ("Radiosity", "Radiosity Back"), strict=True):
        assert_same_uv(corners(glb, side, "TEXCOORD_1"), uv_of(leaf.data, name))
        assert not glb.material_of(side).get("doubleSided", False)


def test_pictures_span_all_light_but_a_thousandth_of_the_texels() -> None:
    page = np.full((100, 100, 3), 0.2, np.float32)
    page[0, :10] = 50.0  # a thousandth
    page[1, :5] = 0.8
    assert light_pictures([page], REC709).white == pytest.approx(0.8)


def test_the_cornell_box_read_back_looks_as_the_baked_scene(tmp_path: Path) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(CORNELL))
    scene = bpy.context.scene
    scene.radiosity.page_size, scene.radiosity.quality = 256, "draft"
    scene.radiosity.textures = str(tmp_path / "pages")
    finish(operators.bake_in_place(scene))
    glb, _ = export(tmp_path)
    wanted = picture(tmp_path / "wanted.exr")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "out" / "room.glb"))
    show_lightmaps(glb, tmp_path)
    bpy.context.scene.camera = next(thing for thing in bpy.context.scene.objects if thing.type == "CAMERA")
    found = picture(tmp_path / "found.exr")
    assert wanted.mean() > 0.02
    assert np.abs(found - wanted).mean() < 0.01 * wanted.mean()


def picture(path: Path) -> np.ndarray:
    """The scene's camera's view without its lamps, linear."""
    scene = bpy.context.scene
    for thing in scene.objects:
        thing.hide_render = thing.hide_render or thing.type == "LIGHT"
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 4, False
    scene.render.resolution_x = scene.render.resolution_y = 96
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    pixels = np.array(image.pixels[:]).reshape(96, 96, -1)[..., :3]
    bpy.data.images.remove(image)
    return pixels


def show_lightmaps(glb: Glb, folder: Path) -> None:
    """Let imported materials emit base colour x irradiance / pi, as the extension says."""
    known = {material["name"]: material for material in glb.content["materials"]}
    for material in bpy.data.materials:
        extension = known[material.name]["extensions"]["MOZ_lightmap"]
        glb.lightmap(known[material.name], folder)  # leaves its file in the folder
        image = bpy.data.images.load(str(folder / "texture.png"))
        image.colorspace_settings.name = "Non-Color"
        tree = material.node_tree
        uv, texture, product, emission = (
            tree.nodes.new(f"ShaderNode{kind}") for kind in ("UVMap", "TexImage", "VectorMath", "Emission")
        )
        users = (thing for thing in bpy.data.objects if material.name in thing.material_slots)
        uv.uv_map = next(users).data.uv_layers[1].name
        texture.image, texture.extension, product.operation = image, "EXTEND", "MULTIPLY"
        product.inputs[1].default_value = known[material.name]["pbrMetallicRoughness"]["baseColorFactor"][:3]
        emission.inputs["Strength"].default_value = extension["intensity"] / math.pi
        tree.links.new(uv.outputs["UV"], texture.inputs["Vector"])
        tree.links.new(texture.outputs["Color"], product.inputs[0])
        tree.links.new(product.outputs["Vector"], emission.inputs["Color"])
        tree.links.new(emission.outputs[0], tree.get_output_node("ALL").inputs["Surface"])
