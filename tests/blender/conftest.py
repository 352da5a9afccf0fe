# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that need bpy: registered once a session, every test starts from an empty factory file."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterator
from pathlib import Path

import pytest

HAS_BPY = importlib.util.find_spec("bpy") is not None


class WithoutBpy(pytest.Module):
    """A test file that can't be imported here: one skip with the reason, in place of an import error."""

    def collect(self) -> list[pytest.Item | pytest.Collector]:
        pytest.skip("bpy is not installed")


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module | None:
    return None if HAS_BPY else WithoutBpy.from_parent(parent, path=module_path)


@pytest.fixture(scope="session")
def registered() -> Iterator[None]:
    """The extension's classes, registered once: Blender 4.2 and 4.5 fail at exit when they are left behind."""
    extension = importlib.import_module("radiosity_addon.blender")
    if not hasattr(extension, "register"):
        yield
        return
    extension.register()
    yield
    extension.unregister()


@pytest.fixture(autouse=True)
def empty_file(registered: None) -> None:
    """An empty file with factory settings."""
    import bpy

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
