# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes of whole scenes against what Cycles measured at a few hundred probes, with many samples and all bounces.

The table goes to the end of pytest's output, pictures of the errors to out/accuracy/.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy", reason="bpy reads the scenes, and is not installed")
import bpy

from radiosity_addon.bake import bake
from radiosity_addon.blender.reading.cycles_shader import CyclesShader
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.chunks import finish
from radiosity_addon.settings import BakeSettings
from tests.accuracy.comparison import Comparison, compare
from tests.accuracy.edges import change_beside
from tests.accuracy.make_references import PLANS
from tests.accuracy.pictures import picture_of_errors
from tests.accuracy.probes import References, fingerprint

HERE = Path(__file__).resolve().parent
PICTURES = HERE.parents[1] / "out" / "accuracy"


@dataclass(frozen=True)
class Limits:
    """Most that a bake may err, as shares of the scene's mean, at probes that no other object stands beside."""

    rms: float
    bias: float
    percentile_99: float


LIMITS = {"medium": Limits(0.025, 0.005, 0.1), "high": Limits(0.015, 0.003, 0.05)}
DRAFT = Limits(0.035, 0.01, 0.15)
THROUGH_A_WINDOW = {"medium": Limits(0.05, 0.005, 0.1), "high": Limits(0.03, 0.003, 0.05)}
FAR_OFF = 0.2
"""Share of the mean by which a probe is off that light leaks to."""
MAX_FAR_OFF = 0.002
"""Of the probes of all scenes together."""
ENOUGH = 600
"""Probes from which on that says something; a scene has 130 to 200."""
NOISE = 0.008
"""Most that a reference may be noisy itself."""

SCENES = {
    "cornell_box": 1024,
    "aces_box": 1024,
    "window_room": 1024,
    "attic": 1024,
    "stair_hall": 1024,
    "studio": 768,
    "pergola": 1024,
    "court": 1024,
    "pavilion": 768,
    "dining": 768,
    "office": 768,
    "gallery": 768,
    "interior": 2048,
}
"""Page size of each: a texel is as wide as the footprint of the reference's probes."""
WINDOW_ROOMS = ("window_room", "attic")
MISSED = {
    (
        "interior",
        "medium",
    ): "RMS 2.8 %, bias 0.5 %, 99 % 11 %: what gather rays find by chance where much light arrives, what lies between "
    "their points, and curtains that turn away within a texel",
}
"""Scenes that do not keep the limits yet, and why: the table shows by how much. Those that miss them at medium quality
already are not baked at high quality, to save time."""
BLENDER_4 = ("cornell_box", "studio", "court", "dining", "office")
"""Scenes that Blender before 5.0 reads too, to save time: lamps, textures, transparency, instances, many objects. The
pergola is not one of them: its panes are a Voronoi texture, whose colours lie elsewhere in 4.5."""


def against_cycles(name: str, settings: BakeSettings) -> tuple[Comparison, References]:
    blend = PLANS[name].folder / f"{name}.blend"
    references = References.load(HERE / "references" / f"{name}.npz")
    assert fingerprint(blend) == references.scene, f"{blend.name} has changed: run make_references.py {name}"
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    extraction = extract_scene(bpy.context.scene)
    baked = finish(bake(extraction.scene, settings, CyclesShader(bpy.context.scene.name, extraction)))
    return compare(baked, extraction.scene, references), references


@dataclass
class FarOff:
    """Probes that are far off.

    Attributes:
        count: how many there are in all bakes of scenes that are to keep their limits
        probes: of how many
        change: by how much the light changes beside each, in scenes that miss their limits too
    """

    count: int = 0
    probes: int = 0
    change: list[float] = field(default_factory=list)


@pytest.fixture(scope="module")
def far_off() -> FarOff:
    return FarOff()


def cases() -> list[object]:
    """Scenes and qualities, those that miss the limits marked so."""
    pairs = [(name, quality) for name in SCENES for quality in LIMITS]
    pairs = [pair for pair in pairs if pair[1] == "medium" or (pair[0], "medium") not in MISSED]
    marks = {pair: pytest.mark.xfail(reason=reason) for pair, reason in MISSED.items()}
    return [pytest.param(*pair, marks=[marks[pair]] if pair in marks else []) for pair in pairs]


@pytest.mark.parametrize(("name", "quality"), cases())
def test_a_scene_is_as_cycles_has_it(name: str, quality: str, table: list[str], far_off: FarOff) -> None:
    if bpy.app.version < (5, 0) and (quality == "high" or name not in BLENDER_4):
        pytest.skip("the core is the same: most is measured once, with Blender 5")
    start = time.perf_counter()
    found, references = against_cycles(name, BakeSettings(page_size=SCENES[name], quality=quality))
    table.append(f"{name:14} {quality:7} {found.row()}  {time.perf_counter() - start:5.1f} s")
    picture_of_errors(PICTURES / f"{name}_{quality}.png", references.position, found.error)
    far = np.flatnonzero(np.abs(found.error) > FAR_OFF)
    far_off.change += change_beside(references, far).tolist() if len(far) else []
    if (name, quality) not in MISSED:
        far_off.count += len(far)
        far_off.probes += len(found.error)
    limits = (THROUGH_A_WINDOW if name in WINDOW_ROOMS else LIMITS)[quality]
    assert found.noise < NOISE
    assert found.rms < limits.rms, found
    assert abs(found.bias) < limits.bias, found
    assert found.percentile_99 < limits.percentile_99, found


def test_a_draft_keeps_what_it_aims_at(table: list[str]) -> None:
    """One scene, that of pictures and of an emissive one, tells whether fewer samples are still enough."""
    if bpy.app.version < (5, 0):
        pytest.skip("the core is the same: it is measured once, with Blender 5")
    found, _ = against_cycles("studio", BakeSettings(page_size=SCENES["studio"], quality="draft"))
    table.append(f"{'studio':14} {'draft':7} {found.row()}")
    assert found.rms < DRAFT.rms, found
    assert abs(found.bias) < DRAFT.bias, found
    assert found.percentile_99 < DRAFT.percentile_99, found


def test_hardly_any_probe_is_far_off(far_off: FarOff) -> None:
    """After the scenes: light that leaks, or a shadow that does, shows in few places but strongly."""
    if far_off.probes < ENOUGH:
        pytest.skip("too few scenes are baked to tell")
    assert far_off.count <= MAX_FAR_OFF * far_off.probes


def test_probes_that_are_far_off_lie_beside_the_edge_of_a_shadow(far_off: FarOff) -> None:
    """After the scenes: within a texel's reading Cycles' own light changes there as much as they are off."""
    assert all(change > FAR_OFF for change in far_off.change), far_off.change
