# SPDX-License-Identifier: GPL-3.0-or-later
"""Direct light: closed forms where a receiver sees the whole lamp, shadow rays only where they are needed.

Lamps come in batches. Each texel sends a few probe rays to each lamp; the probes of a 5 x 5 neighbourhood on the
page say whether a texel is fully lit, fully shadowed, or partly: only those send more rays. Sampling depends on
geometry and visibility, never on strengths or light groups; only of many lamps the weak ones of a group are told from
the strong ones.
"""

from __future__ import annotations

import threading
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ..arrays import Bools, Float32, Int32, Int64
from ..chunks import Fractions, in_chunks, scaled, side_by_side
from ..columns import vectors_at
from ..geometry.surfaces import Surfaces
from ..geometry.texels import STRATA, Texels
from ..geometry.visibility import Visibility
from ..sampling import hash_uniform
from ..scene import AreaLight, Light, Scene, SunLight
from ..settings import BakeSettings
from .area_lamps import PanelLamp, area_lamp
from .companies import brightest, companies_of
from .emitters import emissive_lamps
from .flat_cells import FlatCells
from .glow import Glow
from .lamp_samples import lattice, lattice_generators, rows_of, shifted
from .lamps import Lamp, sun_lamp
from .many_lamps import survey
from .mesh_lamp import MeshLamp
from .own_faces import OwnFaces, add_own_light, own_irradiance_at
from .penumbra import trace_shares
from .round_lamps import round_lamps
from .shades import Probes, undecided
from .shadows import TRACE_CHUNK, Receivers, Tally, sample_groups, shoot
from .sparse_light import LEAST, light_of_meshes
from .terminator import Footing, bend_light

BATCH = 8
"""Lamps treated together, at most: they share ray origins."""

BATCH_BYTES = 6 << 24
"""What the pairs of a batch's lamps and texels take while it is worked on, at most."""

WIDE = 1 << 14
"""Partly lit texels from which on all threads trace a lamp's together; lamps of fewer are traced side by side."""

MANY = 32
"""Lamps from which on nodes find out where each of them matters."""

TOGETHER = 64
"""Of many lamps so many, at most, are treated before their light is added, in order."""

COPIED = 1 << 20
"""Texels that a lamp is treated at alone, at most: a copy of them takes 0.1 GB. Beyond, it is treated at all.

Up to so many, shadows of several lamps are looked at side by side, each by one thread; beyond, all look at one.
"""

PROBE_CHUNK = 1 << 14
"""Texels probed in one go."""


@dataclass(frozen=True, eq=False)
class Lamps:
    """Everything that is sampled as a lamp.

    Attributes:
        lamps: one record each
        sampled: (F,) bool, triangles whose emission is in `lamps`, so that a gather must leave it out
        own: the same triangles by their emitters, which light them apart
        surfaces: the triangles, without backs
        receivers: (M,) bool each, meshes that a lamp lights, by index of the lamp; others light all
    """

    lamps: tuple[Lamp, ...]
    sampled: Bools
    own: OwnFaces
    surfaces: Surfaces
    receivers: Mapping[int, Bools] = field(default_factory=dict)

    def of(self, numbers: Sequence[int]) -> Lamps:
        """Those of these numbers."""
        receivers = {k: self.receivers[number] for k, number in enumerate(numbers) if number in self.receivers}
        return replace(self, lamps=tuple(self.lamps[number] for number in numbers), receivers=receivers)

    @property
    def emitters(self) -> set[int]:
        """Numbers of the emissive surfaces whose first lamp is among them."""
        return {lamp.emitter for lamp in self.lamps if isinstance(lamp, PanelLamp) and lamp.leads}

    def keep_to_receivers(self, index: int, light: Float32, triangle: Int32) -> None:
        """Put out, in place, a lamp's light (P,) on triangles (P,) of fronts that it does not light, or that it is."""
        if index in self.receivers:
            light[~self.receivers[index][self.surfaces.mesh[triangle]]] = 0
        lamp = self.lamps[index]
        if isinstance(lamp, PanelLamp):
            self.own.put_out(lamp.emitter, light, triangle)


def lamps_of(scene: Scene, surfaces: Surfaces, suns: Sequence[SunLight] = (), glow: Glow | None = None) -> Lamps:
    """The scene's lights, emissive surfaces and bright pieces of the sky as lamps.

    Args:
        scene: with positions relative to `surfaces.origin`, as `scene.moved(-surfaces.origin)` gives them
        glow: what triangles emit whose emission varies
    """
    lights = [(k, lamp) for k, light in enumerate((*scene.lights, *suns)) for lamp in _lamps(light, surfaces)]
    emitters, sampled, own = emissive_lamps(scene, surfaces, glow)
    none = len(scene.lights)  # of the scene's lights
    shining = [each for each in [*lights, *((none, lamp) for lamp in emitters)] if any(each[1].strength)]
    receivers = {}
    for number, (index, _) in enumerate(shining):
        if index in scene.receivers:
            receivers[number] = np.isin(np.arange(len(scene.meshes)), list(scene.receivers[index]))
    return Lamps(tuple(lamp for _, lamp in shining), sampled, own, surfaces, receivers)


def _lamps(light: Light, surfaces: Surfaces) -> Sequence[Lamp]:
    if isinstance(light, SunLight):
        return [sun_lamp(light, 4 * surfaces.radius)]
    if isinstance(light, AreaLight):
        return [area_lamp(light)]
    return round_lamps(light)


def irradiance_at(
    lamps: Lamps,
    points: Float32,
    normals: Float32,
    visibility: Visibility,
    samples: int,
    seed_ids: Int64,
    group_count: int,
    triangle: Int32 | None = None,
    footing: Footing | None = None,
) -> Fractions[Float32]:
    """Direct irradiance at any points, each with its own shadow rays; yields the share done.

    Args:
        points: (P, 3) float32, m, lifted off their surfaces
        normals: (P, 3) float32, unit
        samples: shadow rays of a point and lamp
        seed_ids: (P,) what the samples are hashed from
        triangle: (P,) int32, of fronts, that the points lie on; without it all lamps light them, and no emitter its own
        footing: where the P points stand, if light that grazes surfaces is to be seen from elsewhere

    Returns:
        (P, G, 3) float32, W/m2
    """
    everything, visibility = visibility, visibility.of_lamps
    total = np.zeros((len(points), group_count, 3), np.float32)
    emitters, companies = lamps.emitters, companies_of(lamps.lamps, lamps.receivers)
    for start in range(0, len(points), TRACE_CHUNK):
        part = slice(start, start + TRACE_CHUNK)
        shifts = hash_uniform(seed_ids[part], 0), hash_uniform(seed_ids[part], 1)
        for number, company in enumerate(companies):
            lamp = company.lamp
            light = lamp.light(points[part], normals[part], None)
            if triangle is not None:
                for index, own in zip(company.members, np.atleast_2d(light), strict=True):
                    lamps.keep_to_receivers(index, own, triangle[part])
            if footing is not None:
                face, above = footing.triangle[part], [rows_of(normals[part])]
                for index, own in zip(company.members, np.atleast_2d(light), strict=True):
                    bend_light(lamps.lamps[index], own, points[part], above, footing.surfaces, face)
            lit = np.flatnonzero(brightest(light) > 0)
            share: Float32 = np.ones((company.channels(visibility), light.shape[-1]), np.float32)
            if lamp.shadow and len(lit):
                rays = samples if lamp.extended else 1
                side = STRATA if rays % STRATA == 0 else 1
                tiled = np.tile(start + lit, side)
                origins = [(rows_of(points[tiled]), None if footing is None else footing.only(tiled))]
                tally = Tally.none(lamp, len(lit), len(share))
                chosen = shifts[0][lit], shifts[1][lit]
                facing = [rows_of(normals[part][lit])]
                slopes = lattice_generators(seed_ids[part][lit], rays)
                tally.add(lamp, origins, facing, chosen, slopes, sample_groups(rays, side), visibility)
                share[:, lit] = tally.share()
            for index, arrived in company.of_each(light * share):
                _add(total[part], lamps.lamps[index], arrived)
            yield (start + (number + 1) / len(companies) * light.shape[-1]) / len(points)
        if emitters and triangle is not None:
            own_irradiance_at(
                lamps.own, emitters, lamps.surfaces, triangle[part], points[part], normals[part], everything, samples,
                seed_ids[part], total[part],
            )  # fmt: skip
    return total


def direct_irradiance(
    lamps: Lamps, texels: Texels, visibility: Visibility, settings: BakeSettings, group_count: int
) -> Fractions[Float32]:
    """Irradiance H0 of every texel from all lamps; yields the share done.

    Returns:
        (T, G, 3) float32, W/m2; zero where a texel is not valid
    """
    everything, visibility = visibility, visibility.of_lamps
    total = np.zeros((texels.count, group_count, 3), np.float32)
    if lamps.emitters:
        rays, workers = settings.steps.shadow_rays, settings.workers
        yield from scaled(add_own_light(lamps.own, lamps.emitters, texels, everything, rays, workers, total), 0, 0)
    free = lamps.of([number for number in range(len(lamps.lamps)) if number not in lamps.receivers])
    if len(free.lamps) >= MANY:
        yield from scaled(_add_many(free, texels, visibility, settings, total), 0, len(free.lamps) / len(lamps.lamps))
        lamps = lamps.of(sorted(lamps.receivers))
    size = max(1, min(BATCH, BATCH_BYTES // Probes.bytes_each(visibility) // max(texels.count, 1)))
    numbers = range(len(lamps.lamps))
    batches = [lamps.of(numbers[start : start + size]) for start in numbers[::size]]
    flat = FlatCells.of(texels, LEAST) if any(isinstance(lamp, MeshLamp) for lamp in lamps.lamps) else None
    for done, batch in enumerate(batches):
        steps = _add_batch(batch, texels, visibility, settings, flat, total)
        yield from scaled(steps, done / len(batches), (done + 1) / len(batches))
    return total


def _add_many(
    lamps: Lamps, texels: Texels, visibility: Visibility, settings: BakeSettings, total: Float32
) -> Generator[float, None, None]:
    """Add the light of many lamps to `total` (T, G, 3): each at the texels that a survey names, the rest as fitted."""
    workers = settings.workers
    asking = survey(lamps.lamps, texels, visibility, settings.steps.lamp_error, total, lamps.own, workers)
    found = yield from scaled(asking, 0, 0.35)
    alone = replace(settings, threads=1)
    pages = threading.local()

    def arriving(first: int, one: int) -> Fractions[tuple[Int64, Float32]]:
        """The texels where a lamp is treated, and its light there."""
        number = first + one
        ids, weak = found.texels_of(number)
        if not len(ids):
            return ids, np.zeros((visibility.channels, 0), np.float32)
        if len(ids) > COPIED:
            everywhere = np.zeros(texels.count, bool)
            everywhere[ids] = weak
            probes, shares = yield from _shares(lamps.of([number]), texels, visibility, alone, everywhere)
            return ids, (probes.light[0] * shares[0])[:, ids]
        if not hasattr(pages, "texel_at"):
            pages.texel_at = np.full(len(texels.texel_at), -1, np.int32)
        some = texels.only(ids, pages.texel_at)
        probes, shares = yield from _shares(lamps.of([number]), some, visibility, alone, weak)
        pages.texel_at[some.pixel] = -1
        return ids, probes.light[0] * shares[0]

    count = len(lamps.lamps)
    together = max(1, min(TOGETHER, BATCH_BYTES // (12 * max(texels.count, 1))))
    for start in range(0, count, together):
        few = lamps.lamps[start : start + together]
        steps = side_by_side(partial(arriving, start), len(few), workers)
        parts = yield from scaled(steps, 0.35 + 0.65 * start / count, 0.35 + 0.65 * (start + len(few)) / count)
        for lamp, (ids, arrived) in zip(few, parts, strict=True):
            sum_ = total[ids]
            _add(sum_, lamp, arrived)
            total[ids] = sum_
    np.maximum(total, 0, out=total)


def _add(total: Float32, lamp: Lamp, arrived: Float32) -> None:
    """Add a lamp's light (C, B) that arrives, per unit strength, to irradiance (B, G, 3)."""
    for channel, strength in enumerate(lamp.strength):
        if strength:
            total[:, lamp.group, channel] += arrived[channel % len(arrived)] * np.float32(strength)


def _add_batch(
    batch: Lamps, texels: Texels, visibility: Visibility, settings: BakeSettings, flat: FlatCells | None, total: Float32
) -> Generator[float, None, None]:
    """Add the light of a batch to `total` (T, G, 3); yields the share done."""
    probes, shares = yield from _shares(batch, texels, visibility, settings, flat=flat)
    for lamp, light, share in zip(batch.lamps, probes.light, shares, strict=True):
        _add(total, lamp, light * share)


def _shares(
    batch: Lamps,
    texels: Texels,
    visibility: Visibility,
    settings: BakeSettings,
    weak: Bools | None = None,
    flat: FlatCells | None = None,
) -> Fractions[tuple[Probes, list[Float32]]]:
    """Unshadowed light of a batch's lamps, among their probes, and the share (C, T) of each one's that arrives.

    Args:
        weak: (T,) bool, texels where few shadow rays do; None: nowhere
        flat: as for `light_of_meshes`
    """
    number = len(batch.lamps)
    probes = Probes.none(number, texels.count, visibility)
    tolerance, workers = settings.steps.lamp_error, settings.workers
    shining = light_of_meshes(batch.lamps, texels, probes.light, workers, batch.own, tolerance, flat)
    yield from scaled(shining, 0, 0.3)
    yield from scaled(_probe(batch, texels, visibility, settings, probes), 0.3, 0.5)

    companies = companies_of(batch.lamps, batch.receivers)
    count = len(companies)
    aside = count > 1 and texels.count <= COPIED  # a lamp's few partly lit texels would keep one thread busy

    def pool(number: int, workers: int) -> Fractions[tuple[Float32, Int64]]:
        company = companies[number]
        if not company.lamp.shadow:
            yield 0.0
            return np.ones((len(company.members), 1), np.float32), np.zeros(0, np.int64)
        return (yield from undecided(probes, company.members, company.channels(visibility), texels, workers))

    def trace(number: int, workers: int) -> Fractions[None]:
        company, (share, partly) = companies[number], known[number]
        lit = (probes.light[company.members] > 0).any(0)
        rays = settings.steps.shadow_rays
        return trace_shares(company.lamp, texels, partly, lit, share, weak, visibility, rays, workers)

    if aside:
        known = yield from scaled(side_by_side(lambda k: pool(k, 1), count, settings.workers), 0.5, 0.6)
    else:
        known = []
        for number in range(count):
            known.append((yield from scaled(pool(number, settings.workers), 0.5, 0.6)))
    asking = sorted((k for k in range(count) if len(known[k][1])), key=lambda k: -len(known[k][1]))
    wide = [k for k in asking if not aside or len(known[k][1]) > WIDE]
    narrow = asking[len(wide) :]
    for done, number in enumerate(wide):
        yield from scaled(trace(number, settings.workers), 0.6 + 0.4 * done / count, 0.6 + 0.4 * (done + 1) / count)
    tracing = side_by_side(lambda k: trace(narrow[k], 1), len(narrow), settings.workers)
    yield from scaled(tracing, 0.6 + 0.4 * len(wide) / count, 1)
    of_each = [pair for company, (share, _) in zip(companies, known, strict=True) for pair in company.of_each(share)]
    return probes, [share for _, share in sorted(of_each, key=lambda pair: pair[0])]


def _probe(
    batch: Lamps, texels: Texels, visibility: Visibility, settings: BakeSettings, probes: Probes
) -> Fractions[list[None]]:
    """Fill `probes`: closed forms where there is no light yet, and a few rays from wherever a lamp could be seen."""
    pattern = lattice(settings.steps.shadow_probes)
    count, companies = len(pattern), companies_of(batch.lamps, batch.receivers)

    def work(start: int, stop: int) -> None:
        ids = start + np.flatnonzero(texels.valid[start:stop])
        if not len(ids):
            return
        points, shading = (vectors_at(rows, ids) for rows in (texels.position, texels.shading_normal))
        receivers = Receivers.of(texels, ids)
        horizon = None if len(receivers.normals) == 1 else receivers.normals[1].T
        origins, footing = receivers.origins(texels, 0, count)
        triangle = texels.surfaces.front[texels.triangle[ids]]
        for company in companies:
            lamp, members = company.lamp, company.members
            if isinstance(batch.lamps[members[0]], MeshLamp):
                light = probes.light[members][:, ids]
            else:
                light = lamp.light(points, shading, horizon)[None]
            for index, own in zip(members, light, strict=True):
                batch.keep_to_receivers(index, own, triangle)
                bend_light(batch.lamps[index], own, points, receivers.normals, texels.surfaces, triangle)
                probes.light[index][ids] = own
            lit = np.flatnonzero(brightest(light) > 0)
            if not lamp.shadow or not len(lit):
                continue
            some = receivers.only(lit)
            u, v = (shifted(pattern[:, k, None], some.shifts[k]).reshape(-1) for k in (0, 1))
            p = origins.reshape(3, count, -1).take(lit, axis=2).reshape(3, -1)
            stand = None if footing is None else footing.only(lit, count)
            normals = [np.tile(rows, (1, count)) for rows in some.normals]
            found, share = shoot(lamp, p, normals, u, v, visibility, stand)
            rows = found.reshape(len(members), count, -1)
            for own, (index, arrived) in zip(rows, company.of_each(share), strict=True):
                probes.put(index, some.ids, own, arrived.reshape(len(arrived), count, -1))

    return in_chunks(work, texels.count, PROBE_CHUNK, settings.workers)
