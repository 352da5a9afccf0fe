# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps whose nodes shape their light: what is measured of them, once for all that are alike, and by whom."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
import pytest

from radiosity_addon.blender.reading import light_records
from radiosity_addon.blender.reading.cycles import Cycles
from radiosity_addon.blender.reading.extract import extract_scene, read_scene
from radiosity_addon.blender.reading.lamp_distributions import measure_lamp
from radiosity_addon.blender.reading.second_blender import SecondBlender
from radiosity_addon.chunks import finish
from radiosity_addon.scene import Scene
from tests.blender.datablocks import snapshot
from tests.blender.lamp_trees import IES, Tree, emission_of, falloff, ies, ies_node, missing_ies, node_tree
from tests.blender.shader_trees import plane


def lamp(build: Tree, kind: str = "POINT", **values: object) -> bpy.types.Object:
    light = bpy.data.lights.new("lamp", kind)
    for name, value in values.items():
        setattr(light, name, value)
    tree = node_tree(light)
    build(tree, emission_of(tree))
    return hung(light)


def hung(light: bpy.types.Light) -> bpy.types.Object:
    thing = bpy.data.objects.new("lamp", light)
    thing.location = 0.3, 0, 2
    bpy.context.scene.collection.objects.link(thing)
    return thing


def extracted(cycles: Cycles | None = None) -> Scene:
    plane("Floor", None)
    return finish(finish(read_scene(bpy.context.scene)).extraction(cycles or Cycles())).scene


def test_a_profile_is_a_picture_in_the_lamps_own_frame_whose_brightest_direction_is_one() -> None:
    thing = lamp(ies, energy=4 * np.pi)
    thing.rotation_euler = np.pi / 2, 0, 0  # shines along +y
    (light,) = extracted().lights
    assert light.distribution.directions.max() == 1
    assert light.distribution.directions.shape[2] == 1
    assert light.distribution.falloff is None
    np.testing.assert_allclose(light.distribution.axes[2], (0, 1, 0), atol=1e-6)
    np.testing.assert_allclose(np.cross(*light.distribution.axes[:2]), light.distribution.axes[2], atol=1e-6)


def test_lamps_that_share_their_light_are_measured_once_however_they_are_turned(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = []
    monkeypatch.setattr(light_records, "measure_lamp", lambda *args: asked.append(args) or measure_lamp(*args))
    first = lamp(ies)
    for turn in (0.5, 1.5):
        hung(first.data).rotation_euler = turn, turn / 2, turn
    hung(first.data).scale = 1, 2, 1
    found = [light.distribution for light in extracted().lights]
    assert len(asked) == 2
    assert sum(each.directions is found[0].directions for each in found) == 3
    assert len({each.axes for each in found}) == 3


def test_nodes_that_only_compute_a_constant_leave_a_plain_lamp() -> None:
    def build(tree: bpy.types.NodeTree, emission: bpy.types.Node) -> None:
        plus = tree.nodes.new("ShaderNodeMath")
        plus.inputs[0].default_value, plus.inputs[1].default_value = 1.25, 0.25
        tree.links.new(plus.outputs[0], emission.inputs["Strength"])

    lamp(build, energy=4 * np.pi, color=(1, 0.5, 0))
    scene = extracted()
    (light,) = scene.lights
    assert light.distribution is None
    assert light.intensity == pytest.approx((1.5, 0.75, 0), rel=1e-4)
    assert not scene.warnings


def test_a_narrow_spots_picture_shows_no_more_than_its_cone_lights() -> None:
    lamp(ies, "SPOT", spot_size=0.5)
    (light,) = extracted().lights
    assert 0.15 < light.distribution.reach < 0.3


@pytest.mark.parametrize("power", [1, 2])
def test_a_falloff_is_a_law_over_the_distance(power: int) -> None:
    lamp(falloff({1: "Linear", 2: "Constant"}[power]))
    (light,) = extracted().lights
    assert light.distribution.directions.shape == (1, 1, 1)
    distance, factor = light.distribution.falloff.T
    np.testing.assert_allclose(factor, distance**power, rtol=2e-3)


def test_a_missing_profile_is_named() -> None:
    lamp(missing_ies)
    (warning,) = extracted().warnings
    assert warning.startswith("Lamp 'lamp'")
    assert "lost.ies" in warning


def test_nodes_of_areas_and_suns_that_shape_their_light_are_named() -> None:
    lamp(ies, "AREA")
    (warning,) = extracted().warnings
    assert warning.startswith("Lamp 'lamp'")


def test_nothing_of_the_measuring_stays() -> None:
    lamp(ies)
    plane("Floor", None)
    before = snapshot()
    extract_scene(bpy.context.scene)
    assert snapshot() == before


@pytest.fixture(scope="module")
def second() -> Iterator[SecondBlender]:
    with SecondBlender() as blender:
        yield blender


def external(tree: bpy.types.NodeTree, emission: bpy.types.Node) -> None:
    """A profile in a file whose path is relative to the .blend."""
    node = ies_node(tree)
    node.ies, node.mode, node.filepath = None, "EXTERNAL", "//profiles/downlight ü.ies"
    tree.links.new(node.outputs["Fac"], emission.inputs["Strength"])


@pytest.mark.parametrize("build", [ies, external])
def test_a_second_blender_measures_the_same(second: SecondBlender, tmp_path: Path, build: Tree) -> None:
    (tmp_path / "profiles").mkdir()
    (tmp_path / "profiles" / "downlight ü.ies").write_text(IES)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "room.blend"))
    lamp(build)
    there = Cycles(second=second)
    (own,), (other,) = extracted().lights, extracted(there).lights
    assert there._second is second  # it has done the work
    assert own.intensity == other.intensity
    assert own.distribution.directions.std() > 0.1
    assert np.array_equal(own.distribution.directions, other.distribution.directions)
