# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages as EXR files, and files that appear together or not at all."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from concurrent.futures import CancelledError
from pathlib import Path

import numpy as np
import pytest

from radiosity_addon import files as files_module
from radiosity_addon.errors import OutputError
from radiosity_addon.files import LOCK_NAME, Transaction, safe_stem, write_text
from radiosity_addon.pages import image
from radiosity_addon.pages.page_files import page_paths

oiio = pytest.importorskip("OpenImageIO")
ROOT = Path(__file__).parents[1]


def write(path: Path, pixels: np.ndarray) -> int:
    with Transaction() as files:
        clamped = image.write_exr(path, pixels, files)
        files.commit()
    return clamped


def read(path: Path) -> np.ndarray:
    return oiio.ImageInput.open(str(path)).read_image(oiio.FLOAT)


def noise(size: int = 16) -> np.ndarray:
    return np.random.default_rng(1).random((size, size, 3), np.float32)


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_the_page_comes_back_as_half_floats_upside_down(tmp_path: Path) -> None:
    page = noise()
    assert write(tmp_path / "a.exr", page) == 0
    np.testing.assert_array_equal(read(tmp_path / "a.exr"), page[::-1].astype(np.float16).astype(np.float32))


def test_the_file_is_one_part_of_rgb_halfs_with_a_full_window_and_lossless(tmp_path: Path) -> None:
    write(tmp_path / "a.exr", noise())
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    assert tuple(spec.channelnames) == ("R", "G", "B")
    assert str(spec.format) == "half"
    assert spec["compression"] == "zip"
    assert spec["oiio:subimages"] in (None, 1)
    assert (spec.x, spec.y, spec.width, spec.height) == (0, 0, 16, 16)
    assert (spec.full_x, spec.full_y, spec.full_width, spec.full_height) == (0, 0, 16, 16)


def test_values_that_half_floats_cannot_hold_are_clamped_and_counted(tmp_path: Path) -> None:
    page = noise()
    page[0, 0] = np.nan, np.inf, -np.inf
    page[1, 1] = 1e6, 65504.0, -1e6
    assert write(tmp_path / "a.exr", page) == 5
    found = read(tmp_path / "a.exr")[::-1]
    np.testing.assert_array_equal(found[0, 0], [0.0, 65504.0, -65504.0])
    np.testing.assert_array_equal(found[1, 1], [65504.0, 65504.0, -65504.0])
    assert np.isfinite(found).all()


def test_a_name_in_unicode_is_written(tmp_path: Path) -> None:
    path = tmp_path / "Küche 夜_radiosity_1.exr"
    write(path, noise())
    assert names(tmp_path) == {path.name}


def test_a_file_that_comes_back_different_replaces_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.exr"
    path.write_bytes(b"old")
    monkeypatch.setattr(image, "_same", lambda *_: False)
    with pytest.raises(OutputError, match=r"a\.exr"):
        write(path, noise())
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == {"a.exr"}


def test_a_folder_with_the_name_of_a_page_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "a.exr").mkdir()
    with pytest.raises(OutputError, match="a folder has this name"):
        write(tmp_path / "a.exr", noise())


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    if sys.platform != "linux" or os.geteuid() != 0:
        pytest.skip("mounting a tiny disk needs root on Linux")
    folder = tmp_path / "tiny"
    folder.mkdir()
    mounted = subprocess.run(
        [shutil.which("mount") or "mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    if mounted.returncode:
        pytest.skip(f"a tiny disk can't be mounted here: {mounted.stderr.strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_is_an_error_and_the_old_file_is_kept(tiny_disk: Path) -> None:
    path = tiny_disk / "a.exr"
    write(path, noise(16))
    old = path.read_bytes()
    with pytest.raises(OutputError, match=r"a\.exr"):
        write(path, noise(256))
    assert path.read_bytes() == old
    assert names(tiny_disk) == {"a.exr"}


def test_a_full_disk_is_an_error_for_text_too(tiny_disk: Path) -> None:
    with pytest.raises(OutputError, match="no space left"), Transaction() as files:
        write_text(tiny_disk / "a.json", "x" * 100_000, files)
    assert names(tiny_disk) == set()


def test_a_kill_while_writing_keeps_the_old_file_and_the_next_bake_cleans_up(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write(path, noise())
    old = path.read_bytes()
    script = f"""
        from pathlib import Path
        from radiosity_addon.files import Transaction
        with Transaction() as files:
            files.begin(Path({str(path)!r})).write_bytes(b"half a fi")
            print("ready", flush=True)
            input()
    """
    writer = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(script)],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert writer.stdout is not None
    assert writer.stdout.readline() == "ready\n"
    with Transaction() as files:
        files.make_folder(tmp_path)
    assert len(names(tmp_path)) == 2, "a living bake's file is not stale"
    writer.kill()
    writer.communicate()
    assert path.read_bytes() == old
    assert len(names(tmp_path)) == 2
    with Transaction() as files:
        files.make_folder(tmp_path)
    assert names(tmp_path) == {"a.exr"}


def test_leaving_without_commit_brings_back_what_was_there(tmp_path: Path) -> None:
    old, new, folder = tmp_path / "old.txt", tmp_path / "new.txt", tmp_path / "a" / "b"
    old.write_text("old")
    with Transaction() as files:
        files.make_folder(folder)
        files.lock(folder)
        write_text(old, "changed", files)
        write_text(old, "changed twice", files)
        write_text(new, "new", files)
        write_text(folder / "c.txt", "new", files)
        assert old.read_text() == "changed twice"
    assert old.read_text() == "old"
    assert names(tmp_path) == {"old.txt"}


def test_commit_keeps_all_and_leaves_no_temporary_files(tmp_path: Path) -> None:
    old = tmp_path / "old.txt"
    old.write_text("old")
    with Transaction() as files:
        files.make_folder(tmp_path / "a")
        files.lock(tmp_path / "a")
        write_text(old, "changed", files)
        files.commit()
    assert old.read_text() == "changed"
    assert names(tmp_path) == {"old.txt", "a"}
    assert names(tmp_path / "a") == set()


def test_without_hard_links_the_old_file_is_copied_aside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_links(*_: object) -> None:
        raise OSError("not supported")

    monkeypatch.setattr(files_module.os, "link", no_links)
    (tmp_path / "a.txt").write_text("old")
    with Transaction() as files:
        write_text(tmp_path / "a.txt", "new", files)
    assert (tmp_path / "a.txt").read_text() == "old"
    assert names(tmp_path) == {"a.txt"}


def test_two_bakes_into_one_folder_are_an_error(tmp_path: Path) -> None:
    with Transaction() as first:
        first.lock(tmp_path)
        with Transaction() as second, pytest.raises(OutputError, match="another bake is writing"):
            second.lock(tmp_path)
    with Transaction() as third:
        third.lock(tmp_path)
    assert names(tmp_path) == set()


def test_the_lock_of_a_dead_process_is_taken_over(tmp_path: Path) -> None:
    script = f"""
        import os, signal
        from pathlib import Path
        from radiosity_addon.files import Transaction
        files = Transaction()
        files.lock(Path({str(tmp_path)!r}))
        os.kill(os.getpid(), {int(getattr(signal, "SIGKILL", signal.SIGTERM))})
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(script)], cwd=ROOT, check=False)
    assert names(tmp_path) == {LOCK_NAME}
    with Transaction() as files:
        files.lock(tmp_path)
    assert names(tmp_path) == set()


def test_a_folder_below_a_file_is_an_error_that_names_it(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match=re.escape(str(tmp_path / "file"))), Transaction() as files:
        files.make_folder(tmp_path / "file" / "textures")
    with pytest.raises(OutputError, match="not a folder"), Transaction() as files:
        files.make_folder(tmp_path / "file")


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder that nobody may write to")
def test_a_folder_that_nobody_may_write_to_is_an_error() -> None:
    with pytest.raises(OutputError, match="/proc"), Transaction() as files:
        files.make_folder(Path("/proc"))


def test_names_that_file_systems_refuse_are_made_safe_and_stay_apart() -> None:
    assert safe_stem("Küche 2") == "Küche 2"
    assert re.fullmatch(r"a_b-[0-9a-f]{6}", safe_stem("a/b"))
    assert safe_stem("a/b") != safe_stem("a\\b")
    assert re.fullmatch(r"_\.\._etc-[0-9a-f]{6}", safe_stem("../../etc"))
    assert "\0" not in safe_stem("a\0b")
    assert safe_stem("...").startswith("scene-")
    assert len(safe_stem("夜" * 300).encode()) < 200
    assert safe_stem("夜" * 300) != safe_stem("夜" * 301)


def test_pages_are_numbered_from_one(tmp_path: Path) -> None:
    assert [path.name for path in page_paths(tmp_path, "room", 2)] == ["room_radiosity_1.exr", "room_radiosity_2.exr"]


def test_a_file_that_is_being_written_when_its_transaction_is_left_goes_when_it_is_done(tmp_path):
    target = tmp_path / "page.bin"
    with Transaction() as files:
        temporary = files.begin(target)
    temporary.write_bytes(b"by a thread that has not noticed")
    with pytest.raises(CancelledError):
        files.place(target)
    with pytest.raises(CancelledError):
        files.begin(target)
    assert list(tmp_path.iterdir()) == []


# as on Windows, where nobody can move or remove a file that somebody has open


def sharing_violation() -> PermissionError:
    error = PermissionError(13, "The process cannot access the file because it is being used by another process")
    error.winerror = 32
    return error


def test_a_file_that_a_virus_scanner_has_open_is_moved_when_it_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace, refusals = os.replace, [sharing_violation(), sharing_violation()]

    def replace_later(source: Path, target: Path) -> None:
        if refusals:
            raise refusals.pop()
        replace(source, target)

    monkeypatch.setattr(files_module, "SHARING_SECONDS", 5.0)
    monkeypatch.setattr(files_module.os, "replace", replace_later)
    with Transaction() as files:
        write_text(tmp_path / "a.txt", "new", files)
        files.commit()
    assert not refusals
    assert (tmp_path / "a.txt").read_text() == "new"


def test_who_has_a_file_open_is_asked_to_close_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(source: Path, target: Path) -> None:
        raise sharing_violation()

    (tmp_path / "a.txt").write_text("old")
    monkeypatch.setattr(files_module.os, "replace", refuse)
    with pytest.raises(OutputError, match=r"used by another process. Close programs"), Transaction() as files:
        write_text(tmp_path / "a.txt", "new", files)
    assert (tmp_path / "a.txt").read_text() == "old"
    assert names(tmp_path) == {"a.txt"}


def test_a_backup_that_somebody_has_open_is_left_for_the_next_bake(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.txt").write_text("old")
    unlink = Path.unlink

    def refuse(path: Path, missing_ok: bool = False) -> None:
        raise sharing_violation()

    with Transaction() as files:
        write_text(tmp_path / "a.txt", "new", files)
        monkeypatch.setattr(Path, "unlink", refuse)
        files.commit()
        monkeypatch.setattr(Path, "unlink", unlink)
    assert (tmp_path / "a.txt").read_text() == "new"
