# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a user finds the bake: Render properties, the 3D view's sidebar, Object properties."""

from __future__ import annotations

from typing import ClassVar

import bpy

from .names import is_baked
from .operators import Running

TYPES_WITH_SURFACE = {"MESH", "CURVE", "SURFACE", "META", "FONT"}


def draw_buttons(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """Bake and revert, or the progress of a running bake."""
    if Running.progress is not None:
        layout.progress(factor=Running.progress.fraction, text=Running.text())
        layout.label(text="Esc cancels", icon="CANCEL")
        return
    column = layout.column(align=True)
    column.scale_y = 1.4
    column.operator("radiosity.bake", icon="RENDER_STILL")
    if is_baked(scene):
        layout.operator("radiosity.revert", icon="LOOP_BACK")


class RenderPanel:
    """What the panels in Render properties share."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"


class RADIOSITY_PT_render(RenderPanel, bpy.types.Panel):
    """Bake, whatever the render engine."""

    bl_label = "Radiosity"
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.radiosity
        draw_buttons(layout, context.scene)
        column = layout.column()
        column.prop(settings, "quality")
        column.prop(settings, "write_back")


class RADIOSITY_PT_pages(RenderPanel, bpy.types.Panel):
    """Size, density and place of the pages."""

    bl_label = "Lightmaps"
    bl_parent_id = "RADIOSITY_PT_render"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.radiosity
        layout.prop(settings, "page_size")
        row = layout.row(align=True, heading="Density")
        row.prop(settings, "density_enabled", text="")
        value = row.row()
        value.active = settings.density_enabled
        value.prop(settings, "density", text="")
        layout.prop(settings, "textures")


class RADIOSITY_PT_files(RenderPanel, bpy.types.Panel):
    """Format and colours of the page files."""

    bl_label = "Files"
    bl_parent_id = "RADIOSITY_PT_render"
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        context.scene.radiosity.files.draw(layout)


class RADIOSITY_PT_solver(RenderPanel, bpy.types.Panel):
    """When the solver stops, and how many processors it takes."""

    bl_label = "Solver"
    bl_parent_id = "RADIOSITY_PT_render"
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(context.scene.radiosity, "bounces")
        layout.prop(context.scene.radiosity, "tolerance")
        layout.prop(context.scene.radiosity, "threads")


class RADIOSITY_PT_sidebar(bpy.types.Panel):
    """Bake from the 3D view."""

    bl_label = "Radiosity"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Radiosity"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        draw_buttons(layout, context.scene)
        layout.prop(context.scene.radiosity, "quality")


class RADIOSITY_PT_object(bpy.types.Panel):
    """How one object takes part."""

    bl_label = "Radiosity"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "object"
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.object is not None and context.object.type in TYPES_WITH_SURFACE

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.object.radiosity
        layout.prop(settings, "exclude")
        taking_part = layout.column()
        taking_part.active = not settings.exclude
        if context.object.type == "CURVE":
            taking_part.prop(settings, "tube_radius")
        taking_part.prop(settings, "only_casts")
        lit = taking_part.column()
        lit.active = not settings.only_casts
        lit.prop(settings, "density")
        lit.prop(settings, "two_sided")
        if context.object.type == "MESH":
            lit.prop_search(settings, "uv_map", context.object.data, "uv_layers")
        else:
            lit.prop(settings, "uv_map")


CLASSES = (
    RADIOSITY_PT_render,
    RADIOSITY_PT_pages,
    RADIOSITY_PT_files,
    RADIOSITY_PT_solver,
    RADIOSITY_PT_sidebar,
    RADIOSITY_PT_object,
)


def register() -> None:
    """Add the panels."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Take the panels away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
