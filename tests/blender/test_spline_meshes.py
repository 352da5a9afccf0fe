# SPDX-License-Identifier: GPL-3.0-or-later
"""Curve and surface objects in a bake: what is read, what stands in for them."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.data.curves import left_to_blender
from radiosity_addon.blender.data.shapes import FREE_NORMALS, placed, read_shape, set_corner_normals
from radiosity_addon.blender.data.spline_meshes import spline_mesh
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.blender.writing.revert import revert
from radiosity_addon.chunks import finish
from radiosity_addon.scene import Mesh
from tests.blender.built import add_mesh
from tests.blender.spline_objects import bake_all, curve_object, link, shown, taper_object


def nurbs_sphere() -> bpy.types.Object:
    bpy.ops.surface.primitive_nurbs_surface_sphere_add()
    return bpy.context.object


def reason(thing: bpy.types.Object) -> str | None:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return left_to_blender(thing.evaluated_get(depsgraph), depsgraph)


def made(thing: bpy.types.Object):
    return finish(spline_mesh(thing, bpy.context.evaluated_depsgraph_get()))


def normals_of(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Geometric (F, 3) and corner normals (F, 3, 3) of the triangles that have an area."""
    shape = placed(finish(read_shape(mesh)), np.eye(4))
    a, b, c = np.moveaxis(shape.vertices[shape.triangles], 1, 0)
    cross = np.cross(b - a, c - a)
    return cross / np.linalg.norm(cross, axis=1, keepdims=True), shape.corner_normals


def test_a_surface_is_sampled_by_its_curvature_not_by_its_resolution():
    thing = nurbs_sphere()
    first = made(thing).faces
    thing.data.splines[0].resolution_u = thing.data.splines[0].resolution_v = 1
    assert np.array_equal(made(thing).faces.vertices, first.vertices)
    assert len(first.vertices) > 1000


def test_what_we_make_of_surfaces_looks_as_blenders_own():
    thing = nurbs_sphere()
    thing.data.splines[0].resolution_u = thing.data.splines[0].resolution_v = 24
    mesh = made(thing).mesh
    theirs = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    for each in (mesh, theirs):
        shape = placed(finish(read_shape(each)), np.eye(4))
        middle = shape.vertices[shape.triangles].mean(axis=1)
        geometric, corner = normals_of(each)
        assert (np.einsum("fi,fi->f", geometric, middle) > 0).mean() > 0.98  # Blender's own poles are ragged
        assert np.quantile(np.einsum("fci,fi->fc", corner, geometric), 0.02) > 0.98
        assert [layer.name for layer in each.uv_layers] == ["UVMap"]
    assert np.abs(np.array(mesh.texspace_size) - np.array(theirs.texspace_size)).max() < 1e-5


def test_shading_normals_of_a_sphere_are_exact():
    mesh = made(nurbs_sphere()).mesh
    shape = placed(finish(read_shape(mesh)), np.eye(4))
    radial = shape.vertices[shape.triangles]
    poles = np.linalg.norm(radial[..., :2], axis=2) < 1e-6
    radial = radial / np.linalg.norm(radial, axis=2, keepdims=True)
    off = np.linalg.norm(shape.corner_normals - radial, axis=2)
    assert off[~poles].max() < 2e-3
    assert off[poles].max() < 0.05


def test_a_mesh_takes_the_shading_normals_that_it_is_given_and_keeps_its_own_where_none_are():
    mesh = add_mesh().data
    tilted = np.array([[0.6, 0, 0.8]] * 3 + [[0.0, 0, 0]])
    set_corner_normals(mesh, tilted)
    tilted[3] = 0, 0, 1
    found = np.array([normal.vector[:] for normal in mesh.corner_normals])
    assert found == pytest.approx(tilted, abs=1e-6 if FREE_NORMALS else 1e-3)


@pytest.mark.parametrize("outline", [{"bevel_depth": 0.1}, {"bevel_depth": 0.1, "extrude": 0.1, "fill_mode": "HALF"}])
def test_caps_face_outward_as_in_blender(outline):
    thing = curve_object("POLY", 2, use_fill_caps=True, **outline)
    for i, point in enumerate(thing.data.splines[0].points):
        point.co, point.tilt, point.radius = (i, 0, 0, 1), 0, 1
    theirs = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    for mesh in (made(thing).mesh, theirs):
        shape = placed(finish(read_shape(mesh)), np.eye(4))
        normal, _ = normals_of(mesh)
        for end in (0, 1):
            cap = (np.abs(shape.vertices[shape.triangles][..., 0] - end) < 1e-6).all(axis=1)
            area = np.cross(*(np.diff(shape.vertices[shape.triangles[cap]], axis=1).swapaxes(0, 1)))
            assert cap.any()
            assert np.allclose(normal[cap, 0], 2 * end - 1, atol=1e-5)
            assert np.linalg.norm(area, axis=1).sum() > 0.01


def wave(thing: bpy.types.Object) -> None:
    thing.modifiers.new("Wave", "WAVE")


def key(thing: bpy.types.Object) -> None:
    thing.shape_key_add(name="Basis")


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (wave, "modifiers"),
        (key, "shape keys"),
        (lambda thing: setattr(thing.data.splines[0], "use_smooth", False), "flat"),
        (lambda thing: setattr(thing.data, "dimensions", "2D"), "outlines"),
        (lambda thing: setattr(thing.data, "twist_mode", "TANGENT"), "twist"),
        (lambda thing: setattr(thing.data, "twist_smooth", 2.0), "twist"),
        (lambda thing: setattr(thing.data, "bevel_factor_end", 0.5), "part"),
        (lambda thing: setattr(thing.data, "taper_object", taper_object("POLY", use_cyclic_u=True)), "closed"),
        (lambda thing: thing.data.__setattr__("taper_object", curve_object("POLY", bevel_depth=1.0)), "bevelled"),
    ],
)
def test_what_splines_do_not_tell_is_left_to_blender(change, why):
    thing = curve_object("NURBS", bevel_depth=0.1)
    assert reason(thing) is None
    change(thing)
    bpy.context.view_layer.update()
    assert why in reason(thing)
    extraction = extract_scene(bpy.context.scene)
    mesh = next(mesh for mesh in extraction.scene.meshes if mesh.name == thing.name)
    assert mesh.flat is None
    assert len(mesh.vertices) == len(shown(thing).vertices)


def test_an_extracted_surface_comes_with_charts_and_leaves_nothing_behind():
    nurbs_sphere()
    bpy.ops.curve.primitive_bezier_curve_add()
    bpy.context.object.data.bevel_depth = 0.1
    before = len(bpy.data.meshes)
    extraction = extract_scene(bpy.context.scene)
    assert len(bpy.data.meshes) == before
    for mesh in map(Mesh.laid_flat, extraction.scene.meshes):
        assert mesh.chart is not None
        assert mesh.uv.shape == (len(mesh.triangles), 3, 2)
        a, b = (mesh.uv[:, k] - mesh.uv[:, 0] for k in (1, 2))
        flat = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
        c, d = (mesh.vertices[mesh.triangles[:, k]] - mesh.vertices[mesh.triangles[:, 0]] for k in (1, 2))
        assert flat == pytest.approx(np.linalg.norm(np.cross(c, d), axis=1).sum(), rel=0.1)


def test_a_degenerate_spline_is_left_out_with_a_warning():
    thing = curve_object("NURBS", bevel_depth=0.1)
    lone = thing.data.splines.new("NURBS")
    lone.points[0].co = (5, 5, 5, 1)
    extraction = extract_scene(bpy.context.scene)
    assert any("Curve" in warning and "single point" in warning for warning in extraction.warnings)
    assert extraction.scene.meshes[0].vertices.max() < 4


@pytest.mark.parametrize("place", [(0, 0, 0), (np.nan, 0, 0), (np.inf, 1, 2)])
def test_points_that_coincide_or_are_not_finite_make_nothing(place):
    bpy.ops.mesh.primitive_plane_add()
    thing, sheet = curve_object("NURBS", bevel_depth=0.1), nurbs_sphere()
    for owner in (thing, sheet):
        for point in owner.data.splines[0].points:
            point.co = (*place, 1)
    extraction = extract_scene(bpy.context.scene)
    assert [mesh.name for mesh in extraction.scene.meshes] == ["Plane"]
    assert {thing.name, sheet.name} <= set(dict(extraction.skipped))
    assert sum("spline is left out" in warning for warning in extraction.warnings) == 2


def test_a_weight_of_nothing_leaves_its_spline_out():
    bpy.ops.mesh.primitive_plane_add()
    thing = curve_object("NURBS", bevel_depth=0.1)
    thing.data.splines[0].points[2].co[3] = 0
    extraction = extract_scene(bpy.context.scene)
    assert [mesh.name for mesh in extraction.scene.meshes] == ["Plane"]
    assert any("weight" in warning for warning in extraction.warnings)


def test_the_stand_in_is_what_was_baked_and_revert_brings_the_surface_back():
    thing = nurbs_sphere()
    thing.data.materials.append(bpy.data.materials.new("Glaze"))
    link("Lamp", bpy.data.lights.new("Lamp", "POINT")).location = (0, 0, 4)
    corners = len(made(thing).faces.loop_vertex)
    before = sorted(data.name for data in bpy.data.user_map())
    scene = bpy.context.scene
    bake_all(scene)
    stand_in = scene.objects[f"{thing.name} (Radiosity)"]
    assert len(stand_in.data.loops) == corners
    assert [layer.name for layer in stand_in.data.uv_layers] == ["UVMap", "Radiosity"]
    assert stand_in.data.has_custom_normals
    assert len(stand_in.data.materials) == 1
    assert thing.hide_render
    revert(scene)
    assert not thing.hide_render
    assert sorted(data.name for data in bpy.data.user_map()) == before


def test_curves_that_share_their_data_share_their_mesh():
    thing = curve_object("NURBS", bevel_depth=0.1)
    twin = link("Twin", thing.data)
    twin.location.x = 5
    extraction = extract_scene(bpy.context.scene)
    first, second = extraction.scene.meshes
    assert np.array_equal(first.triangles, second.triangles)
    assert np.allclose(second.vertices - first.vertices, [5, 0, 0], atol=1e-5)


def test_instances_of_a_surface_have_light_of_their_own_and_share_its_charts():
    thing = nurbs_sphere()
    group = bpy.data.collections.new("Group")
    bpy.context.scene.collection.objects.unlink(thing)
    group.objects.link(thing)
    for index in range(2):
        empty = link(f"Empty {index}", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", group
        empty.location.x = 3 * index
    bpy.context.view_layer.update()
    first, second = extract_scene(bpy.context.scene).scene.meshes
    assert first.lightmapped
    assert second.lightmapped
    assert first.shape == second.shape is not None
    assert np.array_equal(first.chart, second.chart)


def hair(strands: int = 3, length: float = 1.0, radius: float = 0.02) -> bpy.types.Object:
    data = bpy.data.hair_curves.new("Hair")
    thing = link("Hair", data)
    data.add_curves([4] * strands)
    for index, point in enumerate(data.points):
        point.position = (index // 4 * 0.1, 0, index % 4 * length / 3)
        point.radius = radius
    return thing


def nodes_that_join(thing: bpy.types.Object, other: bpy.types.Object) -> None:
    """Geometry nodes that add another object's geometry."""
    modifier = thing.modifiers.new("Join", "NODES")
    tree = modifier.node_group = bpy.data.node_groups.new("Join", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    info, join = tree.nodes.new("GeometryNodeObjectInfo"), tree.nodes.new("GeometryNodeJoinGeometry")
    info.inputs["Object"].default_value = other
    for source, target in ((start.outputs[0], join), (info.outputs["Geometry"], join), (join.outputs[0], end)):
        tree.links.new(source, target.inputs[0])


def test_hair_shadows_and_bounces_as_tubes():
    bpy.ops.mesh.primitive_plane_add()
    hair()
    extraction = extract_scene(bpy.context.scene)
    found = next(mesh for mesh in extraction.scene.meshes if mesh.name == "Hair")
    assert not found.lightmapped
    assert np.ptp(found.vertices[:, 2]) == pytest.approx(1.0, abs=1e-5)
    a, b, c = np.moveaxis(found.vertices[found.triangles], 1, 0)
    side = 3 * 2 * np.pi * 0.02 * 1.0
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(side, rel=0.05)
    assert "hair" in dict(extraction.skipped)["Hair"]


def test_curves_in_the_geometry_of_a_mesh_object_are_not_rendered():
    """Cycles shows hair of Curves objects alone."""
    bpy.ops.mesh.primitive_plane_add()
    plane, other = bpy.context.object, hair()
    other.hide_render = True
    nodes_that_join(plane, other)
    extraction = extract_scene(bpy.context.scene)
    assert [(mesh.name, len(mesh.triangles)) for mesh in extraction.scene.meshes] == [("Plane", 2)]


def test_a_bare_curve_shows_nothing_unless_it_is_given_a_tube():
    bpy.ops.mesh.primitive_plane_add()
    thing = curve_object("POLY", 2)
    for i, point in enumerate(thing.data.splines[0].points):
        point.co, point.tilt, point.radius = (i, 0, 1, 1), 0, 1
    assert [mesh.name for mesh in extract_scene(bpy.context.scene).scene.meshes] == ["Plane"]
    thing.radiosity.tube_radius = 0.05
    thing.scale = (2, 2, 2)
    bpy.context.view_layer.update()
    found = extract_scene(bpy.context.scene).scene.meshes
    tube = next(mesh for mesh in found if mesh.name == "Curve")
    assert np.ptp(tube.vertices, axis=0) == pytest.approx([2.0, 0.1, 0.1], rel=0.01)
    assert tube.flat is not None


def test_a_bare_curve_with_a_tube_is_shown_and_comes_back():
    bpy.ops.mesh.primitive_plane_add(size=3)
    thing = curve_object("POLY", 2)
    thing.radiosity.tube_radius = 0.05
    glow = bpy.data.materials.new("Glow")
    if glow.node_tree is None:
        glow.use_nodes = True
    tree = glow.node_tree
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Strength"].default_value = 30
    tree.links.new(emission.outputs[0], next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL").inputs["Surface"])
    thing.data.materials.append(glow)
    scene = bpy.context.scene
    bake_all(scene)
    stand_in = scene.objects["Curve (Radiosity)"]
    assert len(stand_in.data.polygons) > 10
    image = next(image for image in bpy.data.images if image.name.startswith("Radiosity"))
    assert np.array(image.pixels[:]).reshape(-1, 4)[:, :3].max() > 0.05
    revert(scene)
    assert "Curve (Radiosity)" not in scene.objects
    assert not thing.hide_render
