# SPDX-License-Identifier: GPL-3.0-or-later
"""The rays of the final gather: stratified pilots first, then guided ones, and what each ray counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import Bools, Float32, Int32, Int64
from .chunks import Fractions, in_chunks, scaled
from .gather_points import GatherPoints, cell_keys
from .guiding import direction_bins, directions_in, draw_bins, pool
from .patches import NOTHING, Patches
from .sampling import cosine_directions, even_uniform
from .settings import BakeSettings
from .texels import STRATA, Texels
from .visibility import Visibility

BELOW = -3
"""A direction below the horizon: it counts, and brings nothing."""

RAYS = 1 << 15
"""Rays traced at once."""

FINE_PART = 3
"""Points close together send one ray of so many: the fit joins the rays of several."""

PILOT_SHARE = 0.75
"""Of the rays of a point; they also serve where nothing outshines the rest."""

POOL_WIDTH = 4.0
"""Pilot rays are pooled over cells this many times as wide as the coarsest cells of gather points."""

JITTER_DIMENSIONS = (4, 5)


@dataclass(frozen=True, eq=False)
class Tally:
    """What the rays of P points met, and their weights.

    Attributes:
        elements: (P, R) int32, the element that each ray met, pilots first
        weights: (P, R) float32: irradiance is the weighted sum of the elements' radiances; a row sums to pi on average
        pilots: how many of the R rays are pilots
    """

    elements: Int32
    weights: Float32
    pilots: int

    def sum(self, table: Float32, workers: int) -> Fractions[Float32]:
        """Irradiance (P, C), W/m2, under radiances `table` (elements, C).

        The weights should add up to pi and do so only on average, and rays that met nothing that takes part are
        missing. What is missing is taken to be as bright as the dimmer part of the view (a control variate): exact
        where all is equally bright, harmless where a small window outshines the rest.
        """

        def work(start: int, stop: int) -> Float32:
            element = self.elements[start:stop]
            weight = self.weights[start:stop] * (element != NOTHING)
            radiance = table[element]
            pilot = radiance[:, : self.pilots]
            sent = (weight[:, : self.pilots] > 0).sum(1)[:, None]
            mean = pilot.sum(1) / np.maximum(sent, 1)
            dim = np.minimum(pilot, mean[:, None]).sum(1) / np.maximum(sent, 1)
            light = np.einsum("pr,prc->pc", weight, radiance)
            return np.asarray(light + dim * (np.float32(np.pi) - weight.sum(1))[:, None], np.float32)

        rows = max(1, RAYS // max(1, self.elements.shape[1]))
        parts = yield from in_chunks(work, len(self.elements), rows, workers)
        return np.concatenate(parts) if parts else np.zeros((0, table.shape[1]), np.float32)


class GatherRays:
    """Traces the rays of gather points, chosen bit by bit."""

    def __init__(
        self, texels: Texels, patches: Patches, visibility: Visibility, settings: BakeSettings, bright: Float32
    ) -> None:
        self._texels, self._patches, self._visibility = texels, patches, visibility
        self._workers = settings.workers
        self._pilots = round(settings.steps.gather_rays * PILOT_SHARE)
        self._guided = settings.steps.gather_rays - self._pilots
        self._bright = bright
        self._elements: list[Int32] = []
        self._bins: list[NDArray[np.uint16]] = []
        self._fine: list[Bools] = []

    def look(self, chosen: Int64, fine: Bools) -> Fractions[tuple[Float32, Float32, Float32]]:
        """Trace the pilot rays of texels (Q,); returns harmonic mean and least distance, m, and light; all (Q,).

        The points that are `fine`, the last ones, send fewer rays; what is not sent counts nothing.
        """
        elements = np.full((len(chosen), self._pilots), BELOW, np.int32)
        bins = np.zeros((len(chosen), self._pilots), np.uint16)
        harmonic, nearest, light = (np.empty(len(chosen), np.float32) for _ in range(3))

        def trace(first: int, last: int, pilots: int) -> Fractions[list[None]]:
            def work(start: int, stop: int) -> None:
                part = slice(first + start, first + stop)
                rows = np.repeat(np.arange(stop - start), pilots)
                texel, column = chosen[part], np.tile(np.arange(pilots), stop - start)
                u, v = (even_uniform(texel[rows], column, dimension) for dimension in (0, 1))
                directions = cosine_directions(self._texels.shading_normal[texel][rows], u, v)
                element, distance = self._trace(texel, rows, column, directions)
                inverse = 1 / np.maximum(distance, np.float32(1e-9)).reshape(-1, pilots)
                elements[part, :pilots] = element.reshape(-1, pilots)
                bins[part, :pilots] = direction_bins(directions).reshape(-1, pilots)
                harmonic[part], nearest[part] = 1 / inverse.mean(1), 1 / inverse.max(1)
                light[part] = self._bright[elements[part, :pilots]].mean(1)

            return in_chunks(work, last - first, max(1, RAYS // pilots), self._workers)

        coarse = len(chosen) - int(np.count_nonzero(fine))
        share = coarse / max(1, len(chosen))
        yield from scaled(trace(0, coarse, self._pilots), 0, share)
        yield from scaled(trace(coarse, len(chosen), max(1, self._pilots // FINE_PART)), share, 1)
        self._elements.append(elements)
        self._bins.append(bins)
        self._fine.append(fine)
        return harmonic, nearest, light

    def clearance(self, chosen: Int64) -> Fractions[Float32]:
        """Distance (Q,), m, from texels to the next surface along the normal."""
        distance = np.empty(len(chosen), np.float32)

        def work(start: int, stop: int) -> None:
            texel = chosen[start:stop]
            origins = self._texels.origins(texel, np.zeros(len(texel), np.int64))
            distance[start:stop] = self._visibility.first_hit(origins, self._texels.normal[texel]).distance

        yield from in_chunks(work, len(chosen), RAYS, self._workers)
        return distance

    def _trace(self, texel: Int64, rows: Int64, sample: Int64, directions: Float32) -> tuple[Int32, Float32]:
        """Element and distance (R,) of rays from texels (Q,), ray r from texel[rows[r]], spread over its strata."""
        texels = self._texels
        strata = texels.origins(np.repeat(texel, STRATA), np.tile(np.arange(STRATA), len(texel)))
        hits = self._visibility.first_hit(strata[rows * STRATA + (sample & (STRATA - 1))], directions)
        element = self._patches.elements(hits)
        shading, geometric = texels.shading_normal[texel], texels.normal[texel]
        tilted = np.einsum("ij,ij->i", shading, geometric) < 1 - 1e-6
        if tilted.any():
            ray = np.flatnonzero(tilted[rows])
            ray = ray[np.einsum("ij,ij->i", directions[ray], geometric[rows[ray]]) <= 0]
            element[ray] = BELOW
        return element, hits.distance

    def tally(self, points: GatherPoints, base: float) -> Fractions[Tally]:
        """Trace the guided rays of all points looked at, and weigh all rays."""
        elements = np.empty((points.count, self._pilots + self._guided), np.int32)
        elements[:, : self._pilots] = np.concatenate(self._elements or [elements[:0, : self._pilots]])
        bins = np.concatenate(self._bins or [np.zeros((0, self._pilots), np.uint16)])
        fine = np.concatenate(self._fine or [np.zeros(0, bool)])
        self._elements, self._bins, self._fine = [], [], []
        weights = np.empty(elements.shape, np.float32)
        keys = cell_keys(self._texels, points.texel, base * POOL_WIDTH)
        order = np.argsort(keys, kind="stable")
        begin = np.flatnonzero(np.concatenate([[True], np.diff(keys[order]) != 0])[: len(keys)])
        # chunks end with a pool, so that no histogram is needed twice
        wanted = np.arange(0, points.count, max(1, RAYS // self._guided))
        cuts = np.append(begin[np.unique(np.searchsorted(begin, wanted))[:-1]] if len(begin) else begin, points.count)
        cuts = np.unique(np.concatenate([[0], cuts]))

        def work(start: int, stop: int) -> None:
            low, high = int(cuts[start]), int(cuts[stop])
            mine = order[low:high]
            pools = np.searchsorted(begin, np.arange(low, high), side="right") - 1
            rank = np.arange(low, high) - begin[pools]
            # Each half of a pool is guided by the pilots of the other: a ray weighed by a histogram that it helped
            # to fill would count too little (4 % of the light was missing so).
            fold = 2 * (pools - pools[0]) + rank % 2
            elements[mine, self._pilots :], weights[mine] = self._guide(
                points.texel[mine], elements[mine, : self._pilots], bins[mine], fold, 2 * int(pools[0]), fine[mine]
            )

        yield from in_chunks(work, len(cuts) - 1, 1, self._workers)
        return Tally(elements, weights, self._pilots)

    def _guide(
        self, texel: Int64, elements: Int32, bins: NDArray[np.uint16], fold: Int64, first: int, fine: Bools
    ) -> tuple[Int32, Float32]:
        """Guided elements (Q, guided) and weights (Q, all) of points whose pilots met `elements` in `bins`."""
        count = int(fold.max(initial=0)) + 2
        share = np.where(fine, np.float32(1 / FINE_PART), np.float32(1))  # of the rays of a row that are sent
        light = self._bright[elements].reshape(-1)  # rays not sent met nothing bright
        density = pool(np.repeat(fold ^ 1, self._pilots), count, bins.reshape(-1).astype(np.int64), light)
        drawn = draw_bins(density, self._guided, first)
        rows = np.repeat(np.arange(len(texel)), self._pilots)
        u = even_uniform(texel[rows], np.tile(np.arange(self._pilots), len(texel)), 0)
        cosine = np.sqrt(1 - u).reshape(-1, self._pilots)
        pilot_weights = self._balance(cosine, density[fold[:, None], bins], share[:, None])
        pilot_weights[fine, max(1, self._pilots // FINE_PART) :] = 0

        rows = np.repeat(np.arange(len(texel)), self._guided)
        sample = np.tile(np.arange(self._guided), len(texel))
        into = drawn[fold].reshape(-1)
        u, v = (even_uniform(texel[rows], sample, dimension) for dimension in JITTER_DIMENSIONS)
        directions = directions_in(into, u, v)
        cosine = np.einsum("ij,ij->i", directions, self._texels.shading_normal[texel][rows])
        left_out = fine[rows] & (sample % FINE_PART > 0)
        sent = np.flatnonzero((cosine > 0) & density.any(1)[fold][rows] & ~left_out)
        element = np.full(len(rows), BELOW, np.int32)
        element[sent] = self._trace(texel, rows[sent], sample[sent], directions[sent])[0]
        weight = np.zeros(len(rows), np.float32)
        weight[sent] = self._balance(cosine[sent], density[fold[rows[sent]], into[sent]], share[rows[sent]])
        shape = (len(texel), self._guided)
        return element.reshape(shape), np.concatenate([pilot_weights, weight.reshape(shape)], axis=1)

    def _balance(self, cosine: Float32, density: Float32, share: Float32) -> Float32:
        """Cosine over the summed densities of both kinds of rays sent: the balance heuristic's weight."""
        total = np.float32(self._pilots / np.pi) * cosine
        total += np.float32(self._guided) * density
        total *= share
        total += np.float32(1e-9)
        weight: Float32 = np.divide(cosine, total, out=total)
        return weight
