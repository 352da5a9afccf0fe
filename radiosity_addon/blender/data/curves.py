# SPDX-License-Identifier: GPL-3.0-or-later
"""Curve and surface objects as nets: their own splines, sampled as their shape asks for.

What Blender makes of splines by other means than the splines themselves is left to its evaluated mesh: see
docs/curves.md.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...arrays import Float64
from ...curves.nurbs import Surface
from ...curves.patchwork import Cap, Net
from ...curves.sweep import (
    Line,
    Path,
    Profile,
    bevel_profile,
    caps,
    quarter_circle,
    ring_profile,
    steps_for,
    sweep,
)
from ...curves.tessellation import CHORD, curve_density, extent, grid_parameters, smooth_normals
from .splines import Degenerate, read_path, read_surface

REPEATED = 1e-6
"""Samples of a line closer than this share of its extent are one, as Blender has it for its own."""

Radius = Callable[[Float64, Float64], Float64]
"""Size (T,) of the profile from the line's radius (T,) and progress (T,)."""


@dataclass(frozen=True, eq=False)
class Nets:
    """What the splines of an object are in its own space, and the reasons for those that show nothing."""

    nets: tuple[Net, ...]
    caps: tuple[Cap, ...]
    degenerate: tuple[str, ...]


def left_to_blender(thing: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> str | None:
    """Why a curve or surface object (as evaluated) is not sampled from its splines, or None if it is."""
    data = thing.data
    if any(modifier.show_render for modifier in thing.modifiers):
        return "it has modifiers"
    if data.shape_keys is not None:
        return "it has shape keys"
    if not all(spline.use_smooth for spline in data.splines):
        return "it is shaded flat, which shows the facets of its own resolution"
    if thing.type == "SURFACE":
        return None
    if data.dimensions == "2D":
        return "flat outlines are filled and mitred"
    if data.twist_mode == "TANGENT" or data.twist_smooth > 0:
        return "its twist depends on its resolution"
    if (data.bevel_factor_start, data.bevel_factor_end) != (0.0, 1.0):
        return "only a part of it is bevelled"
    if any(spline.type == "NURBS" and spline.use_cyclic_u and len(spline.points) == 2 for spline in data.splines):
        return "a closed spline of two points runs back on itself"
    for helper in (data.bevel_object if data.bevel_mode == "OBJECT" else None, data.taper_object):
        if helper is not None and (reason := _odd_helper(helper, helper is data.taper_object)):
            return f"{helper.name}: {reason}"
    if data.use_fill_caps and len(profiles(data, depsgraph)) > 1:
        return "its caps have several outlines"
    return None


def _odd_helper(helper: bpy.types.Object, taper: bool) -> str | None:
    """Why a bevel or taper object can't be read from its splines."""
    data = helper.data
    if helper.type != "CURVE":
        return "it is no curve"
    if helper.modifiers or data.shape_keys is not None:
        return "it has modifiers or shape keys"
    if data.bevel_depth or data.extrude or (data.bevel_mode == "OBJECT" and data.bevel_object is not None):
        return "it is bevelled itself"
    if data.offset or (taper and any(spline.use_cyclic_u for spline in data.splines)):
        return "it is offset or closed"
    return None


def surface_nets(data: bpy.types.SurfaceCurve) -> Generator[None, None, Nets]:
    """A surface object's splines, one a step."""
    found, degenerate = [], []
    for spline in data.splines:
        try:
            found.append(_sampled(read_surface(spline), spline))
        except Degenerate as reason:
            degenerate.append(str(reason))
        yield
    return Nets(tuple(found), (), tuple(degenerate))


def _sampled(surface: Surface, spline: bpy.types.Spline) -> Net:
    if not extent(surface.points):
        raise Degenerate("its points coincide")
    ring = spline.use_cyclic_u, spline.use_cyclic_v
    u, v = grid_parameters(surface, CHORD * extent(surface.points), closed=ring)
    return surface_net(surface, u, v, ring, spline.material_index)


def surface_net(surface: Surface, u: Float64, v: Float64, ring: tuple[bool, bool], material: int) -> Net:
    """A surface on lines of parameters that run from end to end of its domain."""
    places = [(t - t[0]) / (t[-1] - t[0]) for t in (u, v)]
    if ring[0]:
        u = u[:-1]
    if ring[1]:
        v = v[:-1]
    return Net(surface.at(u, v), places[0], places[1], -smooth_normals(surface, u, v), material)


def curve_nets(data: bpy.types.Curve, depsgraph: bpy.types.Depsgraph, tube: float = 0.0) -> Generator[None, None, Nets]:
    """A curve object's splines with their bevel, one a step.

    Args:
        tube: radius of the closed tube that a curve without a bevel gets, m in the object's space; 0: it shows nothing
    """
    bare = not profiles(data, depsgraph)
    if bare and not tube:
        return Nets((), (), ())
    taper = taper_of(data, depsgraph)
    paths: list[tuple[Path, int]] = []
    degenerate = []
    for spline in data.splines:
        try:
            path = read_path(spline, resolution_of(data, spline, depsgraph))
            if not extent(path.curve.points):
                raise Degenerate("its points coincide")
            paths.append((path, spline.material_index))
        except Degenerate as reason:
            degenerate.append(str(reason))
    size = extent(np.concatenate([path.curve.points for path, _ in paths])) if paths else 0.0
    nets: list[Net] = []
    ends: list[Cap] = []
    for path, material in paths:
        factor = taper(path)
        radii = factor(path.curve.points[:, 3:4], np.linspace(0, 1, len(path.shown)))
        widest = max(float(np.abs(radii).max()), 1e-9)
        outlines = [_tube(tube, CHORD * size)] if bare else profiles(data, depsgraph, CHORD * size / widest)
        for outline in outlines:
            profile = Profile(outline.points + np.array([data.offset, 0.0]), outline.places)
            parameters = path.parameters(CHORD * size, profile.reach, factor, data.twist_mode)
            line = path.at(parameters).without_repeats(REPEATED * extent(path.curve.points))
            nets.append(swept(line, profile, factor, data.twist_mode, material))
            if (bare or data.use_fill_caps) and not path.closed:
                ends += caps(nets[-1])
            yield
    return Nets(tuple(nets), tuple(ends), tuple(degenerate))


def _tube(radius: float, chord: float) -> Profile:
    return ring_profile(radius, 0, steps_for(radius, np.pi / 2, chord))


def swept(line: Line, profile: Profile, factor: Radius, twist: str, material: int) -> Net:
    """A profile along a line, tapered."""
    return sweep(replace(line, radius=factor(line.radius, line.progress)), profile, twist, material)


def profiles(data: bpy.types.Curve, depsgraph: bpy.types.Depsgraph, chord: float = np.inf) -> list[Profile]:
    """What a curve object carries along its splines: the bevel's and extrusion's outline, or those of its bevel object.

    Args:
        chord: m, bound on the distance of straight steps from arcs; without it the steps are Blender's
    """
    if data.bevel_mode == "OBJECT":
        return _object_profiles(data.bevel_object, depsgraph, chord) if data.bevel_object is not None else []
    depth, extrude, resolution = data.bevel_depth, data.extrude, data.bevel_resolution
    if not (depth or extrude):
        return []
    if data.bevel_mode == "PROFILE":
        inner = [tuple(point.location) for point in data.bevel_profile.segments[1 : resolution + 1]]
        points = np.array([(1.0, 0.0), *inner, (0.0, 1.0)])
        quarter = points, np.arange(len(points), dtype=np.float64)
    else:
        ring = not extrude and data.fill_mode == "FULL"
        step = 2 * np.pi / (4 + 2 * resolution) if ring else np.pi / 2 / (resolution + 1)
        finer = steps_for(depth, step, chord) if np.isfinite(chord) else 1
        if ring:
            return [ring_profile(depth, resolution, finer)]
        quarter = quarter_circle(resolution, finer)
    return [bevel_profile(quarter, depth, extrude, data.fill_mode)]


def _object_profiles(thing: bpy.types.Object, depsgraph: bpy.types.Depsgraph, chord: float) -> list[Profile]:
    found = []
    data = thing.data
    for spline in data.splines:
        try:
            path = read_path(spline, resolution_of(data, spline, depsgraph), from_last=False)
        except Degenerate:
            continue
        parameters = path.shown
        if np.isfinite(chord):
            density = curve_density(path.curve, chord)
            density.rate[path.rigid] = 0.0
            parameters = density.parameters(3 if path.closed else 1)
        line = path.at(parameters)
        points = line.points[:, :2] * [-thing.scale[0], thing.scale[1]]
        closed = path.closed and len(points) > 2
        found.append(Profile(points, np.append(line.progress, 1.0) if closed else line.progress))
    return found


def taper_of(data: bpy.types.Curve, depsgraph: bpy.types.Depsgraph) -> Callable[[Path], Radius]:
    """How the profile's size follows a path's radius and the taper object."""
    thing = data.taper_object
    if thing is None or not len(thing.data.splines):
        return lambda path: lambda radius, progress: radius
    spline = thing.data.splines[0]
    resolution = resolution_of(thing.data, spline, depsgraph)
    try:
        shape = read_path(spline, resolution)
    except Degenerate:
        return lambda path: lambda radius, progress: radius
    points = shape.at(shape.shown).points
    reach = np.maximum.accumulate(points[:, 0] - points[0, 0])
    width = points[-1, 0] - points[0, 0]
    mode = data.taper_radius_mode

    def of(path: Path) -> Radius:
        def factor(radius: Float64, progress: Float64) -> Float64:
            share = progress * (len(path.shown) - 1) / (len(path.shown) - 2) if path.closed else progress
            taper = np.interp(np.clip(share, 0, 1), reach / width, points[:, 1]) if width > 0 else 1.0
            return {"MULTIPLY": radius * taper, "ADD": radius + taper}.get(mode, taper + 0 * radius)

        return factor

    return of


def resolution_of(data: bpy.types.Curve, spline: bpy.types.Spline, depsgraph: bpy.types.Depsgraph) -> int:
    """Steps a segment that Blender takes."""
    return (depsgraph.mode == "RENDER" and data.render_resolution_u) or spline.resolution_u
