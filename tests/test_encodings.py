# SPDX-License-Identifier: GPL-3.0-or-later
"""Encodings over 16 stops, PNG files as others read them, recipes that bring the light back."""

from __future__ import annotations

import io
import json
import tempfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radiosity_addon.color.gamut import GamutMap
from radiosity_addon.color.spaces import ACESCG, REC709, REC2020
from radiosity_addon.errors import SettingsError
from radiosity_addon.files import Transaction
from radiosity_addon.pages.encodings import (
    RGB9E5_MAX,
    decode_rgb9e5,
    encode_rgb9e5,
    encode_rgbd,
    encode_rgbm,
    quantize,
)
from radiosity_addon.pages.image import read_image, write_exr
from radiosity_addon.pages.page_files import encode, page_paths, sidecar_path, write_pages, write_sidecar
from radiosity_addon.pages.page_format import COMPRESSIONS, FORMATS, PageFormat, Recipe
from radiosity_addon.pages.png import png_bytes, srgb_chunks, text_chunk

oiio = pytest.importorskip("OpenImageIO")
STOPS = 16


def sixteen_stops(size: int = 256, brightest: float = 23.7) -> np.ndarray:
    """Colours of every saturation in Rec.709, their largest channels over 16 stops."""
    random = np.random.default_rng(7)
    shares = random.random((size, size, 3)) ** 2
    shares /= shares.max(axis=-1, keepdims=True)
    shares[0, 0] = 1
    stops = random.random((size, size, 1)) * STOPS
    stops[0, 0] = 0
    return (brightest * shares * 2.0**-stops).astype(np.float32)


def written(folder: Path, page: np.ndarray, wanted: PageFormat, working=REC709) -> tuple[np.ndarray, Recipe, Path]:
    """The light that comes back by what the sidecar says, the recipe, and the file."""
    (path,) = page_paths(folder, "room", 1, wanted.suffix)
    with Transaction() as files:
        done = write_pages([page], [path], wanted, working, files, workers=2)
        write_sidecar(sidecar_path(folder, "room"), [path], done.recipe, files)
        files.commit()
    recipe = Recipe.from_dict(json.loads(sidecar_path(folder, "room").read_text("utf-8")))
    return recipe.decode(read_image(path)), recipe, path


LIMITS = {
    ("exr", "half"): 0.0005,
    ("exr", "float"): 0.0,
    ("hdr", "half"): 0.0040,
    ("rgbm", "half"): 0.0085,
    ("rgbd", "half"): 0.0085,
    ("logluv", "half"): 0.0006,
    ("rgb9e5", "half"): 0.0020,
}
"""Largest error, of a colour's largest channel: the format's half step, a trifle rounded up."""


@pytest.mark.parametrize(("name", "depth"), LIMITS)
def test_light_comes_back_over_16_stops_within_the_formats_step(name: str, depth: str, tmp_path: Path) -> None:
    page = sixteen_stops()
    back, _, _ = written(tmp_path, page, PageFormat(name, depth=depth))
    error = np.abs(back - page) / page.max(axis=-1, keepdims=True)
    assert error.max() <= LIMITS[name, depth]
    assert abs(((back - page) / page.max(axis=-1, keepdims=True)).mean()) < 0.1 * LIMITS[name, depth] + 1e-9


@pytest.mark.parametrize(("name", "step"), [("png8", 1 / 255), ("png16", 1 / 65535)])
@pytest.mark.parametrize("transfer", ["srgb", "linear"])
def test_pictures_come_back_within_a_step_with_their_exposure_undone(name, step, transfer, tmp_path: Path) -> None:
    page = np.random.default_rng(1).random((64, 64, 3), np.float32) * 4
    back, recipe, _ = written(tmp_path, page, PageFormat(name, exposure=-2.0, transfer=transfer))
    assert recipe.scale == 4
    steepest = 2.27 if transfer == "srgb" else 1.0  # slope of sRGB's curve at white
    np.testing.assert_allclose(back, page, rtol=0, atol=1.01 * 4 * step * steepest)


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_keeps_rows_and_black(name: str, tmp_path: Path) -> None:
    page = np.zeros((16, 16, 3), np.float32)
    page[0] = 0.5
    back, _, _ = written(tmp_path, page, PageFormat(name))
    np.testing.assert_allclose(back[0], 0.5, rtol=0.01)
    np.testing.assert_array_equal(back[1:], 0)


@pytest.mark.parametrize("name", FORMATS)
def test_a_black_bake_comes_back_black(name: str, tmp_path: Path) -> None:
    back, _, _ = written(tmp_path, np.zeros((16, 16, 3), np.float32), PageFormat(name))
    np.testing.assert_array_equal(back, 0)


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_no_number_or_negative_becomes_black_and_is_counted_or_mapped(name: str, tmp_path: Path) -> None:
    page = np.full((16, 16, 3), 0.5, np.float32)
    page[3, 4] = np.nan
    (path,) = page_paths(tmp_path, "room", 1, PageFormat(name).suffix)
    with Transaction() as files:
        done = write_pages([page], [path], PageFormat(name), REC709, files)
        files.commit()
    assert done.clamped == (3,)
    np.testing.assert_array_equal(done.recipe.decode(read_image(path))[3, 4], 0)


@pytest.mark.parametrize("name", ["exr", "hdr", "png16", "rgbm", "logluv", "rgb9e5"])
def test_a_narrower_space_is_reached_by_the_intent_and_left_by_the_recipe(name: str, tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    page = (0.3 + 0.2 * random.random((16, 16, 3))).astype(np.float32)
    back, recipe, _ = written(tmp_path, page, PageFormat(name, space="rec709"), working=ACESCG)
    assert recipe.space.name == "Linear Rec.709"
    np.testing.assert_allclose(back @ recipe.space.to(ACESCG).T, page, rtol=0.03)


def test_the_share_outside_is_told_before_and_after(tmp_path: Path) -> None:
    page = np.full((16, 16, 3), 0.5, np.float32)
    page[:4] = 0.0, 0.6, 0.0
    (path,) = page_paths(tmp_path, "room", 1, ".png")
    with Transaction() as files:
        done = write_pages([page], [path], PageFormat("png8"), REC2020, files)
        files.commit()
    assert (done.outside, done.left_outside) == (0.25, 0.0)


def test_pages_of_a_bake_share_one_recipe(tmp_path: Path) -> None:
    pages = [np.full((16, 16, 3), value, np.float32) for value in (0.01, 30.0)]
    paths = page_paths(tmp_path, "room", 2, ".png")
    with Transaction() as files:
        done = write_pages(pages, paths, PageFormat("rgbm"), REC709, files)
        files.commit()
    assert done.recipe.brightest == 30
    for page, path in zip(pages, paths, strict=True):
        np.testing.assert_allclose(done.recipe.decode(read_image(path)), page, rtol=0.01)


@given(st.floats(2.0**-14, RGB9E5_MAX, width=32), st.floats(0, 1, width=32), st.floats(0, 1, width=32))
def test_rgb9e5_errs_at_most_half_a_step_of_its_largest_channel(high: float, green: float, blue: float) -> None:
    color = np.array([[[high, high * np.float32(green), high * np.float32(blue)]]], np.float32)
    back = decode_rgb9e5(encode_rgb9e5(color))
    assert np.abs(back - color).max() <= high / 256 / 2 * 1.0001


def test_rgb9e5_is_laid_out_as_opengl_says() -> None:
    """1 = 256 * 2^(16 - 24): mantissas 256, exponent 16; worked out by hand from EXT_texture_shared_exponent."""
    word = int.from_bytes(encode_rgb9e5(np.ones((1, 1, 3), np.float32)).tobytes(), "little")
    assert word == 16 << 27 | 256 << 18 | 256 << 9 | 256
    assert encode_rgb9e5(np.full((1, 1, 3), 1e9, np.float32)).tobytes() == (0xFFFFFFFF).to_bytes(4, "little")


def test_rgb9e5_rounds_up_into_the_next_exponent() -> None:
    value = np.full((1, 1, 3), 1 - 2.0**-12, np.float32)
    np.testing.assert_array_equal(decode_rgb9e5(encode_rgb9e5(value)), 1)


def test_white_is_full_scale_in_rgbm_and_rgbd() -> None:
    white = np.full((1, 1, 3), 5.0, np.float32)
    assert encode_rgbm(white, 5.0).tolist() == [[[255, 255, 255, 255]]]
    assert encode_rgbd(white, 5.0).tolist() == [[[255, 255, 255, 1]]]


def test_dithering_keeps_the_mean_of_a_dark_wall() -> None:
    wall = np.broadcast_to(np.linspace(0.0101, 0.0199, 64, dtype=np.float32)[:, None, None], (64, 4096, 3))
    steps = quantize(wall, 8, dithered=True)
    np.testing.assert_allclose(steps.mean(axis=1, dtype=np.float64) / 255, wall[:, 0], rtol=0, atol=0.01 / 255)
    flat = quantize(wall, 8, dithered=False)
    assert np.abs(flat.mean(axis=1) / 255 - wall[:, 0]).max() > 0.4 / 255, "without it there are bands"


def test_dithering_leaves_what_lies_on_a_step() -> None:
    steps = np.arange(256, dtype=np.float32)[None, :, None].repeat(64, axis=0).repeat(3, axis=2)
    np.testing.assert_array_equal(quantize(steps / np.float32(255), 8, dithered=True), steps)


def test_dithering_does_not_depend_on_how_a_page_is_cut() -> None:
    page = np.random.default_rng(3).random((80, 8, 3), np.float32)
    parts = [quantize(page[start : start + 16], 8, True, first_row=start) for start in range(0, 80, 16)]
    np.testing.assert_array_equal(quantize(page, 8, True), np.concatenate(parts))


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in ("exr", "hdr")])
def test_threads_change_no_bit(name: str) -> None:
    page = np.clip(sixteen_stops(200) / 24, 0, 1)
    recipe = Recipe(name, REC709, transfer="srgb" if "png" in name else "linear")
    one, two = (encode(page, recipe, workers, dithered=True) for workers in (1, 2))
    np.testing.assert_array_equal(one, two)
    assert b"".join(png_bytes(one, workers=1)) == b"".join(png_bytes(two, workers=2))


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3, 4])
@settings(max_examples=15, deadline=None)
@given(height=st.integers(1, 400), width=st.integers(1, 30))
def test_others_read_our_png_files(kind, channels, height, width) -> None:
    pixels = np.random.default_rng(height).integers(0, np.iinfo(kind).max, (height, width, channels)).astype(kind)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.png"
        path.write_bytes(b"".join(png_bytes(pixels, workers=2)))
        np.testing.assert_array_equal(read_image(path)[::-1], pixels)


@pytest.mark.parametrize("height", [1, 128, 129, 1000])
def test_the_checksum_of_pieces_is_that_of_the_whole(height: int) -> None:
    pixels = np.random.default_rng(height).integers(0, 255, (height, 33, 3), np.uint8)
    stream = io.BytesIO(b"".join(png_bytes(pixels, workers=2))[8:])
    data = b""
    while head := stream.read(8):
        content = stream.read(int.from_bytes(head[:4], "big"))
        data += content if head[4:] == b"IDAT" else b""
        stream.read(4)
    assert len(zlib.decompress(data)) == height * (33 * 3 + 1)  # which raises where the checksum is wrong


def chunks(file: bytes) -> dict[bytes, bytes]:
    found: dict[bytes, bytes] = {}
    stream = io.BytesIO(file[8:])
    while head := stream.read(8):
        found[head[4:]] = stream.read(int.from_bytes(head[:4], "big"))
        stream.read(4)
    return found


@pytest.mark.parametrize(
    ("wanted", "there", "absent"),
    [
        (PageFormat("png8"), {b"sRGB", b"gAMA", b"cHRM"}, {b"cICP"}),
        (PageFormat("png8", space="p3"), {b"cICP", b"gAMA", b"cHRM"}, {b"sRGB"}),
        (PageFormat("png16", transfer="linear"), {b"gAMA", b"cHRM"}, {b"sRGB", b"cICP"}),
        (PageFormat("rgbm"), {b"tEXt"}, {b"sRGB", b"gAMA", b"cHRM", b"cICP"}),
    ],
    ids=["sRGB", "Display P3", "linear", "data"],
)
def test_a_png_says_what_its_numbers_are(wanted, there, absent, tmp_path: Path) -> None:
    _, _, path = written(tmp_path, np.full((16, 16, 3), 0.5, np.float32), wanted)
    found = chunks(path.read_bytes())
    assert there <= set(found)
    assert not absent & set(found)
    if wanted.transfer == "linear":
        assert int.from_bytes(found[b"gAMA"], "big") == 100000


def test_a_remark_is_readable() -> None:
    file = b"".join(png_bytes(np.zeros((1, 1, 3), np.uint8), [*srgb_chunks(), text_chunk("Comment", "hello")]))
    assert chunks(file)[b"tEXt"] == b"Comment\0hello"


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("depth", ["half", "float"])
def test_exr_is_lossless_under_every_compression_and_says_its_space(compression, depth, tmp_path: Path) -> None:
    page = sixteen_stops(64)
    path = tmp_path / "a.exr"
    with Transaction() as files:
        write_exr(path, page, files, depth=depth, compression=compression, space=REC2020)
        files.commit()
    spec = oiio.ImageInput.open(str(path)).spec()
    assert (str(spec.format), spec["compression"]) == (depth, compression)
    np.testing.assert_allclose(spec["chromaticities"], [*REC2020.primaries.ravel(), 0.3127, 0.3290], atol=1e-6)
    kind = np.float16 if depth == "half" else np.float32
    np.testing.assert_array_equal(read_image(path), page.astype(kind))


def test_an_exr_in_the_working_space_is_not_touched_by_an_intent(tmp_path: Path) -> None:
    page = np.full((16, 16, 3), -0.25, np.float32)  # as a lamp of negative power leaves it
    back, _, _ = written(tmp_path, page, PageFormat("exr", intent="perceptual"), working=ACESCG)
    np.testing.assert_array_equal(back, page)


def test_an_intent_for_the_whole_bake_sees_all_pages(tmp_path: Path) -> None:
    mild, vivid = (np.broadcast_to(np.float32(color), (16, 16, 3)) for color in ((0.5, 0.45, 0.1), (0, 1, 0)))
    paths = page_paths(tmp_path, "room", 2, ".png")
    with Transaction() as files:
        done = write_pages([mild, vivid], paths, PageFormat("png16", intent="saturation"), ACESCG, files)
        files.commit()
    mapping = GamutMap(ACESCG, REC709, "saturation", 1.0)
    expected = mapping.apply(mild, mapping.survey([mild, vivid]))
    np.testing.assert_allclose(done.recipe.decode(read_image(paths[0])), expected, atol=1e-4)


@pytest.mark.parametrize(
    ("wrong", "subject"),
    [
        ({"format": "bmp"}, "Format"),
        ({"depth": "double"}, "Depth"),
        ({"compression": "lzma"}, "Compression"),
        ({"transfer": "log"}, "Transfer function"),
        ({"intent": "vivid"}, "Intent"),
        ({"space": "cmyk"}, "Space"),
        ({"exposure": float("nan")}, "Exposure"),
        ({"exposure": 40.0}, "Exposure"),
        ({"format": "png8", "space": "acescg"}, "Space"),
    ],
)
def test_a_choice_that_is_none_is_refused(wrong, subject: str) -> None:
    with pytest.raises(SettingsError, match=f"^{subject}: "):
        PageFormat(**wrong)
