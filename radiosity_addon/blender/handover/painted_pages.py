# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours that node trees compute, painted by Cycles onto pages laid out as those of the light, for a hand-over."""

from __future__ import annotations

from collections import defaultdict

import bpy
import numpy as np

from ...arrays import Float32, Float64
from ...errors import SceneError
from ...scene import Mesh
from ...shading import Layout, Quantity
from ..data.names import UV_MAP
from ..reading.cycles_shader import CyclesShader
from ..reading.extract import extract_scene
from ..reading.extraction import Source
from .lit_set import LitSet, Part

FINER = 4
"""Colours change faster than light: so many of their texels lie along one of the light's,"""
FINE_ENOUGH = 2048
"""but no more than these along a page's edge, unless the light's are more."""


def paint(scene: bpy.types.Scene, lit: LitSet, page_count: int, size: int) -> dict[Quantity, list[Float32]]:
    """What materials of a set ask to have painted: for each quantity its pages, (S, S, 3), row 0 at v = 0.

    The pages are in the working space, and black where no such material is.

    Args:
        scene: that the set was made of
        lit: the set
        page_count: pages of the light
        size: texels along the edges of those

    Raises:
        SceneError: an object was changed since the bake
    """
    wanted = sorted(set().union(*lit.materials.painted.values()))
    if not wanted:
        return {}
    extraction = extract_scene(scene)
    placed = _Placed(lit)
    meshes = extraction.scene.meshes
    parts = [placed.part_of(source) if meshes[source.mesh].lightmapped else None for source in extraction.sources]
    gone = {part.name for part in lit.parts if _is_painted(part, lit)} - {part.name for part in parts if part}
    if gone:
        raise SceneError(min(gone), "it was left out of the bake's reach since", "Bake again")
    uv = tuple(_uv_at(part, mesh) for part, mesh in zip(parts, meshes, strict=True))
    page = np.array([-1 if part is None else part.lit_by.page for part in parts], np.int32)
    layout = Layout(max(size, min(FINER * size, FINE_ENOUGH)), page_count, page, uv)
    shader = CyclesShader(scene.name, extraction)
    return {quantity: list(shader(layout, page >= 0, quantity)) for quantity in wanted}


class _Placed:
    """The parts of a set by what they show."""

    def __init__(self, lit: LitSet) -> None:
        self._parts: dict[str, list[Part]] = defaultdict(list)
        for part in lit.parts:
            if part.lit_by is not None and part.lit_by.side != "back":
                self._parts[part.name].append(part)

    def part_of(self, source: Source) -> Part | None:
        """The part that shows what was extracted; of several of one object, the one that stands where it stands."""
        parts = self._parts[source.object_name]
        if len(parts) < 2:
            return parts[0] if parts else None
        matrix: Float64 = source.matrix
        if matrix is None:
            matrix = np.array(bpy.data.objects[source.object_name, source.library].matrix_world)
        return min(parts, key=lambda part: float(np.abs(part.matrix - matrix).max()))


def _is_painted(part: Part, lit: LitSet) -> bool:
    return any(slot.material.name in lit.materials.painted for slot in part.thing.material_slots if slot.material)


def _uv_at(part: Part | None, mesh: Mesh) -> Float32:
    """The uv (F, 3, 2) of a mesh's light, where the part lies that shows it.

    Raises:
        SceneError: the mesh was changed since the bake
    """
    if part is None:
        return np.zeros((len(mesh.corner), 3, 2), np.float32)
    layer = part.carrier.data.uv_layers[UV_MAP]
    uv = np.empty((len(layer.uv), 2), np.float32)
    layer.uv.foreach_get("vector", uv.ravel())
    if mesh.corner.max(initial=-1) >= len(uv):
        raise SceneError(part.name, "its mesh was changed since the bake", "Bake again")
    scale, *shift = part.lit_by.place or (1.0, 0.0, 0.0)
    placed: Float32 = uv[mesh.corner] * np.float32(scale) + np.array(shift, np.float32)
    return placed
