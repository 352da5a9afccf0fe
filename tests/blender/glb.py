# SPDX-License-Identifier: GPL-3.0-or-later
""".glb files taken apart by hand, as a reader of glTF would that knows nothing of Blender."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from radiosity_addon.pages.image import read_image

KINDS = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


@dataclass(frozen=True)
class Glb:
    """Its JSON, and its binary chunk."""

    content: dict[str, Any]
    data: bytes

    def nodes(self, name: str) -> list[dict[str, Any]]:
        return [node for node in self.content["nodes"] if node["name"] == name]

    def primitive(self, name: str) -> dict[str, Any]:
        """The first primitive of the node of a name."""
        return self.primitive_of(self.nodes(name)[0])

    def primitive_of(self, node: dict[str, Any]) -> dict[str, Any]:
        return self.content["meshes"][node["mesh"]]["primitives"][0]

    def material_of(self, primitive: dict[str, Any]) -> dict[str, Any]:
        return self.content["materials"][primitive["material"]]

    def attribute(self, primitive: dict[str, Any], name: str) -> np.ndarray:
        return self.accessor(primitive["attributes"][name])

    def accessor(self, index: int) -> np.ndarray:
        accessor = self.content["accessors"][index]
        view = self.content["bufferViews"][accessor["bufferView"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        width = WIDTHS[accessor["type"]]
        flat = np.frombuffer(self.data, KINDS[accessor["componentType"]], accessor["count"] * width, start)
        return flat.reshape(-1, width)

    def lightmap(self, material: dict[str, Any], folder: Path) -> np.ndarray:
        """Irradiance (H, W, 3), W/m2, of a material's MOZ_lightmap, the first row on top."""
        extension = material["extensions"]["MOZ_lightmap"]
        return self.texture(extension["index"], folder) / 255 * extension["intensity"]

    def texture(self, index: int, folder: Path) -> np.ndarray:
        """The numbers (H, W, 3) of a PNG texture, the first row on top."""
        image = self.content["images"][self.content["textures"][index]["source"]]
        assert image["mimeType"] == "image/png"
        view = self.content["bufferViews"][image["bufferView"]]
        start = view.get("byteOffset", 0)
        path = folder / "texture.png"
        path.write_bytes(self.data[start : start + view["byteLength"]])
        return read_image(path)[::-1, :, :3]


def read(path: Path) -> Glb:
    data = path.read_bytes()
    magic, version, length = struct.unpack("<4sII", data[:12])
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack("<I4s", data[12:20])
    assert kind == b"JSON"
    return Glb(json.loads(data[20 : 20 + size]), data[28 + size :])


def corners(glb: Glb, primitive: dict[str, Any], uv: str) -> dict[tuple[float, ...], tuple[float, ...]]:
    """The uv of each corner of a mesh whose corners share no position, by that position as Blender has it."""
    position = glb.attribute(primitive, "POSITION")[:, [0, 2, 1]] * [1, -1, 1]
    found = glb.attribute(primitive, uv)
    return {tuple(np.round(at, 4) + 0.0): tuple(np.round(where, 5)) for at, where in zip(position, found, strict=True)}
