# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene as Blender renders it, read into the core's records."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Generator
from dataclasses import replace
from functools import partial

import bpy
import numpy as np

from ...arrays import Float32, Int32
from ...chunks import finish
from ...errors import SceneError
from ...scene import Mesh, Scene
from ..data.evaluation import at_render_settings
from ..data.instances import RAYS, instance_index, is_instance, settings_of
from ..data.names import is_stand_in
from ..data.preflight import (
    check_can_carry,
    check_can_stand_in,
    check_is_there,
    check_memory,
    check_size,
    finite_matrix,
    is_flat,
    is_two_sided,
)
from ..data.shapes import Shape, has_loops_of, placed, read_shape, read_uv
from ..data.shared_shapes import SharedShapes
from ..data.spline_meshes import SplineMeshes, is_bare_tube
from ..data.stand_in import as_unbaked
from ..data.working_space import working_space
from ..looks.surface_answers import SurfaceAnswers
from ..looks.surface_inputs import Input
from .extraction import Extraction, Notes, Skip, Source
from .light_linking import lit_by
from .light_records import LightRecords
from .material_records import MaterialRecords

SURFACES = ("MESH", "CURVE", "SURFACE", "FONT", "META")
"""Types of objects that can have faces."""

LEFT_OUT = "{} is left out: {}"
NO_FACES = "it has no faces"
"""Said of an object unless it is there for the instances that it makes."""


def extract_scene(scene: bpy.types.Scene, only: Collection[str] | None = None) -> Extraction:
    """Read a scene at render settings. What an earlier bake left in it is looked through; see `read_scene`."""
    return finish(read_scene(scene, only))


def read_scene(scene: bpy.types.Scene, only: Collection[str] | None = None) -> Generator[None, None, Extraction]:
    """Read a scene in steps. Until the end nothing else may change the file.

    Args:
        scene: left as found, but edit modes are flushed
        only: names of the objects that get lightmaps, or None for all; the others still shadow and bounce

    Raises:
        SceneError: something can't be baked, or nothing is left to bake
    """
    for name in only or ():
        if name not in scene.objects:
            raise SceneError(name, "there is no such object in the scene", "Give the name of an object in the scene")
    for thing in scene.objects:
        if thing.mode == "EDIT":
            thing.update_from_editmode()
    with as_unbaked(scene):
        reading = at_render_settings(scene, lambda depsgraph: _Reading(scene, depsgraph, only).read_all())
    yield
    yield from reading.unroll()
    yield from reading.lights.render_world(scene)
    return reading.extraction()


class _Reading:
    """One walk over all that is rendered."""

    def __init__(
        self, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, only: Collection[str] | None = None
    ) -> None:
        self.originals = scene
        self.depsgraph = depsgraph
        self.only = only
        self.notes = Notes()
        self.materials = MaterialRecords(depsgraph, self.notes)
        self.lights = LightRecords(depsgraph, self.notes)
        self.surfaces: dict[int, SurfaceAnswers] = {}
        self.answers: dict[int, dict[Input, Float32]] = {}  # of shared meshes
        self.shapes: dict[int, Shape] = {}
        self.splines = SplineMeshes(depsgraph)
        self.meshes: list[Mesh] = []
        self.sources: list[Source] = []
        self.skipped: dict[str, str] = {}
        self.families = SharedShapes()
        self.instancers: dict[str, set[str]] = defaultdict(set)
        self.unrolled: dict[int, Callable[[], tuple[Float32, Int32] | None]] = {}
        self.triangles = 0

    def read_all(self) -> _Reading:
        """Take in all that is rendered, but for a world that has to be rendered itself."""
        seen = set()
        try:
            for item in self.depsgraph.object_instances:
                seen.add(item.object.original.name_full)
                self.read(item)
        finally:
            self.splines.remove()
        self.skip_unseen(seen)
        for name in self.instancers:
            if self.skipped.get(name) == NO_FACES:
                del self.skipped[name], self.notes.warnings[LEFT_OUT.format(name, NO_FACES)]
        if not any(mesh.lightmapped for mesh in self.meshes):
            raise self.nothing_to_bake()
        self.lights.read_world()
        return self

    def unroll(self) -> Generator[None, None, None]:
        """Lay flat what was made of splines; this needs no Blender any more."""
        for index, cut in self.unrolled.items():
            uv, chart = cut() or (None, None)
            self.meshes[index] = replace(self.meshes[index], uv=uv, chart=chart)
            yield

    def extraction(self) -> Extraction:
        """The records of what was taken in."""
        if self.lights.dark and not self.materials.emit:
            self.notes.warn("There is no light in the scene: the lightmaps will be black")
        scene = Scene(
            meshes=tuple(self.meshes),
            materials=tuple(self.materials.records),
            lights=tuple(self.lights.lamps),
            world=self.lights.world,
            groups=tuple(name for name, _ in self.lights.groups),
            receivers={index: self.receivers(linked) for index, linked in self.lights.linked.items()},
            bounces={index: limit for index, (_, limit) in enumerate(self.lights.groups) if limit is not None},
            working_space=working_space(),
            warnings=tuple(self.notes.warnings),
        )
        names = tuple(name for name, _ in self.materials.shown)
        skipped = tuple(self.skipped.items())
        return Extraction(scene, tuple(self.sources), skipped, names, self.surfaces, self.instancers)

    def receivers(self, linked: bpy.types.Collection) -> frozenset[int]:
        """Indices of the meshes that a lamp lights that is linked to a collection."""
        lights = lit_by(linked)
        return frozenset(
            index
            for index, source in enumerate(self.sources)
            if lights((source.object_name, source.library)) or (source.instancer and lights((source.instancer, None)))
        )

    def nothing_to_bake(self) -> SceneError:
        reasons = [
            f"{name}: {reason}" for name, reason in self.skipped.items() if self.only is None or name in self.only
        ]
        why = "; ".join(reasons[:3]) + ("; ..." if len(reasons) > 3 else "")
        return SceneError(
            f"Scene {self.originals.name!r}",
            f"nothing is left to bake ({why})" if why else "it has no object with faces",
            "Add a mesh that is visible in renders, or include one",
        )

    def read(self, item: bpy.types.DepsgraphObjectInstance) -> None:
        """Take one object or instance into the records."""
        thing, original = item.object, item.object.original
        if is_stand_in(original):
            return
        check_is_there(original)
        if not item.show_self:
            self.skipped.setdefault(thing.name, "only its instances are rendered")
            return
        instanced = is_instance(item)
        if instanced:
            self.instancers[item.parent.original.name].add(thing.name)
        if thing.type == "LIGHT":
            self.lights.read_lamp(thing, finite_matrix(item))
            return
        if thing.type not in ("MESH", "CURVES") and not is_bare_tube(original, self.depsgraph):
            if thing.type in ("POINTCLOUD", "VOLUME", "GREASEPENCIL", "GPENCIL"):
                self.skipped.setdefault(thing.name, f"{thing.type.lower()} objects are not read")
            return
        settings = getattr(original, "radiosity", None)
        if any(getattr(each, "exclude", False) for each in settings_of(item)):
            self.skipped[thing.name] = "excluded from the bake"
            return
        try:
            self.read_surface(item, instanced, settings)
        except Skip as reason:
            self.skipped[thing.name] = str(reason)
            self.notes.warn(LEFT_OUT.format(thing.name, reason))

    def read_surface(
        self,
        item: bpy.types.DepsgraphObjectInstance,
        instanced: bool,
        settings: bpy.types.PropertyGroup | None,
    ) -> None:
        thing, original, matrix = item.object, item.object.original, finite_matrix(item)
        splines = self.splines.of(thing)
        mesh: bpy.types.Mesh
        if splines is not None:
            mesh = splines.mesh
            for reason in splines.nets.degenerate:
                self.notes.warn(f"{thing.name}: a spline is left out: {reason}")
        else:
            mesh = thing.to_mesh() if thing.data.is_editmode else thing.data  # an edited mesh is evaluated on demand
        lightmapped = thing.type != "CURVES" and self.gets_lightmap(item)
        if thing.type == "CURVES":
            self.skipped.setdefault(thing.name, "hair can't carry a lightmap; it only shadows and bounces light")
        maker = item.parent if instanced else thing
        self.check_rays(thing, maker)
        if not len(mesh.polygons):
            raise Skip(NO_FACES)
        if is_flat(matrix):
            raise Skip("its scale is zero along an axis")
        shared = item.is_instance or original.data.users > 1
        if lightmapped and instanced:
            check_can_stand_in(item.parent.original, original, mesh)
        elif lightmapped:
            check_can_carry(original)
        shape = placed(self.shape(mesh, keep=shared), matrix)
        self.triangles += len(shape.triangles)
        check_memory(thing.name, self.triangles)
        check_size(thing.name, shape.vertices)
        if not len(shape.triangles):
            raise Skip("all its faces have no area")
        if shape.dropped:
            self.notes.warn(f"{thing.name}: {shape.dropped} triangles without area are left out")
        slots = [slot.material for slot in thing.material_slots]
        group = self.lights.group(thing.lightgroup)
        material = self.materials.of_slots(slots, group, thing.name)[np.clip(shape.slot, 0, max(len(slots) - 1, 0))]
        asked = (self.materials.shown[index][1] for index in np.unique(material))
        asking = [each for each in asked if each is not None]
        if asking:
            kept = self.answers.setdefault(mesh.as_pointer(), {}) if shared else {}
            self.surfaces[len(self.meshes)] = SurfaceAnswers.of(asking, item, mesh, self.depsgraph, kept)
        uv = kept_uv(mesh, shape, thing.name, settings) if lightmapped else None
        if splines is not None and lightmapped and uv is None:
            self.unrolled[len(self.meshes)] = partial(splines.cut, shape.corner, matrix)
        uv_map, page_group = (getattr(settings, name, "") for name in ("uv_map", "page_group"))
        self.sources.append(
            Source(
                object_name=thing.name,
                mesh=len(self.meshes),
                own_mesh=not instanced and is_own_mesh(mesh, original),
                materials=tuple("" if slot is None else slot.original.name for slot in slots),
                slot=shape.slot,
                matrix=matrix if instanced else None,
                instancer=item.parent.original.name if instanced else "",
                index=instance_index(item) if instanced else (),
                library=original.library.filepath if original.library else None,
            )
        )
        two_sided = lightmapped and is_two_sided(original)
        shares = lightmapped and shared and not two_sided  # a place says where one map lies, not where two do
        self.meshes.append(
            Mesh(
                name=thing.name,
                vertices=shape.vertices,
                triangles=shape.triangles,
                corner_normals=shape.corner_normals,
                material=material,
                polygon=shape.polygon,
                corner=shape.corner,
                lightmapped=lightmapped,
                density=getattr(settings, "density", 1.0),
                uv=uv,
                shape=self.families.number(mesh.as_pointer(), uv_map, matrix, page_group) if shares else None,
                two_sided=two_sided,
                page_group=page_group,
                met=thing.visible_diffuse and maker.visible_diffuse,
                casts=thing.visible_shadow and maker.visible_shadow,
            )
        )

    def check_rays(self, thing: bpy.types.Object, maker: bpy.types.Object) -> None:
        """An instance is seen by the rays that see both the object and what makes the instance."""
        if not any(getattr(thing, name) and getattr(maker, name) for name in RAYS):
            raise Skip("it is invisible to all rays")
        for name, what in (("is_shadow_catcher", "a shadow catcher"), ("is_holdout", "a holdout")):
            if getattr(thing, name):
                self.notes.warn(f"{thing.name} is {what}, and is baked as an ordinary surface")

    def gets_lightmap(self, item: bpy.types.DepsgraphObjectInstance) -> bool:
        name = item.object.name
        chosen = {name, item.parent.name} if is_instance(item) else {name}
        if self.only is not None and chosen.isdisjoint(self.only):
            self.skipped[name] = "not chosen; it only shadows and bounces light"
        elif any(getattr(each, "only_casts", False) for each in settings_of(item)):
            self.skipped[name] = "set to only shadow and bounce light"
        else:
            return True
        return False

    def shape(self, mesh: bpy.types.Mesh, keep: bool) -> Shape:
        """A mesh's arrays; those of shared meshes are kept for the next time."""
        shape = self.shapes.get(mesh.as_pointer()) if keep else None
        if shape is None:
            shape = read_shape(mesh)
            if keep:
                self.shapes[mesh.as_pointer()] = shape
        if not np.isfinite(shape.vertices).all():
            raise Skip("it has vertices that are not finite numbers")
        return shape

    def skip_unseen(self, seen: set[str]) -> None:
        """Say why objects that could have faces did not come up."""
        have_faces = {source.object_name for source in self.sources}
        for thing in self.originals.objects:
            if thing.type not in SURFACES or thing.name in have_faces or is_stand_in(thing):
                continue
            known = thing.name_full in seen
            self.skipped.setdefault(thing.name, NO_FACES if known else "it is hidden in renders")


def kept_uv(mesh: bpy.types.Mesh, shape: Shape, name: str, settings: bpy.types.PropertyGroup | None) -> Float32 | None:
    """The uv map that the object is set to keep, (F, 3, 2), or None.

    Raises:
        SceneError: it has no such map
    """
    wanted = getattr(settings, "uv_map", "")
    uv = read_uv(mesh, wanted, shape.corner) if wanted else None
    if wanted and uv is None:
        raise SceneError(
            name, f"it has no uv map named {wanted!r}", "Choose one of its uv maps to keep, or none to unwrap"
        )
    return uv


def is_own_mesh(rendered: bpy.types.Mesh, original: bpy.types.Object) -> bool:
    """Whether a uv map written onto the object's own mesh is what the render shows."""
    if original.type != "MESH" or any(mod.type == "NODES" and mod.show_render for mod in original.modifiers):
        return False
    return has_loops_of(rendered, original.data)
