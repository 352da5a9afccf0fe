# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake says about itself: pages, objects, times, residual. The keys of the JSON file are stable."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .files import Transaction, write_text


@dataclass(frozen=True)
class Page:
    """A lightmap image.

    Attributes:
        image: its name in the .blend
        file: where it lies; None if it is packed into the .blend
        size: width and height, texels
    """

    image: str
    file: Path | None
    size: tuple[int, int]


@dataclass(frozen=True)
class BakedObject:
    """A surface that got light.

    Attributes:
        source: name of the object
        object: name of the object that carries the uv map: the same, or its stand-in
        page: index into the pages
        texels: texels it covers
        density: texels per metre
        uv_scale, uv_offset: where its place differs from its mesh's uv map
        matrix: 4 x 4 world matrix of an instance
        instancer: of an instance, the object that makes it
        index: of an instance, which of the instancer's it is, a number for each level of instancing
    """

    source: str
    object: str
    page: int
    texels: int
    density: float
    uv_scale: tuple[float, float] | None = None
    uv_offset: tuple[float, float] | None = None
    matrix: Sequence[Sequence[float]] | None = None
    instancer: str | None = None
    index: Sequence[int] = ()


@dataclass(frozen=True)
class Report:
    """One bake.

    Attributes:
        skipped: (object, reason)
        stages: (name, seconds, rays)
        seconds: from reading the scene to files replaced
        texels: covered ones
        residual: unshot share of the emitted power
    """

    pages: Sequence[Page]
    objects: Sequence[BakedObject]
    skipped: Sequence[tuple[str, str]]
    stages: Sequence[tuple[str, float, int]]
    seconds: float
    texels: int
    patches: int
    rays: int
    residual: float
    warnings: Sequence[str] = field(default_factory=tuple)

    def summary(self) -> str:
        """What was baked, in one line."""
        width, height = self.pages[0].size
        objects, pages = count_of(len(self.objects), "object"), count_of(len(self.pages), "page")
        return f"Baked {objects} on {pages} of {width} x {height} in {self.seconds:.1f} s"

    def as_json(self, folder: Path) -> str:
        """The report as JSON, with paths relative to a folder."""
        report = {
            "pages": [
                {"image": page.image, "file": _relative(page.file, folder), "size": [int(edge) for edge in page.size]}
                for page in self.pages
            ],
            "objects": [_as_dict(baked) for baked in self.objects],
            "skipped": [{"object": name, "reason": reason} for name, reason in self.skipped],
            "stages": [
                {"name": name, "seconds": round(float(seconds), 4), "rays": int(rays)}
                for name, seconds, rays in self.stages
            ],
            "seconds": round(float(self.seconds), 4),
            "texels": int(self.texels),
            "patches": int(self.patches),
            "rays": int(self.rays),
            "residual": _finite(self.residual),
            "warnings": list(self.warnings),
        }
        return json.dumps(report, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def count_of(number: int, noun: str) -> str:
    """1 page, 2 pages."""
    return f"{number} {noun}{'s' * (number != 1)}"


def write_report(path: Path, report: Report, folder: Path, files: Transaction) -> None:
    """Write the report as JSON, as part of a transaction, with paths relative to a folder."""
    write_text(path, report.as_json(folder), files)


def _as_dict(baked: BakedObject) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "source": baked.source,
        "object": baked.object,
        "page": int(baked.page),
        "texels": int(baked.texels),
        "density": _finite(baked.density),
    }
    if baked.uv_scale is not None:
        entry["uv_scale"] = [float(x) for x in baked.uv_scale]
    if baked.uv_offset is not None:
        entry["uv_offset"] = [float(x) for x in baked.uv_offset]
    if baked.matrix is not None:
        entry["matrix"] = [[float(x) for x in row] for row in baked.matrix]
    if baked.instancer is not None:
        entry |= {"instancer": baked.instancer, "index": [int(x) for x in baked.index]}
    return entry


def _finite(number: float) -> float | None:
    """JSON has no word for what is not a number."""
    return float(number) if math.isfinite(number) else None


def _relative(path: Path | None, folder: Path) -> str | None:
    if path is None:
        return None
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive on Windows
        return path.as_posix()
