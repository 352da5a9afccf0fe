# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes of instances of every kind, and the same scenes made of objects of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import bpy
import numpy as np
from mathutils import Euler, Matrix

from radiosity_addon.blender.data.evaluation import at_render_settings
from radiosity_addon.blender.data.names import UV_MAP
from radiosity_addon.blender.job import Job, bake_scene
from radiosity_addon.chunks import finish
from radiosity_addon.files import Transaction
from radiosity_addon.reports.report import Report
from radiosity_addon.settings import BakeSettings
from tests.blender.materials import diffuse

SPOTS = [(-3.0, -1.0, 0.6), (-0.5, 0.5, 1.0), (2.5, -0.5, 0.8)]
"""Where instances stand, m; the lamp is to the left, so each has light of its own."""


def add(thing: bpy.types.Object, collection: bpy.types.Collection | None = None) -> bpy.types.Object:
    (collection or bpy.context.scene.collection).objects.link(thing)
    return thing


def wedge(name: str = "Wedge") -> bpy.types.Object:
    """A small house of two materials, in no collection yet."""
    mesh = bpy.data.meshes.new(name)
    corners = [(x, y, 0) for x in (-0.6, 0.6) for y in (-0.4, 0.4)] + [(-0.6, 0, 0.9), (0.6, 0, 0.5)]
    mesh.from_pydata(corners, [], [(0, 1, 3, 2), (0, 2, 5, 4), (1, 4, 5, 3), (0, 4, 1), (2, 3, 5)])
    for material in (diffuse(f"{name} Wall", 0.7), diffuse(f"{name} Roof", 0.3)):
        mesh.materials.append(material)
    mesh.polygons.foreach_set("material_index", [0, 1, 1, 0, 0])
    return bpy.data.objects.new(name, mesh)


def stage() -> None:
    """A floor, and a lamp above its left end."""
    mesh = bpy.data.meshes.new("Floor")
    mesh.from_pydata([(-5, -4, 0), (5, -4, 0), (5, 4, 0), (-5, 4, 0)], [], [(0, 1, 2, 3)])
    mesh.materials.append(diffuse("Floor", 0.5))
    add(bpy.data.objects.new("Floor", mesh))
    lamp = bpy.data.lights.new("Lamp", "AREA")
    lamp.energy, lamp.size = 300, 1.5
    add(bpy.data.objects.new("Lamp", lamp)).matrix_world = Matrix.Translation((-3, 1, 4))


def library(thing: bpy.types.Object, name: str = "Library") -> bpy.types.Collection:
    """A collection of the thing that is in no scene."""
    collection = bpy.data.collections.new(name)
    return add(thing, collection) and collection


def holder(collection: bpy.types.Collection, name: str, matrix: Matrix, into: bpy.types.Collection | None = None):
    empty = add(bpy.data.objects.new(name, None), into)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    empty.matrix_world = matrix
    return empty


def collections() -> None:
    """Instances of a collection: turned, mirrored and scaled."""
    group = library(wedge())
    ways = (Euler((0, 0, 0.5)).to_matrix().to_4x4(), Matrix.Diagonal((-1, 1, 1.2, 1)), Matrix.Scale(1.4, 4))
    for number, (spot, way) in enumerate(zip(SPOTS, ways, strict=True)):
        holder(group, f"Holder {number}", Matrix.Translation(spot) @ way)


def nested() -> None:
    """Instances of instances, one with a shear, of an object that is also in the scene itself."""
    thing = add(wedge())
    thing.location = SPOTS[0]
    inner = library(thing, "Inner")
    outer = bpy.data.collections.new("Outer")
    holder(inner, "Inner Holder", Euler((0, 0, 0.7)).to_matrix().to_4x4(), outer)
    holder(outer, "Outer Holder", Matrix.Translation((3, 0, 0)) @ Matrix.Diagonal((1.3, 0.9, 1, 1)))


def objects() -> None:
    """Objects that share a mesh, one of them with materials of its own and one mirrored."""
    first = add(wedge())
    first.matrix_world = Matrix.Translation(SPOTS[0])
    second = add(bpy.data.objects.new("Second", first.data))
    second.matrix_world = Matrix.Translation(SPOTS[1]) @ Matrix.Diagonal((1, -1, 1, 1))
    second.material_slots[1].link = "OBJECT"
    second.material_slots[1].material = diffuse("Own", 0.6)
    third = add(bpy.data.objects.new("Third", first.data))
    third.matrix_world = Matrix.Translation(SPOTS[2]) @ Matrix.Diagonal((3, 0.5, 1, 1))


def points(name: str = "Points") -> bpy.types.Object:
    """A mesh of three vertices without faces."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(SPOTS, [], [])
    return add(bpy.data.objects.new(name, mesh))


def tree(*kinds: str) -> tuple:
    """Geometry nodes: the tree, its input, its output, and one node of each kind."""
    group = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    return group, *(group.nodes.new(kind) for kind in ("NodeGroupInput", "NodeGroupOutput", *kinds))


def nodes(as_instance: bool = True) -> None:
    """Geometry nodes that instance an object on points."""
    thing, host = wedge(), points()
    library(thing)
    group, start, end, on_points, info = tree("GeometryNodeInstanceOnPoints", "GeometryNodeObjectInfo")
    info.inputs["Object"].default_value, info.inputs["As Instance"].default_value = thing, as_instance
    on_points.inputs["Rotation"].default_value = (0, 0, 0.4)
    group.links.new(start.outputs[0], on_points.inputs["Points"])
    group.links.new(info.outputs["Geometry"], on_points.inputs["Instance"])
    group.links.new(on_points.outputs[0], end.inputs[0])
    host.modifiers.new("Nodes", "NODES").node_group = group


def node_meshes() -> None:
    """Geometry nodes that instance a mesh which belongs to no object."""
    host = points()
    kinds = ("GeometryNodeInstanceOnPoints", "GeometryNodeMeshCube", "GeometryNodeSetMaterial")
    group, start, end, on_points, cube, paint = tree(*kinds)
    cube.inputs["Size"].default_value = (1, 0.7, 0.5)
    paint.inputs["Material"].default_value = diffuse("Cube", 0.6)
    group.links.new(start.outputs[0], on_points.inputs["Points"])
    group.links.new(cube.outputs["Mesh"], paint.inputs["Geometry"])
    group.links.new(paint.outputs[0], on_points.inputs["Instance"])
    group.links.new(on_points.outputs[0], end.inputs[0])
    host.modifiers.new("Nodes", "NODES").node_group = group


def particles() -> None:
    """Hair particles shown as an object; the emitter is seen as well."""
    thing = wedge()
    library(thing)
    mesh = bpy.data.meshes.new("Emitter")
    mesh.from_pydata([(-4, -1, 0.3), (4, -1, 0.3), (4, 1, 0.3), (-4, 1, 0.3)], [], [(0, 1, 2, 3)])
    emitter = add(bpy.data.objects.new("Emitter", mesh))
    emitter.modifiers.new("Particles", "PARTICLE_SYSTEM")
    settings = emitter.particle_systems[0].settings
    settings.type, settings.count, settings.render_type = "HAIR", 3, "OBJECT"
    settings.instance_object, settings.particle_size = thing, 0.5
    settings.use_advanced_hair = True
    settings.hair_length, settings.use_rotations, settings.rotation_mode = 0.3, True, "GLOB_X"


def vertices() -> None:
    """A child instanced on the vertices of its parent, which has no faces."""
    thing, host = add(wedge()), points()
    thing.parent = host
    host.instance_type = "VERTS"


def faces() -> None:
    """A child instanced on the faces of its parent, as large as these, while the parent is seen as well."""
    thing = add(wedge())
    thing.data.transform(Matrix.Translation((0, 0, 0.3)))
    mesh = bpy.data.meshes.new("Table")
    squares = [[(x + a * s, y + b * s, z) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
               for (x, y, z), s in zip(SPOTS, (0.5, 0.4, 0.6), strict=True)]  # fmt: skip
    corners = [corner for square in squares for corner in square]
    mesh.from_pydata(corners, [], [(4 * k, 4 * k + 1, 4 * k + 2, 4 * k + 3) for k in range(3)])
    mesh.materials.append(diffuse("Table", 0.6))
    host = add(bpy.data.objects.new("Table", mesh))
    thing.parent = host
    host.instance_type, host.use_instance_faces_scale = "FACES", True


KINDS: dict[str, Callable[[], None]] = {
    "collections": collections,
    "nested": nested,
    "objects": objects,
    "nodes": nodes,
    "nodes' copies": lambda: nodes(as_instance=False),
    "nodes' meshes": node_meshes,
    "particles": particles,
    "vertices": vertices,
    "faces": faces,
}


def singles() -> bpy.types.Scene:
    """A scene that shows the same by objects of their own, no two of which share a mesh."""
    scene, made = bpy.context.scene, []

    with at_render_settings(scene) as depsgraph:
        for item in depsgraph.object_instances:
            thing = item.object
            if thing.type == "MESH" and len(thing.data.polygons):
                mesh = thing.data.copy()
                materials = [slot.material and slot.material.original for slot in thing.material_slots]
                made.append((thing.name, mesh, materials, item.matrix_world.copy()))

    copy = bpy.data.scenes.new("Singles")
    copy.collection.objects.link(bpy.data.objects["Lamp"])
    origin = bpy.data.objects.new("Origin", None)
    copy.collection.objects.link(origin)
    for name, mesh, materials, matrix in made:
        for index, material in enumerate(materials):
            mesh.materials[index] = material
        thing = bpy.data.objects.new(f"{name} alone", mesh)
        copy.collection.objects.link(thing)
        thing.parent, thing.matrix_parent_inverse = origin, matrix
    return copy


def bake(
    scene: bpy.types.Scene | None = None,
    mode: Literal["preview", "uv"] = "preview",
    objects: tuple[str, ...] = (),
    **settings: object,
) -> Report:
    """Bake a scene, by default the open one, with direct light only, which has hardly any noise; pages are packed."""
    chosen = BakeSettings(**{"page_size": 64, "quality": "draft", "bounces": 0} | settings)
    with Transaction() as files:
        return finish(bake_scene(scene or bpy.context.scene, Job(chosen, mode, None, "page", objects), files))


def light(report: Report) -> tuple[np.ndarray, np.ndarray]:
    """Centre, m, and unit normal of each baked polygon in the world, (P, 6), and what the pages hold there, (P, 3)."""
    bpy.context.view_layer.update()
    pages = []
    for page in report.pages:
        image = bpy.data.images[page.image]
        pixels = np.empty(image.size[0] * image.size[1] * 4, np.float32)
        image.pixels.foreach_get(pixels)
        pages.append(pixels.reshape(image.size[1], image.size[0], 4)[..., :3])
    where, found = [], []
    for row in report.objects:
        thing = bpy.data.objects[row.object]
        scale, offset = row.uv_scale or (1, 1), row.uv_offset or (0, 0)
        layer = thing.data.uv_layers[UV_MAP].uv
        for polygon in thing.data.polygons:
            uv = np.mean([layer[loop].vector for loop in polygon.loop_indices], axis=0) * scale + offset
            corners = [thing.matrix_world @ thing.data.vertices[vertex].co for vertex in polygon.vertices]
            normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized()
            where.append([*np.mean(corners, axis=0), *normal * np.sign(thing.matrix_world.determinant())])
            found.append(_bilinear(pages[row.page], uv))
    return np.array(where), np.array(found)


def _bilinear(page: np.ndarray, uv: np.ndarray) -> np.ndarray:
    x, y = np.clip(uv * page.shape[1::-1] - 0.5, 0, np.array(page.shape[1::-1]) - 1.001)
    i, j = int(x), int(y)
    a, b = x - i, y - j
    top, bottom = page[j, i : i + 2], page[j + 1, i : i + 2]
    return (1 - b) * ((1 - a) * top[0] + a * top[1]) + b * ((1 - a) * bottom[0] + a * bottom[1])
