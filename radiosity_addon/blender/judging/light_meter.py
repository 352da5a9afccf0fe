# SPDX-License-Identifier: GPL-3.0-or-later
"""A light meter: point at a surface in the 3D view, and read how much baked light arrives there."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import bpy
import numpy as np
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d

from ...arrays import Float64
from ...atlas.density import texels_per_metre
from ...color.spaces import REC709
from ...errors import OutputError, explained
from ...geometry.picking import bilinear, first_triangle
from ...reports.pictures import LUMENS_PER_WATT
from ...reports.report_figures import short_text
from .overlay_data import Pages, Placed, Shape, missing, placed_things, shape_of
from .overlay_legend import Legend, draw_legend, width_of
from .overlays import redraw_views

ASIDE = 18
"""Pixels between the pointer and what is written, at a resolution scale of 1."""


@dataclass(frozen=True)
class Reading:
    """What the meter shows.

    Attributes:
        name: of the object
        lux: illuminance
        density: texels per metre
    """

    name: str
    lux: float
    density: float

    def legend(self) -> Legend:
        """In lux, in watts, and how fine the lightmap is there."""
        watts = short_text(self.lux / LUMENS_PER_WATT)
        return Legend(
            f"{short_text(self.lux)} lx", None, (), (f"{watts} W/m²", self.name, f"{short_text(self.density)} texels/m")
        )

    def text(self) -> str:
        """In one line."""
        return f"{self.name}: {short_text(self.lux)} lx, {short_text(self.lux / LUMENS_PER_WATT)} W/m²"


def reading(
    things: Iterable[tuple[Placed, Shape]], pages: Pages, origin: Float64, direction: Float64
) -> Reading | None:
    """Read the light where a ray (3,), (3,) first meets a lightmap; None where it meets none.

    Raises:
        OutputError: a page's file is gone
    """
    best: tuple[float, Placed, Shape, tuple[int, float, float]] | None = None
    for thing, shape in things:
        if thing.page is None or abs(np.linalg.det(thing.matrix[:3, :3])) < 1e-30:
            continue
        back = np.linalg.inv(thing.matrix)
        met = first_triangle(back[:3, :3] @ origin + back[:3, 3], back[:3, :3] @ direction, shape.corners)
        if met is not None and (best is None or met[1] < best[0]):
            best = (met[1], thing, shape, (met[0], met[2], met[3]))
    if best is None:
        return None
    _, thing, shape, (triangle, u, v) = best
    linear = thing.matrix[:3, :3]
    facing = np.cross(*(linear @ (shape.corners[triangle, k] - shape.corners[triangle, 0]) for k in (1, 2)))
    behind = facing @ direction * np.linalg.det(linear) > 0
    weights = np.array([1 - u - v, u, v])
    if behind and thing.back_page is not None and shape.back_uv is not None:
        page, place = thing.back_page, weights @ shape.back_uv[triangle]
    else:
        scale, *shift = thing.place
        page, place = thing.page, weights @ shape.uv[triangle] * scale + shift
    light = bilinear(pages.light(page), float(place[0]), float(place[1]))
    lux = float(np.pi * LUMENS_PER_WATT * light @ REC709.luminance_weights)
    own = shape.ratio[triangle : triangle + 1]
    return Reading(thing.name, lux, float(texels_per_metre(own, linear, pages.size * thing.place[0])[0]))


@dataclass(eq=False)
class Meter:
    """The meter while it is in use.

    Attributes:
        shown: what it shows
        region: where, by its address
        at: pixels of the pointer in that region
    """

    pages: Pages
    shown: Legend | None = None
    line: str = ""
    region: int = 0
    at: tuple[int, int] = (0, 0)
    _shapes: dict[Hashable, Shape] = field(default_factory=dict)

    def point(self, context: bpy.types.Context, x: int, y: int) -> None:
        """Read where a pixel of the window shows a surface."""
        self.shown, self.line, self.region = None, "", 0
        found = _region_at(context, x, y)
        if found is None:
            return
        pages = Pages.of(context.scene)
        if pages.signature != self.pages.signature:  # baked again, or undone
            self.pages, self._shapes = pages, {}
        view, region = found
        self.region, self.at = region.as_pointer(), (x - region.x, y - region.y)
        camera = view.region_3d
        origin = np.array(region_2d_to_origin_3d(region, camera, self.at), np.float64)
        direction = np.array(region_2d_to_vector_3d(region, camera, self.at), np.float64)
        things = [(thing, self._shape(thing)) for thing in placed_things(context.evaluated_depsgraph_get(), view)]
        read = reading(things, self.pages, origin, direction)
        if read is not None:
            self.shown, self.line = read.legend(), read.text()

    def _shape(self, thing: Placed) -> Shape:
        if thing.key not in self._shapes:
            self._shapes[thing.key] = shape_of(thing.mesh, thing.uv_map)
        return self._shapes[thing.key]


def _region_at(context: bpy.types.Context, x: int, y: int) -> tuple[bpy.types.SpaceView3D, bpy.types.Region] | None:
    """The 3D view under a pixel of the window; not where its sidebar or its header lies over it."""
    for area in context.window.screen.areas:
        if area.type != "VIEW_3D":
            continue
        inside = [
            region
            for region in area.regions
            if region.x <= x < region.x + region.width and region.y <= y < region.y + region.height
        ]
        if inside and all(region.type in ("WINDOW", "HUD") for region in inside):
            return area.spaces.active, next(region for region in inside if region.type == "WINDOW")
    return None


class RADIOSITY_OT_light_meter(bpy.types.Operator):
    """Point at a surface to read how much light arrives there; a click notes it in the status bar, Esc ends"""

    bl_idname = "radiosity.light_meter"
    bl_label = "Light Meter"
    bl_options: ClassVar = {"INTERNAL"}

    meter: ClassVar[Meter | None] = None
    handler: ClassVar[Any] = None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if bpy.app.background:
            cls.poll_message_set("There is no window to point in")
            return False
        if cls.meter is not None:
            cls.poll_message_set("The light meter is in use; Esc puts it away")
            return False
        reason = "" if context.scene is None else missing(context.scene, "illuminance")
        if reason:
            cls.poll_message_set(reason)
        return context.scene is not None and not reason

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        cls = type(self)
        cls.meter = Meter(Pages.of(context.scene))
        cls.handler = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")
        context.window.cursor_modal_set("EYEDROPPER")
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        meter = type(self).meter
        if meter is None or event.type in ("ESC", "RIGHTMOUSE"):
            self.cancel(context)
            return {"CANCELLED"}
        if event.type == "MOUSEMOVE":
            try:
                meter.point(context, event.mouse_x, event.mouse_y)
            except OutputError as error:
                self.cancel(context)
                self.report({"ERROR"}, explained(error))
                return {"CANCELLED"}
            redraw_views()
            return {"PASS_THROUGH"}
        if event.type == "LEFTMOUSE" and meter.region:  # when let go, too: nothing is to be selected
            if event.value == "PRESS" and meter.line:
                self.report({"INFO"}, meter.line)
            return {"RUNNING_MODAL"}
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Put the meter away; Blender calls this too, when another file is opened."""
        put_away()
        if context.window is not None:
            context.window.cursor_modal_restore()
        redraw_views()


def put_away() -> None:
    """Write nothing beside the pointer any more."""
    operator = RADIOSITY_OT_light_meter
    if operator.handler is not None:
        bpy.types.SpaceView3D.draw_handler_remove(operator.handler, "WINDOW")
    operator.meter = operator.handler = None


def _draw() -> None:
    meter = RADIOSITY_OT_light_meter.meter
    if meter is None or meter.shown is None or bpy.context.region.as_pointer() != meter.region:
        return
    scale = bpy.context.preferences.system.ui_scale
    x, y = meter.at
    right = min(x + ASIDE * scale + width_of(meter.shown, scale), bpy.context.region.width)
    draw_legend(meter.shown, right, y + ASIDE * scale, scale)


def register() -> None:
    """Add the meter."""
    bpy.utils.register_class(RADIOSITY_OT_light_meter)


def unregister() -> None:
    """Take the meter away."""
    put_away()
    bpy.utils.unregister_class(RADIOSITY_OT_light_meter)
