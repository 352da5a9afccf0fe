# SPDX-License-Identifier: GPL-3.0-or-later
"""A baked scene set up anew for an exporter, in a scene of its own: plain objects with the user's materials.

Nothing of the user's is touched. Every object and instance that a render shows becomes an object at its place in the
world, modifiers applied; its first uv map is the user's, the second the lightmap's. A mesh that several share stays
shared: where each of them lies on its page is told by its materials.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

from ...arrays import Float32, Float64
from ...chunks import finish
from ...errors import SceneError
from ..data.evaluation import at_render_settings
from ..data.instances import is_instance
from ..data.names import BACK_PAGE_KEY, BACK_UV_MAP, BAKE_KEY, PAGE_KEY, PLACE_KEY, STAND_IN_KEY, UV_MAP
from ..data.spline_meshes import is_bare_tube
from ..data.stand_in import MeshPool, dress, materials_of
from ..writing.revert import take_out
from .pbr_materials import LitBy, PbrMaterials

FIRST_UV_MAP = "UVMap"
"""What an object's first uv map is called that had none: it is the lightmap's, for readers that want a first one."""
SHEAR = 1e-4
"""Cosine between two axes from which on a matrix has a shear, which a glTF node can't have."""


@dataclass(frozen=True, eq=False)
class Part:
    """An object of the set.

    Attributes:
        thing: in the set's scene
        name: of the user's object that it shows
        lit_by: where its light lies, None if it has no lightmap
        uv_map: that places it, of the carrier
        carrier: the object of the user's scene that has the uv map: itself or a stand-in
        matrix: (4, 4) float64, where it stands
    """

    thing: bpy.types.Object
    name: str
    lit_by: LitBy | None = None
    uv_map: str = UV_MAP
    carrier: bpy.types.Object | None = None
    matrix: Float64 | None = None


@dataclass(frozen=True, eq=False)
class LitSet:
    """What was set up: the name of the user's scene, and in a scene of its own objects and their materials."""

    name: str
    scene: bpy.types.Scene
    parts: list[Part]
    materials: PbrMaterials


@contextmanager
def lit_set(scene: bpy.types.Scene) -> Iterator[LitSet]:
    """Set a baked scene up for an exporter; afterwards all of the set is gone again.

    Raises:
        SceneError: a baked object has lost its uv map
    """
    token = uuid.uuid4().hex
    stage = bpy.data.scenes.new(scene.name)
    try:
        render, seen_by = stage.render, scene.render
        render.resolution_x, render.resolution_y = seen_by.resolution_x, seen_by.resolution_y
        render.pixel_aspect_x, render.pixel_aspect_y = seen_by.pixel_aspect_x, seen_by.pixel_aspect_y
        materials = PbrMaterials(token)
        with at_render_settings(scene) as depsgraph:
            parts = _Building(scene, depsgraph, token, materials).build()
        for part in parts:
            stage.collection.objects.link(part.thing)
        yield LitSet(scene.name, stage, parts, materials)
    finally:
        bpy.data.scenes.remove(stage)
        take_out(token)


class _Building:
    """One walk over all that is rendered."""

    def __init__(
        self, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, token: str, materials: PbrMaterials
    ) -> None:
        self.depsgraph = depsgraph
        self.bake = scene.get(BAKE_KEY)
        self.cameras = {thing.name for thing in scene.objects if thing.type == "CAMERA"}  # not one for the moment
        self.token = token
        self.materials = materials
        self.pool = MeshPool(depsgraph, token)
        self._laid: dict[tuple[str, str], bpy.types.Mesh] = {}

    def build(self) -> list[Part]:
        """The parts, in no scene yet."""
        parts = []
        for item in self.depsgraph.object_instances:
            thing = item.object
            if not item.show_self:
                continue
            if thing.type == "CAMERA" and not is_instance(item) and thing.original.name in self.cameras:
                camera = self._placed(thing.original, thing.original.data, item.matrix_world)
                parts.append(Part(camera, thing.original.name))
            elif self._has_faces(thing) and thing.visible_camera:
                parts += self._surface(item)
        return parts

    def _has_faces(self, thing: bpy.types.Object) -> bool:
        return (thing.type == "MESH" and len(thing.data.polygons) > 0) or is_bare_tube(thing.original, self.depsgraph)

    def _surface(self, item: bpy.types.DepsgraphObjectInstance) -> list[Part]:
        thing, original = item.object, item.object.original
        source = original.get(STAND_IN_KEY) or original
        mesh = finish(self.pool.of(thing, None))
        if original.get(BAKE_KEY) != self.bake or PAGE_KEY not in original:
            return [self._dressed(item, mesh, source)]
        back, place = original.get(BACK_PAGE_KEY), original.get(PLACE_KEY)
        place = None if place is None else tuple(place)
        sides = [(UV_MAP, LitBy(original[PAGE_KEY], place, "both" if back is None else "front"))]
        if back is not None:
            sides.append((BACK_UV_MAP, LitBy(back, None, "back")))
        return [
            self._dressed(item, self._with_lightmap(mesh, uv_map, source.name), source, lit_by, uv_map)
            for uv_map, lit_by in sides
        ]

    def _dressed(
        self,
        item: bpy.types.DepsgraphObjectInstance,
        mesh: bpy.types.Mesh,
        source: bpy.types.Object,
        lit_by: LitBy | None = None,
        uv_map: str = UV_MAP,
    ) -> Part:
        matrix = item.matrix_world.copy()
        stands = np.array(matrix, np.float64)
        if _is_sheared(matrix):
            mesh, matrix = _moved(mesh, matrix), Matrix()
        if not mesh.materials:
            mesh.materials.append(None)
        thing = self._placed(source, mesh, matrix)
        dress(thing, [self.materials.of(worn, lit_by) for worn in materials_of(item.object) or [None]])
        return Part(thing, source.name, lit_by, uv_map, item.object.original, stands)

    def _placed(self, source: bpy.types.Object, data: bpy.types.ID, matrix: Matrix) -> bpy.types.Object:
        thing = bpy.data.objects.new(source.name, data)
        thing[BAKE_KEY], thing[STAND_IN_KEY] = self.token, source
        thing.matrix_world = matrix
        return thing

    def _with_lightmap(self, mesh: bpy.types.Mesh, uv_map: str, name: str) -> bpy.types.Mesh:
        """A mesh whose second uv map is the lightmap's; for backs it is turned over."""
        key = (mesh.name, uv_map)
        if key not in self._laid:
            if uv_map not in mesh.uv_layers:
                raise SceneError(name, f"its uv map {uv_map!r} is gone", "Bake again")
            laid = self._laid[key] = mesh.copy()
            order_uv_maps(laid, uv_map)
            if uv_map == BACK_UV_MAP:
                laid.flip_normals()
        return self._laid[key]


def order_uv_maps(mesh: bpy.types.Mesh, lightmap: str) -> None:
    """Make a lightmap's uv map the second of a mesh, and the user's rendered one, or else the lightmap, the first."""
    ours = (UV_MAP, BACK_UV_MAP)
    own = [layer.name for layer in mesh.uv_layers if layer.name not in ours]
    first = next((layer.name for layer in mesh.uv_layers if layer.active_render and layer.name in own), None)
    first = first or next(iter(own), FIRST_UV_MAP)
    order = [first, lightmap, *(name for name in own if name != first)]
    kept = {layer.name: _uv_of(layer) for layer in mesh.uv_layers}
    while mesh.uv_layers:
        mesh.uv_layers.remove(mesh.uv_layers[0])
    for name in order:
        layer = mesh.uv_layers.new(name=name, do_init=False)
        layer.uv.foreach_set("vector", kept.get(name, kept[lightmap]))
    mesh.uv_layers.active_index = 0
    mesh.uv_layers[0].active_render = True


def _uv_of(layer: bpy.types.MeshUVLoopLayer) -> Float32:
    uv = np.empty(2 * len(layer.uv), np.float32)
    layer.uv.foreach_get("vector", uv)
    return uv


def _is_sheared(matrix: Matrix) -> bool:
    axes = np.array(matrix, np.float64)[:3, :3]
    axes /= np.maximum(np.linalg.norm(axes, axis=0), 1e-30)
    return bool(np.abs(axes.T @ axes - np.diag(np.diag(axes.T @ axes))).max() > SHEAR)


def _moved(mesh: bpy.types.Mesh, matrix: Matrix) -> bpy.types.Mesh:
    """A copy of a mesh in world space."""
    moved = mesh.copy()
    moved.transform(matrix)
    if matrix.is_negative:
        moved.flip_normals()
    return moved
