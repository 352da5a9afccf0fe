# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps of every kind against Cycles: over probes, level and tilted; in a corner; behind a screen; with nodes."""

from __future__ import annotations

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from radiosity_addon.bake import bake  # noqa: E402
from radiosity_addon.blender.reading.extract import extract_scene  # noqa: E402
from radiosity_addon.chunks import finish  # noqa: E402
from radiosity_addon.geometry.surfaces import flatten  # noqa: E402
from radiosity_addon.geometry.visibility import Visibility  # noqa: E402
from radiosity_addon.lighting.lights import irradiance_at, lamps_of  # noqa: E402
from radiosity_addon.settings import BakeSettings  # noqa: E402
from tests.accuracy.comparison import page_at  # noqa: E402
from tests.accuracy.cycles_judge import LIFT_SHARE, judge, measure, probe_mesh  # noqa: E402
from tests.accuracy.probes import Probes, place, rendered_surfaces  # noqa: E402
from tests.blender.lamp_trees import SHAPED, emission_of, node_tree  # noqa: E402
from tests.blender.materials import shader  # noqa: E402

SAMPLES = 8192
CORNER_SAMPLES = 8192
SHADOW_SAMPLES = 4096
SIZE = 4.0
"""m, of the scene, from which probes take their size."""
TOLERANCE = 0.003
NEW = bpy.app.version >= (4, 5)
"""From here on lamps have an exposure, a temperature, and can be left unnormalised."""

Values = dict[str, object]
LAMPS: dict[str, tuple[str, Values]] = {
    "point": ("POINT", {"shadow_soft_size": 0.0}),
    "soft point": ("POINT", {"shadow_soft_size": 0.5}),
    "small soft point": ("POINT", {"shadow_soft_size": 0.05}),
    "stretched soft point": ("POINT", {"shadow_soft_size": 0.3, "scale": (1, 2, 0.5)}),
    "sphere": ("POINT", {"shadow_soft_size": 0.5, "use_soft_falloff": False}),
    "small sphere": ("POINT", {"shadow_soft_size": 0.05, "use_soft_falloff": False}),
    "low sphere": ("POINT", {"shadow_soft_size": 0.9, "use_soft_falloff": False}),
    "stretched sphere": ("POINT", {"shadow_soft_size": 0.3, "use_soft_falloff": False, "scale": (1, 2, 0.5)}),
    "spot": ("SPOT", {"shadow_soft_size": 0.0, "spot_size": 1.4, "spot_blend": 0.6}),
    "hard spot": ("SPOT", {"shadow_soft_size": 0.0, "spot_size": 1.4, "spot_blend": 0.0}),
    "narrow spot": ("SPOT", {"shadow_soft_size": 0.0, "spot_size": 0.4, "spot_blend": 1.0}),
    "widest spot": ("SPOT", {"shadow_soft_size": 0.0, "spot_size": math.pi, "spot_blend": 0.15}),
    "soft spot": ("SPOT", {"shadow_soft_size": 0.3, "spot_size": 1.4, "spot_blend": 0.6}),
    "widest soft spot": ("SPOT", {"shadow_soft_size": 0.3, "spot_size": math.pi, "spot_blend": 1.0}),
    "sphere spot": ("SPOT", {"shadow_soft_size": 0.3, "spot_size": 1.4, "spot_blend": 0.6, "use_soft_falloff": False}),
    "narrow sphere spot": (
        "SPOT",
        {"shadow_soft_size": 0.1, "spot_size": 0.5, "spot_blend": 0.3, "use_soft_falloff": False},
    ),
    "stretched spot": ("SPOT", {"shadow_soft_size": 0.1, "spot_size": 1.4, "spot_blend": 0.5, "scale": (1, 2, 0.7)}),
    "mirrored spot": ("SPOT", {"shadow_soft_size": 0.0, "spot_size": 1.4, "spot_blend": 0.5, "scale": (-1, 2, 1)}),
    "hard wide spot": ("SPOT", {"shadow_soft_size": 0.4, "spot_size": 1.4, "spot_blend": 0.0}),
    "sun": ("SUN", {"angle": 0.0}),
    "sun of half a degree": ("SUN", {"angle": math.radians(0.5)}),
    "sun of 10 degrees": ("SUN", {"angle": math.radians(10)}),
    "wide sun": ("SUN", {"angle": 1.0}),
    "sun of 90 degrees": ("SUN", {"angle": math.pi / 2}),
    "stretched sun": ("SUN", {"angle": 0.2, "scale": (1, 3, 0.5)}),
    "scaled square": ("AREA", {"shape": "SQUARE", "size": 0.5, "scale": (2, 3, 1)}),
    "mirrored rectangle": ("AREA", {"shape": "RECTANGLE", "size": 1.5, "size_y": 0.7, "scale": (-1, 1, 1)}),
    "stretched disc": ("AREA", {"shape": "DISK", "size": 0.6, "scale": (1, 2.5, 1)}),
    "stretched softbox": ("AREA", {"shape": "SQUARE", "size": 0.5, "spread": 1.5, "scale": (2, 3, 1)}),
    "stretched round softbox": ("AREA", {"shape": "DISK", "size": 0.5, "spread": 0.8, "scale": (1, 3, 2)}),
    "huge square": ("AREA", {"shape": "SQUARE", "size": 12.0}),
    "huge softbox": ("AREA", {"shape": "SQUARE", "size": 12.0, "spread": 1.0}),
    "tiny disc": ("AREA", {"shape": "DISK", "size": 0.01}),
    "softbox": ("AREA", {"shape": "RECTANGLE", "size": 1.5, "size_y": 0.7, "spread": 1.5}),
    "beam": ("AREA", {"shape": "SQUARE", "size": 1.5, "spread": math.radians(2)}),
    "negative point": ("POINT", {"shadow_soft_size": 0.1, "energy": -50.0}),
    "negative disc": ("AREA", {"shape": "DISK", "size": 0.5, "energy": -50.0}),
    "coloured area": ("AREA", {"shape": "SQUARE", "size": 1.0, "color": (1.0, 0.5, 0.0)}),
}
for _shape, _sizes in {
    "SQUARE": {"size": 1.0},
    "RECTANGLE": {"size": 1.5, "size_y": 0.7},
    "DISK": {"size": 1.2},
    "ELLIPSE": {"size": 1.5, "size_y": 0.7},
}.items():
    for _degrees in (180, 90, 10):
        LAMPS[f"{_shape.lower()} of {_degrees} degrees"] = (
            "AREA",
            {"shape": _shape, **_sizes, "spread": math.radians(_degrees)},
        )
NEW_LAMPS: dict[str, tuple[str, Values]] = {
    "point not normalized": ("POINT", {"shadow_soft_size": 0.0, "normalize": False}),
    "sphere not normalized": ("POINT", {"shadow_soft_size": 0.3, "use_soft_falloff": False, "normalize": False}),
    "soft point not normalized": ("POINT", {"shadow_soft_size": 0.3, "normalize": False}),
    "spot not normalized": ("SPOT", {"shadow_soft_size": 0.2, "spot_size": 1.4, "normalize": False}),
    "sun not normalized": ("SUN", {"angle": 0.6, "normalize": False}),
    "sharp sun not normalized": ("SUN", {"angle": 0.0, "normalize": False}),
    "wide sun not normalized": ("SUN", {"angle": math.pi / 2, "normalize": False}),
    "area not normalized": ("AREA", {"shape": "SQUARE", "size": 0.5, "scale": (2, 3, 1), "normalize": False}),
    "ellipse not normalized": ("AREA", {"shape": "ELLIPSE", "size": 1.5, "size_y": 0.7, "normalize": False}),
    "softbox not normalized": ("AREA", {"shape": "DISK", "size": 0.5, "spread": 1.0, "normalize": False}),
    "exposed point": ("POINT", {"shadow_soft_size": 0.1, "exposure": -1.3}),
    "exposed sun": ("SUN", {"angle": 0.1, "exposure": 2.0}),
    "warm area": ("AREA", {"shape": "SQUARE", "size": 1.0, "use_temperature": True, "temperature": 2700.0}),
    "cold tinted spot": (
        "SPOT",
        {"spot_size": 1.4, "use_temperature": True, "temperature": 12000.0, "color": (0.5, 0.9, 0.7)},
    ),
    "red hot point": ("POINT", {"use_temperature": True, "temperature": 1000.0}),
}
if NEW:
    LAMPS |= NEW_LAMPS

PLACES: dict[str, tuple[str, Values]] = {
    "point near the floor": ("POINT", {"shadow_soft_size": 0.0, "location": (0.1, 0.05, 0.05)}),
    "soft point near the floor": ("POINT", {"shadow_soft_size": 0.2, "location": (0.1, 0.05, 0.1)}),
    "sphere that touches the floor": (
        "POINT",
        {"shadow_soft_size": 0.3, "use_soft_falloff": False, "location": (0.1, 0.05, 0.3)},
    ),
    "sphere sunk into the floor": (
        "POINT",
        {"shadow_soft_size": 0.5, "use_soft_falloff": False, "location": (0.1, 0.05, 0.1)},
    ),
    "spot near the floor": ("SPOT", {"shadow_soft_size": 0.05, "spot_size": 2.5, "location": (0.1, 0.05, 0.1)}),
    "sun at the horizon": ("SUN", {"angle": 0.3, "rotation_euler": (math.radians(85), 0, 0.5)}),
    "sun below the horizon": ("SUN", {"angle": 0.3, "rotation_euler": (math.radians(95), 0, 0.5)}),
    "square just over the floor": ("AREA", {"size": 1.0, "location": (0.1, 0.05, 0.01), "rotation_euler": (0, 0, 0)}),
    "square that stands on the floor": (
        "AREA",
        {"size": 1.0, "location": (0.1, 0.05, 0.5), "rotation_euler": (math.pi / 2, 0, 0.5)},
    ),
    "square half below the floor": (
        "AREA",
        {"size": 1.0, "location": (0.1, 0.05, 0.1), "rotation_euler": (math.pi / 2, 0, 0.5)},
    ),
    "disc half below the floor": (
        "AREA",
        {"shape": "DISK", "size": 1.0, "location": (0.1, 0.05, 0.1), "rotation_euler": (1.3, 0, 0.5)},
    ),
    "softbox half below the floor": (
        "AREA",
        {"size": 1.0, "spread": 1.6, "location": (0.1, 0.05, 0.1), "rotation_euler": (1.3, 0, 0.5)},
    ),
}
"""Lamps near a floor, touching it and partly under its horizon."""


def probes() -> Probes:
    """A grid of 36 points on the floor, a third of them level, the others tilted to and fro."""
    grid = np.linspace(-1.3, 1.4, 6)
    x, y = (part.ravel() for part in np.meshgrid(grid, grid))
    position = np.stack([x, y, 0 * x], axis=1)
    tilt = np.where(np.arange(36) % 3 == 0, 0, np.where(np.arange(36) % 3 == 1, 0.7, 1.3))
    turn = 2.4 * np.arange(36)
    normal = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=1)
    return Probes(np.array(["probe"] * 36), position, normal)


def add_lamp(kind: str, values: Values) -> None:
    light = bpy.data.lights.new("lamp", kind)
    light.energy = 3 if kind == "SUN" else 100
    lamp = bpy.data.objects.new("lamp", light)
    lamp.location, lamp.rotation_euler = (0.1, 0.05, 1.0), (0.3, 0.2, 0.5)
    for key, value in values.items():
        setattr(lamp if key in ("location", "rotation_euler", "scale") else light, key, value)
    bpy.context.scene.collection.objects.link(lamp)


def add_floor(size: float = 1.0) -> None:
    """Far below the probes, because a scene without a dull face can't be baked."""
    mesh = bpy.data.meshes.new("floor")
    mesh.from_pydata([(-size, -size, -9), (size, -size, -9), (0, size, -9)], [], [(0, 1, 2)])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("floor", mesh))


def cycles_direct(points: Probes) -> np.ndarray:
    """(N, 3) irradiance, W/m2."""
    made, image = probe_mesh(points, SIZE)
    sharp = {light.type in ("POINT", "SPOT") and light.shadow_soft_size == 0 for light in bpy.data.lights} == {True}
    judge(bpy.context.scene, 16 if sharp else SAMPLES, 1, 2)
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT"}, target="IMAGE_TEXTURES", margin=0, use_clear=True)
    pixels = np.empty(4 * image.size[0] * image.size[1], np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.objects.remove(made)
    return math.pi * pixels.reshape(-1, 4)[: len(points.position), :3].astype(np.float64)


def found_and_expected() -> tuple[np.ndarray, np.ndarray]:
    """Irradiance of the scene's one lamp, of all its colours, at the probes (N, 3): ours and Cycles'."""
    scene = extract_scene(bpy.context.scene).scene
    surfaces = flatten(scene)
    lamps = lamps_of(scene.moved(-surfaces.origin), surfaces).lamps
    points = probes()
    position = points.position + SIZE * LIFT_SHARE * points.normal - surfaces.origin
    receivers = position.astype(np.float32), points.normal.astype(np.float32)
    light = sum(lamp.light(*receivers, None)[:, None] * np.array(lamp.strength) for lamp in lamps)
    return light, cycles_direct(points)


def assert_close(found: np.ndarray, expected: np.ndarray, tolerance: float = TOLERANCE) -> None:
    """Each probe within a share of the brightest, and all of them together."""
    assert np.abs(found - expected).max() < tolerance * np.abs(expected).max()
    np.testing.assert_allclose(found.sum(axis=0), expected.sum(axis=0), rtol=TOLERANCE, atol=1e-6)


def add_corner() -> None:
    """A floor and two walls, 3 m wide, white and dull, that face the lamp; one object each."""
    white = shader("white", "ShaderNodeBsdfDiffuse", Color=(0.8, 0.8, 0.8, 1))
    sheets = {
        "floor": [(-1.5, -1.5, 0), (1.5, -1.5, 0), (1.5, 1.5, 0), (-1.5, 1.5, 0)],
        "wall": [(-1.5, 1.5, 0), (1.5, 1.5, 0), (1.5, 1.5, 3), (-1.5, 1.5, 3)],
        "side": [(1.5, 1.5, 0), (1.5, -1.5, 0), (1.5, -1.5, 3), (1.5, 1.5, 3)],
    }
    for name, corners in sheets.items():
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
        mesh.materials.append(white)
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def add_emitter(shape: str) -> None:
    """A glowing mesh where the lamps hang."""
    if shape == "ball":
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, radius=0.4, location=(0.1, 0.05, 1))
    elif shape == "cube":
        bpy.ops.mesh.primitive_cube_add(size=0.6, location=(0.1, 0.05, 1), rotation=(0.3, 0.2, 0.5))
    else:
        bpy.ops.mesh.primitive_plane_add(size=0.8, location=(0.1, 0.05, 1), rotation=(0.3, 0.2, 0.5))
    material = bpy.data.materials.new("glow")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    emission, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    emission.inputs["Strength"].default_value = 10
    material.node_tree.links.new(emission.outputs[0], output.inputs["Surface"])
    bpy.context.object.data.materials.append(material)


@pytest.mark.parametrize("shape", ["ball", "cube", "plane"])
def test_an_emissive_mesh_gives_what_cycles_gives(shape: str) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_emitter(shape)
    add_floor(9.0)
    bpy.context.view_layer.update()
    assert_close(*found_and_expected(), 2 * TOLERANCE)


@pytest.mark.parametrize("name", [*LAMPS, *PLACES])
def test_an_unshadowed_lamp_gives_what_cycles_gives(name: str) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_lamp(*(LAMPS | PLACES)[name])
    add_floor()
    bpy.context.view_layer.update()
    assert_close(*found_and_expected())


CORNER_LAMPS = {
    "soft point": ("POINT", {"shadow_soft_size": 0.2}),
    "spot": ("SPOT", {"shadow_soft_size": 0.1, "spot_size": 1.2, "rotation_euler": (0.6, -0.5, 0)}),
    "wide sun": ("SUN", {"angle": 0.3, "rotation_euler": (0.6, -0.5, 0)}),
    "large square": ("AREA", {"size": 2.6, "location": (0, 0, 2.5), "rotation_euler": (0, 0, 0)}),
    "softbox": ("AREA", {"size": 0.8, "spread": 1.6, "location": (0.5, 0.4, 1.6)}),
}


@pytest.mark.parametrize("name", CORNER_LAMPS)
def test_a_lamp_in_a_corner_of_two_walls_gives_with_all_bounces_what_cycles_gives(name: str) -> None:
    """The mean over a hundred probes: of a single one Cycles knows 1 % in the time that there is."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_lamp(*CORNER_LAMPS[name])
    add_corner()
    bpy.context.view_layer.update()
    points = place(rendered_surfaces(), 100)
    measured, _ = measure(points, SIZE, CORNER_SAMPLES, [1], threads=2)
    scene = extract_scene(bpy.context.scene).scene
    baked = finish(bake(scene, BakeSettings(page_size=256, quality="high")))
    found = page_at(baked, scene, points)
    assert found.mean() == pytest.approx(measured[0].mean(), rel=TOLERANCE)
    assert np.sqrt(np.mean((found - measured[0]) ** 2)) < 0.025 * measured[0].mean()


@pytest.mark.parametrize("also", ["", "Is Diffuse Ray"], ids=["shadow rays", "shadow and diffuse rays"])
def test_a_pane_that_is_clear_to_some_rays_lets_through_what_cycles_does(also: str) -> None:
    """The mix that lets light into rooms with closed windows, of a pane that is red to all others."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_lamp("POINT", {"shadow_soft_size": 0.0, "location": (0.1, 0.05, 1.5)})
    add_corner()
    bpy.ops.mesh.primitive_plane_add(size=2, location=(0, 0, 0.5))
    bpy.context.object.data.materials.append(clear_to_rays(also))
    bpy.context.view_layer.update()
    points = place(rendered_surfaces(), 100)
    measured, _ = measure(points, SIZE, CORNER_SAMPLES // 16, [1], threads=2)
    scene = extract_scene(bpy.context.scene).scene
    baked = finish(bake(scene, BakeSettings(page_size=256, quality="medium")))
    found = page_at(baked, scene, points)
    for name in set(points.object):
        own = points.object == name
        np.testing.assert_allclose(found[own].mean(0), measured[0][own].mean(0), rtol=0.012)  # Cycles' noise is 0.5 %


def clear_to_rays(also: str) -> bpy.types.Material:
    material = shader("red", "ShaderNodeBsdfDiffuse", Color=(0.8, 0.3, 0.3, 1))
    tree = material.node_tree
    red, end = (next(node for node in tree.nodes if node.type == kind) for kind in ("BSDF_DIFFUSE", "OUTPUT_MATERIAL"))
    path, most = tree.nodes.new("ShaderNodeLightPath"), tree.nodes.new("ShaderNodeMath")
    most.operation = "MAXIMUM"
    mix, clear = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBsdfTransparent")
    most.inputs[1].default_value = 0
    tree.links.new(path.outputs["Is Shadow Ray"], most.inputs[0])
    if also:
        tree.links.new(path.outputs[also], most.inputs[1])
    tree.links.new(most.outputs[0], mix.inputs[0])
    tree.links.new(red.outputs[0], mix.inputs[1])
    tree.links.new(clear.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], end.inputs["Surface"])
    return material


def direct_light(points: Probes) -> np.ndarray:
    """(N, 3) irradiance of the open scene's lamps, with shadows, W/m2: ours."""
    scene = extract_scene(bpy.context.scene).scene
    surfaces = flatten(scene)
    position = points.position + SIZE * LIFT_SHARE * points.normal - surfaces.origin
    lamps = lamps_of(scene.moved(-surfaces.origin), surfaces)
    receivers = position.astype(np.float32), points.normal.astype(np.float32)
    ids = np.arange(len(position))
    return finish(irradiance_at(lamps, *receivers, Visibility(surfaces.corners), SHADOW_SAMPLES, ids, 1))[:, 0]


SUNK_LAMPS = {
    "sphere": ("POINT", {"shadow_soft_size": 0.3, "use_soft_falloff": False, "location": (1.4, 0.3, 1.0)}),
    "soft point": ("POINT", {"shadow_soft_size": 0.3, "location": (1.4, 0.3, 1.0)}),
    "disc": ("AREA", {"shape": "DISK", "size": 1.0, "location": (0.2, 1.5, 2.0)}),
    "softbox": ("AREA", {"size": 1.0, "spread": 1.6, "location": (0.2, 1.5, 2.0)}),
    "spot": ("SPOT", {"shadow_soft_size": 0.2, "spot_size": 2.0, "location": (1.4, 0.3, 2.0)}),
}


@pytest.mark.parametrize("name", SUNK_LAMPS)
def test_of_a_lamp_sunk_into_a_wall_that_part_shines_that_cycles_lets_shine(name: str) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_lamp(*SUNK_LAMPS[name])
    add_corner()
    bpy.context.view_layer.update()
    points = place(rendered_surfaces(), 60)
    assert_close(direct_light(points), cycles_direct(points), 2 * TOLERANCE)


@pytest.mark.parametrize("shadow", [True, False])
def test_a_lamp_behind_a_screen_lights_the_floor_only_if_it_casts_no_shadows(shadow: bool) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_lamp("POINT", {"shadow_soft_size": 0.1, "use_shadow": shadow})
    bpy.ops.mesh.primitive_plane_add(size=0.5, location=(0.1, 0.05, 0.5))
    add_floor()
    bpy.context.view_layer.update()
    points = probes()
    assert_close(direct_light(points), cycles_direct(points), 2 * TOLERANCE)


def test_a_lamps_emission_node_scales_its_power() -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_lamp("SPOT", {"spot_size": 1.4, "color": (1.0, 0.5, 0.25)})
    emission = emission_of(node_tree(bpy.data.lights["lamp"]))
    emission.inputs["Strength"].default_value = 2.5
    emission.inputs["Color"].default_value = (0.2, 0.4, 0.9, 1)
    add_floor()
    bpy.context.view_layer.update()
    assert_close(*found_and_expected())


def test_a_quadratic_falloff_node_is_the_strength_of_the_lamp() -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_lamp("POINT", {"shadow_soft_size": 0.2})
    tree = node_tree(bpy.data.lights["lamp"])
    falloff = tree.nodes.new("ShaderNodeLightFalloff")
    falloff.inputs["Strength"].default_value = 3.0
    tree.links.new(falloff.outputs["Quadratic"], emission_of(tree).inputs["Strength"])
    add_floor()
    bpy.context.view_layer.update()
    assert not extract_scene(bpy.context.scene).warnings
    assert_close(*found_and_expected())


@pytest.mark.parametrize("name", SHAPED)
def test_a_lamp_whose_nodes_shape_its_light_gives_what_cycles_gives(name: str) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    kind, values, build = SHAPED[name]
    add_lamp(kind, values)
    tree = node_tree(bpy.data.lights["lamp"])
    build(tree, emission_of(tree))
    add_floor()
    bpy.context.view_layer.update()
    assert_close(*found_and_expected())
