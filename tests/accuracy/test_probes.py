# SPDX-License-Identifier: GPL-3.0-or-later
"""The probes themselves, on light that is known on paper."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("bpy", reason="Cycles is part of bpy, which is not installed")
import bpy
from mathutils import Vector

from tests.accuracy import probes
from tests.accuracy.comparison import READING
from tests.accuracy.cycles_judge import dark_scene, measure
from tests.accuracy.edges import change_beside

SAMPLES = 512


@pytest.fixture(autouse=True)
def floor():
    dark_scene()
    mesh = bpy.data.meshes.new("Floor")
    mesh.from_pydata([(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)], [], [(0, 1, 2, 3)])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Floor", mesh))


def lamp(kind: str, **attributes: float) -> None:
    data = bpy.data.lights.new("Lamp", kind)
    for name, value in attributes.items():
        setattr(data, name, value)
    made = bpy.data.objects.new("Lamp", data)
    made.location = (0, 0, 2)
    bpy.context.scene.collection.objects.link(made)


def at_the_centre() -> np.ndarray:
    below = probes.Probes(np.array(["Floor"]), np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))
    values, _ = measure(below, size=10.0, samples=SAMPLES, seeds=[1])
    return values[0, 0]


def test_point_lamp_over_a_floor_is_as_on_paper() -> None:
    lamp("POINT", energy=100.0, shadow_soft_size=0.0)
    np.testing.assert_allclose(at_the_centre(), 0.633257, rtol=1e-3)


def test_square_area_lamp_over_a_floor_is_as_on_paper() -> None:
    lamp("AREA", energy=100.0, size=1.0)
    np.testing.assert_allclose(at_the_centre(), 2.33887, rtol=2e-3)


def test_sun_on_a_floor_is_as_on_paper() -> None:
    lamp("SUN", energy=3.0, angle=0.0)
    np.testing.assert_allclose(at_the_centre(), 3.0 / math.pi, rtol=1e-3)


def test_open_sky_of_strength_one_gives_one() -> None:
    background = bpy.context.scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    background.inputs["Strength"].default_value = 1.0
    np.testing.assert_allclose(at_the_centre(), 1.0, rtol=1e-3)


def test_each_probe_gets_its_own_texel_and_the_light_of_its_own_place() -> None:
    lamp("POINT", energy=100.0, shadow_soft_size=0.0)
    place = probes.place(probes.rendered_surfaces(), 30)
    values, _ = measure(place, size=10.0, samples=SAMPLES, seeds=[1])
    squared = (place.position**2).sum(axis=1) + 4.0
    expected = 100.0 * 2.0 / (4 * math.pi**2 * squared**1.5)
    np.testing.assert_allclose(values[0, :, 0], expected, rtol=2e-3)


def test_probes_follow_area_and_are_the_same_each_time() -> None:
    corners = np.array([[(0, 0, 0), (3, 0, 0), (0, 2, 0)], [(0, 0, 5), (1, 0, 5), (0, 2, 5)]], float)
    surfaces = [probes.Surface("large", corners[:1]), probes.Surface("small", corners[1:])]
    first, second = probes.place(surfaces, 40), probes.place(surfaces, 40)
    assert (first.object == "large").sum() == 30
    np.testing.assert_array_equal(first.position, second.position)
    np.testing.assert_allclose(first.position[first.object == "small", 2], 5.0)


def test_points_of_a_smooth_surface_have_its_shading_normals() -> None:
    """A roof of 30 degrees that is shaded as if it were level is as bright under a sun in the zenith as a floor."""
    lamp("SUN", energy=3.0, angle=0.0)
    normal = np.array([[math.sin(math.radians(30)), 0.0, math.cos(math.radians(30))]])
    roof = probes.Probes(np.array(["Floor"]), np.array([[0.0, 0.0, 1.0]]), normal)
    values, _ = measure(roof, 10.0, SAMPLES, [1], shading=np.array([[0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(values[0, 0], 3.0 / math.pi, rtol=2e-3)


def test_points_of_a_coarse_ball_are_lit_up_to_its_terminator() -> None:
    """Where light comes from below a facet, but not from below what its normals tell of: small flat points are dark."""
    bpy.data.objects.remove(bpy.data.objects["Floor"])
    bpy.ops.mesh.primitive_uv_sphere_add(segments=12, ring_count=8, radius=1)
    bpy.ops.object.shade_smooth()
    lamp("SUN", energy=math.pi, angle=0.0)
    towards = np.array([0.8, 0.36, 0.48])
    bpy.data.objects["Lamp"].rotation_euler = Vector(towards).to_track_quat("Z", "Y").to_euler()
    surfaces = [surface for surface in probes.rendered_surfaces() if surface.name == "Sphere"]
    place = probes.place(surfaces, 400)
    squares = probes.footprints(surfaces, place, 0.02)
    there = squares.there
    grazed = (squares.normals[there] @ towards < 0) & (squares.shading[there] @ towards > 0.01)
    hosts, normals = squares.hosts.only(grazed), squares.normals[there][grazed]
    points = probes.Probes(np.repeat("Sphere", len(normals)), squares.points[there][grazed], normals)
    shading = squares.shading[there][grazed]
    assert len(shading) > 20
    values, _ = measure(points, 1.0, 16, [1], 1, shading, hosts, 0.02)
    np.testing.assert_allclose(values[0, :, 0], shading @ towards, atol=0.01)
    flat, _ = measure(points, 1.0, 16, [1], 1, shading)
    assert (
        np.mean(flat > 0) < 0.25
    )  # from run to run 0.04 to 0.15: faces come in another order, so other points are asked


def test_a_footprint_is_clipped_to_its_surface() -> None:
    (surface,) = probes.rendered_surfaces()
    middle = probes.Probes(np.array(["Floor"] * 2), np.array([[0.0, 0, 0], [5.0, 0, 0]]), np.array([[0.0, 0, 1]] * 2))
    squares = probes.footprints([surface], middle, 0.1)
    assert squares.there[0].all()
    assert squares.there[1].sum() == probes.POINTS / 2
    centre = probes.middles([surface], middle, squares, squares.there, 0.1)
    np.testing.assert_allclose(centre, [[0, 0, 0], [4.975, 0, 0]], atol=0.01)


def test_points_of_a_curved_surface_lie_on_it() -> None:
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=1)
    bpy.ops.object.shade_smooth()
    surfaces = [surface for surface in probes.rendered_surfaces() if surface.name == "Sphere"]
    place = probes.place(surfaces, 40)
    squares = probes.footprints(surfaces, place, 0.05)
    assert squares.there.all()
    np.testing.assert_allclose(np.linalg.norm(squares.points, axis=2), 1.0, atol=0.005)
    np.testing.assert_allclose(squares.shading, squares.points, atol=0.01)


def test_light_changes_beside_a_probe_within_what_a_texel_s_reading_takes_in_of_the_edge_of_a_shadow() -> None:
    """A roof over the half of the floor where x < 0, under a sun in the zenith: probes before it, and under it."""
    texel = 0.1
    roof = bpy.data.meshes.new("Roof")
    roof.from_pydata([(-5, -5, 9), (0, -5, 9), (0, 5, 9), (-5, 5, 9)], [], [(0, 1, 2, 3)])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Roof", roof))
    lamp("SUN", energy=math.pi, angle=0.0)
    x = texel * READING * np.array([-1.2, -0.8, 0.8, 1.2])
    place = x[:, None] * [1.0, 0, 0]
    value = np.array([0.0, 0.0, 1.0, 1.0])[:, None] * np.ones(3)
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    told = probes.References(np.array(["Floor"] * 4), place, up, value, 0 * value, texel, "", 1, x, x, 0, "")
    np.testing.assert_allclose(change_beside(told, np.arange(4)), [0, 2, 2, 0], atol=0.05)  # twice the mean of 0.5
    np.testing.assert_allclose(change_beside(told, np.array([3, 1])), [0, 2], atol=0.05)
