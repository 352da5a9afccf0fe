# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes to spoil, and bakes of them from the command line."""

from __future__ import annotations

import hashlib
from pathlib import Path

import bpy
import pytest

from radiosity_addon import cli

FAST = ["--page-size", "64", "--quality", "draft"]


SQUARE = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]


SUN = 3.0
"""W/m2, straight down: an open floor holds SUN / pi."""


def add_mesh(name: str, vertices: list | None = None, faces: list | None = None, **values: object) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(SQUARE if vertices is None else vertices, [], [(0, 1, 2, 3)] if faces is None else faces)
    thing = bpy.data.objects.new(name, mesh)
    for key, value in values.items():
        setattr(thing, key, value)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add_lamp(kind: str = "SUN", name: str = "Sun", energy: float = SUN, **values: object) -> bpy.types.Object:
    lamp = bpy.data.lights.new(name, kind)
    lamp.energy = energy
    for key, value in values.items():
        setattr(lamp, key, value)
    thing = bpy.data.objects.new(name, lamp)
    thing.location = (0, 0, 2)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def save(folder: Path) -> Path:
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "in.blend"))
    return folder / "in.blend"


def tree(folder: Path) -> dict[str, str]:
    """All files below a folder, hidden ones too, and what is in them."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "folder"
        for path in folder.rglob("*")
    }


def bake(scene: Path, output: Path, *words: object) -> int:
    return cli.main(["bake", str(scene), "-o", str(output), *FAST, *(str(word) for word in words)])


Captured = pytest.CaptureFixture[str]


def spoken(capsys: Captured, kind: str) -> list[str]:
    """Our lines of a kind, `error` or `warning`; and no traceback."""
    lines = capsys.readouterr().err.splitlines()
    assert not [line for line in lines if "Traceback" in line], lines
    start = f"radiosity: {kind}: "
    return [line.removeprefix(start) for line in lines if line.startswith(start)]


def refused(scene: Path, output: Path, capsys: Captured, *words: object) -> str:
    """The one line of a bake that fails, and leaves all files below the scene's folder as they were."""
    before = tree(scene.parent)
    capsys.readouterr()
    assert bake(scene, output, *words) == 1
    (line,) = spoken(capsys, "error")
    assert tree(scene.parent) == before
    return line


# files
