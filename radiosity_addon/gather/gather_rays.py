# SPDX-License-Identifier: GPL-3.0-or-later
"""The rays of the final gather: stratified pilots first, then guided ones, and what each ray counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Float16, Float32, Int32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..columns import dots, sums
from ..geometry.texels import STRATA, Texels
from ..geometry.visibility import Hits, Visibility, passing_chance
from ..lighting.sky import cells
from ..radiosity.illumination import SPECIAL_ROWS
from ..radiosity.patches import NOTHING, SKY, Patches
from ..sampling import cosine_directions, even_uniform
from ..settings import BakeSettings
from .gather_points import GatherPoints, cell_keys
from .gleams import Gleams
from .guiding import BINS, direction_bins, directions_in, draw_bins, pool

BELOW = -3
"""A direction below the horizon: it counts, and brings nothing."""

RAYS = 1 << 15
"""Rays traced at once."""

FINE_PART = 2
"""Points close together send one ray of so many: the fit joins the rays of several."""

PILOT_SHARE = 0.75
"""Of the rays of a point; they also serve where nothing outshines the rest."""

POOL_WIDTH = 4.0
"""Pilot rays are pooled over cells this many times as wide as the coarsest cells of gather points."""

JITTER_DIMENSIONS = (4, 5)


@dataclass(frozen=True)
class RayCounts:
    """Rays of a point: pilots and guided ones. A `fine` point, close to others, sends only part of them."""

    pilots: int
    guided: int

    def sent(self, fine: bool) -> tuple[int, int]:
        """Pilots and guided rays of a point."""
        part = FINE_PART if fine else 1
        return -(-self.pilots // part), -(-self.guided // part)

    def columns(self, fine: bool) -> Int64:
        """Where the rays of a point stand in a row that has room for all: pilots first."""
        pilots, guided = self.sent(fine)
        return np.concatenate([np.arange(pilots), self.pilots + np.arange(guided)])


@dataclass(frozen=True, eq=False)
class Tally:
    """What the rays of P points met, and their weights.

    Attributes:
        elements: (P, R) int32, the element that each ray met, pilots first
        weights: (P, R) float32: irradiance is the weighted sum of the elements' radiances; a row sums to pi on average
        counts: of rays in a row
        fine: (P,) bool, points that sent only part of them
        tints: (P, R, 3) float16, what colours the light on the way of a ray; None: nothing
        gleams: (P, C) float32, W/m2, what gloss adds to the irradiance of all elements; None: nothing
    """

    elements: Int32
    weights: Float32
    counts: RayCounts
    fine: Bools
    tints: Float16 | None = None
    gleams: Float32 | None = None

    def sum(self, table: Float32, workers: int) -> Fractions[Float32]:
        """Irradiance (P, C), W/m2, under radiances `table` (elements, C + 1), the last column the sum of the others.

        The weights should add up to pi and do so only on average, and rays that met nothing that takes part are
        missing. What is missing is taken to be as bright as the dimmer part of the view (a control variate): exact
        where all is equally bright, harmless where a small window outshines the rest.
        """
        total: Float32 = np.empty((len(self.elements), table.shape[1] - 1), np.float32)
        for fine in (False, True):
            rows = np.flatnonzero(self.fine == fine)
            columns, pilots = self.counts.columns(fine), self.counts.sent(fine)[0]

            def work(start: int, stop: int, rows: Int64 = rows, columns: Int64 = columns, pilots: int = pilots) -> None:
                chosen = rows[start:stop]
                element = self.elements.take(chosen, axis=0).take(columns, axis=1)
                weight = self.weights.take(chosen, axis=0).take(columns, axis=1)
                met = element != NOTHING
                weight *= met
                radiance = table.take(element, axis=0)
                if self.tints is not None:
                    colors = radiance[:, :, :-1].reshape(*element.shape, -1, 3)
                    colors *= self.tints.take(chosen, axis=0).take(columns, axis=1)[:, :, None]
                    radiance[:, :, :-1] = colors.reshape(*element.shape, -1)
                    radiance[:, :, -1] = sums(radiance[:, :, :-1])
                # which rays are dim is decided by all channels and light groups at once, so that groups add up
                bright = np.ascontiguousarray(radiance[:, :pilots, -1])
                count = np.maximum(np.count_nonzero(met[:, :pilots], axis=1), 1).astype(np.float32)[:, None]
                missing = np.float32(np.pi) - weight.sum(1)[:, None]
                level = bright.sum(1)[:, None] / count
                np.maximum(bright, np.maximum(level, np.float32(1e-30)), out=bright)
                dim = np.divide(level, bright, out=bright)
                dim *= missing / count
                weight[:, :pilots] += dim
                total[rows[start:stop]] = np.einsum("pr,prc->pc", weight, radiance)[:, :-1]

            steps = in_chunks(work, len(rows), max(1, RAYS // len(columns)), workers)
            yield from scaled(steps, 0.5 * fine, 0.5 + 0.5 * fine)
        return total


@dataclass(frozen=True, eq=False)
class _Seen:
    """Gleams that K rays see: of which point and in which column of its row they are, and their light (K, C)."""

    point: Int64
    column: Int64
    light: Float32

    @classmethod
    def joined(cls, parts: Sequence[_Seen]) -> _Seen:
        point, column, light = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("point", "column", "light")
        )
        return cls(point, column, light)

    def irradiance(self, weights: Float32) -> Float32:
        """What they bring to each of P points: (P, C) float32, by the weights (P, R) of rays."""
        weight = weights[self.point, self.column].astype(np.float64)
        columns = [np.bincount(self.point, weight * light, len(weights)) for light in self.light.T]
        return np.stack(columns, axis=1).astype(np.float32)


class GatherRays:
    """Traces the rays of gather points, chosen bit by bit."""

    def __init__(
        self,
        texels: Texels,
        patches: Patches,
        visibility: Visibility,
        settings: BakeSettings,
        bright: Float32,
        gleams: Gleams | None = None,
    ) -> None:
        self._texels, self._patches, self._visibility = texels, patches, visibility
        self._workers = settings.workers
        pilots = round(settings.steps.gather_rays * PILOT_SHARE)
        self._counts = RayCounts(pilots, settings.steps.gather_rays - pilots)
        self._bright = bright
        self._cells = len(bright) > texels.count + patches.count + SPECIAL_ROWS
        self._elements: list[Int32] = []
        self._bins: list[NDArray[np.uint16]] = []
        self._fine: list[Bools] = []
        self._tints: list[Float16] = []
        self._tinted = visibility.channels > 1
        self._gleams = gleams
        self._seen: list[_Seen] = []

    def look(self, chosen: Int64, fine: Bools) -> Fractions[tuple[Float32, Float32, Float32]]:
        """Trace the pilot rays of texels (Q,); returns harmonic mean and least distance, m, and light; all (Q,).

        The points that are `fine`, the last ones, send fewer rays; what is not sent counts nothing.
        """
        elements = np.full((len(chosen), self._counts.pilots), BELOW, np.int32)
        bins = np.zeros(elements.shape, np.uint16)
        tints = np.ones((*elements.shape, 3) if self._tinted else 0, np.float16)
        harmonic, nearest, light = (np.empty(len(chosen), np.float32) for _ in range(3))
        before = sum(map(len, self._elements))

        def trace(first: int, last: int, pilots: int) -> Fractions[list[_Seen | None]]:
            def work(start: int, stop: int) -> _Seen | None:
                part = slice(first + start, first + stop)
                rows = np.repeat(np.arange(stop - start), pilots)
                texel, column = chosen[part], np.tile(np.arange(pilots), stop - start)
                u, v = (even_uniform(texel[rows], column, dimension) for dimension in (0, 1))
                normals = self._texels.shading_normal.take(texel, axis=0)
                directions = cosine_directions(normals.take(rows, axis=0), u, v)
                element, hits = self._trace(texel, rows, column, directions)
                if hits.tint is not None:
                    tints[part, :pilots] = hits.tint.reshape(-1, pilots, 3)
                inverse = 1 / np.maximum(hits.distance, np.float32(1e-9)).reshape(-1, pilots)
                elements[part, :pilots] = element.reshape(-1, pilots)
                bins[part, :pilots] = direction_bins(directions).reshape(-1, pilots)
                harmonic[part], nearest[part] = 1 / inverse.mean(1), 1 / inverse.max(1)
                light[part] = self._bright.take(element).reshape(-1, pilots).mean(1)
                return self._gleaming(element, directions, before + first + start + rows, column)

            return in_chunks(work, last - first, max(1, RAYS // pilots), self._workers)

        coarse = len(chosen) - int(np.count_nonzero(fine))
        share = coarse / max(1, len(chosen))
        seen = yield from scaled(trace(0, coarse, self._counts.sent(False)[0]), 0, share)
        seen += yield from scaled(trace(coarse, len(chosen), self._counts.sent(True)[0]), share, 1)
        self._seen += [part for part in seen if part is not None]
        self._elements.append(elements)
        self._bins.append(bins)
        self._fine.append(fine)
        self._tints.append(tints)
        return harmonic, nearest, light

    def _gleaming(self, element: Int32, directions: Float32, point: Int64, column: Int64) -> _Seen | None:
        """What rays (R,) of points (R,) see of suns in gloss."""
        if self._gleams is None:
            return None
        ray, light = self._gleams.seen(element, directions)
        return _Seen(point[ray], column[ray], light)

    def clearance(self, chosen: Int64) -> Fractions[Float32]:
        """Distance (Q,), m, from texels to the next surface along the normal."""
        distance = np.empty(len(chosen), np.float32)

        def work(start: int, stop: int) -> None:
            texel = chosen[start:stop]
            origins = self._texels.origins(texel, np.zeros(len(texel), np.int64))
            distance[start:stop] = self._visibility.first_hit(origins, self._texels.normal[texel]).distance

        yield from in_chunks(work, len(chosen), RAYS, self._workers)
        return distance

    def _trace(self, texel: Int64, rows: Int64, sample: Int64, directions: Float32) -> tuple[Int32, Hits]:
        """Elements (R,) and hits of rays from texels (Q,), ray r from texel[rows[r]], spread over its strata."""
        texels = self._texels
        strata = texels.origins(np.repeat(texel, STRATA), np.tile(np.arange(STRATA), len(texel)))
        chance = passing_chance(self._visibility, texel[rows], sample)
        origins = strata.take(rows * STRATA + (sample & (STRATA - 1)), axis=0)
        hits = self._visibility.first_hit(origins, directions, chance)
        element = self._patches.elements(hits)
        if self._cells:
            left = np.flatnonzero(element == SKY)
            element[left] = cells(directions[left]) + np.int32(texels.count + self._patches.count)
        # each stratum has the horizon of its own face: texels of folded cloth lie on two
        faces = texels.surfaces.normals(texels.footprints.triangles(texel).reshape(-1))
        tilted = dots(np.repeat(texels.shading_normal.take(texel, axis=0), STRATA, axis=0), faces) < 1 - 1e-6
        if tilted.any():
            stratum = rows * STRATA + (sample & (STRATA - 1))
            ray = np.flatnonzero(tilted.take(stratum))
            ray = ray[dots(directions.take(ray, axis=0), faces.take(stratum[ray], axis=0)) <= 0]
            element[ray] = BELOW
        return element, hits

    def tally(self, points: GatherPoints, base: float) -> Fractions[Tally]:
        """Trace the guided rays of all points looked at, and weigh all rays."""
        pilots, guided = self._counts.sent(False)
        elements = np.full((points.count, pilots + guided), BELOW, np.int32)
        elements[:, :pilots] = np.concatenate(self._elements or [elements[:0, :pilots]])
        bins = np.concatenate(self._bins or [np.zeros((0, pilots), np.uint16)])
        fine = np.concatenate(self._fine or [np.zeros(0, bool)])
        tints = None
        if self._tinted:
            tints = np.ones((*elements.shape, 3), np.float16)
            tints[:, :pilots] = np.concatenate([tints[:0, :pilots], *self._tints])
        self._elements, self._bins, self._fine, self._tints = [], [], [], []
        weights = np.zeros(elements.shape, np.float32)
        width = base * POOL_WIDTH
        keys = yield from scaled(cell_keys(self._texels, points.texel, width, self._workers), 0, 0)
        order = np.argsort(keys, kind="stable")
        begin = np.flatnonzero(np.concatenate([[True], np.diff(keys[order]) != 0])[: len(keys)])
        # chunks end with a pool, so that no histogram is needed twice
        wanted = np.arange(0, points.count, max(1, RAYS // guided))
        cuts = np.append(begin[np.unique(np.searchsorted(begin, wanted))[:-1]] if len(begin) else begin, points.count)
        cuts = np.unique(np.concatenate([[0], cuts]))

        def work(start: int, stop: int) -> list[_Seen]:
            low, high = int(cuts[start]), int(cuts[stop])
            gleaming = []
            mine = order[low:high]
            pools = np.searchsorted(begin, np.arange(low, high), side="right") - 1
            rank = np.arange(low, high) - begin[pools]
            # Each half of a pool is guided by the pilots of the other: a ray weighed by a histogram that it helped
            # to fill would count too little (4 % of the light was missing so).
            fold = 2 * (pools - pools[0]) + rank % 2
            sent = elements.take(mine, axis=0)[:, :pilots].reshape(-1)
            light = self._bright.take(sent)  # rays not sent met nothing bright
            into = bins.take(mine, axis=0).reshape(-1).astype(np.int64)
            density = pool(np.repeat(fold ^ 1, pilots), int(fold.max()) + 2, into, light)
            for some in (False, True):
                here = np.flatnonzero(fine[mine] == some)
                points_here = mine[here]
                few, rest = self._counts.sent(some)
                cosine = self._pilot_cosines(points.texel[points_here], few)
                row = BINS * fold[here, None]
                seen = density.take(row + bins.take(points_here, axis=0)[:, :few])
                weights[points_here, :few] = _balance(cosine, seen, few, rest)
                drawn = draw_bins(density, rest, 2 * int(pools[0]))[fold[here]]
                lit = density.any(1)[fold[here]]
                element, cosine, tint, seen_there = self._guide(points.texel[points_here], drawn, lit)
                elements[points_here, pilots : pilots + rest] = element
                if seen_there is not None:
                    gleaming.append(
                        replace(seen_there, point=points_here[seen_there.point], column=seen_there.column + pilots)
                    )
                if tints is not None and tint is not None:
                    tints[points_here, pilots : pilots + rest] = tint
                seen = density.take(row + drawn)
                weights[points_here, pilots : pilots + rest] = _balance(cosine, seen, few, rest)
            return gleaming

        guided_seen = yield from in_chunks(work, len(cuts) - 1, 1, self._workers)
        self._seen += [part for parts in guided_seen for part in parts]
        gleams = _Seen.joined(self._seen).irradiance(weights) if self._seen else None
        self._seen = []
        return Tally(elements, weights, self._counts, fine, tints, gleams)

    def _pilot_cosines(self, texel: Int64, pilots: int) -> Float32:
        """Cosines (Q, pilots) of pilot rays with their shading normals."""
        u = even_uniform(np.repeat(texel, pilots), np.tile(np.arange(pilots), len(texel)), 0)
        return np.asarray(np.sqrt(1 - u).reshape(-1, pilots), np.float32)

    def _guide(self, texel: Int64, drawn: Int64, lit: Bools) -> tuple[Int32, Float32, Float32 | None, _Seen | None]:
        """Elements, cosines and tints, (Q, guided), of rays into bins `drawn` (Q, guided); cosine 0 for those not sent.

        And the gleams that they see.

        Args:
            lit: (Q,) bool, texels whose bins were drawn from light; no others send rays
        """
        guided = drawn.shape[1]
        rows = np.repeat(np.arange(len(texel)), guided)
        sample = np.tile(np.arange(guided), len(texel))
        u, v = (even_uniform(texel[rows], sample, dimension) for dimension in JITTER_DIMENSIONS)
        directions = directions_in(drawn.reshape(-1), u, v)
        normals = self._texels.shading_normal.take(texel, axis=0)
        cosine = np.einsum("qsx,qx->qs", directions.reshape(*drawn.shape, 3), normals).reshape(-1)
        cosine *= np.repeat(lit, guided)
        np.maximum(cosine, 0, out=cosine)
        sent = np.flatnonzero(cosine)
        element = np.full(len(rows), BELOW, np.int32)
        ways = directions.take(sent, axis=0)
        element[sent], hits = self._trace(texel, rows[sent], sample[sent], ways)
        gleaming = self._gleaming(element[sent], ways, rows[sent], sample[sent])
        tint = None
        if hits.tint is not None:
            tint = np.ones((len(rows), 3), np.float32)
            tint[sent] = hits.tint
            tint = tint.reshape(*drawn.shape, 3)
        return element.reshape(drawn.shape), cosine.reshape(drawn.shape), tint, gleaming


def _balance(cosine: Float32, density: Float32, pilots: int, guided: int) -> Float32:
    """Cosine over the summed densities of both kinds of rays sent: the balance heuristic's weight."""
    total = np.float32(pilots / np.pi) * cosine
    total += np.float32(guided) * density
    total += np.float32(1e-9)
    weight: Float32 = np.divide(cosine, total, out=total)
    return weight
