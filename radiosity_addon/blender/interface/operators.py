# SPDX-License-Identifier: GPL-3.0-or-later
"""The bake as an operator: blocking from scripts and in background, alive and cancellable in a window."""

from __future__ import annotations

import time
import traceback
from collections.abc import Generator
from pathlib import Path
from typing import ClassVar

import bpy

from ...chunks import finish
from ...errors import BakeError, explained
from ...files import Transaction
from ...reports.report import Report
from ...stages import Progress
from ..background import take_turn
from ..job import Job, Seat, bake_scene
from ..last_bake import keep_report, learn
from .running import Running
from .scene_check import expected

TICK_SECONDS = 0.01
"""Time between two ticks of the timer, for the window's own events."""
WORK_SECONDS = 0.07
"""Time of a tick that is spent on what only the main thread can do, where that comes in steps: after each tick Blender
may evaluate and draw the scene anew, which takes it longer than most steps. The last step comes on top."""


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
        self._seat = Seat(Running.seat, second_blender=True)
        self._steps = bake_in_place(context.scene, self._seat)
        self._timer = context.window_manager.event_timer_add(TICK_SECONDS, window=context.window)
        Running.begin(expected(context.scene).seconds)
        ended = self._go_on(context)  # the bake is under way before the window is drawn again
        if not ended:
            context.window_manager.modal_handler_add(self)
        return ended or {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if Running.cancelled or (event.type == "ESC" and event.value == "PRESS"):
            self.cancel(context)
            self.report({"INFO"}, "Bake cancelled, nothing was changed")
            return {"CANCELLED"}
        if event.type != "TIMER":  # what the bake is doing to the file is not to be disturbed
            return {"RUNNING_MODAL" if self._seat.main.busy or Running.in_file() else "PASS_THROUGH"}
        ended = self._go_on(context)
        if not ended:
            Running.settle()
            Running.redraw(context)
        return ended or {"PASS_THROUGH"}

    def _go_on(self, context: bpy.types.Context) -> set[str]:
        """Take a turn; if that was the last one, how it ended."""
        try:
            self._take_turn()
        except StopIteration as stop:
            report = Running.told(stop.value)
            self.cancel(context)
            keep_report(context.scene, report)
            return self._finished(report)
        except Exception as error:  # noqa: BLE001 whatever it is, the user gets one line
            self.cancel(context)
            return self._failed(error)
        except BaseException:
            self.cancel(context)
            raise
        return set()

    def _take_turn(self) -> None:
        began, stage = time.perf_counter(), Running.progress.stage
        try:
            Running.progress = take_turn(self._steps, Running.progress, WORK_SECONDS)
        finally:
            Running.turned(stage, began)

    def cancel(self, context: bpy.types.Context) -> None:
        """End the bake; Blender calls this too, when another file is opened or the program quits."""
        self._steps.close()
        context.window_manager.event_timer_remove(self._timer)
        Running.end(context)

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


class RADIOSITY_OT_stop(bpy.types.Operator):
    """End the running bake now, and keep the light as it is shown"""

    bl_idname = "radiosity.stop"
    bl_label = "Stop Here and Keep It"
    bl_options: ClassVar = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not Running.can_stop():
            cls.poll_message_set("There is no light to keep yet, or nothing more to wait for")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        Running.view.satisfied = True
        return {"FINISHED"}


class RADIOSITY_OT_cancel(bpy.types.Operator):
    """End the running bake, and leave everything as it was before"""

    bl_idname = "radiosity.cancel"
    bl_label = "Cancel"
    bl_options: ClassVar = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return Running.progress is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        Running.cancelled = True
        return {"FINISHED"}


def bake_in_place(scene: bpy.types.Scene, seat: Seat | None = None) -> Generator[Progress, None, Report]:
    """Bake a scene of the open file with its own settings; pages lie beside the file, or in it while it is unsaved.

    Args:
        seat: as of bake_scene, for whoever looks on
    """
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
        report = yield from bake_scene(scene, job, files, seat)
        files.commit()
    if not report.ended_in:
        learn(report)
    return report


def _textures(chosen: str, opened: Path | None) -> Path | None:
    if opened is None:
        return None
    if not chosen:
        return opened.with_name(f"{opened.stem}_textures")
    return Path(bpy.path.abspath(chosen)).resolve()


CLASSES = (RADIOSITY_OT_bake, RADIOSITY_OT_stop, RADIOSITY_OT_cancel)


def register() -> None:
    """Add the operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Take the operators away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
