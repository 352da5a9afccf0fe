# SPDX-License-Identifier: GPL-3.0-or-later
"""The rays of the final gather: stratified pilots first, then guided ones, and what each ray counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Float16, Float32, Int32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..columns import dots
from ..geometry.texels import STRATA, Texels
from ..geometry.visibility import Hits, Visibility, passing_chance
from ..lighting.lamp_samples import bent_share
from ..lighting.sky import cells
from ..radiosity.illumination import SPECIAL_ROWS
from ..radiosity.patches import SKY, Patches
from ..sampling import cosine_directions, even_rows
from ..settings import BakeSettings
from .gather_points import GatherPoints, cell_keys
from .gleams import Gleams
from .guiding import BINS, Pools, cut_apart, direction_bins, directions_in, draw_bins, next_starts, pool
from .second_looks import further_looks, variances
from .stands import Stands
from .tally import BELOW, Further, RayCounts, Seen, Tally

RAYS = 1 << 16
"""Rays traced at once."""

PILOT_SHARE = 2 / 3
"""Of the rays of a point; they also serve where nothing outshines the rest. It makes them a power of
two, for which the sequence of their directions is most even."""

POOL_WIDTH = 4.0
"""Pilot rays are pooled over cells this many times as wide as the coarsest cells of gather points."""

JITTER_DIMENSIONS = (4, 5)


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
        far_from: float = np.inf,
        near_to: float = 0.0,
    ) -> None:
        """What rays meet counts as far away beyond `far_from`, m, and never as nearer than `near_to`."""
        self._texels, self._patches, self._visibility = texels, patches, visibility
        self._workers = settings.workers
        pilots = round(settings.steps.gather_rays * PILOT_SHARE)
        self._counts = RayCounts(pilots, settings.steps.gather_rays - pilots)
        self._bright = bright
        self._cells = len(bright) > texels.count + patches.count + SPECIAL_ROWS
        self._elements: list[Int32] = []
        self._bins: list[NDArray[np.uint16]] = []
        self._fine: list[Bools] = []
        self._stands: list[Stands] = []
        self._tints: list[Float16] = []
        self._bends = texels.surfaces.bends
        self._tinted = visibility.channels > 1 or self._bends
        self._gleams = gleams
        self._seen: list[Seen] = []
        self._far_from, self._nearest = np.float32(far_from), np.float32(max(near_to, 1e-9))
        self._far: list[Bools] = []

    def look(self, chosen: Int64, fine: Bools) -> Fractions[tuple[Float32, Float32, Float32]]:
        """Trace the pilot rays of texels (Q,); returns scale of change and least distance, m, and light; all (Q,).

        The scale is that of all rays or, where that is less, the one that counts rays by the light they bring.
        The points that are `fine`, the last ones, send fewer rays; what is not sent counts nothing.
        """
        elements = np.full((len(chosen), self._counts.pilots), BELOW, np.int32)
        bins = np.zeros(elements.shape, np.uint16)
        tints = np.ones((*elements.shape, 3) if self._tinted else 0, np.float16)
        far = np.zeros(elements.shape, bool)
        scale, nearest, light = (np.empty(len(chosen), np.float32) for _ in range(3))
        before = sum(map(len, self._elements))

        stands = yield from scaled(Stands.of(self._texels, chosen, self._workers), 0, 0)

        def trace(first: int, last: int, pilots: int) -> Fractions[list[list[Seen]]]:
            def work(start: int, stop: int) -> list[Seen]:
                part = slice(first + start, first + stop)
                own = stands.only(np.arange(first + start, first + stop))
                directions, element, hits, _ = self._send_pilots(own, pilots)
                if hits.tint is not None:
                    tints[part, :pilots] = hits.tint.reshape(-1, pilots, 3)
                far[part, :pilots] = self._is_far(element, hits).reshape(-1, pilots)
                inverse = 1 / np.maximum(hits.distance, np.float32(1e-9))
                inverse[element == BELOW] = 0  # its own surface is nothing that it sees
                inverse = inverse.reshape(-1, pilots)
                elements[part, :pilots] = element.reshape(-1, pilots)
                bins[part, :pilots] = direction_bins(directions).reshape(-1, pilots)
                nearest[part] = 1 / np.maximum(inverse.max(1), np.float32(1e-30))
                np.minimum(inverse, 1 / self._nearest, out=inverse)
                inverse *= inverse
                bright = self._bright.take(element).reshape(-1, pilots)
                light[part] = bright.mean(1)
                np.maximum(bright, 0, out=bright)
                bright /= np.maximum(bright.sum(1), np.float32(1e-30))[:, None]
                change = np.maximum(inverse.mean(1), np.einsum("pr,pr->p", bright, inverse))
                scale[part] = 1 / np.sqrt(np.maximum(change, np.float32(1e-30)))
                row, column = np.divmod(np.arange(len(element)), pilots)
                return self._gleaming(element, directions, before + first + start + row, column)

            return in_chunks(work, last - first, max(1, RAYS // pilots), self._workers)

        coarse = len(chosen) - int(np.count_nonzero(fine))
        share = coarse / max(1, len(chosen))
        seen = yield from scaled(trace(0, coarse, self._counts.sent(False)[0]), 0, share)
        seen += yield from scaled(trace(coarse, len(chosen), self._counts.sent(True)[0]), share, 1)
        self._seen += [part for parts in seen for part in parts]
        self._stands.append(stands)
        self._elements.append(elements)
        self._bins.append(bins)
        self._fine.append(fine)
        self._tints.append(tints)
        self._far.append(far)
        return scale, nearest, light

    def _gleaming(self, element: Int32, directions: Float32, point: Int64, column: Int64) -> list[Seen]:
        """What rays (R,) of points (R,) see of suns in gloss, if there is such."""
        if self._gleams is None:
            return []
        ray, light = self._gleams.seen(element, directions)
        return [Seen(point[ray], column[ray], light)]

    def _send_pilots(
        self, stands: Stands, pilots: int, first: Int64 | None = None
    ) -> tuple[Float32, Int32, Hits, Float32]:
        """Directions (R, 3), elements (R,) and hits of pilots, and their cosines (Q, pilots).

        Args:
            first: (Q,), of the samples; None: 0
        """
        u, v = (even_rows(stands.texel, pilots, dimension, first) for dimension in (0, 1))
        normals = self._texels.shading_normal.take(stands.texel, axis=0)
        directions = cosine_directions(normals, u, v).reshape(-1, 3)
        count = len(stands.texel)
        rows, column = np.repeat(np.arange(count), pilots), np.tile(np.arange(pilots), count)
        element, hits = self._trace(stands, rows, column, directions)
        return directions, element, hits, np.sqrt(1 - u)

    def _is_far(self, element: Int32, hits: Hits) -> Bools:
        """Which rays (R,) get far; those below the horizon do not."""
        return np.asarray((hits.distance > self._far_from) & (element != BELOW))

    def clearance(self, chosen: Int64) -> Fractions[Float32]:
        """Distance (Q,), m, from texels to the next surface along the normal."""
        distance = np.empty(len(chosen), np.float32)

        def work(start: int, stop: int) -> None:
            texel = chosen[start:stop]
            origins = self._texels.origins(texel, np.zeros(len(texel), np.int64))
            distance[start:stop] = self._visibility.first_hit(origins, self._texels.normal[texel]).distance

        yield from in_chunks(work, len(chosen), RAYS, self._workers)
        return distance

    def _trace(self, stands: Stands, rows: Int64, sample: Int64, directions: Float32) -> tuple[Int32, Hits]:
        """Elements (R,) and hits of rays from points (Q,), ray r from point rows[r], spread over its strata."""
        stratum = rows * STRATA
        stratum += sample & (STRATA - 1)
        chance = passing_chance(self._visibility, stands.texel[rows], sample) if self._visibility.dims else None
        hits = self._visibility.first_hit(stands.origins.take(stratum, axis=0), directions, chance)
        element = self._patches.elements(hits)
        if self._cells:
            left = np.flatnonzero(element == SKY)
            element[left] = cells(directions[left]) + np.int32(self._texels.count + self._patches.count)
        # each stratum has the horizon of its own face: texels of folded cloth lie on two
        if stands.tilted.any():
            ray = np.flatnonzero(stands.tilted.take(stratum))
            ray = ray[dots(directions.take(ray, axis=0), stands.faces.take(stratum[ray], axis=0)) <= 0]
            element[ray] = BELOW
        if self._bends:
            hits = replace(hits, tint=self._bent(stands.texel[rows], directions, hits.tint))
        return element, hits

    def _bent(self, texel: Int64, directions: Float32, tint: Float32 | None) -> Float32:
        """Tints (R, 3) of rays that count by bent cosines at the texels (R,) that they come to."""
        surfaces = self._texels.surfaces
        cosine = dots(directions, self._texels.shading_normal.take(texel, axis=0))
        share = bent_share(cosine, surfaces.bend[self._texels.triangle[texel]])[:, None]
        return np.repeat(share, 3, axis=1) if tint is None else tint * share

    def tally(self, points: GatherPoints, base: float) -> Fractions[Tally]:
        """Trace the guided rays of all points looked at, weigh all rays, and look again from the noisiest points."""
        pilots, guided = self._counts.sent(False)
        rows = Tally.empty(self._counts, np.concatenate(self._fine or [np.zeros(0, bool)]), self._tinted)
        rows.elements[:, :pilots] = np.concatenate(self._elements or [rows.elements[:0, :pilots]])
        if rows.tints is not None:
            rows.tints[:, :pilots] = np.concatenate([rows.tints[:0, :pilots], *self._tints])
        rows.far[:, :pilots] = np.concatenate(self._far or [rows.far[:0, :pilots]])
        bins = np.concatenate(self._bins or [np.zeros((0, pilots), np.uint16)])
        stands = Stands.joined(self._stands or [(yield from Stands.of(self._texels, points.texel, 1))])
        self._elements, self._bins, self._fine, self._tints, self._stands, self._far = [], [], [], [], [], []
        pools = Pools.of((yield from cell_keys(self._texels, points.texel, base * POOL_WIDTH, self._workers)))
        noise = np.zeros(points.count)
        cuts = cut_apart(pools.size, max(1, RAYS // guided))

        def work(start: int, stop: int) -> list[Seen]:
            mine, fold, begins = pools.members(np.arange(cuts[start], cuts[stop]))
            density = self._densities(rows.elements, bins, mine, fold)
            gleaming: list[Seen] = []
            for some in (False, True):
                here = np.flatnonzero(rows.fine[mine] == some)
                own, (few, rest) = mine[here], self._counts.sent(some)
                cosine = np.sqrt(1 - even_rows(points.texel[own], few, 0))
                seen = density.take(BINS * fold[here, None] + bins.take(own, axis=0)[:, :few])
                rows.weights[own, :few] = _balance(cosine, seen, few, rest)
                drawn = draw_bins(density, rest, fold[here], begins[here])
                gleaming += self._guide(rows, own, stands.only(own), density, fold[here], drawn)
            noise[mine] = variances(
                rows.weights.take(mine, axis=0), self._bright.take(rows.elements.take(mine, axis=0))
            )
            return gleaming

        seen = yield from scaled(in_chunks(work, len(cuts) - 1, 1, self._workers), 0, 0.7)
        first = rows.with_gleams([*self._seen, *(part for parts in seen for part in parts)])
        self._seen = []
        looks = yield from scaled(further_looks(noise, self._texels, points, self._workers), 0.7, 0.7)
        if not looks.any():
            return first
        again = yield from scaled(self._look_again(looks, pools, stands, rows.elements, bins), 0.7, 1)
        return first.followed_by(again)

    def _look_again(
        self, looks: Int64, pools: Pools, stands: Stands, elements: Int32, bins: NDArray[np.uint16]
    ) -> Fractions[Further]:
        """Trace `looks` (P,) further rows of rays from points, by samples that follow those of the first."""
        pilots, guided = self._counts.sent(False)
        number = pools.sums(looks)
        busy = np.flatnonzero(number)
        point = pools.members(busy)[0]
        owner = np.repeat(point, looks[point])
        rows = Tally.empty(self._counts, np.zeros(len(owner), bool), self._tinted)
        most = max(1, RAYS // (pilots + guided))
        cuts = cut_apart(number[busy], most)
        first = np.append(0, np.cumsum(number[busy]))[cuts]

        def work(start: int, stop: int) -> list[Seen]:
            mine, fold, begins = pools.members(busy[cuts[start] : cuts[stop]])
            density = self._densities(elements, bins, mine, fold)
            who = np.repeat(np.arange(len(mine)), looks[mine])
            look = 1 + np.arange(len(who)) - np.repeat(np.cumsum(looks[mine]) - looks[mine], looks[mine])
            gleaming: list[Seen] = []
            for low in range(0, len(who), most):
                one, nth = who[low : low + most], look[low : low + most]
                own, half = stands.only(mine[one]), fold[one]
                at = first[start] + low + np.arange(len(one))
                directions, element, hits, cosine = self._send_pilots(own, pilots, nth * pilots)
                rows.elements[at, :pilots] = element.reshape(-1, pilots)
                rows.far[at, :pilots] = self._is_far(element, hits).reshape(-1, pilots)
                if rows.tints is not None and hits.tint is not None:
                    rows.tints[at, :pilots] = hits.tint.reshape(-1, pilots, 3)
                seen = density.take(BINS * half[:, None] + direction_bins(directions).reshape(-1, pilots))
                rows.weights[at, :pilots] = _balance(cosine, seen, pilots, guided)
                row, column = np.divmod(np.arange(len(element)), pilots)
                gleaming += self._gleaming(element, directions, at[row], column)
                drawn = draw_bins(density, guided, half, next_starts(begins[one], nth))
                gleaming += self._guide(rows, at, own, density, half, drawn, nth * guided)
            return gleaming

        seen = yield from in_chunks(work, len(cuts) - 1, 1, self._workers)
        return Further(owner, rows.with_gleams([part for parts in seen for part in parts]))

    def _densities(self, elements: Int32, bins: NDArray[np.uint16], mine: Int64, fold: Int64) -> Float32:
        """Density of each bin, 1/sr, that guides each half of pools with points `mine` (K,) in halves `fold` (K,).

        Each half of a pool is guided by the pilots of the other: a ray weighed by a histogram that it helped to fill
        would count too little (4 % of the light was missing so).
        """
        pilots = bins.shape[1]
        light = self._bright.take(elements.take(mine, axis=0)[:, :pilots].reshape(-1))  # what is not sent meets nothing
        into = bins.take(mine, axis=0).reshape(-1).astype(np.int64)
        return pool(np.repeat(fold ^ 1, pilots), int(fold.max()) + 2, into, light)

    def _guide(
        self,
        rows: Tally,
        at: Int64,
        stands: Stands,
        density: Float32,
        fold: Int64,
        drawn: Int64,
        first: Int64 | None = None,
    ) -> list[Seen]:
        """Send rays into bins `drawn` (Q, guided), and put what they meet into rows `at` (Q,); returns gleams seen.

        Args:
            density: what guides, its rows by `fold` (Q,); points whose row is dark send no rays
            first: (Q,), of the samples; None: 0
        """
        count, guided = drawn.shape
        pilots = self._counts.sent(False)[0]
        few, _ = self._counts.sent(bool(len(at)) and bool(rows.fine[at[0]]))
        u, v = (even_rows(stands.texel, guided, dimension, first).reshape(-1) for dimension in JITTER_DIMENSIONS)
        directions = directions_in(drawn.reshape(-1), u, v)
        normals = self._texels.shading_normal.take(stands.texel, axis=0)
        cosine = np.einsum("qsx,qx->qs", directions.reshape(*drawn.shape, 3), normals).reshape(-1)
        cosine *= np.repeat(density.any(1)[fold], guided)
        np.maximum(cosine, 0, out=cosine)
        sent = np.flatnonzero(cosine)
        element = np.full(count * guided, BELOW, np.int32)
        ways = directions.take(sent, axis=0)
        row, sample = np.divmod(sent, guided)
        element[sent], hits = self._trace(stands, row, sample, ways)
        rows.elements[at, pilots : pilots + guided] = element.reshape(drawn.shape)
        far = np.zeros(len(element), bool)
        far[sent] = self._is_far(element[sent], hits)
        rows.far[at, pilots : pilots + guided] = far.reshape(drawn.shape)
        seen = density.take(BINS * fold[:, None] + drawn)
        rows.weights[at, pilots : pilots + guided] = _balance(cosine.reshape(drawn.shape), seen, few, guided)
        if rows.tints is not None and hits.tint is not None:
            tint = np.ones((count * guided, 3), np.float32)
            tint[sent] = hits.tint
            rows.tints[at, pilots : pilots + guided] = tint.reshape(*drawn.shape, 3)
        return self._gleaming(element[sent], ways, at[row], sample + pilots)


def _balance(cosine: Float32, density: Float32, pilots: int, guided: int) -> Float32:
    """Cosine over the summed densities of both kinds of rays sent: the balance heuristic's weight."""
    total = np.float32(pilots / np.pi) * cosine
    total += np.float32(guided) * density
    total += np.float32(1e-9)
    weight: Float32 = np.divide(cosine, total, out=total)
    return weight
