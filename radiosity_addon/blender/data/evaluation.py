# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene as a render sees it.

Blender gives scripts a dependency graph at viewport settings only; one at render settings (subdivision levels,
modifiers, visibility) is handed to render engines alone. So a copy of the scene is rendered with an engine that does
nothing, and whose data are to persist for a next render that never comes: as long the graph lives, and can be walked in
as many steps as it takes. The copy shares all objects; the scene itself, its engine, camera and last render stay
untouched.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import bpy

ENGINE = "RADIOSITY_LOOK"
RENDER_HANDLERS = (
    "render_init",
    "render_pre",
    "render_post",
    "render_complete",
    "render_cancel",
    "render_stats",
    "render_write",
)


@contextmanager
def at_render_settings(
    scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer | None = None
) -> Iterator[bpy.types.Depsgraph]:
    """A dependency graph of the scene at render settings, evaluated once; nothing of it may be kept beyond the end.

    Meanwhile the window may be drawn, which takes other graphs, but nobody may take out what is in this one.

    Args:
        scene: the scene, left exactly as found
        view_layer: one of the scene's; by default the window's if it shows this scene, else the first that renders
    """
    layer = view_layer or _shown_layer(scene)
    with _engine() as given, _copy_to_render(scene, layer.name) as copy:
        with quiet_handlers(RENDER_HANDLERS), without_render_result():
            bpy.ops.render.render("EXEC_DEFAULT", scene=copy.name)
        if not given:
            raise RuntimeError(f"Blender did not evaluate view layer {layer.name!r} of scene {scene.name!r}")
        try:
            yield given[0]
        finally:
            copy.render.use_persistent_data = False  # frees the graph


def _shown_layer(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    shown = bpy.context.view_layer
    if shown is not None and bpy.context.scene == scene:
        return shown
    return next((layer for layer in scene.view_layers if layer.use), scene.view_layers[0])


@contextmanager
def _engine() -> Iterator[list[bpy.types.Depsgraph]]:
    """An engine for renders, and the graph that one gave it."""
    given: list[bpy.types.Depsgraph] = []
    members = {
        "bl_idname": ENGINE,
        "bl_label": "Radiosity Scene Reader",
        "bl_use_preview": False,
        "update": lambda self, data, depsgraph: given.append(depsgraph),
        "render": lambda self, depsgraph: None,
    }
    engine = type("RadiosityLook", (bpy.types.RenderEngine,), members)
    bpy.utils.register_class(engine)
    try:
        yield given
    finally:
        bpy.utils.unregister_class(engine)


@contextmanager
def quiet_handlers(names: Iterable[str]) -> Iterator[None]:
    """No handlers of other scripts, of these names: this is no render or bake of theirs."""
    lists = [getattr(bpy.app.handlers, name) for name in names]
    kept = [list(handlers) for handlers in lists]
    for handlers in lists:
        handlers.clear()
    try:
        yield
    finally:
        for handlers, functions in zip(lists, kept, strict=True):
            handlers[:] = functions


@contextmanager
def without_render_result() -> Iterator[None]:
    """The image that shows the last render is there afterwards only if it was before."""
    before = {image.session_uid for image in bpy.data.images}
    try:
        yield
    finally:
        for image in list(bpy.data.images):
            if image.type == "RENDER_RESULT" and image.session_uid not in before:
                bpy.data.images.remove(image)


@contextmanager
def _copy_to_render(scene: bpy.types.Scene, shown: str) -> Iterator[bpy.types.Scene]:
    copy = scene.copy()
    camera = None
    try:
        render = copy.render
        render.engine, render.use_persistent_data = ENGINE, True
        render.resolution_x = render.resolution_y = 8
        render.resolution_percentage = 100
        render.use_border = render.use_compositing = render.use_sequencer = False
        render.use_multiview = render.use_freestyle = False
        for layer in copy.view_layers:  # all that are in use would be rendered, whichever is asked for
            layer.use = layer.name == shown
        if copy.camera is None:  # without one Blender refuses to render
            camera = bpy.data.cameras.new("Radiosity")
            copy.camera = bpy.data.objects.new("Radiosity", camera)
            copy.collection.objects.link(copy.camera)
        yield copy
    finally:
        bpy.data.scenes.remove(copy)
        if camera is not None:
            bpy.data.cameras.remove(camera)  # takes its object along
