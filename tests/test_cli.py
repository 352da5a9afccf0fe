# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line before Blender comes in: arguments, exit codes, progress."""

from __future__ import annotations

import importlib.util
import io
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from radiosity_addon import cli, progress
from radiosity_addon.errors import SceneError
from radiosity_addon.progress import Meter, describe, duration, short_count
from radiosity_addon.stages import Progress

ROOT = Path(__file__).parents[1]


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[tuple[cli.Verb, bool]]:
    """What would have been done, and whether its scene was open already."""
    calls: list[tuple[cli.Verb, bool]] = []
    monkeypatch.setattr(cli, "_run", lambda verb, is_open, meter: calls.append((verb, is_open)))
    return calls


@pytest.fixture
def blend(tmp_path: Path) -> Path:
    path = tmp_path / "room.blend"
    path.touch()
    return path


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["paint"],
        ["bake"],
        ["bake", "room.blend"],
        ["bake", "room.blend", "-o", "folder"],
        ["bake", "room.blend", "-o", "out.blend", "--quality", "best"],
        ["bake", "room.blend", "-o", "out.blend", "--density", "fine"],
        ["bake", "room.blend", "-o", "out.blend", "--render", "out.jpg"],
        ["revert", "room.blend"],
        ["info"],
    ],
    ids=" ".join,
)
def test_wrong_arguments_exit_with_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(arguments) == 2
    assert "usage: radiosity" in capsys.readouterr().err


def test_help_exits_with_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["bake", "--help"]) == 0
    assert "--write-back" in capsys.readouterr().out


def test_a_missing_file_is_named_in_one_line_with_exit_code_1(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["bake", "missing.blend", "-o", "out.blend"]) == 1
    error = capsys.readouterr().err
    assert error == "radiosity: error: missing.blend: there is no such file. Give the path of a .blend file.\n"


def test_a_folder_is_no_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["info", str(tmp_path)]) == 1
    assert "it is a folder" in capsys.readouterr().err


def test_every_option_arrives(blend: Path, ran: list[tuple[cli.Verb, bool]]) -> None:
    words = "--threads 2 --quiet --textures t --density 32 --page-size 512 --quality high --solver jacobi"
    more = (
        "--write-back uv --tolerance 1e-4 --bounces 3 --report r.json --render p.png --object Wall Floor --object Lamp"
    )
    form = "--format rgbm --depth float --compression piz --exposure -1.5 --transfer linear --target-space p3"
    last = "--intent perceptual --form-factors area --subdivisions 2 --no-fine-folds"
    given = " ".join([words, more, form, last])
    assert cli.main(["bake", str(blend), "-o", "out.blend", *given.split()]) == 0
    here = Path.cwd()
    assert ran == [
        (
            cli.Verb(
                name="bake",
                scene=blend,
                output=here / "out.blend",
                textures=here / "t",
                report=here / "r.json",
                render=here / "p.png",
                density=32.0,
                fine_folds=False,
                page_size=512,
                quality="high",
                form_factors="area",
                subdivisions=2,
                solver="jacobi",
                tolerance=1e-4,
                bounces=3,
                threads=2,
                write_back="uv",
                format="rgbm",
                depth="float",
                compression="piz",
                exposure=-1.5,
                transfer="linear",
                space="p3",
                intent="perceptual",
                object=("Wall", "Floor", "Lamp"),
                quiet=True,
            ),
            False,
        )
    ]


def test_what_is_not_given_stays_open_for_the_scene_to_say(blend: Path, ran: list[tuple[cli.Verb, bool]]) -> None:
    assert cli.main(["bake", str(blend), "-o", "out.blend"]) == 0
    assert ran == [(cli.Verb(name="bake", scene=blend, output=Path.cwd() / "out.blend"), False)]


def test_within_blender_the_open_file_is_the_scene(blend: Path, ran: list[tuple[cli.Verb, bool]]) -> None:
    assert cli.main(["info"], opened=str(blend)) == 0
    assert ran == [(cli.Verb(name="info", scene=blend), True)]


def test_within_blender_a_file_after_the_verb_goes_first(
    blend: Path, tmp_path: Path, ran: list[tuple[cli.Verb, bool]]
) -> None:
    other = tmp_path / "other.blend"
    other.touch()
    assert cli.main(["info", str(other)], opened=str(blend)) == 0
    assert ran == [(cli.Verb(name="info", scene=other), False)]


def test_within_blender_without_any_file_there_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["info"], opened="") == 1
    assert "no .blend file is open" in capsys.readouterr().err


def failing_with(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(cli, "_run", fail)


def test_a_bake_error_is_one_line(
    blend: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failing_with(SceneError("Wall", "it is bent", "Straighten it"), monkeypatch)
    assert cli.main(["info", str(blend)]) == 1
    assert capsys.readouterr().err == "radiosity: error: Wall: it is bent. Straighten it.\n"


def test_a_defect_of_ours_is_one_line_that_says_so(
    blend: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv(cli.TRACEBACK_VARIABLE, raising=False)
    failing_with(KeyError("page\nmore"), monkeypatch)
    assert cli.main(["info", str(blend)]) == 1
    error = capsys.readouterr().err
    assert error.startswith("radiosity: error: Internal error: KeyError")
    assert error.count("\n") == 1


def test_the_traceback_of_a_defect_is_shown_on_request(
    blend: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(cli.TRACEBACK_VARIABLE, "1")
    failing_with(KeyError("page"), monkeypatch)
    assert cli.main(["info", str(blend)]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_too_little_memory_is_an_error_with_a_remedy(
    blend: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failing_with(MemoryError(), monkeypatch)
    assert cli.main(["info", str(blend)]) == 1
    assert "Lower the page size or the density" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="signals are sent otherwise on Windows")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_exits_with_130_and_gives_the_signal_back(
    number: signal.Signals, blend: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli, "_run", lambda *_: os.kill(os.getpid(), number))
    before = signal.getsignal(number)
    assert cli.main(["info", str(blend)]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert signal.getsignal(number) == before


def test_without_bpy_the_error_says_how_to_get_it(
    blend: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    assert cli.main(["info", str(blend)]) == 1
    assert "pip install ." in capsys.readouterr().err


def test_the_package_runs_as_a_module() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "radiosity_addon", "--help"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    assert "bake" in done.stdout


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_says_stage_share_residual_rays_and_time_left() -> None:
    shown = describe(Progress("Gather", 0.25, 0.0012, 3_000_000), seconds=2.0)
    assert shown == " 25% Gather, residual 0.0012, 1.5M rays/s, 0:06 left"


def test_progress_leaves_out_what_is_not_known_yet() -> None:
    assert describe(Progress("Unwrap", 0.0), seconds=0.5) == "  0% Unwrap"
    assert describe(Progress("Gather", 0.25, 0.0012, 3_000_000), seconds=2.0, brief=True) == " 25% Gather, 0:06 left"


def test_without_a_terminal_progress_is_one_plain_line_a_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    meter = Meter(stream)
    for stage, share in (("Unwrap", 0.0), ("Unwrap", 0.05), ("Gather", 0.5), ("Gather", 0.6)):
        meter.show(Progress(stage, share))
    assert [line.split()[1] for line in stream.getvalue().splitlines()] == ["Unwrap", "Gather"]
    assert "\r" not in stream.getvalue()


def test_a_long_stage_says_again_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    now = [0.0]
    monkeypatch.setattr(progress.time, "perf_counter", lambda: now[0])
    meter = Meter(stream)
    for second in range(25):
        now[0] = float(second)
        meter.show(Progress("Gather", second / 100))
    assert len(stream.getvalue().splitlines()) == 3


def test_on_a_terminal_one_line_is_redrawn_within_its_width(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    stream = Terminal()
    meter = Meter(stream)
    meter.show(Progress("Unwrap", 0.5))
    meter.show(Progress("A stage of a rather long name", 0.5))
    meter.clear()
    assert "\n" not in stream.getvalue()
    drawn = stream.getvalue().split("\r")
    assert drawn[1].startswith("[############------------]  50% Unwrap")
    assert max(len(line) for line in drawn) == 39
    assert drawn[-2].strip() == "", "the line is wiped at the end"


def test_quiet_prints_nothing() -> None:
    stream = Terminal()
    meter = Meter(stream, quiet=True)
    meter.show(Progress("Unwrap", 0.5))
    meter.say("Saved")
    meter.clear()
    assert stream.getvalue() == ""


@pytest.mark.parametrize(("number", "shown"), [(950, "950"), (12_500, "12.5k"), (3.2e6, "3.2M"), (4e9, "4.0G")])
def test_counts_are_short(number: float, shown: str) -> None:
    assert short_count(number) == shown


@pytest.mark.parametrize(("seconds", "shown"), [(7.4, "0:07"), (750, "12:30"), (3723, "1:02:03")])
def test_durations_read_as_clocks(seconds: float, shown: str) -> None:
    assert duration(seconds) == shown


def test_passes_are_numbers_from_one_on(blend: Path, ran: list[tuple[cli.Verb, bool]]) -> None:
    assert cli.main(["passes", str(blend), "--passes", "1,2,30", "--subdivisions", "0,2", "--picture", "s.png"]) == 0
    wanted = cli.Verb("passes", blend, solver="jacobi", passes=(1, 2, 30), splits=(0, 2), picture=Path.cwd() / "s.png")
    assert ran == [(wanted, False)]
    for wrong in ("0,1", "1;2", ""):
        assert cli.main(["passes", str(blend), "--passes", wrong, "--picture", "s.png"]) == 2
