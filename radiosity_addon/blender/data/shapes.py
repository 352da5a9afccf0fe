# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluated meshes as arrays, in their own space and placed in the world."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...arrays import Bools, Float32, Float64, Floats, Int32

FLAT = 1e-7
"""A triangle whose doubled area is below this share of its longest edge squared is a line in float32: degenerate."""

FREE_NORMALS = bpy.app.version >= (5, 0)
"""Shading normals can be plain vectors, and not only angles of 16 bits, which take long to find. Blender 4.5 takes
vectors too, but its Cycles does not."""


@dataclass(frozen=True, eq=False)
class Shape:
    """Triangles of one evaluated mesh.

    Attributes:
        vertices: (V, 3) float64
        triangles: (F, 3) int32, into vertices
        corner_normals: (F, 3, 3) float32
        corner: (F, 3) int32, loop of each triangle corner
        polygon: (F,) int32
        slot: (F,) int32, material index as stored
        dropped: degenerate triangles left out
    """

    vertices: Float64
    triangles: Int32
    corner_normals: Float32
    corner: Int32
    polygon: Int32
    slot: Int32
    dropped: int = 0


def read_shape(mesh: bpy.types.Mesh) -> Shape:
    """A mesh as arrays, in its own space."""
    mesh.calc_loop_triangles()
    triangles = mesh.loop_triangles
    corner = _get(triangles, "loops", (len(triangles), 3), np.int32)
    polygon = _get(triangles, "polygon_index", (len(triangles),), np.int32)
    slot = _get(mesh.polygons, "material_index", (len(mesh.polygons),), np.int32)
    normals = _get(mesh.corner_normals, "vector", (len(mesh.loops), 3), np.float32)
    return Shape(
        vertices=_get(mesh.vertices, "co", (len(mesh.vertices), 3), np.float32).astype(np.float64),
        triangles=_get(triangles, "vertices", (len(triangles), 3), np.int32),
        corner_normals=normals[corner],
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
    for part, name in (("polygons", "loop_start"), ("loops", "vertex_index")):
        a, b = getattr(mesh, part), getattr(own, part)
        if not np.array_equal(_get(a, name, (len(a),), np.int32), _get(b, name, (len(b),), np.int32)):
            return False
    return True


def placed(shape: Shape, matrix: Float64) -> Shape:
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
    normals = shape.corner_normals[keep][:, order] @ np.linalg.inv(linear).astype(np.float32)
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    defined = np.isfinite(length) & (length > 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = np.where(defined, normals / length, geometric[keep][:, None])
    return replace(
        shape,
        vertices=vertices,
        triangles=np.ascontiguousarray(shape.triangles[keep][:, order]),
        corner_normals=np.ascontiguousarray(normals, dtype=np.float32),
        corner=np.ascontiguousarray(shape.corner[keep][:, order]),
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


def _get(items: bpy.types.bpy_prop_collection, name: str, shape: tuple[int, ...], dtype: type) -> Floats | Int32:
    values = np.empty(math.prod(shape), dtype)
    items.foreach_get(name, values)
    return values.reshape(shape)
