# SPDX-License-Identifier: GPL-3.0-or-later
"""How one object takes part in a bake: `object.radiosity`, its panel, and its settings on many objects at once."""

from __future__ import annotations

from typing import ClassVar

import bpy
from bpy.props import BoolProperty, FloatProperty, PointerProperty, StringProperty

from ..reading.extract import SURFACES
from .scene_check import settings_changed


class RadiosityObjectSettings(bpy.types.PropertyGroup):
    """How one object takes part in a bake."""

    exclude: BoolProperty(
        name="Exclude",
        description="Leave the object out of the bake: no lightmap, no shadow, no bounced light",
        default=False,
        update=settings_changed,
    )
    only_casts: BoolProperty(
        name="No Lightmap",
        description="Let the object shadow and bounce light onto others, but take none itself",
        default=False,
        update=settings_changed,
    )
    density: FloatProperty(
        name="Density",
        description="Multiplier of the texel density on this object: 2 for twice as fine, 0.5 for half",
        default=1.0,
        min=0.001,
        soft_max=8.0,
        max=1000.0,
        update=settings_changed,
    )
    two_sided: BoolProperty(
        name="Two-Sided",
        description="Give the backs of the faces places of their own on the lightmaps, as leaves and sheets need them",
        default=False,
        update=settings_changed,
    )
    uv_map: StringProperty(
        name="UV Map",
        description="Keep this uv map for the lightmap instead of unwrapping. Empty: unwrap",
        default="",
        update=settings_changed,
    )
    page_group: StringProperty(
        name="Page Group",
        description="Objects with the same word here share lightmaps that no others are on. Empty: with all the rest",
        default="",
        update=settings_changed,
    )
    tube_radius: FloatProperty(
        name="Tube Radius",
        description="Make a curve without bevel and extrusion a tube of this radius: what it emits lights the scene",
        default=0.0,
        min=0.0,
        soft_max=1.0,
        subtype="DISTANCE",
        unit="LENGTH",
    )


SETTINGS = tuple(RadiosityObjectSettings.__annotations__)
"""Names of the settings, as they stand in the panel."""


def differing(context: bpy.types.Context) -> dict[str, list[bpy.types.Object]]:
    """Of each setting the selected objects whose value is not the active object's; under "" those of any setting."""
    active = context.object
    wanted = [(name, getattr(active.radiosity, name)) for name in SETTINGS]
    found: dict[str, list[bpy.types.Object]] = {name: [] for name in ("", *SETTINGS)}
    for thing in context.selected_objects:
        if thing == active or thing.type not in SURFACES:
            continue
        settings = thing.radiosity
        differs = [name for name, value in wanted if getattr(settings, name) != value]
        for name in (*differs, *([""] if differs else [])):
            found[name].append(thing)
    return found


class RADIOSITY_OT_copy_settings(bpy.types.Operator):
    """Give all selected objects this setting of the active object; without a name, all its Radiosity settings"""

    bl_idname = "radiosity.copy_settings"
    bl_label = "Copy to Selected"
    bl_options: ClassVar = {"REGISTER", "UNDO"}

    name: StringProperty(
        name="Setting", description="Name of the setting that is copied. Empty: all of them", options={"SKIP_SAVE"}
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.object is None or context.object.type not in SURFACES:
            cls.poll_message_set("The active object has no surface")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        if self.name and self.name not in SETTINGS:
            self.report({"ERROR"}, f"There is no setting named {self.name!r}; there are {', '.join(SETTINGS)}")
            return {"CANCELLED"}
        changed = [thing for thing in differing(context)[self.name] if thing.is_editable]
        for thing in changed:
            for name in (self.name,) if self.name else SETTINGS:
                setattr(thing.radiosity, name, getattr(context.object.radiosity, name))
        self.report({"INFO"}, f"{len(changed)} object{'s' * (len(changed) != 1)} changed")
        return {"FINISHED"}


class RADIOSITY_PT_object(bpy.types.Panel):
    """How one object takes part."""

    bl_label = "Radiosity"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "object"
    bl_options: ClassVar = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.object is not None and context.object.type in SURFACES

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        thing = context.object
        settings = thing.radiosity
        several = len(context.selected_objects) > 1
        others = differing(context) if several else {}

        def line(part: bpy.types.UILayout, name: str) -> None:
            row = part.row(align=True)
            if name == "uv_map" and thing.type == "MESH":
                row.prop_search(settings, name, thing.data, "uv_layers")
            else:
                row.prop(settings, name)
            if others.get(name):
                row.operator("radiosity.copy_settings", text="", icon="DUPLICATE").name = name

        line(layout, "exclude")
        taking_part = layout.column()
        taking_part.active = not settings.exclude
        line(taking_part, "only_casts")
        lit = taking_part.column()
        lit.active = not settings.only_casts
        for name in ("density", "two_sided", "uv_map", "page_group"):
            line(lit, name)
        if thing.type == "CURVE":
            line(taking_part, "tube_radius")
        if several:
            draw_selection(layout, len(others[""]))


def draw_selection(layout: bpy.types.UILayout, count: int) -> None:
    """How many of the selected objects have other settings, and a button that makes them alike."""
    what = "1 other selected object differs" if count == 1 else f"{count} other selected objects differ"
    layout.label(text=what if count else "All selected objects agree", icon="OBJECT_DATA")
    button = layout.row()
    button.enabled = count > 0
    button.operator("radiosity.copy_settings", text="Copy All to Selected", icon="DUPLICATE").name = ""


CLASSES = (RadiosityObjectSettings, RADIOSITY_OT_copy_settings, RADIOSITY_PT_object)


def register() -> None:
    """Give objects their settings."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Object.radiosity = PointerProperty(type=RadiosityObjectSettings)


def unregister() -> None:
    """Take the settings away; what a file holds of them stays in it."""
    del bpy.types.Object.radiosity
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
