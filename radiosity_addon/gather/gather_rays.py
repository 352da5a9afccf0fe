# SPDX-License-Identifier: GPL-3.0-or-later
"""The rays of the final gather: stratified pilots first, then guided ones, and what each ray counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Float16, Float32, Int32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..columns import dots, sums
from ..geometry.texels import STRATA, Texels
from ..geometry.visibility import Hits, Visibility, passing_chance
from ..lighting.lamp_samples import bent_share
from ..lighting.sky import cells
from ..radiosity.illumination import SPECIAL_ROWS
from ..radiosity.patches import NOTHING, SKY, Patches
from ..sampling import cosine_directions, even_rows
from ..settings import BakeSettings
from .far_light import FarLight
from .gather_points import GatherPoints, cell_keys
from .gleams import Gleams
from .guiding import BINS, direction_bins, directions_in, draw_bins, pool, sweep_starts
from .stands import Stands

BELOW = -3
"""A direction below the horizon: it counts, and brings nothing."""

RAYS = 1 << 16
"""Rays traced at once."""

FINE_PART = 2
"""Points close together send one ray of so many: the fit joins the rays of several."""

PILOT_SHARE = 2 / 3
"""Of the rays of a point; they also serve where nothing outshines the rest. It makes them a power of
two, for which the sequence of their directions is most even."""

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

    def of(self, rows: NDArray[Any], fine: bool) -> NDArray[Any]:
        """What was sent of rows (Q, R) that have room for all rays, pilots first: copies."""
        pilots, guided = self.sent(fine)
        return np.concatenate([rows[:, :pilots], rows[:, self.pilots : self.pilots + guided]], axis=1)


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
        far: (P, R) bool, rays that met what is far away, or left; None: none of them
    """

    elements: Int32
    weights: Float32
    counts: RayCounts
    fine: Bools
    tints: Float16 | None = None
    gleams: Float32 | None = None
    far: Bools | None = None

    def sum(self, table: Float32, workers: int) -> Fractions[Float32]:
        """Irradiance (P, C), W/m2, under radiances `table` (elements, C + 1), the last column the sum of the others."""
        total: Float32 = np.empty((len(self.elements), table.shape[1] - 1), np.float32)
        yield from self._sum(table, workers, total)
        return total

    def sum_apart(self, table: Float32, workers: int) -> Fractions[tuple[Float32, FarLight]]:
        """The same, and how much of it comes from afar."""
        total: Float32 = np.empty((len(self.elements), table.shape[1] - 1), np.float32)
        far = FarLight(np.zeros_like(total), np.zeros(len(total), np.float32))
        yield from self._sum(table, workers, total, far)
        return total, far

    def _sum(self, table: Float32, workers: int, total: Float32, far: FarLight | None = None) -> Fractions[None]:
        """Fill `total`, and `far`.

        The weights should add up to pi and do so only on average, and rays that met nothing that takes part are
        missing. What is missing is taken to be as bright as the dimmer part of the view (a control variate): exact
        where all is equally bright, harmless where a small window outshines the rest.
        """
        for fine in (False, True):
            rows = np.flatnonzero(self.fine == fine)
            pilots, guided = self.counts.sent(fine)

            def work(start: int, stop: int, rows: Int64 = rows, fine: bool = fine, pilots: int = pilots) -> None:
                chosen = rows[start:stop]
                element: Int32 = self.counts.of(self.elements.take(chosen, axis=0), fine)
                weight: Float32 = self.counts.of(self.weights.take(chosen, axis=0), fine)
                met = element != NOTHING
                weight *= met
                radiance = table.take(element, axis=0)
                if self.tints is not None:
                    colors = radiance[:, :, :-1].reshape(*element.shape, -1, 3)
                    colors *= self.counts.of(self.tints.take(chosen, axis=0), fine)[:, :, None]
                    radiance[:, :, :-1] = colors.reshape(*element.shape, -1)
                    radiance[:, :, -1] = sums(radiance[:, :, :-1])
                # which rays are dim is decided by all channels and light groups at once, so that groups add up
                bright = np.ascontiguousarray(radiance[:, :pilots, -1])
                count = np.maximum(np.count_nonzero(met[:, :pilots], axis=1), 1).astype(np.float32)[:, None]
                missing = np.float32(np.pi) - weight.sum(1)[:, None]
                level = bright.sum(1)[:, None] / count
                np.maximum(bright, np.maximum(level, np.float32(1e-30)), out=bright)
                dim = np.divide(level, bright, out=bright)
                weight[:, :pilots] += dim * (missing / count)
                total[chosen] = np.einsum("pr,prc->pc", weight, radiance)[:, :-1]
                if far is not None and self.far is not None:
                    away = self.counts.of(self.far.take(chosen, axis=0), fine)
                    number = np.count_nonzero(away[:, :pilots], axis=1)[:, None].astype(np.float32)
                    open_share = number / count
                    far.openness[chosen] = open_share[:, 0]
                    weight *= away & (number > 0)  # guided rays alone do not tell how open the view is
                    dim *= away[:, :pilots]  # what is missing of the open share, likewise: even light stays even
                    dim *= (np.float32(np.pi) * open_share - weight.sum(1)[:, None]) / np.maximum(number, 1)
                    weight[:, :pilots] += dim
                    far.irradiance[chosen] = np.einsum("pr,prc->pc", weight, radiance)[:, :-1]

            steps = in_chunks(work, len(rows), max(1, RAYS // (pilots + guided)), workers)
            yield from scaled(steps, 0.5 * fine, 0.5 + 0.5 * fine)


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
        self._seen: list[_Seen] = []
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

        def trace(first: int, last: int, pilots: int) -> Fractions[list[_Seen | None]]:
            def work(start: int, stop: int) -> _Seen | None:
                part = slice(first + start, first + stop)
                own = stands.only(np.arange(first + start, first + stop))
                u, v = (even_rows(own.texel, pilots, dimension) for dimension in (0, 1))
                normals = self._texels.shading_normal.take(own.texel, axis=0)
                directions = cosine_directions(normals, u, v).reshape(-1, 3)
                rows, column = np.repeat(np.arange(stop - start), pilots), np.tile(np.arange(pilots), stop - start)
                element, hits = self._trace(own, rows, column, directions)
                if hits.tint is not None:
                    tints[part, :pilots] = hits.tint.reshape(-1, pilots, 3)
                far[part, :pilots] = self._is_far(element, hits).reshape(-1, pilots)
                inverse = 1 / np.maximum(hits.distance, np.float32(1e-9)).reshape(-1, pilots)
                elements[part, :pilots] = element.reshape(-1, pilots)
                bins[part, :pilots] = direction_bins(directions).reshape(-1, pilots)
                nearest[part] = 1 / inverse.max(1)
                np.minimum(inverse, 1 / self._nearest, out=inverse)
                inverse *= inverse
                bright = self._bright.take(element).reshape(-1, pilots)
                light[part] = bright.mean(1)
                np.maximum(bright, 0, out=bright)
                bright /= np.maximum(bright.sum(1), np.float32(1e-30))[:, None]
                change = np.maximum(inverse.mean(1), np.einsum("pr,pr->p", bright, inverse))
                scale[part] = 1 / np.sqrt(np.maximum(change, np.float32(1e-30)))
                return self._gleaming(element, directions, before + first + start + rows, column)

            return in_chunks(work, last - first, max(1, RAYS // pilots), self._workers)

        coarse = len(chosen) - int(np.count_nonzero(fine))
        share = coarse / max(1, len(chosen))
        seen = yield from scaled(trace(0, coarse, self._counts.sent(False)[0]), 0, share)
        seen += yield from scaled(trace(coarse, len(chosen), self._counts.sent(True)[0]), share, 1)
        self._seen += [part for part in seen if part is not None]
        self._stands.append(stands)
        self._elements.append(elements)
        self._bins.append(bins)
        self._fine.append(fine)
        self._tints.append(tints)
        self._far.append(far)
        return scale, nearest, light

    def _gleaming(self, element: Int32, directions: Float32, point: Int64, column: Int64) -> _Seen | None:
        """What rays (R,) of points (R,) see of suns in gloss."""
        if self._gleams is None:
            return None
        ray, light = self._gleams.seen(element, directions)
        return _Seen(point[ray], column[ray], light)

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
        stands = Stands.joined(self._stands or [(yield from Stands.of(self._texels, points.texel, 1))])
        far = np.zeros(elements.shape, bool)
        far[:, :pilots] = np.concatenate(self._far or [far[:0, :pilots]])
        self._elements, self._bins, self._fine, self._tints, self._stands, self._far = [], [], [], [], [], []
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
            begins = sweep_starts(2 * pools + rank % 2, rank // 2)
            sent = elements.take(mine, axis=0)[:, :pilots].reshape(-1)
            light = self._bright.take(sent)  # rays not sent met nothing bright
            into = bins.take(mine, axis=0).reshape(-1).astype(np.int64)
            density = pool(np.repeat(fold ^ 1, pilots), int(fold.max()) + 2, into, light)
            for some in (False, True):
                here = np.flatnonzero(fine[mine] == some)
                points_here = mine[here]
                few, rest = self._counts.sent(some)
                cosine = np.sqrt(1 - even_rows(points.texel[points_here], few, 0))
                row = BINS * fold[here, None]
                seen = density.take(row + bins.take(points_here, axis=0)[:, :few])
                weights[points_here, :few] = _balance(cosine, seen, few, rest)
                drawn = draw_bins(density, rest, fold[here], begins[here])
                lit = density.any(1)[fold[here]]
                element, away, cosine, tint, seen_there = self._guide(stands.only(points_here), drawn, lit)
                elements[points_here, pilots : pilots + rest] = element
                far[points_here, pilots : pilots + rest] = away
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
        return Tally(elements, weights, self._counts, fine, tints, gleams, far)

    def _guide(
        self, stands: Stands, drawn: Int64, lit: Bools
    ) -> tuple[Int32, Bools, Float32, Float32 | None, _Seen | None]:
        """Elements, which are far, cosines and tints, (Q, guided), of rays into bins `drawn` (Q, guided).

        And the gleams that they see. The cosine is 0 for those not sent.

        Args:
            lit: (Q,) bool, points whose bins were drawn from light; no others send rays
        """
        count, guided = drawn.shape
        u, v = (even_rows(stands.texel, guided, dimension).reshape(-1) for dimension in JITTER_DIMENSIONS)
        directions = directions_in(drawn.reshape(-1), u, v)
        normals = self._texels.shading_normal.take(stands.texel, axis=0)
        cosine = np.einsum("qsx,qx->qs", directions.reshape(*drawn.shape, 3), normals).reshape(-1)
        cosine *= np.repeat(lit, guided)
        np.maximum(cosine, 0, out=cosine)
        sent = np.flatnonzero(cosine)
        element = np.full(count * guided, BELOW, np.int32)
        ways = directions.take(sent, axis=0)
        row, sample = np.divmod(sent, guided)
        element[sent], hits = self._trace(stands, row, sample, ways)
        far = np.zeros(len(element), bool)
        far[sent] = self._is_far(element[sent], hits)
        gleaming = self._gleaming(element[sent], ways, row, sample)
        tint = None
        if hits.tint is not None:
            tint = np.ones((count * guided, 3), np.float32)
            tint[sent] = hits.tint
            tint = tint.reshape(*drawn.shape, 3)
        shape = drawn.shape
        return element.reshape(shape), far.reshape(shape), cosine.reshape(shape), tint, gleaming


def _balance(cosine: Float32, density: Float32, pilots: int, guided: int) -> Float32:
    """Cosine over the summed densities of both kinds of rays sent: the balance heuristic's weight."""
    total = np.float32(pilots / np.pi) * cosine
    total += np.float32(guided) * density
    total += np.float32(1e-9)
    weight: Float32 = np.divide(cosine, total, out=total)
    return weight
