# SPDX-License-Identifier: GPL-3.0-or-later
"""All that talks to Blender: reads scenes, brings light back, and the extension's settings, operators and panels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import bpy

_command: Any = None
"""What Blender gave us for our `--command`, while the extension is registered."""


def _parts() -> tuple[ModuleType, ...]:
    """All that has classes of its own, what others show before what shows them."""
    from .interface import (
        after_bake,
        export_panel,
        light_mix_panel,
        manual,
        object_settings,
        operators,
        panels,
        presets,
        properties,
        scene_check,
    )
    from .judging import light_meter, overlay_panel

    operating = (properties, object_settings, operators, scene_check, after_bake, presets, light_meter)
    return (*operating, panels, light_mix_panel, overlay_panel, export_panel, manual)


def register() -> None:
    """Add settings, operators, panels and the command `blender --command radiosity`."""
    global _command
    for part in _parts():
        part.register()
    _command = bpy.utils.register_cli_command("radiosity", run_command)


def unregister() -> None:
    """Take all of it away again."""
    global _command
    bpy.utils.unregister_cli_command(_command)
    _command = None
    for part in reversed(_parts()):
        part.unregister()


@contextmanager
def registered() -> Iterator[None]:
    """Within, the extension is registered; afterwards it is if it was before. Blender may not end well otherwise."""
    if _command is not None:
        yield
        return
    register()
    try:
        yield
    finally:
        unregister()


def run_command(arguments: Sequence[str]) -> int:
    """Run `blender [FILE.blend] --command radiosity ...`; the exit code."""
    from ..cli import main

    return main(arguments, opened=bpy.data.filepath)
