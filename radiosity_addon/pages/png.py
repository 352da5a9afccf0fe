# SPDX-License-Identifier: GPL-3.0-or-later
"""PNG files by the standard library, deflated in parallel, with the colour space written down (PNG, third edition)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..chunks import finish, in_chunks

ROWS = 128
"""Rows deflated in one piece, whatever the number of threads; pieces of a page of 4096 texels are 1.5 MB and more."""
LEVEL = 3
"""zlib's effort: higher ones take several times as long for a few per cent."""
SIGNATURE = b"\x89PNG\r\n\x1a\n"
COLOR_TYPES = {1: 0, 3: 2, 4: 6}
"""PNG's number for grey, RGB and RGBA."""

Chunk = tuple[bytes, bytes]
"""Type and content of a chunk."""


def png_bytes(
    pixels: NDArray[np.uint8] | NDArray[np.uint16], chunks: Sequence[Chunk] = (), workers: int = 1
) -> list[bytes]:
    """The pieces of a PNG file.

    Args:
        pixels: (H, W, C), 1, 3 or 4 channels, the first row on top
        chunks: what goes between the header and the pixels, such as `srgb_chunks()`
    """
    height, width, channels = pixels.shape
    header = struct.pack(">IIBBBBB", width, height, 8 * pixels.itemsize, COLOR_TYPES[channels], 0, 0, 0)
    rows = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)

    def deflated(start: int, stop: int) -> tuple[bytes, int, int]:
        lines = np.empty((stop - start, rows.shape[1] + 1), np.uint8)
        lines[:, 0] = 2  # the filter "up": each row less the one above it
        above = rows[start - 1 : stop - 1] if start else np.vstack([np.zeros_like(rows[:1]), rows[: stop - 1]])
        np.subtract(rows[start:stop], above, out=lines[:, 1:])
        raw = lines.tobytes()
        squeeze = zlib.compressobj(LEVEL, wbits=-15)
        body = squeeze.compress(raw) + squeeze.flush(zlib.Z_FINISH if stop == height else zlib.Z_FULL_FLUSH)
        return body, zlib.adler32(raw), len(raw)

    pieces = finish(in_chunks(deflated, height, ROWS, workers))
    check = 1
    for _, own, length in pieces:
        check = _adler_of_both(check, own, length)
    data = [b"\x78\x01", *(piece for piece, _, _ in pieces), struct.pack(">I", check)]
    every = [(b"IHDR", header), *chunks, *((b"IDAT", part) for part in data), (b"IEND", b"")]
    return [SIGNATURE, *(_chunk(kind, content) for kind, content in every)]


def gray_pixels(file: bytes) -> NDArray[np.uint8]:
    """The pixels (H, W) of a grey file of 8 bits that `png_bytes` has made.

    Raises:
        ValueError: it is no such file
    """
    stream, found = memoryview(file)[len(SIGNATURE) :], {b"IDAT": b""}
    while len(stream) >= 12:
        length, kind = int.from_bytes(stream[:4], "big"), bytes(stream[4:8])
        found[kind] = found.get(kind, b"") + bytes(stream[8 : 8 + length])
        stream = stream[12 + length :]
    if file[: len(SIGNATURE)] != SIGNATURE or found.get(b"IHDR", b"")[8:10] != bytes([8, 0]):
        raise ValueError("no grey PNG file of 8 bits")
    width, height = struct.unpack(">II", found[b"IHDR"][:8])
    try:
        lines = np.frombuffer(zlib.decompress(found[b"IDAT"]), np.uint8).reshape(height, width + 1)
    except zlib.error as error:
        raise ValueError("a PNG file that is cut short") from error
    return np.cumsum(lines[:, 1:], axis=0, dtype=np.uint8)


def srgb_chunks(display_p3: bool = False) -> list[Chunk]:
    """What says that pixels are sRGB, or Display P3: sRGB and what old readers want in its place, or cICP (H.273)."""
    if display_p3:
        return [(b"cICP", bytes([12, 13, 0, 1])), *gamma_chunks(1 / 2.2, P3_CHROMATICITIES)]
    return [(b"sRGB", b"\x00"), *gamma_chunks(1 / 2.2, REC709_CHROMATICITIES)]


REC709_CHROMATICITIES = (0.3127, 0.3290, 0.64, 0.33, 0.30, 0.60, 0.15, 0.06)
P3_CHROMATICITIES = (0.3127, 0.3290, 0.680, 0.320, 0.265, 0.690, 0.150, 0.060)
"""x and y of white, red, green and blue."""


def gamma_chunks(exponent: float, chromaticities: Sequence[float]) -> list[Chunk]:
    """The exponent that pixels are encoded with, 1 for linear ones, and x, y of white, red, green and blue."""
    points = struct.pack(">8I", *(round(100000 * value) for value in chromaticities))
    return [(b"gAMA", struct.pack(">I", round(100000 * exponent))), (b"cHRM", points)]


def text_chunk(key: str, text: str) -> Chunk:
    """A remark in the file, Latin-1."""
    return b"tEXt", key.encode("latin-1") + b"\0" + text.encode("latin-1", "replace")


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(content, zlib.crc32(kind)))


def _adler_of_both(first: int, second: int, length: int) -> int:
    """Adler-32 of two runs of bytes after one another, the second of a length, from that of each (zlib's combine)."""
    base = 65521
    low_1, high_1, low_2, high_2 = first & 0xFFFF, first >> 16, second & 0xFFFF, second >> 16
    low = (low_1 + low_2 - 1) % base
    high = (high_1 + high_2 + length % base * (low_1 - 1)) % base
    return high << 16 | low
