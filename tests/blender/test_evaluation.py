# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects as they are rendered: render settings, handlers, and meshes in edit mode."""

from __future__ import annotations

import bpy
import pytest

from radiosity_addon.blender.data.evaluation import at_render_settings
from tests.blender.added import add_cube, snapshot
from tests.blender.built import add

# evaluation


def test_looking_at_render_settings_leaves_no_trace():
    bpy.context.view_layer.objects.active = add_cube()
    before = snapshot()
    with at_render_settings(bpy.context.scene):
        pass
    assert snapshot() == before


@pytest.mark.parametrize("in_use", [False, True])
@pytest.mark.parametrize("shown", [0, 1])
def test_of_several_view_layers_the_one_asked_for_is_looked_at_whether_it_renders_or_not(shown, in_use):
    scene = bpy.context.scene
    for name in ("One", "Two"):
        scene.collection.children.link(bpy.data.collections.new(name))
        bpy.data.collections[name].objects.link(bpy.data.objects.new(name, None))
    second = scene.view_layers.new("Second")
    for layer, hidden in ((scene.view_layers[0], "Two"), (second, "One")):
        layer.layer_collection.children[hidden].exclude = True
    second.use = in_use
    with at_render_settings(scene, scene.view_layers[shown]) as depsgraph:
        names = {item.object.name for item in depsgraph.object_instances}
    assert names & {"One", "Two"} == {("One", "Two")[shown]}


def test_an_exception_inside_the_look_comes_out_and_leaves_no_trace():
    before = snapshot()
    with pytest.raises(ZeroDivisionError), at_render_settings(bpy.context.scene):
        raise ZeroDivisionError
    assert snapshot() == before


def test_render_handlers_of_others_are_kept_and_not_called():
    called = []
    bpy.app.handlers.render_pre.append(called.append)
    try:
        with at_render_settings(bpy.context.scene):
            assert list(bpy.app.handlers.render_pre) == [called.append]
        assert called == []
        assert list(bpy.app.handlers.render_pre) == [called.append]
    finally:
        bpy.app.handlers.render_pre.clear()


def test_the_last_render_is_kept(tmp_path):
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 24, 16, 100
    scene.camera = add(bpy.data.objects.new("camera", bpy.data.cameras.new("camera")))
    bpy.ops.render.render()
    with at_render_settings(scene):
        pass
    bpy.data.images["Render Result"].save_render(str(tmp_path / "kept.png"))
    assert tuple(bpy.data.images.load(str(tmp_path / "kept.png")).size) == (24, 16)


def test_a_graph_at_render_settings_outlives_what_the_window_evaluates_meanwhile():
    for name in ("One", "Other"):
        add_cube(name).modifiers.new("Fine", "SUBSURF").render_levels = 2
    faces = {}
    with at_render_settings(bpy.context.scene) as depsgraph:
        for item in depsgraph.object_instances:
            if item.object.type == "MESH":
                faces[item.object.name] = len(item.object.data.polygons)
            add_cube("Later")
            bpy.context.view_layer.update()
    assert faces == {"One": 6 * 4**2, "Other": 6 * 4**2}
    assert len(bpy.data.scenes) == 1
