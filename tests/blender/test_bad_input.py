# SPDX-License-Identifier: GPL-3.0-or-later
"""Bad input on the way from a .blend to files: one line that says what and what to do, and everything left as found."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.bad_scenes import SQUARE, SUN, Captured, add_lamp, add_mesh, bake, refused, save, spoken
from tests.blender.datablocks import snapshot

oiio = pytest.importorskip("OpenImageIO")


pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")  # NumPy's warnings would reach the user


NAN = math.nan


INF = math.inf


TRIANGLE = [(0, 1, 2)]


def add_glow(strength: float) -> bpy.types.Object:
    """A square above the floor that faces down."""
    thing = add_mesh("Bad", SQUARE[::-1], location=(0, 0, 1))
    node = principled(thing, "Glow")
    node.inputs["Emission Color"].default_value = (1, 1, 1, 1)
    node.inputs["Emission Strength"].default_value = strength
    return thing


def principled(thing: bpy.types.Object, name: str) -> bpy.types.Node:
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    thing.data.materials.append(material)
    return next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")


def baked(folder: Path, capsys: Captured) -> tuple[dict, np.ndarray, list[str]]:
    """The report, the page and the warnings of a bake of what is open."""
    report = folder / "out" / "report.json"
    capsys.readouterr()
    assert bake(save(folder), folder / "out" / "lit.blend", "--report", report) == 0
    found = json.loads(report.read_text())
    page = oiio.ImageInput.open(str(report.parent / found["pages"][0]["file"])).read_image(oiio.FLOAT)
    assert np.isfinite(page).all()
    return found, page, spoken(capsys, "warning")


# objects that are left out


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: add_mesh("Bad", [(0, 0, NAN), (1, 0, 0), (0, 1, 0)], TRIANGLE), "not finite"),
        (lambda: add_mesh("Bad", [(0, INF, 0), (1, 0, 0), (0, 1, 0)], TRIANGLE), "not finite"),
        (lambda: add_mesh("Bad", scale=(0, 0, 0)), "scale is zero"),
        (lambda: add_mesh("Bad", scale=(1, 1, 0)), "scale is zero"),
        (lambda: add_mesh("Bad", faces=[]), "no faces"),
        (lambda: add_mesh("Bad", [], []), "no faces"),
        (lambda: add_mesh("Bad", [(0, 0, 0), (1, 0, 0), (2, 0, 0)], TRIANGLE), "no area"),
    ],
    ids=["NaN", "infinity", "no scale", "flat scale", "no faces", "no vertices", "no area"],
)
def test_a_bad_object_is_left_out_by_name_and_the_rest_is_lit(
    make: Callable[[], object], reason: str, tmp_path: Path, capsys: Captured
) -> None:
    add_mesh("Floor")
    add_lamp()
    make()
    report, page, warnings = baked(tmp_path, capsys)
    assert [row["object"] for row in report["objects"]] == ["Floor"]
    (skipped,) = report["skipped"]
    assert skipped["object"] == "Bad"
    assert reason in skipped["reason"]
    assert any("Bad is left out" in line and reason in line for line in warnings)
    np.testing.assert_allclose(page, SUN / math.pi, rtol=0.005)


def test_an_error_says_why_the_only_object_can_not_be_baked(tmp_path: Path, capsys: Captured) -> None:
    add_mesh("Bad", [(0, 0, NAN), (1, 0, 0), (0, 1, 0)], TRIANGLE)
    line = refused(save(tmp_path), tmp_path / "lit.blend", capsys)
    assert "Bad: it has vertices that are not finite" in line
    assert "Add a mesh" in line


# what stops a bake


def with_uv_maps(*names: str) -> None:
    thing = add_mesh("Bad")
    for name in names:
        thing.data.uv_layers.new(name=name)


def bad_world() -> None:
    world = bpy.context.scene.world = bpy.data.worlds.new("Bad")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = NAN


def bad_colour() -> None:
    principled(add_mesh("Wall"), "Bad").inputs["Base Color"].default_value = (NAN, 1, 1, 1)


STOPS: dict[str, tuple[Callable[[], object], str, str]] = {
    "too far": (
        lambda: add_mesh("Bad", [(1e16, 0, 0), (1, 0, 0), (0, 1, 0)], TRIANGLE),
        "1e+15 m",
        "Move or scale it closer",
    ),
    "NaN transform": (lambda: add_mesh("Bad", location=(NAN, 0, 0)), "transform", "Clear its transform"),
    "NaN lamp transform": (lambda: setattr(add_lamp(name="Bad"), "location", (0, NAN, 0)), "transform", "Clear"),
    "infinite power": (lambda: add_lamp("POINT", "Bad", INF), "power", "finite power"),
    "NaN power": (lambda: add_lamp("AREA", "Bad", NAN), "power", "finite power"),
    "NaN lamp colour": (lambda: add_lamp("POINT", "Bad", 100, color=(NAN, 1, 1)), "power", "colour"),
    "NaN lamp radius": (lambda: add_lamp("POINT", "Bad", 100, shadow_soft_size=NAN), "size", "finite size"),
    "NaN lamp size": (lambda: add_lamp("AREA", "Bad", 100, size=NAN), "size", "finite size"),
    "NaN emission": (lambda: add_glow(NAN), "emission", "finite"),
    "NaN colour": (bad_colour, "reflectance", "finite"),
    "NaN world": (bad_world, "light is not a finite number", "finite"),
    "our uv map": (lambda: with_uv_maps("Radiosity"), "named 'Radiosity'", "Rename"),
    "eight uv maps": (lambda: with_uv_maps(*"abcdefgh"), "all 8 uv maps", "Remove one"),
    "NaN density": (lambda: setattr(add_mesh("Bad").radiosity, "density", NAN), "density", "positive number"),
}


@pytest.mark.parametrize("name", STOPS)
def test_what_stops_a_bake_is_one_line_with_name_cause_and_remedy(name: str, tmp_path: Path, capsys: Captured) -> None:
    add_mesh("Floor")
    add_lamp()
    make, cause, remedy = STOPS[name]
    make()
    line = refused(save(tmp_path), tmp_path / "out" / "lit.blend", capsys)
    assert "Bad" in line or "Glow" in line
    assert cause in line
    assert remedy in line


@pytest.mark.parametrize("name", STOPS)
def test_what_stops_a_bake_is_reported_by_the_operator_which_changes_nothing(name: str) -> None:
    add_mesh("Floor")
    add_lamp()
    make, cause, _ = STOPS[name]
    make()
    bpy.context.scene.radiosity.page_size, bpy.context.scene.radiosity.quality = 64, "draft"
    bpy.context.view_layer.update()
    before = repr(snapshot())
    with pytest.raises(RuntimeError) as error:
        bpy.ops.radiosity.bake()
    assert cause in str(error.value)
    assert "Traceback" not in str(error.value)
    assert repr(snapshot()) == before, "compared as text, because NaN differs from itself"


@pytest.mark.parametrize("kind", ["objects", "meshes"])
def test_what_a_missing_library_held_is_an_error(kind: str, tmp_path: Path, capsys: Captured) -> None:
    library = tmp_path / "library.blend"
    bpy.data.libraries.write(str(library), {getattr(add_mesh("Bad"), "data" if kind == "meshes" else "id_data")})
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, into):
        setattr(into, kind, ["Bad"])
    (linked,) = getattr(into, kind)
    thing = linked if kind == "objects" else bpy.data.objects.new("Bad", linked)
    bpy.context.scene.collection.objects.link(thing)
    add_mesh("Floor")
    add_lamp()
    scene = save(tmp_path)
    assert "linked from another file" in refused(scene, tmp_path / "lit.blend", capsys)
    library.unlink()
    assert "Bad: its library file is missing" in refused(scene, tmp_path / "lit.blend", capsys)


# what is said, and baked all the same


def test_a_scene_without_light_is_black_and_says_so(tmp_path: Path, capsys: Captured) -> None:
    add_mesh("Floor")
    _, page, warnings = baked(tmp_path, capsys)
    assert page.max() == 0
    assert any("no light" in line and "black" in line for line in warnings)


def test_light_beyond_half_floats_is_clamped_and_says_so(tmp_path: Path, capsys: Captured) -> None:
    add_mesh("Floor")
    add_glow(1e30)
    _, page, warnings = baked(tmp_path, capsys)
    assert page.max() == np.finfo(np.float16).max
    assert any("half floats" in line for line in warnings)


def test_negative_power_takes_light_away_and_says_so(tmp_path: Path, capsys: Captured) -> None:
    add_mesh("Floor")
    add_lamp()
    add_lamp(name="Bad", energy=-1)
    _, page, warnings = baked(tmp_path, capsys)
    np.testing.assert_allclose(page, (SUN - 1) / math.pi, rtol=0.005)
    assert any("Bad" in line and "negative" in line for line in warnings)


def test_a_lamp_without_area_is_dark_and_says_so(tmp_path: Path, capsys: Captured) -> None:
    add_mesh("Floor")
    add_lamp()
    add_lamp("AREA", "Bad", 100).scale = (0, 1, 1)
    _, page, warnings = baked(tmp_path, capsys)
    np.testing.assert_allclose(page, SUN / math.pi, rtol=0.005)
    assert any("Bad" in line and "no area" in line for line in warnings)


def test_a_missing_image_is_named_and_the_bake_goes_on(tmp_path: Path, capsys: Captured) -> None:
    add_lamp()
    node = principled(add_mesh("Floor"), "Carpet")
    image = bpy.data.images.new("gone", 4, 4)
    image.source, image.filepath = "FILE", "//gone.png"
    texture = node.id_data.nodes.new("ShaderNodeTexImage")
    texture.image = image
    node.id_data.links.new(texture.outputs["Color"], node.inputs["Base Color"])
    _, page, warnings = baked(tmp_path, capsys)
    np.testing.assert_allclose(page, SUN / math.pi, rtol=0.005)
    assert any("Carpet" in line for line in warnings)


# odd, and right


def with_empty_slot() -> None:
    add_mesh("Odd").data.materials.append(None)


def with_index_beyond_slots() -> None:
    thing = add_mesh("Odd")
    principled(thing, "Grey")
    thing.data.polygons[0].material_index = 7


def without_nodes() -> None:
    thing = add_mesh("Odd")
    thing.data.materials.append(bpy.data.materials.new("Bare"))


ODD: dict[str, Callable[[], object]] = {
    "no slot": lambda: add_mesh("Odd"),
    "empty slot": with_empty_slot,
    "index beyond the slots": with_index_beyond_slots,
    "no nodes": without_nodes,
    "concave": lambda: add_mesh("Odd", [(0, 0, 0), (2, 0, 0), (2, 2, 0), (1.5, 0.5, 0)]),
    "loose vertices": lambda: add_mesh("Odd", [*SQUARE, (5, 5, 5), (6, 6, 6)]),
    "sliver": lambda: add_mesh("Odd", [(0, 0, 0), (5, 0, 0), (5, 1e-4, 0)], TRIANGLE),
    "1e-8 m": lambda: add_mesh("Odd", [tuple(1e-8 * x for x in corner) for corner in SQUARE]),
    "1e6 m away": lambda: add_mesh("Odd", location=(1e6, -1e6, 1e6)),
    "mirrored": lambda: add_mesh("Odd", scale=(-2, 0.5, 1)),
}


@pytest.mark.parametrize("name", ODD)
def test_an_odd_surface_gets_the_light_of_the_sun(name: str, tmp_path: Path, capsys: Captured) -> None:
    ODD[name]()
    add_lamp()
    report, page, _ = baked(tmp_path, capsys)
    assert [row["object"] for row in report["objects"]] == ["Odd"]
    np.testing.assert_allclose(page, SUN / math.pi, rtol=0.005)


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        ([(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2, 3)]),
        ([*SQUARE, *SQUARE], [(0, 1, 2, 3), (4, 5, 6, 7)]),
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, -1, 0)], [(0, 1, 2), (0, 1, 3), (0, 1, 4)]),
    ],
    ids=["bow tie", "faces twice", "three faces at an edge"],
)
def test_a_broken_surface_is_lit_somehow(vertices: list, faces: list, tmp_path: Path, capsys: Captured) -> None:
    add_mesh("Broken", vertices, faces)
    add_lamp()
    _, page, _ = baked(tmp_path, capsys)
    assert 0.9 * SUN / math.pi < page.max() < 1.3 * SUN / math.pi


def test_names_that_only_differ_by_case_or_hold_anything_at_all_are_kept_apart(
    tmp_path: Path, capsys: Captured
) -> None:
    names = ["FLOOR", "floor", "ü/..\\:*? ", "\u5e8a"]
    for row, name in enumerate(names):
        add_mesh(name, location=(0, 3 * row, 0))
    add_lamp()
    report, page, _ = baked(tmp_path, capsys)
    assert sorted(row["source"] for row in report["objects"]) == sorted(names)
    np.testing.assert_allclose(page, SUN / math.pi, rtol=0.005)
