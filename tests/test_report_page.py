# SPDX-License-Identifier: GPL-3.0-or-later
"""The page of a report holds everything it shows, and says so where something is missing."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from radiosity_addon import cli
from radiosity_addon.bake import Baked, bake
from radiosity_addon.chunks import finish
from radiosity_addon.color.spaces import ACESCG, REC709
from radiosity_addon.errors import SceneError
from radiosity_addon.files import Transaction
from radiosity_addon.pages.page_files import page_paths, write_pages
from radiosity_addon.pages.page_format import PageFormat
from radiosity_addon.pages.png import gray_pixels, png_bytes
from radiosity_addon.reports.overview import Overview, overview
from radiosity_addon.reports.pictures import (
    LUMENS_PER_WATT,
    as_seen,
    color_scale,
    false_colors,
    illuminance,
    marked,
    masked,
    shrunk,
    tongue,
)
from radiosity_addon.reports.plots import histogram, nice_numbers, residual_curve
from radiosity_addon.reports.report import BakedObject, Page, Report, write_report
from radiosity_addon.reports.report_page import report_page
from radiosity_addon.settings import BakeSettings
from tests.shapes import furnished_room

pytest.importorskip("OpenImageIO")
SETTINGS = BakeSettings(quality="draft", page_size=64, threads=1)
VOID = {"meta", "img", "br"}


@pytest.fixture(scope="module")
def baked() -> Baked:
    return finish(bake(furnished_room(), SETTINGS))


def looked_at(baked: Baked, folder: Path, wanted: PageFormat, working=REC709) -> tuple[Overview, list[Path], object]:
    paths = page_paths(folder, "room", len(baked.pages), wanted.suffix)
    with Transaction() as files:
        written = write_pages(baked.pages, paths, wanted, working, files)
        files.commit()
    return overview(baked.pages, baked.elements, paths, written, wanted, working), paths, written


def write(baked: Baked, folder: Path, wanted: PageFormat | None = None, **changes: object) -> Path:
    wanted = wanted or PageFormat()
    seen, paths, written = looked_at(baked, folder, wanted)
    size = baked.atlas.size
    fields: dict[str, object] = {
        "pages": [Page(f"Radiosity {i + 1}", path, (size, size), seen.maps[i]) for i, path in enumerate(paths)],
        "objects": [BakedObject("Wall <b>", "Wall", 0, 120, 16.5)],
        "skipped": [("Hair & co", "has no surface")],
        "stages": [(stage.name, stage.seconds, stage.rays) for stage in baked.stages],
        "seconds": 2.0,
        "texels": baked.texels,
        "patches": baked.patches,
        "rays": baked.rays,
        "residual": baked.residual,
        "warnings": ["Lamp <Key>: negative energy"],
        "name": "room",
        "settings": SETTINGS,
        "residuals": baked.residuals,
        "balance": baked.balance,
        "overview": seen,
        "files": written,
    }
    with Transaction() as files:
        write_report(folder / "report.json", Report(**{**fields, **changes}), folder, files)  # type: ignore[arg-type]
        files.commit()
    return folder / "report.json"


class Checker(HTMLParser):
    """Whether every element is closed, and where pictures come from."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sources: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.sources += [value or "" for name, value in attributes if name in ("src", "href")]

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.sources += [value or "" for name, value in attributes if name in ("src", "href")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def checked(html: str) -> Checker:
    found = Checker()
    found.feed(html)
    found.close()
    assert not found.open
    return found


def test_the_page_is_well_formed_and_holds_all_its_pictures(baked: Baked, tmp_path: Path) -> None:
    found = checked(report_page(write(baked, tmp_path)))
    assert len(found.sources) >= 8
    for source in found.sources:
        assert source.startswith("data:image/png;base64,")
        assert base64.b64decode(source.partition(",")[2], validate=True)[:4] == b"\x89PNG"


def test_the_page_asks_nothing_of_the_network_and_runs_no_script(baked: Baked, tmp_path: Path) -> None:
    html = report_page(write(baked, tmp_path))
    assert not re.search(r"https?://|<script|@import|<link", html)


def test_the_page_suits_dark_screens_and_paper(baked: Baked, tmp_path: Path) -> None:
    html = report_page(write(baked, tmp_path))
    assert "prefers-color-scheme: dark" in html
    assert "@media print" in html


def test_the_page_has_every_section_and_names_what_users_named_as_they_wrote_it(baked: Baked, tmp_path: Path) -> None:
    text = checked(report_page(write(baked, tmp_path))).text
    for wanted in (
        "Pages",
        "How bright",
        "Which colours",
        "How it was solved",
        "Where the light went",
        "Files",
        "Objects",
    ):
        assert wanted in text
    assert "Wall <b>" in text
    assert "Hair & co" in text
    assert "Lamp <Key>: negative energy" in text


def test_before_and_after_are_shown_where_they_are(baked: Baked, tmp_path: Path) -> None:
    picture = tmp_path / "after.png"
    picture.write_bytes(b"".join(png_bytes(np.zeros((4, 4, 3), np.uint8))))
    plain = checked(report_page(write(baked, tmp_path)))
    one = checked(report_page(write(baked, tmp_path, after=picture)))
    both = checked(report_page(write(baked, tmp_path, after=picture, before=picture)))
    assert len(both.sources) == len(one.sources) + 1 == len(plain.sources) + 2
    assert "Before and after" in both.text


def test_a_page_whose_file_is_gone_says_so(baked: Baked, tmp_path: Path) -> None:
    report = write(baked, tmp_path)
    for path in tmp_path.glob("*.exr"):
        path.unlink()
    assert "not found" in checked(report_page(report)).text


def test_a_bake_that_was_not_looked_at_still_has_a_page(baked: Baked, tmp_path: Path) -> None:
    pages = [Page("Radiosity 1", None, (64, 64))]
    report = write(baked, tmp_path, overview=None, files=None, balance=None, residuals=(), pages=pages)
    checked(report_page(report))


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"folder": "."}'])
def test_what_is_no_report_is_an_error_that_names_it(text: str, tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    path.write_text(text)
    with pytest.raises(SceneError, match=r"report\.json: it is no report of a bake"):
        report_page(path)


def test_the_command_writes_the_page(baked: Baked, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report, page = write(baked, tmp_path), tmp_path / "new" / "page.html"
    assert cli.main(["report", str(report), "-o", str(page)]) == 0
    assert page.read_text("utf-8").startswith("<!doctype html>")
    assert capsys.readouterr().out == f"Saved {page}\n"


@pytest.mark.parametrize("words", [["report"], ["report", "r.json"], ["report", "r.json", "-o", "page.pdf"]])
def test_the_command_wants_a_report_and_a_page(words: list[str]) -> None:
    assert cli.main(words) == 2


def test_the_overview_counts_every_texel_once(baked: Baked, tmp_path: Path) -> None:
    seen, _, _ = looked_at(baked, tmp_path, PageFormat())
    lit = sum(seen.stops)
    assert baked.texels * 0.95 < lit <= baked.texels
    assert seen.darkest <= seen.mean <= seen.brightest


def test_the_density_of_the_overview_is_the_atlass(baked: Baked, tmp_path: Path) -> None:
    seen, _, _ = looked_at(baked, tmp_path, PageFormat())
    density = seen.maps[0]["density"]
    drawn = density.values[density.values > 0] / 255 * density.high
    assert np.median(drawn) == pytest.approx(float(np.median(baked.atlas.density)), rel=0.05)


def test_the_error_of_the_overview_is_the_formats(baked: Baked, tmp_path: Path) -> None:
    errors = {
        name: looked_at(baked, tmp_path, PageFormat(name, **more))[0].maps[0]["error"].high
        for name, more in {"exr": {"depth": "half"}, "rgbm": {}, "png8": {"exposure": -4.0}}.items()
    }
    assert errors["exr"] < 0.0006
    assert errors["exr"] < errors["rgbm"] < 0.01 < errors["png8"]


def test_a_file_that_loses_nothing_has_no_colour_difference(baked: Baked, tmp_path: Path) -> None:
    seen, _, _ = looked_at(baked, tmp_path, PageFormat(depth="float"))
    assert max(seen.difference) < 1e-6


def test_the_mask_shows_what_files_can_not_hold(baked: Baked, tmp_path: Path) -> None:
    inside, _, _ = looked_at(baked, tmp_path, PageFormat("png8", exposure=-8.0))
    outside, _, _ = looked_at(baked, tmp_path, PageFormat("png8", exposure=8.0))
    assert not inside.maps[0]["outside"].values.any()
    assert outside.maps[0]["outside"].values.any()


def test_a_small_map_comes_back_from_its_address() -> None:
    values = np.random.default_rng(1).integers(0, 256, (37, 21), np.uint8)
    np.testing.assert_array_equal(gray_pixels(b"".join(png_bytes(values[:, :, None]))), values)


@pytest.mark.parametrize("spoil", [lambda file: file[:40], lambda file: b"GIF" + file[3:], lambda file: file[:-30]])
def test_a_spoilt_map_is_an_error(spoil: Callable[[bytes], bytes]) -> None:
    file = b"".join(png_bytes(np.random.default_rng(1).integers(0, 256, (9, 9, 1), np.uint8)))
    with pytest.raises(ValueError, match="PNG"):
        gray_pixels(spoil(file))


def test_illuminance_is_683_lumens_a_watt_of_luminance() -> None:
    page = np.full((2, 2, 3), 1 / np.pi, np.float32)
    np.testing.assert_allclose(illuminance(page, ACESCG), LUMENS_PER_WATT, rtol=1e-6)


def test_the_colour_scale_grows_evenly_lighter() -> None:
    from radiosity_addon.color.oklab import to_oklab
    from radiosity_addon.color.transfer import srgb_decode

    light = to_oklab(srgb_decode(color_scale() / 255), REC709)[:, 0]
    steps = np.diff(light)
    assert (steps[::8] > -0.004).all()
    np.testing.assert_allclose(light, np.linspace(light[0], light[-1], len(light)), atol=0.02)


def test_false_colours_end_at_the_ends_of_the_scale() -> None:
    found = false_colors(np.array([[1.0, 10.0, 100.0, 1e9]]), 1.0, 100.0, logarithmic=True)[0]
    np.testing.assert_array_equal(found, color_scale()[[0, 128, 255, 255]])


def test_a_picture_is_clear_where_nothing_is() -> None:
    coverage = np.array([[0.0, 0.2], [1.0, 0.0]], np.float32)
    found = masked(np.zeros((4, 4, 3), np.uint8), coverage)
    np.testing.assert_array_equal(found[::2, ::2, 3], [[0, 255], [255, 0]])


def test_a_mark_stands_out() -> None:
    found = marked(np.zeros((1, 2), np.float32), np.array([[True, False]]))
    assert found[0, 0].tolist() == [255, 0, 160]
    assert len(set(found[0, 1].tolist())) == 1


def test_shrinking_keeps_the_mean_light() -> None:
    page = np.random.default_rng(2).random((64, 64, 3), np.float32)
    np.testing.assert_allclose(shrunk(page, 16).mean(axis=(0, 1)), page.mean(axis=(0, 1)), rtol=1e-5)


def test_a_grey_page_is_seen_grey() -> None:
    seen = as_seen(np.full((4, 4, 3), 0.18, np.float32), REC709, 1.0)
    assert abs(seen.astype(int) - 118).max() <= 1


def test_the_tongue_is_white_at_white() -> None:
    at = tongue(181, (0.8, 0.9))[round(180 * (1 - 0.3290 / 0.9)), round(180 * 0.3127 / 0.8)]
    assert at.min() > 245


def test_the_histogram_shows_only_stops_that_have_texels() -> None:
    svg = histogram(-20.0, 0.25, [0] * 40 + [5, 10] + [0] * 118, "stops")
    assert svg.count('class="bar"') == 2
    assert "-10.00 to -9.75 stops: 33.33%" in svg


def test_plots_of_nothing_say_so() -> None:
    assert "No light" in histogram(-20.0, 0.25, [0] * 10, "stops")
    assert "No steps" in residual_curve([], 1e-4)


@pytest.mark.parametrize(
    ("low", "high", "numbers"), [(1, 10, [1, 2, 5, 10]), (0.1, 1e5, [0.1, 1, 10, 100, 1e3, 1e4, 1e5])]
)
def test_ticks_are_round_numbers(low: float, high: float, numbers: list[float]) -> None:
    assert nice_numbers(low, high) == pytest.approx(numbers)
