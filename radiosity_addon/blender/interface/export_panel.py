# SPDX-License-Identifier: GPL-3.0-or-later
"""Handing a bake over from Blender's window: `scene.radiosity_export`, the operator, the panel."""

from __future__ import annotations

import traceback
from pathlib import Path
from typing import ClassVar

import bpy
from bpy.props import BoolProperty, PointerProperty, StringProperty

from ...errors import BakeError, OutputError, explained
from ...files import Transaction
from ..handover.export import Exported, Handover, export_lightmaps
from .after_bake import OfBakedScene
from .format_properties import RadiosityFileSettings
from .panels import LATER, RenderPanel, SplitPanel
from .properties import RELATIVE_PATH


class RadiosityExportSettings(bpy.types.PropertyGroup):
    """What an export writes, and where to."""

    folder: StringProperty(
        name="Folder",
        description="Where the files go. Empty: a folder beside the .blend file, with its name and _export",
        default="",
        subtype="DIR_PATH",
        options=RELATIVE_PATH,
    )
    gltf: BoolProperty(
        name="glTF",
        description="Write a .glb file of the scene too, lightmaps inside, for three.js and other readers of glTF",
        default=True,
    )
    files: PointerProperty(
        type=RadiosityFileSettings,
        name="Files",
        description="How the exported lightmaps are written",
    )


class RADIOSITY_OT_export(OfBakedScene, bpy.types.Operator):
    """Write the lightmaps, how to read and place them, and a glTF file for game engines and the web"""

    bl_idname = "radiosity.export"
    bl_label = "Export Lightmaps"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not super().poll(context):
            return False
        if context.mode.startswith("EDIT"):
            cls.poll_message_set("Leave edit mode first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            exported = export_in_place(context.scene)
        except Exception as error:  # noqa: BLE001 whatever it is, the user gets one line
            if not isinstance(error, BakeError):
                traceback.print_exception(error)  # to the console, for the report of a defect
            self.report({"ERROR"}, explained(error))
            return {"CANCELLED"}
        for warning in exported.warnings:
            self.report({"WARNING"}, warning)
        self.report({"INFO"}, exported.summary())
        return {"FINISHED"}


def export_in_place(scene: bpy.types.Scene) -> Exported:
    """Export a scene of the open file with its own settings.

    Raises:
        BakeError: with the object or file, the cause and the remedy
    """
    settings = scene.radiosity_export
    opened = Path(bpy.data.filepath) if bpy.data.is_saved else None
    wanted = Handover(
        folder=_folder(settings.folder, opened),
        stem=opened.stem if opened else scene.name,
        page_format=settings.files.page_format(),
        gltf=settings.gltf,
        workers=scene.radiosity.bake_settings().workers,
    )
    with Transaction() as files:
        exported = export_lightmaps(scene, wanted, files)
        files.commit()
    return exported


def _folder(chosen: str, opened: Path | None) -> Path:
    if opened is None and (not chosen or chosen.startswith("//")):
        raise OutputError(
            "Folder", "the file is not saved, so there is no place beside it", "Save it, or choose a folder"
        )
    if not chosen:
        return opened.with_name(f"{opened.stem}_export")
    return Path(bpy.path.abspath(chosen)).resolve()


class RADIOSITY_PT_export(SplitPanel, RenderPanel, bpy.types.Panel):
    """Hand the bake over to game engines and the web."""

    bl_label = "Export"
    bl_parent_id = "RADIOSITY_PT_render"
    bl_order = LATER
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    def draw_in(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        settings = context.scene.radiosity_export
        layout.prop(settings, "folder")
        layout.prop(settings, "gltf")
        settings.files.draw(layout)
        layout.operator("radiosity.export", icon="EXPORT")


CLASSES = (RadiosityExportSettings, RADIOSITY_OT_export, RADIOSITY_PT_export)


def register() -> None:
    """Add settings, operator and panel."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.radiosity_export = PointerProperty(type=RadiosityExportSettings)


def unregister() -> None:
    """Take them away; what a file holds of the settings stays in it."""
    del bpy.types.Scene.radiosity_export
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
