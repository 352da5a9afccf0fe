# SPDX-License-Identifier: GPL-3.0-or-later
"""What an emitter looks like from afar: tabulated over directions and nearness, then looked up by far receivers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import Float32, Float64, Int32
from .lamp_samples import Rows, dot

STEPS = 48
"""Steps of the directions' table along each side of the octahedron's map: kinks of a face's cosine err by 1 %, smooth
shapes by 0.1 %."""

LAYERS = 4
"""Layers of nearness, the emitter's radius over the distance, from 0 to that of the nearest far receiver."""

INFINITE = 1e4
"""Radii from the emitter that stand for an infinite distance."""

Vector = Callable[[Float32], Float32]
"""The light vector (3, B) at points (3, B): times a receiver's normal it gives the irradiance."""


@dataclass(frozen=True, eq=False)
class FarField:
    """Light vectors of an emitter that lies above a receiver's horizon as a whole.

    Directions lie on a square, the octahedron unfolded (Meyer et al. 2010, "On Floating-Point Normal Vectors").

    Attributes:
        centre: (3,) float32, m
        radius: of a ball about the centre that holds the emitter, m
        nearest: radii from the centre to the nearest receiver that it serves
        vectors: (3, N) float32, m2: light vector times squared distance, at nodes (LAYERS, STEPS + 1, STEPS + 1)
    """

    centre: Float32
    radius: float
    nearest: float
    vectors: Float32

    @classmethod
    def of(cls, vector: Vector, centre: Float32, radius: float, nearest: float) -> FarField:
        """Tabulate `vector`."""
        along = np.linspace(-1, 1, STEPS + 1)
        y, x = (grid.ravel() for grid in np.meshgrid(along, along, indexing="ij"))
        ways = _unfolded(x, y)
        layers = []
        for layer in range(LAYERS):
            distance = radius * (nearest * (LAYERS - 1) / layer if layer else INFINITE)
            points = (centre[:, None] + distance * ways).astype(np.float32)
            layers.append(vector(points) * np.float32(distance) ** 2)
        return cls(centre, radius, nearest, np.ascontiguousarray(np.concatenate(layers, axis=1)))

    def light(self, p: Float32, normal: Rows) -> Float32:
        """Irradiance (B,) of far receivers p (3, B), by linear interpolation."""
        out = [p[k] - self.centre[k] for k in range(3)]
        square = dot(out, out)
        near = np.sqrt(square)
        np.divide(np.float32(self.radius * self.nearest * (LAYERS - 1)), near, out=near)
        layer, depth = _split(near, LAYERS - 1)
        sum_ = np.abs(out[0])
        sum_ += np.abs(out[1])
        sum_ += np.abs(out[2])
        x, y = out[0] / sum_, out[1] / sum_
        folded = out[2] < 0
        x, y = (np.where(folded, np.copysign(1 - np.abs(other), own), own) for own, other in ((x, y), (y, x)))
        for side in (x, y):
            side += 1
            side *= np.float32(STEPS / 2)
        column, right = _split(x, STEPS)
        row, up = _split(y, STEPS)
        row += layer * np.int32(STEPS + 1)
        row *= np.int32(STEPS + 1)
        row += column
        total = np.zeros_like(square)
        for above, share in ((0, 1 - depth), (1, depth)):
            for higher, part in ((0, 1 - up), (1, up)):
                weight = share * part
                for beside, rest in ((0, 1 - right), (1, right)):
                    node = row + np.int32((above * (STEPS + 1) + higher) * (STEPS + 1) + beside)
                    total += dot([vector.take(node) for vector in self.vectors], normal) * (weight * rest)
        total /= square
        return np.maximum(total, 0, out=total)


def _split(value: Float32, steps: int) -> tuple[Int32, Float32]:
    """Step (B,) int32, 0 to steps - 1, and the share of the way through it, of values 0 to `steps`."""
    step: Int32 = value.astype(np.int32)
    np.clip(step, 0, steps - 1, out=step)
    return step, value - step.astype(np.float32)


def _unfolded(x: Float64, y: Float64) -> Float64:
    """Unit directions (3, B) of places on the octahedron's square, -1 to 1."""
    z = 1 - np.abs(x) - np.abs(y)
    back = z < 0
    ways = np.stack(
        [
            np.where(back, np.copysign(1 - np.abs(y), x), x),
            np.where(back, np.copysign(1 - np.abs(x), y), y),
            z,
        ]
    )
    unit: Float64 = ways / np.linalg.norm(ways, axis=0)
    return unit
