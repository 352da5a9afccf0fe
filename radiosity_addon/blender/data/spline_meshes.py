# SPDX-License-Identifier: GPL-3.0-or-later
"""Curve and surface objects as meshes, made from their splines, or by Blender where those are not all of it."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import bpy
import numpy as np

from ...arrays import Float32, Float64, Int32
from ...curves.patchwork import Patchwork, face_of_cap, faces_of_net, joined
from ...curves.strands import tubes
from ...curves.unrolling import unroll
from .curves import Nets, curve_nets, left_to_blender, profiles, surface_nets
from .shapes import set_corner_normals

UV_MAP = "UVMap"
"""Name of the texture coordinates that Blender gives to the meshes of splines."""

HAIR_RADIUS = 0.005
"""m, of strands that have none, as in Cycles."""


@dataclass(frozen=True, eq=False)
class SplineMesh:
    """The mesh of an object's splines.

    Attributes:
        mesh: a datablock of its own, without materials
        nets: what it was made of; nothing for hair
        faces: the same as polygons
    """

    mesh: bpy.types.Mesh
    nets: Nets
    faces: Patchwork | None = None


class SplineMeshes:
    """The spline meshes of one dependency graph, made when they are asked for, until they are removed."""

    def __init__(self, depsgraph: bpy.types.Depsgraph) -> None:
        self.depsgraph = depsgraph
        self.made: dict[tuple[str, float], SplineMesh | None] = {}

    def of(self, thing: bpy.types.Object) -> Generator[None, None, SplineMesh | None]:
        """That of an evaluated object, in steps, one for all that share its data; None: it is to be taken as it is."""
        if thing.type == "CURVES":
            key = "", float(thing.data.as_pointer())
            if key not in self.made:
                self.made[key] = hair_mesh(thing)
            return self.made[key]
        original = thing.original
        if original.type not in ("CURVE", "SURFACE"):
            return None
        if left_to_blender(original.evaluated_get(self.depsgraph), self.depsgraph) is not None:
            return None
        key = original.data.name_full, _tube(original)
        if key not in self.made:
            self.made[key] = yield from spline_mesh(original, self.depsgraph)
        return self.made[key]

    def remove(self) -> None:
        """Take the meshes out of the file."""
        for made in self.made.values():
            if made is not None:
                bpy.data.meshes.remove(made.mesh)
        self.made.clear()


def cut(nets: Nets, faces: Patchwork, corner: Int32, matrix: Float64) -> tuple[Float32, Int32] | None:
    """Charts by arc length: uv (F, 3, 2), m, and chart (F,) of triangles by their corners (F, 3).

    None where the splines bend too much to be laid flat by their own parameters.

    Args:
        faces: the polygons that the nets were made into
        matrix: (4, 4) of the object
    """
    laid = unroll(nets.nets, nets.caps, matrix[:3, :3])
    if laid is None:
        return None
    places, charts = (values[faces.face][corner] for values in laid)
    return places.astype(np.float32), charts[:, 0].astype(np.int32)


def is_bare_tube(original: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether an object is a curve without a surface that was given a tube."""
    tube = getattr(getattr(original, "radiosity", None), "tube_radius", 0.0)
    if original.type != "CURVE" or not tube:
        return False
    evaluated = original.evaluated_get(depsgraph)
    return left_to_blender(evaluated, depsgraph) is None and not profiles(evaluated.data, depsgraph)


def spline_mesh(original: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Generator[None, None, SplineMesh | None]:
    """A new mesh datablock of an object's splines, in steps; None where it has none or is left to Blender."""
    if original.type not in ("CURVE", "SURFACE"):
        return None
    thing = original.evaluated_get(depsgraph)
    if left_to_blender(thing, depsgraph) is not None:
        return None
    surface = thing.type == "SURFACE"
    nets = yield from surface_nets(thing.data) if surface else curve_nets(thing.data, depsgraph, _tube(original))
    if not nets.nets:
        return SplineMesh(bpy.data.meshes.new(original.data.name), nets) if nets.degenerate else None
    parts = []
    for net in nets.nets:
        parts.append(faces_of_net(net))
        yield
    faces = joined([*parts, *map(face_of_cap, nets.caps)])
    return SplineMesh(_filled(original.data.name, faces, thing.data), nets, faces)


def hair_mesh(thing: bpy.types.Object) -> SplineMesh:
    """The strands of an evaluated Curves object as tubes."""
    data = thing.data
    points, radius = np.empty(len(data.points) * 3, np.float32), np.full(len(data.points), HAIR_RADIUS, np.float32)
    data.points.foreach_get("position", points)
    attribute = data.attributes.get("radius")
    if attribute is not None and attribute.domain == "POINT" and attribute.data_type == "FLOAT":
        attribute.data.foreach_get("value", radius)
    first = np.empty(len(data.curves), np.int32)
    data.curves.foreach_get("first_point_index", first)
    found = tubes(points.reshape(-1, 3).astype(np.float64), radius.astype(np.float64), np.append(first, len(radius)))
    mesh = bpy.data.meshes.new(data.name)
    mesh.vertices.add(len(found.vertices))
    mesh.vertices.foreach_set("co", found.vertices.astype(np.float32).ravel())
    mesh.loops.add(found.triangles.size)
    mesh.loops.foreach_set("vertex_index", found.triangles.astype(np.int32).ravel())
    mesh.polygons.add(len(found.triangles))
    mesh.polygons.foreach_set("loop_start", np.arange(0, found.triangles.size, 3, dtype=np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(found.triangles), bool))
    mesh.update(calc_edges=True)
    return SplineMesh(mesh, Nets((), (), ()))


def unread_hair(thing: bpy.types.Object) -> list[str]:
    """Names of an evaluated object's particle systems that render as strands, which are not read."""
    systems = [each.particle_system for each in thing.modifiers if each.type == "PARTICLE_SYSTEM" and each.show_render]
    return [each.name for each in systems if (each.settings.type, each.settings.render_type) == ("HAIR", "PATH")]


def _tube(original: bpy.types.Object) -> float:
    """Radius of the tube that the user gives to a bare curve, in the object's own space."""
    radius = getattr(getattr(original, "radiosity", None), "tube_radius", 0.0)
    scale = abs(original.matrix_world.determinant()) ** (1 / 3)
    return radius / scale if scale > 0 else 0.0


def _filled(name: str, faces: Patchwork, data: bpy.types.Curve) -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(faces.vertices))
    mesh.vertices.foreach_set("co", faces.vertices.astype(np.float32).ravel())
    mesh.loops.add(len(faces.loop_vertex))
    mesh.loops.foreach_set("vertex_index", faces.loop_vertex.astype(np.int32))
    mesh.polygons.add(len(faces.loop_start))
    mesh.polygons.foreach_set("loop_start", faces.loop_start.astype(np.int32))
    mesh.polygons.foreach_set("material_index", faces.material.astype(np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces.loop_start), bool))
    layer = mesh.uv_layers.new(name=UV_MAP, do_init=False)
    layer.uv.foreach_set("vector", faces.loop_uv.astype(np.float32).ravel())
    mesh.update(calc_edges=True)
    if faces.loop_normal.any():
        set_corner_normals(mesh, faces.loop_normal)
    mesh.use_auto_texspace = False
    mesh.texspace_location, mesh.texspace_size = data.texspace_location, data.texspace_size
    return mesh
