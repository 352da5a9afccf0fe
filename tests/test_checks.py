# SPDX-License-Identifier: GPL-3.0-or-later
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radiosity_addon.checks import check
from radiosity_addon.scene import Material, Mesh, PointLight, Scene
from radiosity_addon.settings import BakeSettings
from tests.shapes import sheet

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def box(name: str, size: float = 1.0, at: tuple[float, float, float] = (0, 0, 0), inward: bool = False) -> Mesh:
    """A closed cube of edge 2 `size`, its faces outward unless told otherwise."""
    triangles = np.array([triangle for a, b, c, d in QUADS for triangle in ((a, b, c), (a, c, d))], np.int32)
    if inward:
        triangles = np.ascontiguousarray(triangles[:, ::-1])
    return meshed(name, CORNERS * size + np.array(at), triangles)


def quad(name: str, size: float = 1.0, uv: np.ndarray | None = None) -> Mesh:
    corners = np.array([[0, 0, 0], [size, 0, 0], [size, size, 0], [0, size, 0]], np.float64)
    return replace(meshed(name, corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)), uv=uv)


def meshed(name: str, vertices: np.ndarray, triangles: np.ndarray) -> Mesh:
    count = len(triangles)
    normals = np.tile(np.array([0, 0, 1], np.float32), (count, 3, 1))
    corner = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    polygon = np.arange(count, dtype=np.int32)
    return Mesh(name, vertices, triangles, normals, np.zeros(count, np.int32), polygon, corner)


def lamp(*position: float) -> PointLight:
    return PointLight("Lamp", (1.0, 1.0, 1.0), position)


def found(*meshes: Mesh, lights: tuple[PointLight, ...] = (), **settings: object) -> list[tuple[str, str]]:
    scene = Scene(meshes, (Material("Grey"),), lights)
    return [(finding.severity, finding.subject) for finding in check(scene, BakeSettings(**settings))]


def test_a_plain_scene_has_nothing_wrong() -> None:
    assert found(box("Box", at=(5, 0, 0)), box("Other", at=(9, 0, 0)), lights=(lamp(7, 0, 0),)) == []


def test_a_box_turned_inside_out_is_named_and_can_be_flipped_as_a_whole() -> None:
    scene = Scene((box("Right"), box("Wrong", at=(5, 0, 0), inward=True)), (Material("Grey"),))
    (finding,) = check(scene, BakeSettings())
    assert (finding.severity, finding.subject, finding.inside_out) == ("warning", "Wrong", True)


def test_a_ground_that_goes_through_its_middle_makes_no_room_of_a_box() -> None:
    ground = replace(quad("Ground", 8), vertices=quad("Ground", 8).vertices - [4, 4, 0])
    assert found(ground, box("Wrong", inward=True)) == [("warning", "Wrong")]


def test_a_part_that_is_inside_out_can_not_be_mended_by_flipping_the_whole() -> None:
    right, wrong = box("Chair"), box("Chair", at=(5, 0, 0), inward=True)
    both = meshed(
        "Chair",
        np.concatenate([right.vertices, wrong.vertices]),
        np.concatenate([right.triangles, wrong.triangles + 8]),
    )
    (finding,) = check(Scene((both,), (Material("Grey"),)), BakeSettings())
    assert (finding.subject, finding.inside_out) == ("Chair", False)


@pytest.mark.parametrize("inside", [{"lights": (lamp(0, 0, 1),)}, {"meshes": (box("Table", 1.0),)}])
def test_a_room_that_is_seen_from_within_is_right(inside: dict) -> None:
    assert found(box("Room", 3, inward=True), *inside.get("meshes", ()), lights=inside.get("lights", ())) == []


def test_the_hollow_of_a_ball_with_thickness_is_right() -> None:
    outer, inner = box("Shell", 2), box("Shell", 1.9, inward=True)
    shell = meshed(
        "Shell",
        np.concatenate([outer.vertices, inner.vertices]),
        np.concatenate([outer.triangles, inner.triangles + 8]),
    )
    assert found(shell) == []


def test_a_room_whose_faces_point_outward_is_named() -> None:
    assert found(box("Room", 3), box("Table"), lights=(lamp(0, 0, 2),)) == [("warning", "Room")]


def test_a_bulb_around_a_lamp_is_no_room() -> None:
    tables = [box(name, 0.5, at=(x, 0, 0)) for name, x in (("Table", 1), ("Desk", 3))]
    assert found(box("Bulb", 0.1), *tables, lights=(lamp(0, 0, 0),)) == []


def test_two_sided_objects_may_face_either_way() -> None:
    assert found(replace(box("Wrong", inward=True), two_sided=True)) == []


def test_a_kept_uv_map_that_overlaps_stops_the_bake() -> None:
    square = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], np.float32)
    assert found(quad("Fine", uv=square)) == []
    assert found(quad("Bad", uv=square[[0, 0]])) == [("error", "Bad")]


def test_an_object_that_leaves_nothing_to_others_is_named_while_one_page_is_filled() -> None:
    ground, chair = quad("Ground", 100), quad("Chair")
    assert found(ground, chair) == [("info", "Ground")]
    assert found(ground, chair, density=4.0) == []
    assert found(replace(ground, density=0.01), chair) == [], "its density multiplier counts"
    assert found(ground) == [], "there is no other"
    assert found(box("Room", 3, inward=True), box("Table")) == [], "no ground reaches further than all else"


def test_what_is_too_large_for_a_page_at_a_density_is_named() -> None:
    assert found(quad("Ground", 100), density=20.0, page_size=1024) == [("error", "Ground")]
    assert found(quad("Ground", 100), density=10.0, page_size=1024) == []


def test_folds_too_narrow_for_their_texels_are_named_with_the_density_that_they_need() -> None:
    """At 100 texels a metre a cylinder of 10 mm turns by 57 degrees within a texel, by half of that if it is finer."""
    floor, curtain = quad("Floor"), sheet("Curtain", 0.01, 3.0)
    fixed = {"density": 100.0, "page_size": 2048}
    assert found(floor, curtain, **fixed, fine_folds=True) == []
    scene = Scene((floor, curtain), (Material("Grey"),))
    (finding,) = check(scene, BakeSettings(**fixed, fine_folds=False))
    assert (finding.severity, finding.subject) == ("info", "Curtain")
    assert "57 degrees" in finding.text
    assert "Finer Folds, or set its Density to 3.8," in finding.text
    mended = replace(curtain, density=3.8)
    assert found(floor, mended, **fixed, fine_folds=False) == []


def test_folds_of_hardly_any_size_and_threads_are_not_worth_a_word() -> None:
    fixed = {"density": 100.0, "page_size": 2048, "fine_folds": False}
    assert found(quad("Floor", 4), sheet("Arm", 0.01, 3.0), **fixed) == []
    assert found(quad("Floor", 0.5), sheet("Thread", 0.001, 3.0, length=9.0), **fixed) == []
