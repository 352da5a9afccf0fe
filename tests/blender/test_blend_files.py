# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender kept quiet, with a terminal and without."""

from __future__ import annotations

import os
import sys

import pytest

from radiosity_addon.blender.data.blend_files import silence


def test_what_is_printed_below_python_is_kept_off_the_output(capfd: pytest.CaptureFixture[str]) -> None:
    with silence():
        os.write(1, b"chatter")
    os.write(1, b"said")
    assert capfd.readouterr().out == "said"


def test_a_window_without_a_console_has_nothing_to_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows, where Blender may have no standard output at all."""

    def none(number: int) -> int:
        raise OSError(9, "Bad file descriptor")

    monkeypatch.setattr(os, "dup", none)
    monkeypatch.setattr(sys, "stdout", None)
    went = False
    with silence():
        went = True
    assert went
