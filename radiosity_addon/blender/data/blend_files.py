# SPDX-License-Identifier: GPL-3.0-or-later
""".blend files opened and saved so that what went wrong is known, and Blender's own chatter kept off the terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

from ...errors import OutputError, SceneError
from ...files import Transaction

COMPRESSED = (b"\x1f\x8b", b"\x28\xb5\x2f\xfd")
"""How gzip and zstd files begin."""


def open_blend(path: Path) -> None:
    """Open a .blend file in place of the current one.

    Raises:
        SceneError: it can't be read
    """
    try:
        with silence():
            bpy.ops.wm.open_mainfile(filepath=str(path))
    except RuntimeError as error:
        raise SceneError(
            str(path), f"Blender can't read it ({_reason(error)})", "Give a .blend file that it can"
        ) from error


def save_blend(path: Path, files: Transaction) -> None:
    """Save a copy of the open file under a temporary name, and open it to see that it is whole.

    The copy is what is open afterwards; `files.place(path)` gives it its name. Paths relative to the open file are
    made relative to the copy. Blender may report success on a full disk; a file cut short lacks its last block, and
    can't be opened.

    Raises:
        OutputError: it can't be written, or came back broken
    """
    temporary = files.begin(path)
    source = Path(bpy.data.filepath)
    compress = source.is_file() and _is_compressed(source)
    try:
        with silence():
            bpy.ops.wm.save_as_mainfile(
                filepath=str(temporary), copy=True, compress=compress, relative_remap=True, check_existing=False
            )
            bpy.ops.wm.open_mainfile(filepath=str(temporary))
    except RuntimeError as error:
        raise OutputError(
            str(path), f"it was not saved ({_reason(error)})", "Free some space or choose another folder"
        ) from error


def said_of_open() -> list[str]:
    """What there is to say of the open file before it is saved: Blender drops in silence what it doesn't know."""
    wrote, reads = (".".join(map(str, each[:2])) for each in (bpy.data.version, bpy.app.version))
    if bpy.data.version[:2] <= bpy.app.version[:2]:
        return []
    return [
        f"{bpy.data.filepath} was written by Blender {wrote}: what Blender {reads} doesn't know is lost in the result"
    ]


def _is_compressed(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(4).startswith(COMPRESSED)


def _reason(error: RuntimeError) -> str:
    return str(error).strip().removeprefix("Error: ").rstrip(".")


@contextmanager
def silence() -> Iterator[None]:
    """Keep what Blender itself prints off the standard output, which Python code can't stop otherwise."""
    try:
        kept = os.dup(1)
    except OSError:  # there is none, as for a window without a console on Windows
        yield
        return
    _flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    try:
        yield
    finally:
        _flush()
        os.dup2(kept, 1)
        os.close(kept)


def _flush() -> None:
    if sys.stdout is not None:
        sys.stdout.flush()
