# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes a bake out of the .blend again, and leaves what was there before.

Works from what each datablock carries, so it holds after anything was renamed, copied or deleted in between.
"""

from __future__ import annotations

import bpy

from ..data.names import (
    BACK_UV_MAP,
    BAKE_KEY,
    KEYS,
    SLOT_KEY,
    SLOTS_KEY,
    STAND_IN_KEY,
    UV_KEY,
    UV_MAP,
    is_behind_stand_in,
    is_full_copy,
    is_preview,
    is_stand_in,
    original_material,
    original_world,
)
from ..data.stand_in import followed, set_materials, swap_out


def revert(scene: bpy.types.Scene) -> None:
    """Take the scene's bake out; a scene without one stays as it is, and so does one that this one is a copy of."""
    token = scene.get(BAKE_KEY)
    if is_full_copy(scene):
        _leave(scene, token)
    elif token is not None:
        take_out(token)


def take_out(token: str) -> None:
    """Remove all that a bake made, and undo all that it changed, wherever that carries the bake's token."""
    _adopt_joined(token)
    bpy.data.batch_remove([thing for thing in of_bake(bpy.data.objects, token) if is_stand_in(thing)])
    bpy.data.batch_remove(of_bake(bpy.data.collections, token))
    others = followed(thing for scene in bpy.data.scenes for thing in scene.objects)
    for thing in of_bake(bpy.data.objects, token):
        if thing in others and is_behind_stand_in(thing):  # the bake of another scene hides it too
            thing[BAKE_KEY] = others[thing][BAKE_KEY]
        elif is_behind_stand_in(thing):
            swap_out(thing)
        if SLOTS_KEY in thing:
            restore_slots(thing)
    for world in of_bake(bpy.data.worlds, token):
        world.user_remap(original_world(world))
        bpy.data.worlds.remove(world)
    _remove_previews(token)
    for mesh in of_bake(bpy.data.meshes, token):
        if STAND_IN_KEY in mesh and mesh.users == 0:
            bpy.data.meshes.remove(mesh)
        else:
            _restore_mesh(mesh)
    for image in of_bake(bpy.data.images, token):
        bpy.data.images.remove(image)
    for scene in of_bake(bpy.data.scenes, token):
        scene.property_unset("radiosity_mix")
    for kind in (bpy.data.objects, bpy.data.meshes, bpy.data.scenes):
        for datablock in of_bake(kind, token):
            _forget(datablock)


def _forget(datablock: bpy.types.ID) -> None:
    for key in KEYS:
        if key in datablock:
            del datablock[key]


def _leave(scene: bpy.types.Scene, token: str) -> None:
    """Undo what the bake that another scene has too changed in this one, and leave its images and materials."""
    bpy.data.batch_remove([thing for thing in scene.objects if thing.get(BAKE_KEY) == token and is_stand_in(thing)])
    groups = [group for group in scene.collection.children_recursive if group.get(BAKE_KEY) == token]
    bpy.data.batch_remove(groups)
    for thing in scene.objects:
        if is_behind_stand_in(thing):
            swap_out(thing)
        if SLOTS_KEY in thing:
            restore_slots(thing)
    meshes = {thing.data for thing in scene.objects if thing.data is not None and thing.data.get(BAKE_KEY) == token}
    for mesh in meshes:
        _take_slot(mesh)
        _restore_mesh(mesh)
    for slot in [slot for thing in scene.objects for slot in thing.material_slots]:
        if is_preview(slot.material) and slot.material.get(BAKE_KEY) == token:
            slot.material = original_material(slot.material)
    scene.world = original_world(scene.world)
    scene.property_unset("radiosity_mix")
    for datablock in (scene, *meshes, *scene.objects):
        _forget(datablock)


def _adopt_joined(token: str) -> None:
    """Give meshes that baked ones were joined to the token: they have our uv map and previews, but nothing says so."""
    for mesh in bpy.data.meshes:
        shows = any(is_preview(material) and material.get(BAKE_KEY) == token for material in mesh.materials)
        if shows and UV_KEY not in mesh and UV_MAP in mesh.uv_layers and mesh.is_editable:
            mesh[BAKE_KEY], mesh[UV_KEY] = token, {"active": "", "rendered": ""}


def of_bake(collection: bpy.types.bpy_prop_collection, token: str) -> list[bpy.types.ID]:
    """Datablocks of a kind that a bake made or changed."""
    return [datablock for datablock in collection if datablock.get(BAKE_KEY) == token]


def _remove_previews(token: str) -> None:
    for mesh in of_bake(bpy.data.meshes, token):
        _take_slot(mesh)
    for material in of_bake(bpy.data.materials, token):
        original = original_material(material)
        if original is not None:
            material.user_remap(original)
        bpy.data.materials.remove(material)
    for group in of_bake(bpy.data.node_groups, token):
        bpy.data.node_groups.remove(group)


def _take_slot(mesh: bpy.types.Mesh) -> None:
    """Take off the only material slot, where the bake gave it and it shows nothing else."""
    if SLOT_KEY in mesh:
        del mesh[SLOT_KEY]
        if len(mesh.materials) == 1 and (mesh.materials[0] is None or is_preview(mesh.materials[0])):
            set_materials(mesh, [])


def restore_slots(thing: bpy.types.Object) -> None:
    """Link the slots that still show a lightmap to what they were linked to."""
    for index, slot in enumerate(thing.material_slots):
        kept = thing[SLOTS_KEY].get(str(index))
        if kept is not None and slot.link == "OBJECT" and is_preview(slot.material):
            slot.material = kept.get("material")
            slot.link = kept["link"]


def _restore_mesh(mesh: bpy.types.Mesh) -> None:
    """Take our uv map off; where the user had made it the active one, the map that was active before is it again."""
    if UV_KEY not in mesh:
        return
    kept = mesh[UV_KEY].to_dict()
    layers = mesh.uv_layers
    for name in (BACK_UV_MAP, UV_MAP):
        if name not in layers:
            continue
        if layers[name].active and kept["active"] in layers:
            layers.active = layers[kept["active"]]
        if layers[name].active_render and kept["rendered"] in layers:
            layers[kept["rendered"]].active_render = True
        layers.remove(layers[name])
    del mesh[UV_KEY]
