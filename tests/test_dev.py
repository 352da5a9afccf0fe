# SPDX-License-Identifier: GPL-3.0-or-later
"""The helper script keeps its promises about interpreters and about what fails a test run."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

import dev

THIS = "{}.{}".format(*sys.version_info)


class Steps:
    """Stands in for running a command: notes each and answers with the exit code of the first word that matches."""

    def __init__(self, codes: dict[str, int]) -> None:
        self.codes = codes
        self.ran: list[str] = []

    def __call__(self, command: Sequence[object], limit: float | None = None, log: Path | None = None) -> int:
        words = " ".join(str(word) for word in command)
        self.ran.append(words)
        return next((code for text, code in self.codes.items() if text in words), 0)


@pytest.fixture
def run_tests(monkeypatch: pytest.MonkeyPatch):
    """`dev.test` with these Pythons installed and these exit codes, as the pair (exit code, commands)."""

    def run(
        installed: set[str], codes: dict[str, int], in_ci: bool = False, words: Sequence[str] = ("-k", "word")
    ) -> tuple[int, list[str]]:
        steps = Steps(codes)
        monkeypatch.setattr(dev, "call", steps)
        monkeypatch.setattr(dev, "find_interpreter", lambda version: Path(version) if version in installed else None)
        monkeypatch.setattr(dev, "environment", lambda interpreter: Path(f"python-{interpreter[0]}"))
        monkeypatch.setenv("CI", "true" if in_ci else "")
        return dev.test(None, list(words)), steps.ran

    return run


def test_all_green_is_zero_and_pytest_runs_on_both_with_the_callers_arguments(run_tests) -> None:
    code, ran = run_tests({"3.13", "3.11"}, {})
    assert code == 0
    assert sorted(line for line in ran if "pytest" in line) == [
        "python-3.11 -m pytest -k word",
        "python-3.13 -m pytest -k word",
    ]


def test_the_desktop_is_tested_last_and_alone(run_tests) -> None:
    _, ran = run_tests({"3.13", "3.11"}, {}, words=())
    assert ran[-2:] == ["python-3.13 -m pytest tests/desktop", "python-3.11 -m pytest tests/desktop"]
    assert sum("--ignore=tests/desktop" in line for line in ran[:-2]) == 2
    assert sum(line.endswith("-m pytest tests/accuracy") for line in ran[:-2]) == 2, "what the others leave out"
    assert sum("--ignore=tests/accuracy" in line for line in ran[:-2]) == 2


def test_steps_run_side_by_side(tmp_path: Path) -> None:
    """Each waits for what the other does: one after the other they would never end."""
    wait = "import pathlib, sys, time\npathlib.Path(sys.argv[1]).touch()\n"
    wait += "while not pathlib.Path(sys.argv[2]).exists(): time.sleep(0.01)\nsys.exit(int(sys.argv[3]))"
    a, b = tmp_path / "a", tmp_path / "b"
    steps = {"one": [sys.executable, "-c", wait, a, b, 0], "other": [sys.executable, "-c", wait, b, a, 7]}
    assert [code for code, _ in dev.side_by_side(steps).values()] == [0, 7]


def test_what_a_step_beside_the_first_says_is_shown_in_the_end(capfd: pytest.CaptureFixture[str]) -> None:
    dev.side_by_side({"first": [sys.executable, "-c", ""], "lint": [sys.executable, "-c", "print('a fault')"]})
    assert "\nlint:\na fault\n" in capfd.readouterr().out


@pytest.mark.parametrize(
    "step", ["ruff format", "ruff check", "mypy", "python-3.13 -m pytest", "python-3.11 -m pytest"]
)
def test_one_failing_step_fails_the_run_and_stops_no_other(run_tests, step: str) -> None:
    code, ran = run_tests({"3.13", "3.11"}, {step: 1})
    assert code == 1
    assert len(ran) == 5


def test_crash_by_signal_fails_the_run(run_tests) -> None:
    assert run_tests({"3.13", "3.11"}, {"python-3.13 -m pytest": -11})[0] == 1


def test_missing_python_is_skipped_with_its_reason(run_tests, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tests({"3.11"}, {})[0] == 0
    assert "pytest on Python 3.13: skipped, no CPython 3.13 found" in capsys.readouterr().out


def test_missing_python_fails_in_ci(run_tests) -> None:
    assert run_tests({"3.11"}, {}, in_ci=True)[0] == 1


def test_no_python_at_all_fails(run_tests) -> None:
    with pytest.raises(dev.Failure):
        run_tests(set(), {})


def test_an_older_blender_has_an_environment_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    steps = Steps({})
    monkeypatch.setattr(dev, "ROOT", tmp_path)
    monkeypatch.setattr(dev, "requirements", lambda version: tmp_path / "pins.txt")
    monkeypatch.setattr(dev, "find_interpreter", lambda version: Path(f"python{version}"))
    monkeypatch.setattr(dev, "call", steps)
    (tmp_path / "pins.txt").write_text("attrs==1\nbpy==4.5.15\nnumpy==1.26.4\n")
    (tmp_path / ".venv-bpy-4.2.23").mkdir()
    monkeypatch.setattr(dev.shutil, "rmtree", lambda *arguments, **options: None)
    assert dev.test_under("4.2", []) == 0
    assert (tmp_path / ".venv-bpy-4.2.23/requirements.txt").read_text() == "attrs==1\nbpy==4.2.23\nnumpy==1.26.4\n"
    assert steps.ran[0].startswith("python3.11 -m venv")
    assert steps.ran[-1].endswith("-m pytest tests/blender")


def test_running_interpreter_is_found_by_its_version() -> None:
    found = dev.find_interpreter(THIS)
    assert found is not None
    assert dev.probe([str(found)]) == (THIS, found)


def test_interpreter_of_another_version_or_none_is_passed_over(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    broken = tmp_path / "python"
    broken.write_text("not a program")
    commands = [[str(tmp_path / "absent")], [str(broken)], [sys.executable]]
    monkeypatch.setattr(dev, "candidates", lambda version: iter(commands))
    assert dev.find_interpreter("3.99") is None
    assert dev.find_interpreter(THIS) == Path(sys.executable)


def test_command_that_hangs_ends_at_its_limit() -> None:
    assert dev.call([sys.executable, "-c", "import time; time.sleep(60)"], limit=0.5) == 124


def test_words_behind_two_dashes_go_to_pytest() -> None:
    assert dev.split_arguments(["test", "--python", "3.11", "--", "-k", "a"]) == (
        ["test", "--python", "3.11"],
        ["-k", "a"],
    )
    assert dev.split_arguments(["test"]) == (["test"], [])
