# SPDX-License-Identifier: GPL-3.0-or-later
"""The materials of a scene as records: one for each used in each light group, another for its back where unlike."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from ...arrays import Int32
from ...geometry.sheets import is_sheet
from ...scene import Material
from ..data.names import original_material
from ..looks.materials import read_sides
from ..looks.nodes import LinkCycle, is_only_volume, tree_of
from ..looks.surface_inputs import Asking
from .extraction import Notes, Skip


class MaterialRecords:
    """Materials that were read so far.

    Attributes:
        records: as the core takes them
        shown: of each record the full name of its material, and what it asks for if it varies
        volumes: indices of records that show a volume and no surface
    """

    def __init__(self, depsgraph: bpy.types.Depsgraph, notes: Notes) -> None:
        self._depsgraph = depsgraph
        self._notes = notes
        self._override = depsgraph.view_layer.material_override
        self._index: dict[tuple[str, int], int | LinkCycle] = {}
        self.records: list[Material] = []
        self.shown: list[tuple[str, Asking | None]] = []
        self.volumes: set[int] = set()

    @property
    def emit(self) -> bool:
        """Whether any of them shines."""
        return any(any(material.emission) or "emission" in material.varies for material in self.records)

    def of_slots(self, slots: list[bpy.types.Material | None], group: int, user: str) -> Int32:
        """Index into the records' materials of each slot; of the default surface where there is none."""
        override = self._override
        chosen = [override] * max(len(slots), 1) if override else (slots or [None])
        return np.array([self._of(material, group, user) for material in chosen], np.int32)

    def asking(self, of_slots: Int32, slot: Int32) -> list[Asking]:
        """What the records of slots ask for that triangles (F,) are of.

        Args:
            of_slots: as of that method
            slot: (F,), as stored, which may lie beyond the slots
        """
        if not any(self.shown[index][1] for index in of_slots):
            return []
        return [asked for index in _used(of_slots, slot) if (asked := self.shown[index][1]) is not None]

    def only_volume(self, of_slots: Int32, slot: Int32) -> bool:
        """Whether triangles of slots, as of `asking`, only bound a volume."""
        return bool(self.volumes) and self.volumes.issuperset(_used(of_slots, slot).tolist())

    def pass_light(self, of_slots: Int32, slot: Int32) -> bool:
        """Whether light passes scattered through any triangle of slots, as of `asking`, on either face."""
        used = [self.records[index] for index in _used(of_slots, slot)] if len(slot) else []
        behind = [self.records[each.back] for each in used if each.back is not None]
        return bool(is_sheet((*used, *behind)).any())

    def _of(self, material: bpy.types.Material | None, group: int, user: str) -> int:
        shown = original_material(material.original if material is not None else None)
        key = (shown.name_full if shown is not None else "", group)
        found = self._index.get(key)
        if found is None:
            found = self._index[key] = self._new(shown, group, user)
        if isinstance(found, LinkCycle):
            raise Skip(f"its material {key[0]!r} feeds back into itself")
        return found

    def _new(self, shown: bpy.types.Material | None, group: int, user: str) -> int | LinkCycle:
        evaluated = shown.evaluated_get(self._depsgraph) if shown is not None else None
        name = shown.name if shown is not None else ""
        try:
            front, back = read_sides(evaluated, group, self._notes.hears(f"Material {name!r} of {user}"))
        except LinkCycle as cycle:
            return cycle
        index = len(self.records)
        self.records += [front] if back is None else [replace(front, back=index + 1), back]
        output = tree.get_output_node("CYCLES") if evaluated and (tree := tree_of(evaluated)) else None
        if output is not None and is_only_volume(output):
            self.volumes.add(index)
        asking = Asking.of(evaluated.node_tree) if front.varies else None
        for text in asking.unanswered if asking else ():
            self._notes.warn(f"Material {name!r} of {user}: {text}")
        self.shown += [(shown.name_full if shown is not None else "", asking)] * (len(self.records) - index)
        return index


def _used(of_slots: Int32, slot: Int32) -> Int32:
    """The records that triangles are of, each once."""
    return np.unique(of_slots[np.clip(slot, 0, len(of_slots) - 1)])
