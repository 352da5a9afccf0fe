# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake and revert as operators: blocking from scripts and in background, alive and cancellable in a window."""

from __future__ import annotations

import time
import traceback
from collections.abc import Generator
from pathlib import Path
from typing import ClassVar

import bpy

from ..chunks import finish
from ..errors import BakeError, explained
from ..files import Transaction
from ..progress import describe
from ..reports.report import Report
from ..stages import Progress
from .job import Job, bake_scene
from .last_bake import learn
from .names import is_baked
from .revert import revert

TICK_SECONDS = 0.01
"""Time between two ticks of the timer, for the window's own events."""
WORK_SECONDS = 0.04
"""Time of a tick that is spent on the bake, less than makes a window feel slow."""
MAX_WORK_SECONDS = 0.25
"""Where drawing the window takes longer than that, the bake gets half of the time, in turns of this at most."""
REDRAW_SECONDS = 0.2
"""Drawing takes time from the bake."""


class Running:
    """The bake that is going on in a window, of which there is one at most."""

    progress: Progress | None = None
    start = 0.0
    drawn = 0.0
    paused = 0.0

    @classmethod
    def text(cls) -> str:
        """How far it is, in words."""
        return describe(cls.progress, time.perf_counter() - cls.start) if cls.progress else ""


class RADIOSITY_OT_bake(bpy.types.Operator):
    """Bake the light of the scene, all bounces included, into lightmaps"""

    bl_idname = "radiosity.bake"
    bl_label = "Bake Radiosity"
    bl_options: ClassVar = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if Running.progress is not None:
            cls.poll_message_set("A bake is running; Esc cancels it")
            return False
        return context.scene is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            report = finish(bake_in_place(context.scene))
        except Exception as error:  # noqa: BLE001 whatever it is, the user gets one line
            return self._failed(error)
        return self._finished(report)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background:
            return self.execute(context)
        self._steps = bake_in_place(context.scene)
        Running.start = Running.paused = time.perf_counter()
        Running.progress = Progress("Read scene", 0.0)
        self._timer = context.window_manager.event_timer_add(TICK_SECONDS, window=context.window)
        context.window_manager.modal_handler_add(self)
        bpy.types.STATUSBAR_HT_header.append(draw_progress)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            self.report({"INFO"}, "Bake cancelled, nothing was changed")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        now = time.perf_counter()
        end = now + min(max(WORK_SECONDS, now - Running.paused), MAX_WORK_SECONDS)
        try:
            while time.perf_counter() < end:
                Running.progress = next(self._steps)
        except StopIteration as stop:
            self.cancel(context)
            return self._finished(stop.value)
        except Exception as error:  # noqa: BLE001 whatever it is, the user gets one line
            self.cancel(context)
            return self._failed(error)
        except BaseException:
            self.cancel(context)
            raise
        if end - Running.drawn > REDRAW_SECONDS:
            Running.drawn = end
            redraw(context)
        Running.paused = time.perf_counter()
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """End the bake; Blender calls this too, when another file is opened or the program quits."""
        self._steps.close()
        Running.progress = None
        context.window_manager.event_timer_remove(self._timer)
        bpy.types.STATUSBAR_HT_header.remove(draw_progress)
        redraw(context)

    def _failed(self, error: Exception) -> set[str]:
        if not isinstance(error, BakeError):
            traceback.print_exception(error)  # to the console, for the report of a defect
        self.report({"ERROR"}, explained(error))
        return {"CANCELLED"}

    def _finished(self, report: Report) -> set[str]:
        for warning in report.warnings:
            self.report({"WARNING"}, warning)
        self.report({"INFO"}, report.summary())
        return {"FINISHED"}


class RADIOSITY_OT_revert(bpy.types.Operator):
    """Take the bake out of the scene: materials, uv maps and objects become what they were before"""

    bl_idname = "radiosity.revert"
    bl_label = "Revert"
    bl_options: ClassVar = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if Running.progress is not None:
            cls.poll_message_set("A bake is running")
            return False
        if context.scene is None or not is_baked(context.scene):
            cls.poll_message_set("This scene is not baked")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        revert(context.scene)
        return {"FINISHED"}


def bake_in_place(scene: bpy.types.Scene) -> Generator[Progress, None, Report]:
    """Bake a scene of the open file with its own settings; pages lie beside the file, or in it while it is unsaved."""
    settings = scene.radiosity
    opened = Path(bpy.data.filepath) if bpy.data.is_saved else None
    job = Job(
        settings=settings.bake_settings(),
        write_back=settings.write_back,
        folder=_textures(settings.textures, opened),
        stem=opened.stem if opened else "unsaved",
        page_format=settings.files.page_format(),
    )
    with Transaction() as files:
        report = yield from bake_scene(scene, job, files)
        files.commit()
    learn(report)
    return report


def _textures(chosen: str, opened: Path | None) -> Path | None:
    if opened is None:
        return None
    if not chosen:
        return opened.with_name(f"{opened.stem}_textures")
    return Path(bpy.path.abspath(chosen)).resolve()


def draw_progress(self: bpy.types.Header, context: bpy.types.Context) -> None:
    """The bake's progress in the status bar."""
    if Running.progress is not None:
        row = self.layout.row()
        row.ui_units_x = 20
        row.progress(factor=Running.progress.fraction, text=Running.text())


def redraw(context: bpy.types.Context) -> None:
    """Draw the status bar and the places of our panels anew, not what is slow to draw."""
    if context.workspace is not None:
        context.workspace.status_text_set(None)
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            place = {"PROPERTIES": "WINDOW", "VIEW_3D": "UI"}.get(area.type)
            for region in area.regions:
                if region.type == place:
                    region.tag_redraw()


CLASSES = (RADIOSITY_OT_bake, RADIOSITY_OT_revert)


def register() -> None:
    """Add the operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Take the operators away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
