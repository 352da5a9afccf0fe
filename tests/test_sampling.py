# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples: hashes that look independent, sequences that fill the cube evenly, directions after the cosine law."""

import numpy as np
import pytest

from radiosity_addon.sampling import DIMENSIONS, cosine_directions, even_rows, even_uniform, hash_bits, hash_uniform

IDS = np.arange(1 << 16)


def normals(count: int) -> np.ndarray:
    rng = np.random.default_rng(7)
    vectors = rng.normal(size=(count, 3))
    vectors[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


def test_hash_flips_half_of_the_bits_when_one_bit_of_the_id_flips():
    for bit in range(32):
        flipped = hash_bits(IDS) ^ hash_bits(IDS ^ (1 << bit))
        changed = np.unpackbits(flipped.view(np.uint8)).mean()
        assert abs(changed - 0.5) < 0.01


def test_hash_of_distinct_ids_is_distinct():
    assert len(np.unique(hash_bits(IDS))) == len(IDS)


def test_hashed_numbers_are_uniform_and_independent_between_dimensions():
    numbers = np.stack([hash_uniform(IDS, dimension) for dimension in range(4)])
    assert numbers.dtype == np.float32
    assert numbers.min() >= 0
    assert numbers.max() < 1
    counts = np.stack([np.bincount((row * 64).astype(int), minlength=64) for row in numbers])
    assert np.abs(counts - 1024).max() < 5 * np.sqrt(1024)
    assert np.abs(np.corrcoef(numbers) - np.eye(4)).max() < 0.02


@pytest.mark.parametrize("dimension", range(DIMENSIONS))
def test_samples_of_one_id_have_one_value_in_each_interval(dimension):
    values = even_uniform(np.full(256, 12345), np.arange(256), dimension)
    assert np.array_equal(np.sort((values * 256).astype(int)), np.arange(256))


@pytest.mark.parametrize("pair", [(0, 1), (2, 3)])
def test_pairs_of_dimensions_are_even_in_the_square(pair):
    """With 256 samples, 16 x 16 cells hold 256 / 256 = 1 each, up to one cell's neighbour."""
    ids = np.full(256, 99)
    x, y = (even_uniform(ids, np.arange(256), dimension) for dimension in pair)
    counts = np.bincount((x * 8).astype(int) * 8 + (y * 8).astype(int), minlength=64)
    assert np.array_equal(counts, np.full(64, 4))


def test_two_ids_get_different_points():
    sample = np.arange(64)
    first, second = (even_uniform(np.full(64, i), sample, 0) for i in (1, 2))
    assert np.abs(first - second).max() > 0.01


def test_rows_of_samples_and_directions_are_those_of_each_sample_alone():
    ids, sample = np.array([3, 99, 70000, 4, 5, 6]), np.arange(24)
    each, number = np.repeat(ids, len(sample)), np.tile(sample, len(ids))
    u, v = (even_rows(ids, len(sample), dimension) for dimension in (0, 1))
    assert np.array_equal(u.reshape(-1), even_uniform(each, number, 0))
    assert np.array_equal(even_rows(ids, 8, 0, np.full(6, 16)), u[:, 16:])
    alone = cosine_directions(np.repeat(normals(6), len(sample), axis=0), u.reshape(-1), v.reshape(-1))
    assert np.array_equal(cosine_directions(normals(6), u, v).reshape(-1, 3), alone)


def test_directions_are_unit_and_their_cosine_is_the_height_over_the_disc():
    about = normals(len(IDS))
    u, v = hash_uniform(IDS, 0), hash_uniform(IDS, 1)
    directions = cosine_directions(about, u, v)
    assert directions.dtype == np.float32
    assert np.abs(np.linalg.norm(directions, axis=1) - 1).max() < 1e-6
    assert np.abs(np.einsum("ij,ij->i", directions, about) - np.sqrt(1 - u)).max() < 1e-6


def test_directions_follow_the_cosine_law():
    """Their mean is 2/3 of the normal, their second moments are 1/2 along it and 1/4 across."""
    normal = np.float32([0.36, -0.48, 0.8])
    sample = np.arange(1 << 14)
    ids = np.zeros(len(sample), np.int64)
    directions = cosine_directions(
        np.tile(normal, (len(sample), 1)), even_uniform(ids, sample, 0), even_uniform(ids, sample, 1)
    )
    assert directions.mean(0) == pytest.approx(normal * 2 / 3, abs=1e-3)
    moments = directions.T.astype(float) @ directions / len(directions)
    assert moments == pytest.approx(np.eye(3) / 4 + np.outer(normal, normal) / 4, abs=1e-3)
