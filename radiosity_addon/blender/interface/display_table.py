# SPDX-License-Identifier: GPL-3.0-or-later
"""How a scene's view settings show light: exposure, and as a table AgX, Filmic or whatever is chosen."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np

from ...arrays import Float32

EDGE = 32
"""Entries along an axis of the table."""

DARKEST, BRIGHTEST = -9.0, 7.0
"""Powers of two of exposed radiance at its first and last entries: half a stop from one to the next."""

SHOW_MATERIALS = ("MATERIAL", "RENDERED")
"""Shadings of a 3D view in which a bake is seen."""


def is_exposed(shading: bpy.types.View3DShading) -> bool:
    """Whether Blender shows the scene's exposure in a 3D view: not where neither its lamps nor its world light it."""
    if shading.type == "MATERIAL":
        return shading.use_scene_lights or shading.use_scene_world
    return shading.type == "RENDERED" and (shading.use_scene_lights_render or shading.use_scene_world_render)


def display_table(scene: bpy.types.Scene) -> Float32:
    """Colours (EDGE, EDGE, EDGE, 3) as the display takes them, 0..1; blue rises along the first axis, red the last.

    Radiance of powers of two, evenly from DARKEST to BRIGHTEST, is shown without exposure. The scene is left as found.
    """
    level = np.exp2(np.linspace(DARKEST, BRIGHTEST, EDGE, dtype=np.float32))
    pixels = np.ones((EDGE, EDGE, EDGE, 4), np.float32)
    pixels[..., 2], pixels[..., 1], pixels[..., 0] = np.meshgrid(level, level, level, indexing="ij")
    copy = scene.copy()
    images = []
    try:
        copy.view_settings.exposure = 0.0
        settings = copy.render.image_settings
        if hasattr(settings, "media_type"):  # from 5.0; it decides which formats there are
            settings.media_type = "IMAGE"
        settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGB", "8"
        settings.color_management = "FOLLOW_SCENE"
        image = bpy.data.images.new("Radiosity", EDGE * EDGE, EDGE, float_buffer=True)
        images.append(image)
        image.pixels.foreach_set(pixels.ravel())
        with tempfile.TemporaryDirectory(prefix="radiosity-") as folder:
            path = str(Path(folder, "display.png"))
            image.save_render(path, scene=copy)
            images.append(bpy.data.images.load(path))
            images[-1].pixels.foreach_get(pixels.ravel())
        return pixels[..., :3].copy()
    finally:
        for image in images:
            bpy.data.images.remove(image)
        bpy.data.scenes.remove(copy)
