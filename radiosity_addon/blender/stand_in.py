# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain mesh objects that show what can't carry a lightmap itself.

A modified mesh, a curve or a text has other corners when rendered than in its data, and a mesh that several objects
share has one place for its uv map, not several. Such an object is kept, hidden, and its evaluated mesh is shown.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from .names import BAKE_KEY, HIDDEN_KEY, STAND_IN_KEY, is_behind_stand_in, is_stand_in, original_material
from .spline_meshes import mesh_of

LOOKS = (
    "hide_render", "hide_viewport", "hide_select", "color", "pass_index", "display_type", "lightgroup",
    "is_holdout", "is_shadow_catcher", "show_wire", "show_name", "show_in_front", "show_transparent",
    "visible_camera", "visible_diffuse", "visible_glossy", "visible_transmission", "visible_volume_scatter",
    "visible_shadow",
)  # fmt: skip
"""Properties of an object that decide how and where it is seen."""

VISIBILITY = ("hide_render", "hide_viewport", "show_instancer_for_render", "show_instancer_for_viewport")
"""Properties of an object that a stand-in's original loses and gets back."""


def make_stand_in(original: bpy.types.Object, depsgraph: bpy.types.Depsgraph, token: str) -> bpy.types.Object:
    """An object that shows the original as `depsgraph` has it, materials included, in no collection yet.

    It follows the original by a constraint: a matrix of its own could not hold a shear that comes from parents.
    """
    evaluated = original.evaluated_get(depsgraph)
    materials = [slot.material and original_material(slot.material.original) for slot in evaluated.material_slots]
    mesh = mesh_of(original, depsgraph)
    mesh[BAKE_KEY] = token
    mesh[STAND_IN_KEY] = True
    mesh.materials.clear()
    for material in materials:
        mesh.materials.append(material)
    if hasattr(original.data, "texspace_location"):  # generated texture coordinates
        mesh.use_auto_texspace = False
        mesh.texspace_location, mesh.texspace_size = original.data.texspace_location, original.data.texspace_size
    stand_in = bpy.data.objects.new(original.name, mesh)
    stand_in[BAKE_KEY] = token
    stand_in[STAND_IN_KEY] = original
    for name, value in original.items():
        if isinstance(value, (int, float, str, bool)) and name not in stand_in and name != HIDDEN_KEY:
            stand_in[name] = value  # shaders can read them
    stand_in.matrix_world = evaluated.matrix_world.copy()
    stand_in.constraints.new("COPY_TRANSFORMS").target = original
    return stand_in


def instancers(depsgraph: bpy.types.Depsgraph) -> set[str]:
    """Names of the objects that show instances of others."""
    return {
        item.parent.original.name
        for item in depsgraph.object_instances
        if item.is_instance and item.parent.original != item.object.original
    }


def swap_in(original: bpy.types.Object, stand_in: bpy.types.Object, token: str, instances: bool) -> None:
    """Show the stand-in wherever the original is seen, and hide the original.

    Args:
        original: the user's object
        stand_in: in no collection yet
        token: the bake's
        instances: the original shows instances of other objects, which must stay in sight
    """
    stand_in.name = stand_in.data.name = f"{original.name} (Radiosity)"
    for name in LOOKS:
        setattr(stand_in, name, getattr(original, name))
    for collection in _collections(original):
        collection.objects.link(stand_in)
    selected = []
    for scene in original.users_scene:
        for layer in scene.view_layers:
            if original.name in layer.objects:
                stand_in.hide_set(original.hide_get(view_layer=layer), view_layer=layer)
                if original.select_get(view_layer=layer):
                    selected.append([scene.name, layer.name])
    original[BAKE_KEY] = token
    original[HIDDEN_KEY] = {name: getattr(original, name) for name in VISIBILITY} | {"selected": json.dumps(selected)}
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


@contextmanager
def as_unbaked(scene: bpy.types.Scene) -> Iterator[None]:
    """Within, the originals are seen as before the bake and the stand-ins are not."""
    things = [thing for thing in scene.objects if is_stand_in(thing) or is_behind_stand_in(thing)]
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
        for thing, visibility in before:
            for name, shown in visibility.items():
                setattr(thing, name, shown)


def _collections(original: bpy.types.Object) -> list[bpy.types.Collection]:
    """Where a stand-in belongs: the original's collections, less those that mean physics or can't be changed."""
    physics = [scene.rigidbody_world.collection for scene in bpy.data.scenes if scene.rigidbody_world]
    shared = [group for group in original.users_collection if group not in physics and group.is_editable]
    return shared or [scene.collection for scene in original.users_scene]
