# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces that were read, as records in the world: arithmetic alone, which needs no Blender any more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...arrays import Float32, Float64, Int32
from ...scene import Mesh
from ..data.preflight import check_size
from ..data.shapes import Shape, placed
from ..looks.surface_answers import SurfaceAnswers
from .extraction import Notes, Skip, Source


@dataclass(frozen=True, eq=False)
class Found:
    """A surface as the dependency graph shows it, of which nothing is kept.

    Attributes:
        name: of its object
        shape: in its own space; many may share it
        matrix: (4, 4) float64, where it stands
        material: (slots,) int32, index into the records' materials
        uv: (L, 2) float32, of polygon corners, to be kept; None for none
        cut: lays it flat, by triangle corners and matrix, if splines do; None: nothing does
        answers: to what its materials ask, if they ask anything
        mesh: its record, but for what is said above
        source: where it comes from, but for what is said above
    """

    name: str
    shape: Shape
    matrix: Float64
    material: Int32
    uv: Float32 | None
    cut: Callable[[Int32, Float64], tuple[Float32, Int32] | None] | None
    answers: SurfaceAnswers | None
    mesh: Callable[..., Mesh]
    source: Callable[..., Source]


class SurfaceRecords:
    """Surfaces in the world.

    Attributes:
        meshes: as the core takes them
        sources: where each comes from
        answers: by index of the mesh, what a surface answers whose materials vary
    """

    def __init__(self, notes: Notes) -> None:
        self._notes = notes
        self.meshes: list[Mesh] = []
        self.sources: list[Source] = []
        self.answers: dict[int, SurfaceAnswers] = {}

    def take(self, found: Found) -> None:
        """Bring a surface to its place.

        Raises:
            Skip: it has vertices that are nowhere, or nothing of it has an area
            SceneError: it is too far out
        """
        if not np.isfinite(found.shape.vertices).all():
            raise Skip("it has vertices that are not finite numbers")
        shape = placed(found.shape, found.matrix)
        check_size(found.name, shape.vertices)
        if not len(shape.triangles):
            raise Skip("all its faces have no area")
        if shape.dropped:
            self._notes.warn(f"{found.name}: {shape.dropped} triangles without area are left out")
        if found.answers is not None:
            self.answers[len(self.meshes)] = found.answers
        self.sources.append(found.source(object_name=found.name, mesh=len(self.meshes), slot=shape.slot))
        self.meshes.append(
            found.mesh(
                name=found.name,
                vertices=shape.vertices,
                triangles=shape.triangles,
                corner_normals=shape.corner_normals,
                material=found.material[np.clip(shape.slot, 0, len(found.material) - 1)],
                polygon=shape.polygon,
                corner=shape.corner,
                uv=None if found.uv is None else found.uv[shape.corner],
                flat=found.cut and partial(found.cut, shape.corner, found.matrix),
            )
        )
