# SPDX-License-Identifier: GPL-3.0-or-later
"""The error that a bake reports of itself, against errors that are known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from radiosity_addon import bake as baking
from radiosity_addon.bake import Baked
from radiosity_addon.chunks import finish
from radiosity_addon.gather.own_error import OwnError, own_error
from radiosity_addon.scene import AreaLight, Material, PointLight, Scene
from tests.bakes import bake_of
from tests.shapes import box, sphere

LAMP = AreaLight("lamp", (4.0,) * 3, (0, 0, 0.99), (0.6, 0, 0), (0, 0.6, 0), (0, 0, -1))


def room(*lights: AreaLight | PointLight) -> Scene:
    """A grey room with a box in it."""
    meshes = (box("room", (-1, -1, -1), (1, 1, 1), inward=True), box("box", (-0.6, -0.3, -1), (0, 0.3, -0.2)))
    return Scene(meshes, (Material("Grey", (0.6,) * 3),), lights or (LAMP,))


@cache
def parts() -> dict[str, Any]:
    """What a bake of the room hands to its check."""
    names = ("texels", "patches", "light", "lamps", "direct", "indirect", "counted", "wanted", "visibility", "workers")
    kept: list[tuple[Any, ...]] = []

    def keep(*given: Any) -> Any:
        kept.append(given)
        parts = dict(zip(names, given, strict=True))
        direct, indirect = parts["direct"].copy(), parts["indirect"].copy()  # a bake adds one to the other
        kept[0] = (
            *(
                parts | {"direct": direct, "indirect": indirect, "light": replace(parts["light"], direct=direct)}
            ).values(),
        )
        return own_error(*given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(baking, "own_error", keep)
        bake_of(room(), page_size=128, quality="medium", threads=1)
    return dict(zip(names, kept[0], strict=True))


def found(**changes: Any) -> OwnError:
    error = finish(own_error(**{**parts(), **changes}))
    assert error is not None
    return error


def shares_of(light: np.ndarray) -> np.ndarray:
    """What the errors of texels with that light (P,) are told as shares of."""
    return np.maximum(light, np.quantile(light, 0.1))


def lit() -> tuple[np.ndarray, np.ndarray]:
    """Irradiance (P,) of the room's texels, and the part of it that comes from other surfaces."""
    taken = parts()["wanted"] & parts()["texels"].valid & (parts()["texels"].area > 0)
    direct, indirect = (parts()[name][taken].mean((1, 2)) for name in ("direct", "indirect"))
    return direct + indirect, indirect


def test_a_scatter_that_was_added_is_found() -> None:
    level = float(np.quantile(lit()[0], 0.1))
    added = np.random.default_rng(1).normal(0, 0.2 * level, parts()["direct"].shape[:1]).astype(np.float32)
    true = np.sqrt(np.mean((0.2 * level / shares_of(lit()[0])) ** 2))
    assert found(direct=parts()["direct"] + added[:, None, None]).rms == pytest.approx(true, rel=0.25)


@pytest.mark.parametrize("share", [-0.1, 0.1])
def test_an_error_that_all_texels_share_is_found_with_what_its_bounces_add(share: float) -> None:
    light, indirect = lit()
    error = found(indirect=parts()["indirect"] * np.float32(1 + share))
    own = found().bias  # the bake's, before anything was done to it
    assert abs(own) < 0.015
    assert error.bias - own == pytest.approx(share * float(np.mean(indirect / shares_of(light))), rel=0.25)


def true_error(baked: Baked, truth: np.ndarray) -> float:
    """Root mean square error of a bake, texel by texel, as shares of the `truth` (T,), H / pi."""
    elements = baked.elements
    page = np.concatenate([part.reshape(-1, 3) for part in baked.pages]).mean(1)
    taken = np.flatnonzero(elements.valid & (elements.area > 0))
    return float(np.sqrt(np.mean(((page[elements.pixel] - truth)[taken] / shares_of(truth[taken])) ** 2)))


@pytest.mark.parametrize("lights", [(LAMP,), (PointLight("point", (1.0,) * 3, (0.5, 0.5, 0.7), 0.1),)])
def test_the_error_is_told_within_half_of_it(lights: tuple[AreaLight | PointLight, ...]) -> None:
    draft = bake_of(room(*lights), page_size=128)
    fine = bake_of(room(*lights), page_size=128, quality="high")
    elements = fine.elements
    truth = np.concatenate([part.reshape(-1, 3) for part in fine.pages]).mean(1)[elements.pixel]
    true = true_error(draft, truth)
    assert draft.error is not None
    assert true / 1.5 < draft.error.rms < true * 1.5


def test_the_error_against_a_closed_form_is_told_within_half_of_it() -> None:
    """Within a sphere that glows unevenly all get the same light: H = sum(A E) / sum(A (1 - rho))."""
    ball = sphere("ball", 1.0, 48, 24, inward=True)
    half = ball.vertices[ball.triangles].mean(1)[:, 2] > 0
    ball = replace(ball, material=half.astype(np.int32))
    glow = Material("Glow", (0.5,) * 3, (1.0,) * 3)
    baked = bake_of(Scene((ball,), (Material("Grey", (0.5,) * 3), glow)), page_size=128)
    assert baked.error is not None
    true = true_error(baked, np.ones(baked.elements.count))
    assert true / 1.5 < baked.error.rms < true * 1.5


def test_a_check_takes_few_rays_and_no_thread_changes_it() -> None:
    baked = bake_of(room(), page_size=256, quality="medium", threads=2)
    rays = {stage.name: stage.rays for stage in baked.stages}
    assert rays["Check"] < 0.05 * baked.rays
    assert baked.error == bake_of(room(), page_size=256, quality="medium", threads=1).error


def test_a_dark_scene_has_no_error() -> None:
    assert bake_of(Scene(room().meshes, room().materials)).error is None
