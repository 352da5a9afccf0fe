# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake a sample, run the tests, measure, and build the release: `python3 dev.py --help`.

Standard library only, so that it runs on a fresh machine. What it needs beyond that it installs, pinned, into
environments beside this file (.venv-3.11, .venv-3.13).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent
PYTHONS = ("3.13", "3.11")
"""CPython versions that bpy is published for, the preferred one first: Blender 5.2 LTS and 4.5 LTS run on them."""
OTHER_BLENDERS = {"4.2": ("3.11", "4.2.23")}
"""Blenders that are tested when asked for: their Python and the bpy that takes the place of the pinned one."""
STEP_LIMIT = 20 * 60
"""Seconds after which a step of the tests, such as pytest on one Python, is taken to hang."""
ACCURACY = "tests/accuracy"
"""Whole scenes against Cycles take as long as all else: they run beside it."""
DESKTOP = "tests/desktop"
"""These tests measure how long a window stands still: nothing else runs beside them."""
BUNDLED = ("embreex", "OpenImageIO", "xatlas")
"""Packages that the extension brings along; numpy is Blender's own."""
WHEEL_TAGS = {
    "linux-x64": [f"manylinux_2_{minor}_x86_64" for minor in range(28, 16, -1)] + ["manylinux2014_x86_64"],
    "windows-x64": ["win_amd64"],
    "macos-arm64": ["macosx_14_0_arm64", "macosx_14_0_universal2"],
    "macos-x64": ["macosx_14_0_x86_64", "macosx_14_0_universal2"],
}
"""pip's platform tags for each of Blender's platforms."""
WHEEL_ENDS = {
    "linux-x64": r"manylinux\w*_x86_64",
    "windows-x64": "win_amd64",
    "macos-arm64": r"macosx_\d+_\d+_(arm64|universal2)",
    "macos-x64": r"macosx_\d+_\d+_(x86_64|universal2)",
}
"""How the names of their wheels end."""
STAGED = ("__init__.py", "blender_manifest.toml", "LICENSE", "docs/manual", "presets", "radiosity_addon")
"""What an installed extension consists of, its wheels apart."""


class Failure(Exception):
    """A step that can't go on, said in words for the person at the terminal."""


def main() -> int:
    """Run one command; the exit code."""
    arguments, words = split_arguments(sys.argv[1:])
    parser = argparse.ArgumentParser(prog="dev.py", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    command = commands.add_parser("sample", help="bake a sample scene into out/sample/ and render a picture of it")
    command.add_argument("--scene", type=Path, default=ROOT / "sample_scenes/cornell_box.blend", metavar="FILE.blend")
    command.set_defaults(run=lambda options: sample(options.scene))

    command = commands.add_parser("test", help="lint, check types and test; what follows -- goes to pytest")
    command.add_argument("--python", choices=PYTHONS, help="test on this version only")
    command.add_argument("--blender", choices=OTHER_BLENDERS, help="tests/blender under this older Blender only")
    command.set_defaults(run=lambda o: test_under(o.blender, words) if o.blender else test(o.python, words))

    command = commands.add_parser("bench", help="run a script of benchmarks/; what follows -- goes to it")
    command.add_argument("name", nargs="?", default="speed", metavar="NAME", help="default: speed")
    command.set_defaults(run=lambda options: bench(options.name, words))

    command = commands.add_parser("release", help="build the extension's zip for each platform, wheels included")
    command.add_argument("--platform", choices=WHEEL_TAGS, action="append", help="only this one; may be repeated")
    command.add_argument("--extra-wheels", type=Path, metavar="FOLDER", help="bundle these wheels as well")
    command.add_argument("--output", type=Path, default=ROOT / "dist", metavar="FOLDER", help="default: dist/")
    command.set_defaults(run=lambda o: release(o.platform or list(WHEEL_TAGS), o.extra_wheels, o.output))

    options = parser.parse_args(arguments)
    try:
        return int(options.run(options))
    except Failure as failure:
        print(f"dev.py: {failure}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130


def split_arguments(arguments: list[str]) -> tuple[list[str], list[str]]:
    """Ours, and those after `--`."""
    if "--" not in arguments:
        return arguments, []
    cut = arguments.index("--")
    return arguments[:cut], arguments[cut + 1 :]


def sample(scene: Path) -> int:
    """Bake `scene` into out/sample/ and render it with the baked light."""
    if not scene.is_file():
        raise Failure(f"{scene}: no such file. The scenes to choose from are in {ROOT / 'sample_scenes'}.")
    python = environment(any_interpreter())
    folder = ROOT / "out" / "sample"
    folder.mkdir(parents=True, exist_ok=True)
    baked, picture, report = folder / scene.name, folder / f"{scene.stem}.png", folder / "report.json"
    written = ["-o", baked, "--textures", folder / "textures", "--report", report, "--render", picture]
    code = call([python, "-m", "radiosity_addon", "bake", scene.resolve(), *written])
    if code == 0:
        print(f"\nBaked scene:      {baked}\nLightmap pages:   {folder / 'textures'}")
        print(f"Report:           {report}\nRendered picture: {picture}")
    return code


def test(version: str | None, pytest_arguments: list[str]) -> int:
    """Run pytest on every Python beside format, lint and types, then the desktop tests alone; 0 if all passed."""
    pythons: dict[str, Path] = {}
    missing: list[str] = []
    for wanted in [version] if version else PYTHONS:
        interpreter = find_interpreter(wanted)
        if interpreter is None:
            missing.append(wanted)
        else:
            pythons[wanted] = environment((wanted, interpreter))
    if not pythons:
        raise Failure(f"found no CPython {' or '.join(missing)}. Install one, from python.org or with pyenv.")

    first = next(iter(pythons.values()))
    most = pytest_arguments or [f"--ignore={folder}" for folder in (ACCURACY, DESKTOP)]
    steps: dict[str, list[object]] = {}
    for wanted, python in pythons.items():
        steps[f"pytest on Python {wanted}"] = [python, "-m", "pytest", *most]
    for wanted, python in pythons.items() if not pytest_arguments else []:
        steps[f"{ACCURACY} on Python {wanted}"] = [python, "-m", "pytest", ACCURACY]
    steps["ruff format"] = [first, "-m", "ruff", "format", "--check", "."]
    steps["ruff check"] = [first, "-m", "ruff", "check", "."]
    steps["mypy"] = [first, "-m", "mypy"]
    results = side_by_side(steps)
    for wanted, python in pythons.items() if not pytest_arguments else []:
        results |= side_by_side({f"{DESKTOP} on Python {wanted}": [python, "-m", "pytest", DESKTOP]})

    verdicts = []
    for name, (code, seconds) in results.items():
        verdicts.append(f"{name}: {'passed' if code == 0 else f'FAILED with exit code {code}'}, {seconds:.0f} s")
    failed = any(code != 0 for code, _ in results.values())
    in_ci = os.environ.get("CI", "").lower() in ("1", "true", "yes")
    for wanted in missing:
        verdicts.append(f"pytest on Python {wanted}: {'FAILED' if in_ci else 'skipped'}, no CPython {wanted} found")
        failed |= in_ci
    print("", *verdicts, sep="\n")
    return int(failed)


def test_under(blender: str, pytest_arguments: list[str]) -> int:
    """Run pytest under a Blender that is not one of the usual two; its exit code."""
    version, bpy = OTHER_BLENDERS[blender]
    interpreter = find_interpreter(version)
    if interpreter is None:
        raise Failure(f"found no CPython {version}. Install one, from python.org or with pyenv.")
    python = environment((version, interpreter), bpy)
    return call([python, "-m", "pytest", *(pytest_arguments or ["tests/blender"])], limit=STEP_LIMIT)


def side_by_side(steps: Mapping[str, list[object]]) -> dict[str, tuple[int, float]]:
    """Run steps at once: exit code and seconds of each.

    The first one shows at once what it has to say, the others when all have ended.
    """
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(len(steps)) as pool:
        runs, logs = {}, {}
        for number, (name, command) in enumerate(steps.items()):
            logs[name] = Path(folder, f"{number}.log") if number else None
            runs[name] = pool.submit(timed, command, logs[name])
        results = {name: run.result() for name, run in runs.items()}
        for name, log in logs.items():
            if log is not None and log.is_file():
                print(f"\n{name}:", log.read_text(encoding="utf-8", errors="replace").rstrip(), sep="\n", flush=True)
    return results


def timed(command: list[object], log: Path | None) -> tuple[int, float]:
    """Exit code and seconds of a step of the tests, what it says written to `log` where one is given."""
    start = time.monotonic()
    code = call(command, limit=STEP_LIMIT, log=log)
    return code, time.monotonic() - start


def bench(name: str, arguments: list[str]) -> int:
    """Run one script of benchmarks/; its exit code."""
    known = {path.stem: path for path in sorted((ROOT / "benchmarks").glob("[!_]*.py"))}
    if name not in known:
        raise Failure(f"no benchmark {name}. There are: {', '.join(known)}.")
    return call([environment(any_interpreter()), known[name], *arguments])


def release(platforms: Sequence[str], extra_wheels: Path | None, output: Path) -> int:
    """Build one zip a platform into `output`: the repository's manifest, completed with wheels and platforms."""
    if extra_wheels is not None and not extra_wheels.is_dir():
        raise Failure(f"{extra_wheels}: no such folder.")
    python = environment(any_interpreter())
    with tempfile.TemporaryDirectory() as folder:
        stage = Path(folder) / "stage"
        for name in STAGED:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, stage / name, ignore=shutil.ignore_patterns("__pycache__", "*.pyc"))
            else:
                stage.mkdir(exist_ok=True)
                shutil.copy2(ROOT / name, stage / name)

        wheels = stage / "wheels"
        for platform in platforms:
            for version in PYTHONS:
                download_wheels(python, platform, version, wheels)
        for wheel in sorted(extra_wheels.glob("*.whl")) if extra_wheels else []:
            shutil.copy2(wheel, wheels)
        complete_manifest(
            stage / "blender_manifest.toml", platforms, sorted(path.name for path in wheels.glob("*.whl"))
        )

        output.mkdir(parents=True, exist_ok=True)
        tool = extension_tool(python)
        places = ["--source-dir", stage, "--output-dir", output.resolve()]
        code = call([python, tool, "build", "--split-platforms", *places])
    version = from_toml((ROOT / "blender_manifest.toml").read_bytes())["version"]
    for platform in platforms if code == 0 else []:
        archive = output / f"radiosity_addon-{version}-{platform.replace('-', '_')}.zip"
        faults = faults_of(archive, platform)
        if faults:
            raise Failure(f"{archive.name}: {'; '.join(faults)}.")
    return code


def faults_of(archive: Path, platform: str) -> list[str]:
    """What a built zip lacks: a wheel of each bundled package for its platform and each Python, in its manifest."""
    with zipfile.ZipFile(archive) as contents:
        inside = {name for name in contents.namelist() if name.endswith(".whl")}
        built = from_toml(contents.read("blender_manifest.toml"))["build"]["generated"]
    faults = [] if built["platforms"] == [platform] else [f"its manifest is for {built['platforms']}"]
    if {wheel.removeprefix("./") for wheel in built["wheels"]} != inside:
        faults.append("its manifest names other wheels than it holds")
    for package in BUNDLED:
        for python in PYTHONS:
            abi = f"cp{python.replace('.', '')}"
            name = rf"wheels/{package}-[^-]+-{abi}-{abi}-\S*{WHEEL_ENDS[platform]}\.whl"
            if not any(re.fullmatch(name, wheel, re.IGNORECASE) for wheel in inside):
                faults.append(f"no wheel of {package} for Python {python}")
    return faults


def from_toml(content: bytes) -> dict[str, Any]:
    """What a TOML file holds."""
    import tomllib  # from Python 3.11 on; older ones start this script, too

    return tomllib.loads(content.decode("utf-8"))


def download_wheels(python: Path, platform: str, version: str, folder: Path) -> None:
    """Put the bundled packages' wheels for one of Blender's platforms and one Python into `folder`."""
    pins = [line for line in requirements(version).read_text().splitlines() if line.split("==")[0] in BUNDLED]
    tags = [word for tag in WHEEL_TAGS[platform] for word in ("--platform", tag)]
    target = ["--only-binary=:all:", "--no-deps", "--implementation", "cp", "--python-version", version, *tags]
    print(f"dev.py: wheels for {platform}, Python {version}", flush=True)
    if call([python, "-m", "pip", "download", "--quiet", "--dest", folder, *target, *pins], shown=False):
        raise Failure(f"a wheel for {platform} and Python {version} could not be downloaded.")


def complete_manifest(manifest: Path, platforms: Sequence[str], wheels: Sequence[str]) -> None:
    """Add `platforms` and `wheels` above the manifest's first table."""
    text = manifest.read_text(encoding="utf-8")
    head, table, tail = text.partition("\n[")
    listed = json.dumps([f"./wheels/{name}" for name in wheels], indent=2)
    lines = f"\nplatforms = {json.dumps(list(platforms))}\nwheels = {listed}\n"
    manifest.write_text(head + lines + table + tail, encoding="utf-8")


def extension_tool(python: Path) -> Path:
    """Blender's own packer of extensions, inside the bpy wheel."""
    found = subprocess.run(
        [python, "-c", "import importlib.util as u; print(u.find_spec('bpy').submodule_search_locations[0])"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    tools = sorted(Path(found).glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    if not tools:
        raise Failure(f"no blender_ext.py under {found}.")
    return tools[-1]


def requirements(version: str) -> Path:
    """The pinned packages of one Python version."""
    return ROOT / "requirements" / f"python-{version}.txt"


def environment(interpreter: tuple[str, Path], bpy: str | None = None) -> Path:
    """The Python of an environment with everything that `requirements` pins; made anew when the pins change.

    With `bpy` it is an environment of its own, with this version of bpy in place of the pinned one.
    """
    version, base = interpreter
    pins = requirements(version).read_text(encoding="utf-8")
    folder = ROOT / f".venv-{version}"
    if bpy is not None:
        pins = re.sub(r"^bpy==.*$", f"bpy=={bpy}", pins, flags=re.MULTILINE)
        folder = ROOT / f".venv-bpy-{bpy}"
    key = hashlib.sha256(pins.encode()).hexdigest()
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    stamp = folder / "pins.sha256"
    if stamp.is_file() and stamp.read_text() == key and probe([str(python)]) is not None:
        return python
    print(f"dev.py: making {folder.name}, once", flush=True)
    shutil.rmtree(folder, ignore_errors=True)
    if call([base, "-m", "venv", folder]):
        raise Failure(f"{base} can't make a virtual environment. Install its venv module.")
    listed = folder / "requirements.txt"
    listed.write_text(pins, encoding="utf-8")
    if call([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--requirement", listed]):
        raise Failure(f"the packages of {requirements(version).name} could not be installed.")
    stamp.write_text(key)
    return python


def any_interpreter() -> tuple[str, Path]:
    """The first supported version that is found, and its interpreter."""
    for version in PYTHONS:
        interpreter = find_interpreter(version)
        if interpreter is not None:
            return version, interpreter
    raise Failure(f"found no CPython {' or '.join(PYTHONS)}. Install one, from python.org or with pyenv.")


def find_interpreter(version: str) -> Path | None:
    """A CPython of that version, found by running candidates."""
    for command in candidates(version):
        found = probe(command)
        if found is not None and found[0] == version:
            return found[1]
    return None


def candidates(version: str) -> Iterator[list[str]]:
    """Commands that may start a CPython of that version."""
    yield [sys.executable]
    for name in (f"python{version}", "python3", "python"):
        yield [name]
    yield ["py", f"-{version}"]
    roots = [os.environ.get("PYENV_ROOT"), output_of(["pyenv", "root"]), str(Path.home() / ".pyenv")]
    for root in dict.fromkeys(filter(None, roots)):
        for folder in sorted(Path(root, "versions").glob(f"{version}.*"), key=patch_number, reverse=True):
            yield [str(folder / ("python.exe" if os.name == "nt" else "bin/python"))]


def patch_number(folder: Path) -> int:
    """7 of a folder called 3.13.7; 0 of one that is called otherwise."""
    last = folder.name.split(".")[-1]
    return int(last) if last.isdigit() else 0


def probe(command: list[str]) -> tuple[str, Path] | None:
    """Version and path of the CPython that `command` starts, if it starts one that can make environments."""
    code = "import ensurepip, platform, sys; print(platform.python_implementation(), '%d.%d' % sys.version_info[:2]); "
    words = output_of([*command, "-c", code + "print(sys.executable)"]).splitlines()
    if len(words) != 2 or not words[0].startswith("CPython "):
        return None
    return words[0].split()[1], Path(words[1])


def output_of(command: list[str]) -> str:
    """What a command prints; nothing if it can't be run."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()


def call(command: Sequence[object], limit: float | None = None, shown: bool = True, log: Path | None = None) -> int:
    """Run a command from the root, its output going to `log` or where ours goes.

    Its exit code, 124 after `limit` seconds.
    """
    words = [str(word) for word in command]
    if shown:
        print("$", " ".join(words).replace(str(ROOT) + os.sep, ""), flush=True)
    with open(log, "wb") if log else nullcontext() as file:
        try:
            done = subprocess.run(
                words, cwd=ROOT, timeout=limit, check=False, stdout=file, stderr=file and subprocess.STDOUT
            )
        except subprocess.TimeoutExpired:
            print(f"dev.py: stopped after {limit:.0f} s: {' '.join(words)}", flush=True)
            return 124
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
