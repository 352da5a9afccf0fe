# SPDX-License-Identifier: GPL-3.0-or-later
"""How a run of the tests ends."""

from __future__ import annotations

import os
import sys

import pytest

status = pytest.StashKey[int]()


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    session.config.stash[status] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """Leave at once, where Blender was imported.

    The module bpy 4.5 ends its threads when it is freed. Where anything still refers to it when Python ends, it never
    is, and the destructors of its library then wait for a thread that nobody ends.
    """
    if "bpy" in sys.modules and status in config.stash:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(config.stash[status])
