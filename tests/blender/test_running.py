# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes as a window runs them: in threads, looked on at, stopped and kept; without the window."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable, Generator
from pathlib import Path

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.data.names import is_baked
from radiosity_addon.blender.interface import display_table as display
from radiosity_addon.blender.interface import operators
from radiosity_addon.blender.interface.display_table import EDGE, display_table, prepare_soon, unprepared
from radiosity_addon.blender.interface.live_view import LiveView
from radiosity_addon.blender.interface.running import Running
from radiosity_addon.blender.job import Seat
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.blender.reading.extraction import Extraction
from radiosity_addon.chunks import finish
from radiosity_addon.errors import SceneError
from radiosity_addon.reports.report import Report
from radiosity_addon.stages import STAGES, Progress
from radiosity_addon.viewing import LitVertices, View
from tests.blender.datablocks import differences, snapshot

ORDER = ["Read scene", *STAGES, "Write files", "Write back"]


class Onlooker:
    """Keeps what it is shown."""

    def __init__(self) -> None:
        self.satisfied = False
        self.views: list[View] = []

    def show(self, view: View) -> None:
        self.views.append(view)

    def seat(self, scene: bpy.types.Scene) -> Callable[[Extraction], Onlooker]:
        return lambda extraction: self


def in_window(scene: bpy.types.Scene, seat: Seat) -> Generator[Progress, None, Report]:
    """The steps of a bake as a window takes them: between them it lets the bake's thread be."""
    steps = operators.bake_in_place(scene, seat)
    try:
        while True:
            yield next(steps)
            time.sleep(0.001)
    except StopIteration as done:
        return done.value
    finally:
        steps.close()


@pytest.fixture(autouse=True)
def scene(tmp_path: Path) -> bpy.types.Scene:
    """A chequered floor under a lamp, quick to bake; the file is saved."""
    bpy.ops.mesh.primitive_plane_add(size=2)
    floor = bpy.context.object
    floor.name = "Floor"
    material = bpy.data.materials.new("Chequered")
    material.use_nodes = True  # before Blender 5
    nodes, links = material.node_tree.nodes, material.node_tree.links
    links.new(nodes.new("ShaderNodeTexChecker").outputs[0], nodes["Principled BSDF"].inputs["Base Color"])
    floor.data.materials.append(material)
    lamp = bpy.data.lights.new("Lamp", "POINT")
    lamp.energy = 100
    holder = bpy.data.objects.new("Lamp", lamp)
    holder.location = (0, 0, 2)
    bpy.context.collection.objects.link(holder)
    settings = bpy.context.scene.radiosity
    settings.page_size, settings.quality = 64, "draft"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    return bpy.context.scene


def page() -> np.ndarray:
    (image,) = (image for image in bpy.data.images if image.is_float)
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(-1, 4)[:, :3]


@pytest.mark.parametrize("second_blender", [False, True])
def test_pages_are_the_same_to_the_bit_in_threads_and_looked_on_at(
    second_blender: bool, scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The floor's colours are asked of the main thread, or of a second Blender."""
    finish(operators.bake_in_place(scene))
    alone = page()
    viewer = Onlooker()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    helped = dict.fromkeys(ORDER, False)
    for progress in in_window(scene, Seat(viewer.seat, second_blender=second_blender)):
        helped[progress.stage] |= any(tmp_path.glob("radiosity-blender-*"))
    assert any(helped.values()) == second_blender
    assert not any(helped[stage] for stage in ORDER[ORDER.index("Direct light") :]), "it is no longer needed"
    assert len(viewer.views) > 3
    assert np.array_equal(page(), alone)


@pytest.mark.parametrize("stage", ORDER)
def test_a_bake_in_threads_that_is_cancelled_leaves_no_trace(
    stage: str, tmp_path: Path, scene: bpy.types.Scene
) -> None:
    before, threads = snapshot(), threading.active_count()
    steps = in_window(scene, Seat(Onlooker().seat))
    reached = ORDER.index(stage)  # a thread may be past a stage before it is seen there
    assert any(ORDER.index(progress.stage) >= reached for progress in steps)
    steps.close()
    assert differences(before, snapshot()) == []
    for thread in threading.enumerate():
        if thread.name.startswith("radiosity"):
            thread.join(10)  # it ends with the step that it is in, and leaves nothing either
    assert [path.name for path in tmp_path.iterdir()] == ["room.blend"]
    assert threading.active_count() == threads


def test_a_bake_that_is_cancelled_while_a_second_blender_is_at_work_leaves_no_trace(
    tmp_path: Path, scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = snapshot()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    steps = in_window(scene, Seat(Onlooker().seat, second_blender=True))
    assert any(next(tmp_path.glob("radiosity-blender-*/subject.blend"), None) for _ in steps)
    begin = time.perf_counter()
    steps.close()
    assert time.perf_counter() - begin < 1
    for thread in threading.enumerate():
        if thread.name.startswith("radiosity"):
            thread.join(10)
    assert differences(before, snapshot()) == []
    assert [path.name for path in tmp_path.iterdir()] == ["room.blend"]


def test_a_bake_that_is_stopped_keeps_whole_pages_and_says_so(scene: bpy.types.Scene) -> None:
    finish(operators.bake_in_place(scene))
    whole = page()
    viewer = Onlooker()
    viewer.satisfied = True
    report = finish(in_window(scene, Seat(viewer.seat)))
    assert report.ended_in == "Direct light"
    assert "stopped in stage Direct light" in report.summary()
    assert page().mean() == pytest.approx(whole.mean(), rel=0.03)
    assert page().min() > 0


def test_an_object_renamed_during_the_bake_is_an_error_that_says_what_to_do(scene: bpy.types.Scene) -> None:
    steps = in_window(scene, Seat(Onlooker().seat))
    next(steps)
    next(steps)
    bpy.data.objects["Floor"].name = "Ground"
    with pytest.raises(SceneError, match=r"Floor.*renamed or deleted.*Bake again"):
        list(steps)
    assert "Radiosity" not in bpy.data.objects["Ground"].data.uv_layers


@pytest.mark.parametrize("edited, told", [("Lamp", True), ("Floor", True), ("Camera", False)])
def test_edits_during_a_bake_are_noticed_if_they_change_the_light(
    edited: str, told: bool, scene: bpy.types.Scene
) -> None:
    scene.collection.objects.link(bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera")))
    bpy.context.view_layer.update()
    Running.watch(scene)
    try:
        bpy.data.objects[edited].location.x += 0.5
        bpy.context.view_layer.update()
        assert any(edited in warning for warning in Running.edits()) == told
    finally:
        Running.unwatch()


def test_a_bake_can_be_stopped_as_soon_as_there_is_light(monkeypatch: pytest.MonkeyPatch) -> None:
    view = LiveView()
    monkeypatch.setattr(Running, "progress", Progress("Unwrap", 0.1))
    monkeypatch.setattr(Running, "view", view)
    try:
        assert not Running.can_stop()
        view.visible = np.ones(1, bool)
        corners = np.zeros((3, 3), np.float32)
        view.show(LitVertices(corners, corners, np.array([[0, 1, 2]]), np.zeros(1, np.int32)))
        assert Running.can_stop()
    finally:
        view.remove()


def test_time_left_is_what_was_expected_until_a_bake_tells_its_own_pace(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Running, "_expected", 20.0)
    assert Running.left(Progress("Unwrap", 0.0), 5.0) == 15.0
    assert 15.0 < Running.left(Progress("Unwrap", 0.03, left=150.0), 5.0) < 30.0
    assert Running.left(Progress("Unwrap", 0.03, left=150.0), 60.0) == pytest.approx(15.0), "longer than expected"
    assert Running.left(Progress("Gather", 0.5, left=90.0), 60.0) == 90.0


def test_the_display_table_shows_light_as_blender_does(scene: bpy.types.Scene) -> None:
    """Standard: radiance 1/4 is shown as sRGB 0.25, which is 0.537; the exposure is left to the view."""
    before = snapshot()
    scene.view_settings.view_transform, scene.view_settings.exposure = "Standard", 1.0
    table = display_table(scene)
    scene.view_settings.view_transform, scene.view_settings.exposure = "AgX", 0.0
    level = 2.0 ** np.linspace(-9, 7, EDGE)
    grey = table[range(EDGE), range(EDGE), range(EDGE)]
    assert np.interp(1 / 4, level, grey[:, 0]) == pytest.approx(0.537, abs=0.02)
    assert table[0, 0, -1].tolist() == pytest.approx([1, 0.04, 0.04], abs=0.03)
    assert differences(before, snapshot()) == []


def test_what_a_view_needs_is_prepared_once_while_nothing_goes_on(
    scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    timers: list[Callable[[], float | None]] = []
    monkeypatch.setattr(display, "_prepared", set())
    monkeypatch.setattr(bpy.app.timers, "register", lambda work, first_interval: timers.append(work), raising=False)
    scene.view_settings.view_transform = "AgX"
    before = snapshot()
    prepare_soon(scene)
    assert len(unprepared(scene)) == 2
    assert timers[0]() is not None, "one at a time"
    assert timers[0]() is None
    assert unprepared(scene) == []
    assert differences(before, snapshot()) == []
    prepare_soon(scene)
    assert len(timers) == 1
    scene.view_settings.view_transform = "Standard"
    assert len(unprepared(scene)) == 1


def test_what_is_hidden_in_the_view_is_not_drawn(scene: bpy.types.Scene) -> None:
    behind = bpy.data.objects.new("Behind", bpy.data.objects["Floor"].data)
    scene.collection.objects.link(behind)
    behind.hide_set(True)
    looking = Running.seat(scene)
    extraction = extract_scene(scene)
    try:
        drawn = looking(extraction).visible
    finally:
        Running.view.remove()
        Running.view = None
    assert {source.object_name: shown for source, shown in zip(extraction.sources, drawn, strict=True)} == {
        "Floor": True,
        "Behind": False,
    }


def test_many_edits_are_one_warning(scene: bpy.types.Scene) -> None:
    things = [bpy.data.objects.new(f"Thing {number}", bpy.data.objects["Floor"].data) for number in range(5)]
    for thing in things:
        scene.collection.objects.link(thing)
    bpy.context.view_layer.update()
    Running.watch(scene)
    try:
        for thing in things:
            thing.location.x += 1
        bpy.context.view_layer.update()
        (warning,) = Running.edits()
        assert "and 2 more" in warning
    finally:
        Running.unwatch()


def test_a_bake_is_one_step_to_undo(scene: bpy.types.Scene) -> None:
    bpy.ops.ed.undo_push(message="Before")
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    baked = snapshot()
    bpy.ops.ed.undo_push(message="Bake")  # which Blender does by itself where a person has pressed the button
    bpy.ops.ed.undo()
    assert not is_baked(bpy.context.scene)
    assert not bpy.data.objects["Floor"].data.uv_layers.get("Radiosity")
    assert [material.name for material in bpy.data.materials] == ["Chequered"]
    bpy.ops.ed.redo()
    changed = [
        each for each in differences(baked, snapshot()) if "users: " not in each and "/tool_settings/" not in each
    ]
    assert changed == [], "but for counts, which Blender keeps by itself"
