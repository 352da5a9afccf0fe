# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluated meshes as arrays, in their own space and placed in the world."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass

import bpy
import numpy as np

from ...arrays import Bools, Float32, Float64, Floats, Int32

FLAT = 1e-7
"""A triangle whose doubled area is below this share of its longest edge squared is a line in float32: degenerate."""

FREE_NORMALS = bpy.app.version >= (5, 0)
"""Shading normals can be plain vectors, and not only angles of 16 bits, which take long to find. Blender 4.5 takes
vectors too, but its Cycles does not."""

OWN_SLOTS = bpy.app.version >= (5, 0)
"""Cycles lets an empty slot of an object hide the material that its mesh has there."""


@dataclass(frozen=True, eq=False)
class Shape:
    """Triangles of one evaluated mesh, in its own space.

    Attributes:
        vertices: (V, 3) float64
        triangles: (F, 3) int32, into vertices
        loop_normals: (L, 3) float32, of polygon corners
        corner: (F, 3) int32, loop of each triangle corner
        polygon: (F,) int32
        slot: (F,) int32, material index as stored
    """

    vertices: Float64
    triangles: Int32
    loop_normals: Float32
    corner: Int32
    polygon: Int32
    slot: Int32


@dataclass(frozen=True, eq=False)
class Placed:
    """Triangles of one evaluated mesh in the world, all with an area.

    Attributes:
        corner_normals: (F, 3, 3) float32, unit
        dropped: triangles left out
        others: as of Shape
    """

    vertices: Float64
    triangles: Int32
    corner_normals: Float32
    corner: Int32
    polygon: Int32
    slot: Int32
    dropped: int


def slots_of(thing: bpy.types.Object) -> list[bpy.types.Material | None]:
    """The materials in the slots of an evaluated object, as Cycles takes them.

    Where a slot of the object itself is empty, Blender says the mesh's material. Cycles shows that in 4.5, none in 5.2.
    """
    own = thing.original.material_slots if OWN_SLOTS else ()
    empty = {index for index, slot in enumerate(own) if slot.link == "OBJECT" and slot.material is None}
    return [None if index in empty else slot.material for index, slot in enumerate(thing.material_slots)]


def read_shape(mesh: bpy.types.Mesh) -> Generator[None, None, Shape]:
    """A mesh as arrays, in its own space; each step is one call to Blender."""
    mesh.calc_loop_triangles()
    yield
    triangles = mesh.loop_triangles
    corner = _get(triangles, "loops", (len(triangles), 3), np.int32)
    yield
    polygon = _get(triangles, "polygon_index", (len(triangles),), np.int32)
    yield
    normals = _get(mesh.corner_normals, "vector", (len(mesh.loops), 3), np.float32)
    yield
    vertex = _of_attribute(mesh, ".corner_vert", (len(mesh.loops),), np.int32)
    slot = _of_attribute(mesh, "material_index", (len(mesh.polygons),), np.int32)
    return Shape(
        vertices=_of_attribute(mesh, "position", (len(mesh.vertices), 3), np.float32).astype(np.float64),
        triangles=vertex[corner],
        loop_normals=normals,
        corner=corner,
        polygon=polygon,
        slot=slot[polygon],
    )


def read_uv(mesh: bpy.types.Mesh, name: str) -> Float32 | None:
    """A uv map by polygon corner, (L, 2); None if the mesh has no such map."""
    layer = mesh.uv_layers.get(name)
    return None if layer is None else _get(layer.uv, "vector", (len(mesh.loops), 2), np.float32)


def set_corner_normals(mesh: bpy.types.Mesh, normals: Floats) -> None:
    """Give a mesh shading normals (L, 3) at its corners; where one is zero, the mesh keeps its own.

    Without FREE_NORMALS this marks edges as sharp.
    """
    if not FREE_NORMALS:
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)  # 4.2 takes for granted that they are 1
        mesh.normals_split_custom_set((normals / np.where(lengths > 0, lengths, 1)).astype(np.float32))
        return
    unset = ~normals.any(axis=1)
    if unset.any():
        normals = np.where(unset[:, None], _get(mesh.corner_normals, "vector", normals.shape, np.float32), normals)
    attribute = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
    attribute.data.foreach_set("vector", normals.astype(np.float32).ravel())


def has_loops_of(mesh: bpy.types.Mesh, own: bpy.types.Mesh) -> bool:
    """Whether both meshes have the same polygons of the same corners, so that a uv map of one fits the other."""
    if len(mesh.loops) != len(own.loops) or len(mesh.polygons) != len(own.polygons):
        return False
    starts = [_get(each.polygons, "loop_start", (len(each.polygons),), np.int32) for each in (mesh, own)]
    vertices = [_of_attribute(each, ".corner_vert", (len(each.loops),), np.int32) for each in (mesh, own)]
    return np.array_equal(*starts) and np.array_equal(*vertices)


def placed(shape: Shape, matrix: Float64) -> Placed:
    """The shape in the world: a mirroring matrix turns the winding round, so that the front stays the front.

    Triangles without area are left out and counted.

    Args:
        matrix: (4, 4) float64, invertible
    """
    linear = matrix[:3, :3]
    vertices = shape.vertices @ linear.T + matrix[:3, 3]
    keep, geometric = _solid(vertices[shape.triangles])
    order = [0, 2, 1] if np.linalg.det(linear) < 0 else [0, 1, 2]
    if order[1] == 2:
        geometric = -geometric
    corner = np.ascontiguousarray(shape.corner[keep][:, order])
    normals = shape.loop_normals[corner] @ np.linalg.inv(linear).astype(np.float32)
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    defined = np.isfinite(length) & (length > 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = np.where(defined, normals / length, geometric[keep][:, None])
    return Placed(
        vertices=vertices,
        triangles=np.ascontiguousarray(shape.triangles[keep][:, order]),
        corner_normals=np.ascontiguousarray(normals, dtype=np.float32),
        corner=corner,
        polygon=shape.polygon[keep],
        slot=shape.slot[keep],
        dropped=int((~keep).sum()),
    )


def _solid(corners: Float64) -> tuple[Bools, Float64]:
    """Which triangles (F, 3, 3) have an area, (F,), and their unit normals, (F, 3)."""
    a, b, c = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1], corners[:, 0] - corners[:, 2]
    cross = np.cross(a, -c)
    doubled = np.linalg.norm(cross, axis=1)
    longest = np.maximum((a**2).sum(1), np.maximum((b**2).sum(1), (c**2).sum(1)))
    keep = doubled > FLAT * longest
    return keep, cross / np.where(keep, doubled, 1)[:, None]


def _of_attribute(mesh: bpy.types.Mesh, name: str, shape: tuple[int, ...], dtype: type) -> Floats | Int32:
    """What Blender keeps in an attribute, which is read a hundred times faster than its elements' properties.

    One that is not there is 0 all over.
    """
    attribute = mesh.attributes.get(name)
    if attribute is None:
        return np.zeros(shape, dtype)
    return _get(attribute.data, "vector" if len(shape) > 1 else "value", shape, dtype)


def _get(items: bpy.types.bpy_prop_collection, name: str, shape: tuple[int, ...], dtype: type) -> Floats | Int32:
    values = np.empty(math.prod(shape), dtype)
    items.foreach_get(name, values)
    return values.reshape(shape)
