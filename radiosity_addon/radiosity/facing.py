# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes whose fronts look away from the light: a lightmap of their fronts shows little of what a room looks like."""

from __future__ import annotations

import numpy as np

from ..arrays import Float64
from ..scene import Scene
from .patches import Patches

AWAY = 0.9
"""Share of the light which a mesh throws back that leaves from its backs, above which its faces look away."""

WORTH_SAYING = 1e-4
"""Share of the scene's light below which nobody misses it."""


def looking_away(patches: Patches, radiosity: Float64, scene: Scene) -> tuple[str, ...]:
    """Warnings about one-sided meshes with a lightmap that are lit from behind.

    Those that reflect more there, such as panels that shine in front, are meant so.

    Args:
        radiosity: (N, G, 3), W/m2, of the patches
    """
    if not patches.has_backs:
        return ()
    owner = patches.texels.surfaces.mesh[patches.texels.triangle[patches.any_texels()]]
    power = np.maximum(radiosity.sum(1) - patches.emission, 0).sum(1) * patches.area
    behind = np.bincount(owner, power * (patches.sides < 0), minlength=len(scene.meshes))
    whole = np.bincount(owner, power, minlength=len(scene.meshes))
    away = (behind > AWAY * whole) & (behind > WORTH_SAYING * power.sum())
    shown = np.array([entry.reflectance for entry in scene.materials]).sum(1)
    meant = shown < shown[scene.behind] / 2
    return tuple(
        f"{mesh.name}: {share:.0%} of its light falls on the backs of its faces, which the lightmap does not show; "
        "flip its normals, or set it two-sided"
        for mesh, share in zip(
            np.array(scene.meshes, object)[away], (behind / np.maximum(whole, 1e-300))[away], strict=True
        )
        if mesh.lightmapped and not meant[mesh.material].any()
    )
