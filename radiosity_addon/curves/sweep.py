# SPDX-License-Identifier: GPL-3.0-or-later
"""Profiles carried along centre lines: tubes, ribbons, mouldings.

The rules are Blender's, so that the shape is what it shows: the profile stands across the bisector of the chords to
both neighbours, and turns along the way as little as possible or stays upright.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..arrays import Bools, Float64
from .nurbs import Curve
from .patchwork import Cap, Net
from .tessellation import PROBES, TURN, Density, curve_density, probes_of

VERTICAL = 1e-4
"""Directions this near to the z axis have no upright side."""

OPPOSITE = 1e-12
"""Directions whose cosine is this near to -1 turn about no axis in particular."""

PROBE_STEP = 1 / 64
"""Share of a piece over which slopes of what has no derivative are taken."""

ASKEW = 0.02
"""Radians by which the direction given for an end may differ from the curve's own."""

Twist = Literal["MINIMUM", "Z_UP"]
"""How the profile turns along the line: as little as possible, or with its y axis as upright as can be."""


@dataclass(frozen=True, eq=False)
class Line:
    """A centre line by its samples.

    Attributes:
        points: (T, 3) float64
        radius: (T,) float64, factor of the profile's size
        tilt: (T,) float64, radians about the direction
        progress: (T,) float64, texture coordinate, from 0; that of an open line ends at 1
        closed: the last sample is followed by the first
        ends: (2, 3) float64, directions at the ends of an open line; zero where its chords tell
        first: the sample at which the profile of a closed line begins upright
    """

    points: Float64
    radius: Float64
    tilt: Float64
    progress: Float64
    closed: bool
    ends: Float64
    first: int = -1

    def without_repeats(self, near: float) -> Line:
        """Less the samples from which the next differs by no more than `near` along any axis."""
        gaps = np.abs(np.diff(self.points, axis=0)).max(axis=1)
        keep = np.append(gaps > near, True)
        if self.closed and len(keep) > 1 and np.abs(self.points[0] - self.points[-1]).max() <= near:
            keep[-1] = False
        if keep.all():
            return self
        steps = np.diff(self.progress, append=1.0) * keep  # the way from one to the other counts for nothing
        progress = np.append(0.0, np.cumsum(steps)[:-1]) / max(float(steps.sum()), 1e-300)
        values = {name: getattr(self, name)[keep] for name in ("points", "radius", "tilt")}
        first = int(keep[: self.first % len(keep)].sum()) % int(keep.sum())
        return replace(self, progress=progress[keep], first=first, **values)


@dataclass(frozen=True, eq=False)
class Path:
    """A centre line that can be sampled anywhere.

    Attributes:
        curve: in five dimensions: place, radius, tilt
        closed: start and end are one
        rigid: (B - 1,) bool, pieces between breaks that are single straight steps
        shown: (S,) float64, parameters at which Blender samples it, both ends included; texture coordinates run
            evenly from one to the next
        ends: (2, 3) as for Line
        last: (5,) values at the end of an open line, where they aren't the curve's; or None
    """

    curve: Curve
    closed: bool
    rigid: Bools
    shown: Float64
    ends: Float64
    last: Float64 | None = None

    def progress_at(self, parameters: Float64) -> Float64:
        """Texture coordinates (T,) of parameters (T,)."""
        return np.interp(parameters, self.shown, np.linspace(0, 1, len(self.shown)))

    def at(self, parameters: Float64) -> Line:
        """Samples at parameters (T,); those of a closed line end with that of the start, which isn't repeated."""
        values = self.curve.at(parameters)
        progress = self.progress_at(parameters)
        first = -1
        if self.closed:
            values, progress = values[:-1], progress[:-1]
            first = int(np.argmin(np.abs(parameters[:-1] - self.shown[-2])))  # Blender begins at its last sample
        elif self.last is not None:
            values[-1] = self.last
        return Line(values[:, :3], values[:, 3], values[:, 4], progress, self.closed, self.ends, first)

    def parameters(
        self, chord: float, reach: float, factor: Callable[[Float64, Float64], Float64], twist: Twist
    ) -> Float64:
        """Where it is to be sampled for a profile that reaches so far from the line.

        Args:
            chord: m
            reach: m, at a radius of 1
            factor: radius (T,) of the profile from the line's radius (T,) and progress (T,)
            twist: see `Twist`
        """
        curve, breaks = self.curve, self.curve.basis.breaks
        density = curve_density(curve, chord)
        at = probes_of(breaks)
        step = np.repeat(np.diff(breaks), len(PROBES)) * PROBE_STEP
        around = [curve.derivatives(np.clip(at + k * step, breaks[0], breaks[-1]), 1) for k in (-1, 0, 1)]
        sizes = [
            reach * factor(values[:, 3], self.progress_at(at + k * step))
            for k, (values, _) in zip((-1, 0, 1), around, strict=True)
        ]
        speed = np.maximum(np.linalg.norm(around[1][1][:, :3], axis=1), 1e-300)
        directions = [_unit(velocity[:, :3]) for _, velocity in around]
        turned = _angle(directions[0], directions[2]) / (2 * step)
        rolled = np.abs(around[1][1][:, 4])
        if twist == "Z_UP":
            upright = [upright_axes(direction) for direction in directions]
            rolled = rolled + _angle(upright[0], upright[2]) / (2 * step)
        slope = [(sizes[1] - sizes[0]) / step, (sizes[2] - sizes[1]) / step]
        flare = np.abs(slope[1] - slope[0]) / step
        opened = np.abs(np.arctan(slope[1] / speed) - np.arctan(slope[0] / speed)) / step
        sag = np.sqrt((np.abs(sizes[1]) * (turned**2 + rolled**2) + flare) / (8 * chord))
        spin = np.maximum(np.hypot(turned, rolled), opened) / TURN
        rate = np.maximum(density.rate, np.maximum(sag, spin).reshape(density.rate.shape))
        rate[self.rigid] = 0.0
        found = Density(breaks, rate).parameters(3 if self.closed else 1)
        return np.union1d(found, self._special())

    def _special(self) -> Float64:
        """Parameters where Blender's own samples matter: where frames begin, and beside ends that look elsewhere.

        At a floating end Blender's profile stands across the line of the control points, not across the curve.
        """
        if self.closed:
            return self.shown[-2:-1]
        _, velocity = self.curve.derivatives(self.shown[[0, -1]], 1, from_left=True)
        off = self.ends.any(axis=1) & (_angle(self.ends, _unit(velocity[:, :3])) > ASKEW)
        return self.shown[[1, -2]][off]


@dataclass(frozen=True, eq=False)
class Profile:
    """A cross-section, in the plane across the line.

    Attributes:
        points: (C, 2) float64, m, along the x and y axes that the line carries
        places: texture coordinate of each point, (C,), or (C + 1,) where the last is followed by the first
    """

    points: Float64
    places: Float64

    @property
    def closed(self) -> bool:
        return len(self.places) > len(self.points)

    @property
    def reach(self) -> float:
        """How far it reaches from the line, m."""
        return float(np.linalg.norm(self.points, axis=1).max())


def ring_profile(depth: float, resolution: int, finer: int = 1) -> Profile:
    """A circle of 4 + 2 * resolution steps, each in so many finer ones."""
    steps = 4 + 2 * resolution
    angle = (np.arange(steps * finer) / finer + 1) * (2 * np.pi / steps)
    return Profile(depth * np.stack([np.cos(angle), np.sin(angle)], axis=1), np.linspace(0, 1, steps * finer + 1))


def quarter_circle(resolution: int, finer: int = 1) -> tuple[Float64, Float64]:
    """Points (Q, 2) from (1, 0) to (0, 1) in `resolution + 1` steps, each in so many finer ones, and their places."""
    angle = np.linspace(0, np.pi / 2, (resolution + 1) * finer + 1)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1), np.linspace(0, resolution + 1, len(angle))


def bevel_profile(
    quarter: tuple[Float64, Float64], depth: float, extrude: float, sides: Literal["FULL", "HALF", "FRONT", "BACK"]
) -> Profile:
    """A ribbon whose edges are rounded by a quarter profile and its mirror images.

    Args:
        quarter: points (Q, 2) from (1, 0) to (0, 1), and their places counted in steps
        depth: size of the quarter, m; 0 leaves the plain ribbon
        extrude: half the ribbon's width, m
        sides: all around as a closed loop, or one side of it, or the upper or lower quarter of that
    """
    if not depth:
        return Profile(np.array([[0, -extrude], [0, extrude]]), np.array([0.0, 1.0]))
    shape, place = quarter[0] * depth + [0.0, extrude], quarter[1]
    mirrored = {"BACK": ((1, -1), -1), "FRONT": ((1, 1), 1), "left front": ((-1, 1), -1), "left back": ((-1, -1), 1)}
    chosen = {"FULL": list(mirrored), "HALF": ["BACK", "FRONT"]}.get(sides, [sides])
    parts, places, at = [], [], 0.0
    for name in chosen:
        signs, way = mirrored[name]
        parts.append((shape * signs)[::way])
        places.append(at + (place if way > 0 else place[-1] - place[::-1]))
        at = places[-1][-1] + (1.0 if extrude and name in ("BACK", "left front") else 0.0)
    points, counted = np.concatenate(parts), np.concatenate(places)
    if extrude and sides == "FRONT":
        points, counted = np.insert(points, 0, [depth, -extrude], axis=0), np.append(0.0, counted + 1)
    if extrude and sides == "BACK":
        points, counted = np.append(points, [[depth, extrude]], axis=0), np.append(counted, counted[-1] + 1)
    keep = np.append(True, np.diff(counted) > 0)
    points, counted = points[keep], counted[keep]
    return Profile(points[:-1] if sides == "FULL" else points, counted / counted[-1])


def steps_for(radius: float, angle: float, chord: float) -> int:
    """Parts into which an arc of that angle, radians, must be cut for the bound on its chords; eighths at most."""
    most = np.pi / 4 if chord >= radius else min(np.pi / 4, 2 * np.arccos(1 - chord / radius))
    return max(1, int(np.ceil(angle / most - 1e-9)))


def sweep(line: Line, profile: Profile, twist: Twist = "MINIMUM", material: int = 0) -> Net:
    """The profile carried along the line; rows follow the line, columns the profile."""
    direction, x = frames(line, twist)
    y = np.cross(direction, x)
    across = profile.points[:, :1] * x[:, None] + profile.points[:, 1:] * y[:, None]
    points = line.points[:, None] + line.radius[:, None, None] * across
    rows = line.progress
    if line.closed:
        rows = np.append(rows, 1.0) if len(rows) > 2 else np.array([0.0, 1.0])
    return Net(points, rows, profile.places, material=material)


def caps(net: Net) -> list[Cap]:
    """Flat ends of an open tube."""
    first, last = net.points[0], net.points[-1]
    if len(first) < 3:
        return []
    ahead = net.points[[1, -1]].mean(axis=1) - net.points[[0, -2]].mean(axis=1)
    ends = []
    for rim, outward in ((first, -ahead[0]), (last, ahead[1])):
        normal = np.cross(rim - rim[0], np.roll(rim, -1, axis=0) - rim[0]).sum(axis=0)
        ends.append(Cap(rim if normal @ outward > 0 else rim[::-1], net.material))
    return ends


def frames(line: Line, twist: Twist) -> tuple[Float64, Float64]:
    """Direction (T, 3) of the line and x axis (T, 3) of the profile at each sample; y is their cross product."""
    direction = _directions(line)
    if twist == "Z_UP" or len(direction) == 2:
        x = upright_axes(direction)
    else:
        x = _least_twisted(line, direction)
    cosine, sine = np.cos(line.tilt)[:, None], np.sin(line.tilt)[:, None]
    return direction, cosine * x + sine * np.cross(direction, x)


def _directions(line: Line) -> Float64:
    points = line.points
    if len(points) == 2:
        return np.repeat(_unit(points[1:] - points[:1]), 2, axis=0)
    chords = _unit(np.roll(points, -1, axis=0) - points)
    direction = _unit(chords + np.roll(chords, 1, axis=0))
    if not line.closed:
        for end, chord in ((0, chords[0]), (-1, chords[-2])):
            direction[end] = line.ends[end] if line.ends[end].any() else chord
    return direction


def upright_axes(direction: Float64) -> Float64:
    """Level x axes (T, 3) of directions (T, 3): the y axes point up as far as they can."""
    level = np.stack([-direction[:, 1], direction[:, 0], np.zeros(len(direction))], axis=1)
    vertical = np.abs(level).sum(axis=1) < VERTICAL
    level[vertical] = [-1.0, 0.0, 0.0]
    return _unit(level)


def _least_twisted(line: Line, direction: Float64) -> Float64:
    """Axes (T, 3) carried along without any turn about the direction (Bishop 1975).

    They begin upright. What they turn on the way around a closed line is spread evenly over it.
    """
    count = len(direction)
    order = np.roll(np.arange(count), -line.first) if line.closed else np.arange(count)
    ahead = direction[order]
    x = np.empty_like(ahead)
    x[0] = upright_axes(ahead[:1])[0]
    axes, cosines = np.cross(ahead[:-1], ahead[1:]), (ahead[:-1] * ahead[1:]).sum(axis=1)
    for k in range(count - 1):
        x[k + 1] = _turned(x[k], axes[k], cosines[k])
    if line.closed:
        around = _turned(x[-1], np.cross(ahead[-1], ahead[0]), float(ahead[-1] @ ahead[0]))
        surplus = np.arctan2(np.cross(x[0], around) @ ahead[0], x[0] @ around)
        steps = np.diff(line.progress, append=1.0 + line.progress[0])[order - 1]
        angle = -surplus * np.cumsum(steps)[:, None]
        x = np.cos(angle) * x + np.sin(angle) * np.cross(ahead, x)
    result = np.empty_like(x)
    result[order] = x
    return result


def _turned(vector: Float64, axis: Float64, cosine: float) -> Float64:
    """A vector turned by the rotation that takes one unit vector to another, given their cross and dot product."""
    if 1 + cosine < OPPOSITE:
        return vector
    return np.asarray(vector * cosine + np.cross(axis, vector) + axis * (axis @ vector) / (1 + cosine))


def _unit(vectors: Float64) -> Float64:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0, length, 1.0))


def _angle(a: Float64, b: Float64) -> Float64:
    """(T,) radians between unit vectors."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))
