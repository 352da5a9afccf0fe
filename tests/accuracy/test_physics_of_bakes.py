# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender's units mean on a page: whole bakes of scenes whose answer is known on paper, as Cycles has it too."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from radiosity_addon.bake import Baked, bake  # noqa: E402
from radiosity_addon.blender.reading.extract import extract_scene  # noqa: E402
from radiosity_addon.chunks import finish  # noqa: E402
from radiosity_addon.settings import BakeSettings  # noqa: E402

HEIGHT = 2.0
"""m, of lamps over the floor."""


@pytest.fixture(autouse=True)
def empty_file() -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


def material(reflectance: float, strength: float = 0.0) -> bpy.types.Material:
    """A diffuse shader and an emission shader, added."""
    made = bpy.data.materials.new("Material")
    if bpy.app.version < (5, 0):
        made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    nodes.clear()
    output, both = nodes.new("ShaderNodeOutputMaterial"), nodes.new("ShaderNodeAddShader")
    diffuse, emission = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeEmission")
    diffuse.inputs["Color"].default_value = (*(reflectance,) * 3, 1)
    emission.inputs["Strength"].default_value = strength
    links.new(diffuse.outputs[0], both.inputs[0])
    links.new(emission.outputs[0], both.inputs[1])
    links.new(both.outputs[0], output.inputs["Surface"])
    return made


def add_floor() -> None:
    bpy.ops.mesh.primitive_plane_add(size=4)
    bpy.context.object.data.materials.append(material(0.5))


def add_lamp(kind: str, energy: float, scale: float = 1.0, **values: object) -> None:
    lamp = bpy.data.lights.new("Lamp", kind)
    lamp.energy = energy
    for name, value in values.items():
        setattr(lamp, name, value)
    holder = bpy.data.objects.new("Lamp", lamp)
    holder.location, holder.scale = (0, 0, HEIGHT), (scale,) * 3
    bpy.context.scene.collection.objects.link(holder)


def baked(**settings: object) -> Baked:
    bpy.context.view_layer.update()
    options = {"page_size": 64, "quality": "draft", **settings}
    return finish(bake(extract_scene(bpy.context.scene).scene, BakeSettings(**options)))


def below_the_lamp() -> float:
    """H / pi in the middle of the floor."""
    page = baked().pages[0]
    half = len(page) // 2
    return float(page[half - 1 : half + 1, half - 1 : half + 1].mean(dtype=np.float64))


POINT = 0.633257
"""H / pi 2 m below a point of 100 W."""
SOFT = 1 / (1 + 0.5**2 / HEIGHT**2)
"""What a radius of 0.5 m leaves of it on the axis."""
SQUARE = 2.33887
"""H / pi 2 m below a square lamp of 1 m and 100 W."""

LAMPS: dict[str, tuple[Callable[[], None], float]] = {
    "point": (lambda: add_lamp("POINT", 100, shadow_soft_size=0), POINT),
    "soft point": (lambda: add_lamp("POINT", 100, shadow_soft_size=0.5), POINT * SOFT),
    "narrow spot": (lambda: add_lamp("SPOT", 100, shadow_soft_size=0, spot_size=0.3), POINT),
    "wide spot": (lambda: add_lamp("SPOT", 100, shadow_soft_size=0, spot_size=2.8), POINT),
    "sun": (lambda: add_lamp("SUN", 3, angle=0), 3 / math.pi),
    "wide sun": (lambda: add_lamp("SUN", 3, angle=0.5), 3 / math.pi),
    "square": (lambda: add_lamp("AREA", 100, shape="SQUARE", size=1), SQUARE),
    "square of a scaled object": (lambda: add_lamp("AREA", 100, 2.0, shape="SQUARE", size=0.5), SQUARE),
}


@pytest.mark.parametrize("name", LAMPS)
def test_a_lamp_of_so_many_watts_over_an_open_floor(name: str) -> None:
    add_floor()
    make, expected = LAMPS[name]
    make()
    assert below_the_lamp() == pytest.approx(expected, rel=0.005)


@pytest.mark.skipif(bpy.app.version < (4, 5), reason="lamps have no exposure before Blender 4.5")
def test_exposure_doubles_the_power_at_every_step() -> None:
    add_floor()
    add_lamp("POINT", 100, shadow_soft_size=0, exposure=1.5)
    assert below_the_lamp() == pytest.approx(2**1.5 * POINT, rel=0.005)


@pytest.mark.skipif(bpy.app.version < (4, 5), reason="lamps are always normalised before Blender 4.5")
def test_without_normalizing_an_area_lamp_has_radiance_p_over_pi_whatever_its_size() -> None:
    add_floor()
    add_lamp("AREA", 25, shape="SQUARE", size=1, normalize=False)
    assert below_the_lamp() == pytest.approx(SQUARE / 4, rel=0.005)


def test_an_emission_shader_of_strength_s_has_radiance_s() -> None:
    add_floor()
    bpy.ops.mesh.primitive_plane_add(size=1, location=(0, 0, HEIGHT))
    bpy.context.object.data.materials.append(material(0, 100 / math.pi))
    page = baked(page_size=128)
    mesh = page.atlas.uv[0]
    low, high = (np.round(f(mesh.reshape(-1, 2), 0) * 128).astype(int) for f in (np.min, np.max))
    x, y = (low + high) // 2
    assert page.pages[0][y - 1 : y + 1, x - 1 : x + 1].mean() == pytest.approx(SQUARE, rel=0.005)


def test_a_world_of_strength_1_gives_an_irradiance_of_pi() -> None:
    add_floor()
    world = bpy.context.scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 1
    assert np.abs(baked().pages[0] - 1).max() < 0.002


@pytest.mark.parametrize(("reflectance", "expected"), [(0.5, 2.0), (0.9, 10.0)])
def test_a_furnace_of_emission_1_has_the_radiance_one_over_absorption(reflectance: float, expected: float) -> None:
    bpy.ops.mesh.primitive_cube_add(size=2)
    bpy.context.object.data.flip_normals()
    bpy.context.object.data.materials.append(material(reflectance, 1))
    page = baked(tolerance=1e-7).pages[0]
    assert np.abs(1 + reflectance * page - expected).max() < 1e-5 * expected


def test_an_integrating_sphere_of_100_w_has_a_radiance_of_2_533() -> None:
    """R = 1 m and rho = 0.5; of Cycles it is known that it finds 2.5373."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, radius=1)
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.flip_normals()
    bpy.context.object.data.materials.append(material(0.5))
    add_lamp("POINT", 100, shadow_soft_size=0)
    bpy.data.objects["Lamp"].location = (0, 0, 0)
    radiance = 0.5 * baked(page_size=256, quality="high").pages[0]
    assert radiance.mean(dtype=np.float64) == pytest.approx(2.5330, rel=0.005)
    assert np.abs(radiance / 2.5330 - 1).max() < 0.01


def test_a_sphere_of_varying_emission_and_reflectance_is_lit_evenly() -> None:
    """H = sum(A E) / sum(A (1 - rho)), whatever shines where: from any point of a sphere all parts count by area.

    On these 96 x 48 flat faces the mean is 0.012 % less, by their form factors, and places differ by 0.7 %.
    """
    segments = 96
    bpy.ops.mesh.primitive_uv_sphere_add(segments=segments, ring_count=segments // 2, radius=1)
    sphere = bpy.context.object
    bpy.ops.object.shade_smooth()
    sphere.data.flip_normals()
    kinds = [(0.2, 0.0), (0.8, 0.0), (0.5, 1.0), (0.6, 3.0)]
    for reflectance, strength in kinds:
        sphere.data.materials.append(material(reflectance, strength))
    place = np.array([face.center for face in sphere.data.polygons])
    # stripes by where faces are: their order differs from run to run
    stripe = np.floor(np.arctan2(place[:, 1], place[:, 0]) * (segments / (2 * math.pi))).astype(int) % 2
    chosen = np.where(place[:, 0] > 0.3, 0, np.where(place[:, 2] > 0, 1, 2 + stripe)).astype(np.int32)
    sphere.data.polygons.foreach_set("material_index", chosen)
    area = np.array([face.area for face in sphere.data.polygons])
    reflectance, strength = np.array(kinds)[chosen].T
    expected = (area @ strength) / (area @ (1 - reflectance))
    page = baked(page_size=256, quality="high").pages[0]
    assert page.mean(dtype=np.float64) == pytest.approx(expected, rel=0.003)
    assert page.std() < 0.008 * expected  # 0.6 %
    assert np.abs(page / expected - 1).max() < 0.1  # 0.08, in the stripes: rays tell what they throw on themselves
