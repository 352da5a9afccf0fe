# SPDX-License-Identifier: GPL-3.0-or-later
"""Plots as SVG, drawn by hand: coloured by the page's style sheet, so that they suit light, dark and paper."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from ..arrays import Float64
from ..color.spaces import SPACES, xy_of
from ..color.spectra import blackbody_xy, observer
from .pictures import picture_uri, spectral_locus, tongue

WIDTH, HEIGHT = 560, 260
LEFT, RIGHT, TOP, BOTTOM = 56, 14, 14, 40
"""Margins around a plot, for its labels."""
TONGUE_PIXELS = 220
LABELLED = (460, 480, 490, 500, 520, 540, 560, 580, 600, 620)
"""Wavelengths written at the spectral locus, nm."""
TEMPERATURES = (2000, 3000, 4000, 6500, 10000)
"""Black bodies written at the Planckian locus, K."""


def histogram(first: float, step: float, counts: Sequence[int], label: str) -> str:
    """Bars over stops, cut to where there are any."""
    filled = [index for index, count in enumerate(counts) if count]
    if not filled:
        return _empty("No light")
    begin = math.floor(first + step * filled[0])
    end = max(math.ceil(first + step * (filled[-1] + 1)), begin + 4)
    most = max(counts)
    total = sum(counts)
    marks = []
    for index in filled:
        left, right = (_along(first + step * at, begin, end) for at in (index, index + 1))
        height = (HEIGHT - TOP - BOTTOM) * counts[index] / most
        note = f"{first + step * index:+.2f} to {first + step * (index + 1):+.2f} stops: {counts[index] / total:.2%}"
        marks.append(
            f'<rect class="bar" x="{left + 0.5:.1f}" y="{HEIGHT - BOTTOM - height:.1f}" width="{right - left - 1:.1f}" '
            f'height="{height:.1f}"><title>{note}</title></rect>'
        )
    every = max(1, (end - begin) // 10)
    ticks = [(_along(stop, begin, end), f"{stop:+d}" if stop else "0") for stop in range(begin, end + 1, every)]
    return _frame("".join(marks) + _ticks_below(ticks), label)


def residual_curve(residuals: Sequence[float | None], tolerance: float) -> str:
    """The share of the light left to bounce over the solver's progress, logarithmic."""
    known = [value for value in residuals if value]
    if len(known) < 2:
        return _empty("No steps")
    low = math.floor(math.log10(min(*known, tolerance)))
    high = math.ceil(math.log10(max(known)))
    high = max(high, low + 1)

    def place(index: int, value: float) -> str:
        x = LEFT + (WIDTH - LEFT - RIGHT) * index / (len(known) - 1)
        return f"{x:.1f},{_up(math.log10(value), low, high):.1f}"

    points = " ".join(place(index, value) for index, value in enumerate(known))
    lines = "".join(
        f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{_up(decade, low, high):.1f}" '
        f'y2="{_up(decade, low, high):.1f}"/><text class="tick" x="{LEFT - 8}" y="{_up(decade, low, high) + 4:.1f}" '
        f'text-anchor="end">{_power(decade)}</text>'
        for decade in range(low, high + 1)
    )
    limit = _up(math.log10(tolerance), low, high)
    goal = (
        f'<line class="limit" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{limit:.1f}" y2="{limit:.1f}"/>'
        f'<text class="note" x="{WIDTH - RIGHT - 4}" y="{limit - 6:.1f}" text-anchor="end">tolerance</text>'
    )
    ends = _ticks_below([(LEFT, "start"), (WIDTH - RIGHT, "end")])
    return _frame(f'{lines}{goal}<polyline class="curve" points="{points}"/>{ends}', "progress of the solver")


def chromaticity_diagram(seen: str, x_top: float, y_top: float, mean: tuple[float, float] | None) -> str:
    """The CIE 1931 diagram with the gamuts of RGB spaces, and the bake's colours over them.

    Args:
        seen: address of a picture of the bake's chromaticities from (0, 0) to (x_top, y_top), white for many
        mean: x and y of all light
    """
    width, height, margin = 520, 560, 34

    def at(xy: Float64 | tuple[float, float]) -> tuple[float, float]:
        return margin + xy[0] / x_top * (width - margin - 8), height - margin - xy[1] / y_top * (height - margin - 8)

    def path(points: Float64) -> str:
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in map(at, points))

    left, top = at((0, y_top))
    right, bottom = at((x_top, 0))
    box = f'x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" height="{bottom - top:.1f}"'
    locus = spectral_locus()
    ground = picture_uri(tongue(TONGUE_PIXELS, (x_top, y_top)))
    grid = "".join(
        f'<line class="grid" x1="{at((v, 0))[0]:.1f}" x2="{at((v, 0))[0]:.1f}" y1="{top:.1f}" y2="{bottom:.1f}"/>'
        f'<text class="tick" x="{at((v, 0))[0]:.1f}" y="{bottom + 18:.1f}" text-anchor="middle">{v:.1f}</text>'
        for v in np.arange(0, x_top + 0.01, 0.1)
    ) + "".join(
        f'<line class="grid" x1="{left:.1f}" x2="{right:.1f}" y1="{at((0, v))[1]:.1f}" y2="{at((0, v))[1]:.1f}"/>'
        f'<text class="tick" x="{left - 6:.1f}" y="{at((0, v))[1] + 4:.1f}" text-anchor="end">{v:.1f}</text>'
        for v in np.arange(0.1, y_top + 0.01, 0.1)
    )
    waves = ""
    for wavelength in LABELLED:
        here = xy_of(observer(wavelength))
        away = here - (1 / 3, 1 / 3)
        x, y = at(here + away / np.hypot(*away) * 0.022)
        anchor = "end" if away[0] < -0.05 else "start" if away[0] > 0.05 else "middle"
        waves += f'<text class="tick" x="{x:.1f}" y="{y + 4:.1f}" text-anchor="{anchor}">{wavelength}</text>'
    planck = blackbody_xy(np.geomspace(1000, 40000, 60))
    bodies = "".join(
        f'<circle class="planck-mark" cx="{x:.1f}" cy="{y:.1f}" r="2"><title>{kelvin} K</title></circle>'
        for kelvin, (x, y) in ((kelvin, at(blackbody_xy(kelvin))) for kelvin in TEMPERATURES)
    )
    gamuts = "".join(
        f'<polygon class="gamut gamut-{word}" points="{path(space.primaries)}"><title>{space.name}</title></polygon>'
        for word, space in SPACES.items()
    )
    middle = ""
    if mean is not None:
        x, y = at(mean)
        middle = (
            f'<circle class="mean" cx="{x:.1f}" cy="{y:.1f}" r="5"><title>all light: x {mean[0]:.4f}, y {mean[1]:.4f}'
            "</title></circle>"
        )
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="Chromaticity diagram">'
        f'<defs><clipPath id="locus"><polygon points="{path(locus)}"/></clipPath>'
        '<mask id="seen" mask-type="luminance">'
        f'<image href="{seen}" {box} preserveAspectRatio="none" class="pixels"/></mask></defs>{grid}'
        f'<image class="tongue" href="{ground}" {box} preserveAspectRatio="none" clip-path="url(#locus)"/>'
        f'<polygon class="locus" points="{path(locus)}"/>'
        f'<polyline class="planck" points="{path(planck)}"/>{bodies}{gamuts}'
        f'<rect class="seen" {box} mask="url(#seen)"/>{middle}{waves}</svg>'
    )


def scale_legend(ticks: Sequence[tuple[float, str]], ground: str, label: str) -> str:
    """A bar of the colour scale with ticks at shares of its length.

    Args:
        ground: address of a picture of the scale, left to right
    """
    width, bar, margin = 360, 14, 18
    inner = width - 2 * margin
    marks = "".join(
        f'<line class="axis" x1="{x:.1f}" x2="{x:.1f}" y1="{bar}" y2="{bar + 5}"/>'
        f'<text class="tick" x="{x:.1f}" y="{bar + 18}" text-anchor="middle">{escape(text)}</text>'
        for x, text in ((margin + inner * share, text) for share, text in ticks)
    )
    return (
        f'<svg class="legend" viewBox="0 0 {width} 54" role="img" aria-label="{escape(label)}">'
        f'<image href="{ground}" x="{margin}" y="0" width="{inner}" height="{bar}" preserveAspectRatio="none"/>{marks}'
        f'<text class="note" x="{width / 2}" y="50" text-anchor="middle">{escape(label)}</text></svg>'
    )


def nice_numbers(low: float, high: float) -> list[float]:
    """1, 2 and 5 times powers of ten from low to high; only powers of ten where there would be many."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for steps in ((1, 2, 5), (1, 3), (1,)):
        found = [step * 10.0**decade for decade in decades for step in steps]
        found = [number for number in found if low * 0.999 <= number <= high * 1.001]
        if len(found) <= 10:
            return found
    return found[:: math.ceil(len(found) / 10)]


def _along(value: float, begin: float, end: float) -> float:
    return LEFT + (WIDTH - LEFT - RIGHT) * (value - begin) / (end - begin)


def _up(value: float, low: float, high: float) -> float:
    return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (value - low) / (high - low)


def _power(decade: int) -> str:
    return "1" if decade == 0 else f"10<tspan dy='-5' font-size='8'>{decade}</tspan>"


def _ticks_below(ticks: Sequence[tuple[float, str]]) -> str:
    y = HEIGHT - BOTTOM
    return "".join(
        f'<line class="axis" x1="{x:.1f}" x2="{x:.1f}" y1="{y}" y2="{y + 5}"/>'
        f'<text class="tick" x="{x:.1f}" y="{y + 18}" text-anchor="middle">{escape(text)}</text>'
        for x, text in ticks
    )


def _frame(content: str, label: str) -> str:
    y, middle = HEIGHT - BOTTOM, (LEFT + WIDTH - RIGHT) / 2
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(label)}">{content}'
        f'<line class="axis" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y}" y2="{y}"/>'
        f'<text class="note" x="{middle}" y="{HEIGHT - 4}" text-anchor="middle">{escape(label)}</text>'
        "</svg>"
    )


def _empty(text: str) -> str:
    return f'<p class="nothing">{escape(text)}</p>'
