# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a user turns overlays on and off: a panel in the 3D view's sidebar, and its settings of this session."""

from __future__ import annotations

from typing import ClassVar

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, PointerProperty

from ..interface.display_table import SHOW_MATERIALS, is_exposed
from ..interface.running import Running
from .overlay_data import Density, Pages, missing
from .overlay_drawing import Look
from .overlay_legend import UNITS
from .overlays import OFF, Shown, redraw_views, show, turn_off

OVERLAYS = (
    ("lighting", "Lighting", "The baked light alone, without the colours of the surfaces", "LIGHT_SUN"),
    ("illuminance", "Illuminance", "How much light arrives, in false colours with a scale in lux or W/m²", "COLOR"),
    (
        "density",
        "Density",
        "A checker of texels: red where they are too few, green as wanted, blue where more than wanted",
        "TEXTURE",
    ),
    ("charts", "Charts", "The pieces that surfaces were cut into, each in a colour of its own, and their seams", "UV"),
    ("patches", "Patches", "The pieces between which the solver exchanged light", "MESH_GRID"),
    ("invalid", "Invalid Texels", "Texels inside other geometry, which were filled from their neighbours", "ERROR"),
)


def _redraw(self: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    redraw_views()


class RadiosityOverlaySettings(bpy.types.PropertyGroup):
    """How overlays look, in this session."""

    unit: EnumProperty(
        name="Unit",
        description="What the scale counts",
        items=(
            ("lux", "Lux", "Illuminance as a light meter shows it, at 683 lumens a watt"),
            ("watts", "W/m²", "Irradiance, weighted as the eye weighs it"),
        ),
        update=_redraw,
    )
    range_auto: BoolProperty(
        name="Automatic Range",
        description="Let the scale span what the lightmaps hold",
        default=True,
        update=_redraw,
    )
    low: FloatProperty(
        name="From", description="Lower end of the scale", default=10.0, min=1e-6, soft_max=1e5, update=_redraw
    )
    high: FloatProperty(
        name="To", description="Upper end of the scale", default=1000.0, min=1e-6, soft_max=1e6, update=_redraw
    )
    exposure: FloatProperty(
        name="Exposure",
        description="Stops by which the light is shown brighter or darker than the automatic exposure",
        default=0.0,
        soft_min=-6.0,
        soft_max=6.0,
        min=-32.0,
        max=32.0,
        step=10,
        update=_redraw,
    )
    target_auto: BoolProperty(
        name="Automatic Target",
        description="Compare with the density of the bake's settings, or with the median where pages are filled",
        default=True,
        update=_redraw,
    )
    target: FloatProperty(
        name="Target",
        description="Texels per metre that are wanted: the green of the scale",
        default=64.0,
        min=0.001,
        soft_max=512.0,
        update=_redraw,
    )
    sharp: BoolProperty(
        name="Show Texels",
        description="Show every texel as a square, instead of what is seen between them",
        default=False,
        update=_redraw,
    )
    opacity: FloatProperty(
        name="Opacity",
        description="How much of the scene the overlay covers",
        default=1.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        update=_redraw,
    )
    legend: BoolProperty(
        name="Legend",
        description="Tell in a corner of the view what the colours mean",
        default=True,
        update=_redraw,
    )

    def look(self, overlay: str, pages: Pages, density: Density | None) -> Look:
        """How an overlay is to be drawn."""
        factor = UNITS[self.unit][0]
        ends = (self.low / factor, max(self.high, self.low * 1.01) / factor)
        if overlay == "illuminance" and self.range_auto:
            ends = pages.ends
        gain = pages.gain * 2.0**self.exposure if overlay == "lighting" else 1.0
        target = density.target if density else 1.0
        return Look(overlay, ends, gain, target, self.opacity, self.sharp)


class RADIOSITY_OT_overlay(bpy.types.Operator):
    """Show an overlay over the surfaces; nothing in the file is changed"""

    bl_idname = "radiosity.overlay"
    bl_label = "Overlay"
    bl_options: ClassVar = {"INTERNAL"}

    show: EnumProperty(
        name="Show",
        description="What is shown over the surfaces",
        items=[(OFF, "Off", "Show the scene as it is"), *(item[:3] for item in OVERLAYS)],
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        said = {OFF: "Show the scene as it is"} | {item[0]: item[2] for item in OVERLAYS}
        reason = "" if properties.show == OFF else missing(context.scene, properties.show)
        return said[properties.show] + (f".\n{reason}" if reason else "")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if bpy.app.background:
            cls.poll_message_set("There is no window to draw in")
            return False
        return context.scene is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        show(OFF if self.show == Shown.name() else self.show)
        return {"FINISHED"}


class RADIOSITY_PT_overlay(bpy.types.Panel):
    """Looks at a bake from all sides."""

    bl_label = "Judge"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Radiosity"
    bl_parent_id = "RADIOSITY_PT_sidebar"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        shown = Shown.name()
        grid = layout.grid_flow(columns=2, even_columns=True, row_major=True, align=True)
        for name, label, _, icon in OVERLAYS:
            cell = grid.row(align=True)
            cell.enabled = name == shown or not missing(context.scene, name)
            cell.operator("radiosity.overlay", text=label, icon=icon, depress=name == shown).show = name
        layout.operator("radiosity.light_meter", icon="EYEDROPPER")
        if shown == OFF:
            reason = missing(context.scene, "lighting")
            if not reason:
                layout.use_property_split = True
                layout.use_property_decorate = False
                shading = context.space_data.shading
                exposure = layout.column()
                exposure.active = is_exposed(shading)
                exposure.prop(context.scene.view_settings, "exposure", text="View Exposure")
                if not exposure.active and shading.type in SHOW_MATERIALS:
                    layout.operator("radiosity.see", text="Show World and Exposure", icon="WORLD")
            elif Running.progress is None:
                layout.label(text=reason, icon="INFO")
            return
        off = layout.row()
        off.scale_y = 1.4
        off.operator("radiosity.overlay", text="Off", icon="X").show = OFF
        layout.use_property_split = True
        layout.use_property_decorate = False
        self._draw_settings(layout.column(), context, shown)

    def _draw_settings(self, column: bpy.types.UILayout, context: bpy.types.Context, shown: str) -> None:
        settings = context.window_manager.radiosity_overlay
        if shown == "lighting":
            column.prop(settings, "exposure", slider=True)
        if shown == "illuminance":
            column.row().prop(settings, "unit", expand=True)
            column.prop(settings, "range_auto")
            if not settings.range_auto:
                ends = column.column(align=True)
                ends.prop(settings, "low")
                ends.prop(settings, "high")
        if shown == "density":
            column.prop(settings, "target_auto")
            if not settings.target_auto:
                column.prop(settings, "target")
        if shown in ("lighting", "illuminance"):
            column.prop(settings, "sharp")
        column.prop(settings, "opacity", slider=True)
        column.prop(settings, "legend")


CLASSES = (RadiosityOverlaySettings, RADIOSITY_OT_overlay, RADIOSITY_PT_overlay)


def register() -> None:
    """Add the panel and its settings."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.WindowManager.radiosity_overlay = PointerProperty(type=RadiosityOverlaySettings)


def unregister() -> None:
    """Turn overlays off and take the panel away."""
    turn_off()
    del bpy.types.WindowManager.radiosity_overlay
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
