# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a user finds the bake: Render properties, and in short the 3D view's sidebar. Drawing evaluates nothing."""

from __future__ import annotations

import textwrap
from collections import defaultdict
from typing import ClassVar

import bpy

from ...checks import Finding
from ...estimate import about, about_seconds
from ...reports.report import count_of
from ..data.names import REPORT_KEY, is_baked
from ..last_bake import summary, warnings
from ..reading.inspection import subject_of
from ..writing.originals import shows_originals
from .display_table import SHOW_MATERIALS, prepare_soon
from .presets import RADIOSITY_PT_presets
from .running import Running
from .scene_check import Checked, expected

ICONS = {"error": "CANCEL", "warning": "ERROR", "info": "INFO"}
"""Blender's icon named ERROR is the yellow triangle of warnings."""
MOST_FINDINGS = 12
"""Findings in the panel; the command line's `info` lists them all."""
LETTER = 0.56
"""Mean width of a letter, as a share of the font's size."""
WIDER = 0.58
"""Share of a row for the longer one of two words."""
LATER = 1
"""Place of panels below those of the bake that is there."""
BESIDE_TEXT, BUTTON = 64, 24
"""Pixels, at scale 1, beside the lines of a text: margins, tabs, an icon; and for each button."""


def draw_bake(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """Bake, toggle and revert, or the progress of a running bake."""
    if Running.progress is not None:
        layout.progress(factor=Running.progress.fraction, text=Running.text(brief=True))
        layout.operator("radiosity.stop", icon="CHECKMARK")
        layout.operator("radiosity.cancel", text="Cancel (Esc)", icon="X")
        return
    baked = is_baked(scene)
    button = layout.row()
    button.scale_y = 1.6
    button.operator("radiosity.bake", text="Bake Again" if baked else "Bake Radiosity", icon="RENDER_STILL")
    if not baked:
        return
    row = layout.split(factor=WIDER, align=True)
    hidden = shows_originals(scene)
    row.operator(
        "radiosity.toggle", text="Show Baked" if hidden else "Show Original", icon="LIGHT" if hidden else "LOOP_BACK"
    )
    row.operator("radiosity.revert", icon="TRASH")


def draw_summary(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The last bake in a few words, and its report."""
    if Running.progress is not None or REPORT_KEY not in context.scene:
        return
    row = layout.row()
    draw_text(row, summary(context.scene), "CHECKMARK", context, 1)
    row.operator("radiosity.show_report", text="", icon="FILE_TEXT")


def draw_essentials(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """What decides how good and how large a bake is."""
    settings = scene.radiosity
    row = layout.row(align=True)
    row.use_property_split = False
    row.prop(settings, "quality", expand=True)
    column = layout.column()
    column.prop(settings, "page_size")
    row = column.row(align=True, heading="Density")
    row.prop(settings, "density_enabled", text="")
    value = row.row()
    value.active = settings.density_enabled
    value.prop(settings, "density", text="")


def draw_estimate(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """What the next bake will take: a guess, until this scene was baked once."""
    found = expected(scene)
    lines = layout.box().column(align=True)
    lines.scale_y = 0.8
    sure = "About" if REPORT_KEY in scene else "Roughly"
    lines.label(text=f"{sure} {about_seconds(found.seconds)}, up to {found.bytes / 1e9:.1f} GB", icon="TIME")
    if scene.radiosity.density_enabled and Checked.of(scene) is None:
        lines.label(text="Check the scene to know its pages", icon="TEXTURE")
        return
    lines.label(text=f"{count_of(found.pages, 'page')}, {about(found.texels)} texels", icon="TEXTURE")
    if found.density:
        lines.label(text=f"{found.density:.3g} texels per metre", icon="DRIVER_DISTANCE")


def draw_finding(layout: bpy.types.UILayout, finding: Finding, context: bpy.types.Context) -> None:
    """What was found, and buttons for it."""
    row = layout.row()
    draw_text(row, finding.text, ICONS[finding.severity], context, bool(finding.subject) + finding.inside_out)
    buttons = row.row(align=True)
    if finding.inside_out:
        buttons.operator("radiosity.flip", text="", icon="NORMALS_FACE").name = finding.subject
    if finding.subject:
        buttons.operator("radiosity.select", text="", icon="RESTRICT_SELECT_OFF").name = finding.subject


def draw_text(layout: bpy.types.UILayout, text: str, icon: str, context: bpy.types.Context, buttons: int) -> None:
    """A text in lines that fit into the region beside some buttons: Blender's labels are cut where they don't."""
    scale = context.preferences.system.ui_scale
    letter = LETTER * context.preferences.ui_styles[0].widget.points * scale
    room = context.region.width - (BESIDE_TEXT + buttons * BUTTON) * scale
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(textwrap.wrap(text, max(12, int(room / letter)))):
        column.label(text=line, icon="BLANK1" if number else icon)


class RenderPanel:
    """What the panels in Render properties share."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"


class SidebarPanel:
    """What the panels in the 3D view's sidebar share."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Radiosity"


class SplitPanel:
    """Names to the left, values to the right."""

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        self.draw_in(self.layout, context)


class MainPanel(SplitPanel):
    """Bake, after choosing how well."""

    bl_label = "Radiosity"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        RADIOSITY_PT_presets.draw_panel_header(self.layout)

    def draw_in(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        scene = context.scene
        prepare_soon(scene)
        draw_bake(layout, scene)
        draw_summary(layout, context)
        draw_essentials(layout, scene)
        if context.view_layer.lightgroups:
            row = layout.row(heading="Light Groups")
            row.prop(scene.radiosity, "light_groups", text="Keep Apart")
        draw_estimate(layout, scene)


class RADIOSITY_PT_render(MainPanel, RenderPanel, bpy.types.Panel):
    """Bake, whatever the render engine."""

    bl_options: ClassVar = {"DEFAULT_CLOSED"}


class RADIOSITY_PT_sidebar(MainPanel, SidebarPanel, bpy.types.Panel):
    """Bake from the 3D view."""

    def draw_in(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        super().draw_in(layout, context)
        shading = context.space_data.shading
        if is_baked(context.scene) and Running.progress is None and shading.type not in SHOW_MATERIALS:
            layout.operator("radiosity.see", icon="SHADING_TEXTURE")


class CheckPanel:
    """What will be skipped, and what looks wrong."""

    bl_label = "Check"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        known = Checked.of(context.scene)
        for severity in ("error", "warning"):
            count = sum(finding.severity == severity for finding in known.findings) if known else 0
            if count:
                self.layout.label(text=str(count), icon=ICONS[severity])

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        known = Checked.of(context.scene)
        layout.operator("radiosity.check", text="Check Again" if known else "Check Scene", icon="VIEWZOOM")
        if known is None:
            return
        column = layout.column()
        if Checked.is_stale(context.scene):
            column.label(text="The scene has changed since", icon="FILE_REFRESH")
        if known.area is not None:
            lit = f"{count_of(known.objects, 'surface')} of {known.area:,.4g} m² to light"
            column.label(text=lit, icon="CHECKMARK")
        if not known.findings:
            column.label(text="Nothing looks wrong", icon="BLANK1")
        for finding in known.findings[:MOST_FINDINGS]:
            draw_finding(column, finding, context)
        if len(known.findings) > MOST_FINDINGS:
            column.label(text=f"And {len(known.findings) - MOST_FINDINGS} more", icon="BLANK1")


class RADIOSITY_PT_check(CheckPanel, RenderPanel, bpy.types.Panel):
    """The check in Render properties."""

    bl_parent_id = "RADIOSITY_PT_render"


class RADIOSITY_PT_sidebar_check(CheckPanel, SidebarPanel, bpy.types.Panel):
    """The check in the 3D view."""

    bl_parent_id = "RADIOSITY_PT_sidebar"


class RADIOSITY_PT_output(SplitPanel, RenderPanel, bpy.types.Panel):
    """What a bake changes in the scene, and its files."""

    bl_label = "Output"
    bl_parent_id = "RADIOSITY_PT_render"
    bl_order = LATER
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    def draw_in(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        settings = context.scene.radiosity
        layout.prop(settings, "write_back")
        layout.prop(settings, "textures")
        if not bpy.data.is_saved:
            layout.label(text="Packed into the file until it is saved", icon="INFO")
        settings.files.draw(layout)


class RADIOSITY_PT_solver(SplitPanel, RenderPanel, bpy.types.Panel):
    """How far light is followed."""

    bl_label = "Solver"
    bl_parent_id = "RADIOSITY_PT_render"
    bl_order = LATER
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    def draw_in(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        settings = context.scene.radiosity
        layout.prop(settings, "bounces")
        if settings.bounces == "number":
            layout.prop(settings, "most_bounces")
        layout.prop(settings, "tolerance")


class RADIOSITY_PT_light_groups(RenderPanel, bpy.types.Panel):
    """Blender's own light groups: which lights are in which, and whether each gets files of its own."""

    bl_label = "Light Groups"
    bl_parent_id = "RADIOSITY_PT_render"
    bl_order = LATER
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        groups = [group.name for group in context.view_layer.lightgroups]
        if groups:
            layout.prop(context.scene.radiosity, "light_groups")
        else:
            text = "Add light groups to the view layer and assign lamps to them, to get files for each"
            draw_text(layout, text, "INFO", context, 0)
        members = defaultdict(list)
        for thing in context.scene.objects:
            if thing.lightgroup in groups or thing.type == "LIGHT":
                members[thing.lightgroup if thing.lightgroup in groups else ""].append(thing)
        world = context.scene.world
        for name in (*groups, ""):
            things = members[name]
            box = layout.box().column(align=True)
            box.label(text=name or "No Group")
            if world is not None and (world.lightgroup if world.lightgroup in groups else "") == name:
                box.label(text=world.name, icon="WORLD")
            for thing in things[:MOST_FINDINGS]:
                row = box.row()
                row.label(text=thing.name, icon="LIGHT" if thing.type == "LIGHT" else "MESH_DATA")
                row.operator("radiosity.select", text="", icon="RESTRICT_SELECT_OFF").name = thing.name
            if len(things) > MOST_FINDINGS:
                box.label(text=f"And {len(things) - MOST_FINDINGS} more", icon="BLANK1")


class RADIOSITY_PT_advanced(SplitPanel, RenderPanel, bpy.types.Panel):
    """What the method is made of; the defaults are the fastest."""

    bl_label = "Advanced"
    bl_parent_id = "RADIOSITY_PT_render"
    bl_order = LATER
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    def draw_in(self, layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
        settings = context.scene.radiosity
        for name in ("solver", "form_factors", "subdivisions", "fine_folds", "threads"):
            layout.prop(settings, name)


class RADIOSITY_PT_last_bake(RenderPanel, bpy.types.Panel):
    """What the last bake had to say."""

    bl_label = "Last Bake"
    bl_parent_id = "RADIOSITY_PT_render"
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return REPORT_KEY in context.scene

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator("radiosity.show_report", icon="FILE_TEXT")
        said = warnings(context.scene)
        names = {thing.name for thing in context.scene.objects} if said else set()
        column = layout.column()
        for text in said[:MOST_FINDINGS]:
            draw_finding(column, Finding("warning", text, subject_of(text, names)), context)
        if len(said) > MOST_FINDINGS:
            column.label(text=f"And {len(said) - MOST_FINDINGS} more in the report", icon="BLANK1")
        if not said:
            column.label(text="No warnings", icon="CHECKMARK")


CLASSES = (
    RADIOSITY_PT_render,
    RADIOSITY_PT_check,
    RADIOSITY_PT_last_bake,
    RADIOSITY_PT_output,
    RADIOSITY_PT_light_groups,
    RADIOSITY_PT_solver,
    RADIOSITY_PT_advanced,
    RADIOSITY_PT_sidebar,
    RADIOSITY_PT_sidebar_check,
)


def register() -> None:
    """Add the panels."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Take the panels away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
