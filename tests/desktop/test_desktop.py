# SPDX-License-Identifier: GPL-3.0-or-later
"""The released zip in a real desktop Blender.

RADIOSITY_DESKTOP_BLENDER names a script with the verbs `wheels` (prints a folder of wheels for that Blender's Python)
and `run ARGUMENTS` (runs that Blender without a window). Without it, and without one at ../shared/desktop-blender,
these tests are skipped.

A Blender in a container of its own sees the temporary folder, but not always the checkout. So whatever it is handed is
copied into the test's temporary folder, and nothing is said relative to the working directory.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import dev

ROOT = Path(__file__).resolve().parents[2]
INSTALL_AND_BAKE = ROOT / "tests" / "blender" / "install_and_bake.py"
FLOOR_CENTRE = 2.33887
"""Lighting under a square lamp of 1 m and 100 W, 2 m above, as Cycles and the closed form have it, W/(m2 sr)."""

pytestmark = pytest.mark.desktop


class Desktop:
    """A desktop Blender whose settings and extensions live in a folder of their own."""

    def __init__(self, script: Path, folder: Path) -> None:
        self.script = script
        self.folder = folder

    def run(self, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        """Run it without a window; never raises on a failing exit code."""
        environment = os.environ | {"BLENDER_USER_RESOURCES": str(self.folder / "user")}
        command = [self.script, "run", *arguments]
        return subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300, check=False
        )


@pytest.fixture(scope="module")
def script() -> Path:
    """The script that runs a desktop Blender. One that is named but does not work fails the tests."""
    named = os.environ.get("RADIOSITY_DESKTOP_BLENDER")
    path = Path(named) if named else ROOT.parent / "shared" / "desktop-blender"
    if not named and not path.is_file():
        pytest.skip("no desktop Blender: RADIOSITY_DESKTOP_BLENDER is not set")
    ready = subprocess.run([path, "wheels"], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    if ready.returncode != 0 and not named:
        pytest.skip(f"no desktop Blender: {ready.stderr.strip()}")
    assert ready.returncode == 0, ready.stderr
    return path


@pytest.fixture(scope="module")
def desktop(script: Path, tmp_path_factory: pytest.TempPathFactory) -> Desktop:
    """A desktop Blender in which the released zip was installed and baked a small scene."""
    folder = tmp_path_factory.mktemp("desktop")
    wheels = subprocess.run([script, "wheels"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    assert dev.release(["linux-x64"], Path(wheels), folder) == 0
    (archive,) = folder.glob("*.zip")
    desktop = Desktop(script, folder)
    copied = shutil.copy(INSTALL_AND_BAKE, folder)
    done = desktop.run("--background", "--python-exit-code", "1", "--python", copied, "--", archive, folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return desktop


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
