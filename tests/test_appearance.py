# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks that vary over surfaces: asked for where they do, brought within physics, read at the right texels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from radiosity_addon.arrays import Bools, Float32
from radiosity_addon.bake import Baked, bake
from radiosity_addon.chunks import finish
from radiosity_addon.geometry.appearance import Appearance, appearance_of
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.texels import Texels, rasterize
from radiosity_addon.scene import MAX_REFLECTANCE, Material, PointLight, Scene
from radiosity_addon.settings import BakeSettings
from radiosity_addon.shading import Layout, Quantity
from tests.shapes import box, cell_atlas, mesh_of, quad

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

PLAIN = Material("Plain", (0.3, 0.4, 0.5), (1.0, 0.0, 0.0))
PAINTED = Material("Painted", (0.6,) * 3, (2.0,) * 3, varies=frozenset({"reflectance", "emission"}))


@dataclass
class Pictures:
    """A shader that shows one value for each quantity, or what a function makes of the texels' uv, and remembers."""

    show: dict[Quantity, object]
    asked: list[tuple[Quantity, list[bool]]] = field(default_factory=list)

    def __call__(self, layout: Layout, meshes: Bools, quantity: Quantity) -> Float32:
        self.asked.append((quantity, meshes.tolist()))
        shown = self.show[quantity]
        if isinstance(shown, Callable):
            along = (np.arange(layout.size, dtype=np.float32) + 0.5) / layout.size
            v, u = np.meshgrid(along, along, indexing="ij")
            shown = np.broadcast_to(shown(u, v)[..., None], (layout.size, layout.size, 3))
        return np.broadcast_to(np.float32(shown), (layout.page_count, layout.size, layout.size, 3)).copy()


def two_squares(*materials: Material) -> Scene:
    squares = [quad((2 * k, 0, 0), (1, 0, 0), (0, 1, 0)) for k in range(2)]
    meshes = tuple(mesh_of(f"Square {k}", [square], k) for k, square in enumerate(squares))
    return Scene(meshes, materials)


def look_of(scene: Scene, shade: Pictures | None) -> tuple[Appearance, tuple[str, ...], Texels]:
    atlas = cell_atlas(scene, 32)
    texels = finish(rasterize(atlas, flatten(scene)))
    return (*finish(appearance_of(scene, atlas, texels, np.zeros(texels.surfaces.count, bool), shade)), texels)


def of_square(number: int, texels: Texels) -> Bools:
    return texels.surfaces.mesh[texels.triangle[:]] == number


def test_constants_never_call_the_shader():
    shade = Pictures({})
    look, warnings, texels = look_of(two_squares(PLAIN, replace(PLAIN, reflectance=(0.1,) * 3)), shade)
    assert shade.asked == []
    assert warnings == ()
    assert np.array_equal(look.reflectance[of_square(0, texels)][0], np.float32(PLAIN.reflectance))
    assert np.array_equal(np.unique(look.reflectance[of_square(1, texels)]), np.float32([0.1]))


def test_only_what_varies_is_asked_for_and_only_on_its_meshes():
    shade = Pictures({"emission": 7.0})
    look, _, texels = look_of(two_squares(PLAIN, replace(PAINTED, varies=frozenset({"emission"}))), shade)
    assert shade.asked == [("emission", [False, True])]
    assert np.unique(look.emission[of_square(1, texels)]).tolist() == [7]
    assert np.unique(look.emission[of_square(0, texels), 0]).tolist() == [1]
    assert np.array_equal(np.unique(look.reflectance[of_square(1, texels)]), np.float32([0.6]))


def test_a_picture_is_read_at_the_texels_own_place():
    shade = Pictures({"reflectance": lambda u, v: 0.1 + 0.5 * u + 0.25 * v, "emission": 0.0})
    look, _, texels = look_of(two_squares(PAINTED, PAINTED), shade)
    row, column = np.divmod(texels.pixel, texels.size)
    expected = 0.1 + 0.5 * (column + 0.5) / texels.size + 0.25 * (row + 0.5) / texels.size
    assert np.abs(look.reflectance - expected[:, None]).max() < 1e-6


@pytest.mark.parametrize(
    ("shown", "expected", "text"),
    [(1.5, MAX_REFLECTANCE, "limited to 0.999"), (-0.5, 0.0, "negative"), (np.nan, 0.0, "not a finite number")],
)
def test_reflectances_that_can_not_be_are_brought_into_range_and_named(shown, expected, text):
    shade = Pictures({"reflectance": shown, "emission": 0.0})
    look, warnings, texels = look_of(two_squares(PLAIN, PAINTED), shade)
    assert np.unique(look.reflectance[of_square(1, texels)]) == pytest.approx(expected)
    assert len(warnings) == 1
    assert warnings[0].startswith("Square 1: the reflectance of material 'Painted'")
    assert text in warnings[0]


def test_each_surface_is_told_how_much_it_reflects_itself():
    shade = Pictures({"reflectance": lambda u, v: np.where(u + 0 * v < 0.5, 1.25, 4.0), "emission": 0.0})
    _, warnings, _ = look_of(two_squares(PAINTED, PAINTED), shade)
    assert [warning.split(" in places")[0] for warning in warnings] == [
        "Square 0: the reflectance of material 'Painted' is up to 1.25",
        "Square 1: the reflectance of material 'Painted' is up to 4",
    ]


def test_bright_emission_is_no_fault():
    look, warnings, _ = look_of(two_squares(PAINTED, PAINTED), Pictures({"reflectance": 0.5, "emission": 5000.0}))
    assert look.emission.min() == 5000
    assert warnings == ()


ROOM = (
    box("Room", (0, 0, 0), (2, 2, 2), 0, inward=True),
    box("Block", (0.5, 0.5, 0.2), (1, 1, 0.8), 1, lightmapped=False),
)
LAMP = PointLight("Lamp", (8.0,) * 3, (1.5, 1.5, 1.5))


def baked(wall: Material, block: Material, shade: Pictures | None = None) -> Baked:
    scene = Scene(ROOM, (wall, block), (LAMP,))
    return finish(bake(scene, BakeSettings(page_size=64, quality="draft"), shade))


def test_a_picture_of_one_colour_bakes_bit_for_bit_as_that_constant_on_hidden_pages_too():
    plain = baked(Material("Wall", (0.5,) * 3), Material("Block", (0.25,) * 3, (0.0,) * 3))
    varied = replace(PAINTED, varies=frozenset({"reflectance"}), emission=(0.0,) * 3)
    shade = Pictures({"reflectance": 0.25})
    shown = baked(Material("Wall", (0.5,) * 3), varied, shade)
    assert shade.asked == [("reflectance", [False, True])]
    assert np.array_equal(plain.pages[0], shown.pages[0])
