# SPDX-License-Identifier: GPL-3.0-or-later
"""A bake's report as one HTML page that holds everything it shows: for a screen by day or night, and for paper."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Float32
from ..color.spaces import RGBSpace, xy_of
from ..color.spectra import dominant_wavelength
from ..errors import OutputError, SceneError
from ..files import Transaction, write_text
from ..pages.image import read_image
from ..pages.page_format import Recipe
from ..progress import duration, short_count
from .overview import data_uri
from .pictures import LUMENS_PER_WATT, shrunk
from .plots import chromaticity_diagram, histogram, residual_curve
from .report_figures import figure, pages_section, share_text, short_text

PICTURE_EDGE = 384
"""Pixels along the edge of a page's picture, at most."""
MOST_ROWS = 12
"""Objects in one table; more go into two, side by side."""
STYLE = Path(__file__).with_name("report_page.css")
SPACE_KEYS = {"rec709": "Rec.709, sRGB", "p3": "Display P3", "rec2020": "Rec.2020", "acescg": "ACEScg"}


def write_report_page(report: Path, page: Path) -> None:
    """Write the page of a report, whole or not at all.

    Raises:
        SceneError: the report is none
        OutputError: the page can't be written
    """
    html = report_page(report)
    with Transaction() as files:
        files.make_folder(page.parent)
        write_text(page, html, files)
        files.commit()


def report_page(report: Path) -> str:
    """The HTML of a report that `bake --report` has written; pages and renders are read from where it says they lie.

    Raises:
        SceneError: it is no such report
    """
    try:
        known = json.loads(report.read_text(encoding="utf-8"))
        return _page(known, report.parent / known["folder"])
    except (ValueError, KeyError, TypeError, UnicodeDecodeError) as error:
        raise SceneError(
            str(report), f"it is no report of a bake ({type(error).__name__}: {error})", "Bake with --report again"
        ) from error


def _page(known: dict[str, Any], folder: Path) -> str:
    pages = _read_pages(known, folder)
    space = _space(known)
    sections = [
        _head(known),
        _renders(known, folder),
        pages_section(known, pages, space),
        _light(known),
        _solver(known),
        _files(known),
        _objects(known),
    ]
    title = escape(known["scene"] or "Bake")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}: radiosity bake</title>\n<style>\n{STYLE.read_text(encoding='utf-8')}</style>\n</head>\n"
        f"<body>\n<main>\n{''.join(section for section in sections if section)}"
        "<footer>Light is H / pi, irradiance over pi, in linear RGB. Lux are "
        f"{LUMENS_PER_WATT:g} lumens a watt of luminance, as Blender's glTF exporter counts them: a lamp's watts are "
        "taken as light, not as what it draws.</footer>\n</main>\n</body>\n</html>\n"
    )


def _space(known: dict[str, Any]) -> RGBSpace:
    said = known["files"] or known["working_space"]
    name = said["space"] if known["files"] else said["name"]
    return RGBSpace(name, np.array(said["rgb_to_xyz_d65"], np.float64))


def _read_pages(known: dict[str, Any], folder: Path) -> list[Float32 | None]:
    """The light of each page, small; None where its file is not to be found."""
    if known["files"] is None:
        return [None] * len(known["pages"])
    recipe = Recipe.from_dict(known["files"])
    found: list[Float32 | None] = []
    for page in known["pages"]:
        path = folder / page["file"] if page["file"] else None
        try:
            light = None if path is None or not path.is_file() else recipe.decode(read_image(path))
        except OutputError:
            light = None
        found.append(None if light is None else shrunk(np.maximum(np.nan_to_num(light), 0)[::-1], PICTURE_EDGE))
    return found


def _head(known: dict[str, Any]) -> str:
    settings, light = known["settings"], known["light"]
    width, height = known["pages"][0]["size"]
    count = len(known["pages"])
    figures = [
        ("Time", duration(known["seconds"]) if known["seconds"] >= 60 else f"{known['seconds']:.1f} <small>s</small>"),
        ("Objects", f"{len(known['objects']):,}"),
        ("Pages", f"{count} <small>of {width} × {height}</small>"),
        ("Texels", short_count(known["texels"])),
        ("Patches", short_count(known["patches"])),
        ("Rays", short_count(known["rays"])),
        ("Left to bounce", share_text(known["residual"])),
    ]
    error = known.get("estimated_error")
    if error:
        text = f"{error['rms']:.1%} <small>± {error['rms_uncertainty']:.1%}</small>"
        figures.append(("Error, RMS, estimated", text))
    if light:
        lux = np.pi * LUMENS_PER_WATT * light["mean"]
        figures.append(("Mean illuminance", f"{short_text(lux)} <small>lx</small>"))
    warnings = "".join(f"<li>{escape(warning)}</li>" for warning in known["warnings"])
    cells = "".join(f"<div><dt>{name}</dt><dd>{value}</dd></div>" for name, value in figures)
    words = [f"{settings['quality']} quality", f"{settings['solver']} solver", known["working_space"]["name"]]
    return (
        f'<header><p class="kind">Radiosity bake</p><h1>{escape(known["scene"] or "Bake")}</h1>'
        f'<p class="quiet">{escape(" · ".join(words))}</p></header>\n'
        f'<dl class="figures">{cells}</dl>\n' + (f'<ul class="warnings">{warnings}</ul>\n' if warnings else "")
    )


def _renders(known: dict[str, Any], folder: Path) -> str:
    captions = {"before": "Before: path traced from its lamps", "after": "After: shown by its lightmaps"}
    figures = []
    for name, caption in captions.items():
        path = known["renders"][name]
        if path and (folder / path).is_file():
            figures.append(figure(data_uri((folder / path).read_bytes()), caption))
    if not figures:
        return ""
    title = "Before and after" if len(figures) == 2 else "The lit scene"
    return f'<section><h2>{title}</h2><div class="two">{"".join(figures)}</div></section>\n'


def _light(known: dict[str, Any]) -> str:
    light = known["light"]
    if not light:
        return ""
    stops, colors = light["stops"], light["chromaticities"]
    bars = histogram(stops["first"], stops["step"], stops["texels"], "stops: log2 of luminance in W/(m2 sr)")
    mean = xy_of(np.array(light["mean_xyz"]))
    wavelength, purity = dominant_wavelength(mean)
    tint = f"{wavelength:.0f} nm" if wavelength > 0 else f"complement of {-wavelength:.0f} nm"
    said = f"All light together: x {mean[0]:.4f}, y {mean[1]:.4f}; hue {tint}, purity {share_text(float(purity))}."
    if not light["brightest"]:
        said = "There is no light."
    diagram = chromaticity_diagram(colors["png"], colors["x"], colors["y"], (float(mean[0]), float(mean[1])))
    keys = "".join(
        f'<li><svg viewBox="0 0 30 10"><line class="gamut gamut-{word}" x1="0" x2="30" y1="5" y2="5"/></svg>{name}</li>'
        for word, name in SPACE_KEYS.items()
    )
    keys += '<li><svg viewBox="0 0 30 10"><line class="planck" x1="0" x2="30" y1="5" y2="5"/></svg>black bodies</li>'
    table = "".join(
        f'<tr><th>{name}</th><td class="number">{short_text(light[key])} W/(m2 sr)</td>'
        f'<td class="number">{short_text(light[key] * np.pi * LUMENS_PER_WATT)} lx</td></tr>'
        for name, key in (("Darkest", "darkest"), ("Mean", "mean"), ("Brightest", "brightest"))
    )
    return (
        '<section><h2>Light</h2><div class="two"><div class="stack"><div class="card"><h3>How bright</h3>'
        f"{bars}<table>{table}</table></div>{_balance(known)}</div>"
        f'<div class="card"><h3>Which colours</h3>{diagram}<ul class="key">{keys}</ul><p class="quiet">{said} '
        "Black: the bake's texels. Ring: their mean.</p></div></div></section>\n"
    )


def _balance(known: dict[str, Any]) -> str:
    balance = known["balance"]
    if not balance or not balance["emitted"] > 0:
        return ""
    parts = [(name, balance[name] / balance["emitted"]) for name in ("absorbed", "escaped", "unshot")]
    segments = "".join(f'<i class="{name}" style="width:{max(share, 0):.3%}"></i>' for name, share in parts)
    keys = "".join(f'<li><i class="dot {name}"></i>{name} {share_text(share)}</li>' for name, share in parts)
    missing = abs(1 - sum(share for _, share in parts))
    return (
        f'<div class="card"><h3>Where the light went</h3><div class="balance">{segments}</div>'
        f'<ul class="key">{keys}</ul><p class="quiet">Of {short_text(balance["emitted"])} W that surfaces sent out the '
        f"first time, their own light and the lamps'. What does not add up: {missing:.0e} of it.</p></div>"
    )


def _solver(known: dict[str, Any]) -> str:
    longest = max((stage["seconds"] for stage in known["stages"]), default=0) or 1
    stages = "".join(
        f"<span>{escape(stage['name'])}</span>"
        f'<span class="track"><i style="width:{stage["seconds"] / longest:.2%}"></i></span>'
        f'<span class="value">{stage["seconds"]:.2f} s</span>'
        for stage in known["stages"]
    )
    curve = residual_curve(known["residuals"], known["settings"]["tolerance"])
    return (
        '<section><h2>How it was solved</h2><div class="two">'
        f'<div class="card"><h3>Share of the light left to bounce</h3>{curve}</div>'
        f'<div class="card"><h3>Time of the stages</h3><div class="rows">{stages}</div></div></div></section>\n'
    )


def _files(known: dict[str, Any]) -> str:
    said = known["files"]
    if not said:
        return ""
    rows = [
        ("Format", escape(said["format"])),
        ("Color space", escape(said["space"])),
        ("Rendering intent", escape(said["intent"])),
        ("Outside the gamut before", share_text(said["outside_before"])),
        ("Outside the gamut after", share_text(said["outside_after"])),
        ("To decode", f"<code>{escape(said['decode'])}</code>"),
    ]
    rows += [(name, f"{said[name]:.6g}") for name in ("scale", "brightest") if said[name] != 1]
    light = known["light"]
    if light:
        off = light["difference"]
        text = f"mean {off['mean']:.3f}, 95 % below {off['percentile_95']:.3f}, at most {off['largest']:.3f}"
        rows.append(("Color difference, CIEDE2000", text))
    table = "".join(f"<tr><th>{name}</th><td>{value}</td></tr>" for name, value in rows)
    return f'<section><h2>Files</h2><div class="card"><table>{table}</table></div></section>\n'


def _objects(known: dict[str, Any]) -> str:
    rows = [
        f'<tr><td>{escape(row["source"])}</td><td class="number">{row["page"] + 1}</td>'
        f'<td class="number">{row["texels"]:,}</td><td class="number">{short_text(row["density"] or 0)}</td></tr>'
        for row in sorted(known["objects"], key=lambda row: -row["texels"])
    ]
    names = ("Page", "Texels", "Texels/m")
    head = "<tr><th>Object</th>" + "".join(f'<th class="number">{name}</th>' for name in names) + "</tr>"
    half = -(-len(rows) // 2) if len(rows) > MOST_ROWS else len(rows)
    tables = "".join(
        f'<div class="card"><table>{head}{"".join(part)}</table></div>' for part in (rows[:half], rows[half:]) if part
    )
    skipped = "".join(
        f"<tr><td>{escape(row['object'])}</td><td>{escape(row['reason'])}</td></tr>" for row in known["skipped"]
    )
    left_out = f'<h2>Not baked</h2><div class="card"><table>{skipped}</table></div>' if skipped else ""
    return f'<section><h2>Objects</h2><div class="two">{tables}</div>{left_out}</section>\n'
