# SPDX-License-Identifier: GPL-3.0-or-later
"""What stops a bake before it begins, with the object and the remedy."""

from __future__ import annotations

import bpy
import numpy as np

from ...arrays import Float64
from ...errors import SceneError
from .names import BACK_UV_MAP, UV_MAP, has_our_uv_map

MAX_COORDINATE = 1e15
"""m; beyond it squares overflow float32."""

FLAT_SCALE = 1e-7
"""A matrix that shrinks one direction by this share of another is singular in float32."""

MAX_TRIANGLES = 50_000_000
TRIANGLE_BYTES = 300
"""What a triangle takes in the records and the ray tracer together, roughly."""

MAX_UV_MAPS = 8


def check_is_there(thing: bpy.types.Object) -> None:
    """Whether an object was found when its file was read; Blender puts an empty one in its place.

    Raises:
        SceneError: its library, or that of its data, is missing
    """
    if getattr(thing, "is_missing", False) or getattr(thing.data, "is_missing", False):
        raise SceneError(thing.name, "its library file is missing", "Relocate the library, or remove the object")


def check_can_carry(thing: bpy.types.Object, two_sided: bool) -> None:
    """Whether a lightmap, or two if it is `two_sided`, can be put on an object.

    Raises:
        SceneError: it is linked, or its uv maps leave no room
    """
    data = thing.data
    local = "Make it local, or set it to only shadow and bounce light"
    if not thing.is_editable:
        raise SceneError(thing.name, "it is linked from another file", local)
    if not data.is_editable and thing.override_library is None:
        raise SceneError(thing.name, f"its data {data.name!r} is linked from another file", local)
    if isinstance(data, bpy.types.Mesh):
        _check_uv_room(thing, data, two_sided)


def check_can_stand_in(
    instancer: bpy.types.Object, thing: bpy.types.Object, mesh: bpy.types.Mesh, two_sided: bool
) -> None:
    """Whether stand-ins can take the place of an object's instances.

    Args:
        instancer: what makes them
        thing: the object
        mesh: as rendered
        two_sided: they take two lightmaps

    Raises:
        SceneError: the instancer is linked, so that it can't be hidden, or the uv maps leave no room
    """
    if not instancer.is_editable:
        local = "Make it local, or set what it shows to only shadow and bounce light"
        raise SceneError(instancer.name, "it is linked from another file", local)
    if not (has_our_uv_map(mesh) or (isinstance(thing.data, bpy.types.Mesh) and has_our_uv_map(thing.data))):
        _check_uv_room(thing, mesh, two_sided)


def _check_uv_room(thing: bpy.types.Object, mesh: bpy.types.Mesh, two_sided: bool) -> None:
    wanted = (UV_MAP, BACK_UV_MAP) if two_sided else (UV_MAP,)
    ours = (UV_MAP, BACK_UV_MAP) if has_our_uv_map(mesh) else ()
    own = [layer.name for layer in mesh.uv_layers if layer.name not in ours]
    for name in wanted:
        if name in own:
            raise SceneError(thing.name, f"it has a uv map of its own named {name!r}", "Rename that uv map")
    if len(own) + len(wanted) > MAX_UV_MAPS:
        cause = f"all {MAX_UV_MAPS} uv maps are used already"
        if len(wanted) > 1:
            cause = f"{len(own)} of {MAX_UV_MAPS} uv maps are used already, and its two sides take two"
        raise SceneError(thing.name, cause, "Remove one of its uv maps")


def is_two_sided(thing: bpy.types.Object) -> bool:
    """Whether an object is set to have light of its own on its backs."""
    return bool(getattr(getattr(thing, "radiosity", None), "two_sided", False))


def check_memory(name: str, triangles: int) -> None:
    """Whether the scene's triangles up to this object can be held.

    Raises:
        SceneError: they are too many
    """
    if triangles > MAX_TRIANGLES:
        gigabytes = triangles * TRIANGLE_BYTES / 1e9
        raise SceneError(
            name,
            f"with it the scene has {triangles:,} triangles and needs {gigabytes:.0f} GB of memory or more",
            "Lower its subdivision or number of instances, or exclude objects from the bake",
        )


def check_size(name: str, vertices: Float64) -> None:
    """Whether vertices (V, 3), m, are within what ray tracing can hold.

    Raises:
        SceneError: they are too far out
    """
    if len(vertices) and np.abs(vertices).max() >= MAX_COORDINATE:
        raise SceneError(
            name, f"it has vertices {MAX_COORDINATE:g} m or more from the origin", "Move or scale it closer"
        )


def finite_matrix(item: bpy.types.DepsgraphObjectInstance) -> Float64:
    """World matrix of an object or instance, (4, 4).

    Raises:
        SceneError: it holds NaN or infinity
    """
    matrix = np.array(item.matrix_world, np.float64)
    if not np.isfinite(matrix).all():
        raise SceneError(
            item.object.name, "its transform holds values that are not finite numbers", "Clear its transform"
        )
    return matrix


def is_flat(matrix: Float64) -> bool:
    """Whether a matrix squeezes everything onto a plane, line or point."""
    singular = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return bool(singular[2] <= FLAT_SCALE * singular[0])
