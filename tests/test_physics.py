# SPDX-License-Identifier: GPL-3.0-or-later
"""What physics says about light between patches: traced transport and solver together."""

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.radiosity.solvers import progressive
from radiosity_addon.sampling import cosine_directions
from tests.rooms import Facets, box, joined, rectangle, sphere

TIGHT = 1e-9


def solved(patches: Facets, exitance: np.ndarray, rays: int = 128, tolerance: float = TIGHT):
    """The solution for exitance (N,) or (N, 3), one light group."""
    columns = np.broadcast_to(exitance.reshape(patches.count, -1), (patches.count, 3))
    return finish(progressive(patches.transport(rays), patches, columns[:, None], tolerance))


@pytest.mark.parametrize("reflectance, expected", [(0.5, 2.0), (0.9, 10.0)])
@pytest.mark.parametrize("make", [lambda **given: box((3, 2, 1), 5, **given), lambda **given: sphere(6, **given)])
def test_furnace(make, reflectance, expected):
    """Closed, E and rho uniform: B = E / (1 - rho) everywhere."""
    room = make(reflectance=reflectance)
    radiosity = solved(room, np.ones(room.count), rays=64).radiosity
    assert np.abs(radiosity / expected - 1).max() < 1e-5


def test_sphere_with_varying_emission_and_reflectance_is_evenly_lit():
    """Each point of a sphere sees every other alike: H = sum(A E) / sum(A (1 - rho)) everywhere."""
    room = sphere(10)
    x, y, z = room.origin.T
    room.reflectance = np.stack([0.5 + 0.07 * x, 0.5 - 0.07 * y, 0.5 + 0.14 * x * y], axis=1)
    emission = 1 + z / 7
    irradiance = solved(room, emission, rays=4096).irradiance[:, 0]
    expected = (room.area * emission).sum() / (room.area[:, None] * (1 - room.reflectance)).sum(0)
    assert np.abs(irradiance / expected - 1).max() < 0.003


def test_integrating_sphere_of_100_w():
    """R = 1 m, rho = 0.5, the lamp in the middle: radiance 100 / (4 pi^2) rho / (1 - rho) = 2.5330."""
    room = sphere(24, reflectance=0.5)
    direct = 100 / (4 * np.pi) * np.ones(room.count)
    radiance = solved(room, 0.5 * direct, rays=64).radiosity[:, 0, 0] / np.pi
    assert np.abs(radiance / 2.5330 - 1).max() < 0.01


def test_integrating_sphere_hides_where_its_lamp_shines():
    """All 100 W on one spot: every other place has the radiance rho / pi * P rho / (4 pi (1 - rho)) = 1.2665."""
    room = sphere(12, reflectance=0.5)
    spot = room.origin[:, 2] > 0.9
    exitance = np.where(spot, 0.5 * 100 / room.area[spot].sum(), 0)
    radiance = solved(room, exitance, rays=2048).radiosity[:, 0, 0] / np.pi
    means = [
        radiance[part & ~spot].mean() for part in (room.origin[:, 0] > 0, room.origin[:, 0] < 0, room.origin[:, 2] < 0)
    ]
    assert means == pytest.approx([1.2665] * 3, rel=0.01)


def corner_room() -> Facets:
    """A box without its ceiling, and a screen in it that faces both ways."""
    room = box((2, 1, 1), 4)
    walls = np.r_[0:16, 32:96]
    x, y, z, gap = (1, 0, 0), (0, 0.6, 0), (0, 0, 0.7), (1.0002, 0, 0)  # coincident faces would hide each other
    screen = rectangle(x, z, y, 2), rectangle(gap, y, z, 2)
    facets = joined((room.origin[walls], room.edge_u[walls], room.edge_v[walls]), *screen)
    return Facets(*facets, reflectance=(0.8, 0.5, 0.3))


def test_light_is_linear_in_power():
    room = corner_room()
    emission = np.random.default_rng(6).random((room.count, 3))
    once, often = (solved(room, k * emission, tolerance=1e-3).radiosity for k in (1, 1000))
    assert often == pytest.approx(1000 * once, rel=1e-5)


def test_lamps_superpose():
    room = corner_room()
    first, second = np.random.default_rng(7).random((2, room.count, 3)) ** 8
    both = solved(room, first + second).radiosity
    assert both == pytest.approx(solved(room, first).radiosity + solved(room, second).radiosity, rel=1e-5)


def test_lamp_and_receiver_may_trade_places():
    """Reciprocity of the solution: with equal reflectance, A_j B_j of light from i equals A_i B_i of light from j."""
    room = corner_room()
    transport = room.transport(64)
    pair = 3, 70
    exitance = np.zeros((room.count, 2, 3))
    exitance[pair[0], 0] = exitance[pair[1], 1] = 1
    radiosity = finish(progressive(transport, room, exitance, TIGHT)).radiosity
    there = radiosity[pair[1], 0] * room.area[pair[1]]
    back = radiosity[pair[0], 1] * room.area[pair[0]]
    assert there == pytest.approx(back, rel=1e-6)
    assert there.min() > 0


def test_light_that_escapes_and_is_absorbed_agrees_with_traced_photons():
    """Random walks from the lamp know nothing of patches, balancing or solvers."""
    room = corner_room()
    emission = np.zeros(room.count)
    emission[:8] = 1
    balance = solved(room, emission, rays=4096).balance
    walks, reflectance = 200_000, 0.5  # the green channel
    rng = np.random.default_rng(8)
    bvh = Visibility(room.corners())
    at = rng.integers(0, 8, walks)
    gone = inside = 0
    while len(at):
        u, v, disc, turn = rng.random((4, len(at)), dtype=np.float32)
        about = room.normal[at]
        places = (
            room.origin[at] + u[:, None] * room.edge_u[at] + v[:, None] * room.edge_v[at] + np.float32(2e-5) * about
        )
        met = room.at(bvh.first_hit(places, cosine_directions(about, disc, turn)))
        gone += (met == -1).sum()
        inside += (met < -1).sum()
        met = met[met >= 0]
        at = met[rng.random(len(met)) < reflectance]
    assert inside < 1e-3 * walks
    share = gone / walks
    sigma = np.sqrt(share * (1 - share) / walks)
    assert 0.1 < share < 0.9
    assert balance.escaped[0, 1] / balance.emitted[0, 1] == pytest.approx(share, abs=3 * sigma)
    assert balance.absorbed[0, 1] / balance.emitted[0, 1] == pytest.approx(1 - share, abs=3 * sigma)
