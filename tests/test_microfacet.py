# SPDX-License-Identifier: GPL-3.0-or-later
"""Albedos of rough mirrors that are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from radiosity_addon.microfacet import (
    FRESNEL_STEPS,
    dielectric_fresnel,
    dielectric_gloss,
    facets_towards,
    glossy_albedo,
    metal_fresnel,
    metal_gloss,
)
from radiosity_addon.sampling import cosine_directions, even_uniform

WHITE = np.ones(3)


@pytest.mark.parametrize(("ior", "albedo"), [(1.5, 0.09178), (1.3333, 0.06645)])
def test_a_smooth_dielectric_reflects_the_mean_of_fresnels_equations(ior, albedo):
    """Diffuse Fresnel reflectance by the closed form of Walsh (1926)."""
    assert glossy_albedo(0.0, dielectric_fresnel(ior, WHITE)) == pytest.approx([albedo] * 3, abs=2e-4)


@pytest.mark.parametrize("roughness", [0.0, 0.3, 0.7, 1.0])
def test_a_white_mirror_gives_everything_back_at_any_roughness(roughness):
    assert glossy_albedo(roughness, metal_fresnel(WHITE, WHITE)) == pytest.approx([1, 1, 1], abs=1e-9)


def test_without_multiple_scattering_a_rough_mirror_loses_light_and_a_smooth_one_none():
    losses = [1 - glossy_albedo(r, metal_fresnel(WHITE, WHITE), multiscatter=False)[0] for r in (0.05, 0.5, 1.0)]
    assert losses[0] < 1e-4
    assert losses == sorted(losses)
    assert losses[2] > 0.4


def test_a_smooth_metals_albedo_is_schlicks_mean():
    """The mean of f + (1 - f)(1 - c)^5 over the projected hemisphere is f + (1 - f) / 21."""
    color = np.array([0.2, 0.5, 0.9])
    assert glossy_albedo(0.0, metal_fresnel(color, WHITE)) == pytest.approx(color + (1 - color) / 21, abs=1e-4)


def test_a_metal_meets_its_edge_tint_at_82_degrees():
    color, tint = np.array([0.2, 0.5, 0.9]), np.array([0.5, 0.1, 1.0])
    cosine = np.array([1 / 7])
    schlick = color + (1 - color) * (6 / 7) ** 5
    assert metal_fresnel(color, tint)(cosine)[0] == pytest.approx(schlick * tint)


def test_matter_of_index_one_reflects_nothing():
    assert glossy_albedo(0.5, dielectric_fresnel(1.0, WHITE)) == pytest.approx([0, 0, 0], abs=1e-9)


@pytest.mark.parametrize(
    "gloss", [dielectric_gloss(0.6, 1.5), metal_gloss(0.5, (0.9, 0.6, 0.3))], ids=["glaze", "copper"]
)
def test_what_facets_send_each_way_adds_up_to_their_albedo(gloss):
    """Means over light and eye by the cosine, of pi times the distribution; the albedo comes from visible normals."""
    count = 1 << 16
    ids, rays = np.zeros(count, np.int64), np.arange(count)
    up = np.tile(np.float32([0, 0, 1]), (count, 1))
    one, two, three, four = (even_uniform(ids, rays, dimension) for dimension in range(4))
    width = np.full(count, gloss.width, np.float32)
    share, cosine = facets_towards(width, up, cosine_directions(up, one, two), cosine_directions(up, three, four))
    fresnel = np.array(gloss.fresnel)
    found = [np.mean(np.pi * share * np.interp(cosine * FRESNEL_STEPS, range(FRESNEL_STEPS + 1), f)) for f in fresnel.T]
    assert found == pytest.approx(gloss.albedo, rel=0.02)  # grazing ones are rare and bright: these samples err 1 %
