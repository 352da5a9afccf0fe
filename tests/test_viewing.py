# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes that someone looks on at."""

from __future__ import annotations

import threading
from collections.abc import Generator

import numpy as np
import pytest

from radiosity_addon.atlas.unwrap import Atlas, build_atlas
from radiosity_addon.bake import Baked, bake
from radiosity_addon.chunks import finish
from radiosity_addon.scene import Scene
from radiosity_addon.settings import BakeSettings
from radiosity_addon.stages import STAGES
from radiosity_addon.viewing import LitPages, LitVertices, View
from tests.bakes import WHITE, floor
from tests.shapes import furnished_room

SETTINGS = BakeSettings(page_size=128, quality="draft")
STOPPED_IN = ("Direct light", "Transport", "Gather")


class Onlooker:
    """Keeps what it is shown; satisfied when told."""

    def __init__(self) -> None:
        self.satisfied = False
        self.views: list[View] = []

    def show(self, view: View) -> None:
        self.views.append(view)


def stopped_in(stage: str) -> tuple[Baked, Onlooker]:
    """A bake that its viewer ends when it comes to a stage."""
    viewer = Onlooker()
    steps = bake(furnished_room(), SETTINGS, viewer=viewer)
    while True:
        try:
            viewer.satisfied |= next(steps).stage == stage
        except StopIteration as stop:
            return stop.value, viewer


@pytest.fixture(scope="module")
def whole() -> Baked:
    return finish(bake(furnished_room(), SETTINGS))


def test_pages_are_the_same_to_the_bit_whether_anyone_looks_on(whole: Baked) -> None:
    viewer = Onlooker()
    seen = finish(bake(furnished_room(), SETTINGS, viewer=viewer))
    assert np.array_equal(seen.pages, whole.pages)
    assert (seen.rays, seen.residual, seen.warnings, seen.ended_in) == (whole.rays, whole.residual, whole.warnings, "")
    glimpse, first, *later = viewer.views
    assert isinstance(glimpse, LitVertices)
    assert isinstance(first, LitVertices)
    assert len(later) >= 4
    assert all(isinstance(view, LitPages) for view in later)


def test_something_is_seen_before_charts_are_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    viewer, seen = Onlooker(), []

    def counted(scene: Scene, settings: BakeSettings) -> Generator[float, None, Atlas]:
        seen.append(len(viewer.views))
        return build_atlas(scene, settings)

    monkeypatch.setattr("radiosity_addon.bake.build_atlas", counted)
    steps = bake(furnished_room(), SETTINGS, viewer=viewer)
    while not seen:
        next(steps)
    steps.close()
    assert seen == [1]


def test_what_is_shown_comes_nearer_to_what_is_baked() -> None:
    viewer = Onlooker()
    finish(bake(furnished_room(), SETTINGS, viewer=viewer))
    pages = [view.images[0] for view in viewer.views[2:]]
    shown = pages[-1].sum(2) > 0
    errors = [float(np.sqrt(np.mean((page[shown] - pages[-1][shown]) ** 2))) for page in pages]
    assert errors[0] > 1.3 * errors[-2] > 0
    assert errors[-1] == 0
    assert [page[shown].mean() for page in pages] == pytest.approx([pages[-1][shown].mean()] * len(pages), rel=0.1)


def test_the_last_view_is_the_light_of_the_page_times_reflectance() -> None:
    viewer = Onlooker()
    scene = Scene((floor(),), (WHITE,), furnished_room().lights)
    baked = finish(bake(scene, SETTINGS, viewer=viewer))
    image = viewer.views[-1].images[0]
    shown = image.sum(2) > 0
    assert shown.mean() > 0.8
    assert image[shown] == pytest.approx(0.75 * baked.pages[0][shown], rel=1e-5)


@pytest.mark.parametrize("stage", STOPPED_IN)
def test_a_bake_stopped_early_has_whole_pages_near_those_of_the_whole(stage: str, whole: Baked) -> None:
    baked = stopped_in(stage)[0]
    page, aim = baked.pages[0], whole.pages[0]
    assert baked.ended_in == stage
    assert any(stage in warning for warning in baked.warnings)
    assert np.isfinite(page).all()
    assert page.min() >= 0
    assert page.mean() == pytest.approx(aim.mean(), rel=0.05)
    assert np.abs(page - aim).mean() < 0.15 * aim.mean()
    last = list(STAGES).index(stage)
    assert [each.name for each in baked.stages] == [*list(STAGES)[:last], "Pages"]


def test_a_bake_stopped_after_direct_light_is_better_than_one_stopped_before(whole: Baked) -> None:
    errors = [np.abs(stopped_in(stage)[0].pages[0] - whole.pages[0]).mean() for stage in STOPPED_IN]
    assert errors[0] > 1.1 * max(errors[1:])


def test_nobody_can_be_satisfied_before_there_is_something_to_keep() -> None:
    baked, _ = stopped_in("Unwrap")
    assert baked.ended_in == "Direct light"


@pytest.mark.parametrize("stage", ["Unwrap", "Direct light", "Gather"])
def test_a_bake_that_is_closed_leaves_no_thread_behind(stage: str) -> None:
    before = threading.active_count()
    steps = bake(furnished_room(), SETTINGS, viewer=Onlooker())
    assert any(progress.stage == stage for progress in steps)
    steps.close()
    assert threading.active_count() == before


def test_large_pages_are_shown_smaller(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("radiosity_addon.viewing.MOST_SHOWN", 64 * 64)
    viewer = Onlooker()
    finish(bake(furnished_room(), SETTINGS, viewer=viewer))
    assert viewer.views[-1].images[0].shape == (64, 64, 3)
    assert viewer.views[-1].images[0].mean() > 0
