# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of bakes' errors: three views along the axes, each probe a square, blue if too dark, red if too bright."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

SIDE = 360
"""Pixels of a view's longer side."""
GAP = 12
DOT = 3
"""Pixels from the middle of a probe's square to its edge."""
FULL = 0.1
"""Error, as a share of the mean reference, at which the colours are full."""
PAPER, TRACE = 250, 205
"""Grey of the background and of where probes are; a line of the latter parts the views."""
VIEWS = ((0, 1), (0, 2), (1, 2))
"""Axes to the right and up: from above, from the front, from the side."""


def picture_of_errors(path: Path, position: np.ndarray, error: np.ndarray) -> None:
    """Write a PNG of N probes.

    Args:
        position: (N, 3), m
        error: (N,), as shares of the mean reference
    """
    extent = np.ptp(position, axis=0)
    scale = (SIDE - 2 * GAP) / max(float(extent.max()), 1e-9)
    place = ((position - position.min(axis=0)) * scale).astype(int)
    size = (extent * scale).astype(int) + 2 * GAP + 1
    height = max(size[up] for _, up in VIEWS)
    image = np.full((height, sum(size[right] for right, _ in VIEWS), 3), PAPER, np.uint8)
    left = 0
    for right, up in VIEWS:
        image[:, left] = TRACE
        for probe in np.argsort(np.abs(error)):  # the worst on top
            x, y = left + GAP + place[probe, right], height - 1 - GAP - place[probe, up]
            image[max(y - DOT, 0) : y + DOT + 1, max(x - DOT, 0) : x + DOT + 1] = color_of(error[probe])
        left += size[right]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(png(image))


def color_of(error: float) -> np.ndarray:
    """(3,) uint8: grey without an error, full blue at -FULL, full red at FULL."""
    share = min(abs(error) / FULL, 1.0)
    full = np.array([200, 20, 20] if error > 0 else [20, 60, 200])
    return (TRACE * (1 - share) + full * share).astype(np.uint8)


def png(image: np.ndarray) -> bytes:
    """A PNG file of (H, W, 3) uint8, first row on top."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width = image.shape[:2]
    rows = np.concatenate([np.zeros((height, 1), np.uint8), image.reshape(height, -1)], axis=1)  # filter 0: none
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(rows.tobytes()))
        + chunk(b"IEND", b"")
    )
