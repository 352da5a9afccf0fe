# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a bake is from the truth, by its own account: a few texels are computed anew, by other rays.

At chosen texels the right side of the radiosity equation is estimated afresh, without probes, patches, gather points or
fits: shadow rays spread over footprint and lamps, and cosine-distributed rays that read what the finished lightmap
reflects. How far that is from the lightmap is its residual; what an error of the whole room adds to itself by further
bounces is made good. Each texel has two estimates of independent rays: products of their differences have no bias from
the noise of either.

Measured against bakes of 30 times the rays: within 1.5 of the error for the Cornell box and the window room in all
qualities; of a hall whose lamps burn 0.2 m under the ceiling half of it, as few texels hold most of the error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bools, Float32, Float64, Int32, Int64
from ..chunks import Fractions, finish, in_chunks, scaled
from ..columns import dots, sums
from ..geometry.texels import STRATA, Texels
from ..geometry.visibility import Visibility, passing_chance
from ..lighting.lamp_samples import bent_share
from ..lighting.lights import Lamps, irradiance_at
from ..lighting.sky import cells
from ..lighting.terminator import footing
from ..radiosity.illumination import Illumination
from ..radiosity.patches import SKY, Patches
from ..sampling import cosine_directions, even_uniform, hash_bits
from .gleams import Gleams

TEXELS = 96
"""Texels that are checked. Of more there would be fewer rays each, and the rays' noise, squared, counts for more than
which texels are chosen."""

SHARE = 0.04
"""Of the rays of a bake so many more go into its check."""

SHADOWS = 0.25
"""Of these so many are shadow rays."""

GATHER_RAYS = (192, 4096)
"""Rays of one estimate at a texel for indirect light, at least and at most."""

SHADOW_POINTS = (1, 16)
"""Points of a footprint that one estimate asks lamps from, at least and at most, with STRATA rays each."""

DARK = 0.1
"""Of the texels the darkest: errors in the deepest shadow are not seen."""

DARKEST = 0.01
"""Share of the mean light that all texels count as having at least: faces that next to no light reaches."""

MOST_RETURNED = 0.9
"""Of an error of the whole room so much comes back by further bounces, at most; beyond, a check can tell nothing."""

CERTAIN = 2.0
"""Standard errors from which on a bias is taken to be there, and its return to add to the error."""

RAYS = 1 << 15
"""Rays traced at once."""

LAMP_TEXELS = 48
"""Texels that ask lamps at once: each of many lamps is asked by as many together as threads leave."""


@dataclass(frozen=True)
class OwnError:
    """Errors of a lightmap as shares of the light of each texel, mixed from all channels and groups alike.

    A sunlit facade must not hide the errors of the room behind it, so each texel's error is a share of its own light;
    the darkest tenth counts as if it had the light of the brightest of them.

    Attributes:
        rms: root mean square error
        bias: mean error
        rms_uncertainty, bias_uncertainty: standard errors of both
        texels: that were computed anew
    """

    rms: float
    bias: float
    rms_uncertainty: float
    bias_uncertainty: float
    texels: int


def own_error(
    texels: Texels,
    patches: Patches,
    light: Illumination,
    lamps: Lamps,
    direct: Float32,
    indirect: Float32,
    counted: bool,
    wanted: Bools,
    visibility: Visibility,
    workers: int,
) -> Fractions[OwnError | None]:
    """Estimate the error of `direct` and `indirect` irradiance (T, G, 3), W/m2, together; None if there is no light.

    Args:
        light: what surfaces send out
        counted: bounces are, so that surfaces reflect what the patches have of them, not `indirect`
        wanted: (T,) texels of the lightmap
    """
    chosen = _chosen(texels, wanted)
    if len(chosen) < 2:
        return None
    rays = SHARE * visibility.traced / (2 * len(chosen))
    sent = int(np.clip(rays * (1 - SHADOWS), *GATHER_RAYS))
    points = int(np.clip(rays * SHADOWS / STRATA / max(len(lamps.lamps), 1), *SHADOW_POINTS))
    shown = Shown(light, patches, None if counted else indirect)
    groups = direct.shape[1]
    gleams = None if light.beams is None else Gleams(light.beams, texels, groups)

    def lit(start: int, stop: int) -> Float64:
        halves = np.repeat(np.arange(2), stop - start)
        asked = np.tile(chosen[start:stop], 2)
        return lamp_light(texels, asked, halves, points, lamps, visibility, groups).reshape(2, -1)

    def bounced(start: int, stop: int) -> tuple[Float64, Float64]:
        halves = np.repeat(np.arange(2), stop - start)
        asked = np.tile(chosen[start:stop], 2)
        return bounced_light(texels, patches, asked, halves, sent, light, shown, gleams, visibility)

    lights = yield from scaled(in_chunks(lit, len(chosen), LAMP_TEXELS, workers), 0, SHADOWS)
    each = max(1, RAYS // (2 * sent))
    parts = yield from scaled(in_chunks(bounced, len(chosen), each, workers), SHADOWS, 1)
    fresh = np.concatenate([part.reshape(2, -1) for part, _ in parts], axis=1) + np.concatenate(lights, axis=1)
    back = float(np.concatenate([part for _, part in parts]).mean())
    own = _luminance((direct[chosen] + indirect[chosen]).reshape(len(chosen), -1)).astype(np.float64)
    scale = np.maximum(own, max(np.quantile(own, DARK), DARKEST * own.mean()))
    if scale.min() <= 0:
        return None
    return _judged((own - fresh) / scale, min(back, MOST_RETURNED))


def _judged(residual: Float64, returned: float) -> OwnError:
    """What two estimates' relative residuals (2, P) say.

    The residual's mean is an error that all texels share; of its own reflections the share `returned` is in the fresh
    light too, and hides that much of it. What differs from texel to texel is averaged out on its way back.
    """
    number = residual.shape[1]
    product = residual[0] * residual[1]
    bias = residual.mean() / (1 - returned)
    # of the mean's square, without what its own scatter adds to it
    common = (number**2 * residual[0].mean() * residual[1].mean() - product.sum()) / (number * (number - 1))
    spread = float(residual.mean(0).std()) / np.sqrt(number) / (1 - returned)
    if abs(bias) < CERTAIN * spread:
        common = 0.0
    square = product.mean() + common * ((1 - returned) ** -2 - 1)
    scatter = product.std() / np.sqrt(number)
    rms = float(np.sqrt(max(square, 0.0)))
    above = float(np.sqrt(max(square, 0.0) + scatter)) - rms
    return OwnError(rms, float(bias), above, spread, number)


def _chosen(texels: Texels, wanted: Bools) -> Int64:
    """Texels (P,), one in each of so many equal parts of those that are wanted and lie on a surface."""
    taking = np.flatnonzero(wanted & texels.valid & (texels.area > 0))
    ends = np.linspace(0, len(taking), min(TEXELS, len(taking)) + 1).astype(np.int64)
    size = np.diff(ends)
    chosen: Int64 = taking[ends[:-1] + hash_bits(ends[:-1], 7).astype(np.int64) % np.maximum(size, 1)]
    return chosen


class Shown:
    """What rays of the check see: the finished light."""

    def __init__(self, light: Illumination, patches: Patches, indirect: Float32 | None) -> None:
        """Takes the patches' light where `indirect` irradiance (T, G, 3), W/m2, is None."""
        self._light, self._patches, self._indirect = light, patches, indirect
        self._last = len(light.passes) - 1
        self._others = _luminance(light.radiance_of_others(self._last, patches))

    def at(self, element: Int32) -> tuple[Float32, Float32]:
        """Radiance of elements (R,), W/(m2 sr), all channels and groups alike, and mean reflectance; both (R,)."""
        count = len(self._light.direct)
        seen = self._others[np.where(element >= count, element - count, np.minimum(element, -1))]
        back = np.zeros(len(element), np.float32)
        ray = np.flatnonzero((element >= 0) & (element < count))
        texel = element[ray]
        near = None if self._indirect is None else (np.ones(len(ray), bool), self._indirect[texel])
        seen[ray] = _luminance(self._light.radiance_of_texels(self._last, self._patches, texel, near))
        back[ray] = self._light.look.reflectance[texel].mean(1)
        return seen, back


def _luminance(light: Float32) -> Float32:
    """Light (P, 3 G) of all groups as one number (P,), channels alike."""
    return sums(light) / np.float32(3)


def bounced_light(
    texels: Texels,
    patches: Patches,
    ids: Int64,
    half: Int64,
    rays: int,
    light: Illumination,
    shown: Shown,
    gleams: Gleams | None,
    visibility: Visibility,
) -> tuple[Float64, Float64]:
    """Irradiance (P,), W/m2, at texels by cosine-distributed rays, and the mean reflectance (P,) that they meet.

    Args:
        ids, half: (P,) texels, and which of two independent estimates each is
        rays: of each
    """
    sample = np.tile(np.arange(rays), len(ids))
    texel = np.repeat(ids, rays)
    seeds = np.repeat(hash_bits(ids * 2 + half, 11).astype(np.int64), rays)
    u, v = (even_uniform(seeds, sample, dimension) for dimension in (0, 1))
    directions = cosine_directions(texels.shading_normal.take(texel, axis=0), u, v)
    origins, triangle = texels.points(texel, sample)
    faces = texels.surfaces.normals(triangle)
    origins += faces * np.float32(texels.surfaces.offset)
    hits = visibility.first_hit(origins, directions, passing_chance(visibility, seeds, sample))
    element = patches.elements(hits)
    if len(light.sky):
        left = np.flatnonzero(element == SKY)
        element[left] = cells(directions[left]) + np.int32(texels.count + patches.count)
    seen, back = shown.at(element)
    if gleams is not None:
        ray, more = gleams.seen(element, directions)
        seen[ray] += _luminance(more * np.repeat(light.passes[-1].reflecting, 3))
    if hits.tint is not None:
        seen *= hits.tint.mean(1)
    above = (dots(directions, faces) > 0).astype(np.float32)
    if texels.surfaces.bends:
        cosine = dots(directions, texels.shading_normal.take(texel, axis=0))
        above *= bent_share(cosine, texels.surfaces.bend[texels.triangle[texel]])
    seen *= above
    back *= above
    return np.pi * seen.reshape(-1, rays).mean(1, dtype=np.float64), back.reshape(-1, rays).mean(1, dtype=np.float64)


def lamp_light(
    texels: Texels, ids: Int64, half: Int64, points: int, lamps: Lamps, visibility: Visibility, groups: int
) -> Float64:
    """Irradiance (P,), W/m2, from lamps at texels, each asked from points spread over the footprint.

    Args:
        ids, half: (P,) texels, and which of two independent estimates each is
        points: of each footprint, with STRATA rays a lamp
    """
    texel = np.repeat(ids, points)
    sample = np.tile(np.arange(points), len(ids)) + np.repeat(half, points) * points
    normals = texels.shading_normal.take(texel, axis=0)
    front = texels.surfaces.front[texels.triangle[texel]]
    seeds = texel * 64 + sample + 5
    origins, stand = texels.origins(texel, sample), footing(texels, texel, sample)
    light = finish(irradiance_at(lamps, origins, normals, visibility, STRATA, seeds, groups, front, stand))
    return _luminance(light.reshape(len(light), -1)).reshape(-1, points).mean(1, dtype=np.float64)
