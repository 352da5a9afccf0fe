# SPDX-License-Identifier: GPL-3.0-or-later
"""How a scene's view settings show light: exposure, and as a table AgX, Filmic or whatever is chosen."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import bpy
import numpy as np

from ...arrays import Float32

EDGE = 32
"""Entries along an axis of the table."""

DARKEST, BRIGHTEST = -9.0, 7.0
"""Powers of two of exposed radiance at its first and last entries: half a stop from one to the next."""

PLAINEST = "Raw"
"""The view that transforms nothing."""

IDLE_SECONDS = 0.2
"""Between what is prepared and whatever came before, for the window's own events."""

SHOW_MATERIALS = ("MATERIAL", "RENDERED")
"""Shadings of a 3D view in which a bake is seen."""


_prepared: set[str] = set()
_expecting: list[str] = []


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
    return _displayed(scene, pixels)[..., :3].copy()


def unprepared(scene: bpy.types.Scene) -> list[Callable[[bpy.types.Scene], None]]:
    """What Blender has to get ready in this session before a table of the scene takes it no time, step by step.

    Built are what all views need, which takes half the time, and the transform of the scene's own.
    """
    steps = {"": prepare_views, _view_of(scene): prepare_view}
    return [step for view, step in steps.items() if view not in _prepared]


def prepare_views(scene: bpy.types.Scene) -> None:
    """Have Blender get ready to transform light for any view."""
    _displayed(scene, np.ones((1, 1, 1, 4), np.float32), PLAINEST)
    _prepared.add("")


def prepare_view(scene: bpy.types.Scene) -> None:
    """Have Blender build the transform of the scene's view."""
    _displayed(scene, np.ones((1, 1, 1, 4), np.float32))
    _prepared.add(_view_of(scene))


def prepare_soon(scene: bpy.types.Scene) -> None:
    """Have Blender do so while nothing goes on: whoever looks at our panel may bake before long."""
    if unprepared(scene) and not bpy.app.timers.is_registered(_prepare):
        _expecting[:] = [scene.name]
        bpy.app.timers.register(_prepare, first_interval=IDLE_SECONDS)


def _prepare() -> float | None:
    scene = bpy.data.scenes.get(_expecting[0])
    steps = [] if scene is None else unprepared(scene)
    if bpy.app.is_job_running("RENDER"):
        return IDLE_SECONDS
    if steps:
        steps[0](scene)
    return IDLE_SECONDS if len(steps) > 1 else None


def _view_of(scene: bpy.types.Scene) -> str:
    view = scene.view_settings
    return f"{scene.display_settings.display_device}/{view.view_transform}/{view.look}"


def _displayed(scene: bpy.types.Scene, pixels: Float32, view: str = "") -> Float32:
    """Pixels (D, H, W, 4) as the display takes them, in place, in another `view` if there is one of that name."""
    copy = scene.copy()
    images = []
    try:
        if view:
            with suppress(TypeError):  # Blender runs with other colour configurations, too
                copy.view_settings.view_transform = view
        copy.view_settings.exposure = 0.0
        settings = copy.render.image_settings
        if hasattr(settings, "media_type"):  # from 5.0; it decides which formats there are
            settings.media_type = "IMAGE"
        settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGB", "8"
        settings.color_management = "FOLLOW_SCENE"
        depth, height, width = pixels.shape[:3]
        image = bpy.data.images.new("Radiosity", width, depth * height, float_buffer=True)
        images.append(image)
        image.pixels.foreach_set(pixels.ravel())
        with tempfile.TemporaryDirectory(prefix="radiosity-") as folder:
            path = str(Path(folder, "display.png"))
            image.save_render(path, scene=copy)
            images.append(bpy.data.images.load(path))
            images[-1].pixels.foreach_get(pixels.ravel())
        return pixels
    finally:
        for image in images:
            bpy.data.images.remove(image)
        bpy.data.scenes.remove(copy)
