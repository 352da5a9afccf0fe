# SPDX-License-Identifier: GPL-3.0-or-later
"""Limits that Cycles puts on light: bounces of lamps, worlds and scenes, and clamps."""

from __future__ import annotations

import bpy
import pytest

from radiosity_addon.blender.headless.commands import bake_settings
from radiosity_addon.blender.reading.extract import extract_scene
from radiosity_addon.cli import Verb


@pytest.fixture
def scene() -> bpy.types.Scene:
    mesh = bpy.data.meshes.new("Floor")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    found = bpy.context.scene
    found.collection.objects.link(bpy.data.objects.new("Floor", mesh))
    return found


def add_lamp(name: str, **cycles: int) -> bpy.types.Object:
    light = bpy.data.lights.new(name, "POINT")
    for key, value in cycles.items():
        setattr(light.cycles, key, value)
    lamp = bpy.data.objects.new(name, light)
    bpy.context.scene.collection.objects.link(lamp)
    return lamp


def test_lamps_of_few_bounces_make_groups_of_their_own(scene):
    bpy.context.view_layer.lightgroups.add(name="warm")
    add_lamp("a")
    add_lamp("b", max_bounces=0)
    add_lamp("c", max_bounces=2).lightgroup = "warm"
    add_lamp("d", max_bounces=0)
    found = extract_scene(scene).scene
    limit = {light.name: found.bounces.get(light.group) for light in found.lights}
    assert limit == {"a": None, "b": 0, "c": 2, "d": 0}
    assert [found.groups[light.group] for light in sorted(found.lights, key=lambda light: light.name)] == [
        "",
        "",
        "warm",
        "",
    ]
    assert len(found.groups) == 3


def test_a_world_of_few_bounces_is_limited(scene):
    scene.world = bpy.data.worlds.new("World")
    scene.world.cycles.max_bounces = 1
    found = extract_scene(scene).scene
    assert found.bounces[found.world.group] == 1


def test_as_the_scene_takes_cycles_diffuse_bounces_and_clamps(scene):
    scene.cycles.max_bounces, scene.cycles.diffuse_bounces = 12, 3
    scene.cycles.sample_clamp_direct, scene.cycles.sample_clamp_indirect = 7.0, 2.0
    assert scene.radiosity.bake_settings().bounces is None
    scene.radiosity.bounces = "scene"
    settings = scene.radiosity.bake_settings()
    assert (settings.bounces, settings.clamp_direct, settings.clamp_indirect) == (3, 7.0, 2.0)
    scene.cycles.max_bounces = 2
    assert scene.radiosity.bake_settings().bounces == 2


@pytest.mark.parametrize("word, expected", [("all", (None, 0)), ("scene", (4, 2)), (1, (1, 0)), (None, (4, 2))])
def test_the_command_line_overrules_the_scene(scene, tmp_path, word, expected):
    scene.cycles.diffuse_bounces, scene.cycles.sample_clamp_indirect = 4, 2.0
    scene.radiosity.bounces = "scene"
    settings = bake_settings(scene, Verb("bake", tmp_path / "room.blend", bounces=word))
    assert (settings.bounces, settings.clamp_indirect) == expected


def test_finer_folds_are_as_the_scene_has_them_unless_the_command_line_tells(tmp_path):
    scene = bpy.context.scene
    assert not bake_settings(scene, Verb("bake", tmp_path / "room.blend")).fine_folds
    assert bake_settings(scene, Verb("bake", tmp_path / "room.blend", fine_folds=True)).fine_folds
    scene.radiosity.fine_folds = True
    assert bake_settings(scene, Verb("bake", tmp_path / "room.blend")).fine_folds
    assert not bake_settings(scene, Verb("bake", tmp_path / "room.blend", fine_folds=False)).fine_folds
