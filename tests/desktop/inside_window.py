# SPDX-License-Identifier: GPL-3.0-or-later
"""Run by a Blender with a window: does what the tests ask for and tells them what they can't see.

    blender FILE.blend --python inside_window.py -- FOLDER

A question is FOLDER/question.json, the answer FOLDER/answer.json; both carry its number. Mouse and keys are not ours:
they come from outside, as a person's do.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
TICK_SECONDS = 0.05
WATCH_SECONDS = 0.005
OPERATOR_COLOR = (0x54 / 255, 0x57 / 255, 0x54 / 255, 1.0)
"""Of buttons that call operators. The theme has three steps less green, which no eye tells apart."""
SLIDER_COLOR = (0x47 / 255, 0x72 / 255, 0xB0 / 255, 1.0)
"""Of the filled part of sliders, likewise."""
PROGRESS_COLOR = (0x47 / 255, 0x75 / 255, 0xB3 / 255, 1.0)
"""Of bars that show progress, likewise."""
PLACES = {"sidebar": ("VIEW_3D", "UI"), "view": ("VIEW_3D", "WINDOW"), "properties": ("PROPERTIES", "WINDOW")}

answered = 0
noted: dict[str, float] = {}
kept: list[dict[str, Any]] = []


def arrange(tab: str) -> bool:
    """Bring the window into a known state, a tab of the sidebar in sight; True once it is, so ask again until then."""
    preferences = bpy.context.preferences
    preferences.use_preferences_save = False
    interface = preferences.themes[0].user_interface
    interface.wcol_tool.inner = OPERATOR_COLOR
    interface.wcol_progress.item = PROGRESS_COLOR
    interface.wcol_numslider.item = SLIDER_COLOR
    area("PROPERTIES").spaces.active.context = "RENDER"
    space, sidebar = area("VIEW_3D").spaces.active, region("sidebar")
    if not tab:
        space.show_region_ui = False
        return True
    if not space.show_region_ui or sidebar.width <= 1:
        space.show_region_ui = True
        return False
    if sidebar.active_panel_category != tab:
        sidebar.active_panel_category = tab
        return False
    return True


def look(shading: str, camera: bool) -> None:
    """Choose how the 3D view is shaded, and whether it looks through the camera, quickly drawn."""
    space = area("VIEW_3D").spaces.active
    space.shading.type = shading
    bpy.context.preferences.system.viewport_aa = "OFF"  # software draws a picture for each sample
    if camera:
        bpy.context.window_manager.windows[0].scene.eevee.taa_samples = 1  # likewise
        space.region_3d.view_perspective = "CAMERA"


def tutorial(step: str) -> None:
    """Take a step of tutorial_steps.py in the 3D view."""
    import tutorial_steps

    window = bpy.context.window_manager.windows[0]
    with bpy.context.temp_override(window=window, area=area("VIEW_3D"), region=region("view")):
        getattr(tutorial_steps, step)()


def state() -> dict[str, Any]:
    """What is open, and how far the bake is."""
    scene = bpy.context.window_manager.windows[0].scene
    return {
        "file": bpy.data.filepath,
        "running": "RADIOSITY_OT_bake" in running(),
        "baked": "radiosity_bake" in scene,
        "original": "radiosity_originals" in scene,
        "report": json.loads(scene["radiosity_report"]["report"]) if "radiosity_report" in scene else None,
        "active": thing.name if (thing := scene.view_layers[0].objects.active) else "",
        "last": operators[-1].bl_idname if (operators := bpy.context.window_manager.operators) else "",
        "search": area("PROPERTIES").spaces.active.search_filter,
        "mix": [group.strength for group in scene.radiosity_mix],
        "uv_maps": sum("Radiosity" in mesh.uv_layers for mesh in bpy.data.meshes),
        "images": [image.name for image in bpy.data.images if image.is_float],
    }


def watch() -> None:
    """From now on, note when each stage of the next bake is seen first, and when the bake is over; see `seen`."""
    noted.clear()
    (module,) = (
        each for name, each in sys.modules.items() if name.endswith("radiosity_addon.blender.interface.running")
    )

    def look() -> float | None:
        progress = module.Running.progress
        if progress is not None:
            noted.setdefault(progress.stage, time.monotonic())
        elif noted:
            noted["ended"] = time.monotonic()
            return None
        return WATCH_SECONDS

    bpy.app.timers.register(look)


def seen() -> dict[str, float]:
    """By stage, when it was seen first since `watch`, and "ended"; seconds of a clock that all programs share."""
    return noted


def remember() -> None:
    """Keep all datablocks as they are, for `changed`."""
    from datablocks import snapshot

    kept.append(snapshot())


def changed() -> list[str]:
    """Where the file differs from what was kept, datablock by datablock."""
    from datablocks import differences, snapshot

    return differences(kept[-1], snapshot())


def redraw() -> None:
    """Draw all that is in sight again."""
    for each in bpy.context.window_manager.windows[0].screen.areas:
        each.tag_redraw()


def running() -> list[str]:
    """The operators that are running in the window."""
    return [operator.bl_idname for operator in bpy.context.window_manager.windows[0].modal_operators]


def place(name: str) -> list[int]:
    """Left, top, right and bottom of a part of the window, in pixels of a screenshot."""
    found = region(name)
    height = bpy.context.window_manager.windows[0].height
    return [found.x, height - found.y - found.height, found.x + found.width, height - found.y]


def hovered(name: str) -> str:
    """The call behind the button under the mouse, such as `bpy.ops.radiosity.bake()`; empty where there is none."""
    return _copied(name, bpy.ops.ui.copy_python_command_button)


def pointed(name: str) -> str:
    """The path of the setting under the mouse, from its datablock on; empty where there is none."""
    return _copied(name, bpy.ops.ui.copy_data_path_button)


def _copied(name: str, copy: Callable[[], object]) -> str:
    """What an operator copies of the button under the mouse; empty where it can't."""
    manager = bpy.context.window_manager
    manager.clipboard = ""
    with bpy.context.temp_override(window=manager.windows[0], area=area(PLACES[name][0]), region=region(name)):
        if copy.poll():
            copy()
    return str(manager.clipboard)


def furnish() -> None:
    """Add a hoop made of a curve, a second lamp in a light group of its own, and something that is not rendered."""
    scene = bpy.context.window_manager.windows[0].scene
    layer = scene.view_layers[0]
    hoop = bpy.data.curves.new("Hoop", "CURVE")
    hoop.dimensions, hoop.bevel_depth = "3D", 0.2
    spline = hoop.splines.new("NURBS")
    spline.points.add(3)
    for point, (x, z) in zip(spline.points, ((-1, 0), (0, -1), (1, 0), (0, 1)), strict=True):
        point.co = (x, 0, z, 1)
    spline.use_cyclic_u = True
    fill = bpy.data.lights.new("Fill", "POINT")
    fill.energy, fill.color, fill.shadow_soft_size = 150, (0.1, 0.3, 1.0), 0.2
    added = {"Hoop": (hoop, (0.8, 1.5, 3.6)), "Fill": (fill, (-1.8, 1.0, 1.0)), "Forgotten": (hoop, (0, 20, 0))}
    for name, (data, place) in added.items():
        thing = bpy.data.objects.new(name, data)
        thing.location = place
        scene.collection.objects.link(thing)
    bpy.data.objects["Forgotten"].hide_render = True
    for name in ("Lamp", "Fill"):
        layer.lightgroups.add(name=name)
        bpy.data.objects[name].lightgroup = name


def choose(settings: dict[str, Any]) -> None:
    """Set settings of the scene's bake; None takes a setting back."""
    radiosity = bpy.context.window_manager.windows[0].scene.radiosity
    for name, value in settings.items():
        if value is None:
            radiosity.property_unset(name)
        else:
            setattr(radiosity, name, value)


def save(path: str, copy: bool = True) -> None:
    """Save the open file as `path`; with `copy` go on with the one that was open."""
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=copy)


def compare(before: str, after: str) -> list[str]:
    """Where two .blend files differ, datablock by datablock."""
    from datablocks import differences, snapshot

    area("VIEW_3D").spaces.active.shading.type = "SOLID"  # faster to draw
    snapshots = []
    for path in (before, after):
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
            bpy.ops.wm.open_mainfile(filepath=path, load_ui=False)
        snapshots.append(snapshot())
    return differences(*snapshots)


def area(kind: str) -> bpy.types.Area:
    return next(area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == kind)


def region(name: str) -> bpy.types.Region:
    kind, part = PLACES[name]
    return next(region for region in area(kind).regions if region.type == part)


CALLS: dict[str, Callable[..., Any]] = {
    call.__name__: call
    for call in (
        arrange, look, tutorial, state, watch, seen, remember, changed, redraw, place, hovered, pointed, furnish,
        choose, save, compare,
    )
}  # fmt: skip


def answer() -> float:
    """Answer the question, if there is a new one."""
    global answered
    try:
        question = json.loads((FOLDER / "question.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return TICK_SECONDS
    if question["number"] > answered:
        answered = question["number"]
        reply: dict[str, Any] = {"number": answered}
        try:
            reply["value"] = CALLS[question["call"]](*question["arguments"])
        except Exception:  # noqa: BLE001 the test that asked says what went wrong
            reply["error"] = traceback.format_exc()
        waiting = FOLDER / "answer.part"
        waiting.write_text(json.dumps(reply), encoding="utf-8")
        os.replace(waiting, FOLDER / "answer.json")
    return TICK_SECONDS


sys.path.insert(0, str(Path(__file__).parent))
bpy.context.preferences.view.show_splash = False
bpy.app.timers.register(answer, persistent=True)
