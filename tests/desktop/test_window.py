# SPDX-License-Identifier: GPL-3.0-or-later
"""The installed extension in a real window, by mouse and keys: bake, watch, cancel, bake, undo, toggle, revert.

One window goes through all of it; each fixture is one step, and each test looks at what a step has left. Pictures are
kept in out/desktop/, or in the folder that RADIOSITY_WINDOW_PICTURES names.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.desktop.blender import Desktop
from tests.desktop.cornell import LONG_BAKE, MARKS, PICTURES, SHORT_BAKE, copied, unbaked
from tests.desktop.window import Window, alike

IN_VIEW = (600, 700)
LIVE = 0.05
"""First light is found at vertices alone: so much may the mean of the 3D view be off."""

pytestmark = MARKS


@pytest.fixture(scope="module")
def blend(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Cornell box, in a folder of its own."""
    return copied(tmp_path_factory.mktemp("window"))


@pytest.fixture(scope="module")
def window(desktop: Desktop, blend: Path) -> Iterator[Window]:
    """A window that shows it."""
    window = Window(desktop, blend.parent, PICTURES)
    try:
        window.open(blend)
        window.ask("look", "MATERIAL", True)
        window.ask("save", str(blend.with_name("before.blend")))
        yield window
    finally:
        window.close()


@pytest.fixture(scope="module")
def unlit(window: Window) -> np.ndarray:
    """What the 3D view shows before any bake."""
    return unbaked(window, "before")


@pytest.fixture(scope="module")
def running(window: Window, unlit: np.ndarray) -> dict[str, Any]:
    """Lengths of the progress bars while a bake runs that was started by a click, and the state once light is seen."""
    window.ask("choose", LONG_BAKE)
    window.click_button("bpy.ops.radiosity.bake(")
    window.until(lambda: window.ask("state")["running"], "the bake runs")
    first = window.until(window.progress_bars, "a progress bar is seen")
    second = window.until(lambda: max(window.progress_bars() - first, 0), "the bar has grown") + first
    live = window.until(lambda: unlike(window.glance("baking"), unlit), "light is seen")
    return {"bars": [first, second], "live": live[0], **window.ask("state")}


@pytest.fixture(scope="module")
def cancelled(window: Window, running: dict[str, Any]) -> dict[str, Any]:
    """The state after Esc, and what the 3D view shows then."""
    window.press("Escape")
    window.until(lambda: not window.ask("state")["running"], "the bake has ended")
    return {"view": window.view("cancelled"), **window.ask("state")}


@pytest.fixture(scope="module")
def baked(window: Window, cancelled: dict[str, Any], unlit: np.ndarray) -> dict[str, Any]:
    """The state after a second bake, and what the 3D view shows then."""
    window.ask("choose", SHORT_BAKE)
    window.click_button("bpy.ops.radiosity.bake(")
    window.until(lambda: window.ask("state")["baked"], "the scene is baked")
    return {"view": window.view("baked", unlike=unlit), **window.ask("state")}


@pytest.fixture(scope="module")
def undone(window: Window, baked: dict[str, Any]) -> dict[str, Any]:
    """The state after Ctrl Z; then Ctrl Shift Z brings the bake back."""
    window.hands("mousemove", *IN_VIEW)
    window.press("ctrl+z")
    window.until(lambda: not window.ask("state")["baked"], "the bake is undone")
    state = dict(window.ask("state"))
    window.press("ctrl+shift+z")
    window.until(lambda: window.ask("state")["baked"], "the bake is done again")
    return state


@pytest.fixture(scope="module")
def toggled(window: Window, baked: dict[str, Any], undone: dict[str, Any]) -> list[np.ndarray]:
    """What the 3D view shows after Show Original, and after Show Baked."""
    window.click_button("bpy.ops.radiosity.toggle(")
    window.until(lambda: window.ask("state")["original"], "the original is shown")
    original = window.view("original", unlike=baked["view"])
    window.click_button("bpy.ops.radiosity.toggle(")
    window.until(lambda: not window.ask("state")["original"], "the bake is shown")
    return [original, window.view("baked_again", unlike=original)]


@pytest.fixture(scope="module")
def reverted(window: Window, baked: dict[str, Any], toggled: list[np.ndarray]) -> dict[str, Any]:
    """The state after Revert, and what the 3D view shows then."""
    window.click_button("bpy.ops.radiosity.revert(")
    window.until(lambda: not window.ask("state")["baked"], "the bake is taken out")
    return {"view": window.view("reverted", unlike=baked["view"]), **window.ask("state")}


def test_progress_bar_grows_while_the_window_is_drawn(running: dict[str, Any]) -> None:
    assert 0 < running["bars"][0] < running["bars"][1]


def test_light_is_seen_while_the_bake_runs(running: dict[str, Any]) -> None:
    assert running["running"]
    assert not running["baked"]


def test_escape_cancels_and_leaves_no_trace(cancelled: dict[str, Any], unlit: np.ndarray, blend: Path) -> None:
    assert alike(cancelled["view"], unlit)
    assert not cancelled["baked"]
    assert cancelled["uv_maps"] == 0
    assert cancelled["images"] == []
    assert [path.name for path in blend.parent.glob("*_textures/*")] == []


def test_second_bake_lights_every_object(baked: dict[str, Any], blend: Path) -> None:
    assert baked["uv_maps"] == 7
    assert len(baked["images"]) == 1
    assert len(list(blend.parent.glob("*_textures/*.exr"))) == 1


def test_baked_light_is_seen(baked: dict[str, Any], unlit: np.ndarray) -> None:
    assert not alike(baked["view"], unlit)


def test_live_light_is_as_bright_as_the_baked_one(running: dict[str, Any], baked: dict[str, Any]) -> None:
    assert running["live"].mean() == pytest.approx(baked["view"].mean(), rel=LIVE)


def test_bake_is_one_step_of_undo(undone: dict[str, Any]) -> None:
    assert undone["uv_maps"] == 0
    assert undone["images"] == []


def test_toggle_shows_the_original_and_the_bake(
    toggled: list[np.ndarray], baked: dict[str, Any], unlit: np.ndarray
) -> None:
    assert alike(toggled[0], unlit)
    assert alike(toggled[1], baked["view"])


def test_view_after_revert_is_the_view_before(reverted: dict[str, Any], unlit: np.ndarray) -> None:
    assert alike(reverted["view"], unlit)


def test_file_after_revert_is_the_file_before(window: Window, reverted: dict[str, Any], blend: Path) -> None:
    window.ask("choose", dict.fromkeys(SHORT_BAKE))
    after = blend.with_name("after.blend")
    window.ask("save", str(after))
    assert window.ask("compare", str(blend.with_name("before.blend")), str(after)) == []


def unlike(view: np.ndarray, other: np.ndarray) -> list[np.ndarray]:
    """The view, if it shows something else."""
    return [] if alike(view, other) else [view]
