# SPDX-License-Identifier: GPL-3.0-or-later
"""Go through docs/tutorial.md in a real window of a desktop Blender, and take its pictures.

    python3 dev.py bench tutorial_pictures -- SCRIPT

SCRIPT runs that Blender; tests/desktop/conftest.py says what it must understand. The room is built by the operators
behind the menus and keys that the tutorial names; what is ours is clicked with the mouse.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.desktop.blender import Desktop  # noqa: E402
from tests.desktop.window import Window, red  # noqa: E402

PICTURES = ROOT / "docs" / "pictures"
UNSEEN = 4.0
"""Seconds for which nobody looks at the screen once the button is pressed: looking takes a processor from the bake."""
FAR_ON = 5300
"""From which on it is far on its way."""
MOST_BYTES = 300_000
"""Of a picture."""
BITS = (0xFF, 0xFE, 0xFC, 0xF8)
"""Of each channel, that are kept; the lowest, which no eye tells, are given up for smaller files."""
ASIDE, BELOW = 400, 240
"""Pixels at the left and at the lower edge of the 3D view that show nothing but its grid."""
RED_CUBE = 5000
"""Pixels of it in sight, at least."""
WELL_ON = 3000
"""Pixels of progress bars from which on a bake is on its way."""


def main(script: Path, wanted: str) -> None:
    """Take all pictures of the tutorial, or the README's of a window."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        desktop = Desktop(script, folder)
        desktop.install()
        window = Window(desktop, folder, ROOT / "out" / "tutorial")
        try:
            if wanted == "tutorial":
                window.open("--factory-startup", "--addons", "bl_ext.user_default.radiosity_addon")
                take_all(window, folder)
            else:
                window.open(shutil.copy(ROOT / "sample_scenes/interior.blend", folder))
                take_window(window)
        finally:
            window.close()


def take_window(window: Window) -> None:
    """The interior while it is baked; and how long the window had to wait for that."""
    window.ask("look", "SOLID", True)
    window.click_button("bpy.ops.radiosity.bake(")
    time.sleep(UNSEEN)
    window.until(lambda: window.progress_bars() > FAR_ON, "the bake is far on its way")
    Image.fromarray(window.picture()).save(PICTURES / "blender_window.jpg", quality=90, subsampling=0)
    window.until(lambda: window.ask("state")["baked"], "the scene is baked")
    print(window.ask("state")["report"]["window"])


def take_all(window: Window, folder: Path) -> None:
    """Step by step, as the tutorial tells."""
    window.turn_to("")
    window.ask("tutorial", "build_room")
    keep(window, "room")
    for step in ("color_cube", "place_lamp", "select_lamp"):
        window.ask("tutorial", step)
    window.turn_to("Item")
    keep(window, "lamp")
    window.ask("save", str(folder / "room.blend"), False)
    window.turn_to("Radiosity")
    window.ask("tutorial", "deselect")
    window.click_button("bpy.ops.radiosity.bake(")
    window.until(lambda: window.progress_bars() > WELL_ON, "the bake is on its way")
    crop(window, "baking", window.picture())
    window.until(lambda: window.ask("state")["baked"], "the scene is baked")
    window.ask("look", "MATERIAL", False)
    window.until(lambda: red(window.picture()) > RED_CUBE, "the cube is seen")
    baked = keep(window, "baked")
    window.click_button("bpy.ops.radiosity.toggle(")
    original = keep(window, "original", unlike=baked)
    window.click_button("bpy.ops.radiosity.toggle(")
    window.view(unlike=original)
    window.click_button("bpy.ops.radiosity.overlay(show='illuminance'")
    keep(window, "illuminance", unlike=baked, below=0)  # where the legend is


def keep(window: Window, name: str, unlike: np.ndarray | None = None, below: int = BELOW) -> np.ndarray:
    """Keep a picture of the 3D view and its sidebar once nothing changes; the view."""
    view = window.view(unlike=unlike)
    crop(window, name, window.picture(), below)
    return view


def crop(window: Window, name: str, picture: np.ndarray, below: int = BELOW) -> None:
    """Keep what matters of a picture."""
    left, top, right, bottom = window.ask("place", "view")
    seen = picture[top : bottom - below, left + ASIDE : right]
    save(seen, PICTURES / f"tutorial_{name}.png")


def save(seen: np.ndarray, path: Path) -> None:
    """Write a picture, as exactly as its size allows."""
    for kept in BITS:
        Image.fromarray(seen & kept).save(path, optimize=True)
        if path.stat().st_size < MOST_BYTES:
            break
    print(f"{path.name}: {path.stat().st_size // 1024} KB")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Take pictures of a real window.")
    parser.add_argument("script", type=Path, help="runs a desktop Blender, as tests/desktop/conftest.py says")
    parser.add_argument("--only", choices=("tutorial", "readme"), default="tutorial", help="default: tutorial")
    arguments = parser.parse_args()
    main(arguments.script.resolve(), arguments.only)
