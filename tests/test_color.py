# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour against published values; where a reference says "computed", it is colour-science 0.4.7 at 1 nm."""

from __future__ import annotations

import colorsys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from radiosity_addon.color.difference import ciede2000
from radiosity_addon.color.models import (
    cmyk_to_rgb,
    hsl_to_rgb,
    hsv_to_rgb,
    rgb_to_cmy,
    rgb_to_cmyk,
    rgb_to_hsl,
    rgb_to_hsv,
)
from radiosity_addon.color.oklab import from_oklab, to_oklab
from radiosity_addon.color.spaces import (
    ACES_WHITE,
    ACESCG,
    D65,
    DISPLAY_P3,
    REC709,
    REC2020,
    SPACES,
    adaptation,
    from_lab,
    luminance,
    to_lab,
    uv_of,
    xy_of,
    xyz_of,
)
from radiosity_addon.color.spectra import (
    ILLUMINANTS,
    WAVELENGTHS,
    blackbody,
    blackbody_xy,
    dominant_wavelength,
    observer,
    planck,
    spectrum_to_xyz,
)
from radiosity_addon.color.transfer import rec709_decode, rec709_encode, srgb_decode, srgb_encode

D50 = (0.34567, 0.35850)

PATCHES = """
dark skin 0.4316 0.3777 0.1008 37.986 13.555 14.059 116 81 67
light skin 0.4197 0.3744 0.3495 65.711 18.13 17.81 199 147 129
blue sky 0.276 0.3016 0.1836 49.927 -4.88 -21.925 91 122 156
foliage 0.3703 0.4499 0.1325 43.139 -13.095 21.905 90 108 64
blue flower 0.2999 0.2856 0.2304 55.112 8.844 -25.399 130 128 176
bluish green 0.2848 0.3911 0.4178 70.719 -33.397 -0.199 92 190 172
orange 0.5295 0.4055 0.3118 62.661 36.067 57.096 224 124 47
purplish blue 0.2305 0.2106 0.1126 40.02 10.41 -45.964 68 91 170
moderate red 0.5012 0.3273 0.1938 51.124 48.239 16.248 198 82 97
purple 0.3319 0.2482 0.0637 30.325 22.976 -21.587 94 58 106
yellow green 0.3984 0.5008 0.4446 72.532 -23.709 57.255 159 189 63
orange yellow 0.4957 0.4427 0.4357 71.941 19.363 67.857 230 162 39
blue 0.2018 0.1692 0.0575 28.778 14.179 -50.297 35 63 147
green 0.3253 0.5032 0.2318 55.261 -38.342 31.37 67 149 74
red 0.5686 0.3303 0.1257 42.101 53.378 28.19 180 49 57
yellow 0.4697 0.4734 0.5981 81.733 4.039 79.819 238 198 20
magenta 0.4159 0.2688 0.2009 51.935 49.986 -14.574 193 84 151
cyan 0.2131 0.3023 0.193 51.038 -28.631 -28.638 0 136 170
white 0.3469 0.3608 0.9131 96.539 -0.425 1.186 245 245 243
grey 8 0.344 0.3584 0.5894 81.257 -0.638 -0.335 200 202 202
grey 6.5 0.3432 0.3581 0.3632 66.766 -0.734 -0.504 161 163 163
grey 5 0.3446 0.3579 0.1915 50.867 -0.153 -0.27 121 121 122
grey 3.5 0.3401 0.3548 0.0883 35.656 -0.421 -1.231 82 84 86
black 0.3406 0.3537 0.0311 20.461 -0.079 -0.973 49 49 51

"""
"""The ColorChecker of 2005 under D50: xyY and L*a*b* of its maker, sRGB of Pascale 2006 (Bradford, cut to the cube)."""


def patches() -> np.ndarray:
    return np.array([row.split()[-9:] for row in PATCHES.strip().replace("\n", ";").split(";")], np.float64)


def test_there_are_24_patches() -> None:
    assert patches().shape == (24, 9)


def test_patches_have_their_published_chromaticity_to_the_last_digit() -> None:
    xyz = from_lab(patches()[:, 3:6], D50)
    found = np.column_stack([xy_of(xyz), xyz[:, 1]])
    np.testing.assert_allclose(found, patches()[:, :3], rtol=0, atol=0.52e-4)


def test_patches_have_their_published_srgb_values_exactly() -> None:
    xyz = from_lab(patches()[:, 3:6], D50) @ adaptation(D50, D65).T
    found = np.clip(np.round(255 * srgb_encode(xyz @ REC709.from_xyz.T)), 0, 255)
    np.testing.assert_array_equal(found, patches()[:, 6:])


@pytest.mark.parametrize(
    ("name", "white"),
    [("A", (0.4476, 0.4074)), ("D50", (0.3457, 0.3585)), ("D65", (0.3127, 0.3290))],
)
def test_an_illuminants_spectrum_has_its_published_white(name: str, white: tuple[float, float]) -> None:
    xy = xy_of(spectrum_to_xyz(WAVELENGTHS, ILLUMINANTS[name]))
    np.testing.assert_array_equal(np.round(xy, 4), white)


def test_the_spectrum_of_d65_is_the_published_one() -> None:
    found = np.interp([380, 450, 555, 600, 780], WAVELENGTHS, ILLUMINANTS["D65"])
    np.testing.assert_allclose(found, [49.9755, 117.008, 102.023, 90.0062, 63.3828], rtol=0, atol=5e-4)


def test_the_spectrum_of_illuminant_a_is_the_published_one() -> None:
    found = 100 * np.interp([380, 450, 555, 600, 780], WAVELENGTHS, ILLUMINANTS["A"])
    np.testing.assert_allclose(found, [9.79510, 33.0859, 96.4423, 129.043, 241.675], rtol=5e-6)


@pytest.mark.parametrize(
    ("wavelength", "xy"),
    [
        (450, (0.1566, 0.0177)),
        (500, (0.0082, 0.5384)),
        (520, (0.0743, 0.8338)),
        (600, (0.6270, 0.3725)),
        (700, (0.7347, 0.2653)),
    ],
)
def test_the_spectral_locus_is_where_it_is_published(wavelength: float, xy: tuple[float, float]) -> None:
    np.testing.assert_array_equal(np.round(xy_of(observer(wavelength)), 4), xy)


def test_the_observer_integrates_to_the_equal_energy_white() -> None:
    xyz = spectrum_to_xyz(WAVELENGTHS, np.ones((2, len(WAVELENGTHS))))
    assert xyz.shape == (2, 3)
    np.testing.assert_allclose(xyz[0], 106.857, rtol=5e-4)
    np.testing.assert_allclose(xy_of(xyz[0]), 1 / 3, atol=1e-4)


BLACK_BODIES = {
    1000: (0.65275, 0.34446),
    1500: (0.58572, 0.39312),
    2000: (0.52668, 0.41330),
    3000: (0.43693, 0.40408),
    4000: (0.38044, 0.37675),
    5000: (0.34510, 0.35161),
    6500: (0.31353, 0.32363),
    10000: (0.28063, 0.28829),
    20000: (0.25646, 0.25763),
    40000: (0.24720, 0.24472),
}
"""Computed."""


def test_black_bodies_lie_on_the_planckian_locus() -> None:
    found = blackbody_xy(np.array(list(BLACK_BODIES)))
    np.testing.assert_allclose(found, list(BLACK_BODIES.values()), rtol=0, atol=1e-5)


def test_a_very_hot_black_body_is_as_blue_as_they_get() -> None:
    np.testing.assert_allclose(blackbody_xy(1e9), (0.2399, 0.2341), atol=1e-4)


@pytest.mark.parametrize("space", SPACES.values(), ids=SPACES)
def test_a_black_bodys_rgb_has_luminance_1_and_its_chromaticity(space) -> None:
    rgb = blackbody(np.array([1000.0, 6500.0]), space)
    np.testing.assert_allclose(luminance(rgb, space), 1, rtol=1e-12)
    np.testing.assert_allclose(xy_of(rgb @ space.to_xyz.T), blackbody_xy(np.array([1000.0, 6500.0])), atol=1e-12)


def test_plancks_law_peaks_where_wien_says() -> None:
    wavelength = np.linspace(300, 3000, 270_001)
    assert wavelength[planck(wavelength, 5000).argmax()] == pytest.approx(2.897771955e6 / 5000, abs=0.02)


PUBLISHED = {
    "rec709": (REC709, [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]], 5e-5),
    "rec2020": (
        REC2020,
        [[0.636958, 0.144617, 0.168881], [0.262700, 0.677998, 0.059302], [0.0, 0.028073, 1.060985]],
        5e-7,
    ),
    "p3": (
        DISPLAY_P3,
        [[0.4865709, 0.2656677, 0.1982173], [0.2289746, 0.6917385, 0.0792869], [0, 0.0451134, 1.0439444]],
        5e-8,
    ),
}


@pytest.mark.parametrize(("space", "matrix", "digit"), PUBLISHED.values(), ids=PUBLISHED)
def test_a_spaces_matrix_is_the_published_one_to_the_last_digit(space, matrix, digit) -> None:
    np.testing.assert_allclose(space.to_xyz, matrix, rtol=0, atol=1.02 * digit)


def test_acescg_under_its_own_white_has_the_published_matrix() -> None:
    own = adaptation(D65, ACES_WHITE) @ ACESCG.to_xyz
    published = [
        [0.6624541811, 0.1340042065, 0.1561876870],
        [0.2722287168, 0.6740817658, 0.0536895174],
        [-0.0055746495, 0.0040607335, 1.0103391003],
    ]
    np.testing.assert_allclose(own, published, rtol=0, atol=1e-10)


def test_acescg_goes_to_rec709_by_the_published_matrix_which_adapts_by_bradford() -> None:
    published = [[1.70505, -0.62179, -0.08326], [-0.13026, 1.14080, -0.01055], [-0.02400, -0.12897, 1.15297]]
    np.testing.assert_allclose(ACESCG.to(REC709), published, rtol=0, atol=5.1e-6)


@pytest.mark.parametrize("space", SPACES.values(), ids=SPACES)
def test_white_is_white_in_every_space(space) -> None:
    np.testing.assert_allclose(space.to_xyz @ np.ones(3), xyz_of(D65), rtol=1e-14)


def test_a_space_goes_to_itself_by_exactly_the_identity() -> None:
    np.testing.assert_array_equal(REC709.to(REC709), np.eye(3))


def test_uniform_chromaticities_of_d65_are_the_published_ones() -> None:
    np.testing.assert_array_equal(np.round(uv_of(xyz_of(D65)), 4), (0.1978, 0.4683))


def test_black_has_the_chromaticity_of_white() -> None:
    np.testing.assert_allclose(xy_of(np.zeros(3)), D65)
    np.testing.assert_allclose(uv_of(np.zeros(3)), uv_of(xyz_of(D65)))


def test_dominant_wavelengths_of_the_primaries_are_the_known_ones() -> None:
    wavelength, purity = dominant_wavelength(REC709.primaries)
    np.testing.assert_allclose(wavelength, [611.4, 549.1, 464.2], atol=0.1)
    assert ((purity > 0.7) & (purity < 1)).all()


def test_a_spectral_colour_is_pure_and_has_its_own_wavelength() -> None:
    wavelength, purity = dominant_wavelength(xy_of(observer(np.array([470.0, 530.0, 580.0, 620.0]))))
    np.testing.assert_allclose(wavelength, [470, 530, 580, 620], atol=1e-6)
    np.testing.assert_allclose(purity, 1, atol=1e-9)


def test_a_purple_has_a_complementary_wavelength_and_half_way_to_the_boundary_half_the_purity() -> None:
    end = xy_of(observer(np.array([380.0, 700.0]))).mean(axis=0)
    wavelength, purity = dominant_wavelength(np.array([end, (end + D65) / 2]))
    assert (wavelength > -560).all()
    assert (wavelength < -490).all()
    np.testing.assert_allclose(purity, [1, 0.5], atol=1e-9)


def test_white_has_no_wavelength_and_no_purity() -> None:
    wavelength, purity = dominant_wavelength(np.array(D65))
    assert np.isnan(wavelength)
    assert purity == 0


SHARMA = """
50 2.6772 -79.7751 50 0 -82.7485 2.0425; 50 3.1571 -77.2803 50 0 -82.7485 2.8615; 50 2.8361 -74.02 50 0 -82.7485 3.4412
50 -1.3802 -84.2814 50 0 -82.7485 1; 50 -1.1848 -84.8006 50 0 -82.7485 1; 50 -0.9009 -85.5211 50 0 -82.7485 1
50 0 0 50 -1 2 2.3669; 50 -1 2 50 0 0 2.3669; 50 2.49 -0.001 50 -2.49 0.0009 7.1792
50 2.49 -0.001 50 -2.49 0.0010 7.1792
50 2.49 -0.001 50 -2.49 0.0011 7.2195; 50 2.49 -0.001 50 -2.49 0.0012 7.2195; 50 -0.001 2.49 50 0.0009 -2.49 4.8045
50 -0.001 2.49 50 0.001 -2.49 4.8045
50 -0.001 2.49 50 0.0011 -2.49 4.7461; 50 2.5 0 50 0 -2.5 4.3065; 50 2.5 0 73 25 -18 27.1492; 50 2.5 0 61 -5 29 22.8977
50 2.5 0 56 -27 -3 31.9030; 50 2.5 0 58 24 15 19.4535; 50 2.5 0 50 3.1736 0.5854 1; 50 2.5 0 50 3.2972 0 1
50 2.5 0 50 1.8634 0.5757 1; 50 2.5 0 50 3.2592 0.3350 1; 60.2574 -34.0099 36.2677 60.4626 -34.1751 39.4387 1.2644
63.0109 -31.0961 -5.8663 62.8187 -29.7946 -4.0864 1.2630; 61.2901 3.7196 -5.3901 61.4292 2.2480 -4.9620 1.8731
35.0831 -44.1164 3.7933 35.0232 -40.0716 1.5901 1.8645; 22.7233 20.0904 -46.6940 23.0331 14.9730 -42.5619 2.0373
36.4612 47.8580 18.3852 36.2715 50.5065 21.2231 1.4146; 90.8027 -2.0831 1.4410 91.1528 -1.6435 0.0447 1.4441
90.9257 -0.5406 -0.9208 88.6381 -0.8985 -0.7239 1.5381; 6.7747 -0.2908 -2.4247 5.8714 -0.0985 -2.2286 0.6377
2.0776 0.0795 -1.1350 0.9033 -0.0636 -0.5514 0.9082
"""
"""Pairs of Sharma, Wu and Dalal 2005, table 1."""


def test_colour_differences_are_the_published_ones() -> None:
    rows = np.array([row.split() for row in SHARMA.strip().replace("\n", ";").split(";")], np.float64)
    assert len(rows) == 34
    np.testing.assert_allclose(ciede2000(rows[:, :3], rows[:, 3:6]), rows[:, 6], rtol=0, atol=5.1e-5)
    np.testing.assert_allclose(ciede2000(rows[:, 3:6], rows[:, :3]), rows[:, 6], rtol=0, atol=5.1e-5)


channels = arrays(np.float64, (4, 3), elements=st.floats(0, 1, width=16))
wide = arrays(np.float64, (4, 3), elements=st.floats(-8, 8, allow_subnormal=False))


@given(wide, st.sampled_from(list(SPACES.values())), st.sampled_from(list(SPACES.values())))
def test_spaces_round_trip(rgb, one, other) -> None:
    np.testing.assert_allclose(rgb @ one.to(other).T @ other.to(one).T, rgb, rtol=0, atol=1e-12)


@given(channels)
def test_lab_round_trips(xyz) -> None:
    np.testing.assert_allclose(from_lab(to_lab(xyz)), xyz, rtol=0, atol=1e-12)


@given(wide)
def test_oklab_round_trips_beyond_the_gamut(rgb) -> None:
    np.testing.assert_allclose(from_oklab(to_oklab(rgb, REC709), REC709), rgb, rtol=0, atol=1e-10)


def test_oklab_has_its_published_values() -> None:
    found = to_oklab(np.eye(3) @ REC709.from_xyz.T, REC709)  # XYZ (1, 0, 0), (0, 1, 0), (0, 0, 1) of Ottosson 2020
    published = [[0.450, 1.236, -0.019], [0.922, -0.671, 0.263], [0.153, -1.415, -0.449]]
    np.testing.assert_allclose(found, published, rtol=0, atol=1.1e-3)


@given(st.floats(1e-6, 1e6))
def test_grey_has_no_chroma_in_oklab(value) -> None:
    np.testing.assert_allclose(to_oklab(np.full(3, value), ACESCG)[1:], 0, atol=1e-12 * np.cbrt(value))


@given(wide)
def test_transfer_functions_round_trip(linear) -> None:
    np.testing.assert_allclose(srgb_decode(srgb_encode(linear)), linear, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(rec709_decode(rec709_encode(linear)), linear, rtol=1e-12, atol=1e-12)


def test_srgb_has_its_known_values() -> None:
    np.testing.assert_allclose(srgb_encode(np.array([0.0, 0.18, 0.5, 1.0])), [0, 0.461356, 0.735357, 1], atol=5e-7)


def test_rec709_is_continuous_and_known_at_middle_grey() -> None:
    assert rec709_encode(np.array(0.18)) == pytest.approx(0.409, abs=2e-4)  # 0.40901 by the three digits of BT.709
    step = rec709_encode(np.array([0.0180539, 0.0180541]))
    assert np.diff(step) == pytest.approx(4.5 * 2e-7, rel=1e-2)


@given(channels)
def test_hsv_and_hsl_agree_with_the_standard_library(rgb) -> None:
    hsl = [colorsys.rgb_to_hls(*row) for row in rgb]
    found_hsv, found_hsl = rgb_to_hsv(rgb), rgb_to_hsl(rgb)
    np.testing.assert_allclose(found_hsv, [colorsys.rgb_to_hsv(*row) for row in rgb], atol=1e-9)
    light = (found_hsl[:, 2] > 1e-12) & (found_hsl[:, 2] < 1 - 1e-12)  # at the ends saturation is 0 / 0
    np.testing.assert_allclose(found_hsl[light], np.array(hsl)[light][:, [0, 2, 1]], atol=1e-9)


@given(channels)
def test_colour_models_round_trip(rgb) -> None:
    np.testing.assert_allclose(hsv_to_rgb(rgb_to_hsv(rgb)), rgb, rtol=0, atol=1e-10)
    np.testing.assert_allclose(hsl_to_rgb(rgb_to_hsl(rgb)), rgb, rtol=0, atol=1e-10)
    np.testing.assert_allclose(cmyk_to_rgb(rgb_to_cmyk(rgb)), rgb, rtol=0, atol=1e-10)
    np.testing.assert_allclose(rgb_to_cmy(rgb_to_cmy(rgb)), rgb, rtol=0, atol=1e-15)


def test_known_colours_in_other_models() -> None:
    orange = np.array([1.0, 0.5, 0.0])
    np.testing.assert_allclose(rgb_to_hsv(orange), [1 / 12, 1, 1])
    np.testing.assert_allclose(rgb_to_hsl(orange), [1 / 12, 1, 0.5])
    np.testing.assert_allclose(rgb_to_cmyk(orange * 0.8), [0, 0.5, 1, 0.2])
