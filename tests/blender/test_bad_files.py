# SPDX-License-Identifier: GPL-3.0-or-later
"""Bad files, names that are taken, folders that can't be written to and full disks: FAULTS' catalogue of files."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy
import pytest

from radiosity_addon import cli
from tests.blender.bad_scenes import Captured, add_lamp, add_mesh, refused, save, spoken, tree
from tests.blender.datablocks import differences, snapshot

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")  # NumPy's warnings would reach the user


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    add_mesh("Floor")
    add_lamp()
    return save(tmp_path)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99], ids=["empty", "half", "but its end"])
@pytest.mark.parametrize("verb", ["bake", "revert", "info"])
def test_a_file_cut_short_is_an_error_that_names_it(
    share: float, verb: str, scene: Path, tmp_path: Path, capsys: Captured
) -> None:
    cut = tmp_path / "cut.blend"
    cut.write_bytes(scene.read_bytes()[: int(share * scene.stat().st_size)])
    before = tree(tmp_path)
    words = [] if verb == "info" else ["-o", str(tmp_path / "lit.blend")]
    capsys.readouterr()
    assert cli.main([verb, str(cut), *words]) == 1
    (line,) = spoken(capsys, "error")
    assert str(cut) in line
    assert tree(tmp_path) == before


@pytest.mark.parametrize(
    ("output", "make", "named"),
    [
        ("lit.blend", "lit.blend/", "lit.blend: a folder has this name"),
        ("in.blend/lit.blend", "", "in.blend: it is a file, not a folder"),
        ("lit.blend", "lit_textures", "lit_textures: it is a file, not a folder"),
        ("lit.blend", "lit_textures/lit_radiosity_1.exr/", "lit_radiosity_1.exr: a folder has this name"),
    ],
    ids=["output is a folder", "folder is a file", "textures are a file", "page is a folder"],
)
def test_a_name_that_is_taken_is_an_error(
    output: str, make: str, named: str, scene: Path, tmp_path: Path, capsys: Captured
) -> None:
    if make.endswith("/"):
        (tmp_path / make).mkdir(parents=True)
    elif make:
        (tmp_path / make).write_text("kept")
    assert named in refused(scene, tmp_path / output, capsys)


def test_a_folder_in_the_place_of_a_file_is_told_before_anything_is_baked(
    scene: Path, tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lit.blend").mkdir()
    monkeypatch.setattr("radiosity_addon.blender.headless.commands.bake_scene", lambda *_: 1 / 0)
    assert "a folder has this name" in refused(scene, tmp_path / "lit.blend", capsys)


@pytest.mark.parametrize(
    "words",
    [["--report", "in.blend"], ["--report", "lit.blend"], ["--report", "lit.png", "--render", "lit.png"]],
    ids=["scene", "output", "picture"],
)
def test_a_file_never_replaces_another_one_of_its_bake(
    words: list[str], scene: Path, tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    line = refused(scene, tmp_path / "lit.blend", capsys, *words)
    assert "another file of this bake" in line
    assert words[-1] in line


def mounted(folder: Path, options: str) -> Iterator[Path]:
    if sys.platform != "linux" or os.geteuid() != 0:
        pytest.skip("mounting a disk needs root on Linux")
    folder.mkdir()
    command = [shutil.which("mount") or "mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"a disk can't be mounted here: {done.stderr.strip()}")
    yield folder
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)  # lets go of files on it
    subprocess.run(["umount", str(folder)], check=True)


@pytest.fixture
def read_only(tmp_path: Path) -> Iterator[Path]:
    yield from mounted(tmp_path / "read only", "ro")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    yield from mounted(tmp_path / "small", "size=4m")


@pytest.mark.parametrize("words", [[], ["--textures"], ["--report"], ["--render"]], ids=lambda words: " ".join(words))
def test_a_folder_that_may_not_be_written_to_is_an_error(
    words: list[str], scene: Path, read_only: Path, tmp_path: Path, capsys: Captured
) -> None:
    ending = {"--report": "report.json", "--render": "lit.png"}
    given = [*words, read_only / ending.get(words[0], "pages")] if words else []
    line = refused(scene, (tmp_path if words else read_only) / "lit.blend", capsys, *given)
    assert "read only" in line
    assert "may write" in line


def test_a_full_disk_is_reported_by_the_operator_and_old_pages_are_kept(small_disk: Path) -> None:
    add_mesh("Floor")
    add_lamp()
    settings = bpy.context.scene.radiosity
    settings.page_size, settings.quality = 64, "draft"
    save(small_disk)
    assert bpy.ops.radiosity.bake() == {"FINISHED"}
    bpy.ops.wm.save_mainfile()
    free = os.statvfs(small_disk)
    (small_disk / "filler").write_bytes(bytes(free.f_bavail * free.f_frsize))
    before, files = snapshot(), tree(small_disk)
    with pytest.raises(RuntimeError, match=r"[Ff]ree some space"):
        bpy.ops.radiosity.bake()
    assert differences(before, snapshot()) == []
    assert tree(small_disk) == files


def test_a_file_of_a_newer_blender_is_baked_with_a_warning(tmp_path: Path, scene: Path, capsys: Captured) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(scene), compress=False)
    head, rest = scene.read_bytes()[:20], scene.read_bytes()[20:]
    digits = re.search(rb"v(\d+)", head)[1]
    newer = str(int(digits) + 100).zfill(len(digits)).encode()
    scene.write_bytes(head.replace(b"v" + digits, b"v" + newer) + rest)
    assert cli.main(["bake", str(scene), "-o", str(tmp_path / "lit.blend"), "--page-size", "16"]) == 0
    assert any("was written by Blender" in line for line in spoken(capsys, "warning"))
