# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene as Blender renders it, read into the core's records."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Generator, Sequence
from functools import partial

import bpy

from ...arrays import Float32
from ...chunks import finish
from ...errors import SceneError, raise_together
from ...scene import Mesh, Scene
from ..data.instances import RAYS, instance_index, is_instance, settings_of
from ..data.names import is_stand_in
from ..data.preflight import (
    check_can_carry,
    check_can_stand_in,
    check_is_there,
    check_memory,
    finite_matrix,
    is_flat,
    is_two_sided,
)
from ..data.shapes import Shape, has_loops_of, read_shape, read_uv, slots_of
from ..data.shared_shapes import SharedShapes
from ..data.spline_meshes import SplineMeshes, cut, is_bare_tube, unread_hair
from ..data.stand_in import as_rendered_unbaked, followed
from ..data.working_space import working_space
from ..looks.surface_answers import SurfaceAnswers
from ..looks.surface_inputs import Input
from .cycles import Cycles
from .extraction import Extraction, Notes, Skip, Source
from .light_linking import Name
from .light_records import LightRecords
from .material_records import MaterialRecords
from .surface_records import Found, SurfaceRecords

SURFACES = ("MESH", "CURVE", "SURFACE", "FONT", "META")
"""Types of objects that can have faces."""

LEFT_OUT = "{} is left out: {}"
NO_FACES = "it has no faces"

MOST_ERRORS = 20
"""Of what stops a bake; after as many nothing more is read."""
"""Said of an object unless it is there for the instances that it makes."""


def extract_scene(scene: bpy.types.Scene, only: Collection[str] | None = None) -> Extraction:
    """Read a scene at render settings. What an earlier bake left in it is looked through; see `read_scene`."""
    return finish(finish(read_scene(scene, only)).extraction(Cycles()))


def read_scene(scene: bpy.types.Scene, only: Collection[str] | None = None) -> Generator[None, None, Reading]:
    """Read a scene in steps. Until the end nothing else may change the file.

    Args:
        scene: left as found, but edit modes are flushed
        only: names of the objects that get lightmaps, or None for all; the others still shadow and bounce

    Raises:
        SceneError: something can't be baked
    """
    for name in only or ():
        if name not in scene.objects:
            raise SceneError(name, "there is no such object in the scene", "Give the name of an object in the scene")
    for thing in scene.objects:
        if thing.mode == "EDIT":
            thing.update_from_editmode()
    with as_rendered_unbaked(scene) as depsgraph:
        yield
        reading = Reading(scene, depsgraph, only)
        yield from reading.look(scene)
    return reading


class Reading:
    """What is rendered, as a dependency graph has it. A world that is to be rendered is not in it."""

    def __init__(
        self, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, only: Collection[str] | None = None
    ) -> None:
        self.depsgraph = depsgraph
        self.name = scene.name
        self.only = only
        self.notes = Notes()
        self.materials = MaterialRecords(depsgraph, self.notes)
        self.lights = LightRecords(depsgraph, self.notes)
        self.answers: dict[int, dict[Input, Float32]] = {}  # of shared meshes
        self.shapes: dict[int, Shape] = {}
        self.splines = SplineMeshes(depsgraph)
        self.found: list[Found] = []
        self.skipped: dict[str, str] = {}
        self.families = SharedShapes()
        self.instancers: dict[str, set[str]] = defaultdict(set)
        self.triangles = 0
        self.errors: list[SceneError] = []
        self.working_space = working_space()
        self.unseen: dict[str, str] = {}

    def look(self, scene: bpy.types.Scene) -> Generator[None, None, None]:
        """Take all into the records, in steps as short as one call to Blender or a spline."""
        seen = set()
        try:
            for item in self.depsgraph.object_instances:
                seen.add(item.object.original.name_full)
                try:
                    yield from self.read(item)
                except SceneError as error:  # all that stops a bake is told at once
                    self.errors.append(error)
                yield
                if len(self.errors) > MOST_ERRORS:
                    break
        finally:
            self.splines.remove()
        for shown, stand_in in followed(scene.objects).items():
            if shown is None or shown.name_full not in scene.objects:
                self.skip(stand_in.name, "it shows the bake of an object that is not in the scene")
        self.unseen = {
            thing.name: NO_FACES if thing.name_full in seen else "it is hidden in renders"
            for thing in scene.objects
            if thing.type in SURFACES and not is_stand_in(thing)
        }
        self.lights.read_world()

    @property
    def ask_cycles(self) -> bool:
        """Whether there is something that only Cycles can tell."""
        return self.lights.unclear or any(record.varies for record in self.materials.records)

    def extraction(self, cycles: Cycles) -> Generator[None, None, Extraction]:
        """The records of what was read, in steps that need no Blender any more.

        Args:
            cycles: looks at the world and at lamps, where no one else could

        Raises:
            SceneError: something can't be baked, or nothing is left to bake
        """
        self.lights.render_world(self.name, cycles)
        self.lights.measure_lamps(self.name, cycles)
        surfaces = SurfaceRecords(self.notes)
        for found in self.found:
            try:
                surfaces.take(found)
            except Skip as reason:
                self.skip(found.name, str(reason))
            except SceneError as error:
                self.errors.append(error)
            yield
        raise_together(self.errors)
        have_faces = {source.object_name for source in surfaces.sources}
        for name, reason in self.unseen.items():
            if name not in have_faces:
                self.skipped.setdefault(name, reason)
        for name in self.instancers:
            if self.skipped.get(name) == NO_FACES:
                del self.skipped[name]
                self.notes.warnings.pop(LEFT_OUT.format(name, NO_FACES), None)
        if not any(mesh.lightmapped for mesh in surfaces.meshes):
            raise self.nothing_to_bake()
        if self.lights.dark and not self.materials.emit:
            self.notes.warn("There is no light in the scene: the lightmaps will be black")
        scene = Scene(
            meshes=tuple(surfaces.meshes),
            materials=tuple(self.materials.records),
            lights=tuple(self.lights.lamps),
            world=self.lights.world,
            groups=tuple(name for name, _ in self.lights.groups),
            receivers={index: receivers(lit, surfaces.sources) for index, lit in self.lights.linked.items()},
            bounces={index: limit for index, (_, limit) in enumerate(self.lights.groups) if limit is not None},
            working_space=self.working_space,
            warnings=tuple(self.notes.warnings),
        )
        names = tuple(name for name, _ in self.materials.shown)
        skipped = tuple(self.skipped.items())
        return Extraction(scene, tuple(surfaces.sources), skipped, names, surfaces.answers, self.instancers)

    def nothing_to_bake(self) -> SceneError:
        reasons = [
            f"{name}: {reason}" for name, reason in self.skipped.items() if self.only is None or name in self.only
        ]
        why = "; ".join(reasons[:3]) + ("; ..." if len(reasons) > 3 else "")
        return SceneError(
            f"Scene {self.name!r}",
            f"nothing is left to bake ({why})" if why else "it has no object with faces",
            "Add a mesh that is visible in renders, or include one",
        )

    def skip(self, name: str, reason: str) -> None:
        """Leave out an object, and say so."""
        self.skipped[name] = reason
        self.notes.warn(LEFT_OUT.format(name, reason))

    def read(self, item: bpy.types.DepsgraphObjectInstance) -> Generator[None, None, None]:
        """Take one object or instance into the records."""
        thing, original = item.object, item.object.original
        instanced = is_instance(item)
        if is_stand_in(original) and not instanced:  # an instance is of an asset that is baked in its own file
            return
        check_is_there(original)
        if not item.show_self:
            self.skipped.setdefault(thing.name, "only its instances are rendered")
            return
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
            yield from self.read_surface(item, instanced, settings)
        except Skip as reason:
            self.skip(thing.name, str(reason))

    def read_surface(
        self,
        item: bpy.types.DepsgraphObjectInstance,
        instanced: bool,
        settings: bpy.types.PropertyGroup | None,
    ) -> Generator[None, None, None]:
        thing, original, matrix = item.object, item.object.original, finite_matrix(item)
        splines = yield from self.splines.of(thing)
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
        for name in unread_hair(thing):
            self.notes.warn(f"{thing.name}: the hair of {name!r} is ignored; convert it to hair curves")
        if not len(mesh.polygons):
            raise Skip(NO_FACES)
        if is_flat(matrix):
            raise Skip("its scale is zero along an axis")
        shared = item.is_instance or original.data.users > 1
        shape = yield from self.shape(mesh, keep=shared)
        self.triangles += len(shape.triangles)
        check_memory(thing.name, self.triangles)
        slots = slots_of(thing)
        group = self.lights.group(thing.lightgroup)
        material = self.materials.of_slots(slots, group, thing.name)
        if self.materials.only_volume(material, shape.slot):
            raise Skip("its materials show a volume and no surface")
        sheet = self.materials.pass_light(material, shape.slot)
        two_sided = sheet or (lightmapped and is_two_sided(original))
        if lightmapped and instanced:
            check_can_stand_in(item.parent.original, original, mesh, two_sided)
        elif lightmapped:
            check_can_carry(original, two_sided)
        asking, answers = self.materials.asking(material, shape.slot), None
        if asking:
            kept = self.answers.setdefault(mesh.as_pointer(), {}) if shared else {}
            answers = yield from SurfaceAnswers.of(asking, item, mesh, self.depsgraph, kept)
        uv = kept_uv(mesh, thing.name, settings) if lightmapped else None
        unrolls = lightmapped and uv is None and splines is not None and splines.faces is not None
        uv_map, page_group = (getattr(settings, name, "") for name in ("uv_map", "page_group"))
        shares = lightmapped and shared and not two_sided  # a place says where one map lies, not where two do
        self.found.append(
            Found(
                name=thing.name,
                shape=shape,
                matrix=matrix,
                material=material,
                uv=uv,
                cut=partial(cut, splines.nets, splines.faces) if unrolls else None,
                answers=answers,
                mesh=partial(
                    Mesh,
                    lightmapped=lightmapped,
                    density=getattr(settings, "density", 1.0),
                    shape=self.families.number(mesh.as_pointer(), uv_map, matrix, page_group) if shares else None,
                    two_sided=two_sided,
                    page_group=page_group,
                    terminator=terminator_offsets(thing)[0],
                    bend=1 / (1 - terminator_offsets(thing)[1] / 2),  # as Cycles has it
                    met=thing.visible_diffuse and maker.visible_diffuse,
                    casts=thing.visible_shadow and maker.visible_shadow,
                ),
                source=partial(
                    Source,
                    own_mesh=not instanced and is_own_mesh(mesh, original),
                    materials=tuple("" if slot is None else slot.original.name for slot in slots),
                    matrix=matrix if instanced else None,
                    instancer=item.parent.original.name if instanced else "",
                    index=instance_index(item) if instanced else (),
                    library=original.library.filepath if original.library else None,
                ),
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

    def shape(self, mesh: bpy.types.Mesh, keep: bool) -> Generator[None, None, Shape]:
        """A mesh's arrays; those of shared meshes are kept for the next time."""
        shape = self.shapes.get(mesh.as_pointer()) if keep else None
        if shape is None:
            shape = yield from read_shape(mesh)
            if keep:
                self.shapes[mesh.as_pointer()] = shape
        return shape


def receivers(lit: Callable[[Name], bool], sources: Sequence[Source]) -> frozenset[int]:
    """Indices of the meshes that a lamp lights which lights what is `lit`."""
    return frozenset(
        index
        for index, source in enumerate(sources)
        if lit((source.object_name, source.library)) or (source.instancer and lit((source.instancer, None)))
    )


def kept_uv(mesh: bpy.types.Mesh, name: str, settings: bpy.types.PropertyGroup | None) -> Float32 | None:
    """The uv map that the object is set to keep, by polygon corner, (L, 2), or None.

    Raises:
        SceneError: it has no such map
    """
    wanted = getattr(settings, "uv_map", "")
    uv = read_uv(mesh, wanted) if wanted else None
    if wanted and uv is None:
        raise SceneError(
            name, f"it has no uv map named {wanted!r}", "Choose one of its uv maps to keep, or none to unwrap"
        )
    return uv


def is_own_mesh(rendered: bpy.types.Mesh, original: bpy.types.Object) -> bool:
    """Whether a uv map written onto the object's own mesh is what the render shows."""
    shown = [mod for mod in original.modifiers if mod.show_render]
    if original.type != "MESH" or any(mod.type == "NODES" for mod in shown):
        return False
    return not shown or has_loops_of(rendered, original.data)


def terminator_offsets(thing: bpy.types.Object) -> tuple[float, float]:
    """Geometry and shading offset of the shadow terminator, which Cycles keeps by itself in Blender 4.2."""
    if hasattr(thing, "shadow_terminator_shading_offset"):
        return thing.shadow_terminator_geometry_offset, thing.shadow_terminator_shading_offset
    return thing.cycles.shadow_terminator_geometry_offset, thing.cycles.shadow_terminator_offset
