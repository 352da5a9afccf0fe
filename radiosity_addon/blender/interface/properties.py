# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user sets in Blender about a bake: `scene.radiosity`, saved with the file."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ...settings import MAX_PAGE_SIZE, MOST_SUBDIVISIONS, BakeSettings
from .format_properties import RadiosityFileSettings
from .scene_check import settings_changed

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
        update=settings_changed,
    )
    density: FloatProperty(
        name="Density",
        description="Texels per metre of surface: 16 for large levels, 64 for rooms, 256 for close-ups",
        default=64.0,
        min=0.001,
        soft_min=1.0,
        soft_max=512.0,
        update=settings_changed,
    )
    fine_folds: BoolProperty(
        name="Finer Folds",
        description="Give smooth surfaces that fold within few texels, such as curtains, up to twice as fine ones",
        default=BakeSettings.fine_folds,
        update=settings_changed,
    )
    page_size: IntProperty(
        name="Page Size",
        description="Texels along an edge of a lightmap image; twice as many take about three times as long",
        default=BakeSettings.page_size,
        min=16,
        max=MAX_PAGE_SIZE,
        subtype="PIXEL",
        update=settings_changed,
    )
    quality: EnumProperty(
        name="Quality",
        description="How many rays are spent: more give smoother shadows and finer bounced light",
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
            ("number", "Number", "So many times, 0 for direct light only"),
        ),
        default="all",
    )
    most_bounces: IntProperty(
        name="Most Bounces",
        description="Reflections of light that the lightmaps hold at most; 0 for the direct light of lamps only",
        default=4,
        min=0,
        soft_max=32,
    )
    solver: EnumProperty(
        name="Method",
        description="How the radiosity equation is solved; all methods end alike, some take longer",
        items=(
            ("conjugate-gradient", "Conjugate Gradients", "The fastest"),
            ("progressive", "Progressive Refinement", "All bright patches shoot their light at once"),
            ("overshooting", "Overshooting", "Patches shoot what they expect to receive, too"),
            ("southwell", "Southwell", "The brightest patch shoots, one at a time"),
            ("gauss-seidel", "Gauss-Seidel", "Patches gather one after the other"),
            ("jacobi", "Jacobi", "All patches gather at once: one bounce a step"),
            ("dense", "Dense", "Solved at one stroke, for scenes of few patches"),
        ),
        default=BakeSettings.solver,
    )
    form_factors: EnumProperty(
        name="Form Factors",
        description="How it is found out which share of a patch's light reaches each other patch",
        items=(
            ("nusselt", "Nusselt Rays", "By rays in the cosine's distribution; the fastest"),
            ("hemicube", "Hemicube", "Through the pixels of a half cube over each patch"),
            ("area", "Area Integral", "Point by point between every two patches, for scenes of few patches"),
        ),
        default=BakeSettings.form_factors,
    )
    subdivisions: IntProperty(
        name="Subdivisions",
        description="How often patches are split where the light changes across them",
        default=BakeSettings.subdivisions,
        min=0,
        max=MOST_SUBDIVISIONS,
    )
    light_groups: BoolProperty(
        name="Keep Groups Apart",
        description="Bake the light of each light group onto pages of its own, too: afterwards it can be dimmed and "
        "tinted without baking again, here or in an engine",
        default=False,
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
            fine_folds=self.fine_folds,
            page_size=self.page_size,
            quality=self.quality,
            tolerance=self.tolerance,
            solver=self.solver,
            form_factors=self.form_factors,
            subdivisions=self.subdivisions,
            threads=self.threads,
            light_groups=self.light_groups,
            **(cycles_limits(self.id_data) if self.bounces == "scene" else {}),
            **({"bounces": self.most_bounces} if self.bounces == "number" else {}),
        )


CLASSES = (RadiosityFileSettings, RadiositySceneSettings)


def register() -> None:
    """Give scenes their settings."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.radiosity = PointerProperty(type=RadiositySceneSettings)


def unregister() -> None:
    """Take the settings away; what a file holds of them stays in it."""
    del bpy.types.Scene.radiosity
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
