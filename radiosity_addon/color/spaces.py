# SPDX-License-Identifier: GPL-3.0-or-later
"""CIE XYZ, what is derived from it, and linear RGB spaces.

XYZ is relative: white has Y = 1. Every RGB space here is given by its matrix to XYZ as seen under D65; a space with
another white is adapted to D65 first (linear Bradford), so that white stays white from any space to any other. That is
also what Blender does. Arrays are (..., 3) or (..., 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import Float64, Floats

D65 = (0.3127, 0.3290)
"""White of daylight at 6504 K, xy, as the standards of RGB spaces round it."""
D50 = (0.3457, 0.3585)
"""White of daylight at 5003 K, xy."""
ACES_WHITE = (0.32168, 0.33767)
"""White of the ACES spaces, xy, close to D60 (SMPTE ST 2065-1)."""

BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""XYZ to the sharpened cone responses in which whites are scaled (Lam 1985; ICC.1:2022, annex E)."""


@dataclass(frozen=True, eq=False)
class RGBSpace:
    """A linear RGB space.

    Attributes:
        name: as Blender and the report call it
        to_xyz: (3, 3) float64, RGB to XYZ under D65, white to Y = 1
    """

    name: str
    to_xyz: Float64

    @cached_property
    def from_xyz(self) -> Float64:
        """(3, 3), XYZ under D65 to RGB."""
        inverse: Float64 = np.linalg.inv(self.to_xyz)
        return inverse

    @property
    def luminance_weights(self) -> Float64:
        """(3,), what each channel adds to the luminance Y."""
        weights: Float64 = self.to_xyz[1]
        return weights

    @property
    def primaries(self) -> Float64:
        """(3, 2), xy of red, green and blue, as seen under D65."""
        return xy_of(self.to_xyz.T)

    def to(self, other: RGBSpace) -> Float64:
        """(3, 3), to another space; exactly the identity where both are the same."""
        if self is other or np.array_equal(self.to_xyz, other.to_xyz):
            return np.eye(3)
        matrix: Float64 = other.from_xyz @ self.to_xyz
        return matrix


def xy_of(xyz: Floats) -> Float64:
    """Chromaticity x, y of XYZ; that of D65 where there is no light."""
    return _shares(xyz, np.array([[1.0, 0, 0], [0, 1, 0]]), np.ones(3), D65)


def uv_of(xyz: Floats) -> Float64:
    """u', v' of the uniform chromaticity scale (CIE 1976) of XYZ; those of D65 where there is no light."""
    x, y = D65
    white = (4 * x / (-2 * x + 12 * y + 3), 9 * y / (-2 * x + 12 * y + 3))
    return _shares(xyz, np.array([[4.0, 0, 0], [0, 9, 0]]), np.array([1.0, 15, 3]), white)


def _shares(xyz: Floats, upper: Float64, lower: Float64, without_light: tuple[float, float]) -> Float64:
    values = np.asarray(xyz, np.float64)
    below = (values @ lower)[..., None]
    shares: Float64 = np.where(below == 0, np.array(without_light), values @ upper.T / np.where(below == 0, 1, below))
    return shares


def xyz_of(xy: Floats | tuple[float, float], luminance: Floats | float = 1.0) -> Float64:
    """XYZ (..., 3) of chromaticities (..., 2), y not 0, and luminances Y (...)."""
    x, y = np.moveaxis(np.asarray(xy, np.float64), -1, 0)
    scale = np.asarray(luminance, np.float64) / y
    return np.stack([x * scale, y * scale, (1 - x - y) * scale], axis=-1)


def adaptation(source: tuple[float, float], target: tuple[float, float]) -> Float64:
    """(3, 3), XYZ seen under one white, xy, to XYZ that look the same under another (linear Bradford)."""
    before, after = BRADFORD @ xyz_of(source), BRADFORD @ xyz_of(target)
    matrix: Float64 = np.linalg.inv(BRADFORD) @ np.diag(after / before) @ BRADFORD
    return matrix


def rgb_space(name: str, primaries: Floats, white: tuple[float, float] = D65) -> RGBSpace:
    """A space by the xy of its primaries (3, 2) and of its white (SMPTE RP 177-1993)."""
    columns = xyz_of(primaries).T
    own = columns * np.linalg.solve(columns, xyz_of(white))
    return RGBSpace(name, own if white == D65 else adaptation(white, D65) @ own)


REC709 = rgb_space("Linear Rec.709", np.array([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]]))
"""ITU-R BT.709 and sRGB (IEC 61966-2-1)."""
REC2020 = rgb_space("Linear Rec.2020", np.array([[0.708, 0.292], [0.170, 0.797], [0.131, 0.046]]))
"""ITU-R BT.2020."""
DISPLAY_P3 = rgb_space("Linear Display P3", np.array([[0.680, 0.320], [0.265, 0.690], [0.150, 0.060]]))
"""SMPTE RP 431-2's primaries with the white of sRGB."""
ACESCG = rgb_space("ACEScg", np.array([[0.713, 0.293], [0.165, 0.830], [0.128, 0.044]]), ACES_WHITE)
"""The AP1 primaries of ACES (S-2014-004)."""

SPACES = {"rec709": REC709, "rec2020": REC2020, "p3": DISPLAY_P3, "acescg": ACESCG}
"""Spaces that a user can choose, by the word for it."""


def luminance(rgb: Floats, space: RGBSpace = REC709) -> Float64:
    """Luminance Y (...) of linear RGB (..., 3)."""
    weighted: Float64 = np.asarray(rgb, np.float64) @ space.luminance_weights
    return weighted


def to_lab(xyz: Floats, white: tuple[float, float] = D65) -> Float64:
    """CIE 1976 L*, a*, b* (..., 3) of XYZ seen under a white (CIE 15:2004, section 8.2.1)."""
    ratio = np.asarray(xyz, np.float64) / xyz_of(white)
    cubic, linear = np.cbrt(ratio), ratio * (29**3 / 27 / 116) + 16 / 116
    x, y, z = np.moveaxis(np.where(ratio > (6 / 29) ** 3, cubic, linear), -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def from_lab(lab: Floats, white: tuple[float, float] = D65) -> Float64:
    """XYZ of L*, a*, b*: the inverse of `to_lab`."""
    light, a, b = np.moveaxis(np.asarray(lab, np.float64), -1, 0)
    y = (light + 16) / 116
    root = np.stack([y + a / 500, y, y - b / 200], axis=-1)
    return np.where(root > 6 / 29, root**3, (root - 16 / 116) * (116 * 27 / 29**3)) * xyz_of(white)
