# SPDX-License-Identifier: GPL-3.0-or-later
"""The Cornell box in a file whose working space is ACEScg, its colours converted; only Blender 5 can make it."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "sample_scenes"))
import bpy
import cornell_box
from building import write_when_run


def build() -> object:
    """Make the scene in Blender."""
    scene = cornell_box.build()
    bpy.ops.wm.set_working_color_space(working_space="ACEScg", convert_colors=True)
    return scene


if __name__ == "__main__":
    write_when_run(build, __file__)
