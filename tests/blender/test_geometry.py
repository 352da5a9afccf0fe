# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender makes of geometry when it renders is what is baked."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from radiosity_addon.blender.data.names import UV_MAP
from radiosity_addon.blender.reading.extract import extract_scene
from tests.blender.instanced import add, bake, holder, library, stage, tree, wedge


def read(name: str):
    """What the extractor makes of an object."""
    meshes = [mesh for mesh in extract_scene(bpy.context.scene).scene.meshes if mesh.name == name]
    assert len(meshes) == 1
    return meshes[0]


def area(mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def polygon(name: str, corners: list[tuple[float, float]]) -> bpy.types.Object:
    """A flat mesh of one face."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(x, y, 0) for x, y in corners], [], [range(len(corners))])
    return add(bpy.data.objects.new(name, mesh))


def cube(name: str = "Cube") -> bpy.types.Object:
    bpy.ops.mesh.primitive_cube_add(size=2)
    bpy.context.object.name = name
    return bpy.context.object


def smooth_between(normals: np.ndarray, mesh) -> float:
    """Cosine between shading and geometric normals, the least of all corners."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1)[:, None]
    return float((normals * flat[:, None]).sum(axis=2).min())


def test_a_concave_polygon_keeps_its_area_and_gets_one_chart(tmp_path):
    polygon("L", [(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)])
    assert area(read("L")) == pytest.approx(5)
    report = bake(density=16.0)
    assert report.objects[0].object == "L"
    layer = bpy.data.objects["L"].data.uv_layers[UV_MAP].uv
    uv = np.array([corner.vector for corner in layer])
    x, y = uv.T
    shoelace = abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2
    assert shoelace * 64**2 == pytest.approx(5 * 16**2, rel=1e-3)


def test_a_polygon_of_many_corners_is_baked():
    turn = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    polygon("Disc", list(zip(np.cos(turn).tolist(), np.sin(turn).tolist(), strict=True)))
    assert area(read("Disc")) == pytest.approx(np.pi, rel=1e-3)
    assert bake().objects[0].texels > 1000


def test_sharp_edges_part_normals_and_smooth_ones_blend_them():
    thing = cube()
    thing.data.shade_smooth()
    mesh = read("Cube")
    assert smooth_between(mesh.corner_normals, mesh) == pytest.approx(1 / np.sqrt(3), abs=1e-5)
    thing.data.set_sharp_from_angle(angle=1.0)
    mesh = read("Cube")
    assert smooth_between(mesh.corner_normals, mesh) == pytest.approx(1, abs=1e-5)


def test_smooth_shading_by_nodes_is_read_as_rendered():
    """The Smooth by Angle modifier is such a tree."""
    thing = cube()
    group, start, end, smooth = tree("GeometryNodeSetShadeSmooth")
    group.links.new(start.outputs[0], smooth.inputs["Geometry"])
    group.links.new(smooth.outputs[0], end.inputs[0])
    thing.modifiers.new("Smooth", "NODES").node_group = group
    mesh = read("Cube")
    assert smooth_between(mesh.corner_normals, mesh) == pytest.approx(1 / np.sqrt(3), abs=1e-5)


@pytest.mark.parametrize("matrix", [Matrix.Diagonal((-1, 2, 0.5, 1)), Matrix.Shear("XY", 4, (0.7, -0.4))])
def test_custom_normals_of_an_instance_are_those_of_the_surface_that_it_shows(matrix):
    thing = wedge()
    thing.data.normals_split_custom_set_from_vertices([(0.6, 0, 0.8)] * len(thing.data.vertices))
    parent = add(bpy.data.objects.new("Parent", None))
    empty = holder(library(thing), "Holder", Matrix())
    empty.parent, empty.matrix_parent_inverse = parent, matrix
    mesh = read("Wedge")
    expected = np.linalg.inv(np.array(matrix)[:3, :3]).T @ (0.6, 0, 0.8)
    np.testing.assert_allclose(mesh.corner_normals, np.broadcast_to(expected / np.linalg.norm(expected),
                               mesh.corner_normals.shape), atol=2e-3)  # fmt: skip


def test_a_modifier_that_is_off_in_renders_is_off_in_the_bake():
    thing = cube()
    array = thing.modifiers.new("Array", "ARRAY")
    array.show_render, array.show_viewport = False, True
    assert area(read("Cube")) == pytest.approx(24)
    array.show_render, array.show_viewport = True, False
    assert area(read("Cube")) == pytest.approx(48)


def test_metaballs_that_melt_together_are_one_surface_of_their_first():
    stage()
    for x in (0.0, 1.2):
        bpy.ops.object.metaball_add(location=(x, 0, 2))
    report = bake()
    assert sorted(row.source for row in report.objects) == ["Floor", "Mball"]
    width = np.ptp([vertex.co.x for vertex in bpy.data.objects["Mball (Radiosity)"].data.vertices])
    assert width > 3
    assert not report.warnings


def test_text_is_baked_with_its_bevel_and_from_instances_too():
    stage()
    bpy.ops.object.text_add(location=(0, 0, 1))
    text = bpy.context.object
    text.data.body, text.data.extrude, text.data.bevel_depth = "ok", 0.1, 0.02
    bpy.context.scene.collection.objects.unlink(text)
    group = library(text)
    holder(group, "Left", Matrix.Translation((-2, 0, 0)))
    holder(group, "Right", Matrix.Translation((2, 0, 0)))
    report = bake(page_size=256)
    rows = [row for row in report.objects if row.source == "Text"]
    assert [row.instancer for row in rows] == ["Left", "Right"]
    assert len({bpy.data.objects[row.object].data for row in rows}) == 1


def test_a_mesh_that_nodes_make_from_nothing_is_baked():
    stage()
    host = add(bpy.data.objects.new("Made", bpy.data.meshes.new("Empty")))
    group, _, end, ball = tree("GeometryNodeMeshUVSphere")
    group.links.new(ball.outputs["Mesh"], end.inputs[0])
    host.modifiers.new("Nodes", "NODES").node_group = group
    host.location.z = 2
    report = bake()
    row = next(row for row in report.objects if row.source == "Made")
    assert UV_MAP in bpy.data.objects[row.object].data.uv_layers
    assert area(read("Made")) == pytest.approx(4 * np.pi, rel=0.03)
