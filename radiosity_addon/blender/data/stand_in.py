# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain mesh objects that show what can't carry a lightmap itself.

A modified mesh, a curve or a text has other corners when rendered than in its data, and a mesh that is stretched in
different ways needs several uv maps. Such an object is kept, hidden, and its evaluated mesh is shown.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TypeAlias

import bpy
import numpy as np

from .evaluation import at_render_settings
from .names import (
    BAKE_KEY,
    HIDDEN_KEY,
    KEYS,
    STAND_IN_KEY,
    is_behind_stand_in,
    is_stand_in,
    original_material,
    original_world,
)
from .shapes import slots_of
from .spline_meshes import spline_mesh

LOOKS = (
    "hide_render", "hide_viewport", "hide_select", "color", "pass_index", "display_type", "lightgroup",
    "is_holdout", "is_shadow_catcher", "show_wire", "show_name", "show_in_front", "show_transparent",
    "visible_camera", "visible_diffuse", "visible_glossy", "visible_transmission", "visible_volume_scatter",
    "visible_shadow",
)  # fmt: skip
"""Properties of an object that decide how and where it is seen."""

VISIBILITY = ("hide_render", "hide_viewport", "show_instancer_for_render", "show_instancer_for_viewport")
"""Properties of an object that a stand-in's original loses and gets back."""


Common: TypeAlias = tuple[str, int]
"""What all have in common that share a mesh: the name of a kind, and a number."""


class MeshPool:
    """Meshes of the file as evaluated objects and instances show them, one for all that have something in common."""

    def __init__(self, depsgraph: bpy.types.Depsgraph, token: str) -> None:
        self.depsgraph = depsgraph
        self.token = token
        self._made: dict[Common, bpy.types.Mesh] = {}

    def of(self, thing: bpy.types.Object, common: Common | None) -> Generator[None, None, bpy.types.Mesh]:
        """The mesh of an evaluated object, in steps; "rendered" is in common, for want of more, what is so alike."""
        key = common or ("rendered", thing.data.as_pointer())
        if key not in self._made:
            self._made[key] = yield from self._copy(thing)
        return self._made[key]

    def _copy(self, thing: bpy.types.Object) -> Generator[None, None, bpy.types.Mesh]:
        original = thing.original
        evaluated = original.evaluated_get(self.depsgraph)
        made_by_nodes = thing.type == "MESH" and thing.data != evaluated.data  # it belongs to no object
        materials = materials_of(thing)
        splines = yield from spline_mesh(original, self.depsgraph)
        if splines is not None:
            mesh = splines.mesh
        elif made_by_nodes:
            mesh = thing.data.copy()
        else:
            mesh = bpy.data.meshes.new_from_object(evaluated, preserve_all_data_layers=True, depsgraph=self.depsgraph)
        mesh[BAKE_KEY] = self.token
        mesh[STAND_IN_KEY] = True
        set_materials(mesh, materials)
        if hasattr(original.data, "texspace_location") and not made_by_nodes:  # generated texture coordinates
            mesh.use_auto_texspace = False
            mesh.texspace_location, mesh.texspace_size = original.data.texspace_location, original.data.texspace_size
        return mesh


def materials_of(thing: bpy.types.Object) -> list[bpy.types.Material | None]:
    """The user's materials in the slots of an evaluated object or instance."""
    return [material and original_material(material.original) for material in slots_of(thing)]


def set_materials(mesh: bpy.types.Mesh, materials: Sequence[bpy.types.Material | None]) -> None:
    """Give a mesh these slots; each face keeps its index, which Blender sets to 0 where slots are cleared."""
    index = np.zeros(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("material_index", index)
    mesh.materials.clear()
    for material in materials:
        mesh.materials.append(material)
    if index.any():
        mesh.polygons.foreach_set("material_index", index)


def dress(stand_in: bpy.types.Object, materials: Sequence[bpy.types.Material | None]) -> None:
    """Give a stand-in these materials where those of its mesh, which others may share, are not the same."""
    for slot, material in zip(stand_in.material_slots, materials, strict=False):
        if slot.material != material:
            slot.link, slot.material = "OBJECT", material


def make_stand_in(
    original: bpy.types.Object, pool: MeshPool, common: Common | None
) -> Generator[None, None, bpy.types.Object]:
    """An object that shows the original as a pool's depsgraph has it, materials included, in no collection yet.

    It follows the original by a constraint: a matrix of its own could not hold a shear that comes from parents.
    """
    evaluated = original.evaluated_get(pool.depsgraph)
    stand_in = bpy.data.objects.new(original.name, (yield from pool.of(evaluated, common)))
    stand_in[BAKE_KEY] = pool.token
    stand_in[STAND_IN_KEY] = original
    for name, value in carried_properties(original).items():
        stand_in[name] = value
    dress(stand_in, materials_of(evaluated))
    stand_in.matrix_world = evaluated.matrix_world.copy()
    stand_in.constraints.new("COPY_TRANSFORMS").target = original
    return stand_in


def carried_properties(original: bpy.types.Object) -> dict[str, object]:
    """Custom properties that shaders can read."""
    return {
        name: value
        for name, value in original.items()
        if name not in KEYS and (isinstance(value, (int, float, str, bool)) or hasattr(value, "typecode"))
    }


def swap_in(original: bpy.types.Object, stand_in: bpy.types.Object, token: str, instances: bool) -> None:
    """Show the stand-in wherever the original is seen, and hide the original.

    Args:
        original: the user's object
        stand_in: in no collection yet
        token: the bake's
        instances: the original shows instances of other objects, which must stay in sight
    """
    name_after(original, stand_in)
    hidden = original.get(HIDDEN_KEY, {})  # by the bake of another scene that shares it
    for name in LOOKS:
        setattr(stand_in, name, bool(hidden[name]) if name in hidden else getattr(original, name))
    for collection in collections_of(original):
        collection.objects.link(stand_in)
    for scene in original.users_scene:
        for layer in scene.view_layers:
            if original.name in layer.objects:
                stand_in.hide_set(original.hide_get(view_layer=layer), view_layer=layer)
    hide(original, token, instances)


def name_after(original: bpy.types.Object, stand_in: bpy.types.Object) -> None:
    """Name a stand-in and its mesh, when the names that those of an earlier bake had are free."""
    stand_in.name = f"{original.name} (Radiosity)"
    if isinstance(stand_in.data, bpy.types.Mesh) and STAND_IN_KEY in stand_in.data:
        stand_in.data.name = stand_in.name


def hide(original: bpy.types.Object, token: str, instances: bool) -> None:
    """Hide an object whose stand-ins are shown, all of it or all but the `instances` that it makes.

    Where the bake of another scene hides it already, what it was before that is kept.
    """
    selected = [
        [scene.name, layer.name]
        for scene in original.users_scene
        for layer in scene.view_layers
        if original.name in layer.objects and original.select_get(view_layer=layer)
    ]
    original[BAKE_KEY] = token
    if not is_behind_stand_in(original):
        seen = {name: getattr(original, name) for name in VISIBILITY}
        original[HIDDEN_KEY] = seen | {"selected": json.dumps(selected)}
    if instances:
        original.show_instancer_for_render = original.show_instancer_for_viewport = False
    else:
        original.hide_render = original.hide_viewport = True


def swap_out(original: bpy.types.Object) -> None:
    """Show an object again as it was before its stand-in took over."""
    kept = original[HIDDEN_KEY].to_dict()
    del original[HIDDEN_KEY]
    for name in VISIBILITY:
        setattr(original, name, bool(kept[name]))
    for scene_name, layer_name in json.loads(kept["selected"]):
        scene = bpy.data.scenes.get(scene_name)
        layer = scene and scene.view_layers.get(layer_name)
        if layer is not None and original.name in layer.objects:
            original.select_set(True, view_layer=layer)


def followed(things: Iterable[bpy.types.Object]) -> dict[bpy.types.Object, bpy.types.Object]:
    """What stand-ins among these objects show where it is, each with its stand-in; None is what was deleted."""
    return {
        thing[STAND_IN_KEY]: thing
        for thing in things
        if is_stand_in(thing) and any(each.type == "COPY_TRANSFORMS" for each in thing.constraints)
    }


@contextmanager
def as_unbaked(scene: bpy.types.Scene) -> Iterator[None]:
    """Within, the originals and the user's world are seen as before the bake, and the stand-ins are not."""
    things = [thing for thing in scene.objects if is_stand_in(thing) or is_behind_stand_in(thing)]
    world, scene.world = scene.world, original_world(scene.world)
    before = [(thing, {name: getattr(thing, name) for name in VISIBILITY}) for thing in things]
    for thing in things:
        if is_stand_in(thing):
            thing.hide_render = thing.hide_viewport = True
            continue
        for name in VISIBILITY:
            setattr(thing, name, bool(thing[HIDDEN_KEY][name]))
    try:
        yield
    finally:
        scene.world = world
        for thing, visibility in before:
            for name, shown in visibility.items():
                setattr(thing, name, shown)


@contextmanager
def as_rendered_unbaked(scene: bpy.types.Scene) -> Iterator[bpy.types.Depsgraph]:
    """A graph at render settings as of a scene that was never baked, while the scene itself shows its bake."""
    with ExitStack() as stack:
        with as_unbaked(scene):
            depsgraph = stack.enter_context(at_render_settings(scene))
        yield depsgraph


def collections_of(original: bpy.types.Object) -> list[bpy.types.Collection]:
    """Where a stand-in belongs: the original's collections, less those that mean physics or can't be changed."""
    physics = [scene.rigidbody_world.collection for scene in bpy.data.scenes if scene.rigidbody_world]
    shared = [group for group in original.users_collection if group not in physics and group.is_editable]
    return shared or [scene.collection for scene in original.users_scene]
