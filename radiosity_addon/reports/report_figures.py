# SPDX-License-Identifier: GPL-3.0-or-later
"""The pages of a bake in its report: as seen, in false colours, and maps of what they are like."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from ..arrays import Float32
from ..color.spaces import RGBSpace
from ..pages.encodings import UInt8
from ..pages.png import gray_pixels
from .pictures import (
    as_seen,
    color_scale,
    exposure_of,
    false_colors,
    illuminance,
    marked,
    masked,
    picture_uri,
    scale_ends,
)
from .plots import nice_numbers, scale_legend


def pages_section(known: dict[str, Any], pages: Sequence[Float32 | None], space: RGBSpace) -> str:
    """The section that shows the pages, light, density, error and mask, and the legends of their scales.

    Args:
        known: the report
        pages: light (H, W, 3) of each, first row on top; None where its file is not to be found
        space: of that light
    """
    found = [page for page in pages if page is not None]
    ends = scale_ends([illuminance(page, space) for page in found])
    gain = exposure_of(found, space) if found else 1.0
    mapped = [page["maps"] for page in known["pages"] if "maps" in page]
    highs = {name: max((maps[name]["high"] for maps in mapped), default=1.0) for name in ("density", "error")}
    rows = []
    for number, (page, light) in enumerate(zip(known["pages"], pages, strict=True), 1):
        coverage = _decoded(page["maps"]["coverage"]) if "maps" in page else np.ones((1, 1), np.float32)
        figures = _pictures(light, coverage, space, gain, ends)
        if light is None:
            figures = f'<p class="nothing">{escape(page["file"] or "packed into the .blend")}<br>not found</p>'
        if "maps" in page:
            figures += _page_maps(page["maps"], coverage, highs)
        name = f"Page {number}: {escape(page['image'])}, {page['size'][0]} × {page['size'][1]}"
        rows.append(f'<div class="page"><h3>{name}</h3>{figures}</div>')
    legends = ""
    if found:
        span = np.log(ends[1] / ends[0])
        ticks = [(np.log(number / ends[0]) / span, short_text(number)) for number in nice_numbers(*ends)]
        legends += _legend(ticks, "illuminance, lux")
    if mapped:
        quarters = (0, 0.25, 0.5, 0.75, 1)
        legends += _legend([(part, short_text(part * highs["density"])) for part in quarters], "texels per metre")
        lost = [(part, share_text(part * highs["error"])) for part in (0, 0.5, 1)]
        legends += _legend(lost, "error of the file, of a colour's largest channel")
    return f'<section><h2>Pages</h2>{"".join(rows)}<div class="legends">{legends}</div></section>\n'


def _pictures(light: Float32 | None, coverage: Float32, space: RGBSpace, gain: float, ends: tuple[float, float]) -> str:
    if light is None:
        return ""
    seen = masked(as_seen(light, space, gain), coverage)
    lux = masked(false_colors(illuminance(light, space), *ends, logarithmic=True), coverage)
    return figure(picture_uri(seen), "<b>Light</b>as a camera sees it") + figure(
        picture_uri(lux), "<b>Illuminance</b>false colours"
    )


def _page_maps(maps: dict[str, Any], coverage: Float32, highs: dict[str, float]) -> str:
    outside = _decoded(maps["outside"])
    there = "<b>Outside the gamut</b>" + ("magenta" if outside.any() else "nothing is")
    figures = {
        "<b>Density</b>texels per metre": _scaled(maps["density"], highs["density"]),
        f"<b>Error of the file</b>at most {share_text(maps['error']['high'])}": _scaled(maps["error"], highs["error"]),
        there: marked(np.full_like(outside, 0.75), outside > 0),
    }
    return "".join(figure(picture_uri(masked(drawn, coverage)), text, "small") for text, drawn in figures.items())


def figure(uri: str, caption: str, kind: str = "") -> str:
    """A picture with its caption, in HTML."""
    words = re.sub("<[^>]*>", " ", caption).strip()
    return f'<figure class="{kind}"><img src="{uri}" alt="{words}"><figcaption>{caption}</figcaption></figure>'


def _legend(ticks: Sequence[tuple[float, str]], label: str) -> str:
    return scale_legend([(float(share), text) for share, text in ticks], picture_uri(color_scale()[None]), label)


def _decoded(map_known: dict[str, Any]) -> Float32:
    """A map of the report as numbers (h, w) from 0 to 1, its first row on top."""
    raw = base64.b64decode(map_known["png"].partition(",")[2])
    return gray_pixels(raw).astype(np.float32) / np.float32(255)


def _scaled(map_known: dict[str, Any], high: float) -> UInt8:
    """A map in false colours whose scale ends at `high`."""
    return false_colors(_decoded(map_known) * map_known["high"] / high, 0.0, 1.0, logarithmic=False)


def share_text(value: float | None) -> str:
    """A share in per cent, small ones by their power of ten."""
    if value is None:
        return "unknown"
    if value == 0:
        return "0 %"
    return f"{100 * value:.3g} %" if value >= 1e-3 else f"{value:.1e}".replace("e-0", "e-")


def short_text(value: float) -> str:
    """Three digits, thousands apart."""
    if value and not 1e-3 <= abs(value) < 1e6:
        return f"{value:.2e}"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
