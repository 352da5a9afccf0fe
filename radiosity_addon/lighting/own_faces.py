# SPDX-License-Identifier: GPL-3.0-or-later
"""The light that emitters throw on their own faces: the inner side of a bent tube, a half-pipe, the inside of a letter.

No lamp can be nearer. Closed forms of the very triangle that a point lies on are nothing or half the sky, as rounding
has it; points spread over the emitter hardly ever fall where its light comes from; and lifted rays find the next facet
below the horizon. Cosine-distributed rays (Malley 1988) have none of it: an emitter's light on itself is the share of
them that meets it above the horizon of the face that they leave. It is what Cycles finds where it does not sample
the emission of the mesh; where it does, facets of coarse smooth tubes also light one another from below their horizons.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float32, Int32, Int64
from ..chunks import Fractions, in_chunks, scaled
from ..columns import dots
from ..geometry.surfaces import Surfaces
from ..geometry.texels import STRATA, Texels
from ..geometry.visibility import Visibility, passing_chance
from ..sampling import cosine_directions, even_uniform
from ..scene import Material
from .glow import Glow
from .lamp_samples import bent_share, lattice_generators, pixel_shifts, shifted
from .shadows import sample_groups, whole_groups

CHUNK = 1 << 13
"""Texels that look for their own emitter in one go, STRATA rays of each at a time."""

RAYS = 6
"""Rays of a texel for each shadow ray that it would send into a penumbra: they look all around.

They are not fitted as penumbrae are: that takes their noise to be known, and where few rays see the emitter it is not:
1.4 % were missing. The mean over neighbours at opposite sides asks nothing.
"""

LEVEL, FACETS = np.float32(0.998), np.float32(0.99)
"""Least cosines, between a texel and neighbours that share their light, of shading normals and of those of faces.

Over a surface that bends by 3.6 degrees from texel to texel the mean of 3 x 3 errs by 0.3 %.
"""

RISE = 1e-4
"""An emitter of few faces is hollow, or folded, if one rises over another by this share of its size."""

FEW = 16
"""Triangles of an emitter, at most, that are held against one another; one of more is hollow unless it is flat."""


@dataclass(frozen=True, eq=False)
class OwnFaces:
    """E emitters that are sampled as lamps, and which of F triangles are theirs.

    Attributes:
        emitter: (F,) int32, number of a triangle's emitter, -1 for none
        radiance: (E, 3) float32, W/(m2 sr), that of its constant, or the largest that its picture or either face has
        faces: (E, 2, 3) float32, that of fronts and of backs as a share of it; None: all shine alike on both
        group: (E,) int64, light groups
        hollow: (E,) bool, may see itself
        picture: (E,) bool, shows what `glow` has
        glow: what the triangles of pictures emit; None where there are none
        bend: (F,) float32, of the angles of light on triangles; None where it counts by Lambert's law
    """

    emitter: Int32
    radiance: Float32
    faces: Float32 | None
    group: Int64
    hollow: Bools
    picture: Bools
    glow: Glow | None
    bend: Float32 | None

    @classmethod
    def of(
        cls, emitters: Sequence[tuple[Int64, Material, Material]], surfaces: Surfaces, glow: Glow | None
    ) -> OwnFaces:
        """Of emitters, each with its triangles and what they are made of, seen from the front and from behind."""
        owner = np.full(surfaces.count, -1, np.int32)
        radiance = np.zeros((len(emitters), 2, 3), np.float32)
        hollow, picture = np.zeros((2, len(emitters)), bool)
        for number, (triangles, material, behind) in enumerate(emitters):
            owner[triangles] = number
            outside = behind is material and bool(surfaces.closed[triangles].all())
            hollow[number] = is_hollow(surfaces.corners[triangles], outside)
            picture[number] = glow is not None and "emission" in material.varies
            radiance[number] = material.emission, behind.emission
            if glow is not None and picture[number]:
                rows = np.searchsorted(glow.triangle, triangles)
                radiance[number] = [side.radiance[rows].max((0, 1)) for side in (glow, glow.backs or glow)]
        group = np.array([material.group for _, material, _ in emitters], np.int64)
        brightest: Float32 = radiance.max(1)
        faces: Float32 | None = None
        if any(behind is not material for _, material, behind in emitters):
            faces = np.asarray(radiance / np.maximum(brightest, np.float32(1e-30))[:, None], np.float32)
        bend = surfaces.bend if surfaces.bends else None
        return cls(owner, brightest, faces, group, hollow, picture, glow if picture.any() else None, bend)

    def put_out(self, emitter: int, light: Float32, triangle: Int32) -> None:
        """Put out, in place, an emitter's light (P,) on points of triangles (P,) of its own."""
        if emitter >= 0:
            light[self.emitter[triangle] == emitter] = 0

    def lit(self, triangle: Int32, among: set[int]) -> Int64:
        """Which points, on triangles (P,), their own emitter may light, if that is `among` some emitters."""
        counts = self.hollow.copy()
        counts[[number for number in range(len(counts)) if number not in among]] = False
        return np.flatnonzero(np.append(counts, False)[self.emitter[triangle]])

    def channels(self, visibility: Visibility) -> int:
        """Colours that `seen` tells apart: 1 or 3."""
        return 3 if visibility.channels > 1 or self.picture.any() or self.faces is not None else 1

    def seen(
        self,
        triangle: Int32,
        origins: Float32,
        shading: Float32,
        faces: Float32,
        u: Float32,
        v: Float32,
        visibility: Visibility,
        chance: Float32 | None,
    ) -> Float32:
        """Radiance (C, R) that rays bring from the emitters of triangles (R,) that they start on, as a share of theirs.

        Args:
            origins: (R, 3), m
            shading, faces: (R, 3) unit normals: that of the cosine, and that of the horizon
            u, v: (R,) samples
            chance: as for `Visibility.first_hit`
        """
        ways = cosine_directions(shading, u, v)
        hits = visibility.first_hit(origins, ways, chance)
        own = self.emitter[triangle]
        met = np.append(self.emitter, np.int32(-1))[hits.triangle] == own
        met &= dots(ways, faces) > 0
        share = np.repeat(met[None].astype(np.float32), self.channels(visibility), axis=0)
        if self.faces is not None:
            some = np.flatnonzero(met)
            share[:, some] = self.faces[own[some], np.where(hits.front[some], 0, 1)].T
        if self.glow is not None:
            varied = np.flatnonzero(met & self.picture[own])
            where = hits.triangle[varied], hits.u[varied], hits.v[varied]
            shown = self.glow.at(*where)
            if self.glow.backs is not None:
                shown = np.where(hits.front[varied, None], shown, self.glow.backs.at(*where))
            share[:, varied] = (shown / np.maximum(self.radiance[own[varied]], np.float32(1e-30))).T
        if hits.tint is not None:
            share *= hits.tint.T
        if self.bend is not None:
            share *= bent_share(dots(ways, shading), self.bend[triangle])
        return share

    def irradiance(self, triangle: Int32, share: Float32) -> Float32:
        """W/m2 (P, 3) from mean shares (C, P) at points of triangles (P,)."""
        light: Float32 = self.radiance[self.emitter[triangle]] * np.float32(np.pi)
        light *= share.T
        return light


def is_hollow(corners: Float32, closed: bool) -> bool:
    """Whether some of the triangles (M, 3, 3) of an emitter may see others; those of a `closed` body on its outside."""
    size = float(np.max(np.ptp(corners, axis=(0, 1)), initial=0))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    few = len(corners) <= FEW
    held = slice(None) if few else slice(1)
    height = np.einsum("mx,nx->mn", normal[held], corners.reshape(-1, 3))
    height -= np.einsum("mx,mx->m", normal[held], corners[held, 0])[:, None]
    return bool(((height if few and closed else np.abs(height)) > RISE * size).any())


def add_own_light(
    own: OwnFaces, among: set[int], texels: Texels, visibility: Visibility, rays: int, workers: int, total: Float32
) -> Fractions[None]:
    """Add what emitters `among` some throw on their own texels to irradiance `total` (T, G, 3), W/m2.

    Args:
        rays: shadow rays that a texel would send
    """
    surfaces = texels.surfaces
    front = surfaces.front[texels.triangle[:]]
    ids = own.lit(front, among)
    ids = ids[texels.valid[ids]]
    if not len(ids):
        return
    groups = sample_groups(whole_groups(RAYS * rays), STRATA)
    count = len(groups) * STRATA
    shares = np.empty((own.channels(visibility), len(ids)), np.float32)

    def look(start: int, stop: int) -> None:
        part = ids[start:stop]
        every = np.tile(part, STRATA)
        shading, triangle = texels.shading_normal.take(every, axis=0), front[every]
        shifts = pixel_shifts(texels.pixel[part].astype(np.int64), texels.size)
        slopes = lattice_generators(texels.pixel[part], count)
        sums = np.zeros((own.channels(visibility), len(part)))
        for number, group in enumerate(groups):
            u = shifted(group, shifts[0]).reshape(-1)
            v = (group * slopes + shifts[1]).reshape(-1)
            v -= np.floor(v)
            sample = np.repeat(np.arange(STRATA * number, STRATA * (number + 1)), len(part))
            points, face = texels.points(every, sample)
            faces = surfaces.normals(face)
            points += faces * np.float32(surfaces.offset)
            chance = passing_chance(visibility, every, sample)
            found = own.seen(triangle, points, shading, faces, u, v, visibility, chance)
            sums += found.reshape(len(sums), STRATA, -1).sum(1)
        shares[:, start:stop] = sums / count

    yield from scaled(in_chunks(look, len(ids), CHUNK, workers), 0, 1)
    number = np.full(len(texels.texel_at), -1, np.int32)
    number[texels.pixel[ids]] = np.arange(len(ids), dtype=np.int32)

    def add(start: int, stop: int) -> None:
        part = ids[start:stop]
        light = own.irradiance(front[part], _even(shares, np.arange(start, stop), ids, number, texels))
        total[part, own.group[own.emitter[front[part]]]] += light

    yield from scaled(in_chunks(add, len(ids), CHUNK, workers), 1, 1)


def _even(shares: Float32, chosen: Int64, ids: Int64, number: Int32, texels: Texels) -> Float32:
    """Means (C, K) of shares (C, P) over pairs of opposite neighbours on the page and the `chosen` (K,) between them.

    What changes evenly across a texel is left as it is.

    Args:
        ids: (P,) texels of the shares
        number: (pixels,) which of them each pixel is, -1 for none
    """
    surfaces, texel = texels.surfaces, ids[chosen]
    component = surfaces.component[texels.triangle[texel]]
    shading, faces = texels.shading_normal.take(texel, axis=0), texels.normal.take(texel)
    column = texels.pixel[texel] % texels.size

    def beside(step: int) -> tuple[Int32, Bools]:
        other = number.take(texels.pixel[texel] + step, mode="clip")
        there = ids[other]
        alike = (other >= 0) & (surfaces.component[texels.triangle[there]] == component)
        alike &= np.abs(texels.pixel[there] % texels.size - column) <= 1
        alike &= dots(texels.shading_normal.take(there, axis=0), shading) > LEVEL
        alike &= dots(texels.normal.take(there), faces) > FACETS
        return other, alike

    total, count = shares[:, chosen].copy(), np.ones(len(chosen), np.float32)
    for step in (1, texels.size - 1, texels.size, texels.size + 1):
        (ahead, first), (behind, second) = beside(step), beside(-step)
        both = np.flatnonzero(first & second)
        total[:, both] += shares[:, ahead[both]] + shares[:, behind[both]]
        count[both] += 2
    return total / count


def own_irradiance_at(
    own: OwnFaces,
    among: set[int],
    surfaces: Surfaces,
    triangle: Int32,
    points: Float32,
    normals: Float32,
    visibility: Visibility,
    samples: int,
    seed_ids: Int64,
    total: Float32,
) -> None:
    """Add the same at any points (P, 3), lifted off triangles (P,) of fronts, to `total` (P, G, 3): `samples` each."""
    lit = own.lit(triangle, among)
    if not len(lit):
        return
    each = np.repeat(lit, samples)
    sample = np.tile(np.arange(samples), len(lit))
    u, v = (even_uniform(seed_ids[each], sample, dimension) for dimension in (0, 1))
    faces = surfaces.normals(triangle[each])
    shading = normals.take(each, axis=0)
    faces = faces * np.sign(dots(faces, shading))[:, None]  # those of backs point the other way
    chance = passing_chance(visibility, seed_ids[each], sample)
    share = own.seen(triangle[each], points.take(each, axis=0), shading, faces, u, v, visibility, chance)
    mean = share.reshape(len(share), -1, samples).mean(2)
    total[lit, own.group[own.emitter[triangle[lit]]]] += own.irradiance(triangle[lit], mean)
