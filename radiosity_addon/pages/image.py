# SPDX-License-Identifier: GPL-3.0-or-later
"""OpenEXR and Radiance files, and images read back (the only place that talks to OpenImageIO)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Float32
from ..chunks import finish, in_chunks
from ..color.spaces import D65, RGBSpace
from ..errors import BakeError, OutputError
from ..files import Transaction
from .encodings import RGBE_MAX, rounded_to_rgbe

HALF_MAX = float(np.finfo(np.float16).max)
"""65504, the largest number that an EXR of half floats holds."""
FLOAT_MAX = float(np.finfo(np.float32).max)
ROWS = 32
"""Rows of a page looked at in one go, so that what is computed on the way stays in cache."""


def write_exr(
    path: Path,
    pixels: Float32,
    files: Transaction,
    *,
    depth: str = "half",
    compression: str = "zip",
    space: RGBSpace | None = None,
) -> int:
    """Write one page: R G B, one part, full data window, lossless, with the chromaticities of its space.

    The page's row 0 (v = 0) becomes the file's last scanline, as images are stored from the top. The file is read
    back and compared before it replaces anything, because a library may report success on a full disk.

    Args:
        path: where the page goes; its folder exists
        pixels: (H, W, 3) float32, row 0 at v = 0
        files: the transaction that the file is part of
        depth: half or float
        compression: none, rle, zips, zip or piz
        space: what the numbers mean

    Returns:
        Number of values that had to be clamped: not a number became 0, anything beyond the largest number became that

    Raises:
        OutputError: the file can't be written, or came back different
    """
    limit, kind = (HALF_MAX, np.float16) if depth == "half" else (FLOAT_MAX, np.float32)
    held, clamped = _held(pixels[::-1], -limit, limit)
    stored = np.ascontiguousarray(held, kind)
    attributes: dict[str, Any] = {"compression": compression}
    if space is not None:
        points = (*space.primaries.ravel(), *D65)
        attributes["chromaticities"] = ("float[8]", tuple(float(number) for number in points))
    _write(path, stored, attributes, files)
    return clamped


def write_hdr(path: Path, pixels: Float32, files: Transaction, workers: int = 1) -> int:
    """Write one page as a Radiance file; otherwise as `write_exr`, but what is negative is clamped to 0 too.

    Radiance's header could name the primaries, but OpenImageIO does not write it: the sidecar does.
    """
    held, clamped = _held(pixels[::-1], 0.0, RGBE_MAX)
    rows = finish(in_chunks(lambda start, stop: rounded_to_rgbe(held[start:stop]), len(held), ROWS, workers))
    _write(path, np.concatenate(rows), {}, files)
    return clamped


def read_image(path: Path) -> NDArray[Any]:
    """The numbers of an image file as they are stored, (H, W, C), row 0 at v = 0.

    Raises:
        OutputError: it can't be read
    """
    oiio = _openimageio()
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)  # alpha is a number like the others
    found = oiio.ImageInput.open(str(path), config)
    pixels = None if found is None else found.read_image(found.spec().format)
    if pixels is None:
        reason = oiio.geterror() or "it can't be read"
        raise OutputError(str(path), reason.strip().rstrip("."), "Bake again")
    return np.asarray(pixels)[::-1]


def _held(pixels: Float32, low: float, high: float) -> tuple[Float32, int]:
    sound = sum(np.count_nonzero((rows >= low) & (rows <= high)) for rows in _blocks(pixels))
    clamped = pixels.size - int(sound)
    if clamped:
        pixels = np.clip(np.nan_to_num(pixels, nan=0.0, posinf=high, neginf=low), low, high).astype(np.float32)
    return pixels, clamped


def _write(path: Path, pixels: NDArray[Any], attributes: dict[str, Any], files: Transaction) -> None:
    oiio = _openimageio()
    temporary = files.begin(path)
    height, width, _ = pixels.shape
    kind = oiio.HALF if pixels.dtype == np.float16 else oiio.FLOAT
    spec = oiio.ImageSpec(width, height, 3, kind)
    spec.channelnames = ("R", "G", "B")
    for name, value in attributes.items():
        if isinstance(value, tuple):
            spec.attribute(name, oiio.TypeDesc(value[0]), value[1])
        else:
            spec.attribute(name, value)
    out = oiio.ImageOutput.create(str(temporary))
    if out is None:
        raise OutputError(
            str(path), f"OpenImageIO can't write it ({oiio.geterror()})", "Install OpenImageIO with this format"
        )
    written = out.open(str(temporary), spec) and out.write_image(pixels)
    closed = out.close()
    if not (written and closed and _same(oiio, temporary, pixels)):
        reason = out.geterror() or "the file did not come back as it was written; the disk may be full"
        raise OutputError(str(path), reason.strip().rstrip("."), "Free some space or choose another folder")
    files.place(path)


def _same(oiio: Any, path: Path, pixels: NDArray[Any]) -> bool:
    """Whether a file holds these pixels: the same bits, of Radiance's 8 bits a colour the same steps."""
    found = oiio.ImageInput.open(str(path))
    if found is None:
        return False
    back = found.read_image(found.spec().format)
    found.close()
    if back is None or back.shape != pixels.shape:
        return False
    step = 1 / 256 if path.suffix == ".hdr" else 0.0
    return all(_alike(one, other, step) for one, other in zip(_blocks(back), _blocks(pixels), strict=True))


def _alike(back: NDArray[Any], pixels: NDArray[Any], step: float) -> bool:
    """Whether colours are the same, to a step of their largest channel."""
    if not step:
        return bool(np.array_equal(back, pixels))
    largest = np.maximum(np.maximum(pixels[..., 0], pixels[..., 1]), pixels[..., 2])
    return bool((np.abs(back - pixels) <= step * largest[..., None]).all())


def _blocks(pixels: NDArray[Any]) -> Iterator[NDArray[Any]]:
    return (pixels[start : start + ROWS] for start in range(0, len(pixels), ROWS))


def _openimageio() -> Any:
    try:
        import OpenImageIO
    except ImportError as error:
        raise BakeError(
            "OpenImageIO",
            f"the library that reads and writes images did not load ({error})",
            "Install the zip made for this platform, or `pip install .` outside Blender",
        ) from error
    return OpenImageIO
