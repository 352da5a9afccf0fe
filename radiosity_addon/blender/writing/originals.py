# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene as it was before its bake, shown in place of the baked one, and back: the bake stays in the file.

What a user changes in between is kept: a slot that was given another material is not touched on the way back, and
what was hidden or moved stays so.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from ..data.names import (
    BAKE_KEY,
    ORIGINALS_KEY,
    SHOWN_KEY,
    SLOTS_KEY,
    STAND_IN_KEY,
    is_behind_stand_in,
    is_preview,
    is_stand_in,
    original_material,
    original_world,
)
from ..data.stand_in import hide, swap_out
from .revert import of_bake, restore_slots

SIGHT = ("hide_render", "hide_viewport")


def shows_originals(scene: bpy.types.Scene) -> bool:
    """Whether a baked scene is shown as it was before the bake."""
    return ORIGINALS_KEY in scene


def show_originals(scene: bpy.types.Scene) -> None:
    """Show a baked scene as it was before, with the bake behind it."""
    token = scene[BAKE_KEY]
    for thing in of_bake(bpy.data.objects, token):
        if is_stand_in(thing):
            thing[SHOWN_KEY] = {name: getattr(thing, name) for name in SIGHT}
            thing.hide_render = thing.hide_viewport = True
        elif is_behind_stand_in(thing):
            only_instances = not thing.hide_render
            swap_out(thing)
            thing[ORIGINALS_KEY] = only_instances
    for mesh in of_bake(bpy.data.meshes, token):
        shown = {str(index): each for index, each in enumerate(mesh.materials) if _of_bake(each, token)}
        if shown and STAND_IN_KEY not in mesh:
            mesh[SHOWN_KEY] = shown
            for index, preview in shown.items():
                mesh.materials[int(index)] = original_material(preview)
            mesh.update()  # or the 3D view goes on showing what it has
    for thing in bpy.data.objects:
        if not is_stand_in(thing):
            _undress(thing, token)
    if original_world(scene.world) != scene.world:
        scene[SHOWN_KEY], scene.world = scene.world, original_world(scene.world)
    scene[ORIGINALS_KEY] = True


def show_bake(scene: bpy.types.Scene) -> None:
    """Show the bake of a scene again."""
    token = scene[BAKE_KEY]
    del scene[ORIGINALS_KEY]
    if SHOWN_KEY in scene:
        if scene.world == original_world(scene[SHOWN_KEY]):
            scene.world = scene[SHOWN_KEY]
        del scene[SHOWN_KEY]
    for mesh in of_bake(bpy.data.meshes, token):
        if SHOWN_KEY in mesh:
            for index, preview in mesh[SHOWN_KEY].items():
                if int(index) < len(mesh.materials) and mesh.materials[int(index)] == original_material(preview):
                    mesh.materials[int(index)] = preview
            del mesh[SHOWN_KEY]
            mesh.update()
    for thing in of_bake(bpy.data.objects, token):
        if ORIGINALS_KEY in thing:
            only_instances = bool(thing[ORIGINALS_KEY])
            del thing[ORIGINALS_KEY]
            hide(thing, token, instances=only_instances)
        if SHOWN_KEY not in thing:
            continue
        if is_stand_in(thing):
            for name in SIGHT:
                setattr(thing, name, bool(thing[SHOWN_KEY][name]))
        else:
            _dress(thing)
        del thing[SHOWN_KEY]


@contextmanager
def as_baked(scene: bpy.types.Scene) -> Iterator[None]:
    """Within, the bake is shown; afterwards what was shown before."""
    originals = shows_originals(scene)
    if originals:
        show_bake(scene)
    try:
        yield
    finally:
        if originals:
            show_originals(scene)


def _undress(thing: bpy.types.Object, token: str) -> None:
    """Give an object's own slots the materials that its previews stand for."""
    own = {
        str(index): slot.material
        for index, slot in enumerate(thing.material_slots)
        if slot.link == "OBJECT" and _of_bake(slot.material, token)
    }
    if not own:
        return
    thing[BAKE_KEY], thing[SHOWN_KEY] = token, own
    if SLOTS_KEY in thing:
        restore_slots(thing)
    for slot in thing.material_slots:
        if slot.link == "OBJECT" and _of_bake(slot.material, token):
            slot.material = original_material(slot.material)


def _dress(thing: bpy.types.Object) -> None:
    """Give an object's slots their previews back, where they still hold what those stand for."""
    for index, preview in thing[SHOWN_KEY].items():
        slot = thing.material_slots[int(index)] if int(index) < len(thing.material_slots) else None
        if slot is not None and slot.material == original_material(preview):
            slot.link = "OBJECT"
            slot.material = preview


def _of_bake(material: bpy.types.Material | None, token: str) -> bool:
    return is_preview(material) and material.get(BAKE_KEY) == token
