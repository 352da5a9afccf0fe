# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures: where a fitted camera stands, and that rendering leaves the scene as it was."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest
from mathutils import Vector

from radiosity_addon.blender.headless.fitted_camera import fitted_camera
from radiosity_addon.blender.headless.render_picture import render_picture
from radiosity_addon.errors import SceneError
from radiosity_addon.files import Transaction
from tests.blender.datablocks import differences, snapshot

BOX = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
FRONT = (0, 4, 5, 1)
OTHER_SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
"""Corners of a box's sides, wound so that they face inwards."""


def room(open_front: bool) -> None:
    """A box of 2 m whose walls have no thickness, around a pillar."""
    mesh = bpy.data.meshes.new("Room")
    mesh.from_pydata(BOX, [], [side[::-1] for side in (OTHER_SIDES if open_front else [*OTHER_SIDES, FRONT])])
    bpy.context.collection.objects.link(bpy.data.objects.new("Room", mesh))
    assert all(face.normal.dot(face.center) < 0 for face in mesh.polygons), "they face inwards"
    bpy.ops.mesh.primitive_cube_add(size=0.2)


def camera_place() -> tuple[Vector, Vector]:
    """Where a fitted camera stands, and the way it looks."""
    scene = bpy.context.scene
    with fitted_camera(scene, list(scene.objects)):
        matrix = scene.camera.matrix_world.copy()
    return matrix.translation, -matrix.col[2].to_3d()


def test_objects_in_the_open_are_seen_from_the_front_and_above() -> None:
    bpy.ops.mesh.primitive_cube_add(location=(50, 0, 0))
    place, look = camera_place()
    assert place.y < -2
    assert place.z > 1
    assert look.dot((Vector((50, 0, 0)) - place).normalized()) > 0.99


def test_a_box_is_seen_through_its_open_side() -> None:
    room(open_front=True)
    place, look = camera_place()
    assert place.y < -2
    assert place.x == pytest.approx(0, abs=0.01)
    assert look.y == pytest.approx(1, abs=0.01)


def test_a_closed_room_is_seen_from_inside() -> None:
    room(open_front=False)
    place, look = camera_place()
    assert max(abs(x) for x in place) < 1
    assert look.dot(-place.normalized()) > 0.99


def test_rendering_leaves_the_scene_as_it_was(tmp_path: Path) -> None:
    bpy.ops.mesh.primitive_cube_add()
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 4000, 2000
    scene.render.resolution_percentage = 1
    before = snapshot()
    with Transaction() as files:
        render_picture(scene, tmp_path / "picture.png", [bpy.context.object], files)
        files.commit()
    assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]
    assert differences(before, snapshot()) == []


def test_a_scene_of_nothing_has_no_picture(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="nothing to render"), Transaction() as files:
        render_picture(bpy.context.scene, tmp_path / "picture.png", [], files)
