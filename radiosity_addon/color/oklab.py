# SPDX-License-Identifier: GPL-3.0-or-later
"""Oklab (Ottosson 2020), the perceptual space that gamut mapping works in.

Its lines of equal hue bend least in the blues among the simple spaces, and it is homogeneous: k times the light is
cbrt(k) times L, a and b, so that brightness changes neither hue nor the saturation C / L.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Float64, Floats
from .spaces import D65, RGBSpace, xyz_of


def _neutral(matrix: Float64, of_white: Float64, wanted: Float64) -> Float64:
    """The published matrix, its last digits such that white is exactly neutral."""
    exact: Float64 = matrix + ((wanted - matrix @ of_white) / (of_white @ of_white))[:, None] * of_white
    return exact


TO_LMS = _neutral(
    np.array(
        [
            [0.8189330101, 0.3618667424, -0.1288597137],
            [0.0329845436, 0.9293118715, 0.0361456387],
            [0.0482003018, 0.2643662691, 0.6338517070],
        ]
    ),
    xyz_of(D65),
    np.ones(3),
)
"""XYZ under D65 to cone responses."""

TO_LAB = _neutral(
    np.array(
        [
            [0.2104542553, 0.7936177850, -0.0040720468],
            [1.9779984951, -2.4285922050, 0.4505937099],
            [0.0259040371, 0.7827717662, -0.8086757660],
        ]
    ),
    np.ones(3),
    np.array([1.0, 0, 0]),
)
"""Cube roots of cone responses to L, a, b."""


def lms_matrix(space: RGBSpace) -> Float64:
    """(3, 3), linear RGB to cone responses."""
    matrix: Float64 = TO_LMS @ space.to_xyz
    return matrix


def to_oklab(rgb: Floats, space: RGBSpace) -> Float64:
    """L, a, b (..., 3) of linear RGB (..., 3)."""
    lab: Float64 = np.cbrt(np.asarray(rgb, np.float64) @ lms_matrix(space).T) @ TO_LAB.T
    return lab


def from_oklab(lab: Floats, space: RGBSpace) -> Float64:
    """Linear RGB of L, a, b: the inverse of `to_oklab`."""
    root = np.asarray(lab, np.float64) @ np.linalg.inv(TO_LAB).T
    rgb: Float64 = root**3 @ np.linalg.inv(lms_matrix(space)).T
    return rgb
