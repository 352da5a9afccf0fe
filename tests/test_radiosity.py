# SPDX-License-Identifier: GPL-3.0-or-later
"""The solvers: worked examples, agreement with elimination, the order of shots, and where the energy goes."""

from dataclasses import replace
from itertools import islice
from types import SimpleNamespace

import numpy as np
import pytest

from radiosity_addon.chunks import finish
from radiosity_addon.errors import SettingsError
from radiosity_addon.radiosity.relaxation import Refinement, Solution, SolverState
from radiosity_addon.radiosity.solvers import (
    MOST_DENSE,
    SHOOTING_SHARE,
    SOLVERS,
    dense,
    jacobi,
    overshooting,
    progressive,
    southwell,
)
from radiosity_addon.radiosity.transport import Transport
from tests.rooms import box

TIGHT = 1e-10


def transport_of(area, form_factors) -> Transport:
    """A full Transport from a matrix of form factors, reciprocal as given."""
    area, matrix = np.array(area, float), np.array(area, float)[:, None] * np.array(form_factors, float)
    count = len(area)
    first = np.arange(count + 1) * count
    column = np.tile(np.arange(count, dtype=np.int32), count)
    exchange = matrix.reshape(-1).astype(np.float32)
    escaped = 1 - exchange.astype(float).reshape(count, count).sum(1) / area
    return Transport(area, first, column, exchange, escaped, escaped, np.ones(count, int))


def surfaces(*reflectance) -> SimpleNamespace:
    """Patches as the solvers see them; each reflectance a number or a triple."""
    return SimpleNamespace(reflectance=np.float32([np.broadcast_to(r, 3) for r in reflectance]))


def lit(*exitance, groups: int = 1) -> np.ndarray:
    return np.repeat(np.array([np.broadcast_to(e, 3) for e in exitance], float)[:, None], groups, axis=1)


def room(cuts: int = 3, reflectance=(0.7, 0.5, 0.2)):
    """A box with a coloured lamp on its floor and a weaker one on a wall, each a light group."""
    patches = box((3, 2, 1), cuts, reflectance=reflectance)
    exitance = np.zeros((patches.count, 2, 3))
    exitance[1, 0] = 3, 2, 1
    exitance[-2, 1] = 0.001, 0, 0.002
    return patches, patches.transport(64), exitance


def followed(steps: Refinement) -> tuple[list[tuple[np.ndarray, SolverState]], Solution]:
    """Each state with a copy of its unshot light, and the solution."""
    states = []
    while True:
        try:
            state = next(steps)
        except StopIteration as stop:
            return states, stop.value
        states.append((state.unshot.copy(), state))


def test_two_patches_of_the_lecture_reach_their_fixed_point():
    """rho = 0.5, E = (0, 0.8), F = (cos 30 - cos 60) / 2 = 0.183: B = (0.0738, 0.8068)."""
    form_factor = (np.cos(np.pi / 6) - np.cos(np.pi / 3)) / 2
    transport = transport_of([1, 1], [[0, form_factor], [form_factor, 0]])
    for solver in (progressive, southwell):
        solution = finish(solver(transport, surfaces(0.5, 0.5), lit(0, 0.8), TIGHT))
        assert solution.radiosity[:, 0, 0] == pytest.approx([0.0738, 0.8068], abs=5e-5)


def test_light_received_grows_with_the_inverse_ratio_of_areas():
    """The slip of the lecture notes: dB_j = rho_j dB_i F_ij A_i / A_j, so 4 m2 light 1 m2 by F_ij * 4."""
    transport = transport_of([4, 1], [[0, 0.1], [0.4, 0]])
    solution = finish(progressive(transport, surfaces(0, 0.5), lit(1, 0), TIGHT))
    assert solution.radiosity[1, 0, 0] == pytest.approx(0.5 * 0.1 * 4 / 1)


def stained(transport: Transport) -> Transport:
    """The same with coloured glass between some patches, symmetric as light is."""
    row = np.repeat(np.arange(transport.count), np.diff(transport.first))
    share = np.random.default_rng(5).random((3, transport.count))
    tint = (share[:, row] + share[:, transport.column]) / 2
    return replace(transport, tint=(tint / tint.mean(0) * 0.9).astype(np.float32))


def exact(transport: Transport, patches, exitance: np.ndarray) -> np.ndarray:
    """Radiosity (N, G, 3) by NumPy's elimination, the equation written out once more."""
    found = np.empty(exitance.shape)
    for channel in range(3):
        form_factors = transport.dense(channel) / transport.area[:, None]
        matrix = np.eye(transport.count) - patches.reflectance[:, channel, None].astype(float) * form_factors
        found[:, :, channel] = np.linalg.solve(matrix, exitance[:, :, channel])
    return found


@pytest.mark.parametrize("glass", [False, True], ids=["clear", "stained"])
@pytest.mark.parametrize("name", SOLVERS)
def test_solvers_agree_with_elimination(name, glass):
    patches, transport, exitance = room()
    transport = stained(transport) if glass else transport
    solution = finish(SOLVERS[name](transport, patches, exitance, 1e-9))
    assert solution.converged
    assert solution.radiosity == pytest.approx(exact(transport, patches, exitance), rel=1e-6)
    assert solution.radiosity == pytest.approx(exitance + patches.reflectance[:, None] * solution.irradiance)


ONE_BY_ONE = ("southwell", "overshooting", "gauss-seidel")
"""Solvers that take patches one by one: minutes for 2,000 of them, which is what benchmarks/solvers.py is for."""


@pytest.fixture(scope="module", params=["colours", "bright and open"])
def large_rooms(request):
    """A box, or one of reflectance 0.95 that lacks some walls, large and small: transport, elimination's answer."""

    def made(cuts):
        open_to = request.param == "bright and open"
        patches = box((3, 2, 1), cuts, reflectance=np.float32([0.95, 0.9, 0.0] if open_to else [0.7, 0.5, 0.2]))
        kept = np.arange(patches.count) < patches.count * (0.92 if open_to else 1)
        full = patches.transport(64).dense() * kept * kept[:, None]
        transport = transport_of(patches.area, full / patches.area[:, None])
        exitance = np.zeros((patches.count, 1, 3))
        exitance[patches.count // 4 : patches.count // 4 + 20] = 3, 2, 1
        return patches, transport, exitance, exact(transport, patches, exitance)

    large = 19 if request.param == "colours" else 11
    return {False: made(large), True: made(7)}


@pytest.mark.parametrize("name", SOLVERS)
def test_solvers_agree_on_large_rooms(large_rooms, name):
    """2,166 patches, 726 of the slower room; 294 for those that take them one by one."""
    patches, transport, exitance, expected = large_rooms[name in ONE_BY_ONE]
    solution = finish(SOLVERS[name](transport, patches, exitance, 1e-8))
    assert solution.converged
    assert np.abs(solution.radiosity - expected).max() < 1e-6 * expected.mean()


@pytest.mark.parametrize("glass", [False, True], ids=["clear", "stained"])
@pytest.mark.parametrize("name", SOLVERS)
def test_the_books_balance_after_every_step(name, glass):
    """An open room with mirrors of light and black walls: emitted = unshot + absorbed + escaped."""
    patches = box((1, 1, 1), 3, reflectance=(0.9, 0.5, 0.0))
    transport = transport_of(patches.area, patches.transport(64).dense() / patches.area[:, None] * 0.9)
    transport = stained(transport) if glass else transport
    exitance = np.random.default_rng(3).random((patches.count, 2, 3))
    states, solution = followed(SOLVERS[name](transport, patches, exitance, 1e-8))
    assert states
    assert max(state.balance.error for _, state in states) < 1e-10
    assert solution.balance.escaped.min() > 0


def test_unshot_light_is_what_the_equation_lacks():
    """For each solver on its way: unshot = E + rho F shot - shot, and radiosity = shot + unshot."""
    patches, transport, exitance = room()
    form_factors = transport.dense() / transport.area[:, None]
    for solver in SOLVERS.values():
        for state in islice(solver(transport, patches, exitance, 1e-4), 3):
            shot = exitance + patches.reflectance[:, None] * state.irradiance - state.unshot
            received = np.einsum("ij,jgc->igc", form_factors, shot)
            gap = exitance + patches.reflectance[:, None] * received - shot - state.unshot
            assert np.abs(gap).max() < 1e-9 * np.abs(exitance).max()


def test_conjugate_gradients_need_fewest_steps_in_a_bright_room():
    patches, transport, exitance = room(2, reflectance=0.99)
    names = ("dense", "conjugate-gradient", "gauss-seidel", "jacobi")
    steps = {name: len(finish(SOLVERS[name](transport, patches, exitance, 1e-4)).residuals) - 1 for name in names}
    assert steps["dense"] <= 2
    assert 5 * steps["conjugate-gradient"] < steps["gauss-seidel"] < steps["jacobi"]


def test_overshooting_takes_fewer_shots_in_a_bright_room():
    patches, transport, exitance = room(reflectance=0.9)
    shots = [finish(solver(transport, patches, exitance, 1e-3)).shots for solver in (southwell, overshooting)]
    assert shots[1] < 0.7 * shots[0]


def test_a_matrix_that_is_too_large_is_refused():
    count = MOST_DENSE + 1
    transport = SimpleNamespace(count=count, area=np.ones(count), losses=np.zeros((count, 1)))
    patches = SimpleNamespace(reflectance=np.zeros((count, 3), np.float32))
    with pytest.raises(SettingsError, match="too large"):
        finish(dense(transport, patches, np.zeros((count, 1, 3))))


def test_step_k_of_jacobi_holds_the_first_k_bounces():
    patches, transport, exitance = room()
    form_factors = transport.dense() / transport.area[:, None]
    partial = light = exitance
    for state in jacobi(transport, patches, exitance, 0, 4):
        light = patches.reflectance[:, None] * np.einsum("ij,jgc->igc", form_factors, light)
        partial = partial + light
        assert state.radiosity == pytest.approx(partial, rel=1e-9)


def test_every_patch_above_the_threshold_shoots_and_none_below():
    patches, transport, exitance = room()
    states, solution = followed(progressive(transport, patches, exitance[:, :1], 1e-6))
    assert len(states) > 5
    before, threshold = exitance[:, :1], np.inf
    emitted = (transport.area[:, None, None] * before).sum()
    for unshot, state in states:
        power = (transport.area[:, None, None] * before).sum((1, 2)) / emitted
        threshold = min(threshold, SHOOTING_SHARE * power.max())
        assert list(state.shooters) == list(np.flatnonzero(power >= threshold * (1 - 1e-12)))
        before = unshot
    assert solution.shots == sum(len(state.shooters) for _, state in states)


def test_southwell_shoots_the_patch_with_the_most_unshot_power():
    patches, transport, exitance = room()
    before = exitance[:, :1]
    states, _ = followed(southwell(transport, patches, before, 1e-3))
    assert len(states) > 5
    for unshot, state in states:
        assert list(state.shooters) == [(transport.area[:, None, None] * before).sum((1, 2)).argmax()]
        before = unshot


@pytest.mark.parametrize("solver", [progressive, southwell])
def test_energy_is_accounted_for_at_every_step(solver):
    patches = box((1, 1, 1), 3, reflectance=(0.9, 0.5, 0.1))
    open_side = np.arange(patches.count) >= 9
    transport = transport_of(patches.area, patches.transport(64).dense() / patches.area[:, None] * 0.9)
    exitance = np.random.default_rng(3).random((patches.count, 2, 3)) * open_side[:, None, None]
    errors = [state.balance.error for state in solver(transport, patches, exitance, 1e-4)]
    assert len(errors) > 10
    assert max(errors) < 1e-10


def test_balance_notices_light_that_is_missing():
    patches, transport, exitance = room()
    leaking = replace(transport, exchange=transport.exchange * 0.99)
    assert finish(progressive(leaking, patches, exitance)).balance.error > 1e-3


@pytest.mark.parametrize("solver", [progressive, southwell])
def test_unshot_power_falls_at_every_step(solver):
    patches, transport, exitance = room()
    states, _ = followed(solver(transport, patches, exitance, 1e-4))
    area = transport.area[:, None, None]
    totals = [(area * exitance).sum(), *((area * unshot).sum() for unshot, _ in states)]
    assert (np.diff(totals) < 0).all()


def test_residual_is_the_unshot_share_of_the_emitted_power():
    patches, transport, exitance = room()
    solution = finish(progressive(transport, patches, exitance, 1e-3))
    area = transport.area[:, None, None]
    shares = (area * solution.unshot).sum((0, 2)) / (area * exitance).sum((0, 2))
    assert solution.residuals[0] == pytest.approx(1)
    assert solution.residuals[-1] == pytest.approx(shares.max())
    assert solution.residuals[-1] <= 1e-3 < solution.residuals[-2]


def test_light_groups_add_up_to_all_lamps_at_once():
    patches, transport, exitance = room()
    apart = finish(progressive(transport, patches, exitance, 1e-8)).radiosity.sum(1)
    together = finish(progressive(transport, patches, exitance.sum(1, keepdims=True), 1e-8)).radiosity[:, 0]
    assert apart == pytest.approx(together, rel=1e-5)


def test_strength_of_a_group_scales_its_light_and_nothing_else():
    """Even at a loose tolerance: the order of shots does not depend on strengths."""
    patches, transport, exitance = room()
    plain = finish(progressive(transport, patches, exitance, 1e-2))
    scaled = finish(progressive(transport, patches, exitance * np.array([1, 1000])[:, None], 1e-2))
    assert scaled.shots == plain.shots
    assert scaled.radiosity[:, 0] == pytest.approx(plain.radiosity[:, 0], rel=1e-12)
    assert scaled.radiosity[:, 1] == pytest.approx(plain.radiosity[:, 1] * 1000, rel=1e-12)


def test_a_white_room_that_takes_too_long_says_so():
    patches, transport, exitance = room(reflectance=0.99)
    solution = finish(progressive(transport, patches, exitance, 1e-6, most_steps=50))
    assert not solution.converged
    assert len(solution.residuals) == 51
    assert solution.residuals[-1] == pytest.approx(0.99**50, rel=0.1)


def test_nothing_is_shot_in_the_dark():
    patches, transport, exitance = room()
    solution = finish(progressive(transport, patches, exitance * 0))
    assert solution.shots == 0
    assert solution.converged
    assert not solution.radiosity.any()


def test_a_dark_light_group_stays_dark_beside_a_lit_one():
    patches, transport, exitance = room()
    exitance[:, 1] = 0
    solution = finish(progressive(transport, patches, exitance))
    assert solution.converged
    assert solution.radiosity[:, 0].all()
    assert not solution.radiosity[:, 1].any()


def test_negative_light_is_the_mirror_of_positive_light():
    patches, transport, exitance = room()
    positive, negative = (finish(progressive(transport, patches, sign * exitance)) for sign in (1, -1))
    assert np.array_equal(negative.radiosity, -positive.radiosity)


def test_preview_with_ambient_light_is_exact_where_light_is_even():
    """A uniform closed room: one step and the ambient guess give E / (1 - rho)."""
    patches = box((1, 1, 1), 2, reflectance=0.5)
    transport = patches.transport(64)
    state = next(progressive(transport, patches, np.ones((patches.count, 1, 3))))
    assert state.with_ambient == pytest.approx(np.full((patches.count, 1, 3), 2.0), rel=1e-6)


def test_given_exitance_is_left_alone():
    patches, transport, exitance = room()
    kept = exitance.copy()
    finish(progressive(transport, patches, exitance))
    assert np.array_equal(exitance, kept)


def test_solution_is_the_same_for_any_number_of_threads():
    patches = box((3, 2, 1), 16, reflectance=0.6)
    exitance = np.random.default_rng(4).random((patches.count, 1, 3))
    one, two = (finish(progressive(patches.transport(256, n), patches, exitance)) for n in (1, 2))
    assert np.array_equal(one.radiosity, two.radiosity)
