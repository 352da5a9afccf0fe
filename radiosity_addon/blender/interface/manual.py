# SPDX-License-Identifier: GPL-3.0-or-later
"""Where *Online Manual* leads from our settings and buttons: pages that come with the extension."""

from __future__ import annotations

from pathlib import Path

import bpy

PAGES = Path(__file__).resolve().parents[3] / "docs" / "manual"
"""Beside the package, in the repository as in the installed extension: they fit the version, and need no network."""

SETTINGS = {
    "RadiositySceneSettings": {
        "density_enabled": "bake.md#density",
        "density": "bake.md#density",
        "fine_folds": "advanced.md#finer-folds",
        "page_size": "bake.md#page-size",
        "quality": "bake.md#quality",
        "tolerance": "solver.md#tolerance",
        "bounces": "solver.md#bounces",
        "most_bounces": "solver.md#most-bounces",
        "solver": "advanced.md#method",
        "form_factors": "advanced.md#form-factors",
        "subdivisions": "advanced.md#subdivisions",
        "light_groups": "light_groups.md#keep-groups-apart",
        "threads": "advanced.md#threads",
        "write_back": "output.md#result",
        "textures": "output.md#textures",
        "files": "output.md#format",
    },
    "RadiosityFileSettings": {
        "format": "output.md#format",
        "depth": "output.md#depth",
        "compression": "output.md#compression",
        "exposure": "output.md#exposure",
        "transfer": "output.md#transfer",
        "space": "output.md#color-space",
        "intent": "output.md#intent",
    },
    "RadiosityExportSettings": {
        "folder": "export.md#folder",
        "gltf": "export.md#gltf",
        "files": "export.md#files",
    },
    "RadiosityLightGroup": {
        "strength": "light_groups.md#light-mix",
        "color": "light_groups.md#light-mix",
    },
    "RadiosityObjectSettings": {
        "exclude": "object.md#exclude",
        "only_casts": "object.md#no-lightmap",
        "density": "object.md#density",
        "two_sided": "object.md#two-sided",
        "uv_map": "object.md#uv-map",
        "page_group": "object.md#page-group",
        "tube_radius": "object.md#tube-radius",
    },
    "RadiosityOverlaySettings": {
        "unit": "judge.md#unit",
        "range_auto": "judge.md#range",
        "low": "judge.md#range",
        "high": "judge.md#range",
        "exposure": "judge.md#exposure",
        "target_auto": "judge.md#target",
        "target": "judge.md#target",
        "sharp": "judge.md#show-texels",
        "opacity": "judge.md#opacity",
        "legend": "judge.md#legend",
    },
}
"""Of each group of settings the place of each setting."""

OPERATORS = {
    "bake": "bake.md#bake-radiosity",
    "stop": "bake.md#stop-here-and-keep-it",
    "cancel": "bake.md#cancel",
    "revert": "bake.md#revert",
    "toggle": "bake.md#show-original",
    "preset_add": "bake.md#presets",
    "see": "bake.md#see-it-in-material-preview",
    "check": "check.md#check-scene",
    "select": "check.md#select-object",
    "flip": "check.md#flip-normals",
    "show_report": "last_bake.md#show-report",
    "export": "export.md#export-lightmaps",
    "reset_mix": "light_groups.md#light-mix",
    "overlay": "judge.md#overlay",
    "light_meter": "judge.md#light-meter",
    "copy_settings": "object.md#copy-to-selected",
}
"""Of `bpy.ops.radiosity`, their own settings included."""


def manual_map() -> tuple[str, tuple[tuple[str, str], ...]]:
    """The address of the pages, and which of them tells about what; Blender asks with lower case names."""
    settings = (
        (f"bpy.types.{group}.{name}".lower(), place)
        for group, places in SETTINGS.items()
        for name, place in places.items()
    )
    operators = ((f"bpy.ops.radiosity.{name}{end}", place) for name, place in OPERATORS.items() for end in ("", ".*"))
    return PAGES.as_uri() + "/", (*settings, *operators)


def register() -> None:
    """Add the map."""
    bpy.utils.register_manual_map(manual_map)


def unregister() -> None:
    """Take it away."""
    bpy.utils.unregister_manual_map(manual_map)
