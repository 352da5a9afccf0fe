# SPDX-License-Identifier: GPL-3.0-or-later
"""The rays of the final gather: what they look at, and what the whole of it finds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from radiosity_addon.bake import bake
from radiosity_addon.chunks import finish
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import rasterize
from radiosity_addon.scene import Material, Mesh, Scene
from radiosity_addon.settings import BakeSettings
from tests.gathering import floor, rays_of, sheet
from tests.shapes import box, cell_atlas, mesh_of, quad, sphere


def test_each_part_of_a_texel_on_two_faces_has_the_horizon_of_its_own_face() -> None:
    """A face under a white sky has (1 + cos a) / 2 of it if its shading normal leans by a; folds hide more of it."""
    texels = sheet([0, 2.03, 4], [0, 1.7, 0])  # the ridge leads through texels
    rays, _ = rays_of(texels, sky=1)
    faces = texels.surfaces.normal[texels.footprints.triangles(np.arange(texels.count))]
    mixed = np.flatnonzero(np.ptp(faces[:, :, 0], axis=1) > 0.1)
    _, _, seen = finish(rays.look(mixed, np.zeros(len(mixed), bool)))
    lean = faces[mixed, :, 2].mean(1)
    assert len(mixed) > 20
    assert seen == pytest.approx((1 + lean) / 2, abs=0.02)


def test_a_smooth_surface_does_not_see_itself_below_its_horizon() -> None:
    """Shading normals lean off their faces, so some rays go down; on a ball alone in space nothing is near."""
    scene = Scene((sphere("Ball", segments=12, rings=6),), (Material("Grey"),))
    texels = finish(rasterize(cell_atlas(scene, 256), flatten(scene), 1))
    rays, _ = rays_of(texels, 1, sky=1)
    whole = np.flatnonzero(texels.covered == 15)
    scale, nearest, _ = finish(rays.look(whole, np.zeros(len(whole), bool)))
    assert len(whole) > 500
    assert nearest.min() > 1e6
    assert scale.min() > 1e6


def test_what_shines_counts_by_its_distance_where_it_is_nearer_than_most() -> None:
    """Light of a board 0.1 m away changes over distances like that, however far the dark walls around are."""
    far_walls = box("Walls", (-20, -20, -1), (24, 24, 20))
    inward = Mesh(**{**vars(far_walls), "triangles": far_walls.triangles[:, ::-1]})
    board = mesh_of("Board", [quad((1.9, 1.9, 0.1), (0, 0.2, 0), (0.2, 0, 0))], [0])
    texels = floor(board, inward)
    place = texels.position + texels.surfaces.origin
    beside = np.linalg.norm(place - [2.2, 2.0, 0.0], axis=1).argmin(keepdims=True)
    scale = []
    for shining in (place[:, 2] > 9, np.abs(place[:, 2] - 0.1) < 0.01):
        rays, _ = rays_of(texels, shining)
        scale.append(finish(rays.look(beside, np.zeros(1, bool)))[0][0])
    assert 0.1 < scale[1] < 0.35
    assert scale[0] > 0.5


@pytest.mark.parametrize(("near_to", "expected"), [(0.0, math.sqrt(2) * 0.1), (2.0, 2.0)])
def test_under_a_wide_ceiling_the_scale_of_change_is_its_height_times_root_two(near_to: float, expected: float) -> None:
    """The mean of 1 / d^2 over what is seen, by the cosine, is 1 / (2 h^2); of what is nearer than it may be, that."""
    ceiling = mesh_of("Ceiling", [quad((-18, -18, 0.1), (0, 40, 0), (40, 0, 0))], [0])
    texels = floor(ceiling)
    rays, _ = rays_of(texels, 1, sky=1, near_to=near_to)
    middle = np.linalg.norm(texels.position + texels.surfaces.origin - [2, 2, 0], axis=1).argmin(keepdims=True)
    scale, _, _ = finish(rays.look(middle, np.zeros(1, bool)))
    assert scale[0] == pytest.approx(expected, rel=0.01)


# the whole of it: an emitter of half the scene's surface is not a lamp, and only the gather's rays find it


@pytest.mark.parametrize(
    ("receiver", "emitter", "form_factor"),
    [
        (quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), quad((0, 0, 1), (0, 1, 0), (1, 0, 0)), 0.1998249),
        (quad((0, 0, 0), (2, 0, 0), (0, 2, 0)), quad((0, 0, 1), (0, 2, 0), (2, 0, 0)), 0.4152533),
        (quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), quad((0, 0, 0), (0, 1, 0), (0, 0, 1)), 0.2000438),
    ],
    ids=["squares 1 m apart", "squares half as far", "squares at a right angle"],
)
def test_the_gather_reads_the_form_factor_between_squares(receiver, emitter, form_factor) -> None:
    """H / pi of a black receiver is the emitter's radiance times F."""
    scene = Scene(
        (mesh_of("Receiver", [receiver], [0]), mesh_of("Emitter", [emitter], [1])),
        (Material("Black", (0, 0, 0)), Material("Glow", (0, 0, 0), (1, 1, 1))),
    )
    baked = finish(bake(scene, BakeSettings(page_size=128, quality="high")))
    texels = finish(rasterize(baked.atlas, flatten(scene), 1))
    light = baked.pages[0].reshape(-1, 3)[texels.pixel, 0].astype(np.float64)
    mine = texels.surfaces.mesh[texels.triangle[:]] == 0
    assert np.average(light[mine], weights=texels.area[mine]) == pytest.approx(form_factor, rel=0.01)
