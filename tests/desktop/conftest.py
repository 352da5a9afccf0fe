# SPDX-License-Identifier: GPL-3.0-or-later
"""The released zip, installed in a real desktop Blender.

RADIOSITY_DESKTOP_BLENDER names a script with these verbs:

    wheels              prints a folder of wheels for that Blender's Python
    run ARGUMENTS       runs that Blender without a window
    window ARGUMENTS    runs it in a window of 1600 x 1000 pixels, on the X screen that DESKTOP_BLENDER_DISPLAY names
    shot FILE.png       writes a picture of that screen
    xdo ARGUMENTS       runs xdotool there

Without it, and without one at ../shared/desktop-blender, these tests are skipped.

A Blender in a container of its own sees the temporary folder, but not always the checkout. So whatever it is handed is
copied into the test's temporary folder, and nothing is said relative to the working directory.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from tests.desktop.blender import ROOT, Desktop


@pytest.fixture(scope="session")
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


@pytest.fixture(scope="session")
def desktop(script: Path, tmp_path_factory: pytest.TempPathFactory) -> Desktop:
    """A desktop Blender in which the released zip was installed and baked a small scene."""
    desktop = Desktop(script, tmp_path_factory.mktemp("desktop"))
    desktop.install()
    return desktop
