# SPDX-License-Identifier: GPL-3.0-or-later
"""The core runs without Blender, whatever the installed package is called."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "radiosity_addon"
CORE = sorted(
    path
    for path in PACKAGE.rglob("*.py")
    if path.name != "__main__.py" and path.relative_to(PACKAGE).parts[0] != "blender"
)
EVERYWHERE = sorted(PACKAGE.rglob("*.py"))

IMPORT_EACH_FIRST = """
import importlib, json, sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("bpy", "mathutils"):
            raise ImportError(f"{name} is blocked")

sys.meta_path.insert(0, Blocker())
failures = {}
for name in sys.argv[1:]:
    for loaded in [key for key in sys.modules if key.partition(".")[0] == "radiosity_addon"]:
        del sys.modules[loaded]
    try:
        importlib.import_module(name)
    except ImportError as error:
        failures[name] = str(error)
print(json.dumps(failures))
"""


def module_name(path: Path) -> str:
    """radiosity_addon.errors for .../radiosity_addon/errors.py."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def imports(path: Path, top_level_only: bool = False) -> Iterator[str]:
    """Absolute names of the modules that a file imports; of `from . import name` and the like also `name`."""
    package = path.relative_to(ROOT).parent.parts
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in tree.body if top_level_only else ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else ()
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)


@pytest.fixture(scope="module")
def failures() -> dict[str, str]:
    command = [sys.executable, "-c", IMPORT_EACH_FIRST, *map(module_name, CORE)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    result: dict[str, str] = json.loads(done.stdout)
    return result


@pytest.mark.parametrize("path", CORE, ids=module_name)
def test_core_module_imports_without_bpy(path: Path, failures: dict[str, str]) -> None:
    assert module_name(path) not in failures, failures[module_name(path)]


@pytest.mark.parametrize("path", CORE, ids=module_name)
def test_core_module_never_names_bpy(path: Path) -> None:
    assert not {"bpy", "mathutils"} & {name.partition(".")[0] for name in imports(path)}


@pytest.mark.parametrize(
    ("library", "owner"), [("embreex", "visibility.py"), ("OpenImageIO", "image.py"), ("xatlas", "xatlas_worker.py")]
)
def test_library_is_imported_by_one_module_only(library: str, owner: str) -> None:
    importers = [path.name for path in EVERYWHERE if library in {name.partition(".")[0] for name in imports(path)}]
    assert importers == [owner]


@pytest.mark.parametrize("path", EVERYWHERE, ids=module_name)
def test_package_imports_itself_relatively_only(path: Path) -> None:
    absolute = [
        node
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if (isinstance(node, ast.ImportFrom) and not node.level and (node.module or "").startswith("radiosity_addon"))
        or (isinstance(node, ast.Import) and any(alias.name.startswith("radiosity_addon") for alias in node.names))
    ]
    assert not absolute, "an installed extension is renamed"


def test_core_modules_import_one_another_one_way() -> None:
    names = {module_name(path): path for path in CORE}
    graph = {
        name: {used for used in imports(path, top_level_only=True) if used in names} - {name, "radiosity_addon"}
        for name, path in names.items()
    }
    assert list(TopologicalSorter(graph).static_order())


def rooms(house: Path) -> list[str]:
    """The packages in a package, those that others stand on first.

    Raises:
        CycleError: they do not stand one above the other
    """
    below: dict[str, set[str]] = {}
    for path in house.glob("*/*.py"):
        room = path.parent.name
        for name in imports(path):
            inside = name.removeprefix(f"{module_name(house)}.")
            other = inside.partition(".")[0]
            if inside != name and other != room and (house / other).is_dir():
                below.setdefault(room, set()).add(other)
    return list(TopologicalSorter(below).static_order())


def test_rooms_of_the_core_import_one_way() -> None:
    order = [room for room in rooms(PACKAGE) if room != "blender"]
    assert order.index("atlas") < order.index("geometry") < order.index("radiosity") < order.index("gather")


def test_rooms_of_blenders_part_import_one_way() -> None:
    order = rooms(PACKAGE / "blender")
    assert order.index("data") < order.index("looks") < order.index("reading") < order.index("writing")
    assert order.index("writing") < order.index("handover") < order.index("interface") < order.index("headless")
