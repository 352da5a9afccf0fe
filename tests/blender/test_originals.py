# SPDX-License-Identifier: GPL-3.0-or-later
"""The original shown in place of the bake, and back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
import pytest

from radiosity_addon.blender.data.names import is_preview, is_stand_in
from radiosity_addon.blender.data.stand_in import VISIBILITY
from radiosity_addon.blender.writing.originals import show_bake, show_originals, shows_originals
from radiosity_addon.blender.writing.revert import revert
from tests.blender import instanced
from tests.blender.baked import bake, quad
from tests.blender.datablocks import differences, snapshot
from tests.blender.materials import diffuse


@pytest.fixture
def things() -> list[bpy.types.Object]:
    """One of each kind: a plain mesh, two that share one, a slot of the object's own, no slot, and a modified mesh."""
    plain, first = quad("Plain", diffuse("White", 0.8)), quad("First", diffuse("Red", 0.4))
    second = bpy.data.objects.new("Second", first.data)
    bpy.context.scene.collection.objects.link(second)
    own = quad("Own", diffuse("Blue", 0.2))
    own.material_slots[0].link = "OBJECT"
    own.material_slots[0].material = diffuse("Green", 0.3)
    bare, modified = quad("Bare"), quad("Modified", diffuse("Grey", 0.5))
    modified.modifiers.new("Bevel", "SUBSURF")
    modified.select_set(True)
    return [plain, first, second, own, bare, modified]


def looks() -> dict[str, object]:
    """What is seen of each object that a bake did not make: its materials, and whether it is hidden."""
    return {
        thing.name: (
            [(slot.link, slot.material and slot.material.name) for slot in thing.material_slots if slot.material],
            [getattr(thing, name) for name in VISIBILITY],
        )
        for thing in bpy.data.objects
        if not is_stand_in(thing)
    }


def seen() -> set[str]:
    """Objects that are rendered."""
    return {thing.name for thing in bpy.context.scene.objects if not thing.hide_render}


def baked(things: list[bpy.types.Object], folder: Path) -> None:
    bake(things, folder, own={"Second": True})


def test_the_original_looks_as_before_the_bake(things: list[bpy.types.Object], tmp_path: Path) -> None:
    before, rendered = looks(), seen()
    baked(things, tmp_path)
    assert looks() != before
    show_originals(bpy.context.scene)
    assert looks() == before
    assert seen() == rendered, "stand-ins are hidden, too"
    assert shows_originals(bpy.context.scene)


def test_what_is_drawn_follows(things: list[bpy.types.Object], tmp_path: Path) -> None:
    def drawn() -> list[str]:
        bpy.context.view_layer.update()
        evaluated = [thing.evaluated_get(bpy.context.evaluated_depsgraph_get()) for thing in things]
        return [slot.material.name for thing in evaluated for slot in thing.material_slots if slot.material]

    before = drawn()
    baked(things, tmp_path)
    lit = drawn()
    show_originals(bpy.context.scene)
    assert drawn() == before != lit
    show_bake(bpy.context.scene)
    assert drawn() == lit


def test_there_and_back_leaves_the_bake_as_it_was(things: list[bpy.types.Object], tmp_path: Path) -> None:
    baked(things, tmp_path)
    lit = snapshot()
    show_originals(bpy.context.scene)
    show_bake(bpy.context.scene)
    show_originals(bpy.context.scene)
    show_bake(bpy.context.scene)
    left = [text for text in differences(lit, snapshot()) if "radiosity_bake" not in text]
    assert left == []
    assert not shows_originals(bpy.context.scene)


def test_revert_is_exact_while_the_original_is_shown(things: list[bpy.types.Object], tmp_path: Path) -> None:
    before = snapshot()
    baked(things, tmp_path)
    show_originals(bpy.context.scene)
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []


def test_a_new_bake_while_the_original_is_shown_is_seen_and_reverts(
    things: list[bpy.types.Object], tmp_path: Path
) -> None:
    before = snapshot()
    baked(things, tmp_path)
    lit = looks()
    show_originals(bpy.context.scene)
    baked(things, tmp_path)
    assert not shows_originals(bpy.context.scene)
    assert looks() == lit
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []


def test_changes_made_to_the_original_are_kept(things: list[bpy.types.Object], tmp_path: Path) -> None:
    baked(things, tmp_path)
    show_originals(bpy.context.scene)
    other = diffuse("Other", 0.1)
    things[0].data.materials[0] = other
    things[2].material_slots[0].link = "OBJECT"
    things[2].material_slots[0].material = other
    things[5].hide_render = True
    show_bake(bpy.context.scene)
    assert things[0].data.materials[0] == other
    assert things[2].material_slots[0].material == other
    assert is_preview(things[1].material_slots[0].material)
    revert(bpy.context.scene)
    assert things[0].data.materials[0] == things[2].material_slots[0].material == other
    assert things[5].hide_render


def test_the_state_is_saved_with_the_file(things: list[bpy.types.Object], tmp_path: Path) -> None:
    before = looks()
    baked(things, tmp_path)
    lit = looks()
    show_originals(bpy.context.scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "room.blend"))
    assert looks() == before
    show_bake(bpy.context.scene)
    assert looks() == lit


@pytest.mark.parametrize("make", [instanced.collections, instanced.objects, instanced.particles, instanced.node_meshes])
def test_instances_are_shown_as_before_and_again_as_baked(make: Callable[[], None]) -> None:
    instanced.stage()
    make()
    before, rendered = snapshot(), seen()
    instanced.bake(page_size=128)
    lit, stand_ins = looks(), seen()
    show_originals(bpy.context.scene)
    assert seen() == rendered
    show_bake(bpy.context.scene)
    assert (looks(), seen()) == (lit, stand_ins)
    show_originals(bpy.context.scene)
    revert(bpy.context.scene)
    assert differences(before, snapshot()) == []
