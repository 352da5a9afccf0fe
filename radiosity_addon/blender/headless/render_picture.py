# SPDX-License-Identifier: GPL-3.0-or-later
"""A picture of a baked scene, rendered with Cycles on the processor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import bpy

from ...errors import OutputError, SceneError
from ...files import Transaction
from ..data.evaluation import without_render_result
from .fitted_camera import fitted_camera

SAMPLES = 64
"""Lit materials only emit, so samples smooth edges alone; 64 leave nothing to see."""
ADAPTIVE_THRESHOLD = 0.01
"""Noise below which Cycles leaves a pixel alone: a flat lit wall is done after a few samples."""
ADAPTIVE_MIN_SAMPLES = 8
MAX_EDGE = 1920
"""Larger pictures than this, in pixels, are scaled down."""


def render_picture(
    scene: bpy.types.Scene,
    path: Path,
    objects: Sequence[bpy.types.Object],
    files: Transaction,
    caption: str = "",
    edge: int = MAX_EDGE,
) -> None:
    """Render the scene as a PNG, with a camera fitted to `objects` if the scene has none; the scene is left as found.

    Args:
        path: of the PNG
        caption: a line of text in the picture
        edge: pixels along its longer edge, at most

    Raises:
        SceneError: there is nothing to look at
        OutputError: the picture was not written
    """
    if scene.camera is None and not objects:
        raise SceneError("Scene", "there is nothing to render a picture of", "Bake an object with a surface")
    temporary = files.begin(path)
    with without_render_result(), _copy_for_a_picture(scene, temporary, edge) as copy, ExitStack() as stack:
        if caption:
            _write_into(copy.render, caption)
        if copy.camera is None:
            stack.enter_context(fitted_camera(copy, objects))
        bpy.ops.render.render("EXEC_DEFAULT", scene=copy.name, write_still=True)
    if not is_whole(temporary):
        raise OutputError(str(path), "the rendered picture was not written", "Free some space or choose another folder")
    files.place(path)


def _write_into(render: bpy.types.RenderSettings, caption: str) -> None:
    """Have Blender write a caption into the picture, and nothing else."""
    for name in dir(render):
        if name.startswith("use_stamp_"):
            setattr(render, name, name == "use_stamp_note")
    render.use_stamp = True
    render.stamp_note_text = caption
    render.stamp_font_size = max(12, render.resolution_x * render.resolution_percentage // 100 // 28)
    render.stamp_foreground, render.stamp_background = (1, 1, 1, 1), (0, 0, 0, 0.6)


def is_whole(picture: Path) -> bool:
    """Blender reports success on a full disk: the picture's last chunk tells."""
    return picture.is_file() and picture.read_bytes()[-8:-4] == b"IEND"


@contextmanager
def _copy_for_a_picture(scene: bpy.types.Scene, path: Path, longest: int) -> Iterator[bpy.types.Scene]:
    """A copy of the scene that shares its objects, to be rendered quickly to a PNG."""
    copy = scene.copy()
    try:
        render, image = copy.render, copy.render.image_settings
        render.engine = "CYCLES"
        render.filepath, render.use_file_extension = str(path), False
        render.use_border = render.use_multiview = render.use_sequencer = False
        render.use_compositing = False  # its nodes may write files of their own
        edge = max(render.resolution_x, render.resolution_y) * render.resolution_percentage / 100
        render.resolution_percentage = max(1, int(render.resolution_percentage * min(1.0, longest / edge)))
        if hasattr(image, "media_type"):  # from 5.0; it decides which formats there are
            image.media_type = "IMAGE"
        image.file_format, image.color_mode, image.color_depth = "PNG", "RGB", "8"
        cycles = copy.cycles
        cycles.device = "CPU"
        cycles.samples, cycles.use_denoising = SAMPLES, False
        cycles.use_adaptive_sampling = True
        cycles.adaptive_threshold, cycles.adaptive_min_samples = ADAPTIVE_THRESHOLD, ADAPTIVE_MIN_SAMPLES
        yield copy
    finally:
        bpy.data.scenes.remove(copy)
