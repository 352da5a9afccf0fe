# SPDX-License-Identifier: GPL-3.0-or-later
"""What the rays of gather points met, and the light that they bring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Float16, Float32, Int32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..columns import sums
from ..radiosity.patches import NOTHING
from .far_light import FarLight

BELOW = -3
"""A direction below the horizon: it counts, and brings nothing."""

FINE_PART = 2
"""Points close together send one ray of so many: the fit joins the rays of several."""

RAYS = 1 << 16
"""Rays summed at once."""


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
        far: (P, R) bool, rays that met what is far away, or left
        tints: (P, R, 3) float16, what colours the light on the way of a ray; None: nothing
        gleams: (P, C) float32, W/m2, what gloss adds to the irradiance of all elements; None: nothing
        further: what points saw that looked again; None: none did
    """

    elements: Int32
    weights: Float32
    counts: RayCounts
    fine: Bools
    far: Bools
    tints: Float16 | None = None
    gleams: Float32 | None = None
    further: Further | None = None

    @classmethod
    def empty(cls, counts: RayCounts, fine: Bools, tinted: bool) -> Tally:
        """Rows to be filled, of points that are `fine` (P,) or not."""
        shape = (len(fine), sum(counts.sent(False)))
        tints = np.ones((*shape, 3), np.float16) if tinted else None
        elements, weights = np.full(shape, BELOW, np.int32), np.zeros(shape, np.float32)
        return cls(elements, weights, counts, fine, np.zeros(shape, bool), tints)

    def with_gleams(self, seen: Sequence[Seen]) -> Tally:
        """The same, with the gleams that rays have seen."""
        return replace(self, gleams=Seen.joined(seen).irradiance(self.weights) if seen else None)

    def followed_by(self, further: Further) -> Tally:
        """The same, with what was seen later."""
        later = further.tally.gleams
        gleams = self.gleams if self.gleams is None or later is None else further.means(self, self.gleams, later)
        return replace(self, gleams=gleams, further=further)

    def sum(self, table: Float32, workers: int) -> Fractions[tuple[Float32, FarLight]]:
        """Irradiance (P, C), W/m2, under radiances `table` (elements, C + 1), and how much of it comes from afar.

        The last column of the table is the sum of the others.
        """
        total, far = yield from scaled(self._sum(table, workers), 0, 1 if self.further is None else 0.5)
        if self.further is None:
            return total, far
        later, later_far = yield from scaled(self.further.tally._sum(table, workers), 0.5, 1)
        mean = partial(self.further.means, self)
        openness = mean(far.openness[:, None], later_far.openness[:, None])[:, 0]
        return mean(total, later), FarLight(mean(far.irradiance, later_far.irradiance), openness)

    def _sum(self, table: Float32, workers: int) -> Fractions[tuple[Float32, FarLight]]:
        """The same, of these rows alone.

        The weights should add up to pi and do so only on average, and rays that met nothing that takes part are
        missing. What is missing is taken to be as bright as the dimmer part of the view (a control variate): exact
        where all is equally bright, harmless where a small window outshines the rest.
        """
        total: Float32 = np.empty((len(self.elements), table.shape[1] - 1), np.float32)
        far = FarLight(np.zeros_like(total), np.zeros(len(total), np.float32))
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
        return total, far


@dataclass(frozen=True, eq=False)
class Further:
    """Rows of rays (E,) of points that looked again.

    Attributes:
        point: (E,) int64, whose they are
        tally: of the rows; each has light of its own, and they count by their numbers of rays
    """

    point: Int64
    tally: Tally

    def means(self, of: Tally, first: Float32, later: Float32) -> Float32:
        """Means (P, C), by numbers of rays, of the values `first` (P, C) of points and of their `later` ones (E, C)."""
        points = len(first)
        again = np.unique(self.point)
        weight = np.where(of.fine[again], np.float32(1 / FINE_PART), np.float32(1))
        share = weight + np.bincount(self.point, minlength=points)[again]
        total = first.copy()
        for column in range(first.shape[1]):
            added = np.bincount(self.point, later[:, column], points)[again]
            total[again, column] = (weight * first[again, column] + added) / share
        return total


@dataclass(frozen=True, eq=False)
class Seen:
    """Gleams that K rays see: of which point and in which column of its row they are, and their light (K, C)."""

    point: Int64
    column: Int64
    light: Float32

    @classmethod
    def joined(cls, parts: Sequence[Seen]) -> Seen:
        point, column, light = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("point", "column", "light")
        )
        return cls(point, column, light)

    def irradiance(self, weights: Float32) -> Float32:
        """What they bring to each of P points: (P, C) float32, by the weights (P, R) of rays."""
        weight = weights[self.point, self.column].astype(np.float64)
        columns = [np.bincount(self.point, weight * light, len(weights)) for light in self.light.T]
        return np.stack(columns, axis=1).astype(np.float32)
