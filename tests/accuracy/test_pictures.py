# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of errors: what is written is a PNG, and shows each error where it is, in its colour."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

from tests.accuracy.pictures import GAP, TRACE, color_of, picture_of_errors


def pixels(path: Path) -> np.ndarray:
    """(H, W, 3) of a PNG without filters."""
    data = path.read_bytes()
    assert data.startswith(b"\x89PNG\r\n\x1a\n")
    width, height = struct.unpack(">II", data[16:24])
    start = data.index(b"IDAT") + 4
    rows = np.frombuffer(zlib.decompress(data[start:-16]), np.uint8).reshape(height, 1 + 3 * width)
    return rows[:, 1:].reshape(height, width, 3)


def test_an_error_is_shown_in_its_colour_in_all_three_views(tmp_path: Path) -> None:
    position = np.array([[0.0, 0.0, 0.0], [2.0, 1.0, 0.5]])
    picture_of_errors(tmp_path / "errors.png", position, np.array([0.3, 0.0]))
    image = pixels(tmp_path / "errors.png")
    red = (image == color_of(0.3)).all(axis=2)
    columns = np.flatnonzero(red.any(axis=0))
    assert np.count_nonzero(np.diff(columns) > 1) == 2
    assert red[len(image) - 1 - GAP, GAP]


def test_colours_grow_with_the_error_and_tell_too_dark_from_too_bright() -> None:
    assert (color_of(0.0) == TRACE).all()
    assert (color_of(1.0) == color_of(0.1)).all()
    assert color_of(0.05)[0] > color_of(0.05)[2]
    assert color_of(-0.05)[0] < color_of(-0.05)[2]
