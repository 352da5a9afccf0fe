# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the rays of gather points start, found once for all rays of a point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float32, Int64
from ..chunks import Fractions, in_chunks
from ..columns import dots
from ..geometry.texels import STRATA, Texels

CHUNK = 1 << 13
"""Points whose strata are found in one go."""

TILTED = 1 - 1e-6
"""Cosine between a face and a shading normal below which their horizons differ."""


@dataclass(frozen=True, eq=False)
class Stands:
    """The strata of the texels that Q points stand at, four of each.

    Attributes:
        texel: (Q,) int64
        origins: (4 Q, 3) float32, m, lifted off the surface
        faces: (4 Q, 3) float32, unit geometric normals
        tilted: (4 Q,) bool, where the face has another horizon than the texel's shading normal
    """

    texel: Int64
    origins: Float32
    faces: Float32
    tilted: Bools

    @classmethod
    def of(cls, texels: Texels, texel: Int64, workers: int) -> Fractions[Stands]:
        """Those of points at texels (Q,)."""
        count = STRATA * len(texel)
        origins, all_faces = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
        tilted = np.empty(count, bool)

        def work(start: int, stop: int) -> None:
            own, part = texel[start:stop], slice(STRATA * start, STRATA * stop)
            points, triangle = texels.points(np.repeat(own, STRATA), np.tile(np.arange(STRATA), len(own)))
            faces = texels.surfaces.normals(triangle)
            shading = np.repeat(texels.shading_normal.take(own, axis=0), STRATA, axis=0)
            tilted[part] = dots(shading, faces) < TILTED
            all_faces[part] = faces
            faces *= np.float32(texels.surfaces.offset)
            points += faces
            origins[part] = points

        yield from in_chunks(work, len(texel), CHUNK, workers)
        return cls(texel, origins, all_faces, tilted)

    def only(self, chosen: Int64) -> Stands:
        """Those at positions `chosen` (K,)."""
        strata = (chosen[:, None] * STRATA + np.arange(STRATA)).reshape(-1)
        origins, faces = self.origins.take(strata, axis=0), self.faces.take(strata, axis=0)
        return Stands(self.texel[chosen], origins, faces, self.tilted[strata])

    @staticmethod
    def joined(parts: Sequence[Stands]) -> Stands:
        """All of them, one after the other."""
        return Stands(
            np.concatenate([part.texel for part in parts]),
            np.concatenate([part.origins for part in parts]),
            np.concatenate([part.faces for part in parts]),
            np.concatenate([part.tilted for part in parts]),
        )
