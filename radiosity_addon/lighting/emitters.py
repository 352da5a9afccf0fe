# SPDX-License-Identifier: GPL-3.0-or-later
"""Emissive meshes as lamps: what shines is decided once for each emitter, so that nothing counts twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Bools, Float32, Float64, Int32, Int64
from ..geometry.surfaces import Surfaces
from ..scene import RGB, Material, Scene
from .area_lamps import PanelLamp
from .emitter_tree import EmitterTree, halved
from .glow import ALIKE, Glow
from .mesh_lamp import MeshLamp
from .own_faces import OwnFaces
from .polygons import Polygon, convex_polygon, parallelogram

POLYGONS = 16
"""Emitters of at most so many polygons are summed polygon by polygon, others over a tree."""

LARGEST = 0.25
"""An emitter with more than this share of the scene's surface is left to the gather, whose rays can't miss it."""

CLEAR = 0.5
"""An emitter that lets more than this share of the light pass is a lamp whatever its size: few rays stop at it."""

BOTH, FRONT, BACK = 0, 1, -1
"""Sides that surfaces shine on."""

FLAT = 1e-5
"""Largest distance of a quad's fourth corner from the plane of the others, and from a parallelogram, as a share."""


def emissive_lamps(
    scene: Scene, surfaces: Surfaces, glow: Glow | None = None
) -> tuple[list[PanelLamp], Bools, OwnFaces]:
    """Lamps that stand for emissive triangles, one for each mesh and material, or one a channel where colours vary.

    Where the two faces do not shine alike, each has lamps of its own.

    Args:
        glow: what triangles emit whose emission varies; without it they emit their material's constant

    Returns:
        the lamps; (F,) which triangles they stand for, the gather finds the others; and how those light themselves
    """
    sampled = np.zeros(surfaces.count, bool)
    lamps: list[PanelLamp] = []
    emission = np.array([material.emission for material in scene.materials] or [(0, 0, 0)], np.float64)
    shines = (emission > 0).any(1)
    bright = (shines | shines[scene.behind])[surfaces.material]
    if glow is not None:
        bright[glow.triangle] = glow.bright
    glowing = np.flatnonzero(bright & (surfaces.area > 0) & surfaces.met)
    owner = surfaces.mesh[glowing].astype(np.int64) * max(len(scene.materials), 1) + surfaces.material[glowing]
    polygon = np.concatenate([mesh.polygon for mesh in scene.meshes] or [np.zeros(0, np.int32)])
    known: list[tuple[Int64, Material, Material]] = []
    for emitter in np.unique(owner):
        triangles = glowing[owner == emitter]
        number = surfaces.material[triangles[0]]
        material, behind = scene.materials[number], scene.materials[scene.behind[number]]
        missed = np.mean(material.transmittance) > CLEAR
        picture = glow if "emission" in material.varies else None
        constant = None if picture is None or behind is not material else picture.constant(triangles)
        if constant is not None:  # as where each instance has a colour of its own
            material = behind = replace(material, emission=constant, varies=material.varies - {"emission"})
            picture = None
        sides = _sides(material, behind, picture)
        shining = max(
            surfaces.area[triangles].sum() if picture is None else picture.extent(triangles, surfaces.area)
            for _, _, picture in sides
        )
        if missed or shining <= LARGEST * surfaces.area.sum():
            found = []
            for side, look, picture in sides:
                if picture is None:
                    found.append(_emitter(surfaces, triangles, polygon, look, side))
                else:
                    found += _pictures(surfaces, triangles, picture, look, side)
            lamps += [replace(lamp, emitter=len(known), leads=lamp is found[0]) for lamp in found]
            known.append((triangles, material, material if sides[0][0] == BOTH else behind))
            sampled[triangles] = True
    if glow is not None:
        sampled[glow.triangle] |= ~bright[glow.triangle]  # black all over: nothing to find there
    return lamps, sampled, OwnFaces.of(known, surfaces, glow)


def _sides(material: Material, behind: Material, glow: Glow | None) -> list[tuple[int, Material, Glow | None]]:
    """What of a surface shines, with its picture if it has one: both faces alike, or one of them, or each by itself."""
    backs = None if glow is None else glow.backs
    if behind is material or (backs is None if glow is not None else behind.emission == material.emission):
        return [(BOTH, material, glow)]
    sides = [(FRONT, material, glow), (BACK, behind, backs)]
    return [side for side in sides if side[2] is not None or any(side[1].emission)]


def _turned(surfaces: Surfaces, triangles: Int64, side: int) -> tuple[Bools, Float32 | None]:
    """Which triangles (M,) to turn so that they shine from their fronts, and the bounding box of closed bodies."""
    if side == BACK or not surfaces.closed[triangles].all():
        return np.full(len(triangles), side == BACK), None
    inward, box = _body(surfaces, triangles)
    return inward & (side == BOTH), box


def _pictures(surfaces: Surfaces, triangles: Int64, glow: Glow, material: Material, side: int) -> list[PanelLamp]:
    """Lamps of an emitter whose emission varies: pieces, each with its own radiance, as one lamp for each channel.

    Where colours are alike but for their brightness one lamp does for all channels.
    """
    corners, radiance, owner = glow.pieces(triangles, surfaces.corners[triangles].astype(np.float64))
    if not len(corners):
        return []
    turned, box = _turned(surfaces, triangles, side)
    corners[turned[owner]] = corners[turned[owner]][:, ::-1]
    color = radiance.mean(0) / radiance.mean()
    level = radiance.mean(1)
    if np.abs(radiance - level[:, None] * color).max() < ALIKE * level.max():
        colors, levels = [color], level[:, None]
    else:
        bright = np.flatnonzero(radiance.any(0))
        colors, levels = list(np.eye(3)[bright]), radiance[:, bright]
    mean = np.array([_mean(corners, own) for own in levels.T])
    levels = levels / mean
    tree = EmitterTree.over(corners, levels)
    place = halved(corners.mean(1), max(len(corners) - 1, 1).bit_length())
    order = np.argsort(place, kind="stable")
    corners, levels = corners[order], levels[order]
    mixed = levels.mean(1)
    alike = len(colors) == 1
    group, both = material.group, side == BOTH
    return [
        _picture(corners, mixed, number, color * mean[number], tree, box, group, None if alike else own / mixed, both)
        for number, (own, color) in enumerate(zip(levels.T, colors, strict=True))
    ]


def _mean(corners: Float64, level: Float64) -> float:
    """Mean radiance of those of the triangles (M, 3, 3) that shine at all, from their `level` (M,)."""
    size = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return float((size * level).sum() / size[level > 0].sum())


def _picture(
    corners: Float64,
    level: Float64,
    channel: int,
    radiance: Float64,
    tree: EmitterTree,
    box: Float32 | None,
    group: int,
    tint: Float64 | None,
    both: bool,
) -> MeshLamp:
    """A lamp of triangles that shine at different levels; samples fall on them by the light of all channels alike.

    Args:
        radiance: (3,) mean of the lamp's channel
        tint: level in that channel, as a share of `level`
        both: shines to both sides
    """
    edge_u, edge_v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = np.cross(edge_u, edge_v)
    size = np.linalg.norm(cross, axis=1)
    weight = size * level
    return MeshLamp(
        strength=_rgb(radiance),
        polygons=(),
        corner=corners[:, 0].astype(np.float32),
        edge_u=edge_u.astype(np.float32),
        edge_v=edge_v.astype(np.float32),
        normal=(cross / np.maximum(size, 1e-300)[:, None]).astype(np.float32),
        ends=(np.cumsum(weight) / weight.sum()).astype(np.float32),
        shape="triangle",
        area=float(weight.sum() / 2),
        two_sided=both,
        box=box,
        shadow=True,
        group=group,
        tree=tree,
        channel=channel,
        tint=None if tint is None else tint.astype(np.float32),
    )


def _rgb(values: Float64) -> RGB:
    return (float(values[0]), float(values[1]), float(values[2]))


def _emitter(surfaces: Surfaces, triangles: Int64, polygon: Int32, material: Material, side: int) -> PanelLamp:
    # neighbours on the surface are neighbours in the list, so that even samples of the list are even on the surface
    place = halved(surfaces.corners[triangles].mean(1), max(len(triangles) - 1, 1).bit_length())
    triangles = triangles[np.argsort(place, kind="stable")]
    corners = surfaces.corners[triangles].astype(np.float64)
    turned, box = _turned(surfaces, triangles, side)
    corners[turned] = corners[turned][:, ::-1]
    quads = _quads(corners, polygon[triangles])
    merged = {index for pair, _ in quads for index in pair}
    loose = [k for k in range(len(corners)) if k not in merged]
    few = len(quads) + len(loose) <= POLYGONS
    shapes: list[Polygon] = []
    if few:
        both = side == BOTH and box is None
        shapes = [_polygon(quad, both) for _, quad in quads]
        shapes += [convex_polygon(corners[k], both) for k in loose]
    plain = few and not loose and all(_is_parallelogram(quad) for _, quad in quads)
    cells = np.array([quad[[0, 1, 3]] for _, quad in quads]) if plain else corners
    edge_u, edge_v = cells[:, 1] - cells[:, 0], cells[:, 2] - cells[:, 0]
    cross = np.cross(edge_u, edge_v)
    size = np.linalg.norm(cross, axis=1)
    fields = {
        "strength": material.emission,
        "polygons": tuple(shapes),
        "corner": cells[:, 0].astype(np.float32),
        "edge_u": edge_u.astype(np.float32),
        "edge_v": edge_v.astype(np.float32),
        "normal": (cross / np.maximum(size, 1e-300)[:, None]).astype(np.float32),
        "ends": (np.cumsum(size) / size.sum()).astype(np.float32),
        "shape": "parallelogram" if plain else "triangle",
        "area": float(surfaces.area[triangles].sum()),
        "two_sided": side == BOTH,
        "box": box,
        "shadow": True,
        "group": material.group,
    }
    return PanelLamp(**fields) if few else MeshLamp(**fields, tree=EmitterTree.over(corners))


def _body(surfaces: Surfaces, triangles: Int64) -> tuple[Bools, Float32]:
    """Of closed bodies: which triangles wind inward, and the bodies' bounding box (2, 3)."""
    parts = np.unique(surfaces.component[triangles])
    members = np.flatnonzero(np.isin(surfaces.component, parts))
    corners = surfaces.corners[members].astype(np.float64)
    part = np.searchsorted(parts, surfaces.component[members])
    middle = corners.mean((0, 1))
    a, b, c = (corners[:, k] - middle for k in range(3))
    volume = np.bincount(part, weights=np.einsum("ij,ij->i", a, np.cross(b, c)), minlength=len(parts))
    inward = volume[np.searchsorted(parts, surfaces.component[triangles])] < 0
    flat = surfaces.corners[members].reshape(-1, 3)
    return inward, np.stack([flat.min(0), flat.max(0)])


def _quads(corners: Float64, polygon: Int32) -> list[tuple[tuple[int, int], Float64]]:
    """Pairs of triangles that are one flat convex quad: their numbers, and its corners (4, 3)."""
    found = []
    if len(corners) > 4 * POLYGONS:
        return []
    for number in np.unique(polygon):
        pair = np.flatnonzero(polygon == number)
        if len(pair) != 2:
            continue
        first, second = corners[pair]
        same = [(i, j) for i in range(3) for j in range(3) if np.array_equal(first[i], second[j])]
        if len(same) != 2:
            continue
        lone = ({0, 1, 2} - {i for i, _ in same}).pop()
        other = ({0, 1, 2} - {j for _, j in same}).pop()
        quad = np.array([first[lone], first[lone - 2], second[other], first[lone - 1]])
        if _is_flat_and_convex(quad):
            found.append(((int(pair[0]), int(pair[1])), quad))
    return found


def _is_flat_and_convex(quad: Float64) -> bool:
    edges = np.roll(quad, -1, axis=0) - quad
    turns = np.cross(edges, np.roll(edges, -1, axis=0))
    size = np.linalg.norm(turns, axis=1)
    normal = turns.sum(0) / max(float(np.linalg.norm(turns.sum(0))), 1e-300)
    return bool((turns @ normal > (1 - FLAT) * size).all() and (size > 0).all())


def _is_parallelogram(quad: Float64) -> bool:
    gap = quad[0] - quad[1] + quad[2] - quad[3]
    return bool(np.linalg.norm(gap) < FLAT * np.linalg.norm(quad[2] - quad[0]))


def _polygon(quad: Float64, two_sided: bool) -> Polygon:
    if _is_parallelogram(quad):
        return parallelogram(quad[0], quad[1] - quad[0], quad[3] - quad[0], two_sided)
    return convex_polygon(quad, two_sided)
