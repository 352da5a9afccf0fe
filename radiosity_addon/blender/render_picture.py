# SPDX-License-Identifier: GPL-3.0-or-later
"""A picture of a baked scene, rendered with Cycles on the processor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix, Vector

from ..errors import OutputError, SceneError
from ..files import Transaction

SAMPLES = 64
"""Lit materials only emit, so samples smooth edges alone; 64 leave nothing to see."""
ADAPTIVE_THRESHOLD = 0.01
"""Noise below which Cycles leaves a pixel alone: a flat lit wall is done after a few samples."""
MAX_EDGE = 1920
"""Larger pictures than this, in pixels, are scaled down."""
VIEW_FROM = Vector((-0.55, -1.0, 0.45))
"""Direction from the objects to a fitted camera: in front, from the left, a little from above."""


def render_picture(scene: bpy.types.Scene, path: Path, objects: Sequence[bpy.types.Object], files: Transaction) -> None:
    """Render the scene as a PNG, with a camera fitted to `objects` if the scene has none; the scene is left as found.

    Raises:
        SceneError: there is nothing to look at
        OutputError: the picture was not written
    """
    temporary = files.begin(path)
    with _for_a_picture(scene, temporary), _camera(scene, objects):
        bpy.ops.render.render("EXEC_DEFAULT", scene=scene.name, write_still=True)
    if not _is_whole(temporary):
        raise OutputError(str(path), "the rendered picture was not written", "Free some space or choose another folder")
    files.place(path)


def _is_whole(picture: Path) -> bool:
    """Blender reports success on a full disk: the picture's last chunk tells."""
    return picture.is_file() and picture.read_bytes()[-8:-4] == b"IEND"


@contextmanager
def _for_a_picture(scene: bpy.types.Scene, path: Path) -> Iterator[None]:
    render = scene.render
    edge = max(render.resolution_x, render.resolution_y) * render.resolution_percentage / 100
    changes: list[tuple[Any, str, Any]] = [
        (render, "engine", "CYCLES"),
        (render, "filepath", str(path)),
        (render, "use_file_extension", False),
        (render, "use_border", False),
        (render, "use_multiview", False),
        (render, "use_sequencer", False),
        (render, "resolution_percentage", max(1, int(render.resolution_percentage * min(1.0, MAX_EDGE / edge)))),
        (scene.cycles, "device", "CPU"),
        (scene.cycles, "samples", SAMPLES),
        (scene.cycles, "use_adaptive_sampling", True),
        (scene.cycles, "adaptive_threshold", ADAPTIVE_THRESHOLD),
        (scene.cycles, "adaptive_min_samples", 8),
        (scene.cycles, "use_denoising", False),
    ]
    image = render.image_settings
    if hasattr(image, "media_type"):  # from 5.0; it decides which formats there are
        changes.append((image, "media_type", "IMAGE"))
    changes += [(image, "file_format", "PNG"), (image, "color_mode", "RGB"), (image, "color_depth", "8")]
    before = []
    try:
        for owner, name, value in changes:
            before.append((owner, name, getattr(owner, name)))
            setattr(owner, name, value)
        yield
    finally:
        for owner, name, value in reversed(before):
            setattr(owner, name, value)


@contextmanager
def _camera(scene: bpy.types.Scene, objects: Sequence[bpy.types.Object]) -> Iterator[None]:
    if scene.camera is not None:
        yield
        return
    corners = [thing.matrix_world @ Vector(corner) for thing in objects for corner in thing.bound_box]
    if not corners:
        raise SceneError("Scene", "there is nothing to render a picture of", "Bake an object with a surface")
    data = bpy.data.cameras.new("Radiosity")
    camera = bpy.data.objects.new("Radiosity", data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    try:
        _fit(camera, scene, corners)
        yield
    finally:
        scene.camera = None
        bpy.data.cameras.remove(data)  # takes its object along


def _fit(camera: bpy.types.Object, scene: bpy.types.Scene, corners: Sequence[Vector]) -> None:
    """Place the camera so that it sees all corners."""
    low = Vector(min(corner[axis] for corner in corners) for axis in range(3))
    high = Vector(max(corner[axis] for corner in corners) for axis in range(3))
    turn = VIEW_FROM.to_track_quat("Z", "Y").to_matrix().to_4x4()
    camera.matrix_world = Matrix.Translation((low + high) / 2) @ turn
    depsgraph = bpy.context.evaluated_depsgraph_get()
    depsgraph.update()
    place, _ = camera.camera_fit_coords(depsgraph, [x for corner in corners for x in corner])
    camera.matrix_world = Matrix.Translation(place) @ turn
    reach = max((corner - place).length for corner in corners)
    camera.data.clip_start, camera.data.clip_end = reach * 1e-4, reach * 2
