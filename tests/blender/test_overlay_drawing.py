# SPDX-License-Identifier: GPL-3.0-or-later
"""Overlays as they are drawn, colour by colour, and what is left of them: nothing. Needs something to draw on."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from radiosity_addon.color.transfer import srgb_encode
from radiosity_addon.reports.pictures import LUMENS_PER_WATT, color_scale, density_scale
from tests.blender.draw_overlays import CANNOT

SCRIPT = Path(__file__).with_name("draw_overlays.py")
HALF_FLOAT = 2e-3
"""Colours pass through textures of half floats."""


@pytest.fixture(scope="module")
def drawn() -> dict[str, Any]:
    done = subprocess.run([sys.executable, SCRIPT], capture_output=True, text=True, timeout=120, check=False)
    if done.returncode == CANNOT:
        pytest.skip("this Blender can't draw without a window here")
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


@pytest.fixture
def pictures(drawn: dict[str, Any]) -> dict[str, np.ndarray]:
    return {name: np.array(values) for name, values in drawn["pictures"].items()}


@pytest.mark.parametrize(
    ("name", "light"),
    [
        ("bright half", 0.5),
        ("dark half", 0.1),
        ("between texels", 0.325),  # 4.0625 texels from the left, 9/16 of the way between two centres
        ("texels as they are", 0.5),
        ("brighter", 0.2),
        ("own place", 0.5),
        ("front", 0.1),
        ("back", 0.2),
        ("front, mirrored", 0.1),
        ("back, mirrored", 0.2),
        ("behind another", 0.5),
    ],
)
def test_light_is_shown_as_srgb_where_the_uv_map_has_it(name: str, light: float, pictures: dict) -> None:
    np.testing.assert_allclose(pictures[name], [*[srgb_encode(np.float64(light))] * 3, 1], atol=HALF_FLOAT)


def test_what_is_brighter_than_white_keeps_its_hue_on_the_way_to_white(pictures: dict) -> None:
    """Light (4, 2, 0): white by 3/4, and its own colour (1, 0.5, 0) by 1/4."""
    expected = srgb_encode(np.array([1, 0.75 + 0.125, 0.75]))
    np.testing.assert_allclose(pictures["beyond white"][:3], expected, atol=HALF_FLOAT)


def test_opacity_leaves_the_scene_its_share(pictures: dict) -> None:
    assert pictures["half opaque"][3] == pytest.approx(0.5, abs=HALF_FLOAT)


def test_illuminance_has_the_color_that_the_legend_has_there(pictures: dict) -> None:
    lux = np.pi * LUMENS_PER_WATT * 0.5
    share = np.log(lux / 100) / np.log(100)
    step = round(share * 255)
    np.testing.assert_allclose(pictures["illuminance"][:3], color_scale()[step] / 255, atol=HALF_FLOAT)


@pytest.mark.parametrize(("name", "share"), [("density as wanted", 0.5), ("density, stretched", 0.25)])
def test_density_has_the_hue_that_the_legend_has_there(name: str, share: float, pictures: dict) -> None:
    """256 texels over 2 m are the 128 that are wanted; over 8 m x 2 m they are half as dense, at a quarter."""
    wanted = density_scale()[round(share * 255)] / 255
    hue = pictures[name] / pictures[name].sum()
    np.testing.assert_allclose(hue, wanted / wanted.sum(), atol=0.01)


def test_the_checker_has_light_and_dark_squares(pictures: dict) -> None:
    assert pictures["squares"][1] > 0.05


def test_charts_differ_and_their_seam_is_dark(pictures: dict) -> None:
    assert np.abs(pictures["chart"] - pictures["other chart"]).max() > 0.2
    assert pictures["seam"][:3].max() < 0.1
    np.testing.assert_array_equal(pictures["no seam"], pictures["chart"])


def test_patches_differ_and_have_edges(pictures: dict) -> None:
    assert np.abs(pictures["patch"] - pictures["other patch"]).max() > 0.2
    assert pictures["edge of a patch"][:3].sum() < 0.6 * pictures["patch"][:3].sum()
    assert np.ptp(pictures["no patch"][:3]) == 0


def test_invalid_texels_are_magenta_on_grey(pictures: dict) -> None:
    red, green, blue, _ = pictures["invalid"]
    assert min(red, blue) > green + 0.3
    assert np.ptp(pictures["valid"][:3]) == 0


def test_nothing_is_left_of_an_overlay_that_is_off(drawn: dict[str, Any]) -> None:
    session = drawn["session"]
    assert session["on"] == ["patches", 2, 4]
    assert session["same painter"]
    assert session["freed"]
    for after in ("off", "other file", "disabled"):
        assert session[after] == ["off", 0, 0], after
