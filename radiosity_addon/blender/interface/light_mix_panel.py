# SPDX-License-Identifier: GPL-3.0-or-later
"""Sliders that mix the light groups of a bake anew: `scene.radiosity_mix`, and the panels that show them."""

from __future__ import annotations

from typing import ClassVar

import bpy
from bpy.props import CollectionProperty, FloatProperty, FloatVectorProperty

from ..looks.node_arithmetic import WHITE
from ..writing.light_mix import mixed_colors
from .panels import RenderPanel, SidebarPanel
from .running import Running


def _tell_drivers(self: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Drivers hear of what is set by hand, but not of what scripts set."""
    self.id_data.update_tag()


class RadiosityLightGroup(bpy.types.PropertyGroup):
    """How the baked light of a light group is shown; `name` is the group's, "" for lights in none."""

    strength: FloatProperty(
        name="Strength",
        description="How bright the light of this group is shown; 1 as it was baked, 0 switches it off",
        default=1.0,
        min=0.0,
        soft_max=2.0,
        step=5,
        precision=2,
        update=_tell_drivers,
    )
    color: FloatVectorProperty(
        name="Tint",
        description="What the light of this group is coloured with; white as it was baked",
        default=(1.0, 1.0, 1.0),
        min=0.0,
        soft_max=1.0,
        size=3,
        subtype="COLOR",
        update=_tell_drivers,
    )


class RADIOSITY_OT_reset_mix(bpy.types.Operator):
    """Show the light of all groups as it was baked"""

    bl_idname = "radiosity.reset_mix"
    bl_label = "Reset Mix"
    bl_options: ClassVar = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.scene is None or not mixed_colors(context.scene):
            cls.poll_message_set("All groups are shown as they were baked")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        for group in context.scene.radiosity_mix:
            group.strength, group.color = 1.0, WHITE
        return {"FINISHED"}


class MixPanel:
    """Dims and tints light groups without baking again."""

    bl_label = "Light Mix"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return Running.progress is None and len(context.scene.radiosity_mix) > 0

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        column = layout.column(align=True)
        for group in context.scene.radiosity_mix:
            parts = column.split(factor=0.4)
            parts.label(text=group.name or "No Group")
            row = parts.row(align=True)
            tint = row.row(align=True)
            tint.ui_units_x = 1.5
            tint.prop(group, "color", text="")
            row.prop(group, "strength", text="", slider=True)
        layout.operator("radiosity.reset_mix", icon="LOOP_BACK")


class RADIOSITY_PT_mix(MixPanel, RenderPanel, bpy.types.Panel):
    """The mix in Render properties."""

    bl_parent_id = "RADIOSITY_PT_render"


class RADIOSITY_PT_sidebar_mix(MixPanel, SidebarPanel, bpy.types.Panel):
    """The mix in the 3D view, where its light is seen."""

    bl_parent_id = "RADIOSITY_PT_sidebar"


CLASSES = (RadiosityLightGroup, RADIOSITY_OT_reset_mix, RADIOSITY_PT_mix, RADIOSITY_PT_sidebar_mix)


def register() -> None:
    """Add sliders, operator and panels."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.radiosity_mix = CollectionProperty(type=RadiosityLightGroup)


def unregister() -> None:
    """Take them away; what a file holds of the sliders stays in it."""
    del bpy.types.Scene.radiosity_mix
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
