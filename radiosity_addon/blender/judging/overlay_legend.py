# SPDX-License-Identifier: GPL-3.0-or-later
"""The legend of an overlay: what its colours mean, in words, numbers and a scale."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ...pages.encodings import UInt8
from ...reports.pictures import LUMENS_PER_WATT, color_scale, density_scale
from ...reports.plots import nice_numbers
from ...reports.report_figures import share_text, short_text

if TYPE_CHECKING:
    from .overlay_data import Density, Pages
    from .overlay_drawing import Look

WIDTH, MARGIN, BAR, PADDING = 300, 20, 14, 14
"""Of a box with a bar, around it, height of the bar, inside of the box; pixels at a resolution scale of 1."""
TITLE, TEXT, LINE = 14, 12, 42
"""Sizes of type, and letters of a line."""
GROUND, WORDS, QUIET = (0.045, 0.045, 0.05, 1.0), (0.96, 0.96, 0.96, 1.0), (0.74, 0.74, 0.76, 1.0)
FEW_TICKS = 3
"""A scale with fewer round numbers has its ends and its middle written instead."""
UNITS = {"lux": (1.0, "lx"), "watts": (1 / LUMENS_PER_WATT, "W/m²")}
"""What lux are multiplied by, and what is then written."""


@dataclass(frozen=True, eq=False)
class Legend:
    """What is written beside an overlay.

    Attributes:
        title: in bold
        scale: (256, 3) colours of a bar, or None
        ticks: shares of the bar's length, and what is written below them
        notes: lines of small type
    """

    title: str
    scale: UInt8 | None
    ticks: tuple[tuple[float, str], ...]
    notes: tuple[str, ...]


def legend_of(look: Look, pages: Pages, density: Density | None, charts: int, unit: str) -> Legend:
    """The legend of an overlay.

    Args:
        density: where that is shown
        charts: in view
        unit: of UNITS
    """
    if look.overlay == "illuminance":
        factor, sign = UNITS[unit]
        low, high = (end * factor for end in look.ends)
        span, numbers = np.log(high / low), nice_numbers(low, high)
        if len(numbers) < FEW_TICKS:
            numbers = [low, float(np.sqrt(low * high)), high]
        ticks = [(float(np.log(number / low) / span), short_text(number)) for number in numbers]
        title = "Illuminance" if unit == "lux" else "Irradiance"
        mean = f"Mean of the lightmaps: {short_text(pages.mean_lux * factor)} {sign}"
        return Legend(f"{title}, {sign}", color_scale(), _apart(ticks), (mean,))
    if look.overlay == "density" and density is not None:
        return _density_legend(density)
    patches, used, invalid = pages.counts if look.overlay in ("patches", "invalid") else (0, 0, 0)
    if look.overlay == "patches":
        each = used / max(patches, 1)
        notes = (f"{patches:,} patches, {each:,.0f} texels each on average", "Each shade is one patch of the solver")
        return Legend("Patches", None, (), notes)
    if look.overlay == "invalid":
        notes = (
            f"{invalid:,} of {used:,} texels ({share_text(invalid / max(used, 1))})",
            "Striped: inside other geometry,",
            "filled from their neighbours",
        )
        return Legend("Invalid Texels", None, (), notes)
    if look.overlay == "charts":
        return Legend("Charts", None, (), (f"{charts:,} charts in view", "Dark lines are seams"))
    return Legend("Lighting", None, (), ("Light alone, without surface colours", f"Shown {np.log2(look.gain):+.1f} EV"))


def _density_legend(density: Density) -> Legend:
    steps = ((0.0, 0.25), (0.25, 0.5), (0.5, 1.0), (0.75, 2.0), (1.0, 4.0))
    loose, half, dense = density.spread
    if density.known:
        ticks = tuple((share, short_text(density.target * step)) for share, step in steps)
        spread = f"Median {short_text(half)}, 90 % within {short_text(loose)} to {short_text(dense)}"
        title = "Density, texels per metre"
    else:
        ticks = tuple((share, f"{step / 1:g}×") for share, step in steps)
        spread = f"90 % within {loose / density.target:.2f}× to {dense / density.target:.2f}×"
        title = "Density, relative to the mean"
    return Legend(
        title, density_scale(), ticks, ("Too low · as wanted · too high", spread, "Large squares: 8 × 8 texels")
    )


def _apart(ticks: list[tuple[float, str]]) -> tuple[tuple[float, str], ...]:
    """As many ticks as don't run into each other, the first kept."""
    kept: list[tuple[float, str]] = []
    for share, text in ticks:
        room = 0.022 * (len(text) + len(kept[-1][1])) / 2 + 0.03 if kept else 0.0
        if not kept or share - kept[-1][0] > room:
            kept.append((share, text))
    return tuple(kept)


def draw_legend(legend: Legend, right: float, bottom: float, scale: float) -> None:
    """Draw a legend whose lower right corner lies there, in pixels; `scale` is the interface's."""
    line = TEXT * 1.55 * scale
    height = 2 * PADDING * scale + TITLE * 1.3 * scale + line * len(legend.notes)
    if legend.scale is not None:
        height += (BAR + 12) * scale + line
    left, top = right - width_of(legend, scale), bottom + height
    gpu.state.blend_set("ALPHA")
    _box(left, bottom, right, top, 6 * scale)
    inner, outer = left + PADDING * scale, right - PADDING * scale
    y = top - PADDING * scale - TITLE * scale
    _write(legend.title, inner, y, TITLE * scale, WORDS)
    if legend.scale is not None:
        y -= (BAR + 12) * scale
        _bar(legend.scale, inner, y, outer, y + BAR * scale)
        y -= line
        for share, text in legend.ticks:
            x = inner + share * (outer - inner)
            _rectangles([(x - 0.5 * scale, y + line - 4 * scale, x + 0.5 * scale, y + line)], WORDS)
            _write(text, x, y, TEXT * scale, WORDS, centred=(inner, outer))
    for note in legend.notes:
        y -= line
        _write(note, inner, y, TEXT * scale, QUIET)
    gpu.state.blend_set("NONE")


def width_of(legend: Legend, scale: float) -> float:
    """Pixels that a legend takes: as many as its words, or as a bar asks for."""
    widest = 0.0 if legend.scale is None else WIDTH * scale
    for text, size in ((legend.title, TITLE), *((note, TEXT) for note in legend.notes)):
        blf.size(0, size * scale)
        widest = max(widest, blf.dimensions(0, text)[0] + 2 * PADDING * scale)
    return widest


def said(text: str) -> Legend:
    """Why there is nothing to see, in place of a legend."""
    return Legend("Nothing to Show", None, (), tuple(textwrap.wrap(text, LINE)))


def corner(context: bpy.types.Context, scale: float) -> tuple[float, float]:
    """Where a legend goes: into the lower right corner of the view, left of the sidebar."""
    sidebar = 0
    if context.preferences.system.use_region_overlap:
        sidebar = sum(region.width for region in context.area.regions if region.type == "UI" and region.width > 1)
    return context.region.width - sidebar - MARGIN * scale, MARGIN * scale


def _write(
    text: str,
    x: float,
    y: float,
    size: float,
    color: tuple[float, ...],
    centred: tuple[float, float] | None = None,
) -> None:
    blf.size(0, size)
    blf.color(0, *color)
    if centred:
        width = blf.dimensions(0, text)[0]
        x = min(max(x - width / 2, centred[0]), centred[1] - width)
    blf.position(0, x, y, 0)
    blf.draw(0, text)


def _rectangles(rectangles: list[tuple[float, float, float, float]], color: tuple[float, ...]) -> None:
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    corners = [
        corner
        for x0, y0, x1, y1 in rectangles
        for corner in ((x0, y0), (x1, y0), (x1, y1), (x0, y0), (x1, y1), (x0, y1))
    ]
    shader.uniform_float("color", color)
    batch_for_shader(shader, "TRIS", {"pos": corners}).draw(shader)


def _box(left: float, bottom: float, right: float, top: float, radius: float) -> None:
    """A dark ground with round corners, on which words can be read before any picture."""
    turn = np.linspace(0, np.pi / 2, 7)
    x = np.concatenate(
        [
            [right - radius, left + radius, left + radius, right - radius][k] + radius * np.cos(turn + k * np.pi / 2)
            for k in range(4)
        ]
    )
    y = np.concatenate(
        [
            [top - radius, top - radius, bottom + radius, bottom + radius][k] + radius * np.sin(turn + k * np.pi / 2)
            for k in range(4)
        ]
    )
    middle = ((left + right) / 2, (bottom + top) / 2)
    ring = [*zip(x.tolist(), y.tolist(), strict=True)]
    corners = [point for a, b in zip(ring, [*ring[1:], ring[0]], strict=True) for point in (middle, a, b)]
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    shader.uniform_float("color", GROUND)
    batch_for_shader(shader, "TRIS", {"pos": corners}).draw(shader)


def _bar(scale: UInt8, left: float, bottom: float, right: float, top: float) -> None:
    x = np.linspace(left, right, len(scale))
    corners = np.stack([np.stack([x, np.full_like(x, y)], axis=1) for y in (bottom, top)], axis=1).reshape(-1, 2)
    colors = np.concatenate([scale / np.float32(255), np.ones((len(scale), 1), np.float32)], axis=1)
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    data = {"pos": corners.astype(np.float32), "color": np.repeat(colors, 2, axis=0).astype(np.float32)}
    batch_for_shader(shader, "TRI_STRIP", data).draw(shader)
