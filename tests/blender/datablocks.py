# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything that a .blend holds, as plain values: two snapshots are equal exactly when nothing changed."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import bpy
import numpy as np

SKIPPED = {
    "rna_type", "bl_rna", "session_uid", "id_data", "original", "is_evaluated", "is_updated", "is_updated_data",
    "is_runtime_data", "is_dirty", "is_saved", "use_autopack", "version", "filepath", "file_format", "bind_point",
    "frame_duration", "pixels", "preview", "depsgraph", "hierarchy", "storage_type", "use_nodes", "all_ids",
    "loop_triangles", "loop_triangle_polygons", "window_managers", "workspaces", "screens", "libraries", "brushes",
    "palettes", "texts", "fonts", "linestyles", "point_cache",
    "is_library_indirect",
}  # fmt: skip
"""What changes by itself, belongs to the window, or is derived."""
if bpy.app.version < (4, 3):
    # Scene.copy() counts what lies in the scene's own collection once too often; opening the file counts anew.
    SKIPPED.add("users")
UNREADABLE = {
    "MeshUVLoopLayer": {"data", "vertex_selection", "edge_selection", "pin"},
    "ToolSettings": {"uv_sculpt"},
}
"""Of a uv map, what crashes Blender 4.5 or makes layers when it is read; of tools, what crashes 4.2."""
BULK = 64
"""Collections of more items than this are compared by their arrays."""


def snapshot() -> dict[str, Any]:
    """All datablocks by kind and name, with all properties, custom ones included, and references by name."""
    bpy.context.view_layer.update()
    taken: dict[str, Any] = {}
    for prop in bpy.data.bl_rna.properties:
        if prop.type != "COLLECTION" or prop.identifier in SKIPPED:
            continue
        for datablock in getattr(bpy.data, prop.identifier):
            taken[f"{prop.identifier}/{datablock.name}"] = _properties(datablock, 0)
    for scene in bpy.data.scenes:
        for layer in scene.view_layers:
            taken[f"shown/{scene.name}/{layer.name}"] = {
                thing.name: [thing.select_get(view_layer=layer), thing.hide_get(view_layer=layer)]
                for thing in layer.objects
            }
    return taken


def differences(before: Any, after: Any, path: str = "") -> list[str]:
    """Where two snapshots differ, readable."""
    if isinstance(before, dict) and isinstance(after, dict):
        found = [f"{path}/{key} is gone" for key in before if key not in after]
        found += [f"{path}/{key} is new" for key in after if key not in before]
        for key in before:
            if key in after:
                found += differences(before[key], after[key], f"{path}/{key}")
        return found
    if isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        pairs = enumerate(zip(before, after, strict=True))
        return [text for index, pair in pairs for text in differences(*pair, f"{path}/{index}")]
    return [] if before == after else [f"{path}: {before!r} became {after!r}"]


def _properties(thing: Any, depth: int) -> dict[str, Any]:
    taken: dict[str, Any] = {}
    for prop in thing.bl_rna.properties:
        if prop.identifier in SKIPPED or prop.identifier in UNREADABLE.get(thing.bl_rna.identifier, ()):
            continue
        taken[prop.identifier] = _value(thing, prop, depth)
    if hasattr(thing, "keys") and not isinstance(thing, bpy.types.Preferences):
        with suppress(TypeError):  # this type has no custom properties
            taken["custom"] = {key: repr(value) for key, value in thing.items() if not hasattr(value, "keys")}
    return taken


def _value(thing: Any, prop: Any, depth: int) -> Any:
    value = getattr(thing, prop.identifier, None)
    if prop.type == "POINTER":
        if value is None:
            return None
        if isinstance(value, bpy.types.ID) and not _embedded(thing, value):
            return value.name_full
        return _properties(value, depth + 1) if depth < 5 else "..."
    if prop.type == "COLLECTION":
        return _collection(value, depth)
    if getattr(prop, "is_array", False):
        return np.array(value).ravel().tolist()
    return sorted(value) if isinstance(value, set) else value


def _embedded(owner: Any, value: Any) -> bool:
    return isinstance(owner, bpy.types.ID) and value.is_embedded_data


def _collection(items: Any, depth: int) -> Any:
    if items is None:
        return None
    listed = list(items)
    if listed and isinstance(listed[0], bpy.types.ID):
        return sorted(item.name_full if item is not None else "" for item in listed)
    if len(listed) > BULK:
        return [len(listed), *(_bulk(items, name) for name in ("co", "vector", "vertex_index", "value"))]
    return [
        None if item is None else item.name_full if isinstance(item, bpy.types.ID)
        else _properties(item, depth + 1) if depth < 5 else "..."
        for item in listed
    ]  # fmt: skip


def _bulk(items: Any, name: str) -> list[float]:
    prop = items[0].bl_rna.properties.get(name)
    if prop is None:
        return []
    values = np.empty(len(items) * max(prop.array_length, 1), np.float32)
    items.foreach_get(name, values)
    return values.tolist()
