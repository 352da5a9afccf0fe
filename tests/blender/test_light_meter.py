# SPDX-License-Identifier: GPL-3.0-or-later
"""What the light meter reads: known light on squares, from both sides, mirrored and moved."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.judging.light_meter import RADIOSITY_OT_light_meter, reading
from radiosity_addon.blender.judging.overlay_data import Placed, Shape
from radiosity_addon.reports.pictures import LUMENS_PER_WATT

CORNERS = np.float32([[[-1, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1, -1, 0], [1, 1, 0], [-1, 1, 0]]])
WHOLE = np.float32([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]])
FLOOR = Shape(np.array([[0, 1, 2], [0, 2, 3]], np.int32), CORNERS, WHOLE, WHOLE)
LUX = np.pi * LUMENS_PER_WATT
"""Of light 1."""
HALVES = np.full((8, 8, 3), 1.0, np.float32)
HALVES[:, 4:] = 3.0
PAGES = SimpleNamespace(light=lambda page: [HALVES, np.full((8, 8, 3), 2.0, np.float32)][page], size=8)


def placed(name: str = "Floor", matrix: np.ndarray | None = None, **more: object) -> Placed:
    return Placed(name, None, "", (), np.eye(4) if matrix is None else matrix, **({"page": 0} | more))


def read(x: float, *things: Placed, z: float = 5.0):
    """Look straight down, or up from below, at x."""
    rows = [(thing, FLOOR) for thing in things]
    return reading(rows, PAGES, np.array([x, 0.3, z]), np.array([0.0, 0.0, -np.sign(z)]))


@pytest.mark.parametrize(("x", "light"), [(-0.6, 1), (0.6, 3)])
def test_light_is_read_where_the_uv_map_has_it(x: float, light: float) -> None:
    assert read(x, placed()).lux == pytest.approx(LUX * light)


def test_density_is_that_of_the_world() -> None:
    wide = np.diag([4.0, 4.0, 1.0, 1.0])
    assert read(0.6, placed()).density == pytest.approx(4)
    assert read(0.6, placed(matrix=wide)).density == pytest.approx(1)


def test_the_nearest_thing_is_read() -> None:
    higher = np.eye(4)
    higher[2, 3] = 2.0
    things = placed("Floor"), placed("Table", higher, page=1)
    assert read(0.6, *things).name == "Table"
    assert read(0.6, *things).lux == pytest.approx(LUX * 2)
    assert read(0.6, *things, z=-5.0).name == "Floor"


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_backs_have_light_of_their_own(mirror: float) -> None:
    floor = placed(matrix=np.diag([mirror, 1.0, 1.0, 1.0]), back_page=1)
    assert read(0.6 * mirror, floor).lux == pytest.approx(LUX * 3)
    assert read(0.6 * mirror, floor, z=-5.0).lux == pytest.approx(LUX * 2)


def test_things_with_a_place_of_their_own_are_read_there() -> None:
    assert read(-0.6, placed(place=(0.5, 0.5, 0.0))).lux == pytest.approx(LUX * 3)


def test_what_has_no_page_or_is_missed_is_not_read() -> None:
    assert read(0.6, placed(page=None)) is None
    assert read(1.6, placed()) is None
    assert read(0.6, placed(matrix=np.diag([1.0, 1.0, 0.0, 1.0]))) is None


def test_a_reading_says_lux_watts_and_density() -> None:
    found = read(0.6, placed())
    assert found.legend().title == "6,437 lx"
    assert found.legend().notes == ("9.42 W/m²", "Floor", "4 texels/m")
    assert found.text() == "Floor: 6,437 lx, 9.42 W/m²"


def test_without_a_window_the_meter_stays_away() -> None:
    assert not RADIOSITY_OT_light_meter.poll(bpy.context)
    with pytest.raises(RuntimeError, match="no window"):
        bpy.ops.radiosity.light_meter("INVOKE_DEFAULT")


@pytest.mark.parametrize("value", ["PRESS", "RELEASE", "CLICK"])
def test_a_click_that_is_noted_selects_nothing(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    meter = SimpleNamespace(region=1, line="Floor: 100 lx")
    monkeypatch.setattr(RADIOSITY_OT_light_meter, "meter", meter)

    class Pointed:
        meter = RADIOSITY_OT_light_meter.meter
        report = staticmethod(lambda kind, text: said.append(text))

    event = SimpleNamespace(type="LEFTMOUSE", value=value)
    assert RADIOSITY_OT_light_meter.modal(Pointed(), bpy.context, event) == {"RUNNING_MODAL"}
    assert said == [meter.line] * (value == "PRESS")
