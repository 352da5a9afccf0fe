# SPDX-License-Identifier: GPL-3.0-or-later
"""glTF files with lightmaps: Blender's own exporter, with what it has no word for added by its hooks.

A material's extension MOZ_lightmap names a picture, the uv map that places it, and an intensity: intensity x picture is
the irradiance, W/m2, linear Rec.709. It is the extension that Mozilla Hubs brought in and three.js has a loader for.
"""

from __future__ import annotations

import importlib.util
import json
import math
import struct
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import addon_utils
import bpy

from ...errors import BakeError, OutputError
from ...files import Transaction
from ...shading import Quantity
from .lit_set import LitSet
from .pbr_materials import LitBy

ADDON = "io_scene_gltf2"
EXTENSION = "MOZ_lightmap"
TRANSFORM = "KHR_texture_transform"
STRENGTH = "KHR_materials_emissive_strength"
BINARY = ("io.exp.binary_data", "io.exp.gltf2_io_binary_data")
"""Modules of the exporter that have BinaryData: from 4.3 on, and before."""
LINEAR, CLAMP = 9729, 33071
"""glTF's numbers for filtering without mip levels, and for no repetition."""


@dataclass(frozen=True, eq=False)
class Pictures:
    """Pages as glTF holds them.

    Attributes:
        files: a PNG file each
        white: what their white stands for
    """

    files: list[bytes]
    white: float


class _Lightmaps:
    """What the exporter asks while it writes a set: names as the user knows them, lightmaps, painted colours."""

    def __init__(self, lit: LitSet, light: Pictures, painted: Mapping[Quantity, Pictures]) -> None:
        self.lit = lit
        self.names = {part.thing.name: part.name for part in lit.parts}
        self.light = light
        self.painted = painted
        self._textures: dict[str, Any] = {}

    def gather_node_hook(self, node: Any, thing: bpy.types.Object, settings: dict[str, Any]) -> None:
        """Name a node as the user's object."""
        node.name = self.names.get(thing.name, node.name)
        if node.mesh is not None:
            node.mesh.name = node.name

    def gather_scene_hook(self, found: Any, scene: bpy.types.Scene, settings: dict[str, Any]) -> None:
        """Name the scene as the user's."""
        found.name = self.lit.name

    def gather_material_hook(self, found: Any, material: bpy.types.Material, settings: dict[str, Any]) -> None:
        """Name a material as the user's, and give it its lightmap."""
        found.name = self.lit.materials.names.get(material.name, found.name)
        lit_by = self.lit.materials.lit.get(material.name)
        if lit_by is not None:
            found.extensions = found.extensions or {}
            found.extensions[EXTENSION] = self._lightmap(lit_by)
            for quantity in sorted(self.lit.materials.painted.get(material.name, ())):
                self._show_painted(found, quantity, lit_by)

    def _lightmap(self, lit_by: LitBy) -> Any:
        content = {"index": self._texture(self.light, lit_by.page, "Radiosity"), "texCoord": 1}
        content["intensity"] = math.pi * self.light.white
        if lit_by.place is not None:
            content["extensions"] = _transform(lit_by.place)
        return _extension(EXTENSION, content)

    def _show_painted(self, found: Any, quantity: Quantity, lit_by: LitBy) -> None:
        pictures = self.painted[quantity]
        info = _gltf().TextureInfo(
            extensions=None if lit_by.place is None else _transform(lit_by.place),
            extras=None,
            index=self._texture(pictures, lit_by.page, f"Radiosity {quantity.capitalize()}"),
            tex_coord=1,
        )
        if quantity == "reflectance":
            found.pbr_metallic_roughness.base_color_texture = info
        else:
            found.emissive_texture, found.emissive_factor = info, [1.0, 1.0, 1.0]
            found.extensions[STRENGTH] = _extension(STRENGTH, {"emissiveStrength": pictures.white})

    def _texture(self, pictures: Pictures, page: int, name: str) -> Any:
        """A page as a texture, whose name tells which it is."""
        key = f"{name} {page + 1}"
        if key not in self._textures:
            gltf = _gltf()
            plain = {"extensions": None, "extras": None, "name": None}
            sampler = gltf.Sampler(**plain, mag_filter=LINEAR, min_filter=LINEAR, wrap_s=CLAMP, wrap_t=CLAMP)
            data = _binary_data()(pictures.files[page])
            image = gltf.Image(**{**plain, "name": key}, buffer_view=data, mime_type="image/png", uri=None)
            self._textures[key] = gltf.Texture(**{**plain, "name": key}, sampler=sampler, source=image)
        return self._textures[key]


def transform_of(place: tuple[float, float, float]) -> dict[str, list[float]]:
    """KHR_texture_transform of the uv scale * uv + (u, v): in glTF v points down, so that 1 - v is what is scaled."""
    scale, u, v = place
    return {"offset": [u, 1.0 - scale - v], "scale": [scale, scale]}


def write_glb(
    path: Path, lit: LitSet, light: Pictures, painted: Mapping[Quantity, Pictures], files: Transaction
) -> None:
    """Write a set as one .glb file, lightmaps inside.

    Args:
        path: the file
        light: the lightmaps, linear, H / pi in W/(m2 sr)
        painted: what materials have painted, by sRGB's transfer function
        files: the transaction that the file is part of

    Raises:
        BakeError: Blender's glTF exporter is not there
        OutputError: the file can't be written, or came back without its lightmaps
    """
    temporary = files.begin(path)
    try:
        with _hooked(_Lightmaps(lit, light, painted)), _shown(lit.scene):
            bpy.ops.export_scene.gltf(
                filepath=str(temporary),
                check_existing=False,
                export_format="GLB",
                use_active_scene=True,
                export_cameras=True,
                export_lights=False,
                export_animations=False,
                export_current_frame=True,
                export_morph=False,
                export_skins=False,
            )
    except RuntimeError as error:
        reason = str(error).strip().removeprefix("Error: ").splitlines()[-1].rstrip(".")
        raise OutputError(
            str(path), f"it was not exported ({reason})", "Free some space or choose another folder"
        ) from error
    _check(path, temporary, lit)
    files.place(path)


def _check(path: Path, written: Path, lit: LitSet) -> None:
    """Whether a file is whole and has the lightmaps: the exporter prints what goes wrong in a hook, and goes on.

    Raises:
        OutputError: it is not, or has not
    """
    content = read_glb(written)
    lightmaps = sum(EXTENSION in material.get("extensions", {}) for material in content.get("materials", ()))
    if lightmaps != len(lit.materials.lit):
        cause = f"{lightmaps} of its {len(lit.materials.lit)} lit materials came back with a lightmap"
        raise OutputError(str(path), cause, "Export again; if that does not help, report it")


def read_glb(path: Path) -> dict[str, Any]:
    """The JSON of a .glb file.

    Raises:
        OutputError: it is no such file, or cut short
    """
    data = path.read_bytes() if path.is_file() else b""
    magic, _, length = struct.unpack("<4sII", data[:12]) if len(data) >= 20 else (b"", 0, 0)
    if magic != b"glTF" or length != len(data):
        raise OutputError(str(path), "the file did not come back whole", "Free some space or choose another folder")
    size = struct.unpack("<I", data[12:16])[0]
    content: dict[str, Any] = json.loads(data[20 : 20 + size])
    return content


def _transform(place: tuple[float, float, float]) -> dict[str, Any]:
    return {TRANSFORM: _extension(TRANSFORM, transform_of(place))}


def _extension(name: str, content: dict[str, Any]) -> Any:
    return importlib.import_module(f"{ADDON}.io.com.gltf2_io_extensions").Extension(name, content, required=False)


def _gltf() -> Any:
    return importlib.import_module(f"{ADDON}.io.com.gltf2_io")


def _binary_data() -> Any:
    for name in BINARY:
        if importlib.util.find_spec(f"{ADDON}.{name}") is not None:
            return importlib.import_module(f"{ADDON}.{name}").BinaryData
    raise BakeError("glTF", "this Blender's exporter is not known", "Turn glTF off, and export by Blender's own menu")


@contextmanager
def _hooked(hooks: _Lightmaps) -> Iterator[None]:
    """Blender's glTF exporter, enabled, with hooks: it looks for them in the modules of add-ons, its own too."""
    preferences = bpy.context.preferences
    dirty, enabled = preferences.is_dirty, ADDON in preferences.addons
    if not enabled and addon_utils.enable(ADDON, default_set=True) is None:
        raise BakeError("glTF", "this Blender has no glTF exporter", "Turn glTF off")
    exporter: Any = sys.modules[ADDON]
    exporter.glTF2ExportUserExtension = lambda: hooks
    try:
        yield
    finally:
        del exporter.glTF2ExportUserExtension
        if not enabled:
            addon_utils.disable(ADDON, default_set=True)
        preferences.is_dirty = dirty


@contextmanager
def _shown(scene: bpy.types.Scene) -> Iterator[None]:
    """Within, the scene is the one that exporters export: the window's, and of no editor that would name another."""
    window = bpy.context.window or bpy.context.window_manager.windows[0]
    before, layer = window.scene, window.view_layer
    window.scene = scene
    try:
        with bpy.context.temp_override(window=window, area=None, region=None):
            yield
    finally:
        window.scene, window.view_layer = before, layer
