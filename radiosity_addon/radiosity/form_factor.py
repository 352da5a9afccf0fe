# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimators of form factors: which share of the light that leaves one patch reaches each other one.

Rays from a patch, spread evenly over it, tell at once of all that it sees: the share of them that meets patch j is
F[i, j]. Whereto they go is the choice: cosine-distributed, as the Nusselt analog has it, or through the cells of a
hemicube. The double-area integral is taken pair by pair instead (pairs.py); rays then only tell what escapes.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..arrays import Float16, Float32, Float64, Int32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..geometry.visibility import Visibility, passing_chance
from ..lighting.sky import Sky, cells
from ..sampling import cosine_directions, even_uniform, hash_uniform
from ..settings import BakeSettings
from .hemicube import hemicube, resolution_for
from .pairs import exchange_of_pairs
from .patches import SKY, Patches
from .transport import Transport, View, closed, join_hits

TRACED_RAYS = 16384
"""Rays of patches of mean size that are traced at once: their arrays, 2 MB, stay in cache."""

RAYS_OF_A_POINT = 16
"""Of the rays that a patch would send, so many pay for one of its points in the double-area integral."""


class RayPattern(Protocol):
    """Whereto patches send rays, and what each counts."""

    @property
    def weights(self) -> Float64 | None:
        """(C,) float64, what each ray of a patch counts, 1 on average, where all send C; None: 1 each."""
        ...

    def counts(self, area: Float64) -> Int64:
        """Rays (N,) of patches of `area` (N,), m2."""
        ...

    def directions(self, normals: Float32, ids: Int32, sample: Int64) -> Float32:
        """Unit directions (R, 3) of the samples (R,) of patches `ids` (R,)."""
        ...


@dataclass(frozen=True)
class NusseltRays:
    """Cosine-distributed rays: Sobol points on the unit disc, lifted to the hemisphere (Malley 1988).

    Attributes:
        mean: rays of a patch of mean area
    """

    mean: int
    weights: Float64 | None = None

    def counts(self, area: Float64) -> Int64:
        """About `mean` rays; they grow with the root of the area."""
        return ray_counts(area, self.mean)

    def directions(self, normals: Float32, ids: Int32, sample: Int64) -> Float32:
        """Density cos / pi."""
        return cosine_directions(normals, even_uniform(ids, sample, 0), even_uniform(ids, sample, 1))


class HemicubeRays:
    """One ray through each cell of a hemicube, which stands turned by another angle on each patch."""

    def __init__(self, resolution: int) -> None:
        self._cube = hemicube(resolution)
        self.weights: Float64 | None = self._cube.weights * len(self._cube.weights)

    def counts(self, area: Float64) -> Int64:
        """As many for each patch."""
        return np.full(len(area), len(self._cube.weights), np.int64)

    def directions(self, normals: Float32, ids: Int32, sample: Int64) -> Float32:
        """Through the middles of cells."""
        x, y, z = np.ascontiguousarray(self._cube.directions[sample].T)
        turn = hash_uniform(ids, 0) * np.float32(2 * np.pi)
        cosine, sine = np.cos(turn), np.sin(turn)
        x, y = cosine * x - sine * y, sine * x + cosine * y
        nx, ny, nz = np.ascontiguousarray(normals.T)
        sign = np.copysign(np.float32(1), nz)  # the basis without branches of Duff et al. (2017), listing 3
        a = -1 / (sign + nz)
        b = nx * ny * a
        along = (1 + sign * nx * nx * a, sign * b, -sign * nx)
        across = (b, sign + ny * ny * a, -ny)
        rows = [x * u + y * v + z * n for u, v, n in zip(along, across, (nx, ny, nz), strict=True)]
        return np.ascontiguousarray(np.stack(rows, axis=1))


def trace_transport(
    patches: Patches, visibility: Visibility, settings: BakeSettings, sky: Sky | None = None
) -> Generator[float, None, Transport]:
    """How patches exchange light, by the estimator that the settings name; yields the share done."""
    rays, workers = settings.steps.patch_rays, settings.workers
    pattern = HemicubeRays(resolution_for(rays)) if settings.form_factors == "hemicube" else NusseltRays(rays)
    viewing = trace_view(patches, pattern, visibility, workers, sky)
    if settings.form_factors == "area":
        view, tint, radiance = yield from scaled(viewing, 0.0, 0.1)
        points = max(1, rays // RAYS_OF_A_POINT)
        rows = yield from scaled(exchange_of_pairs(patches, visibility, points, workers), 0.1, 0.9)
    else:
        view, tint, radiance = yield from scaled(viewing, 0.0, 0.8)
        rows = yield from scaled(join_hits(patches.area, view, workers), 0.8, 0.9)
    transport = yield from scaled(closed(patches.area, view, rows, workers), 0.9, 1.0)
    return replace(transport, sky_tint=tint, sky_radiance=radiance)


def trace_view(
    patches: Patches, pattern: RayPattern, visibility: Visibility, workers: int, sky: Sky | None = None
) -> Fractions[tuple[View, Float64, Float64]]:
    """Trace what patches see; yields the share done. Rays that meet NOTHING don't count.

    Returns:
        what the rays met, and of each patch's rays that left the scene the mean tint and radiance (N, 3)
    """
    rays = pattern.counts(patches.area)
    begin = np.concatenate([[0], np.cumsum(rays)])
    target = np.empty(begin[-1], np.int32)
    tint: Float16 | None = np.ones((len(target), 3), np.float16) if visibility.channels > 1 else None
    sky_tint = np.ones((len(rays), 3))
    sky_radiance = np.zeros((len(rays), 3))

    def trace(start: int, stop: int) -> None:
        ids = np.repeat(np.arange(start, stop, dtype=np.int32), rays[start:stop])
        sample = np.arange(begin[start], begin[stop]) - begin[ids]
        origins, normals = patches.origins(ids, sample)
        directions = pattern.directions(normals, ids, sample)
        hits = visibility.first_hit(origins, directions, passing_chance(visibility, ids, sample), both_ways=True)
        met = patches.at(hits)
        target[begin[start] : begin[stop]] = met
        if tint is not None and hits.tint is not None:
            tint[begin[start] : begin[stop]] = hits.tint
        if hits.tint is None and sky is None:
            return
        gone = np.flatnonzero(met == SKY)
        owner = ids[gone] - start
        weight = None if pattern.weights is None else pattern.weights[sample[gone]]
        if hits.tint is not None:
            sky_tint[start:stop] = mean_of(hits.tint[gone], owner, stop - start, weight)
        if sky is not None:
            seen = sky.radiance[cells(directions[gone])]
            if hits.tint is not None:
                seen *= hits.tint[gone]
            sky_radiance[start:stop] = mean_of(seen, owner, stop - start, weight)

    chunk = max(1, TRACED_RAYS * len(rays) // max(len(target), 1))
    yield from in_chunks(trace, len(rays), chunk, workers)
    return View(rays, target, pattern.weights, tint), sky_tint, sky_radiance


def mean_of(values: Float32, owner: Int32, count: int, weight: Float64 | None = None) -> Float64:
    """Weighted mean (count, 3) of the values (R, 3) of each owner (R,); 0 for those without any."""
    total = np.bincount(owner, weights=weight, minlength=count)
    columns = (channel if weight is None else channel * weight for channel in values.T)
    sums = [np.bincount(owner, weights=column, minlength=count) for column in columns]
    return np.stack(sums, axis=1) / np.where(total > 0, total, 1)[:, None]


def ray_counts(area: Float64, mean: int) -> Int64:
    """Rays (N,) of patches of `area` (N,), about `mean` for a patch of mean area.

    They grow with the square root of the area: in proportion to it every ray would carry the same power, the best
    for the light as a whole, alike for all every row would be equally exact; the root serves both. The bounds of 1/4
    and 4 keep a scene with one huge patch from starving the others.
    """
    if not len(area):
        return np.zeros(0, np.int64)
    share = np.sqrt(area / area.mean())
    return np.maximum(np.rint(mean * np.clip(share, 0.25, 4.0)), 1).astype(np.int64)
