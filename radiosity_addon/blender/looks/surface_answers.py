# SPDX-License-Identifier: GPL-3.0-or-later
"""What rendered surfaces answer to the node trees of their materials, as Cycles does (its folder blender/)."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping
from dataclasses import dataclass

import bpy
import numpy as np

from ...arrays import Float32, Float64, Int32
from ..data.instances import attribute_of
from ..data.shapes import slots_of
from .surface_inputs import Asking, Input

ABSENT = np.zeros((1, 1), np.float32)
"""What a surface answers that does not have what is asked for, as Cycles takes it."""


OF_MESHES = ("generated", "object", "uv", "attribute", "colour attribute")
"""What has nothing to do with the object that shows a mesh."""


@dataclass(frozen=True, eq=False)
class SurfaceAnswers:
    """What a surface answers to the trees of its materials.

    Attributes:
        values: (L, C) float32 by loop of the evaluated mesh, or (1, C) all over; C is 1, or 4 for colours and vectors
        matrix: (4, 4) of the object or instance
        apart: must be shaded as an object of its own
        edges: (E, 2) int32, vertices, where trees tell islands by them
    """

    values: Mapping[Input, Float32]
    matrix: Float64
    apart: bool
    edges: Int32 | None

    @classmethod
    def of(
        cls,
        tree_asks: Iterable[Asking],
        item: bpy.types.DepsgraphObjectInstance,
        mesh: bpy.types.Mesh,
        depsgraph: bpy.types.Depsgraph,
        kept: dict[Input, Float32],
    ) -> Generator[None, None, SurfaceAnswers]:
        """What a rendered surface answers, in steps; what it does not have is 0, as Cycles takes it.

        Args:
            kept: answers of the mesh, the same for all that show it; new ones are added
        """
        wanted = frozenset().union(*(asks.inputs for asks in tree_asks))
        islands = any(asks.islands for asks in tree_asks)
        values = {asked: kept.get(asked) for asked in wanted}
        for asked in [asked for asked in wanted if values[asked] is None]:
            values[asked] = _read(asked, item, mesh, depsgraph)
            if asked.kind in OF_MESHES:
                kept[asked] = values[asked]
            yield
        return cls(
            values=values,
            matrix=np.array(item.matrix_world, np.float64),
            apart=islands or any(asks.own_space for asks in tree_asks),
            edges=_get(mesh.edges, "vertices", 2, np.int32) if islands else None,
        )


def _read(
    asked: Input, item: bpy.types.DepsgraphObjectInstance, mesh: bpy.types.Mesh, depsgraph: bpy.types.Depsgraph
) -> Float32:
    thing = item.object
    match asked.kind:
        case "generated":
            return _at_loops(mesh, _generated(mesh))
        case "object":
            return _at_loops(mesh, _get(mesh.vertices, "co", 3))
        case "normal":
            return ABSENT  # the joined mesh's own, turned back
        case "uv":
            return _uv(mesh, asked.name)
        case "attribute":
            return _attribute_values(mesh, asked.name)
        case "colour attribute":
            layers = mesh.color_attributes
            shown = layers.render_color_index
            active = layers[shown].name if 0 <= shown < len(layers) else ""
            return _attribute_values(mesh, asked.name or active)
        case "object property":
            return _property(asked.name, thing, thing.data)
        case "instancer property":
            values = attribute_of(item, asked.name) if item.is_instance else None
            if values is not None:
                return _everywhere(*values)
            owners = (item.parent, item.parent.data) if item.is_instance else ()
            return _property(asked.name, *owners, thing, thing.data)
        case "layer property":
            return _property(asked.name, depsgraph.view_layer_eval, depsgraph.scene_eval, depsgraph.scene_eval.world)
        case "location":
            return _everywhere(*item.matrix_world.translation)
        case "colour":
            return _everywhere(*thing.color)
        case "index":
            return _everywhere(thing.pass_index)
        case "material index":
            slots = [material.pass_index if material else 0 for material in slots_of(thing)] or [0]
            index = np.minimum(_get(mesh.polygons, "material_index", 1, np.int32)[:, 0], len(slots) - 1)
            return np.repeat(np.float32(slots)[index], _corners(mesh))[:, None]
        case "random":
            seed = item.random_id & 0xFFFFFFFF if item.is_instance else _hash_pair(_hash_text(thing.name), 0)
            return _everywhere(np.float32(seed) * np.float32(1 / 0xFFFFFFFF))
        case "instancer generated":
            return _everywhere(*(0.5 * x - 0.5 for x in item.orco)) if item.is_instance else _everywhere(0, 0, 0)
        case "instancer uv":
            return _everywhere(*item.uv, 0) if item.is_instance else _everywhere(0, 0, 0)


def _everywhere(*values: float) -> Float32:
    return _padded(np.array([values], np.float32))


def _padded(values: Float32) -> Float32:
    """Values (K, C) as numbers (K, 1) or as colours (K, 4)."""
    if values.shape[1] in (1, 4):
        return values
    result = np.zeros((len(values), 4), np.float32)
    result[:, : values.shape[1]] = values
    result[:, 3] = 1
    return result


def _get(items: bpy.types.bpy_prop_collection, name: str, width: int, dtype: type = np.float32) -> Float32 | Int32:
    values = np.empty(len(items) * width, dtype)
    items.foreach_get(name, values)
    return values.reshape(-1, width)


def _corners(mesh: bpy.types.Mesh) -> Int32:
    return _get(mesh.polygons, "loop_total", 1, np.int32)[:, 0]


def _at_loops(mesh: bpy.types.Mesh, at_vertices: Float32) -> Float32:
    return _padded(at_vertices[_get(mesh.loops, "vertex_index", 1, np.int32)[:, 0]])


def _generated(mesh: bpy.types.Mesh) -> Float32:
    """Texture space before deformation, 0 to 1 over the mesh's box unless that is set otherwise."""
    shown = mesh.texco_mesh or mesh
    location, size = np.float32(shown.texspace_location), np.float32(shown.texspace_size)
    size = np.where(size == 0, 1, size)
    return (_get(mesh.vertices, "undeformed_co", 3) - (location - size)) / (2 * size)


def _uv(mesh: bpy.types.Mesh, name: str) -> Float32:
    layers = mesh.uv_layers
    layer = layers.get(name) if name else next((layer for layer in layers if layer.active_render), None)
    return _everywhere(0, 0, 0) if layer is None else _padded(_get(layer.uv, "vector", 2))


FIELDS = {
    "FLOAT": ("value", 1),
    "INT": ("value", 1),
    "INT8": ("value", 1),
    "BOOLEAN": ("value", 1),
    "FLOAT2": ("vector", 2),
    "FLOAT_VECTOR": ("vector", 3),
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color", 4),
    "QUATERNION": ("value", 4),
}
"""Where attributes of each type hold their numbers, and how many."""


def _attribute_values(mesh: bpy.types.Mesh, name: str) -> Float32:
    attribute = mesh.attributes.get(name) if name else None
    if attribute is None or attribute.data_type not in FIELDS or not len(attribute.data):
        return ABSENT
    field, width = FIELDS[attribute.data_type]
    dtype = {"INT": np.int32, "INT8": np.int32, "BOOLEAN": bool}.get(attribute.data_type, np.float32)
    values = _padded(_get(attribute.data, field, width, dtype).astype(np.float32))
    match attribute.domain:
        case "POINT":
            return _at_loops(mesh, values)
        case "FACE":
            return np.repeat(values, _corners(mesh), axis=0)
        case "EDGE":
            return _at_loops(mesh, _edge_means(mesh, values))
    return values


def _edge_means(mesh: bpy.types.Mesh, values: Float32) -> Float32:
    """Values of edges (E, C) as means at vertices."""
    ends = _get(mesh.edges, "vertices", 2, np.int32)
    count = np.maximum(np.bincount(ends.ravel(), minlength=len(mesh.vertices)), 1)
    columns = [np.bincount(ends.ravel(), np.repeat(column, 2), len(mesh.vertices)) / count for column in values.T]
    return np.stack(columns, axis=1).astype(np.float32)


def _property(name: str, *owners: bpy.types.bpy_struct | None) -> Float32:
    """A custom property or a property of Blender's own by its path, of the first owner that has it."""
    for owner in owners:
        if owner is None:
            continue
        value = owner.get(name)
        if value is None:
            try:
                value = owner.path_resolve(name)
            except (ValueError, AttributeError):
                continue
        if isinstance(value, (int, float)):
            return _everywhere(value)
        if hasattr(value, "__len__") and not isinstance(value, (str, bytes)) and 2 <= len(value) <= 4:
            return _everywhere(*value)
    return ABSENT


def _hash_text(text: str) -> int:
    """Cycles' hash of a name (util/hash.h, hash_string)."""
    value = 0
    for byte in text.encode():
        value = (value * 37 + byte) & 0xFFFFFFFF
    return value


def _hash_pair(first: int, second: int) -> int:
    """Cycles' hash of two numbers (util/hash.h, hash_uint2), the last step of Jenkins' lookup3 (2006)."""
    mask = 0xFFFFFFFF
    start = (0xDEADBEEF + (2 << 2) + 13) & mask
    a, b, c = (start + first) & mask, (start + second) & mask, start

    def turned(x: int, bits: int) -> int:
        return ((x << bits) | (x >> (32 - bits))) & mask

    c = ((c ^ b) - turned(b, 14)) & mask
    a = ((a ^ c) - turned(c, 11)) & mask
    b = ((b ^ a) - turned(a, 25)) & mask
    c = ((c ^ b) - turned(b, 16)) & mask
    a = ((a ^ c) - turned(c, 4)) & mask
    b = ((b ^ a) - turned(a, 14)) & mask
    return ((c ^ b) - turned(b, 24)) & mask
