# SPDX-License-Identifier: GPL-3.0-or-later
"""Which objects a lamp lights that is linked to a collection."""

from __future__ import annotations

from collections.abc import Callable

import bpy

Name = tuple[str, str | None]
"""An object's name and the file that it is linked from."""


def lit_by(linked: bpy.types.Collection) -> Callable[[Name], bool]:
    """Tells by name whether an object receives the light.

    What a collection includes is lit and nothing else; what it excludes is not; where it includes nothing, all else is.
    An object's own word goes before that of the collections that it is in.
    """
    included: dict[Name, bool] = {}
    for child, entry in zip(linked.children, linked.collection_children, strict=True):
        for thing in child.all_objects:
            wanted = entry.light_linking.link_state == "INCLUDE"
            included[_name(thing)] = included.get(_name(thing), True) and wanted
    for thing, entry in zip(linked.objects, linked.collection_objects, strict=True):
        included[_name(thing)] = entry.light_linking.link_state == "INCLUDE"
    otherwise = not any(included.values())
    return lambda name: included.get(name, otherwise)


def _name(thing: bpy.types.Object) -> Name:
    return thing.name, thing.library and thing.library.filepath
