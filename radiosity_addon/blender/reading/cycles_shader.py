# SPDX-License-Identifier: GPL-3.0-or-later
"""How surfaces look, told by Cycles: it bakes their shaders, whatever they are made of, onto pages.

All surfaces of a page are joined into one mesh of a scene made for the moment, and are baked in one go at one sample a
texel: baking object by object takes a whole scene's preparation for each. What trees ask of their objects goes along as
attributes. Nothing of the user's is touched, and nothing of ours is left.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import bpy
import numpy as np

from ...arrays import Bools, Float32, Float64, Int64
from ...errors import SceneError
from ...pages.lightmap import grow
from ...shading import Layout, Quantity
from ..data.blend_files import silence
from ..data.evaluation import quiet_handlers
from .cycles import Cycles
from .extraction import Extraction
from .joined_mesh import LAYOUT_UV, Part, join
from .look_materials import LookMaterials
from .subject import Subject, named

BAKE_HANDLERS = ("object_bake_pre", "object_bake_complete", "object_bake_cancel")

GROWTH = 3
"""Texels by which what was baked is continued beside charts."""

AROUND = np.array([[-0.45, -0.3], [0.45, -0.3], [0.0, 0.6]])
"""Corners, in texels, of a triangle about the centre of a texel that covers no other's."""


class CyclesShader:
    """Answers for the surfaces that were extracted; see shading.Shader."""

    def __init__(self, scene_name: str, extraction: Extraction, cycles: Cycles | None = None) -> None:
        """Args:
        scene_name: of the scene that was extracted
        extraction: what was read from it
        cycles: is asked
        """
        self.scene_name = scene_name
        self.extraction = extraction
        self.cycles = cycles or Cycles()

    def __call__(self, layout: Layout, meshes: Bools, quantity: Quantity, behind: bool = False) -> Float32:
        """Colours (page_count, size, size, 3), as Cycles has them.

        Raises:
            SceneError: the scene or a material is gone, or Cycles is disabled
        """
        records = self.extraction.scene.materials
        varies = np.array([quantity in record.varies and (record.back is not None or not behind) for record in records])
        parts: list[list[Part]] = [[] for _ in range(layout.page_count)]
        for index, mesh in enumerate(self.extraction.scene.meshes):
            chosen = np.flatnonzero(varies[mesh.material]) if meshes[index] and layout.page[index] >= 0 else ()
            if len(chosen):
                uv = layout.uv[index][chosen].astype(np.float64)
                shown = replace(mesh, uv=None, chart=None, flat=None)
                parts[layout.page[index]].append(Part(shown, self.extraction.surfaces[index], chosen, uv))
        used = sorted(
            {int(index) for page in parts for part in page for index in np.unique(part.mesh.material[part.chosen])}
        )
        return self.cycles.ask(partial(self._subject, used), bake_looks, parts, layout.size, quantity, behind)

    def _subject(self, used: Sequence[int]) -> Subject:
        """The materials of these records, and the camera, which they may ask for."""
        scene = named(bpy.data.scenes, self.scene_name, "Scene")
        materials = {
            str(index): named(bpy.data.materials, self.extraction.materials[index], "Material") for index in used
        }
        return Subject.of(scene, {"camera": scene.camera, **materials})


def bake_looks(
    subject: Subject, parts: Sequence[Sequence[Part]], size: int, quantity: Quantity, behind: bool
) -> Generator[None, None, Float32]:
    """How surfaces look, (page_count, size, size, 3), one bake after the other.

    Until the end nothing else may change the file.

    Args:
        subject: "camera", and the records' materials by their indices
        parts: on each page
        size: texels along the edge of a page
        quantity: what is wanted
        behind: of the backs

    Raises:
        SceneError: Cycles is disabled
    """
    pages = np.zeros((len(parts), size, size, 3), np.float32)
    asked = sorted({asked for page in parts for part in page for asked in part.surface.values})
    studio = _Studio(subject, LookMaterials(quantity, asked, behind))
    with studio.opened():
        for page, on_page in zip(pages, parts, strict=True):
            if on_page:
                page[:] = yield from _page(studio, on_page, size)
    return pages


def _page(studio: _Studio, parts: Sequence[Part], size: int) -> Generator[None, None, Float32]:
    """One page (size, size, 3); surfaces too small to cover the centre of a texel are baked once more, magnified."""
    colors, known = yield from studio.bake(parts, size)
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
        shown, _ = yield from studio.bake(magnified, side)
        x, y = np.concatenate([place[some] for place, some in zip(places, lost, strict=True)]).T
        colors[y, x] = shown[cell[:, 1], cell[:, 0]]
        known[y, x] = True
    for _ in range(GROWTH):
        grow(colors, known)
    return colors


class _Studio:
    """A scene for the moment in which parts are baked."""

    def __init__(self, subject: Subject, materials: LookMaterials) -> None:
        """Args:
        subject: what is to be seen
        materials: the copies to bake
        """
        self.subject = subject
        self.materials = materials
        self.scene: bpy.types.Scene | None = None

    @contextmanager
    def opened(self) -> Iterator[None]:
        """Within, parts can be baked."""
        self.scene = bpy.data.scenes.new("Radiosity")
        try:
            _set_up(self.scene)
            self.subject.pose(self.scene)
            self.scene.camera = self.subject.datablocks.get("camera")
            yield
        finally:
            bpy.data.scenes.remove(self.scene)
            self.materials.remove()

    def bake(self, parts: Sequence[Part], size: int) -> Generator[None, None, tuple[Float32, Bools]]:
        """Colours (size, size, 3) of the texels whose centres the parts cover, and which those are."""
        colors, known = np.zeros((size, size, 3), np.float32), np.zeros((size, size), bool)
        together = [part for part in parts if not part.surface.apart]
        for group in filter(None, [together, *([part] for part in parts if part.surface.apart)]):
            corners = np.concatenate([part.uv.reshape(-1, 2) for part in group]) * size
            low = np.clip(np.floor(corners.min(0)), 0, size - 1).astype(int)
            high = np.clip(np.ceil(corners.max(0)), low + 1, size).astype(int)
            shown = self._bake_window(group, size, low, high - low)
            window = slice(low[1], high[1]), slice(low[0], high[0])
            there = shown[:, :, 3] > 0
            colors[window][there] = shown[there, :3]
            known[window] |= there
            yield
        return colors, known

    def _bake_window(self, parts: Sequence[Part], size: int, low: Int64, extent: Int64) -> Float32:
        """Part of a page, (height, width, 4), with alpha where texels are covered: each object needs its own time."""
        image = bpy.data.images.new("Radiosity", *map(int, extent), alpha=True, float_buffer=True, is_data=True)
        mesh = bpy.data.meshes.new("Radiosity")
        try:
            pixels = np.zeros((extent[1], extent[0], 4), np.float32)
            image.pixels.foreach_set(pixels.ravel())
            matrix = parts[0].surface.matrix if parts[0].surface.apart else np.eye(4)
            placed = [replace(part, uv=(part.uv * size - low) / extent) for part in parts]
            used = join(mesh, placed, matrix, self.materials.names)
            for index in used:
                mesh.materials.append(self.materials.of(self.subject.datablocks[str(index)]))
            self.materials.aim(image)
            bake_mesh(self.scene, mesh, matrix, type="EMIT", uv_layer=LAYOUT_UV)
            image.pixels.foreach_get(pixels.ravel())
            return pixels
        finally:
            bpy.data.meshes.remove(mesh)  # takes its object along
            bpy.data.images.remove(image)


def _set_up(scene: bpy.types.Scene) -> None:
    """One sample at the centre of each texel."""
    try:
        scene.render.engine = "CYCLES"
    except TypeError as error:
        raise SceneError(
            "Cycles", "it is disabled, and no one else can tell how materials look", "Enable it in the preferences"
        ) from error
    scene.cycles.device = "CPU"
    scene.cycles.samples, scene.cycles.max_bounces = 1, 0
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = scene.cycles.use_auto_tile = False


def bake_mesh(scene: bpy.types.Scene, mesh: bpy.types.Mesh, matrix: Float64, **wanted: object) -> None:
    """Have Cycles bake a mesh onto its materials' active images, as an object that goes when the mesh does.

    Args:
        matrix: (4, 4) the object's, in the world
        wanted: of Blender's operator: type, passes, uv map
    """
    thing = bpy.data.objects.new("Radiosity", mesh)
    thing.matrix_world = matrix.T
    scene.collection.objects.link(thing)
    layer = scene.view_layers[0]
    layer.update()
    shown = {"scene": scene, "view_layer": layer, "object": thing, "active_object": thing}
    with silence(), quiet_handlers(BAKE_HANDLERS), bpy.context.temp_override(**shown, selected_objects=[thing]):
        bpy.ops.object.bake(
            "EXEC_DEFAULT", target="IMAGE_TEXTURES", save_mode="INTERNAL", margin=0, use_clear=False,
            use_selected_to_active=False, use_split_materials=False, **wanted,
        )  # fmt: skip
