# SPDX-License-Identifier: GPL-3.0-or-later
"""The bake that is going on in a window: what is known of it, where it is shown, and what is watched meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import bpy
import numpy as np

from ...geometry.sides import backs_of
from ...progress import describe
from ...reports.report import Report, Stalls
from ...stages import AFTER_THE_LIGHT, Progress
from ..reading.extraction import Extraction
from .display_table import display_table, unprepared
from .live_view import LiveView

REDRAW_SECONDS = 0.3
"""Drawing takes time from the bake."""

TELLING_SHARE = 0.3
"""From this share of a bake on its own pace alone tells what is left; before that, what was expected counts too."""

NO_SHARE = 1e-3
"""Least share of a bake that is divided by."""

WATCHED = (bpy.types.Object, bpy.types.Mesh, bpy.types.Curve, bpy.types.Light, bpy.types.Material, bpy.types.World)
"""What decides how light falls. Whatever else is edited changes nothing."""

MOST_NAMED = 3
"""Of what was edited during a bake, so much is named."""

UNSEEN = ("CAMERA", "SPEAKER", "ARMATURE", "LATTICE")
"""Types of objects that neither light nor shadow; what they deform is edited too."""


class Running:
    """The bake that is going on in a window, of which there is one at most.

    Attributes:
        progress: how far it is, None where no bake is running
        view: draws its light, once the scene was read
        cancelled: it is to end and leave no trace
    """

    progress: Progress | None = None
    view: LiveView | None = None
    cancelled = False
    _start = _drawn = _returned = _gap = _expected = 0.0
    _stalls: ClassVar[dict[str, float]] = {}
    _scene = ""
    _unsettled: ClassVar[list[Callable[[bpy.types.Scene], None]]] = []
    _edited: ClassVar[dict[str, None]] = {}

    @classmethod
    def begin(cls, expected: float) -> None:
        """A bake was asked for, which is expected to take so many seconds."""
        cls.progress, cls.view, cls.cancelled = Progress("Read scene", 0.0), None, False
        cls._start = cls._returned = time.perf_counter()
        cls._drawn = cls._gap = 0.0
        cls._expected = expected
        cls._stalls, cls._unsettled = {}, []
        cls._edited = {}
        bpy.types.STATUSBAR_HT_header.append(draw_progress)

    @classmethod
    def seat(cls, scene: bpy.types.Scene) -> Callable[[Extraction], LiveView]:
        """Look on at the bake of a scene that was read."""
        things = {
            (thing.name, thing.library and thing.library.filepath) for thing in scene.objects if thing.visible_get()
        }
        names = {name for name, _ in things}
        view = cls.view = LiveView()
        cls._scene = scene.name
        cls._unsettled = [*unprepared(scene), cls._show_as_in, cls.watch]

        def looking(extraction: Extraction) -> LiveView:
            meshes = extraction.scene.meshes
            view.visible = np.zeros(len(meshes) + len(backs_of(meshes)), bool)
            for index, source in enumerate(extraction.sources):
                own = (source.object_name, source.library) in things
                view.visible[index] = source.instancer in names if source.instancer else own
            for front, back in backs_of(meshes).items():
                view.visible[back] = view.visible[front]
            return view

        return looking

    @classmethod
    def settle(cls) -> None:
        """What can wait until the bake's thread is under way, a thing a turn: how light is shown, then to notice edits.

        By then Blender has evaluated what reading the scene has touched, which is no edit.
        """
        scene = bpy.data.scenes.get(cls._scene)
        if cls.view is None or scene is None:
            return
        if cls.progress is not None and cls.progress.stage == "Write back":
            cls.unwatch()  # from here on the bake itself edits
        elif cls._unsettled:
            began = time.perf_counter()
            cls._unsettled.pop(0)(scene)
            cls.turned("Drawing", began)

    @classmethod
    def _show_as_in(cls, scene: bpy.types.Scene) -> None:
        if cls.view is not None:
            cls.view.table = display_table(scene)

    @classmethod
    def watch(cls, scene: bpy.types.Scene) -> None:
        """From now on, notice what is edited of a scene."""
        cls._scene, cls._edited = scene.name, {}
        bpy.app.handlers.depsgraph_update_post.append(_notice_edits)

    @classmethod
    def unwatch(cls) -> None:
        """Notice no more."""
        if _notice_edits in bpy.app.handlers.depsgraph_update_post:  # opening a file clears them
            bpy.app.handlers.depsgraph_update_post.remove(_notice_edits)

    @classmethod
    def edits(cls) -> list[str]:
        """A warning about what was edited, if anything was."""
        if not cls._edited:
            return []
        names, more = list(cls._edited)[:MOST_NAMED], len(cls._edited) - MOST_NAMED
        named = ", ".join(names) + (f" and {more} more" if more > 0 else "")
        return [f"Edited during the bake, which shows the light from before: {named}; bake again"]

    @classmethod
    def text(cls, brief: bool = False) -> str:
        """How far it is, in words."""
        if cls.progress is None:
            return ""
        seconds = time.perf_counter() - cls._start
        told = describe(replace(cls.progress, left=cls.left(cls.progress, seconds)), seconds, brief)
        return f"Stopping: {told}" if cls.view is not None and cls.view.satisfied else told

    @classmethod
    def left(cls, progress: Progress, seconds: float) -> float:
        """Seconds until the end: first stages, which differ from scene to scene, tell little of those that follow."""
        own = seconds * (1 / max(progress.fraction, NO_SHARE) - 1) if progress.left is None else progress.left
        trust = min(progress.fraction / TELLING_SHARE, 1.0)
        return trust * own + (1 - trust) * max(cls._expected - seconds, 0.0)

    @classmethod
    def in_file(cls) -> bool:
        """The bake holds parts of the file, which nobody may undo or edit away meanwhile."""
        return cls.progress is not None and (cls.view is None or cls.progress.stage == "Write back")

    @classmethod
    def can_stop(cls) -> bool:
        """There is light to be kept, and still some to be waited for."""
        return (
            cls.progress is not None
            and cls.view is not None
            and cls.view.lit
            and not cls.view.satisfied
            and cls.progress.stage not in AFTER_THE_LIGHT
        )

    @classmethod
    def turned(cls, stage: str, began: float) -> None:
        """The window got its turn back, which the bake had since `began` for a stage."""
        cls._gap = max(cls._gap, began - cls._returned)
        cls._returned = time.perf_counter()
        cls._stalls[stage] = max(cls._stalls.get(stage, 0.0), cls._returned - began)

    @classmethod
    def redraw(cls, context: bpy.types.Context) -> None:
        """Draw what shows the bake anew, where it has changed and not too often."""
        now = time.perf_counter()
        fresh = cls.view is not None and cls.view.fresh
        if fresh or now - cls._drawn > REDRAW_SECONDS:
            cls._drawn = now
            tag(context, fresh)
        if cls.view is not None:
            cls.view.fresh = False

    @classmethod
    def told(cls, report: Report) -> Report:
        """A report, with what there is to say of the window."""
        if cls.view is not None:
            cls._stalls["Drawing"] = max(cls._stalls.get("Drawing", 0.0), cls.view.drawing)
        first = None if cls.view is None or cls.view.first_at is None else cls.view.first_at - cls._start
        return replace(report, warnings=[*report.warnings, *cls.edits()], stalls=Stalls(cls._stalls, cls._gap, first))

    @classmethod
    def end(cls, context: bpy.types.Context) -> None:
        """No bake is running any more."""
        cls.progress = None
        cls.unwatch()
        bpy.types.STATUSBAR_HT_header.remove(draw_progress)
        if cls.view is not None:
            cls.view.remove()
        tag(context, cls.view is not None)

    @classmethod
    def notice(cls, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        """Keep what was edited of a scene, if it is the one that is baked."""
        if scene.name != cls._scene:
            return
        for update in depsgraph.updates:
            changed = update.is_updated_geometry or update.is_updated_transform or update.is_updated_shading
            if changed and isinstance(update.id, WATCHED) and getattr(update.id, "type", "") not in UNSEEN:
                cls._edited[update.id.name] = None


def _notice_edits(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    Running.notice(scene, depsgraph)


def draw_progress(self: bpy.types.Header, context: bpy.types.Context) -> None:
    """The bake's progress in the status bar, and how to end it."""
    if Running.progress is not None:
        row = self.layout.row(align=True)
        bar = row.row()
        bar.ui_units_x = 22
        bar.progress(factor=Running.progress.fraction, text=Running.text())
        row.operator("radiosity.stop", icon="CHECKMARK")
        row.operator("radiosity.cancel", icon="X")


def tag(context: bpy.types.Context, views: bool) -> None:
    """Have the status bar and the places of our panels drawn anew, and the 3D views if that is worth it."""
    if context.workspace is not None:
        context.workspace.status_text_set(None)
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            places = {"PROPERTIES": ("WINDOW",), "VIEW_3D": ("UI", "WINDOW") if views else ("UI",)}.get(area.type, ())
            for region in area.regions:
                if region.type in places:
                    region.tag_redraw()
