# SPDX-License-Identifier: GPL-3.0-or-later
"""The manifest keeps the extension platform's rules, and the files around the code agree with one another."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest

import dev

ROOT = Path(__file__).resolve().parents[1]
MANIFEST_TEXT = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
MANIFEST: dict[str, Any] = tomllib.loads(MANIFEST_TEXT)
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
SHORT_TEXT = 64
"""Characters that the platform allows a tagline and the reason of a permission."""


def test_manifest_has_no_key_that_blender_would_ignore() -> None:
    required = {"schema_version", "id", "version", "name", "tagline", "maintainer", "type", "blender_version_min"}
    assert set(MANIFEST) == required | {"tags", "license", "copyright", "permissions", "build"}
    assert set(MANIFEST["build"]) == {"paths_exclude_pattern"}


def test_manifest_id_is_the_package() -> None:
    assert (ROOT / MANIFEST["id"] / "__init__.py").is_file()


def test_version_is_the_same_everywhere() -> None:
    newest = re.search(r"^## (\d+\.\d+\.\d+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert newest is not None
    assert MANIFEST["version"] == PROJECT["version"] == newest[1]


def test_name_is_allowed() -> None:
    assert "blender" not in MANIFEST["name"].lower()


@pytest.mark.parametrize("text", [MANIFEST["tagline"], *MANIFEST["permissions"].values()])
def test_short_text_fits_and_ends_without_a_full_stop(text: str) -> None:
    assert 0 < len(text) <= SHORT_TEXT
    assert text[-1].isalnum()


def test_permission_for_files_is_the_only_one() -> None:
    assert list(MANIFEST["permissions"]) == ["files"]


def test_tags_are_the_platforms() -> None:
    assert MANIFEST["tags"] == ["Bake", "Lighting", "Render"]


def test_licence_is_the_platforms() -> None:
    assert MANIFEST["license"] == [f"SPDX:{PROJECT['license']}"] == ["SPDX:GPL-3.0-or-later"]
    assert (ROOT / "LICENSE").read_text(encoding="utf-8").split()[:4] == ["GNU", "GENERAL", "PUBLIC", "LICENSE"]


def test_excluded_paths_repeat_blenders_defaults() -> None:
    assert MANIFEST["build"]["paths_exclude_pattern"][:4] == ["__pycache__/", ".*", "/*.zip", "*.blend[1-9]"]


def test_release_knows_blenders_platforms_only() -> None:
    assert set(dev.WHEEL_TAGS) == {"linux-x64", "windows-x64", "macos-arm64", "macos-x64"}


def test_release_completes_the_manifest(tmp_path: Path) -> None:
    manifest = tmp_path / "blender_manifest.toml"
    manifest.write_text(MANIFEST_TEXT, encoding="utf-8")
    dev.complete_manifest(manifest, ["linux-x64", "macos-x64"], ["a-1-py3-none-any.whl"])
    completed = tomllib.loads(manifest.read_text(encoding="utf-8"))
    added = {"platforms": ["linux-x64", "macos-x64"], "wheels": ["./wheels/a-1-py3-none-any.whl"]}
    assert completed == MANIFEST | added


@pytest.mark.parametrize("platform", dev.WHEEL_TAGS)
def test_a_zip_without_a_wheel_or_with_one_of_another_platform_is_no_release(tmp_path: Path, platform: str) -> None:
    tags = {
        "linux-x64": "manylinux_2_27_x86_64.manylinux_2_28_x86_64",
        "windows-x64": "win_amd64",
        "macos-arm64": "macosx_11_0_arm64",
        "macos-x64": "macosx_10_14_x86_64",
    }
    whole = [
        f"wheels/{package.lower()}-1.2-{abi}-{abi}-{tags[platform]}.whl"
        for package in dev.BUNDLED
        for abi in ("cp311", "cp313")
    ]

    def faults(held: list[str], named: list[str], built_for: str) -> list[str]:
        with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
            built = f"[build.generated]\nplatforms = [{built_for!r}]\nwheels = {[f'./{wheel}' for wheel in named]}\n"
            archive.writestr("blender_manifest.toml", built)
            for wheel in held:
                archive.writestr(wheel, b"")
        return dev.faults_of(tmp_path / "a.zip", platform)

    assert faults(whole, whole, platform) == []
    assert faults(whole[1:], whole[1:], platform) == [f"no wheel of {dev.BUNDLED[0]} for Python 3.11"]
    assert faults(whole, whole[1:], platform) == ["its manifest names other wheels than it holds"]
    assert faults(whole, whole, "elsewhere") == ["its manifest is for ['elsewhere']"]
    other = next(tag for name, tag in tags.items() if name != platform)
    mixed = [wheel.replace(tags[platform], other) if "xatlas" in wheel else wheel for wheel in whole]
    assert faults(mixed, mixed, platform) == [f"no wheel of xatlas for Python {python}" for python in dev.PYTHONS]


@pytest.mark.parametrize("version", dev.PYTHONS)
def test_environment_pins_what_the_package_pins(version: str) -> None:
    pinned = set(dev.requirements(version).read_text(encoding="utf-8").splitlines())
    wanted = []
    for dependency in PROJECT["dependencies"]:
        pin, _, marker = dependency.partition("; ")
        if not marker or marker == f"python_version == '{version}'":
            wanted.append(pin)
    assert len(wanted) == 5
    assert set(wanted) <= pinned


@pytest.mark.parametrize("version", dev.PYTHONS)
def test_every_requirement_is_pinned_and_names_no_host(version: str) -> None:
    comment, *lines = dev.requirements(version).read_text(encoding="utf-8").splitlines()
    assert comment.startswith("# ")
    for line in lines:
        assert re.fullmatch(r"[\w.-]+==[\w.]+(; sys_platform == \"win32\")?", line), line


@pytest.mark.parametrize("name", ["pyproject.toml", "dev.py", ".ci/run", "blender_manifest.toml"])
def test_no_address_is_written_down(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    assert not re.search(r"https?://|--(extra-)?index-url|--find-links|--trusted-host", text)


def test_every_source_file_names_its_licence() -> None:
    folders = ("radiosity_addon", "presets", "tests", "sample_scenes", "benchmarks")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*.py")] + list(ROOT.glob("*.py"))
    first_lines = {path: path.read_text(encoding="utf-8").partition("\n")[0] for path in files}
    assert not [path for path, line in first_lines.items() if line != "# SPDX-License-Identifier: GPL-3.0-or-later"]


def test_root_module_imports_nothing_before_it_is_registered() -> None:
    code = "import runpy, sys; runpy.run_path('__init__.py'); sys.exit('radiosity_addon' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_architecture_shows_where_every_module_is() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    package = ROOT / "radiosity_addon"
    modules = {path.relative_to(package).as_posix() for path in package.rglob("*.py") if path.name != "__init__.py"}
    named = set(re.findall(r"`((?!tests/)(?:\w+/){0,2}\w+\.py)`", text))
    assert named == modules
