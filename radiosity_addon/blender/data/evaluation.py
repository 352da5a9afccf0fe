# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene as a render sees it.

Blender gives scripts a dependency graph at viewport settings only; one at render settings (subdivision levels,
modifiers, visibility) is handed to render engines alone. So a copy of the scene is rendered with an engine that
looks and leaves. The copy shares all objects; the scene itself, its engine, camera and last render stay untouched.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

import bpy

T = TypeVar("T")

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


class _Look(Generic[T]):
    """One look at a dependency graph: what to do with it, and what came of it."""

    def __init__(self, use: Callable[[bpy.types.Depsgraph], T]) -> None:
        self.use = use
        self.results: list[T] = []
        self.failure: BaseException | None = None

    def take(self, depsgraph: bpy.types.Depsgraph) -> None:
        try:
            self.results.append(self.use(depsgraph))
        except BaseException as failure:  # noqa: BLE001  Blender would print it; at_render_settings raises it
            self.failure = failure


def at_render_settings(
    scene: bpy.types.Scene, use: Callable[[bpy.types.Depsgraph], T], view_layer: bpy.types.ViewLayer | None = None
) -> T:
    """Call `use` with a dependency graph of the scene at render settings and return its result.

    Nothing of the graph may be kept: it is freed on return. `use` may raise; the scene is as it was in any case.

    Args:
        scene: the scene, left exactly as found
        use: called once, from the main thread
        view_layer: one of the scene's; by default the window's if it shows this scene, else the first that renders
    """
    layer = view_layer or _shown_layer(scene)
    look = _Look(use)
    with _engine(look), quiet_handlers(RENDER_HANDLERS), without_render_result(), _copy_to_render(scene) as copy:
        bpy.ops.render.render("EXEC_DEFAULT", scene=copy.name, layer=layer.name)
    if look.failure is not None:
        raise look.failure
    if not look.results:
        raise RuntimeError(f"Blender did not evaluate view layer {layer.name!r} of scene {scene.name!r}")
    return look.results[0]


def _shown_layer(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    shown = bpy.context.view_layer
    if shown is not None and bpy.context.scene == scene:
        return shown
    return next((layer for layer in scene.view_layers if layer.use), scene.view_layers[0])


@contextmanager
def _engine(look: _Look[T]) -> Iterator[None]:
    def update(self: bpy.types.RenderEngine, data: bpy.types.BlendData, depsgraph: bpy.types.Depsgraph) -> None:
        if not look.results and look.failure is None:
            look.take(depsgraph)

    members = {
        "bl_idname": ENGINE,
        "bl_label": "Radiosity Scene Reader",
        "bl_use_preview": False,
        "update": update,
        "render": lambda self, depsgraph: None,
    }
    engine = type("RadiosityLook", (bpy.types.RenderEngine,), members)
    bpy.utils.register_class(engine)
    try:
        yield
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
def _copy_to_render(scene: bpy.types.Scene) -> Iterator[bpy.types.Scene]:
    copy = scene.copy()
    camera = None
    try:
        render = copy.render
        render.engine = ENGINE
        render.resolution_x = render.resolution_y = 8
        render.resolution_percentage = 100
        render.use_border = render.use_compositing = render.use_sequencer = False
        render.use_multiview = render.use_freestyle = False
        for layer in copy.view_layers:
            layer.use = True
        if copy.camera is None:  # without one Blender refuses to render
            camera = bpy.data.cameras.new("Radiosity")
            copy.camera = bpy.data.objects.new("Radiosity", camera)
            copy.collection.objects.link(copy.camera)
        yield copy
    finally:
        bpy.data.scenes.remove(copy)
        if camera is not None:
            bpy.data.cameras.remove(camera)  # takes its object along
