# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's keys are a promise to whoever reads it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from radiosity_addon.color.spaces import REC709
from radiosity_addon.files import Transaction
from radiosity_addon.geometry.visibility import Tally
from radiosity_addon.pages.page_files import PageFiles
from radiosity_addon.pages.page_format import Recipe
from radiosity_addon.radiosity.relaxation import Balance
from radiosity_addon.reports.report import BakedObject, Page, Report, Stalls, thinned, write_report
from radiosity_addon.settings import BakeSettings


def report(**changes: object) -> Report:
    fields: dict[str, object] = {
        "pages": [Page("room_radiosity_1", Path("/srv/out/room_textures/room_radiosity_1.exr"), (64, 64))],
        "objects": [BakedObject("Wall", "Wall", 0, np.int64(120), np.float64(16.5))],
        "skipped": [("Hair", "has no surface")],
        "stages": [("Unwrap", 0.25, 0), ("Gather", np.float64(1.5), np.int64(3000))],
        "seconds": 2.0,
        "texels": np.int64(120),
        "patches": 12,
        "rays": np.int64(3000),
        "tracing": Tally(2000, 0.5, 1000, 0.25),
        "residual": np.float32(0.0009765625),
        "warnings": ["Lamp: negative energy"],
        "name": "room",
        "residuals": [1.0, np.float64(0.5), np.float32(0.0009765625)],
        "balance": Balance(*(np.full((1, 3), watts) for watts in (4.0, 5.0, 2.0, 2.0, 1.0, 1.0))),
        "files": PageFiles(Recipe("rgbm", REC709, brightest=2.0), np.float64(0.25), 0.0, (0,)),
        "after": Path("/srv/out/room.png"),
        "ended_in": "Gather",
        "stalls": Stalls({"Read scene": 0.05, "Write back": 0.09}, 0.2, 0.75),
    }
    return Report(**{**fields, **changes})  # type: ignore[arg-type]


def test_the_keys_are_exactly_the_promised_ones() -> None:
    found = json.loads(report().as_json(Path("/srv/out")))
    assert found == {
        "scene": "room",
        "folder": ".",
        "settings": {
            "quality": "medium",
            "solver": BakeSettings.solver,
            "tolerance": 1e-4,
            "page_size": 1024,
            "density": None,
        },
        "working_space": {"name": "Linear Rec.709", "rgb_to_xyz_d65": REC709.to_xyz.tolist()},
        "pages": [{"image": "room_radiosity_1", "file": "room_textures/room_radiosity_1.exr", "size": [64, 64]}],
        "objects": [{"source": "Wall", "object": "Wall", "page": 0, "texels": 120, "density": 16.5}],
        "skipped": [{"object": "Hair", "reason": "has no surface"}],
        "stages": [
            {"name": "Unwrap", "seconds": 0.25, "rays": 0},
            {"name": "Gather", "seconds": 1.5, "rays": 3000},
        ],
        "seconds": 2.0,
        "texels": 120,
        "patches": 12,
        "rays": 3000,
        "tracing": {"closest": 2000, "closest_seconds": 0.5, "shadow": 1000, "shadow_seconds": 0.25},
        "ended_in": "Gather",
        "window": {
            "longest_stall_s": 0.09,
            "longest_stall_in": "Write back",
            "stalls_s": {"Read scene": 0.05, "Write back": 0.09},
            "longest_gap_s": 0.2,
            "first_light_s": 0.75,
        },
        "residual": 0.0009765625,
        "residuals": [1.0, 0.5, 0.0009765625],
        "estimated_error": None,
        "balance": pytest.approx({"emitted": 4.0, "absorbed": 2.0, "escaped": 1.0, "unshot": 1.0}),
        "light_groups": {},
        "files": {
            **Recipe("rgbm", REC709, brightest=2.0).as_dict(),
            "outside_before": 0.25,
            "outside_after": 0.0,
        },
        "light": None,
        "renders": {"before": None, "after": "room.png"},
        "warnings": ["Lamp: negative energy"],
    }


def test_an_instance_says_where_it_lies() -> None:
    instance = BakedObject("Chair", "Chair", 1, 9, 8.0, (0.5, 0.25), (0.125, 0.0), np.eye(4))
    found = json.loads(report(objects=[instance]).as_json(Path("/srv/out")))["objects"][0]
    assert found["uv_scale"] == [0.5, 0.25]
    assert found["uv_offset"] == [0.125, 0.0]
    assert found["matrix"] == np.eye(4).tolist()


def test_a_packed_page_has_no_file() -> None:
    assert json.loads(report(pages=[Page("p", None, (8, 8))]).as_json(Path("/")))["pages"][0]["file"] is None


def test_a_residual_that_is_no_number_becomes_null() -> None:
    assert json.loads(report(residual=float("nan")).as_json(Path("/")))["residual"] is None


def test_the_file_lies_in_utf_8_with_paths_relative_to_the_folder_given(tmp_path: Path) -> None:
    page = Page("p", tmp_path / "textures" / "夜.exr", (8, 8))
    with Transaction() as files:
        write_report(tmp_path / "report.json", report(pages=[page]), tmp_path / "blends", files)
        files.commit()
    found = json.loads((tmp_path / "report.json").read_bytes().decode("utf-8"))
    assert found["pages"][0]["file"] == "../textures/夜.exr"


def test_the_summary_is_one_line() -> None:
    assert report().summary() == "Baked 1 object on 1 page of 64 x 64 in 2.0 s, stopped in stage Gather"
    two = report(ended_in="", objects=[BakedObject("A", "A", 0, 1, 1.0)] * 2, pages=[Page("p", None, (8, 8))] * 2)
    assert two.summary() == "Baked 2 objects on 2 pages of 8 x 8 in 2.0 s"


def test_the_file_says_where_its_paths_begin(tmp_path: Path) -> None:
    with Transaction() as files:
        write_report(tmp_path / "report.json", report(), tmp_path / "blends", files)
        files.commit()
    assert json.loads((tmp_path / "report.json").read_text("utf-8"))["folder"] == "blends"


def test_a_long_curve_is_thinned_to_its_ends_and_what_is_between() -> None:
    found = thinned([float(step) for step in range(5000)])
    assert (len(found), found[0], found[-1]) == (200, 0.0, 4999.0)
    assert list(found) == sorted(found)
