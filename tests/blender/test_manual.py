# SPDX-License-Identifier: GPL-3.0-or-later
"""Online Manual leads somewhere, from everything that is ours, and the manual's own links do too."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

import bpy
import pytest
from bl_operators.wm import WM_OT_doc_view_manual

from radiosity_addon.blender.interface.manual import OPERATORS, PAGES, SETTINGS

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"\]\(([^)\s]+)\)")


def our_ids() -> list[str]:
    """What Blender calls our settings and operators when it asks for the manual."""
    groups = [group for group in bpy.types.PropertyGroup.__subclasses__() if group.__name__.startswith("Radiosity")]
    settings = [f"bpy.types.{group.__name__}.{name}" for group in groups for name in group.__annotations__]
    operators = [f"bpy.ops.radiosity.{name}" for name in dir(bpy.ops.radiosity)]
    return settings + operators


def anchors(page: Path) -> set[str]:
    """Of a page's headings, as GitHub and others make them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def assert_exists(page: Path, anchor: str) -> None:
    assert page.is_file(), page
    assert not anchor or anchor in anchors(page), f"{page.name}#{anchor}"


def test_everything_of_ours_has_a_place_in_the_manual() -> None:
    ids = our_ids()
    assert "bpy.ops.radiosity.bake" in ids
    assert "bpy.types.RadiosityObjectSettings.density" in ids
    for name in ids:
        address = WM_OT_doc_view_manual._lookup_rna_url(name, verbose=False)
        assert address is not None, f"{name} is missing in blender/manual.py"
        parts = urlsplit(address)
        page = Path(url2pathname(parts.path))
        assert page.parent == PAGES, f"{name} leads to {address}"
        assert_exists(page, parts.fragment)


def test_manual_tells_of_nothing_that_is_gone() -> None:
    mapped = {f"bpy.types.{group}.{name}" for group, places in SETTINGS.items() for name in places}
    mapped |= {f"bpy.ops.radiosity.{name}" for name in OPERATORS}
    assert mapped - set(our_ids()) == set()


@pytest.mark.parametrize(
    "page",
    [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))],
    ids=lambda page: page.relative_to(ROOT).as_posix(),
)
def test_links_lead_somewhere(page: Path) -> None:
    for link in LINK.findall(page.read_text(encoding="utf-8")):
        path, _, anchor = link.partition("#")
        if "://" in link:
            continue
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        if target.suffix == ".md":
            assert_exists(target, anchor)
