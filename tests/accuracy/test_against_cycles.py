# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes of sample scenes against what Cycles measured at a few hundred points, with many samples and all bounces."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("bpy", reason="bpy reads the scenes, and is not installed")
import bpy

from radiosity_addon.bake import bake
from radiosity_addon.blender.extract import extract_scene
from radiosity_addon.chunks import finish
from radiosity_addon.settings import BakeSettings
from tests.accuracy.comparison import Comparison, compare
from tests.accuracy.probes import References, fingerprint

HERE = Path(__file__).resolve().parent
SCENES = HERE.parents[1] / "sample_scenes"


def against_cycles(name: str, settings: BakeSettings) -> Comparison:
    blend = SCENES / f"{name}.blend"
    references = References.load(HERE / "references" / f"{name}.npz")
    assert fingerprint(blend) == references.scene, f"{blend.name} has changed: run make_references.py {name}"
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    scene = extract_scene(bpy.context.scene).scene
    return compare(finish(bake(scene, settings)), scene, references)


def test_cornell_box_is_within_1_2_percent_of_cycles_and_unbiased() -> None:
    found = against_cycles("cornell_box", BakeSettings(page_size=512))
    assert found.noise < 0.003
    assert found.rms < 0.012, found
    assert abs(found.bias) < 0.003, found


def test_room_lit_through_one_window_is_within_4_percent_of_cycles() -> None:
    found = against_cycles("window_room", BakeSettings())
    assert found.noise < 0.01
    assert found.rms < 0.04, found
