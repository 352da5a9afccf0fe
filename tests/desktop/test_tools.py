# SPDX-License-Identifier: GPL-3.0-or-later
"""What is done with a bake besides looking at it, in a real window by mouse: stopping early, mixing its lights,
judging it, and comparing it with the original.

One window goes through all of it; see test_window.py.
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

LEGEND = 90
"""Rows of pixels at the bottom of the 3D view, at most, in which an overlay that is not drawn says why."""
NEAR = 0.1
"""Share of a change that may be left when it was taken back."""
GROUPS_APART = {**SHORT_BAKE, "light_groups": True}

pytestmark = MARKS


@pytest.fixture(scope="module")
def blend(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Cornell box, in a folder of its own."""
    return copied(tmp_path_factory.mktemp("tools"))


@pytest.fixture(scope="module")
def window(desktop: Desktop, blend: Path) -> Iterator[Window]:
    """A window that shows it, with a hoop that needs a stand-in, and two light groups."""
    window = Window(desktop, blend.parent, PICTURES)
    try:
        window.open(blend)
        window.ask("furnish")
        window.ask("look", "MATERIAL", True)
        yield window
    finally:
        window.close()


@pytest.fixture(scope="module")
def unlit(window: Window) -> np.ndarray:
    """What the 3D view shows before any bake."""
    return unbaked(window, "tools_before")


@pytest.fixture(scope="module")
def stopped(window: Window, unlit: np.ndarray) -> dict[str, Any]:
    """The state after a bake that was ended as soon as there was light to keep."""
    window.ask("choose", LONG_BAKE)
    window.click_button("bpy.ops.radiosity.bake(")
    window.until(lambda: window.ask("state")["running"], "the bake runs")
    window.click_button("bpy.ops.radiosity.stop(")
    window.until(lambda: window.ask("state")["baked"], "the light is kept")
    return {"view": window.view("stopped", unlike=unlit), **window.ask("state")}


@pytest.fixture(scope="module")
def baked(window: Window, stopped: dict[str, Any]) -> np.ndarray:
    """What the 3D view shows after a whole bake with its light groups kept apart."""
    window.ask("choose", GROUPS_APART)
    window.click_button("bpy.ops.radiosity.bake(")
    window.until(lambda: window.ask("state")["mix"], "the light groups can be mixed")
    window.click_button("bpy.ops.radiosity.toggle(")  # the bake may look as the one that was stopped did, if late
    window.until(lambda: window.ask("state")["original"], "the original is shown")
    original = window.view(unlike=stopped["view"])
    window.click_button("bpy.ops.radiosity.toggle(")
    window.until(lambda: not window.ask("state")["original"], "the bake is shown")
    return window.view("grouped", unlike=original)


def test_a_bake_that_is_stopped_keeps_its_light(stopped: dict[str, Any], unlit: np.ndarray) -> None:
    assert stopped["report"]["ended_in"]
    assert not alike(stopped["view"], unlit)


def test_a_slider_dims_a_light_group_and_reset_brings_it_back(window: Window, baked: np.ndarray) -> None:
    window.set_slider("radiosity_mix[0].strength", "0")
    window.until(lambda: window.ask("state")["mix"] == [0.0, 1.0], "the slider is at its end")
    dimmed = window.view("mixed", unlike=baked)
    assert dimmed.mean() < baked.mean()
    window.click_button("bpy.ops.radiosity.reset_mix(")
    window.until(lambda: window.ask("state")["mix"] == [1.0, 1.0], "the groups are as they were baked")
    assert returned(window.view(unlike=dimmed), baked, dimmed)


def test_an_overlay_gives_way_to_the_original_and_comes_back_with_the_bake(
    window: Window, baked: np.ndarray, unlit: np.ndarray
) -> None:
    window.click_button("bpy.ops.radiosity.overlay(show='illuminance'")
    judged = window.view("overlay", unlike=baked)
    window.click_button("bpy.ops.radiosity.toggle(")
    window.until(lambda: window.ask("state")["original"], "the original is shown")
    original = window.view("overlay_original", unlike=judged)
    assert returned(original[:-LEGEND], unlit[:-LEGEND], judged[:-LEGEND])
    window.click_button("bpy.ops.radiosity.toggle(")
    window.until(lambda: not window.ask("state")["original"], "the bake is shown")
    assert returned(window.view(unlike=original), judged, original)
    window.click_button("bpy.ops.radiosity.overlay(show='off'")
    assert returned(window.view(unlike=judged), baked, judged)


def test_check_names_what_is_not_rendered_and_its_button_selects_it(window: Window, baked: np.ndarray) -> None:
    assert window.ask("state")["active"] != "Forgotten"
    window.click_button("bpy.ops.radiosity.check(")
    window.until(lambda: window.ask("state")["last"] == "RADIOSITY_OT_check", "the scene is checked")
    window.click_button('bpy.ops.radiosity.select(name="Forgotten"')
    window.until(lambda: window.ask("state")["active"] == "Forgotten", "the object is selected")
    window.picture("checked")


def test_export_is_found_by_its_name_and_writes_files(window: Window, baked: np.ndarray, blend: Path) -> None:
    window.search("export lightmaps")
    window.click(*window.scroll_to_button("bpy.ops.radiosity.export(", "properties"))
    folder = blend.with_name(f"{blend.stem}_export")
    window.until(lambda: list(folder.glob("*.glb")), "the files are written")
    window.picture("exported")
    assert sorted(path.suffix for path in folder.iterdir()) == [".exr", ".glb", ".json"]


def returned(view: np.ndarray, to: np.ndarray, away: np.ndarray) -> bool:
    """Whether a view shows again what it did, as seen from how far it was away: edges of shadows are sampled anew."""

    def far(one: np.ndarray) -> float:
        return float(np.abs(one.astype(np.float32) - to).mean())

    return far(view) < NEAR * far(away)
