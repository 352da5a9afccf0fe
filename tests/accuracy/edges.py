# SPDX-License-Identifier: GPL-3.0-or-later
"""Edges of shadows near probes: places where the light changes much within what a texel's reading takes in."""

from __future__ import annotations

import math

import numpy as np

from tests.accuracy.comparison import READING
from tests.accuracy.cycles_judge import measure
from tests.accuracy.probes import LUMINANCE, POINTS, Probes, References, extent, footprints, rendered_surfaces

SAMPLES = 2048
"""Of a point: their noise is a small part of the change that makes an edge."""


def change_beside(references: References, chosen: np.ndarray) -> np.ndarray:
    """(K,) by how much Cycles' light changes within READING texels of probes (K,) of the open scene, over the mean."""
    surfaces = rendered_surfaces()
    probes = Probes(references.object[chosen], references.position[chosen], references.normal[chosen])
    width = 2 * READING * references.footprint
    squares = footprints(surfaces, probes, width)
    there = squares.there
    flat = Probes(
        np.repeat(probes.object[:, None], POINTS, axis=1)[there], squares.points[there], squares.normals[there]
    )
    edge = references.footprint / math.sqrt(POINTS)
    measured, _ = measure(flat, extent(surfaces), SAMPLES, [1], 1, squares.shading[there], squares.hosts, edge)
    lowest, highest = np.full(there.shape, np.inf), np.full(there.shape, -np.inf)
    lowest[there] = highest[there] = measured[0] @ LUMINANCE
    change: np.ndarray = (highest.max(axis=1) - lowest.min(axis=1)) / (references.value.mean(axis=0) @ LUMINANCE)
    return change
