# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes made with bpy, read into records: known places, normals, shapes."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.reading.cycles import Cycles
from radiosity_addon.blender.reading.extract import read_scene
from radiosity_addon.chunks import finish
from tests.blender.added import add_cube
from tests.blender.built import QUAD, add, add_mesh, emission, extract


def geometric_normals(mesh) -> np.ndarray:
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    return cross / np.linalg.norm(cross, axis=1, keepdims=True)


# geometry


def test_a_moved_rotated_scaled_quad_lands_where_blender_puts_it():
    thing = add_mesh(location=(1, 2, 3), rotation_euler=(0.3, 0.4, 0.5), scale=(1, 2, 3))
    mesh = extract().scene.meshes[0]
    bpy.context.view_layer.update()
    expected = [thing.matrix_world @ vertex.co for vertex in thing.data.vertices]
    assert np.allclose(mesh.vertices, expected, atol=1e-6)
    assert mesh.vertices.dtype == np.float64
    assert mesh.triangles.dtype == np.int32


def test_a_scene_was_read_in_one_look_whatever_becomes_of_it_while_records_are_made():
    add_cube()
    thing = add_mesh(location=(1, 2, 3), scale=(1, 2, 3))
    thing.data.materials.append(emission("Glow", 3.0))
    before = extract().scene
    reading = finish(read_scene(bpy.context.scene))
    records = reading.extraction(Cycles())
    next(records)
    bpy.data.materials.remove(thing.data.materials[0])
    for each in list(bpy.data.meshes):
        bpy.data.meshes.remove(each)
    after = finish(records).scene
    assert after.materials == before.materials
    for one, other in zip(after.meshes, before.meshes, strict=True):
        assert one.name == other.name
        assert np.array_equal(one.vertices, other.vertices)
        assert np.array_equal(one.corner_normals, other.corner_normals)
        assert np.array_equal(one.material, other.material)


def test_no_step_reads_more_than_one_object():
    for index in range(4):
        add_cube(f"Cube {index}")
    before = len(list(read_scene(bpy.context.scene)))
    add_cube("One more")
    assert len(list(read_scene(bpy.context.scene))) > before


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (1, -2, 0.5), (-1, -1, -1), (3, 1, 0.2)])
def test_winding_and_normals_point_out_of_a_cube_at_any_scale(scale):
    add_cube(scale=scale, rotation_euler=(0.1, 0.2, 0.3))
    mesh = extract().scene.meshes[0]
    outward = mesh.vertices[mesh.triangles].mean(axis=1)
    assert ((geometric_normals(mesh) * outward).sum(1) > 0).all()
    assert ((mesh.corner_normals * geometric_normals(mesh)[:, None]).sum(2) > 0.999).all()  # flat shaded


def test_smooth_normals_follow_the_inverse_transpose_under_a_non_uniform_scale():
    """Corner normals of a cube are diagonals; halving z doubles their z before they are made unit again."""
    thing = add_cube(scale=(1, 1, 0.5))
    thing.data.shade_smooth()
    mesh = extract().scene.meshes[0]
    corners = mesh.vertices[mesh.triangles]
    expected = np.sign(corners) * [1, 1, 2] / np.sqrt(6)
    assert np.allclose(mesh.corner_normals, expected, atol=1e-4)


def test_custom_normals_are_kept():
    thing = add_mesh()
    tilted = np.array([0.6, 0, 0.8])
    thing.data.normals_split_custom_set([tilted] * 4)
    assert np.allclose(extract().scene.meshes[0].corner_normals, tilted, atol=1e-3)


def test_corners_name_the_loops_behind_a_mirrored_quads_triangles():
    thing = add_mesh(scale=(-1, 1, 1))
    mesh = extract().scene.meshes[0]
    of_loop = np.array([loop.vertex_index for loop in thing.data.loops])
    assert np.array_equal(of_loop[mesh.corner], mesh.triangles)
    assert mesh.polygon.tolist() == [0, 0]


def test_subdivision_is_at_render_level_and_not_the_own_mesh():
    thing = add_cube()
    modifier = thing.modifiers.new("s", "SUBSURF")
    modifier.levels, modifier.render_levels = 1, 2
    extraction = extract()
    assert len(extraction.scene.meshes[0].triangles) == 6 * 16 * 2
    assert not extraction.sources[0].own_mesh


def test_a_deformed_mesh_is_still_the_own_mesh():
    thing = add_cube()
    thing.modifiers.new("d", "DISPLACE").mid_level = 0
    extraction = extract()
    assert extraction.sources[0].own_mesh
    assert not np.allclose(np.abs(extraction.scene.meshes[0].vertices), 1)


def test_geometry_nodes_never_count_as_the_own_mesh():
    thing = add_mesh()
    thing.modifiers.new("n", "NODES").node_group = pass_through()
    assert not extract().sources[0].own_mesh


def test_a_mesh_in_edit_mode_is_flushed_first():
    thing = add_mesh()
    bpy.context.view_layer.objects.active = thing
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.translate(value=(0, 0, 5))
    try:
        assert np.allclose(extract().scene.meshes[0].vertices[:, 2], 5)
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")


def test_instances_of_a_mesh_in_edit_mode_are_read_too():
    thing = add_mesh()
    add(bpy.data.objects.new("twin", thing.data))
    bpy.context.view_layer.objects.active = thing
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        assert [len(mesh.triangles) for mesh in extract().scene.meshes] == [2, 2]
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")


def test_a_curve_in_edit_mode_is_read():
    curve = bpy.data.curves.new("Tube", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.1
    curve.splines.new("POLY").points.add(1)
    curve.splines[0].points[1].co = (1, 0, 0, 1)
    bpy.context.view_layer.objects.active = add(bpy.data.objects.new("Tube", curve))
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        assert len(extract().scene.meshes[0].triangles)
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")


def test_curves_text_and_metaballs_become_meshes_of_their_own():
    curve = bpy.data.curves.new("Tube", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.1
    curve.splines.new("NURBS").points.add(3)
    for i, point in enumerate(curve.splines[0].points):
        point.co = (i, 0, 0, 1)
    text = bpy.data.curves.new("Text", "FONT")
    text.body = "A"
    balls = bpy.data.metaballs.new("Ball")
    balls.elements.new()
    for data in (curve, text, balls):
        add(bpy.data.objects.new(data.name, data))
    extraction = extract()
    assert [mesh.name for mesh in extraction.scene.meshes] == ["Tube", "Text", "Ball"]
    assert all(mesh.lightmapped and len(mesh.triangles) for mesh in extraction.scene.meshes)
    assert not any(source.own_mesh for source in extraction.sources)
    assert extraction.skipped == ()


def test_degenerate_triangles_are_dropped_and_counted():
    add_mesh(vertices=[*QUAD, (5, 0, 0), (6, 0, 0), (7, 0, 0)], faces=[(0, 1, 2, 3), (4, 5, 6)])
    extraction = extract()
    assert len(extraction.scene.meshes[0].triangles) == 2
    assert "Quad: 1 triangles without area are left out" in extraction.warnings


def test_tiny_triangles_and_slivers_are_kept():
    add_mesh(
        vertices=[(0, 0, 0), (1e-8, 0, 0), (0, 1e-8, 0), (0, 0, 1), (1, 0, 1), (0.5, 1e-5, 1)],
        faces=[(0, 1, 2), (3, 4, 5)],
    )
    assert len(extract().scene.meshes[0].triangles) == 2


# speed


def test_a_million_triangles_are_read():
    side = 708
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3).astype(np.float32)
    first = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).reshape(-1)
    loops = (first[:, None] + [0, 1, side + 1, side]).astype(np.int32)
    mesh = bpy.data.meshes.new("grid")
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.ravel())
    mesh.loops.add(loops.size)
    mesh.loops.foreach_set("vertex_index", loops.ravel())
    mesh.polygons.add(len(loops))
    mesh.polygons.foreach_set("loop_start", np.arange(len(loops), dtype=np.int32) * 4)
    mesh.update()
    add(bpy.data.objects.new("grid", mesh))
    assert len(extract().scene.meshes[0].triangles) == 2 * 707**2


# helpers


def pass_through() -> bpy.types.NodeTree:
    tree = bpy.data.node_groups.new("same", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    tree.links.new(tree.nodes.new("NodeGroupInput").outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    return tree
