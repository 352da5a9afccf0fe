# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures and small maps of a bake, for its report: how bright, which colours, how dense, and what the files lost."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Float32, Float64, Int64
from ..color.difference import ciede2000
from ..color.spaces import RGBSpace, to_lab
from ..geometry.texels import Texels
from ..pages.image import read_image
from ..pages.page_files import PageFiles, finite, gamut_map, holds_all
from ..pages.page_format import PageFormat
from ..pages.png import png_bytes

MAP_EDGE = 192
"""Pixels along a map's edge, at most: maps are looked at, and a report with many pages stays small."""
STOP = 0.25
"""Width of a bin of the histogram, in stops."""
DARKEST, BRIGHTEST = -20.0, 20.0
"""Ends of the histogram, log2 of W/(m2 sr)."""
CHROMATICITY_EDGE = 160
CHROMATICITY_TOP = (0.8, 0.9)
"""The histogram of chromaticities: bins along an edge, and the x and y that it ends at; it starts at 0."""
COUNTED_SHARE = 2.0**-12
"""Texels darker than this share of the brightest have no colour to speak of, and no relative error."""
SAMPLES = 1 << 16
"""Texels whose colour difference is judged, evenly over all pages."""
BLOCK = 1 << 18


@dataclass(frozen=True, eq=False)
class Map:
    """A small picture of a quantity: 255 stands for `high`, 0 for `low`.

    Attributes:
        values: (h, w) uint8, row 0 at v = 0
        low, high: in `unit`
    """

    values: NDArray[np.uint8]
    low: float
    high: float
    unit: str

    def as_dict(self) -> dict[str, Any]:
        """For a JSON file: the picture as a data URI, its first row on top."""
        file = b"".join(png_bytes(np.ascontiguousarray(self.values[::-1, :, None])))
        return {"low": self.low, "high": self.high, "unit": self.unit, "png": data_uri(file)}


@dataclass(frozen=True, eq=False)
class Overview:
    """What a bake's report shows of its light.

    Attributes:
        maps: of each page: coverage, density, error of the file, share outside what the files can hold
        stops: texels by log2 of luminance, from `first_stop` on in steps of STOP
        chromaticities: texels by x and y
        difference: CIEDE2000 between file and bake, mean, 95th percentile and largest
        darkest, mean, brightest: luminance of texels, W/(m2 sr)
        mean_xyz: (3,), of all light
    """

    maps: tuple[dict[str, Map], ...]
    first_stop: float
    stops: tuple[int, ...]
    chromaticities: Map
    difference: tuple[float, float, float]
    darkest: float
    mean: float
    brightest: float
    mean_xyz: tuple[float, float, float]

    def light_as_dict(self) -> dict[str, Any]:
        """For a JSON file: all but the maps of pages."""
        mean, most, largest = self.difference
        return {
            "unit": "W/(m2 sr)",
            "darkest": self.darkest,
            "mean": self.mean,
            "brightest": self.brightest,
            "mean_xyz": list(self.mean_xyz),
            "stops": {"first": self.first_stop, "step": STOP, "texels": list(self.stops)},
            "chromaticities": {**self.chromaticities.as_dict(), "x": CHROMATICITY_TOP[0], "y": CHROMATICITY_TOP[1]},
            "difference": {"name": "CIEDE2000", "mean": mean, "percentile_95": most, "largest": largest},
        }


def data_uri(file: bytes) -> str:
    """A PNG file as an address that holds it."""
    return "data:image/png;base64," + base64.b64encode(file).decode("ascii")


def overview(
    pages: Sequence[Float32],
    texels: Texels,
    paths: Sequence[Path],
    written: PageFiles,
    wanted: PageFormat,
    working: RGBSpace,
    workers: int = 1,
) -> Overview:
    """Look at a bake and read its files again.

    Args:
        pages: (S, S, 3) float32, W/(m2 sr), as baked
        texels: those of the pages; further ones are on hidden pages
        paths: the files of the pages
        written: what was written into them, in the format `wanted`
        working: the space of the pages
    """
    size = texels.size
    mapping = gamut_map(wanted, working)
    brightest = max(float(page.max(initial=0)) for page in pages)
    light, maps, pairs = _Light(working, brightest), [], []
    for index, (page, path) in enumerate(zip(pages, paths, strict=True)):
        start, stop = texels.before(index * size**2), texels.before((index + 1) * size**2)
        mine = texels.pixel[start:stop].astype(np.int64) - index * size**2
        page = finite(page)[0]
        light.add(page.reshape(-1, 3), mine)
        stored = written.recipe.decode(read_image(path))
        outside = np.zeros(page.shape[:2], bool) if holds_all(wanted, working) else mapping.outside(page, workers)
        matrix = working.to(mapping.target).T.astype(np.float32)
        same = np.array_equal(matrix, np.eye(3))
        ideal = page if same else (page.reshape(-1, 3) @ matrix).reshape(page.shape)
        maps.append(_maps(ideal, stored, outside, texels.area[start:stop], texels.covered[start:stop], mine))
        some = mine[:: max(1, len(texels.pixel) // SAMPLES)]
        pairs.append((page.reshape(-1, 3)[some], stored.reshape(-1, 3)[some]))
    return Overview(
        maps=tuple(maps),
        first_stop=DARKEST,
        stops=tuple(int(count) for count in light.stops),
        chromaticities=_logarithmic(light.chromaticities),
        difference=_difference(pairs, working, written.recipe.space, light.brightest),
        darkest=light.darkest,
        mean=light.total / max(light.count, 1),
        brightest=light.brightest,
        mean_xyz=light.mean_xyz,
    )


class _Light:
    """Sums and histograms over covered texels."""

    def __init__(self, space: RGBSpace, brightest: float) -> None:
        self.matrix = space.to_xyz.astype(np.float32)
        self.floor = brightest * COUNTED_SHARE
        self.stops: Int64 = np.zeros(round((BRIGHTEST - DARKEST) / STOP), np.int64)
        self.chromaticities: Int64 = np.zeros(CHROMATICITY_EDGE**2, np.int64)
        self.count, self.total = 0, 0.0
        self.darkest, self.brightest = np.inf, 0.0
        self.xyz: Float64 = np.zeros(3)

    @property
    def mean_xyz(self) -> tuple[float, float, float]:
        x, y, z = (float(total) / max(self.count, 1) for total in self.xyz)
        return x, y, z

    def add(self, flat: Float32, chosen: Int64) -> None:
        for start in range(0, len(chosen), BLOCK):
            xyz = flat[chosen[start : start + BLOCK]] @ self.matrix.T
            y = xyz[:, 1]
            self.count += len(y)
            self.total += float(y.sum(dtype=np.float64))
            self.xyz += xyz.sum(axis=0, dtype=np.float64)
            self.darkest = min(self.darkest, float(y.min(initial=np.inf)))
            self.brightest = max(self.brightest, float(y.max(initial=0)))
            lit = y[y > 0]
            place = np.clip((np.log2(lit) - DARKEST) / STOP, 0, len(self.stops) - 1).astype(np.int64)
            self.stops += np.bincount(place, minlength=len(self.stops))
            seen = xyz[y > self.floor]
            share = seen[:, :2] / np.maximum(seen.sum(axis=1, keepdims=True), 1e-12)
            cell = np.clip(share / np.array(CHROMATICITY_TOP) * CHROMATICITY_EDGE, 0, CHROMATICITY_EDGE - 1)
            column, row = cell.astype(np.int64).T
            self.chromaticities += np.bincount(row * CHROMATICITY_EDGE + column, minlength=CHROMATICITY_EDGE**2)


def _maps(
    ideal: Float32, stored: Float32, outside: Bools, area: Float32, covered: NDArray[np.uint8], mine: Int64
) -> dict[str, Map]:
    """Of one page: its light as baked and as stored, both (S, S, 3) in the space of the files."""
    size = len(ideal)
    whole = covered == 15  # texels at the edge of a chart have a part of its area alone
    there = np.bincount(mine, minlength=size**2).reshape(size, size)
    dense = np.bincount(mine[whole], 1 / np.sqrt(np.maximum(area[whole], 1e-12)), minlength=size**2)
    counted = np.bincount(mine[whole], minlength=size**2)
    shares = _shrunk(there, np.sum) / _shrunk(np.ones_like(there), np.sum)
    density = _shrunk(dense.reshape(size, size), np.sum) / np.maximum(_shrunk(counted.reshape(size, size), np.sum), 1)
    largest = np.maximum(np.abs(ideal).max(axis=-1), COUNTED_SHARE * max(float(ideal.max(initial=0)), 1e-12))
    error = np.where(there > 0, np.abs(stored - ideal).max(axis=-1) / largest, 0)
    return {
        "coverage": _map(shares, 0.0, 1.0, "share"),
        "density": _map(density, 0.0, _high(density), "texels/m"),
        "error": _map(_shrunk(error, np.max), 0.0, _high(error), "share of a colour's largest channel"),
        "outside": _map(_shrunk(outside & (there > 0), np.mean), 0.0, 1.0, "share"),
    }


def _high(values: NDArray[Any]) -> float:
    return float(values.max(initial=0)) or 1.0


def _map(values: Float64, low: float, high: float, unit: str) -> Map:
    scaled = np.clip((values - low) / (high - low), 0, 1) * 255
    return Map(np.ceil(scaled).astype(np.uint8), low, high, unit)  # what is there at all shall be seen


def _logarithmic(counts: Int64) -> Map:
    """Rare colours shall be seen beside common ones."""
    square = np.log1p(counts.reshape(CHROMATICITY_EDGE, CHROMATICITY_EDGE))
    return _map(square, 0.0, _high(square), "log(1 + texels)")


def _shrunk(values: NDArray[Any], over: Any) -> Float64:
    """(h, w), each pixel the sum, mean or maximum `over` a square of texels."""
    step = -(-len(values) // MAP_EDGE)
    padded = np.pad(values, [(0, -edge % step) for edge in values.shape])
    height, width = padded.shape
    reduced: Float64 = over(padded.reshape(height // step, step, width // step, step), axis=(1, 3))
    return reduced


def _difference(
    pairs: Sequence[tuple[Float32, Float32]], working: RGBSpace, of_files: RGBSpace, white: float
) -> tuple[float, float, float]:
    """Mean, 95th percentile and largest, where the brightest luminance of the bake is white."""
    before, after = (np.concatenate(side).astype(np.float64) for side in zip(*pairs, strict=True))
    if not len(before) or white <= 0:
        return 0.0, 0.0, 0.0
    found = ciede2000(to_lab(before @ working.to_xyz.T / white), to_lab(after @ of_files.to_xyz.T / white))
    return float(found.mean()), float(np.percentile(found, 95)), float(found.max())
