# SPDX-License-Identifier: GPL-3.0-or-later
"""All that talks to Blender: reads scenes, brings light back, and the extension's settings, operators and panels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import bpy

_command: Any = None
"""What Blender gave us for our `--command`, while the extension is registered."""


def register() -> None:
    """Add settings, operators, panels and the command `blender --command radiosity`."""
    global _command
    from . import export_panel, operators, panels, properties

    properties.register()
    operators.register()
    panels.register()
    export_panel.register()
    _command = bpy.utils.register_cli_command("radiosity", run_command)


def unregister() -> None:
    """Take all of it away again."""
    global _command
    from . import export_panel, operators, panels, properties

    bpy.utils.unregister_cli_command(_command)
    _command = None
    export_panel.unregister()
    panels.unregister()
    operators.unregister()
    properties.unregister()


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
