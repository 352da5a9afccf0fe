# SPDX-License-Identifier: GPL-3.0-or-later
"""How surfaces look, told by Cycles: it bakes their shaders, whatever they are made of, onto pages.

All surfaces of a page are joined into one mesh of a scene made for the moment, and are baked in one go at one sample a
texel: baking object by object takes a whole scene's preparation for each. What trees ask of their objects goes along as
attributes. Nothing of the user's is touched, and nothing of ours is left.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..arrays import Bools, Float32, Float64, Int64
from ..errors import SceneError
from ..lightmap import grow
from ..scene import Mesh
from ..shading import Layout, Quantity
from .blend_files import silence
from .evaluation import quiet_handlers
from .extract import Extraction
from .look_materials import LookMaterials
from .surface_inputs import ABSENT, Input, SurfaceInputs

LAYOUT_UV = "radiosity layout"

BAKE_HANDLERS = ("object_bake_pre", "object_bake_complete", "object_bake_cancel")

GROWTH = 3
"""Texels by which what was baked is continued beside charts."""

FLAT = 1e-6
"""Corner normals of a polygon that is shaded flat are this much alike."""

AROUND = np.array([[-0.45, -0.3], [0.45, -0.3], [0.0, 0.6]])
"""Corners, in texels, of a triangle about the centre of a texel that covers no other's."""


@dataclass(frozen=True, eq=False)
class _Part:
    """Triangles of one mesh that are to be baked.

    Attributes:
        index: of the mesh in the extracted scene
        chosen: (K,) which of its triangles
        uv: (K, 3, 2) float64, 0 to 1 of the page
    """

    index: int
    mesh: Mesh
    surface: SurfaceInputs
    chosen: Int64
    uv: Float64


class CyclesShader:
    """Answers for the surfaces that were extracted; see shading.Shader."""

    def __init__(self, scene: bpy.types.Scene, extraction: Extraction) -> None:
        """Args:
        scene: that was extracted
        extraction: what was read from it
        """
        self.scene_name = scene.name
        self.extraction = extraction

    def __call__(self, layout: Layout, meshes: Bools, quantity: Quantity) -> Float32:
        """Colours (page_count, size, size, 3), as Cycles has them.

        Raises:
            SceneError: the scene or a material is gone, or Cycles is disabled
        """
        records = self.extraction.scene.materials
        varies = np.array([quantity in record.varies for record in records])
        parts: list[list[_Part]] = [[] for _ in range(layout.page_count)]
        for index, mesh in enumerate(self.extraction.scene.meshes):
            chosen = np.flatnonzero(varies[mesh.material]) if meshes[index] and layout.page[index] >= 0 else ()
            if len(chosen):
                uv = layout.uv[index][chosen].astype(np.float64)
                parts[layout.page[index]].append(_Part(index, mesh, self.extraction.surfaces[index], chosen, uv))
        pages = np.zeros((layout.page_count, layout.size, layout.size, 3), np.float32)
        asked = sorted({asked for page in parts for part in page for asked in part.surface.values})
        studio = _Studio(self.extraction.materials, LookMaterials(quantity, asked))
        with studio.opened(self.scene_name):
            for page, on_page in zip(pages, parts, strict=True):
                if on_page:
                    page[:] = _page(studio, on_page, layout.size)
        return pages


def _page(studio: _Studio, parts: Sequence[_Part], size: int) -> Float32:
    """One page (size, size, 3); surfaces too small to cover the centre of a texel are baked once more, magnified."""
    colors, known = studio.bake(parts, size)
    places = [np.clip((part.uv.mean(1) * size).astype(np.int64), 0, size - 1) for part in parts]
    lost = [~known[place[:, 1], place[:, 0]] for place in places]
    count = sum(int(np.count_nonzero(some)) for some in lost)
    if count:
        side = max(math.ceil(math.sqrt(count)), 4)
        cell = np.stack([np.arange(count) % side, np.arange(count) // side], axis=1)
        uv = (cell[:, None] + 0.5 + AROUND) / side
        firsts = np.cumsum([0, *(np.count_nonzero(some) for some in lost)])
        magnified = [
            replace(part, chosen=part.chosen[some], uv=uv[first : first + np.count_nonzero(some)])
            for part, some, first in zip(parts, lost, firsts, strict=False)
            if some.any()
        ]
        shown, _ = studio.bake(magnified, side)
        x, y = np.concatenate([place[some] for place, some in zip(places, lost, strict=True)]).T
        colors[y, x] = shown[cell[:, 1], cell[:, 0]]
        known[y, x] = True
    for _ in range(GROWTH):
        grow(colors, known)
    return colors


class _Studio:
    """A scene for the moment in which parts are baked."""

    def __init__(self, names: Sequence[str], materials: LookMaterials) -> None:
        """Args:
        names: full name of each of the records' materials
        materials: the copies to bake
        """
        self.names = names
        self.materials = materials
        self.scene: bpy.types.Scene | None = None

    @contextmanager
    def opened(self, scene_name: str) -> Iterator[None]:
        """Within, parts can be baked as the user's scene of this name shows them."""
        user = bpy.data.scenes.get(scene_name)
        if user is None:
            raise SceneError(scene_name, "the scene was renamed or deleted during the bake", "Bake again")
        self.scene = bpy.data.scenes.new("Radiosity")
        try:
            _set_up(self.scene, user)
            yield
        finally:
            bpy.data.scenes.remove(self.scene)
            self.materials.remove()

    def bake(self, parts: Sequence[_Part], size: int) -> tuple[Float32, Bools]:
        """Colours (size, size, 3) of the texels whose centres the parts cover, and which those are."""
        image = bpy.data.images.new("Radiosity", size, size, alpha=True, float_buffer=True, is_data=True)
        try:
            image.pixels.foreach_set(np.zeros(size * size * 4, np.float32))
            together = [part for part in parts if not part.surface.apart]
            if together:
                self._bake_object(together, image, np.eye(4))
            for part in parts:
                if part.surface.apart:
                    self._bake_object([part], image, part.surface.matrix)
            pixels = np.empty(size * size * 4, np.float32)
            image.pixels.foreach_get(pixels)
        finally:
            bpy.data.images.remove(image)
        pixels = pixels.reshape(size, size, 4)
        return np.ascontiguousarray(pixels[:, :, :3]), pixels[:, :, 3] > 0

    def _bake_object(self, parts: Sequence[_Part], image: bpy.types.Image, matrix: Float64) -> None:
        mesh = bpy.data.meshes.new("Radiosity")
        try:
            self._fill(mesh, parts, matrix)
            thing = bpy.data.objects.new("Radiosity", mesh)
            thing.matrix_world = matrix.T
            self.scene.collection.objects.link(thing)
            self.materials.aim(image)
            layer = self.scene.view_layers[0]
            layer.update()
            shown = {"scene": self.scene, "view_layer": layer, "object": thing, "active_object": thing}
            with silence(), quiet_handlers(BAKE_HANDLERS), bpy.context.temp_override(**shown, selected_objects=[thing]):
                bpy.ops.object.bake(
                    "EXEC_DEFAULT", type="EMIT", target="IMAGE_TEXTURES", save_mode="INTERNAL", margin=0,
                    uv_layer=LAYOUT_UV, use_clear=False, use_selected_to_active=False, use_split_materials=False,
                )  # fmt: skip
        finally:
            bpy.data.meshes.remove(mesh)  # takes its object along

    def _fill(self, mesh: bpy.types.Mesh, parts: Sequence[_Part], matrix: Float64) -> None:
        """Join parts in a mesh; `matrix` is that of its object."""
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
        used, slots = np.unique(
            np.concatenate([part.mesh.material[part.chosen] for part in parts]), return_inverse=True
        )
        for index in used:
            mesh.materials.append(self.materials.of(self._material(self.names[index])))
        mesh.polygons.foreach_set("material_index", slots.reshape(-1).astype(np.int32))
        if parts[0].surface.edges is not None:
            mesh.edges.add(len(parts[0].surface.edges))
            mesh.edges.foreach_set("vertices", parts[0].surface.edges.ravel())
        mesh.update()
        layer = mesh.uv_layers.new(name=LAYOUT_UV, do_init=False)
        layer.uv.foreach_set("vector", _joined(part.uv[:, order] for part in parts))
        normals = _joined(_normals(part)[:, order] @ matrix[:3, :3] for part in parts)
        if bpy.app.version >= (5, 0):
            mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER").data.foreach_set("vector", normals)
        elif parts[0].surface.edges is None:  # this would change the edges, which tell islands
            mesh.normals_split_custom_set(normals.reshape(-1, 3))
        for asked, name in self.materials.names.items():
            answers = [_answer(part, asked, order) for part in parts]
            width = max(answer.shape[2] for answer in answers)
            attribute = mesh.attributes.new(name, "FLOAT" if width == 1 else "FLOAT_COLOR", "CORNER")
            values = _joined(_widened(answer, width) for answer in answers)
            attribute.data.foreach_set("value" if width == 1 else "color", values)

    @staticmethod
    def _material(name: str) -> bpy.types.Material:
        found = next((material for material in bpy.data.materials if material.name_full == name), None)
        if found is None:
            raise SceneError(f"Material {name!r}", "was renamed or deleted during the bake", "Bake again")
        return found


def _normals(part: _Part) -> Float64:
    """Shading normals (K, 3, 3) in world space; of flat polygons those of each triangle, as Cycles has them."""
    smooth = part.mesh.corner_normals[part.chosen].astype(np.float64)
    corners = part.mesh.vertices[part.mesh.triangles[part.chosen]]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cross /= np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-300)
    flat = (np.abs(smooth - smooth[:, :1]) < FLAT).all((1, 2))
    return np.where(flat[:, None, None], cross[:, None], smooth)


def _answer(part: _Part, asked: Input, order: list[int]) -> Float32:
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


def _set_up(scene: bpy.types.Scene, user: bpy.types.Scene) -> None:
    """One sample at the centre of each texel, at the user's moment and camera."""
    try:
        scene.render.engine = "CYCLES"
    except TypeError as error:
        raise SceneError(
            "Cycles", "it is disabled, and no one else can tell how materials look", "Enable it in the preferences"
        ) from error
    scene.cycles.device = "CPU"
    scene.cycles.samples, scene.cycles.max_bounces = 1, 0
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = scene.cycles.use_auto_tile = False
    scene.frame_current, scene.frame_subframe = user.frame_current, user.frame_subframe
    scene.camera = user.camera
