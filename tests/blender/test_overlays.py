# SPDX-License-Identifier: GPL-3.0-or-later
"""What overlays read from a file before and after a bake, and that they leave it alone. Drawing takes a window."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from radiosity_addon.arrays import Float32
from radiosity_addon.blender.data.names import PAGE_KEY, TEXELS_KEY
from radiosity_addon.blender.judging.overlay_data import (
    NEEDS,
    Pages,
    Placed,
    density_of,
    edge_texels,
    missing,
    placed_things,
    shape_of,
)
from radiosity_addon.blender.judging.overlay_drawing import RAMPS, Look, border_distances
from radiosity_addon.blender.judging.overlay_legend import legend_of
from radiosity_addon.blender.judging.overlay_panel import OVERLAYS
from radiosity_addon.blender.judging.overlays import OFF, Shown, show
from radiosity_addon.blender.writing.originals import show_bake, show_originals
from radiosity_addon.blender.writing.revert import revert
from radiosity_addon.reports.pictures import LUMENS_PER_WATT
from radiosity_addon.reports.texel_maps import packed
from tests.blender import baked
from tests.blender.datablocks import snapshot

LIT = 0.5
"""H / pi of every texel of the bakes here, W/(m2 sr)."""


def in_view() -> dict[str, Placed]:
    bpy.context.view_layer.update()
    return {thing.name: thing for thing in placed_things(bpy.context.evaluated_depsgraph_get())}


def square_map(thing: bpy.types.Object, edge: float = 1.0) -> None:
    """A uv map that lays the whole object over a square, to be kept by a bake."""
    layer = thing.data.uv_layers.new(name="Lightmap")
    layer.uv.foreach_set("vector", np.float32([0, 0, 1, 0, 1, 1, 0, 1]) * edge)
    thing.radiosity.uv_map = "Lightmap"


def density(wanted: float | None) -> tuple[float, ...]:
    things = [(thing, shape_of(thing.mesh, thing.uv_map)) for thing in in_view().values()]
    found = density_of(things, 64, wanted, None)
    return (*found.spread, found.target, found.known)


def test_every_overlay_has_a_button_and_colors_of_its_own() -> None:
    assert [item[0] for item in OVERLAYS] == list(NEEDS) == list(RAMPS)
    assert all(ramp().shape == (256, 3) for ramp in RAMPS.values())


def test_before_a_bake_each_overlay_says_what_it_lacks() -> None:
    baked.quad("Floor")
    reasons = {name: missing(bpy.context.scene, name) for name in NEEDS}
    assert all("Bake first" in reason for reason in reasons.values())
    square_map(bpy.data.objects["Floor"])
    assert {name for name in NEEDS if not missing(bpy.context.scene, name)} == {"density", "charts"}


def test_after_a_bake_nothing_lacks_but_what_was_not_kept(tmp_path: Path) -> None:
    baked.bake([baked.quad("Floor")], tmp_path)
    scene = bpy.context.scene
    assert {name for name in NEEDS if missing(scene, name)} == {"patches", "invalid"}
    Pages.of(scene).images[0][TEXELS_KEY] = packed(np.ones((8, 8), np.int32))
    assert not any(missing(scene, name) for name in NEEDS)


def test_no_overlay_covers_the_original_that_was_asked_for(tmp_path: Path) -> None:
    baked.bake([baked.quad("Floor")], tmp_path)
    scene = bpy.context.scene
    Pages.of(scene).images[0][TEXELS_KEY] = packed(np.ones((8, 8), np.int32))
    show_originals(scene)
    assert all("Show Baked" in missing(scene, name) for name in NEEDS)
    show_bake(scene)
    assert not any(missing(scene, name) for name in NEEDS)


def test_objects_know_their_pages_until_they_are_reverted(tmp_path: Path) -> None:
    floor, wall = baked.quad("Floor"), baked.quad("Wall")
    before = snapshot()
    baked.bake([floor, wall], tmp_path, pages={"Wall": 1})
    assert {name: thing.page for name, thing in in_view().items()} == {"Floor": 0, "Wall": 1}
    revert(bpy.context.scene)
    assert PAGE_KEY not in floor
    assert snapshot() == before


def test_what_is_hidden_is_not_shown_and_what_moves_is_followed(tmp_path: Path) -> None:
    floor, wall = baked.quad("Floor"), baked.quad("Wall")
    baked.bake([floor, wall], tmp_path)
    wall.hide_set(True)
    floor.location = 1, 2, 3
    found = in_view()
    assert list(found) == ["Floor"]
    assert found["Floor"].matrix[:3, 3].tolist() == [1, 2, 3]


def test_a_curve_is_shown_by_its_stand_in(tmp_path: Path) -> None:
    bpy.ops.surface.primitive_nurbs_surface_sphere_add()
    thing = bpy.context.object
    baked.bake([thing], tmp_path)
    (found,) = in_view().values()
    assert found.name == f"{thing.name} (Radiosity)"
    assert len(shape_of(found.mesh, found.uv_map).corners) > 10


def test_objects_that_share_a_mesh_share_its_shape_and_keep_their_places(tmp_path: Path) -> None:
    floor = baked.quad("Floor")
    other = floor.copy()
    other.name, other.location = "Other", (5, 0, 0)
    bpy.context.scene.collection.objects.link(other)
    baked.bake([floor], tmp_path)
    other[PAGE_KEY], other["radiosity_place"] = 0, (0.5, 0.25, 0.0)
    found = in_view()
    assert found["Floor"].key == found["Other"].key
    assert found["Other"].place == (0.5, 0.25, 0.0)


def test_a_map_that_a_bake_would_keep_shows_the_density_that_it_will_have() -> None:
    """2 m x 2 m over half of the map's edge: the bake scales the map as a whole, to 64 texels a metre."""
    square_map(baked.quad("Floor"), edge=0.5)
    assert density(64.0) == pytest.approx((64, 64, 64, 64, True), rel=1e-5)
    assert density(None) == pytest.approx((1, 1, 1, 1, False), rel=1e-5)


def test_density_after_a_bake_is_counted_in_texels_of_the_page(tmp_path: Path) -> None:
    floor = baked.quad("Floor")
    baked.bake([floor], tmp_path)
    floor.data.uv_layers["Radiosity"].uv.foreach_set("vector", np.float32([0, 0, 1, 0, 1, 1, 0, 1]))
    floor.scale = 4, 1, 1
    assert density(None) == pytest.approx((16, 16, 16, 16, True), rel=1e-5)  # 64 x 64 texels on 16 m2
    (thing,) = in_view().values()
    assert edge_texels(thing, shape_of(thing.mesh, thing.uv_map), 64, None) == 64


def test_pages_tell_the_light_that_they_hold(tmp_path: Path) -> None:
    baked.bake([baked.quad("Floor")], tmp_path, value=LIT)
    pages = Pages.of(bpy.context.scene)
    assert pages.size == 8
    np.testing.assert_allclose(pages.light(0), LIT, rtol=1e-3)
    assert pages.mean_lux == pytest.approx(np.pi * LUMENS_PER_WATT * LIT, rel=1e-3)
    assert pages.ends[0] < pages.mean_lux < pages.ends[1]


def test_only_texels_in_use_count(tmp_path: Path) -> None:
    baked.bake([baked.quad("Floor")], tmp_path)
    image = Pages.of(bpy.context.scene).images[0]
    numbers = np.zeros((8, 8), np.int32)
    numbers[:2] = 7, 1, 3, 7, 9, 9, 9, 2
    image[TEXELS_KEY] = packed(numbers)
    pages = Pages.of(bpy.context.scene)
    assert pages.counts == (3, 16, 2)
    assert len(pages.lux[0]) == 16


@pytest.mark.parametrize(
    ("unit", "mean", "sign", "ends"),
    [("lux", "1,073 lx", "lx", ["1,000", "1,468", "2,154"]), ("watts", "1.57 W/m²", "W/m²", ["1.46", "2.15", "3.15"])],
)
def test_the_legend_counts_in_the_unit_that_was_chosen(
    unit: str, mean: str, sign: str, ends: list[str], tmp_path: Path
) -> None:
    baked.bake([baked.quad("Floor")], tmp_path, value=LIT)
    pages = Pages.of(bpy.context.scene)
    legend = legend_of(Look("illuminance", pages.ends), pages, None, 0, unit)
    assert legend.title.endswith(sign)
    assert mean in legend.notes[0]
    assert [text for _, text in legend.ticks] == ends
    assert [share for share, _ in legend.ticks] == pytest.approx([0, 0.5, 1])


def test_seams_lie_where_the_distance_to_the_border_is_none() -> None:
    found = border_distances(2, np.array([0, 5]))
    middle = np.float32([[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]])  # of a triangle's edges 0, 1 and 2

    def nearest(triangle: int) -> Float32:
        return (middle @ found[triangle]).min(axis=1)

    assert nearest(0)[0] == 0
    assert (nearest(0)[1:] > 0.4).all()
    assert nearest(1)[2] == 0
    assert (nearest(1)[:2] > 0.4).all()


def test_a_bake_keeps_what_every_overlay_needs_and_reverting_leaves_nothing() -> None:
    """A block on a floor: texels below it are invalid."""
    bpy.ops.mesh.primitive_plane_add(size=4)
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 0, 0.5))
    bpy.ops.object.light_add(type="SUN", location=(0, 0, 3))
    scene = bpy.context.scene
    scene.radiosity.page_size, scene.radiosity.quality = 64, "draft"
    before = snapshot()
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    assert not any(missing(scene, name) for name in NEEDS)
    pages = Pages.of(scene)
    patches, used, invalid = pages.counts
    assert 100 < patches < used < 64 * 64
    assert 20 < invalid < used / 4
    assert {thing.page for thing in in_view().values()} == {0}
    revert(scene)
    assert snapshot() == before


def test_without_a_window_overlays_are_refused_and_nothing_is_on() -> None:
    baked.quad("Floor")
    before = snapshot()
    with pytest.raises(RuntimeError, match="no window"):
        bpy.ops.radiosity.overlay(show="charts")
    show(OFF)
    assert Shown.name() == OFF
    assert snapshot() == before
