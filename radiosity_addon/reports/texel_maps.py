# SPDX-License-Identifier: GPL-3.0-or-later
"""What each texel of a page was to the bake, unused, invalid or part of a patch: small enough to stay with the page."""

from __future__ import annotations

import zlib

import numpy as np

from ..arrays import Int32
from ..errors import OutputError
from ..geometry.texels import Texels

UNUSED, INVALID, UNPATCHED, PATCHED = 0, 1, 2, 3
"""Texels of no chart; inside other geometry, filled from their neighbours; clear ones, which stop no light; from here
on the number of a patch is added."""

ROWS = 256
"""Rows packed in one go: 1 MB at 1024 texels."""


def texel_map(texels: Texels, patch: Int32, page: int) -> Int32:
    """One page's map (S, S), row 0 at v = 0.

    Args:
        patch: (T,) patch of each texel, negative for none
    """
    size = texels.size
    mine = slice(texels.before(page * size**2), texels.before((page + 1) * size**2))
    kind = np.where(patch[mine] >= 0, patch[mine] + PATCHED, UNPATCHED)
    result: Int32 = np.zeros(size * size, np.int32)
    result[texels.pixel[mine] - page * size**2] = np.where(texels.valid[mine], kind, INVALID)
    return result.reshape(size, size)


def packed(numbers: Int32) -> bytes:
    """A square map in few bytes: what changes along rows, deflated."""
    press = zlib.compressobj(level=1)
    parts = []
    for start in range(0, len(numbers), ROWS):
        rows = numbers[start : start + ROWS].astype("<i4")
        rows[:, 1:] -= rows[:, :-1].copy()
        parts.append(press.compress(rows.tobytes()))
    return b"".join([*parts, press.flush()])


def unpacked(data: bytes) -> Int32:
    """The inverse of `packed`.

    Raises:
        OutputError: these bytes are none of ours
    """
    try:
        flat = np.frombuffer(zlib.decompress(data), "<i4")
        size = round(len(flat) ** 0.5)
        numbers: Int32 = np.cumsum(flat.reshape(size, size), axis=1, dtype=np.int32)
    except (zlib.error, ValueError) as error:
        raise OutputError("Page", "what was kept of its texels can't be read", "Bake again") from error
    return numbers


def patch_count(maps: list[Int32]) -> int:
    """Different patches on pages; those without a texel on any of them are not counted."""
    found = [np.unique(numbers) for numbers in maps]
    every = np.unique(np.concatenate([np.zeros(0, np.int32), *found]))
    return int(np.count_nonzero(every >= PATCHED))
