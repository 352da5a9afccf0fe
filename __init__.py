# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender loads, beside the manifest. It imports late, since test runners import it too, as no package."""


def register() -> None:
    """Add the extension to Blender."""
    from .radiosity_addon import register

    register()


def unregister() -> None:
    """Take the extension out of Blender."""
    from .radiosity_addon import unregister

    unregister()
