# SPDX-License-Identifier: GPL-3.0-or-later
"""A desktop Blender, run by a script."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


class Desktop:
    """A desktop Blender whose settings and extensions live in a folder of their own."""

    def __init__(self, script: Path, folder: Path) -> None:
        self.script = script
        self.folder = folder

    def environment(self) -> dict[str, str]:
        """Variables for the script."""
        return os.environ | {"BLENDER_USER_RESOURCES": str(self.folder / "user")}

    def run(self, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        """Run it without a window; never raises on a failing exit code."""
        return subprocess.run(
            [self.script, "run", *arguments],
            cwd=ROOT,
            env=self.environment(),
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
