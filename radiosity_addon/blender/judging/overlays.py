# SPDX-License-Identifier: GPL-3.0-or-later
"""The overlay that is on, if one is: drawn in every 3D view from what is read from the file, gone with one click."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any

import bpy

from ...errors import OutputError, explained
from .overlay_data import Density, Pages, Placed, Shape, density_of, edge_texels, missing, placed_things, shape_of
from .overlay_drawing import Painter
from .overlay_legend import Legend, corner, draw_legend, legend_of, said

OFF = "off"


@dataclass(eq=False)
class Overlay:
    """An overlay while it is on.

    Attributes:
        name: which
        painter: what is on the graphics card
        legend: what is to be written beside it
        failure: why it can't be drawn, or nothing
    """

    name: str
    painter: Painter
    legend: Legend | None = None
    failure: str = ""
    _pages: Pages = field(default_factory=lambda: Pages([]))
    _shapes: dict[Hashable, Shape] = field(default_factory=dict)
    _density: tuple[Any, Density] | None = None
    _edges: dict[Hashable, float] = field(default_factory=dict)

    def draw(
        self,
        scene: bpy.types.Scene,
        depsgraph: bpy.types.Depsgraph,
        settings: bpy.types.PropertyGroup,
        view: bpy.types.SpaceView3D | None = None,
    ) -> None:
        """Draw it over what a dependency graph holds, by the matrices and into the buffer that are set.

        Args:
            settings: of overlays
            view: what hides some of it, if it does
        """
        self.legend, self.failure = None, missing(scene, self.name)
        if self.failure:
            return
        pages = self._current_pages(scene)
        found = [(thing, self._shape(thing)) for thing in placed_things(depsgraph, view)]
        wanted = scene.radiosity.density if scene.radiosity.density_enabled else None
        ranked = [(thing, shape, self._edge(thing, shape, pages.size, wanted)) for thing, shape in found]
        if self.name not in ("density", "charts"):
            ranked = [row for row in ranked if row[0].page is not None]
        if not ranked:
            self.failure = "Nothing in view has a place on a lightmap"
            return
        try:
            density = self._densities(found, pages.size, wanted, settings)
            look = settings.look(self.name, pages, density)
            self.painter.draw(ranked, pages, look)
            if settings.legend:
                charts = sum(shape.chart_count for _, shape, _ in ranked) if self.name == "charts" else 0
                self.legend = legend_of(look, pages, density, charts, settings.unit)
        except OutputError as error:
            self.failure = explained(error)

    def forget_changed(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Read again what has changed in the file."""
        for update in depsgraph.updates:
            kind = update.id.original
            if isinstance(kind, bpy.types.Image):
                self.forget_pages()
            elif update.is_updated_geometry:
                keys = [key for key in self._shapes if key[1] == kind.session_uid]
                for key in keys:
                    del self._shapes[key]
                self._edges.clear()
                self.painter.forget_shapes(keys)

    def forget_all(self) -> None:
        """Read everything again."""
        self.forget_pages()
        self.painter.forget_shapes(list(self._shapes))
        self._shapes.clear()
        self._edges.clear()

    def forget_pages(self) -> None:
        """Read the pages again."""
        self._pages = Pages([])
        self.painter.forget_pages()

    def _current_pages(self, scene: bpy.types.Scene) -> Pages:
        found = Pages.of(scene)
        if found.signature != self._pages.signature:
            self.forget_all()
            self._pages = found
        return self._pages

    def _shape(self, thing: Placed) -> Shape:
        if thing.key not in self._shapes:
            self._shapes[thing.key] = shape_of(thing.mesh, thing.uv_map)
        return self._shapes[thing.key]

    def _edge(self, thing: Placed, shape: Shape, size: int, wanted: float | None) -> float:
        if thing.page is not None:
            return edge_texels(thing, shape, size, wanted)
        key = (thing.key, id(shape), thing.matrix[:3, :3].tobytes(), wanted)
        if key not in self._edges:
            self._edges[key] = edge_texels(thing, shape, size, wanted)
        return self._edges[key]

    def _densities(
        self, found: list[tuple[Placed, Shape]], size: int, wanted: float | None, settings: bpy.types.PropertyGroup
    ) -> Density | None:
        if self.name != "density":
            return None
        target = None if settings.target_auto else settings.target
        key = [(thing.key, id(shape), thing.matrix[:3, :3].tobytes(), thing.place) for thing, shape in found]
        state = (key, size, wanted, target)
        if self._density is None or self._density[0] != state:
            self._density = (state, density_of(found, size, wanted, target))
        return self._density[1]


class Shown:
    """The overlay of this session, of which there is one at most, and the handlers that draw it."""

    overlay: Overlay | None = None
    handlers: tuple[Any, ...] = ()

    @classmethod
    def name(cls) -> str:
        """Which overlay is on, OFF for none."""
        return cls.overlay.name if cls.overlay else OFF


def show(name: str) -> None:
    """Turn an overlay on in place of another one, or all of them off."""
    if name == Shown.name():
        return
    if name == OFF:
        turn_off()
    elif Shown.overlay is not None:
        Shown.overlay.name = name
    else:
        Shown.overlay = Overlay(name, Painter())
        view = bpy.types.SpaceView3D
        Shown.handlers = (
            view.draw_handler_add(_draw_view, (), "WINDOW", "POST_VIEW"),
            view.draw_handler_add(_draw_pixels, (), "WINDOW", "POST_PIXEL"),
        )
        for events, function in _events():
            if function not in events:
                events.append(function)
    redraw_views()


def turn_off() -> None:
    """Draw nothing any more, and free what lies on the graphics card."""
    for handler in Shown.handlers:
        bpy.types.SpaceView3D.draw_handler_remove(handler, "WINDOW")
    Shown.overlay, Shown.handlers = None, ()
    for events, function in _events():
        if function in events:
            events.remove(function)
    redraw_views()


def redraw_views() -> None:
    """Draw the 3D views anew, their sidebars too."""
    for manager in bpy.data.window_managers:
        for window in manager.windows:
            for area in window.screen.areas:
                if area.type == "VIEW_3D":
                    area.tag_redraw()


def _events() -> tuple[tuple[list[Any], Any], ...]:
    handlers = bpy.app.handlers
    return (
        (handlers.depsgraph_update_post, _on_change),
        (handlers.undo_post, _on_undo),
        (handlers.redo_post, _on_undo),
        (handlers.load_pre, _on_load),
    )


def _draw_view() -> None:
    context = bpy.context
    if Shown.overlay is not None:
        settings = context.window_manager.radiosity_overlay
        Shown.overlay.draw(context.scene, context.view_layer.depsgraph, settings, context.space_data)


def _draw_pixels() -> None:
    if Shown.overlay is None:
        return
    legend = said(Shown.overlay.failure) if Shown.overlay.failure else Shown.overlay.legend
    if legend is not None:
        scale = bpy.context.preferences.system.ui_scale
        draw_legend(legend, *corner(bpy.context, scale), scale)


def _on_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if Shown.overlay is not None:
        Shown.overlay.forget_changed(depsgraph)


def _on_undo(*_: object) -> None:
    if Shown.overlay is not None:
        Shown.overlay.forget_all()


def _on_load(*_: object) -> None:
    """Another file: Blender drops these handlers itself, so that its list of them stays as it is while it runs."""
    for handler in Shown.handlers:
        bpy.types.SpaceView3D.draw_handler_remove(handler, "WINDOW")
    Shown.overlay, Shown.handlers = None, ()
