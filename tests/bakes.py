# SPDX-License-Identifier: GPL-3.0-or-later
"""Small bakes, texel by texel, and floors and rooms for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radiosity_addon.arrays import Float32, Float64, Int32
from radiosity_addon.bake import Baked, bake
from radiosity_addon.chunks import finish
from radiosity_addon.geometry.sides import with_backs
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import rasterize
from radiosity_addon.scene import Material, Mesh, Scene
from radiosity_addon.settings import BakeSettings
from radiosity_addon.shading import Shader
from tests.shapes import mesh_of, quad

WHITE = Material("White", (0.75,) * 3)


BLACK = Material("Black", (0.0,) * 3)


@dataclass(frozen=True, eq=False)
class Lit:
    """A bake, texel by texel.

    Attributes:
        mesh: (T,) index into the scene's meshes
        position, normal: (T, 3)
        area: (T,) m2
        light: (T, 3) W/(m2 sr), H / pi
    """

    baked: Baked
    mesh: Int32
    position: Float64
    normal: Float32
    area: Float32
    light: Float32

    def of(self, mesh: int) -> Float32:
        return self.light[self.mesh == mesh]


def bake_of(scene: Scene, shade: Shader | None = None, **settings: object) -> Baked:
    """A small bake in draft quality unless `settings` say otherwise; light is finite and never negative."""
    baked = finish(bake(scene, BakeSettings(**{"page_size": 64, "quality": "draft", **settings}), shade))
    assert all(np.isfinite(page).all() and page.min() >= 0 for page in baked.pages)
    return baked


def lit(scene: Scene, **settings: object) -> Lit:
    """A bake, texel by texel; backs of two-sided meshes are the meshes after the scene's own."""
    baked = bake_of(scene, **settings)
    surfaces = flatten(with_backs(scene))
    texels = finish(rasterize(baked.atlas, surfaces, 1))
    shown = texels.pixel < baked.atlas.page_count * baked.atlas.size**2
    return Lit(
        baked,
        surfaces.mesh[texels.triangle[shown]],
        texels.position[shown] + surfaces.origin,
        texels.normal[shown],
        texels.area[shown],
        np.concatenate([page.reshape(-1, 3) for page in baked.pages])[texels.pixel[shown]],
    )


def floor(size: float = 4.0, name: str = "Floor", material: int = 0, **options: object) -> Mesh:
    """A square in z = 0 that faces up."""
    return mesh_of(name, [quad((-size / 2, -size / 2, 0), (size, 0, 0), (0, size, 0))], [material], **options)


def planes(mesh: Mesh, turned: bool = False) -> tuple[Mesh, ...]:
    """Each quad as an object of its own, facing the other way if `turned`."""
    quads = mesh.vertices.reshape(-1, 4, 3)
    return tuple(
        mesh_of(f"{mesh.name} {k}", [corners[::-1] if turned else corners], [int(mesh.material[2 * k])])
        for k, corners in enumerate(quads)
    )
