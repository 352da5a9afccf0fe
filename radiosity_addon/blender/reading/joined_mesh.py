# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of many objects joined into one mesh, which carries what their materials' trees ask for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from ...arrays import Float32, Float64, Int32, Int64
from ...scene import Mesh
from ..data.shapes import FREE_NORMALS, set_corner_normals
from ..looks.surface_answers import ABSENT, SurfaceAnswers
from ..looks.surface_inputs import Input

LAYOUT_UV = "radiosity layout"

FLAT = 1e-6
"""Corner normals of a polygon that is shaded flat are this much alike."""


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of one mesh that are to be baked.

    Attributes:
        chosen: (K,) which of its triangles
        uv: (K, 3, 2) float64, 0 to 1 of the page
    """

    mesh: Mesh
    surface: SurfaceAnswers
    chosen: Int64
    uv: Float64


def join(mesh: bpy.types.Mesh, parts: Sequence[Part], matrix: Float64, names: Mapping[Input, str]) -> Int32:
    """Join parts in a new mesh.

    Args:
        matrix: (4, 4) of the object that will show it
        names: of the attributes that answer what trees ask for

    Returns:
        which of the records' materials each of its slots is for
    """
    inverse = np.linalg.inv(matrix)
    order = [0, 2, 1] if np.linalg.det(matrix) < 0 else [0, 1, 2]
    starts = np.cumsum([0, *(len(part.mesh.vertices) for part in parts)])
    vertices = np.concatenate([part.mesh.vertices for part in parts]) @ inverse[:3, :3].T + inverse[:3, 3]
    corners = np.concatenate(
        [part.mesh.triangles[part.chosen][:, order] + start for part, start in zip(parts, starts, strict=False)]
    )
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.loops.add(corners.size)
    mesh.loops.foreach_set("vertex_index", corners.astype(np.int32).ravel())
    mesh.polygons.add(len(corners))
    mesh.polygons.foreach_set("loop_start", np.arange(0, corners.size, 3, dtype=np.int32))
    used, slots = np.unique(np.concatenate([part.mesh.material[part.chosen] for part in parts]), return_inverse=True)
    mesh.polygons.foreach_set("material_index", slots.reshape(-1).astype(np.int32))
    if parts[0].surface.edges is not None:
        mesh.edges.add(len(parts[0].surface.edges))
        mesh.edges.foreach_set("vertices", parts[0].surface.edges.ravel())
    mesh.update()
    layer = mesh.uv_layers.new(name=LAYOUT_UV, do_init=False)
    layer.uv.foreach_set("vector", _joined(part.uv[:, order] for part in parts))
    if FREE_NORMALS or parts[0].surface.edges is None:  # sharp edges would tell other islands
        normals = _joined(_normals(part)[:, order] @ matrix[:3, :3] for part in parts)
        set_corner_normals(mesh, normals.reshape(-1, 3))
    for asked, name in names.items():
        answers = [_answer(part, asked, order) for part in parts]
        width = max(answer.shape[2] for answer in answers)
        attribute = mesh.attributes.new(name, "FLOAT" if width == 1 else "FLOAT_COLOR", "CORNER")
        values = _joined(_widened(answer, width) for answer in answers)
        attribute.data.foreach_set("value" if width == 1 else "color", values)
    return used


def _normals(part: Part) -> Float64:
    """Shading normals (K, 3, 3) in world space; of flat polygons those of each triangle, as Cycles has them."""
    smooth = part.mesh.corner_normals[part.chosen].astype(np.float64)
    corners = part.mesh.vertices[part.mesh.triangles[part.chosen]]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cross /= np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-300)
    flat = (np.abs(smooth - smooth[:, :1]) < FLAT).all((1, 2))
    return np.where(flat[:, None, None], cross[:, None], smooth)


def _answer(part: Part, asked: Input, order: list[int]) -> Float32:
    """What a surface answers at the corners of a part, (K, 3, C); nothing to what it was not asked."""
    if asked.kind == "normal":
        local = _normals(part)[:, order] @ part.surface.matrix[:3, :3]
        return _widened(local, 4)
    answer = part.surface.values.get(asked, ABSENT)
    corner = part.mesh.corner[part.chosen][:, order]
    return answer[corner] if len(answer) > 1 else np.broadcast_to(answer, (*corner.shape, answer.shape[1]))


def _widened(values: Float32 | Float64, width: int) -> Float32 | Float64:
    """Values (K, 3, C) as (K, 3, width): numbers become grey, what has no alpha is opaque."""
    if values.shape[2] == width:
        return values
    color = np.broadcast_to(values, (*values.shape[:2], 3))
    return np.concatenate([color, np.ones_like(color[:, :, :1])], axis=2)


def _joined(parts: Iterable[Float32 | Float64]) -> Float32:
    return np.concatenate([part.reshape(-1) for part in parts]).astype(np.float32)
