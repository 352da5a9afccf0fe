# SPDX-License-Identifier: GPL-3.0-or-later
"""What is rendered beside the objects of a scene: instances of collections, nodes, particles, vertices and faces."""

from __future__ import annotations

import bpy

RAYS = ("visible_camera", "visible_diffuse", "visible_glossy", "visible_shadow")
"""Properties of an object that say which rays see its surface."""

Key = tuple[str, tuple[int, ...], str]
"""What an instance is known by: its instancer, its index, and the object that it shows."""

VALUES = ("value", "vector", "color")
"""What an element of an attribute may call its value."""

NO_PARTNER = 2**31 - 1
"""What Blender fills a persistent id with after its last level."""


def is_instance(item: bpy.types.DepsgraphObjectInstance) -> bool:
    """Whether an object's surface is shown again elsewhere; the object itself isn't what is seen.

    The faces of a curve, text and the like come as an instance of the object made by itself, at the first level.
    """
    own = item.parent is not None and item.object.original == item.parent.original
    return item.is_instance and not (own and len(instance_index(item)) == 1)


def instance_index(item: bpy.types.DepsgraphObjectInstance) -> tuple[int, ...]:
    """Which of its instancer's an instance is, a number for each level of instancing."""
    return tuple(number for number in item.persistent_id if number != NO_PARTNER) if item.is_instance else ()


def settings_of(item: bpy.types.DepsgraphObjectInstance) -> list[bpy.types.PropertyGroup | None]:
    """The settings that an object or instance follows: an empty decides for all that it shows."""
    things = [item.object.original]
    if is_instance(item) and item.parent.type == "EMPTY":
        things.append(item.parent.original)
    return [getattr(thing, "radiosity", None) for thing in things]


def key_of(item: bpy.types.DepsgraphObjectInstance) -> Key:
    """What an instance is known by."""
    return item.parent.original.name, instance_index(item), item.object.name


def attribute_of(item: bpy.types.DepsgraphObjectInstance, name: str) -> tuple[float, ...] | None:
    """What geometry nodes stored under a name on an instance that they made; None where there is no such attribute.

    Blender tells attributes of instances from 4.5 on, and of those that the instancer itself makes only.
    """
    index = instance_index(item)
    if len(index) != 2 or not hasattr(item.parent, "evaluated_geometry"):
        return None
    geometry = item.parent.evaluated_geometry()  # the points live as long as it does
    instances = geometry.instances_pointcloud()
    attribute = instances.attributes.get(name) if instances is not None else None
    if attribute is None or attribute.domain != "POINT":
        return None
    row, ids = index[-1], instances.attributes.get("id")
    if ids is not None:
        row = next((at for at, known in enumerate(ids.data) if known.value == row), row)
    if not 0 <= row < len(attribute.data):
        return None
    value = next(getattr(attribute.data[row], part) for part in VALUES if hasattr(attribute.data[row], part))
    return tuple(map(float, value)) if hasattr(value, "__len__") else (float(value),)
