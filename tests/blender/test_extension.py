# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension as Blender installs it: packed from the root, installed into settings of its own, used, removed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

import dev

ROOT = Path(__file__).resolve().parents[2]
FLOOR_CENTRE = 2.33887
"""Lighting under a square lamp of 1 m and 100 W, 2 m above, as Cycles and the closed form have it, W/(m2 sr)."""


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The zip that the root builds, without wheels."""
    target = tmp_path_factory.mktemp("extension") / "radiosity_addon.zip"
    tool = dev.extension_tool(Path(sys.executable))
    command = [sys.executable, tool, "build", "--source-dir", ROOT, "--output-filepath", target]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    return target


@pytest.fixture(scope="module")
def installed(archive: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a Blender of its own says after installing, baking and removing."""
    folder = tmp_path_factory.mktemp("installed")
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(folder / "user")}
    command = [sys.executable, Path(__file__).with_name("install_and_bake.py"), archive, folder]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return result


def test_manifest_validates() -> None:
    tool = dev.extension_tool(Path(sys.executable))
    done = subprocess.run([sys.executable, tool, "validate", ROOT], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr


def test_zip_holds_what_a_release_stages_and_nothing_else(archive: Path) -> None:
    staged = {name for name in dev.STAGED if (ROOT / name).is_file()}
    folders = [ROOT / name for name in dev.STAGED if (ROOT / name).is_dir()]
    package = [path for kind in ("*.py", "*.css", "*.md") for folder in folders for path in folder.rglob(kind)]
    sources = {path.relative_to(ROOT).as_posix() for path in package}
    with zipfile.ZipFile(archive) as content:
        assert {name for name in content.namelist() if not name.endswith("/")} == staged | sources


def test_extension_is_enabled_by_installing(installed: dict[str, Any]) -> None:
    assert installed["enabled"]


def test_operators_come_and_go_with_the_extension(installed: dict[str, Any]) -> None:
    assert installed["operators"] == ["bake", "revert"]
    assert installed["operators_after_disabling"] == []


def test_installed_extension_bakes_the_light_of_a_lamp(installed: dict[str, Any]) -> None:
    assert installed["bake"] == ["FINISHED"]
    assert "Radiosity" in installed["uv_maps"]
    (page,) = installed["pages"]
    assert page["brightest"] == pytest.approx(FLOOR_CENTRE, rel=0.01)
