# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake says about itself: pages, objects, times, residual. The keys of the JSON file are stable."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ..color.spaces import REC709, RGBSpace
from ..files import Transaction, write_text
from ..gather.own_error import OwnError
from ..geometry.visibility import Tally
from ..pages.page_files import PageFiles
from ..radiosity.relaxation import Balance
from ..settings import BakeSettings
from ..stages import NO_RAYS
from .overview import Map, Overview

RESIDUALS = 200
"""Points of the residual's curve, at most: one-patch solvers take as many steps as shots."""


@dataclass(frozen=True)
class Page:
    """A lightmap image.

    Attributes:
        image: its name in the .blend
        file: where it lies; None if it is packed into the .blend
        size: width and height, texels
        maps: small pictures of its density and the like
    """

    image: str
    file: Path | None
    size: tuple[int, int]
    maps: Mapping[str, Map] = field(default_factory=dict)


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
        back_page: of a two-sided object, index of the page that holds its backs
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
    back_page: int | None = None


@dataclass(frozen=True)
class Stalls:
    """How alive a window was during a bake.

    Attributes:
        longest: by stage, seconds of the longest turn that the bake took before it gave the window back
        gap: seconds of the longest time between two turns, in which the window draws itself
        first_light: seconds from the click to the first picture of the light on the screen; None: there was none
    """

    longest: Mapping[str, float]
    gap: float = 0.0
    first_light: float | None = None

    @property
    def worst(self) -> tuple[str, float]:
        """The stage with the longest turn, and its seconds."""
        return max(self.longest.items(), key=lambda item: item[1], default=("", 0.0))


@dataclass(frozen=True)
class Report:
    """One bake.

    Attributes:
        skipped: (object, reason)
        stages: (name, seconds, rays)
        seconds: from reading the scene to files replaced
        texels: covered ones
        tracing: rays that Embree traced, by kind, and the processor time in it
        residual: unshot share of the emitted power
        working_space: the space that the light was baked in
        name: of the scene
        settings: the bake's
        residuals: the residual at the start and after every step
        error: of the light, by the bake's own account
        balance: where the light between patches has gone
        overview: the light in figures and maps, if it was looked at
        files: what the page files hold
        before, after: pictures of the scene
        light_groups: of each light group that has files of its own, by name, one for each page
        ended_in: the stage in which the bake was stopped by hand and kept; "" if it went to its end
        stalls: how long a window had to wait, where a bake ran in one
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
    tracing: Tally = NO_RAYS
    warnings: Sequence[str] = field(default_factory=tuple)
    name: str = ""
    working_space: RGBSpace = REC709
    settings: BakeSettings = field(default_factory=BakeSettings)
    residuals: Sequence[float] = ()
    error: OwnError | None = None
    balance: Balance | None = None
    overview: Overview | None = None
    files: PageFiles | None = None
    before: Path | None = None
    after: Path | None = None
    ended_in: str = ""
    stalls: Stalls | None = None
    light_groups: Mapping[str, Sequence[Path]] = field(default_factory=dict)

    def summary(self) -> str:
        """What was baked, in one line."""
        width, height = self.pages[0].size
        objects, pages = count_of(len(self.objects), "object"), count_of(len(self.pages), "page")
        stopped = f", stopped in stage {self.ended_in}" if self.ended_in else ""
        return f"Baked {objects} on {pages} of {width} x {height} in {self.seconds:.1f} s{stopped}"

    def as_json(self, folder: Path, home: Path | None = None) -> str:
        """The report as JSON, with paths relative to a folder.

        Args:
            home: where the report will lie; by default that folder
        """
        report = {
            "scene": self.name,
            "folder": _relative(folder, home or folder),
            "settings": {
                "quality": self.settings.quality,
                "solver": self.settings.solver,
                "tolerance": float(self.settings.tolerance),
                "page_size": int(self.settings.page_size),
                "density": self.settings.density,
            },
            "working_space": {
                "name": self.working_space.name,
                "rgb_to_xyz_d65": [[float(number) for number in row] for row in self.working_space.to_xyz],
            },
            "pages": [_page_as_dict(page, folder) for page in self.pages],
            "files": self._files_as_dict(),
            "light_groups": {
                name: [_relative(path, folder) for path in paths] for name, paths in self.light_groups.items()
            },
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
            "tracing": asdict(self.tracing),
            "ended_in": self.ended_in or None,
            "window": self._stalls_as_dict(),
            "residual": _finite(self.residual),
            "residuals": [_finite(residual) for residual in thinned(self.residuals)],
            "estimated_error": self._error_as_dict(),
            "balance": self._balance_as_dict(),
            "light": self.overview.light_as_dict() if self.overview else None,
            "renders": {"before": _relative(self.before, folder), "after": _relative(self.after, folder)},
            "warnings": list(self.warnings),
        }
        return json.dumps(report, indent=2, ensure_ascii=False, allow_nan=False) + "\n"

    def _stalls_as_dict(self) -> dict[str, Any] | None:
        if self.stalls is None:
            return None
        stage, seconds = self.stalls.worst
        return {
            "longest_stall_s": round(seconds, 4),
            "longest_stall_in": stage,
            "stalls_s": {name: round(longest, 4) for name, longest in self.stalls.longest.items()},
            "longest_gap_s": round(self.stalls.gap, 4),
            "first_light_s": None if self.stalls.first_light is None else round(self.stalls.first_light, 4),
        }

    def _files_as_dict(self) -> dict[str, Any] | None:
        if self.files is None:
            return None
        return {
            **self.files.recipe.as_dict(),
            "outside_before": float(self.files.outside),
            "outside_after": float(self.files.left_outside),
        }

    def _error_as_dict(self) -> dict[str, Any] | None:
        if self.error is None:
            return None
        return {name: _finite(value) if isinstance(value, float) else value for name, value in vars(self.error).items()}

    def _balance_as_dict(self) -> dict[str, Any] | None:
        """Watts of luminance: light groups added up, channels weighed as the eye does."""
        if self.balance is None:
            return None
        weights = self.working_space.luminance_weights
        names = ("emitted", "absorbed", "escaped", "unshot")
        return {name: float(getattr(self.balance, name).sum(axis=0) @ weights) for name in names}


def thinned(residuals: Sequence[float]) -> Sequence[float]:
    """At most RESIDUALS of them, the first and the last among them."""
    if len(residuals) <= RESIDUALS:
        return residuals
    return [residuals[round(index * (len(residuals) - 1) / (RESIDUALS - 1))] for index in range(RESIDUALS)]


def count_of(number: int, noun: str) -> str:
    """1 page, 2 pages."""
    return f"{number} {noun}{'s' * (number != 1)}"


def write_report(path: Path, report: Report, folder: Path, files: Transaction) -> None:
    """Write the report as JSON, as part of a transaction, with paths relative to a folder."""
    write_text(path, report.as_json(folder, path.parent), files)


def _page_as_dict(page: Page, folder: Path) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "image": page.image,
        "file": _relative(page.file, folder),
        "size": [int(edge) for edge in page.size],
    }
    if page.maps:
        entry["maps"] = {name: drawn.as_dict() for name, drawn in page.maps.items()}
    return entry


def _as_dict(baked: BakedObject) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "source": baked.source,
        "object": baked.object,
        "page": int(baked.page),
        "texels": int(baked.texels),
        "density": _finite(baked.density),
    }
    if baked.back_page is not None:
        entry["back_page"] = int(baked.back_page)
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
