# SPDX-License-Identifier: GPL-3.0-or-later
"""Backs of two-sided meshes: records of their own, last in the scene, so that they get charts, texels and patches.

Rays meet fronts only. A hit on the back of a triangle that has a twin is a hit on the twin's front.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..arrays import Float32, Int32
from ..scene import Mesh, Scene
from .surfaces import Surfaces
from .visibility import Hits

TURNED = [0, 2, 1]
"""Order of the corners of a triangle seen from behind."""


def backs_of(meshes: Sequence[Mesh]) -> dict[int, int]:
    """Of each two-sided mesh, by its index, the index that the record of its backs will have."""
    wanted = [index for index, mesh in enumerate(meshes) if mesh.two_sided and len(mesh.triangles)]
    return {index: len(meshes) + k for k, index in enumerate(wanted)}


def with_backs(scene: Scene) -> Scene:
    """The scene with a record of the backs of each two-sided mesh after all others; itself where there is none."""
    backs = [_back(scene.meshes[index], index, scene.behind) for index in backs_of(scene.meshes)]
    return replace(scene, meshes=(*scene.meshes, *backs)) if backs else scene


def _back(mesh: Mesh, index: int, behind: Int32) -> Mesh:
    return replace(
        mesh,
        triangles=np.ascontiguousarray(mesh.triangles[:, TURNED]),
        corner_normals=-mesh.corner_normals[:, TURNED],
        material=behind[mesh.material],
        corner=np.ascontiguousarray(mesh.corner[:, TURNED]),
        uv=None if mesh.uv is None else _mirrored(mesh.uv),
        flat=None if mesh.flat is None else partial(_mirrored_flat, mesh.flat),
        shape=None,
        front=index,
    )


def _mirrored(uv: Float32) -> Float32:
    """A map (F, 3, 2) as it is seen from behind."""
    turned: Float32 = uv[:, TURNED]
    turned[:, :, 0] = 1 - turned[:, :, 0]
    return turned


def _mirrored_flat(flat: Callable[[], tuple[Float32, Int32] | None]) -> tuple[Float32, Int32] | None:
    laid = flat()
    return laid and (_mirrored(laid[0]), laid[1])


def seen_side(surfaces: Surfaces, hits: Hits) -> Hits:
    """The hits, those on backs that have a twin as hits on the twin."""
    if surfaces.fronts == surfaces.count:
        return hits
    twin = surfaces.twin[hits.triangle]
    turned = (twin >= 0) & ~hits.front & (hits.triangle >= 0)
    return replace(
        hits,
        triangle=np.where(turned, twin, hits.triangle),
        u=np.where(turned, hits.v, hits.u),
        v=np.where(turned, hits.u, hits.v),
        front=hits.front | turned,
    )
