# SPDX-License-Identifier: GPL-3.0-or-later
"""A desktop Blender, run by a script."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import dev

ROOT = Path(__file__).resolve().parents[2]


class Desktop:
    """A desktop Blender whose settings and extensions live in a folder of their own."""

    def __init__(self, script: Path, folder: Path) -> None:
        self.script = script
        self.folder = folder

    def environment(self) -> dict[str, str]:
        """Variables for the script."""
        return os.environ | {"BLENDER_USER_RESOURCES": str(self.folder / "user")}

    def install(self) -> Path:
        """Build the extension's zip with wheels for this Blender, install it, and bake a small scene; the zip."""
        command = [self.script, "wheels"]
        wheels = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
        assert dev.release(["linux-x64"], Path(wheels), self.folder) == 0
        (archive,) = self.folder.glob("*.zip")
        copied = shutil.copy(ROOT / "tests/blender/install_and_bake.py", self.folder)
        done = self.run("--background", "--python-exit-code", "1", "--python", copied, "--", archive, self.folder)
        assert done.returncode == 0, done.stdout + done.stderr
        return archive

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
