# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user sets in Blender: `scene.radiosity` and `object.radiosity`, saved with the file."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..settings import MAX_PAGE_SIZE, BakeSettings
from .format_properties import RadiosityFileSettings

RELATIVE_PATH = {"ANIMATABLE", "PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5) else {"ANIMATABLE"}
"""Before 4.5 every path could be relative to the .blend."""


def cycles_limits(scene: bpy.types.Scene) -> dict[str, Any]:
    """Settings of a bake that make it as limited as the scene's renders; without Cycles there are no limits."""
    cycles = getattr(scene, "cycles", None)
    if cycles is None:
        return {}
    return {
        "bounces": min(cycles.diffuse_bounces, cycles.max_bounces),
        "clamp_direct": cycles.sample_clamp_direct,
        "clamp_indirect": cycles.sample_clamp_indirect,
    }


class RadiositySceneSettings(bpy.types.PropertyGroup):
    """Settings of a scene's bake."""

    density_enabled: BoolProperty(
        name="Fixed Density",
        description="Use as many pages as the density asks for, instead of filling one page",
        default=False,
    )
    density: FloatProperty(
        name="Density",
        description="Texels per metre of surface",
        default=64.0,
        min=0.001,
        soft_min=1.0,
        soft_max=512.0,
    )
    page_size: IntProperty(
        name="Page Size",
        description="Texels along an edge of a lightmap image",
        default=BakeSettings.page_size,
        min=16,
        max=MAX_PAGE_SIZE,
        subtype="PIXEL",
    )
    quality: EnumProperty(
        name="Quality",
        description="How many rays are spent",
        items=(
            ("draft", "Draft", "A quick look while placing lights"),
            ("medium", "Medium", "Good for most scenes"),
            ("high", "High", "For the last bake, a few times slower"),
        ),
        default=BakeSettings.quality,
    )
    tolerance: FloatProperty(
        name="Tolerance",
        description="Share of the emitted light that may be left to bounce when the solver stops",
        default=BakeSettings.tolerance,
        min=1e-8,
        max=0.5,
        precision=6,
        step=0.1,
    )
    bounces: EnumProperty(
        name="Bounces",
        description="How often light is reflected",
        items=(
            ("all", "All", "Until none is left to reflect"),
            ("scene", "As the Scene", "As often, and as bright, as the scene's Cycles settings allow"),
        ),
        default="all",
    )
    threads: IntProperty(
        name="Threads",
        description="Processors to use, 0 for all",
        default=BakeSettings.threads,
        min=0,
        max=1024,
    )
    write_back: EnumProperty(
        name="Result",
        description="What the bake changes in the scene",
        items=(
            (
                "preview",
                "Lit Materials",
                "Copies of the materials show the baked light; Revert brings the own ones back",
            ),
            ("uv", "UV Maps and Images", "Only uv maps and images are added, the materials stay"),
        ),
        default="preview",
    )
    textures: StringProperty(
        name="Textures",
        description="Folder of the lightmap images. Empty: beside the .blend file, or packed while it is unsaved",
        default="",
        subtype="DIR_PATH",
        options=RELATIVE_PATH,
    )

    files: PointerProperty(
        type=RadiosityFileSettings,
        name="Files",
        description="How the lightmap images are written",
    )

    def bake_settings(self) -> BakeSettings:
        """The core's settings."""
        return BakeSettings(
            density=self.density if self.density_enabled else None,
            page_size=self.page_size,
            quality=self.quality,
            tolerance=self.tolerance,
            threads=self.threads,
            **(cycles_limits(self.id_data) if self.bounces == "scene" else {}),
        )


class RadiosityObjectSettings(bpy.types.PropertyGroup):
    """How one object takes part in a bake."""

    exclude: BoolProperty(
        name="Exclude",
        description="Leave the object out of the bake: no lightmap, no shadow, no bounced light",
        default=False,
    )
    only_casts: BoolProperty(
        name="No Lightmap",
        description="Let the object shadow and bounce light onto others, but take none itself",
        default=False,
    )
    density: FloatProperty(
        name="Density",
        description="Multiplier of the texel density on this object",
        default=1.0,
        min=0.001,
        soft_max=8.0,
        max=1000.0,
    )
    two_sided: BoolProperty(
        name="Two-Sided",
        description="Give the backs of the faces places of their own on the lightmaps, as leaves and sheets need them",
        default=False,
    )
    uv_map: StringProperty(
        name="UV Map",
        description="Keep this uv map for the lightmap instead of unwrapping. Empty: unwrap",
        default="",
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


CLASSES = (RadiosityFileSettings, RadiositySceneSettings, RadiosityObjectSettings)


def register() -> None:
    """Give scenes and objects their settings."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.radiosity = PointerProperty(type=RadiositySceneSettings)
    bpy.types.Object.radiosity = PointerProperty(type=RadiosityObjectSettings)


def unregister() -> None:
    """Take the settings away; what a file holds of them stays in it."""
    del bpy.types.Object.radiosity
    del bpy.types.Scene.radiosity
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
