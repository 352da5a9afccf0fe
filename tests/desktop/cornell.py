# SPDX-License-Identifier: GPL-3.0-or-later
"""The Cornell box in a real window: what the tests that go through one have in common."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.desktop.blender import ROOT
from tests.desktop.window import Window, red

PICTURES = Path(os.environ.get("RADIOSITY_WINDOW_PICTURES", ROOT / "out/desktop"))
LONG_BAKE = {"page_size": 1024, "quality": "high"}
SHORT_BAKE = {"page_size": 256, "quality": "draft"}
RED_WALL = 10000
"""Pixels of it in sight, at least."""

MARKS = [
    pytest.mark.desktop,
    pytest.mark.skipif(sys.version_info < (3, 13), reason="the same Blender is driven once, under Python 3.13"),
]


def copied(folder: Path) -> Path:
    """The Cornell box, in a folder of its own."""
    return Path(shutil.copy(ROOT / "sample_scenes/cornell_box.blend", folder))


def unbaked(window: Window, name: str) -> np.ndarray:
    """What the 3D view shows before any bake, kept as a picture of that name."""
    seen: list[np.ndarray] = []

    def red_and_still() -> bool:
        seen.append(window.view(name))  # also stands still while shaders are compiled, all of it grey
        return red(seen[-1]) > RED_WALL

    window.until(red_and_still, "the red wall is seen")
    return seen[-1]
