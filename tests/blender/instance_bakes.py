# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes and pictures of instances."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix


def picture(folder: Path, engine: str = "CYCLES") -> np.ndarray:
    """What an engine shows from above, (H, W, 3), W/(m2 sr), lit by nothing but the lightmaps."""
    scene = bpy.context.scene
    bpy.data.objects["Lamp"].hide_render = True
    if scene.camera is None:
        camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        camera.data.type, camera.data.ortho_scale = "ORTHO", 9
        camera.matrix_world = Matrix.Translation((-0.5, 0, 6))
        scene.collection.objects.link(camera)
        scene.camera = camera
    scene.render.engine, scene.eevee.taa_render_samples = engine, 16
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 16, False, 0
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 120, 60, 100
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(folder / "picture.exr")
    bpy.ops.render.render(write_still=True)
    bpy.data.objects["Lamp"].hide_render = False
    return pixels_of(folder / "picture.exr")


def pixels_of(path: Path) -> np.ndarray:
    """A picture's colours (H, W, 3)."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.is_data = True
    pixels = np.array(image.pixels[:]).reshape(60, 120, -1)[..., :3]
    bpy.data.images.remove(image)
    return pixels
