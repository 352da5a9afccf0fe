# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets of bake settings by Blender's own means: ours lie beside the code, a user's where all of theirs do."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from .format_properties import RadiosityFileSettings
from .properties import RadiositySceneSettings

ROOT = Path(__file__).resolve().parents[3]
"""The folder of the extension; `presets/radiosity` in it holds the presets that come with it."""

NOT_PRESET = {"textures", "files", "threads"}
"""What belongs to one file or machine alone, and `files`, whose parts are listed one by one."""

VALUES = (
    *(f"settings.{name}" for name in RadiositySceneSettings.__annotations__ if name not in NOT_PRESET),
    *(f"settings.files.{name}" for name in RadiosityFileSettings.__annotations__),
)
"""What a preset sets."""


class RADIOSITY_PT_presets(PresetPanel, bpy.types.Panel):
    """The list of presets."""

    bl_label = "Radiosity Presets"
    preset_subdir = "radiosity"
    preset_operator = "script.execute_preset"
    preset_add_operator = "radiosity.preset_add"


class RADIOSITY_OT_preset_add(AddPresetBase, bpy.types.Operator):
    """Keep the present bake settings as a preset, or remove one that was kept"""

    bl_idname = "radiosity.preset_add"
    bl_label = "Add Radiosity Preset"
    preset_menu = "RADIOSITY_PT_presets"
    preset_subdir = "radiosity"
    preset_defines: ClassVar = ["settings = bpy.context.scene.radiosity"]
    preset_values: ClassVar = list(VALUES)

    def remove(self, context: bpy.types.Context, filepath: str) -> None:
        """Take a preset of the user's own away; Blender keeps only what may not be written."""
        path = Path(filepath).resolve()
        if path.is_relative_to(ROOT):
            self.report({"WARNING"}, f"{path.stem} comes with the extension and stays")
        else:
            path.unlink()


CLASSES = (RADIOSITY_PT_presets, RADIOSITY_OT_preset_add)


def register() -> None:
    """Add the presets."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.utils.register_preset_path(str(ROOT))


def unregister() -> None:
    """Take the presets away; a user's own stay on disk."""
    bpy.utils.unregister_preset_path(str(ROOT))
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
