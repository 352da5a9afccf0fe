# SPDX-License-Identifier: GPL-3.0-or-later
"""What a ray meets: bounding volume hierarchies (Embree, through embreex) over what is opaque and what is not.

Segments to lamps are dimmed by each surface that they pass. Rays that look for what they meet pass a half clear
surface or stop at it by chance: what they find then counts in full, and no ray splits.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bools, Float32, Int32, Int64
from ..columns import dots
from ..errors import BakeError
from ..sampling import even_uniform, hash_bits, hash_uniform
from ..scene import Scene
from ..shading import Shader
from .surfaces import Surfaces
from .transmittance import Transmittance, for_indirect_light, transmittance_of

SEGMENT_END = np.float32(1.0 - 1e-4)
"""Shadow segments stop short of their target by this share, so that a target on a surface is not its own blocker."""

PIECE = 1 << 17
"""Triangles that Embree takes in one go, a tenth of a second: in it no other thread of Python gets its turn."""

MOST_LAYERS = 256
"""Surfaces that a ray can pass; the next one stops it."""

TINY = np.float32(1e-30)
"""Keeps 0 / 0 from arising; normals of slivers may vanish."""

FLATTEST = np.float32(0.01)
"""Least cosine with which a ray is taken to pass a surface: nearly parallel ones would step on too far."""

PASSING_DIMENSION = 3
"""Dimension of the sample sequence that lets rays pass; directions take 0 and 1, origins 2."""

BLOCKED = 0.5
"""A line of sight is blocked if less than this share of the light gets through."""


@dataclass(frozen=True)
class Hits:
    """First hits of R rays.

    Attributes:
        triangle: (R,) int32, -1 where the ray leaves the scene
        u, v: (R,) float32, barycentrics of corners 1 and 2
        distance: (R,) float32, in lengths of the ray's direction; huge where it leaves
        front: (R,) bool, the geometric front was hit
        tint: (R, 3) float32, what the light's channels are multiplied with on the way; None: nothing colours it
    """

    triangle: Int32
    u: Float32
    v: Float32
    distance: Float32
    front: Bools
    tint: Float32 | None = None


@dataclass(frozen=True)
class Tally:
    """Rays that Embree traced, and the processor time it took for them, s, of all threads together.

    Attributes:
        closest, closest_seconds: of rays that look for the nearest surface
        shadow, shadow_seconds: of rays that ask whether anything is in the way
    """

    closest: int = 0
    closest_seconds: float = 0.0
    shadow: int = 0
    shadow_seconds: float = 0.0

    def __add__(self, more: Tally) -> Tally:
        return Tally(
            self.closest + more.closest,
            self.closest_seconds + more.closest_seconds,
            self.shadow + more.shadow,
            self.shadow_seconds + more.shadow_seconds,
        )

    def __sub__(self, less: Tally) -> Tally:
        return self + Tally(-less.closest, -less.closest_seconds, -less.shadow, -less.shadow_seconds)

    @property
    def seconds(self) -> float:
        return self.closest_seconds + self.shadow_seconds


class _Meter:
    """Keeps a tally for several threads."""

    def __init__(self) -> None:
        self.tally = Tally()
        self._lock = threading.Lock()

    def add(self, more: Tally) -> None:
        with self._lock:
            self.tally += more


class _Tree:
    """A BVH over those of the triangles (F, 3, 3) that are `chosen`, (K,) or None for all."""

    def __init__(self, corners: Float32, meter: _Meter, chosen: Int64 | None = None) -> None:
        self._meter = meter
        try:
            from embreex import rtcore_scene
            from embreex.mesh_construction import TriangleMesh
        except ImportError as error:
            raise BakeError(
                "embreex", f"the ray-tracing library did not load ({error})", "Install the zip made for this platform"
            ) from error
        self.number = None if chosen is None else np.append(chosen, -1).astype(np.int32)  # -1, no triangle, stays so
        if chosen is not None:
            corners = corners[chosen]
        self.empty = len(corners) == 0
        self._scene = rtcore_scene.EmbreeScene(robust=True)
        if not self.empty:
            vertices = np.ascontiguousarray(corners.reshape(-1, 3), np.float32)
            indices = np.arange(3 * min(PIECE, len(corners)), dtype=np.int32).reshape(-1, 3)
            pieces = [vertices[start : start + 3 * PIECE] for start in range(0, len(vertices), 3 * PIECE)]
            self._pieces = [TriangleMesh(self._scene, piece, indices[: len(piece) // 3]) for piece in pieces]
            self._scene.run(vertices[:1], np.ones((1, 3), np.float32))  # builds the tree here, not in a worker

    def blocks(self, origins: Float32, segments: Float32, end: np.float32 | None = None) -> Bools:
        """Whether anything lies along the rays (R, 3), before the share `end` of them if that is given."""
        if self.empty or len(origins) == 0:
            return np.zeros(len(origins), bool)
        origins, segments = (np.ascontiguousarray(part, np.float32) for part in (origins, segments))
        dists = None if end is None else np.full(len(origins), end, np.float32)
        start = time.thread_time()
        found = self._scene.run(origins, segments, dists=dists, query="OCCLUDED")
        self._meter.add(Tally(shadow=len(origins), shadow_seconds=time.thread_time() - start))
        return np.asarray(found == 0)

    def first(self, origins: Float32, directions: Float32, ends: Float32 | None = None) -> tuple[Hits, Float32]:
        """The nearest triangles, before `ends` (R,) if given, and their normals (R, 3), not of unit length."""
        count = len(origins)
        if self.empty or count == 0:
            nothing = np.zeros(count, np.float32)
            far = np.full(count, 1e37, np.float32)
            hits = Hits(np.full(count, -1, np.int32), nothing, nothing, far, np.zeros(count, bool))
            return hits, np.zeros((count, 3), np.float32)
        origins, directions = (np.ascontiguousarray(part, np.float32) for part in (origins, directions))
        dists = None if ends is None else ends.astype(np.float32)  # a copy: it is written into
        start = time.thread_time()
        found = self._scene.run(origins, directions, dists=dists, output=1)
        self._meter.add(Tally(closest=count, closest_seconds=time.thread_time() - start))
        triangle = found["primID"]
        if len(self._pieces) > 1:
            triangle = np.where(triangle < 0, -1, triangle + found["geomID"] * PIECE).astype(np.int32)
        if self.number is not None:
            triangle = self.number.take(triangle)
        facing = dots(found["Ng"], directions) < 0
        return Hits(triangle, found["u"], found["v"], found["tfar"], facing), found["Ng"]


Passing = Callable[[Int64, Hits, Float32], Bools]
"""Given rays (K,), what they meet and the shares (C, K) that pass there: which of them go on."""


class Visibility:
    """What (F, 3, 3) float32 corners hide. Queries are safe from several threads and release the GIL.

    Args:
        transmittance: what they let through; None: nothing
        lift: m, perpendicular to a surface, by which a ray that passes it steps on: nearer ones count as one
        met: (F,) bool, triangles that are there at all
        casts: (F,) bool, triangles that are there for the light of lamps
        of_lamps: what hides lamps, if more differs than that

    Attributes:
        of_lamps: what hides lamps: this, where the same triangles do
        transmittance: as given
        rays: traced so far
    """

    def __init__(
        self,
        corners: Float32,
        transmittance: Transmittance | None = None,
        lift: float = 0.0,
        met: Bools | None = None,
        casts: Bools | None = None,
        of_lamps: Visibility | None = None,
    ) -> None:
        if not np.isfinite(corners).all() or (corners.size and np.abs(corners).max() > 1e15):
            raise ValueError("corners must be finite and below 1e15 m")
        met, casts = (np.ones(len(corners), bool) if part is None else part for part in (met, casts))
        self.rays = 0
        self._lock = threading.Lock()
        self._meter = _Meter()
        self.transmittance = transmittance
        self._lift = np.float32(lift)
        if transmittance is None:
            self._opaque = _Tree(corners, self._meter, None if met.all() else np.flatnonzero(met))
        else:
            self._opaque = _Tree(corners, self._meter, np.flatnonzero(transmittance.opaque & met))
            self._veils = _Tree(
                corners, self._meter, np.flatnonzero(~(transmittance.opaque | transmittance.clear) & met)
            )
        self.of_lamps = of_lamps or self
        if of_lamps is None and not np.array_equal(met, casts):
            self.of_lamps = Visibility(corners, transmittance, lift, casts, casts)

    @property
    def dims(self) -> bool:
        """Whether some surfaces stop only part of the light."""
        return self.transmittance is not None

    @property
    def channels(self) -> int:
        """Colours that `transmitted` tells apart: 1 or 3."""
        return 1 if self.transmittance is None else self.transmittance.channels

    def _count(self, origins: Float32, directions: Float32) -> None:
        if origins.shape != directions.shape or origins.ndim != 2 or origins.shape[1] != 3:
            raise ValueError("origins and directions must both be (R, 3)")
        with self._lock:
            self.rays += len(origins)

    def include(self, other: Visibility) -> None:
        """Count what another has traced as traced here."""
        with self._lock:
            self.rays += other.rays
        self._meter.add(other.tally)

    @property
    def traced(self) -> int:
        """Rays traced so far, those to lamps included."""
        return self.rays if self.of_lamps is self else self.rays + self.of_lamps.rays

    @property
    def tally(self) -> Tally:
        """What Embree has done so far, for lamps included. Rays that pass surfaces come again from each."""
        own = self._meter.tally
        return own if self.of_lamps is self else own + self.of_lamps.tally

    def occluded(self, origins: Float32, segments: Float32) -> Bools:
        """Whether what lies between origins (R, 3) and origins + segments (R, 3) stops most of the light."""
        if self.transmittance is not None:
            return np.asarray(self.transmitted(origins, segments).mean(0) < BLOCKED)
        self._count(origins, segments)
        return self._opaque.blocks(origins, segments, SEGMENT_END)

    def transmitted(self, origins: Float32, segments: Float32, both_ways: bool = False) -> Float32:
        """The share (C, R) of light that gets from origins + segments (R, 3) to origins (R, 3), C `channels`.

        Args:
            both_ways: as for `first_hit`
        """
        self._count(origins, segments)
        clear = ~self._opaque.blocks(origins, segments, SEGMENT_END)
        share = np.repeat(clear.astype(np.float32)[None], self.channels, axis=0)
        if self.transmittance is not None:
            rays = np.flatnonzero(clear)

            def dims(ray: Int64, hits: Hits, passed: Float32) -> Bools:
                left = share[:, rays[ray]] * passed
                share[:, rays[ray]] = left
                return np.asarray(left.max(0) > 0)

            ends = np.full(len(rays), SEGMENT_END, np.float32)
            share[:, rays[self._pass(origins[rays], segments[rays], ends, dims, both_ways)]] = 0
        return share

    def escapes(self, origins: Float32, directions: Float32) -> Bools:
        """Whether rays (R, 3) leave the scene without being stopped."""
        if self.transmittance is not None:
            return self.first_hit(origins, directions).triangle < 0
        self._count(origins, directions)
        return ~self._opaque.blocks(origins, directions)

    def first_hit(
        self, origins: Float32, directions: Float32, chance: Float32 | None = None, both_ways: bool = False
    ) -> Hits:
        """The nearest surface that stops each ray (R, 3).

        Args:
            chance: (R,) uniform in [0, 1), even over the rays of one receiver, for what passes half clear surfaces;
                None: hashed from the rays
            both_ways: what lets light through from one side only stops it from either, as exchange takes it
        """
        self._count(origins, directions)
        hits, _ = self._opaque.first(origins, directions)
        if self.transmittance is None:
            return hits
        left = hash_uniform(_ray_ids(origins, directions)) if chance is None else chance.copy()
        found = replace(hits, distance=hits.distance.copy())
        tint = np.ones((len(left), 3), np.float32) if self.channels > 1 else None

        def stops(ray: Int64, hits: Hits, passed: Float32) -> Bools:
            mean = passed.mean(0)
            onward = left[ray] < mean
            here = ray[~onward]
            for own, other in (
                (found.triangle, hits.triangle),
                (found.u, hits.u),
                (found.v, hits.v),
                (found.distance, hits.distance),
                (found.front, hits.front),
            ):
                own[here] = other[~onward]
            on = ray[onward]
            left[on] /= mean[onward]  # again uniform: one number passes all layers, as evenly as the first
            if tint is not None:
                tint[on] *= (passed[:, onward] / mean[onward]).T
            return onward

        self._pass(origins, directions, hits.distance, stops, both_ways)
        return replace(found, tint=tint)

    def _pass(self, origins: Float32, directions: Float32, ends: Float32, passing: Passing, both_ways: bool) -> Int64:
        """Walk along rays (R, 3) from one surface that is not opaque to the next, up to `ends` (R,).

        Returns:
            rays that have passed too many
        """
        assert self.transmittance is not None
        ray = np.arange(len(origins))
        begin = np.zeros(len(origins), np.float32)
        start, way = origins, directions
        for layer in range(MOST_LAYERS):
            if self._veils.empty or not len(ray):
                return ray[:0]
            if layer:
                way = directions[ray]
                start = origins[ray] + begin[:, None] * way
            hits, normal = self._veils.first(start, way, ends[ray] - begin)
            met = np.flatnonzero(hits.triangle >= 0)
            ray, way, normal, begin = ray[met], way[met], normal[met], begin[met]
            hits = Hits(hits.triangle[met], hits.u[met], hits.v[met], begin + hits.distance[met], hits.front[met])
            length, across = (np.sqrt(np.einsum("ij,ij->i", part, part)) for part in (way, normal))
            cosine = np.abs(np.einsum("ij,ij->i", way, normal)) / np.maximum(length * across, TINY)
            side = None if both_ways else hits.front
            share = self.transmittance.at(hits.triangle, hits.u, hits.v, np.minimum(cosine, 1), side)
            onward = passing(ray, hits, share)
            begin = hits.distance + self._lift / (length * np.maximum(cosine, FLATTEST))
            kept = np.flatnonzero(onward & (begin < ends[ray]))
            ray, begin = ray[kept], begin[kept]
        return ray


def passing_chance(visibility: Visibility, ids: Int32 | Int64, sample: Int32 | Int64) -> Float32 | None:
    """Chances for `first_hit` that are even over the samples of each id (R,); None where there is nothing to pass."""
    return even_uniform(ids, sample, PASSING_DIMENSION) if visibility.dims else None


def _ray_ids(origins: Float32, directions: Float32) -> Int64:
    """A number (R,) for each ray, the same whenever it is traced."""
    ids = np.zeros(len(origins), np.uint32)
    for rows in (origins, directions):
        for part in np.ascontiguousarray(rows.T, np.float32):
            ids = hash_bits(ids ^ part.view(np.uint32))
    return ids.astype(np.int64)


def visibility_of(scene: Scene, surfaces: Surfaces, shader: Shader | None, density: float) -> Visibility:
    """What rays meet in a scene, of which some surfaces let light through; see `transmittance_of`."""
    corners, lift, met, casts = surfaces.corners, surfaces.offset, surfaces.met, surfaces.casts
    own = transmittance_of(scene, surfaces, shader, density)
    indirect = for_indirect_light(scene)
    if indirect is scene:
        return Visibility(corners, own, lift, met, casts)
    of_lamps = Visibility(corners, own, lift, casts, casts)
    return Visibility(corners, transmittance_of(indirect, surfaces, shader, density), lift, met, casts, of_lamps)
