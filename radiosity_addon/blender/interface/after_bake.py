# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be done with a baked scene: look at the original again and at the bake's report, or take it out."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import bpy

from ...errors import explained
from ..data.names import REPORT_KEY, is_baked
from ..last_bake import write_last_report
from ..writing.originals import show_bake, show_originals, shows_originals
from ..writing.revert import revert
from .running import Running


class OfBakedScene:
    """What can be done with a baked scene alone, and while no bake runs."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if Running.progress is not None:
            cls.poll_message_set("A bake is running")
            return False
        if context.scene is None or not is_baked(context.scene):
            cls.poll_message_set("This scene is not baked")
            return False
        return True


class RADIOSITY_OT_toggle(OfBakedScene, bpy.types.Operator):
    """Switch the whole scene between its baked light and how it was before the bake; nothing is lost either way"""

    bl_idname = "radiosity.toggle"
    bl_label = "Show Original"
    bl_options: ClassVar = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        if shows_originals(context.scene):
            show_bake(context.scene)
        else:
            show_originals(context.scene)
        return {"FINISHED"}


class RADIOSITY_OT_revert(OfBakedScene, bpy.types.Operator):
    """Take the bake out of the scene: materials, uv maps and objects become what they were before"""

    bl_idname = "radiosity.revert"
    bl_label = "Revert"
    bl_options: ClassVar = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        revert(context.scene)
        return {"FINISHED"}


class RADIOSITY_OT_show_report(bpy.types.Operator):
    """Open the report of the last bake in the web browser: its pages, times, residual, densities and warnings"""

    bl_idname = "radiosity.show_report"
    bl_label = "Show Report"
    bl_options: ClassVar = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.scene is None or REPORT_KEY not in context.scene:
            cls.poll_message_set("There is no report of a bake in this scene")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            page = write_last_report(context.scene, Path(bpy.app.tempdir))
        except Exception as error:  # noqa: BLE001 whatever it is, the user gets one line
            self.report({"ERROR"}, explained(error))
            return {"CANCELLED"}
        if not bpy.app.background:
            bpy.ops.wm.url_open(url=page.as_uri())
        self.report({"INFO"}, f"Wrote {page}")
        return {"FINISHED"}


class RADIOSITY_OT_see(OfBakedScene, bpy.types.Operator):
    """Let this 3D view show materials, with the world, the lamps and the exposure of the scene"""

    bl_idname = "radiosity.see"
    bl_label = "See It in Material Preview"
    bl_options: ClassVar = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and isinstance(context.space_data, bpy.types.SpaceView3D)

    def execute(self, context: bpy.types.Context) -> set[str]:
        shading = context.space_data.shading
        shading.type = "MATERIAL"
        shading.use_scene_lights = shading.use_scene_world = True
        return {"FINISHED"}


CLASSES = (RADIOSITY_OT_toggle, RADIOSITY_OT_revert, RADIOSITY_OT_show_report, RADIOSITY_OT_see)


def register() -> None:
    """Add the operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Take the operators away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
