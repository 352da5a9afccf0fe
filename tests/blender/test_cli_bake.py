# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line on real .blend files, from the scene to files and back."""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
import pytest

from radiosity_addon import cli
from radiosity_addon.files import Transaction
from radiosity_addon.settings import BakeSettings

oiio = pytest.importorskip("OpenImageIO")
ROOT = Path(__file__).parents[2]
SUN = 3.0
"""W/m2; on an open floor H / pi is SUN / pi."""
FAST = ["--page-size", "64", "--quality", "draft"]


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A floor and a block beside it under a sun that stands overhead, saved as room.blend."""
    return save_room(tmp_path / "in" / "room.blend")


def save_room(path: Path) -> Path:
    bpy.ops.mesh.primitive_plane_add(size=4)
    bpy.context.object.name = "Floor"
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 8, -2))
    bpy.context.object.name = "Block"
    bpy.ops.mesh.primitive_plane_add(size=1, location=(0, -8, 0))
    bpy.context.object.name = "Hidden"
    bpy.context.object.hide_render = True
    lamp = bpy.data.lights.new("Sun", "SUN")
    lamp.energy, lamp.angle = SUN, 0
    bpy.context.collection.objects.link(bpy.data.objects.new("Sun", lamp))
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = 96, 64
    path.parent.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def run(*words: object) -> int:
    return cli.main([str(word) for word in words])


def tree(folder: Path) -> dict[str, str]:
    """All files below a folder, hidden ones too, and what is in them."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "folder"
        for path in folder.rglob("*")
    }


def open_file(path: Path) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(path))


def test_light_that_pictures_can_not_hold_is_told(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    words = ["--format", "png8", "--exposure", "4"]
    assert run("bake", scene, "-o", tmp_path / "lit.blend", *FAST, *words) == 0
    warned = capsys.readouterr().err
    assert "of the texels lay outside of what png8 in Linear Rec.709 holds; intent relative fitted them" in warned


def test_a_format_of_pictures_comes_with_its_recipe_and_looks_alike(scene: Path, tmp_path: Path) -> None:
    pictures = {}
    for words in (["--format", "exr"], ["--format", "rgbm"], ["--format", "png16", "--exposure", "-2"]):
        out = tmp_path / words[1]
        assert run("bake", scene, "-o", out / "lit.blend", "--render", out / "room.png", *FAST, *words) == 0
        pictures[words[1]] = oiio.ImageInput.open(str(out / "room.png")).read_image(oiio.FLOAT)
        open_file(out / "lit.blend")
        assert run("revert", out / "lit.blend", "-o", out / "plain.blend") == 0
        open_file(out / "plain.blend")
        assert not bpy.data.node_groups, "the group that decodes goes with the bake"
    assert not (tmp_path / "exr" / "lit_textures" / "lit_radiosity.json").exists()
    recipe = json.loads((tmp_path / "rgbm" / "lit_textures" / "lit_radiosity.json").read_text())
    assert (recipe["format"], recipe["pages"]) == ("rgbm", ["lit_radiosity_1.png"])
    np.testing.assert_allclose(pictures["rgbm"], pictures["exr"], rtol=0, atol=2 / 255)
    np.testing.assert_allclose(pictures["png16"], pictures["exr"], rtol=0, atol=2 / 255)


@pytest.mark.parametrize(("words", "suffixes"), [([], {".exr"}), (["--format", "rgbm"], {".png", ".json"})])
def test_light_groups_get_files_of_their_own(words: list[str], suffixes: set[str], scene: Path, tmp_path: Path) -> None:
    open_file(scene)
    bpy.ops.scene.view_layer_add_lightgroup(name="Key: 1")
    bpy.data.objects["Sun"].lightgroup = "Key: 1"
    bpy.ops.wm.save_mainfile()
    out = tmp_path / "out"
    line = ["bake", scene, "-o", out / "lit.blend", "--report", out / "lit.json", "--light-groups", *FAST, *words]
    assert run(*line) == 0
    listed = json.loads((out / "lit.json").read_text())["light_groups"]
    assert set(listed) == {"", "Key: 1"}
    written = {path.name for path in (out / "lit_textures").iterdir()}
    assert {Path(path).name for paths in listed.values() for path in paths} < written
    assert {Path(name).suffix for name in written} == suffixes
    assert len(written) == 3 * len(suffixes)
    if not words:
        pages = [read_page(out / paths[0]) for paths in listed.values()]
        whole = read_page(out / "lit_textures" / "lit_radiosity_1.exr")
        np.testing.assert_allclose(sum(pages), whole, rtol=0, atol=2e-3)
        assert [page.max() > 0 for page in pages] == [False, True], "there is no world"


def read_page(path: Path) -> np.ndarray:
    return oiio.ImageInput.open(str(path)).read_image(oiio.FLOAT)[..., :3]


def test_a_bake_writes_the_lit_scene_its_page_the_report_and_a_picture(scene: Path, tmp_path: Path) -> None:
    source = scene.read_bytes()
    out = tmp_path / "out"
    report_path, picture = out / "report.json", out / "room.png"
    assert run("bake", scene, "-o", out / "lit.blend", "--report", report_path, "--render", picture, *FAST) == 0
    assert scene.read_bytes() == source
    assert set(tree(out)) == {
        "lit.blend",
        "lit_textures",
        "lit_textures/lit_radiosity_1.exr",
        "report.json",
        "room.png",
    }

    report = json.loads(report_path.read_text())
    assert list(report) == [
        "scene", "folder", "settings", "working_space", "pages", "files", "light_groups", "objects", "skipped",
        "stages", "seconds", "texels", "patches", "rays", "tracing", "ended_in", "window", "residual", "residuals",
        "estimated_error", "balance", "light", "renders", "warnings",
    ]  # fmt: skip
    assert report["pages"][0]["file"] == "lit_textures/lit_radiosity_1.exr"
    assert report["pages"][0]["size"] == [64, 64]
    assert {(row["source"], row["object"], row["page"]) for row in report["objects"]} == {
        ("Floor", "Floor", 0),
        ("Block", "Block", 0),
    }
    assert sum(row["texels"] for row in report["objects"]) == report["texels"] > 0
    assert [row["object"] for row in report["skipped"]] == ["Hidden"]
    assert sum(stage["seconds"] for stage in report["stages"]) == pytest.approx(report["seconds"], rel=0.2, abs=0.2)
    assert sum(stage["rays"] for stage in report["stages"]) == report["rays"]
    assert 0 <= report["residual"] <= BakeSettings.tolerance
    assert report["residuals"][-1] == report["residual"]
    balance = report["balance"]
    assert balance["emitted"] == pytest.approx(balance["absorbed"] + balance["escaped"] + balance["unshot"])
    assert report["light"]["brightest"] == pytest.approx(SUN / np.pi, rel=0.05)
    assert set(report["pages"][0]["maps"]) == {"coverage", "density", "error", "outside"}
    assert report["renders"] == {"before": None, "after": "room.png"}
    assert run("report", report_path, "-o", tmp_path / "page.html") == 0
    assert (tmp_path / "page.html").stat().st_size > 50_000

    open_file(out / "lit.blend")
    image = bpy.data.images[report["pages"][0]["image"]]
    assert image.filepath == "//lit_textures/lit_radiosity_1.exr"
    assert tuple(image.size) == (64, 64)
    assert "Radiosity" in bpy.data.objects["Floor"].data.uv_layers
    assert "Radiosity" not in bpy.data.objects["Hidden"].data.uv_layers
    assert bpy.context.scene.camera is None, "the fitted camera is not saved"
    assert picture_is_lit(picture)


def picture_is_lit(path: Path) -> bool:
    pixels = oiio.ImageInput.open(str(path)).read_image(oiio.FLOAT)
    return pixels.ndim == 3 and bool((pixels.max(axis=2) > 0.2).mean() > 0.05)


def test_an_open_floor_under_the_sun_holds_its_irradiance_over_pi(scene: Path, tmp_path: Path) -> None:
    report_path = tmp_path / "report.json"
    assert run("bake", scene, "-o", tmp_path / "lit.blend", "--report", report_path, "--object", "Floor", *FAST) == 0
    report = json.loads(report_path.read_text())
    assert [row["object"] for row in report["objects"]] == ["Floor"]
    assert {row["object"] for row in report["skipped"]} == {"Block", "Hidden"}
    page = oiio.ImageInput.open(str(tmp_path / report["pages"][0]["file"])).read_image(oiio.FLOAT)
    np.testing.assert_allclose(page, SUN / math.pi, rtol=0.005)


def test_the_settings_saved_in_the_scene_hold_where_none_are_given(tmp_path: Path) -> None:
    bpy.context.scene.radiosity.page_size = 32
    bpy.context.scene.radiosity.quality = "draft"
    bpy.context.scene.radiosity.write_back = "uv"
    scene = save_room(tmp_path / "room.blend")
    report_path = tmp_path / "report.json"
    assert run("bake", scene, "-o", tmp_path / "lit.blend", "--report", report_path) == 0
    assert json.loads(report_path.read_text())["pages"][0]["size"] == [32, 32]
    assert not bpy.data.materials


def test_uv_write_back_leaves_materials_alone(scene: Path, tmp_path: Path) -> None:
    assert run("bake", scene, "-o", tmp_path / "lit.blend", "--write-back", "uv", *FAST) == 0
    open_file(tmp_path / "lit.blend")
    assert not bpy.data.materials
    assert "Radiosity" in bpy.data.objects["Block"].data.uv_layers


def test_the_scene_itself_is_written_when_o_names_it(scene: Path) -> None:
    assert run("bake", scene, "-o", scene, *FAST) == 0
    open_file(scene)
    assert "Radiosity" in bpy.data.objects["Floor"].data.uv_layers


def test_baking_again_replaces_the_earlier_bake(scene: Path, tmp_path: Path) -> None:
    lit = tmp_path / "lit.blend"
    assert run("bake", scene, "-o", lit, *FAST) == 0
    assert run("bake", lit, "-o", lit, *FAST) == 0
    assert set(tree(tmp_path)) == {
        "in", "in/room.blend", "lit.blend", "lit_textures", "lit_textures/lit_radiosity_1.exr",
    }  # fmt: skip
    open_file(lit)
    assert len([image for image in bpy.data.images if image.is_float]) == 1
    assert list(bpy.data.objects["Floor"].data.uv_layers.keys()).count("Radiosity") == 1


def test_paths_to_textures_hold_from_another_folder(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    picture = bpy.data.images.new("Carpet", 4, 4)
    picture.filepath_raw = str(tmp_path / "in" / "carpet.png")
    picture.file_format = "PNG"
    picture.save()
    picture.source = "FILE"
    picture.use_fake_user = True
    save_room(tmp_path / "in" / "room.blend")
    picture.filepath = "//carpet.png"
    bpy.ops.wm.save_mainfile()
    assert run("bake", tmp_path / "in" / "room.blend", "-o", tmp_path / "out" / "lit.blend", *FAST) == 0
    open_file(tmp_path / "out" / "lit.blend")
    assert Path(bpy.path.abspath(bpy.data.images["Carpet"].filepath)).resolve() == tmp_path / "in" / "carpet.png"


def test_revert_brings_the_scene_back(scene: Path, tmp_path: Path) -> None:
    assert run("bake", scene, "-o", tmp_path / "lit.blend", *FAST) == 0
    assert run("revert", tmp_path / "lit.blend", "-o", tmp_path / "back.blend") == 0
    open_file(tmp_path / "back.blend")
    assert not bpy.data.materials
    assert not [image for image in bpy.data.images if image.is_float]
    assert list(bpy.data.objects["Floor"].data.uv_layers.keys()) == ["UVMap"]


def test_info_lists_what_is_baked_and_what_not_and_why(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", scene, "--page-size", "64") == 0
    text = capsys.readouterr().out
    assert "Floor: page 1" in text
    assert "Hidden: it is hidden in renders" in text
    assert "1 page of 64 x 64" in text
    assert "GB of memory" in text


def fails(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """The one line that a failing command prints."""
    assert run(*words) == 1
    lines = capsys.readouterr().err.splitlines()
    ours = [line for line in lines if line.startswith("radiosity:")]
    assert len(ours) == 1, lines
    assert "Traceback" not in "".join(lines)
    return ours[0]


def test_a_broken_file_is_an_error_that_names_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = tmp_path / "broken.blend"
    broken.write_bytes(b"BLENDER-v405 and then nothing")
    assert str(broken) in fails(capsys, "bake", broken, "-o", tmp_path / "lit.blend")
    assert set(tree(tmp_path)) == {"broken.blend"}


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--object", "Wall"], "Wall"),
        (["--page-size", "3"], "Page size"),
        (["--density", "-1"], "Density"),
        (["--textures", "in/room.blend"], "room.blend"),
        (["--report", "in/room.blend/report.json"], "room.blend"),
        (["--report", "in"], "in: a folder has this name"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_what_can_not_be_done_is_an_error_and_leaves_nothing_behind(
    words: list[str],
    named: str,
    scene: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    before = tree(tmp_path)
    assert named in fails(capsys, "bake", scene, "-o", "out/lit.blend", *FAST, *words)
    assert tree(tmp_path) == before


def test_a_scene_without_a_surface_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "empty.blend"))
    fails(capsys, "bake", tmp_path / "empty.blend", "-o", tmp_path / "lit.blend")
    assert set(tree(tmp_path)) == {"empty.blend"}


def test_two_bakes_into_one_folder_are_an_error(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "textures").mkdir()
    with Transaction() as other:
        other.lock(tmp_path / "textures")
        words = ["bake", scene, "-o", tmp_path / "lit.blend", "--textures", tmp_path / "textures", *FAST]
        assert "another bake" in fails(capsys, *words)


def test_reverting_what_is_not_baked_is_an_error(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "there is no bake" in fails(capsys, "revert", scene, "-o", tmp_path / "back.blend")
    assert not (tmp_path / "back.blend").exists()


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    if sys.platform != "linux" or os.geteuid() != 0:
        pytest.skip("mounting a tiny disk needs root on Linux")
    folder = tmp_path / "tiny"
    folder.mkdir()
    command = [shutil.which("mount") or "mount", "-t", "tmpfs", "-o", "size=56k", "tmpfs", str(folder)]
    mounted = subprocess.run(command, capture_output=True, text=True, check=False)
    if mounted.returncode:
        pytest.skip(f"a tiny disk can't be mounted here: {mounted.stderr.strip()}")
    yield folder
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)  # lets go of files on it
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_is_an_error_and_all_old_files_are_kept(
    scene: Path, tiny_disk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tiny_disk / "lit.blend").write_bytes(b"old scene")
    (tiny_disk / "lit_textures").mkdir()
    (tiny_disk / "lit_textures" / "lit_radiosity_1.exr").write_bytes(b"old page")
    before = tree(tiny_disk)
    assert "lit.blend" in fails(capsys, "bake", scene, "-o", tiny_disk / "lit.blend", *FAST)
    assert tree(tiny_disk) == before


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is sent otherwise on Windows")
def test_ctrl_c_exits_with_130_and_leaves_nothing_behind(scene: Path, tmp_path: Path) -> None:
    before = tree(tmp_path)
    command = [sys.executable, "-m", "radiosity_addon", "bake", scene, "-o", tmp_path / "out" / "lit.blend"]
    child = subprocess.Popen(
        [*command, "--page-size", "1024", "--quality", "high"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert child.stdout is not None
    for line in child.stdout:
        if "Direct light" in line:
            break
    os.killpg(child.pid, signal.SIGINT)  # as a terminal does
    _, errors = child.communicate(timeout=60)
    assert child.returncode == 130, errors
    assert errors == "radiosity: interrupted; all files are as they were\n"
    assert tree(tmp_path) == before
