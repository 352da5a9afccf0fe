# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes radiosity lightmaps. Blender is only imported once it asks for `register()`."""


def register() -> None:
    """Add the extension to Blender."""
    from . import blender

    blender.register()


def unregister() -> None:
    """Take the extension out of Blender."""
    from . import blender

    blender.unregister()
