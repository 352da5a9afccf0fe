# SPDX-License-Identifier: GPL-3.0-or-later
"""What the last bake of a scene had to say, kept on the scene itself: saved with it, undone and reverted with the bake.

How long it took tells, too, how long the next one will: for the same scene best of all, else for this machine.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

import bpy

from ..errors import SceneError
from ..estimate import Pace
from ..reports.report import Report
from ..reports.report_page import write_report_page
from ..stages import STAGES, shares_of
from .data.names import BAKE_KEY, PAGE_KEY, REPORT_KEY, page_images

EXTENSION = __package__.rpartition(".")[0].rpartition(".")[0] if __package__.count(".") > 2 else ""
"""The name under which Blender knows us; "" where the package is imported plainly."""

NEWEST = 0.5
"""Weight of the newest bake in what is known of this machine; the rest is what was known before."""

TELLING = 500_000
"""Texels from which on a bake has that weight."""

_machine: dict[str, float] = {}
"""`slowness` of this machine, once it was looked up."""


def keep_report(scene: bpy.types.Scene, report: Report) -> None:
    """Keep a bake's report on its scene."""
    found = pace(scene) if report.ended_in else _pace_of(report)
    folder = next((page.file.parent for page in report.pages if page.file), Path.cwd())
    scene[REPORT_KEY] = {
        "summary": report.summary(),
        "warnings": "\n".join(warning.replace("\n", " ") for warning in report.warnings),
        "fixed": found.fixed,
        "slowness": found.slowness,
        "report": report.as_json(folder),
    }


def summary(scene: bpy.types.Scene) -> str:
    """The last bake in a line, "" if there is none."""
    return str(scene[REPORT_KEY]["summary"]) if REPORT_KEY in scene else ""


def warnings(scene: bpy.types.Scene) -> list[str]:
    """What the last bake warned of."""
    said = str(scene[REPORT_KEY]["warnings"]) if REPORT_KEY in scene else ""
    return said.splitlines()


def write_last_report(scene: bpy.types.Scene, folder: Path) -> Path:
    """Write the page of the last bake's report into a folder that holds nothing worth keeping.

    Pages are found by what the file knows of its images, wherever they lie by now; packed ones are written beside it.

    Raises:
        SceneError: there is no report
        OutputError: the page can't be written
    """
    if REPORT_KEY not in scene:
        raise SceneError(scene.name, "there is no report of a bake", "Bake the scene")
    known = json.loads(scene[REPORT_KEY]["report"])
    known["folder"] = "."
    images = {image[PAGE_KEY]: image for image in page_images(scene.get(BAKE_KEY, ""))}
    for index, page in enumerate(known["pages"]):
        image = images.get(index)
        page["file"] = None if image is None else str(_file_of(image, folder / f"radiosity_page_{index + 1}"))
    report = folder / "radiosity_report.json"
    report.write_text(json.dumps(known), encoding="utf-8")
    page = report.with_suffix(".html")
    write_report_page(report, page)
    return page


def _file_of(image: bpy.types.Image, unpacked: Path) -> Path:
    if image.packed_file is None:
        return Path(bpy.path.abspath(image.filepath)).resolve()
    path = unpacked.with_suffix(Path(image.filepath or image.name).suffix or ".exr")
    path.write_bytes(image.packed_file.data)
    return path


def pace(scene: bpy.types.Scene) -> Pace:
    """How fast the scene is baked here: as last time, or as this machine did others."""
    if REPORT_KEY in scene:
        return Pace(float(scene[REPORT_KEY]["fixed"]), float(scene[REPORT_KEY]["slowness"]))
    if not _machine:
        _machine["slowness"] = _read_machine()
    return Pace(slowness=_machine["slowness"])


def stage_shares(scene: bpy.types.Scene) -> Mapping[str, float]:
    """What share of the time each stage of the next bake will take: as last time, if that went to its end."""
    known = json.loads(scene[REPORT_KEY]["report"]) if REPORT_KEY in scene else {}
    if not known or known["ended_in"]:
        return STAGES
    return shares_of({stage["name"]: stage["seconds"] for stage in known["stages"]})


def learn(report: Report) -> None:
    """Remember how long a bake took, for other scenes on this machine: a small one tells little."""
    before = _machine["slowness"] if _machine else _read_machine()
    weight = NEWEST * min(1.0, report.texels / TELLING)
    now = max(_pace_of(report).slowness, 1e-3)
    _machine["slowness"] = math.exp((1 - weight) * math.log(before) + weight * math.log(now))
    path = _machine_file(create=True)
    if path is not None:
        path.write_text(json.dumps(_machine), encoding="utf-8")


def _pace_of(report: Report) -> Pace:
    return Pace.of(report.stages, report.texels, report.settings.quality)


def _read_machine() -> float:
    path = _machine_file(create=False)
    try:
        known = json.loads(path.read_text(encoding="utf-8")) if path else {}
        return min(max(float(known["slowness"]), 1e-3), 1e3)
    except (OSError, ValueError, KeyError, TypeError):  # never written, or not by us: as good as none
        return 1.0


def _machine_file(create: bool) -> Path | None:
    """Where Blender lets an extension keep what is its own; nowhere for what is none."""
    if not EXTENSION:
        return None
    return Path(bpy.utils.extension_path_user(EXTENSION, create=create)) / "speed.json"
