# SPDX-License-Identifier: GPL-3.0-or-later
"""The linear RGB space that Blender's colours are in, as its OpenColorIO configuration has it."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Color

from ...arrays import Float64
from ...color.spaces import REC709, RGBSpace
from ...color.spectra import blackbody

SAME = 1e-3
"""Spaces whose matrices differ by less are one: Blender 4.5 rounds the white of Rec.709 in another digit."""

BLACKBODY_RANGE = (800.0, 12000.0)
"""K; Blender's black bodies don't change beyond."""


def working_space() -> RGBSpace:
    """Asked of Blender, by what it makes of the three unit colours, so that any configuration is followed."""
    to_xyz = np.array([Color(unit).from_scene_linear_to_xyz_d65() for unit in np.eye(3)], np.float64).T
    colorspace = getattr(bpy.data, "colorspace", None)  # from 5.0
    if colorspace is not None:
        return RGBSpace(colorspace.working_space, to_xyz)
    known = np.abs(to_xyz - REC709.to_xyz).max() < SAME
    return RGBSpace(REC709.name if known else "scene linear", to_xyz)


def blackbody_color(kelvin: float) -> Float64:
    """Colour (3,) of Blender's Blackbody nodes and lamps, luminance 1: within 0.2 % of its own, a polynomial fit."""
    return np.maximum(blackbody(np.clip(kelvin, *BLACKBODY_RANGE), working_space()), 0)
