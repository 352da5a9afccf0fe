# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks of any node tree as Cycles has them: known answers, and Cycles' own bake of each object as the judge."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from radiosity_addon.arrays import Float32
from radiosity_addon.atlas.cells import lay_cells
from radiosity_addon.blender.looks.materials import read_material
from radiosity_addon.blender.reading.cycles_shader import CyclesShader
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.errors import SceneError
from radiosity_addon.shading import Layout
from tests.blender.datablocks import differences, snapshot
from tests.blender.shader_trees import (
    SIZE,
    Tree,
    checkers,
    emitting,
    image,
    layout_of,
    of_coordinates,
    of_image,
    pages,
    plane,
)


def cube(name: str, *materials: bpy.types.Material, **values: object) -> bpy.types.Object:
    """A cube whose uv map has no overlaps, each side of another material in turn."""
    bpy.ops.mesh.primitive_cube_add(size=1.5)
    thing = bpy.context.object
    thing.name = name
    for material in materials:
        thing.data.materials.append(material)
    for polygon in thing.data.polygons:
        polygon.material_index = polygon.index % max(len(materials), 1)
    for key, value in values.items():
        setattr(thing, key, value)
    return thing


def cycles(thing: bpy.types.Object, uv_map: str = "UVMap") -> tuple[Float32, Float32]:
    """Cycles' own bake of an object where it stands, and which texels it covers."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.device = 1, "CPU"
    image = bpy.data.images.new("reference", SIZE, SIZE, alpha=True, float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.zeros(SIZE * SIZE * 4, np.float32))
    for slot in thing.material_slots:
        node = slot.material.node_tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        slot.material.node_tree.nodes.active = node
    bpy.ops.object.select_all(action="DESELECT")
    thing.select_set(True)
    bpy.context.view_layer.objects.active = thing
    bpy.ops.object.bake(type="EMIT", margin=0, use_clear=False, uv_layer=uv_map)
    pixels = np.empty(SIZE * SIZE * 4, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(SIZE, SIZE, 4)
    return pixels[:, :, :3], pixels[:, :, 3] > 0


def of_object(output: str) -> Callable[[Tree], bpy.types.NodeSocket]:
    return lambda tree: tree.node("ObjectInfo").outputs[output]


def of_attribute(name: str, output: str = "Color", kind: str = "GEOMETRY") -> Callable[[Tree], bpy.types.NodeSocket]:
    def make(tree: Tree) -> bpy.types.NodeSocket:
        node = tree.node("Attribute")
        node.attribute_name, node.attribute_type = name, kind
        return node.outputs[output]

    return make


def of_geometry(output: str) -> Callable[[Tree], bpy.types.NodeSocket]:
    return lambda tree: tree.node("NewGeometry").outputs[output]


def of_noise(tree: Tree) -> bpy.types.NodeSocket:
    return tree.node("TexNoise").outputs["Color"]


def of_layers(tree: Tree) -> bpy.types.NodeSocket:
    return tree.node("LayerWeight").outputs["Facing"]


def in_object_space(tree: Tree) -> bpy.types.NodeSocket:
    node = tree.node("VectorTransform")
    node.convert_from, node.convert_to = "WORLD", "OBJECT"
    tree.link(tree.node("NewGeometry").outputs["Normal"], node.inputs[0])
    return node.outputs[0]


AS_CYCLES = {
    "generated": of_coordinates("Generated"),
    "object": of_coordinates("Object"),
    "normal": of_coordinates("Normal"),
    "uv": of_coordinates("UV"),
    "noise without coordinates": of_noise,
    "location": of_object("Location"),
    "object colour": of_object("Color"),
    "object alpha": of_object("Alpha"),
    "object index": of_object("Object Index"),
    "material index": of_object("Material Index"),
    "random": of_object("Random"),
    "position": of_geometry("Position"),
    "geometry normal": of_geometry("Normal"),
    "true normal": of_geometry("True Normal"),
    "incoming": of_geometry("Incoming"),
    "random per island": of_geometry("Random Per Island"),
    "facing": of_layers,
    "object space": in_object_space,
    "colour attribute": of_attribute("Paint"),
    "alpha of a colour attribute": of_attribute("Paint", "Alpha"),
    "number of a colour attribute": of_attribute("Paint", "Fac"),
    "number attribute": of_attribute("Weight", "Fac"),
    "face attribute": of_attribute("Face"),
    "uv map as attribute": of_attribute("UVMap", "Vector"),
    "absent attribute": of_attribute("Nothing"),
    "alpha of an absent attribute": of_attribute("Nothing", "Alpha"),
    "object property": of_attribute("tint", "Color", "OBJECT"),
    "object property of Blender's own": of_attribute("pass_index", "Fac", "OBJECT"),
    "layer property": of_attribute("mood", "Color", "VIEW_LAYER"),
}


@pytest.mark.parametrize("name", AS_CYCLES)
def test_what_a_tree_asks_of_its_surface_is_answered_as_cycles_does(name):
    """Two objects, moved, turned, scaled, mirrored and deformed, so that no answer fits both by chance."""
    material = emitting(AS_CYCLES[name])
    material.pass_index = 3
    first = cube("Erster", material, location=(1, 2, 3), rotation_euler=(0.3, 0.5, 0.7), scale=(1, 2, 0.5))
    second = cube("Zweiter\u00fc", material, location=(-2, 0, 1), scale=(-1, 1, 1), color=(0.1, 0.6, 0.3, 0.7))
    second.pass_index = 7
    first.modifiers.new("Islands", "EDGE_SPLIT")
    second.modifiers.new("Bend", "SIMPLE_DEFORM").angle = 0.6
    first["tint"], second["tint"] = (0.2, 0.3, 0.9), (0.7, 0.1, 0.4)
    bpy.context.view_layer["mood"] = (0.3, 0.8, 0.2)
    for thing in (first, second):
        paint = thing.data.attributes.new("Paint", "BYTE_COLOR" if thing == first else "FLOAT_COLOR", "CORNER")
        paint.data.foreach_set("color", np.linspace(0, 1, 96, dtype=np.float32))
        weight = thing.data.attributes.new("Weight", "FLOAT", "POINT")
        weight.data.foreach_set("value", np.linspace(-1, 2, 8, dtype=np.float32))
        face = thing.data.attributes.new("Face", "FLOAT_VECTOR", "FACE")
        face.data.foreach_set("vector", np.linspace(0, 3, 18, dtype=np.float32))
    shown = pages()
    for thing in (first, second):
        expected, covered = cycles(thing)
        assert covered.mean() > 0.2
        assert np.abs(shown[thing.name] - expected)[covered].max() < 3e-4 * max(1, np.abs(expected).max())


def test_a_checker_has_its_two_colours_in_their_places():
    plane("Floor", emitting(checkers))
    page = pages()["Floor"]
    for row, column in ((16, 16), (48, 48)):
        assert page[row, column] == pytest.approx((0.8, 0.2, 0.1), abs=1e-6)
        assert page[row, 64 - column] == pytest.approx((0.1, 0.3, 0.6), abs=1e-6)


def test_a_gradient_follows_the_uv_map():
    def gradient(tree: Tree) -> bpy.types.NodeSocket:
        node = tree.node("TexGradient")
        tree.link(tree.node("TexCoord").outputs["UV"], node.inputs["Vector"])
        return node.outputs["Fac"]

    plane("Floor", emitting(gradient))
    page = pages()["Floor"]
    expected = (np.arange(SIZE) + 0.5) / SIZE
    assert np.abs(page[:, :, 0] - expected).max() < 1e-4


def test_groups_in_groups_are_asked_and_fed():
    inner = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
    inner.interface.new_socket("Tint", in_out="INPUT", socket_type="NodeSocketColor")
    inner.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    start, end, mix = (inner.nodes.new(kind) for kind in ("NodeGroupInput", "NodeGroupOutput", "ShaderNodeVectorMath"))
    place = inner.nodes.new("ShaderNodeTexCoord")
    mix.operation = "MULTIPLY"
    inner.links.new(place.outputs["UV"], mix.inputs[0])
    inner.links.new(start.outputs[0], mix.inputs[1])
    inner.links.new(mix.outputs[0], end.inputs[0])
    outer = bpy.data.node_groups.new("Outer", "ShaderNodeTree")
    outer.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    user, out = outer.nodes.new("ShaderNodeGroup"), outer.nodes.new("NodeGroupOutput")
    user.node_tree = inner
    user.inputs[0].default_value = (0.5, 0.25, 1, 1)
    outer.links.new(user.outputs[0], out.inputs[0])

    def grouped(tree: Tree) -> bpy.types.NodeSocket:
        node = tree.node("Group")
        node.node_tree = outer
        return node.outputs[0]

    plane("Floor", emitting(grouped))
    assert pages()["Floor"][48, 16] == pytest.approx([0.5 * 16.5 / 64, 0.25 * 48.5 / 64, 0], abs=1e-4)


def test_each_slot_shows_its_own_material():
    colors = [(0.9, 0.1, 0.1), (0.1, 0.8, 0.2), (0.2, 0.1, 0.7)]
    paints = [image(f"Paint {k}", [[color]], float_buffer=True, is_data=True) for k, color in enumerate(colors)]
    thing = cube("Box", *(emitting(of_image(paint), paint.name) for paint in paints))
    shown = pages()["Box"]
    for polygon in thing.data.polygons:
        corners = np.array([thing.data.uv_layers[0].uv[loop].vector for loop in polygon.loop_indices])
        column, row = (corners.mean(0) * SIZE).astype(int)
        assert shown[row, column] == pytest.approx(colors[polygon.material_index], abs=1e-5)


def test_text_has_generated_coordinates_over_its_box():
    curve = bpy.data.curves.new("Text", "FONT")
    curve.body, curve.extrude = "II", 0.2
    curve.materials.append(emitting(of_coordinates("Generated")))
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Text", curve))
    extraction = extract_scene(bpy.context.scene)
    mesh = extraction.scene.meshes[0]
    low, high = mesh.vertices.min(0), mesh.vertices.max(0)
    cells = lay_cells([mesh], 20.0, 128)[0]
    layout = Layout(128, 1, np.zeros(1, np.int32), (cells.uv,))
    page = CyclesShader(bpy.context.scene.name, extraction)(layout, np.ones(1, bool), "emission")[0]
    column, row = (cells.uv.mean(1) * 128).astype(int).T
    middle = (mesh.vertices[mesh.triangles].mean(1) - low) / (high - low)
    assert np.abs(page[row, column] - middle)[:, :2].max() < 0.2  # somewhere in the triangle
    assert page[row, column, :2].std(0).min() > 0.2


def test_instances_have_places_and_numbers_of_their_own():
    material = emitting(of_object("Location"))
    numbers = emitting(of_object("Random"), "Random")
    group = bpy.data.collections.new("Group")
    for thing in (plane("One", material), plane("Two", numbers)):
        bpy.context.scene.collection.objects.unlink(thing)
        group.objects.link(thing)
    for number in range(2):
        empty = bpy.data.objects.new(f"Empty {number}", None)
        empty.instance_type, empty.instance_collection, empty.location = "COLLECTION", group, (0, 0, 1.0 + number)
        bpy.context.scene.collection.objects.link(empty)
    plane("Floor", emitting(checkers, "Floor"))
    extraction = extract_scene(bpy.context.scene)
    shown = CyclesShader(bpy.context.scene.name, extraction)(layout_of(extraction), np.ones(5, bool), "emission")
    found = [(source.object_name, page[32, 32]) for source, page in zip(extraction.sources, shown, strict=True)]
    places = sorted(color.tolist() for name, color in found if name == "One")
    assert places == [[0, 0, 1], [0, 0, 2]]
    one, two = (color[0] for name, color in found if name == "Two")
    assert one != two


@pytest.mark.skipif(bpy.app.version < (5, 0), reason="scenes work in Linear Rec.709 before Blender 5.0")
def test_pages_hold_the_working_spaces_own_numbers():
    bpy.ops.wm.set_working_color_space(working_space="Linear Rec.2020", convert_colors=False)
    try:
        red = image("Red", [[(1, 0, 0)]])
        plane("Image", emitting(of_image(red), "Image"))
        painted = plane("Bytes", emitting(of_attribute("Paint"), "Bytes"))
        painted.data.attributes.new("Paint", "BYTE_COLOR", "CORNER").data.foreach_set("color", [1, 0, 0, 1] * 4)
        floats = plane("Floats", emitting(of_attribute("Paint"), "Floats"))
        floats.data.attributes.new("Paint", "FLOAT_COLOR", "CORNER").data.foreach_set("color", [1, 0, 0, 1] * 4)
        shown = pages()
        in_rec2020 = pytest.approx([0.6274, 0.0691, 0.0164], abs=1e-3)
        assert shown["Image"][32, 32] == in_rec2020
        assert shown["Bytes"][32, 32] == in_rec2020
        assert shown["Bytes"][32, 32] == pytest.approx(cycles(painted)[0][32, 32], abs=1e-3)
        assert shown["Floats"][32, 32] == pytest.approx([1, 0, 0])
    finally:
        bpy.ops.wm.set_working_color_space(working_space="Linear Rec.709", convert_colors=False)


def test_diffuse_rays_see_what_the_camera_may_not_and_shadow_rays_tell_transparency():
    tree = Tree()
    path, end = tree.node("LightPath"), tree.node("OutputMaterial")
    glow, clear, mix = tree.node("Emission"), tree.node("BsdfTransparent"), tree.node("MixShader")
    tree.link(checkers(tree), glow.inputs["Color"])
    tree.link(checkers(tree), clear.inputs["Color"])
    tree.link(path.outputs["Is Shadow Ray"], mix.inputs[0])
    tree.link(glow.outputs[0], mix.inputs[1])
    tree.link(clear.outputs[0], mix.inputs[2])
    tree.link(mix.outputs[0], end.inputs["Surface"])
    plane("Floor", tree.material)
    assert pages("emission")["Floor"][16, 16] == pytest.approx([0.8, 0.2, 0.1], abs=1e-6)
    assert pages("transmittance")["Floor"][16, 16] == pytest.approx([0.8, 0.2, 0.1], abs=1e-6)


def test_the_three_quantities_of_a_principled_are_told_apart():
    tree = Tree()
    shader, end = tree.node("BsdfPrincipled", Roughness=1.0, Specular_IOR_Level=0.0), tree.node("OutputMaterial")
    color = checkers(tree)
    tree.link(color, shader.inputs["Base Color"])
    tree.link(color, shader.inputs["Emission Color"])
    shader.inputs["Emission Strength"].default_value = 3.0
    shader.inputs["Alpha"].default_value = 0.25
    tree.link(shader.outputs[0], end.inputs["Surface"])
    plane("Floor", tree.material)
    assert pages("reflectance")["Floor"][16, 16] == pytest.approx([0.25 * c for c in (0.8, 0.2, 0.1)], abs=0.01)
    assert pages("emission")["Floor"][16, 16] == pytest.approx([0.75 * c for c in (0.8, 0.2, 0.1)], abs=1e-6)


TOLD = {
    "dielectric": {"Base Color": (0.6, 0.3, 0.1), "Roughness": 0.35},
    "metal": {"Base Color": (0.6, 0.3, 0.1), "Metallic": 1.0, "Roughness": 0.6},
    "half metal": {"Base Color": (0.6, 0.3, 0.1), "Metallic": 0.5, "Roughness": 0.25},
    "coated lamp": {"Coat Weight": 0.7, "Emission Color": (0.2, 0.5, 1.0), "Emission Strength": 6.0},
    "dim mirror": {"Base Color": (0, 0, 0), "Specular IOR Level": 0.8, "Roughness": 0.1},
    "glass": {"Base Color": (0.9, 0.5, 0.5), "Transmission Weight": 0.6, "Alpha": 0.8},
}


@pytest.mark.parametrize("name", TOLD)
def test_a_principled_whose_inputs_are_textures_looks_as_one_of_constants(name):
    """Which Cycles judges in test_materials: within a hundredth, where roughness and metals are interpolated."""
    constant, textured = Tree("Constant"), Tree("Textured")
    for tree in (constant, textured):
        shader, end = tree.node("BsdfPrincipled"), tree.node("OutputMaterial")
        tree.link(shader.outputs[0], end.inputs["Surface"])
        for key, value in TOLD[name].items():
            if tree is textured:
                color = value if isinstance(value, tuple) else (value,) * 3
                shown = image(key, [[color]], float_buffer=True, is_data=True)
                tree.link(of_image(shown)(tree), shader.inputs[key])
            else:
                shader.inputs[key].default_value = (*value, 1) if isinstance(value, tuple) else value
    expected = read_material(constant.material, 0, lambda text: None)
    plane("Floor", textured.material)
    (record,) = extract_scene(bpy.context.scene).scene.materials
    for quantity in record.varies:
        assert pages(quantity)["Floor"][32, 32] == pytest.approx(getattr(expected, quantity), abs=0.01, rel=0.01)
    for quantity in {"reflectance", "emission", "transmittance"} - record.varies:
        assert getattr(record, quantity) == pytest.approx(getattr(expected, quantity), abs=1e-6)


def test_nothing_of_the_users_is_changed_and_nothing_is_left():
    def grouped(tree: Tree) -> bpy.types.NodeSocket:
        group = bpy.data.node_groups.new("Paint", "ShaderNodeTree")
        group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
        end, coordinates = group.nodes.new("NodeGroupOutput"), group.nodes.new("ShaderNodeTexCoord")
        group.links.new(coordinates.outputs["Generated"], end.inputs[0])
        node = tree.node("Group")
        node.node_tree = group
        return node.outputs[0]

    plane("Floor", emitting(grouped))
    cube("Box", emitting(checkers), emitting(of_geometry("Random Per Island")))
    before, active = snapshot(), bpy.context.view_layer.objects.active
    shown = pages()
    assert shown["Floor"].max() > 0.9
    assert differences(before, snapshot()) == []
    assert bpy.context.view_layer.objects.active == active


def test_a_picture_that_shines_is_light_and_nodes_that_are_not_followed_are_named():
    def occluded(tree: Tree) -> bpy.types.NodeSocket:
        node = tree.node("AmbientOcclusion")
        tree.link(checkers(tree), node.inputs["Color"])
        return node.outputs["Color"]

    plane("Floor", emitting(occluded, "Paint"))
    warnings = extract_scene(bpy.context.scene).scene.warnings
    assert warnings == (
        "Material 'Paint' of Floor: Ambient Occlusion finds only surfaces around it whose materials vary",
    )


def test_a_material_that_is_gone_is_an_error_that_leaves_nothing():
    plane("Floor", emitting(checkers, "Paint"))
    extraction = extract_scene(bpy.context.scene)
    bpy.data.materials["Paint"].name = "Other"
    before = snapshot()
    with pytest.raises(SceneError, match="'Paint': was renamed or deleted"):
        CyclesShader(bpy.context.scene.name, extraction)(layout_of(extraction), np.ones(1, bool), "emission")
    assert differences(before, snapshot()) == []


def test_triangles_smaller_than_a_texel_are_shown_too():
    """Each triangle of a grid on a speck of its own, few of which hold the centre of a texel."""
    thing = plane("Floor", emitting(of_geometry("Position")))
    thing.modifiers.new("Cut", "SUBSURF").render_levels = 3
    thing.modifiers["Cut"].subdivision_type = "SIMPLE"
    extraction = extract_scene(bpy.context.scene)
    mesh = extraction.scene.meshes[0]
    count = len(mesh.triangles)
    cell = np.stack([np.arange(count) % 12, np.arange(count) // 12], axis=1)[:, None] * 5 + 2.1
    uv = (cell + np.array([[0, 0], [0.2, 0], [0, 0.2]])) / SIZE
    layout = Layout(SIZE, 1, np.zeros(1, np.int32), (uv.astype(np.float32),))
    page = CyclesShader(bpy.context.scene.name, extraction)(layout, np.ones(1, bool), "emission")[0]
    middle = mesh.vertices[mesh.triangles].mean(1)
    column, row = cell[:, 0].astype(int).T
    assert np.abs(page[row, column] - middle).max() < 1e-3
    assert np.abs(page[row + 1, column + 1] - middle).max() < 1e-3
