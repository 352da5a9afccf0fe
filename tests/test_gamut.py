# SPDX-License-Identifier: GPL-3.0-or-later
"""What every rendering intent promises, on colours that hypothesis chooses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from radiosity_addon.color.gamut import INTENTS, KNEE, GamutMap, highest_saturation, shoulder
from radiosity_addon.color.oklab import to_oklab
from radiosity_addon.color.spaces import ACESCG, DISPLAY_P3, REC709, REC2020

COLORFUL = 2e-3
"""Chroma in Oklab from which on float32 knows a hue to a tenth of a degree."""

sources = st.sampled_from([REC709, REC2020, DISPLAY_P3, ACESCG])
intents = st.sampled_from(INTENTS)
peaks = st.sampled_from([1.0, None])
light = st.floats(0.0, 1.0, width=32)
bakes = st.builds(
    lambda share, stops: (share * 2.0**stops).astype(np.float32),
    arrays(np.float32, (3, 5, 3), elements=light),
    arrays(np.float32, (3, 5, 1), elements=st.floats(-6, 4, width=32)),
)
"""Pages whose colours span ten stops, up to 16 times the peak."""
with_negative = st.builds(
    lambda page, share: (page - np.float32(share) * page.max()).astype(np.float32), bakes, st.floats(0, 0.3)
)
"""The same, as lamps of negative power leave them."""


def mapped(bake: np.ndarray, mapping: GamutMap) -> np.ndarray:
    return mapping.apply(bake, mapping.survey([bake]))


def hue_and_chroma(rgb: np.ndarray, space) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    lab = to_oklab(rgb, space)
    return np.degrees(np.arctan2(lab[..., 2], lab[..., 1])), np.hypot(lab[..., 1], lab[..., 2]), lab[..., 0]


@given(bakes | with_negative, sources, intents, peaks)
def test_the_result_is_always_inside(bake, source, intent, peak) -> None:
    result = mapped(bake, GamutMap(source, REC709, intent, peak))
    assert np.isfinite(result).all()
    assert result.min() >= 0
    assert peak is None or result.max() <= peak


@given(bakes, sources, st.sampled_from(["absolute", "relative"]), peaks)
def test_colorimetric_intents_leave_alone_what_is_inside(bake, source, intent, peak) -> None:
    mapping = GamutMap(source, REC709, intent, peak)
    inside = ~mapping.outside(bake)
    plain = bake @ source.to(REC709).T
    result = mapped(bake, mapping)
    np.testing.assert_allclose(result[inside], plain[inside], rtol=0, atol=2e-6 * bake.max(initial=1e-9))


@given(bakes, st.sampled_from(["absolute", "relative"]))
def test_within_one_space_what_is_inside_stays_the_same_to_the_bit(bake, intent) -> None:
    mapping = GamutMap(REC709, REC709, intent, 1.0)
    inside = ~mapping.outside(bake)
    np.testing.assert_array_equal(mapped(bake, mapping)[inside], np.minimum(bake, 1)[inside])


@given(bakes, sources, st.sampled_from(["relative", "perceptual", "saturation"]), peaks)
def test_hue_is_kept_within_a_degree(bake, source, intent, peak) -> None:
    result = mapped(bake, GamutMap(source, REC709, intent, peak))
    before, vivid, _ = hue_and_chroma(bake, source)
    after, left, lightness = hue_and_chroma(result, REC709)
    turn = np.abs((before - after + 180) % 360 - 180)
    judged = (left > COLORFUL) & (left > 0.01 * lightness) & (vivid > COLORFUL)
    assert turn[judged].max(initial=0) < 1


@given(bakes, sources, peaks)
def test_relative_keeps_lightness_up_to_whites(bake, source, peak) -> None:
    result = mapped(bake, GamutMap(source, REC709, "relative", peak))
    _, _, before = hue_and_chroma(bake, source)
    _, _, after = hue_and_chroma(result, REC709)
    np.testing.assert_allclose(after, np.minimum(before, peak or np.inf), rtol=0, atol=1e-3 * max(1, before.max()))


def ramp(source, hue: float, lightness: float, count: int = 64) -> np.ndarray:
    """Colours of one hue and lightness, grey to as vivid as the source has them."""
    from radiosity_addon.color.oklab import from_oklab

    chroma = lightness * np.linspace(0, 0.9, count)[:, None]
    lab = np.hstack([np.full((count, 1), lightness), chroma * np.cos(hue), chroma * np.sin(hue)])
    colors = from_oklab(lab, source)
    return colors[(colors >= 0).all(axis=1)].astype(np.float32)[None]


@given(sources, st.floats(-3.14, 3.14), st.floats(0.05, 1.5), intents, peaks)
def test_the_order_of_saturation_is_kept(source, hue, lightness, intent, peak) -> None:
    if intent == "absolute":
        return  # the nearest point keeps no order
    colors = ramp(source, hue, lightness)
    assume(colors.shape[1] > 1)
    result = mapped(colors, GamutMap(source, REC709, intent, peak))
    _, chroma, light_after = hue_and_chroma(result[0], REC709)
    saturation = chroma / np.maximum(light_after, 1e-9)
    assert (np.diff(saturation) > -2e-4).all()


@given(bakes, sources, st.sampled_from(["perceptual", "saturation"]))
def test_the_order_of_saturation_is_kept_over_all_brightness(bake, source, intent) -> None:
    """Of one hue, however bright each: Oklab's saturation does not depend on brightness."""
    colors = ramp(source, 0.5, 0.6)
    scaled = colors * np.linspace(3, 0.1, colors.shape[1], dtype=np.float32)[None, :, None]
    mapping = GamutMap(source, REC709, intent, 1.0)
    result = mapping.apply(scaled, mapping.survey([scaled, bake]))
    _, chroma, light_after = hue_and_chroma(result[0], REC709)
    assert (np.diff(chroma / light_after) > -2e-4).all()


@given(bakes)
def test_perceptual_leaves_a_bake_that_fits_as_it_is(bake) -> None:
    bake = bake / max(1.0, float(bake.max()))
    np.testing.assert_array_equal(mapped(bake, GamutMap(REC709, REC709, "perceptual", 1.0)), bake)


def test_one_vivid_texel_bends_the_saturation_of_all_under_the_intents_for_whole_bakes_only() -> None:
    mild = np.array([[[0.5, 0.45, 0.1]]], np.float32)
    vivid = np.array([[[0.0, 1.0, 0.0]]], np.float32)
    for intent, changes in (("absolute", False), ("relative", False), ("perceptual", True), ("saturation", True)):
        mapping = GamutMap(ACESCG, REC709, intent, 1.0)
        alone = mapping.apply(mild, mapping.survey([mild]))
        beside = mapping.apply(mild, mapping.survey([mild, vivid]))
        assert np.array_equal(alone, beside) != changes, intent


def test_saturation_keeps_the_ratios_of_saturations() -> None:
    colors = ramp(REC2020, 2.4, 0.6)
    result = mapped(colors, GamutMap(REC2020, REC709, "saturation"))
    _, before, _ = hue_and_chroma(colors[0], REC2020)
    _, after, _ = hue_and_chroma(result[0], REC709)
    ratio = after[1:] / before[1:]
    assert ratio.max() < 1
    np.testing.assert_allclose(ratio, ratio[0], rtol=2e-3)


def test_absolute_takes_the_nearest_point() -> None:
    outside = np.array([[[1.5, 0.5, -0.2]]], np.float32)
    np.testing.assert_array_equal(mapped(outside, GamutMap(REC709, REC709, "absolute", 1.0))[0, 0], [1, 0.5, 0])


def test_relative_ends_on_the_boundary() -> None:
    outside = np.array([[[-0.1, 0.6, 0.2]]], np.float32)
    assert mapped(outside, GamutMap(REC709, REC709, "relative", 1.0))[0, 0, 0] == pytest.approx(0, abs=1e-4)


def test_a_colour_outside_is_found_and_its_share_told() -> None:
    page = np.full((2, 2, 3), 0.5, np.float32)
    page[0, 1] = 0.0, 1.0, 0.0
    mapping = GamutMap(ACESCG, REC709, "relative", 1.0)
    np.testing.assert_array_equal(mapping.outside(page), [[False, True], [False, False]])
    assert mapping.survey([page, page]).outside == 0.25


@given(with_negative, sources, intents)
@settings(max_examples=20, deadline=None)
def test_threads_change_nothing(bake, source, intent) -> None:
    page = np.tile(bake, (40, 400, 1))
    mapping = GamutMap(source, REC709, intent, 1.0)
    one, two = mapping.survey([page], 1), mapping.survey([page], 2)
    assert one == two
    np.testing.assert_array_equal(mapping.apply(page, one, 1), mapping.apply(page, one, 2))


def test_gain_comes_before_all_else() -> None:
    page = np.full((1, 1, 3), 0.4, np.float32)
    assert mapped(page, GamutMap(REC709, REC709, "relative", 1.0, gain=2.0))[0, 0, 0] == pytest.approx(0.8)


@pytest.mark.parametrize("space", [REC709, REC2020, DISPLAY_P3, ACESCG], ids=lambda space: space.name)
def test_the_boundary_of_a_gamut_goes_through_its_edges(space) -> None:
    share = np.linspace(0, 1, 777)[:, None] * [0, 1, 0]
    for corner in np.eye(3)[[0, 2]]:
        hue, chroma, lightness = hue_and_chroma(corner + share, space)
        found = np.interp(np.radians(hue), *highest_saturation(space))
        saturation = chroma / lightness
        assert (found > saturation * (1 - 2e-4)).all()
        np.testing.assert_allclose(found[100:], saturation[100:], rtol=2e-4)  # before that blue's edge turns back


@given(st.floats(1.0001, 100))
def test_the_shoulder_rises_from_the_knee_to_one(top) -> None:
    value = np.linspace(0, top, 500, dtype=np.float32)
    bent = shoulder(value, top)
    np.testing.assert_array_equal(bent[value <= KNEE], value[value <= KNEE])
    assert (np.diff(bent) >= 0).all()
    assert bent[-1] == pytest.approx(1, abs=1e-6)
