# SPDX-License-Identifier: GPL-3.0-or-later
"""The check of a scene as an operator, what it found for the panels to draw, and what can be done about it."""

from __future__ import annotations

from typing import ClassVar

import bpy
from bpy.app.handlers import persistent
from bpy.props import StringProperty

from ...errors import explained
from ...estimate import Estimate, estimate
from ...reports.report import count_of
from ..data.names import BAKE_KEY, REPORT_KEY
from ..last_bake import pace
from ..reading.inspection import Inspection, inspect
from ..writing.originals import shows_originals
from .running import Running


class Checked:
    """What the last check of each scene found, by the scene's `session_uid`, until another file is opened.

    Drawing a panel must never evaluate a scene: panels draw what is known, and say when it may have changed.
    """

    found: ClassVar[dict[int, Inspection]] = {}
    stale: ClassVar[set[int]] = set()
    shown: ClassVar[dict[int, object]] = {}

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> Inspection | None:
        return cls.found.get(scene.session_uid)

    @classmethod
    def is_stale(cls, scene: bpy.types.Scene) -> bool:
        """Whether the scene may have changed since."""
        return scene.session_uid in cls.stale

    @classmethod
    def keep(cls, scene: bpy.types.Scene, inspection: Inspection) -> None:
        cls.found[scene.session_uid] = inspection
        cls.stale.discard(scene.session_uid)
        cls.shown[scene.session_uid] = bake_shown(scene)


def bake_shown(scene: bpy.types.Scene) -> object:
    """What changes whenever a bake is written, taken out, or hidden behind the original."""
    return scene.get(BAKE_KEY), shows_originals(scene)


def expected(scene: bpy.types.Scene) -> Estimate:
    """What the next bake of a scene will take, as far as that is known now."""
    known = Checked.of(scene)
    settings = scene.radiosity.bake_settings()
    area, groups = (known.area, known.page_groups) if known else (None, 1)
    shining = known.shining if known and REPORT_KEY not in scene else 0  # the last bake of a scene knows of them
    return estimate(area, settings, max(groups, 1), pace(scene), shining)


class RADIOSITY_OT_check(bpy.types.Operator):
    """Look the scene over as a bake would read it: what will be skipped, what looks wrong, what it will take"""

    bl_idname = "radiosity.check"
    bl_label = "Check Scene"
    bl_options: ClassVar = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if Running.progress is not None:
            cls.poll_message_set("A bake is running")
            return False
        return context.scene is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        try:
            inspection = inspect(scene, scene.radiosity.bake_settings())
        except Exception as error:  # noqa: BLE001 whatever it is, the user gets one line
            self.report({"ERROR"}, explained(error))
            return {"CANCELLED"}
        context.view_layer.update()
        Checked.keep(scene, inspection)
        count = sum(finding.severity != "info" for finding in inspection.findings)
        self.report({"INFO"}, f"{count_of(count, 'thing')} to look at" if count else "Nothing looks wrong")
        return {"FINISHED"}


class RADIOSITY_OT_select(bpy.types.Operator):
    """Select this object alone and make it the active one"""

    bl_idname = "radiosity.select"
    bl_label = "Select Object"
    bl_options: ClassVar = {"REGISTER", "UNDO", "INTERNAL"}

    name: StringProperty(name="Object", description="Name of the object to select, one of the present view layer")

    def execute(self, context: bpy.types.Context) -> set[str]:
        thing = context.view_layer.objects.get(self.name)
        if thing is None:
            self.report({"WARNING"}, f"{self.name} is not in this view layer")
            return {"CANCELLED"}
        if context.object is not None and context.object.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        for other in context.selected_objects:
            other.select_set(False)
        context.view_layer.objects.active = thing
        thing.select_set(True)
        if not thing.visible_get():
            self.report({"INFO"}, f"{self.name} is hidden in this view")
        return {"FINISHED"}


class RADIOSITY_OT_flip(bpy.types.Operator):
    """Turn all faces of this object round, so that their fronts are where they are seen"""

    bl_idname = "radiosity.flip"
    bl_label = "Flip Normals"
    bl_options: ClassVar = {"REGISTER", "UNDO", "INTERNAL"}

    name: StringProperty(name="Object", description="Name of the mesh object whose faces are turned round")

    def execute(self, context: bpy.types.Context) -> set[str]:
        thing = context.scene.objects.get(self.name)
        if thing is None or thing.type != "MESH" or not thing.data.is_editable or thing.mode != "OBJECT":
            self.report({"WARNING"}, f"{self.name} has no mesh that can be changed now")
            return {"CANCELLED"}
        thing.data.flip_normals()
        thing.data.update()
        inspection = Checked.of(context.scene)
        if inspection is not None:
            Checked.found[context.scene.session_uid] = inspection.without(self.name)
        return {"FINISHED"}


@persistent
def mark_stale(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Note that a scene has changed since it was checked."""
    uid = scene.session_uid
    if uid not in Checked.found or uid in Checked.stale or Running.progress is not None:
        return
    before, Checked.shown[uid] = Checked.shown[uid], bake_shown(scene)
    if before != Checked.shown[uid]:
        return  # what a check sees is the original, whatever is shown
    if any(update.is_updated_geometry or update.is_updated_transform for update in depsgraph.updates):
        Checked.stale.add(uid)


@persistent
def forget_all(*_: object) -> None:
    """Another file is opened: the ids of its scenes may be those of others."""
    Checked.found.clear()
    Checked.shown.clear()
    Checked.stale.clear()


def settings_changed(settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """For settings that a check depends on: what it found may no longer be so."""
    Checked.stale.update(Checked.found)


CLASSES = (RADIOSITY_OT_check, RADIOSITY_OT_select, RADIOSITY_OT_flip)


def register() -> None:
    """Add the operators, and listen for changes."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.app.handlers.depsgraph_update_post.append(mark_stale)
    bpy.app.handlers.load_pre.append(forget_all)


def unregister() -> None:
    """Take all of it away again."""
    bpy.app.handlers.load_pre.remove(forget_all)
    bpy.app.handlers.depsgraph_update_post.remove(mark_stale)
    forget_all()
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
