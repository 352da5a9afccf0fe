# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages as OpenEXR files (the only place that talks to OpenImageIO)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Float32
from .errors import BakeError, OutputError
from .files import Transaction

HALF_MAX = float(np.finfo(np.float16).max)
"""65504, the largest number that an EXR of half floats holds."""


def write_exr(path: Path, pixels: Float32, files: Transaction) -> int:
    """Write one page: half floats, R G B, one part, full data window, lossless (ZIP).

    The page's row 0 (v = 0) becomes the file's last scanline, as images are stored from the top. The file is read
    back and compared before it replaces anything, because a library may report success on a full disk.

    Args:
        path: where the page goes; its folder exists
        pixels: (H, W, 3) float32, row 0 at v = 0
        files: the transaction that the file is part of

    Returns:
        Number of values that had to be clamped: not a number became 0, anything beyond 65504 became that

    Raises:
        OutputError: the file can't be written, or came back different
    """
    oiio = _openimageio()
    half, clamped = _as_half(pixels[::-1])
    temporary = files.begin(path)
    height, width, _ = half.shape
    spec = oiio.ImageSpec(width, height, 3, oiio.HALF)
    spec.channelnames = ("R", "G", "B")
    spec.attribute("compression", "zip")
    out = oiio.ImageOutput.create(str(temporary))
    if out is None:
        raise OutputError(
            str(path), f"OpenImageIO can't write it ({oiio.geterror()})", "Install OpenImageIO with OpenEXR"
        )
    written = out.open(str(temporary), spec) and out.write_image(half)
    closed = out.close()
    if not (written and closed and _same(oiio, temporary, half)):
        reason = out.geterror() or "the file did not come back as it was written; the disk may be full"
        raise OutputError(str(path), reason.strip().rstrip("."), "Free some space or choose another folder")
    files.place(path)
    return clamped


def _as_half(pixels: Float32) -> tuple[NDArray[np.float16], int]:
    sound = np.isfinite(pixels) & (np.abs(pixels) <= HALF_MAX)
    clamped = int(sound.size - np.count_nonzero(sound))
    if clamped:
        pixels = np.clip(np.nan_to_num(pixels, nan=0.0, posinf=HALF_MAX, neginf=-HALF_MAX), -HALF_MAX, HALF_MAX)
    return np.ascontiguousarray(pixels, np.float16), clamped


def _same(oiio: Any, path: Path, half: NDArray[np.float16]) -> bool:
    found = oiio.ImageInput.open(str(path))
    if found is None:
        return False
    pixels = found.read_image(oiio.HALF)
    found.close()
    return pixels is not None and pixels.shape == half.shape and bool(np.array_equal(pixels, half))


def _openimageio() -> Any:
    try:
        import OpenImageIO
    except ImportError as error:
        raise BakeError(
            "OpenImageIO",
            f"the library that writes EXR files did not load ({error})",
            "Install the zip made for this platform, or `pip install .` outside Blender",
        ) from error
    return OpenImageIO
