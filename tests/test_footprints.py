# SPDX-License-Identifier: GPL-3.0-or-later
"""What is kept of texels says where each of their strata lies, whole on a triangle or not."""

from copy import deepcopy

import numpy as np

from radiosity_addon.chunks import finish
from radiosity_addon.estimate import BYTES_PER_TEXEL
from radiosity_addon.geometry.by_triangle import ByTriangle
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import STRATA, Texels, rasterize
from radiosity_addon.scene import Material, Scene
from tests.shapes import cell_atlas, mesh_of, quad, sphere


def texels_of(*meshes) -> Texels:
    scene = Scene(meshes, (Material("Grey"),))
    return finish(rasterize(cell_atlas(scene, 256, margin=2), flatten(scene)))


def ball() -> Texels:
    return texels_of(sphere("Ball", radius=2.0))


def test_of_texels_whole_on_a_triangle_only_that_is_kept():
    texels = texels_of(mesh_of("Floor", [quad((0, 0, 0), (7, 0, 0), (0, 7, 0))], [0]))
    footprints = texels.footprints
    triangle, _ = footprints.strata(np.arange(texels.count))
    whole = (texels.covered == 15) & (triangle == triangle[:, :1]).all(1)
    assert np.array_equal(footprints.seat >= 0, whole)
    assert len(footprints.triangle) == np.count_nonzero(~whole) < 0.1 * texels.count


def test_points_of_strata_are_those_of_their_barycentrics():
    texels = ball()
    ids, slot = np.repeat(np.arange(texels.count), STRATA), np.tile(np.arange(STRATA), texels.count)
    for chosen in (slice(None), texels.footprints.seat[ids] >= 0, texels.footprints.seat[ids] < 0):
        points, triangle = texels.footprints.points(ids[chosen], slot[chosen])
        own, weights = texels.footprints.at(ids[chosen], slot[chosen])
        assert np.array_equal(triangle, own)
        assert np.abs(points - texels.surfaces.points(own, weights)).max() < 2e-6


def test_strata_that_are_put_are_found_again_and_others_stay():
    texels = ball()
    changed = np.flatnonzero(np.arange(texels.count) % 3 == 0)  # of both kinds
    before = texels.footprints.strata(np.arange(texels.count))
    footprints = deepcopy(texels.footprints)
    triangle, weights = before[0][changed][:, ::-1], before[1][changed][:, ::-1]
    footprints.put(changed, triangle, weights)
    after = footprints.strata(np.arange(texels.count))
    others = np.setdiff1d(np.arange(texels.count), changed)
    for old, new, put in zip(before, after, (triangle, weights), strict=True):
        assert np.array_equal(new[changed], put)
        assert np.array_equal(new[others], old[others])
    assert np.array_equal(footprints.first(slice(None)), after[0][:, 0])


def test_values_of_triangles_read_as_an_array_over_texels():
    texels = ball()
    values = np.random.default_rng(0).random((texels.surfaces.count, 3)).astype(np.float32)
    read = ByTriangle(values, texels.footprints)
    array = values[texels.triangle[:]]
    chosen = np.arange(0, texels.count, 7)
    assert np.array_equal(read[:], array)
    assert np.array_equal(read[5:9], array[5:9])
    assert np.array_equal(read[chosen, 1], array[chosen, 1])
    assert np.array_equal(read[chosen, None], array[chosen, None]), "a new axis behind the texels"
    assert np.array_equal(read.take(chosen, axis=0), array[chosen])
    assert np.array_equal((2.0 * read)[chosen], 2 * array[chosen])
    assert np.array_equal(np.asarray(read), array)
    assert len(read) == len(array)


def bytes_of(record: object) -> int:
    """Of the arrays that a record holds itself."""
    return sum(value.nbytes for value in vars(record).values() if isinstance(value, np.ndarray))


def test_a_texel_of_a_flat_surface_takes_less_than_half_of_what_a_bake_needs_for_it():
    texels = texels_of(mesh_of("Floor", [quad((0, 0, 0), (7, 0, 0), (0, 7, 0))], [0]))
    rows = len(texels.footprints.triangle)
    own = bytes_of(texels) + bytes_of(texels.footprints) - texels.pixel.nbytes  # which both of them name
    assert own - 48 * rows < 48 * texels.count < BYTES_PER_TEXEL / 2 * texels.count
