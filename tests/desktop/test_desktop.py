# SPDX-License-Identifier: GPL-3.0-or-later
"""The released zip in a real desktop Blender, without a window."""

from __future__ import annotations

import json
from typing import Any

import pytest

from tests.desktop.blender import Desktop

FLOOR_CENTRE = 2.33887
"""Lighting under a square lamp of 1 m and 100 W, 2 m above, as Cycles and the closed form have it, W/(m2 sr)."""

pytestmark = pytest.mark.desktop


@pytest.fixture(scope="module")
def result(desktop: Desktop) -> dict[str, Any]:
    """What that Blender noted."""
    noted: dict[str, Any] = json.loads((desktop.folder / "result.json").read_text(encoding="utf-8"))
    return noted


def test_extension_is_enabled_by_installing(result: dict[str, Any]) -> None:
    assert result["enabled"]
    assert result["operators"] == ["bake", "revert"]


def test_wheels_come_from_the_zip(result: dict[str, Any], desktop: Desktop) -> None:
    extensions = str(desktop.folder / "user" / "extensions")
    assert result["libraries"]
    assert all(path.startswith(extensions) for path in result["libraries"].values()), result["libraries"]


def test_operator_bakes_the_light_of_a_lamp(result: dict[str, Any]) -> None:
    assert result["bake"] == ["FINISHED"]
    assert "Radiosity" in result["uv_maps"]
    (page,) = result["pages"]
    assert page["brightest"] == pytest.approx(FLOOR_CENTRE, rel=0.01)


def test_command_line_bakes_the_file_given_before_it(desktop: Desktop) -> None:
    baked = desktop.folder / "command" / "baked.blend"
    baked.parent.mkdir()
    bake = ["radiosity", "bake", "-o", baked, "--page-size", "128", "--report", baked.with_suffix(".json")]
    done = desktop.run(desktop.folder / "scene.blend", "--command", *bake)
    assert done.returncode == 0, done.stdout + done.stderr
    assert baked.is_file()
    report = json.loads(baked.with_suffix(".json").read_text(encoding="utf-8"))
    assert [item["source"] for item in report["objects"]] == ["Floor"]


def test_command_line_says_that_a_missing_file_is_missing(desktop: Desktop) -> None:
    done = desktop.run(
        "--command", "radiosity", "bake", desktop.folder / "none.blend", "-o", desktop.folder / "x.blend"
    )
    assert done.returncode == 1
    assert "no such file" in done.stderr
    assert "Traceback" not in done.stderr
