# SPDX-License-Identifier: GPL-3.0-or-later
"""Run by a Blender of its own: install the extension from a zip, bake a small scene, take the extension out.

    python install_and_bake.py ZIP FOLDER                      (under bpy)
    blender --background --python install_and_bake.py -- ZIP FOLDER

Leaves FOLDER/scene.blend (unbaked), FOLDER/baked.blend and FOLDER/result.json, which holds what the tests ask about.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy
import numpy as np

MODULE = "bl_ext.user_default.radiosity_addon"


def main(archive: str, folder: Path) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default", enable_on_install=True)
    bpy.ops.wm.save_userpref()
    result: dict[str, object] = {"blender": bpy.app.version_string, "python": sys.version.split()[0]}
    result["enabled"] = MODULE in bpy.context.preferences.addons
    result["operators"] = operators()

    build_scene()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    bpy.context.scene.radiosity.page_size = 256
    result["bake"] = sorted(bpy.ops.radiosity.bake())
    floor = bpy.data.objects["Floor"]
    result["uv_maps"] = [layer.name for layer in floor.data.uv_layers]
    result["pages"] = [page_of(image) for image in bpy.data.images if image.is_float]
    result["libraries"] = libraries()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "baked.blend"))

    bpy.ops.preferences.addon_disable(module=MODULE)
    result["operators_after_disabling"] = operators()
    (folder / "result.json").write_text(json.dumps(result), encoding="utf-8")


def build_scene() -> None:
    """A grey floor, 2 m x 2 m, under a square lamp."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.mesh.primitive_plane_add(size=2)
    bpy.context.object.name = "Floor"
    lamp = bpy.data.lights.new("Lamp", "AREA")
    lamp.energy, lamp.size = 100, 1
    holder = bpy.data.objects.new("Lamp", lamp)
    holder.location = (0, 0, 2)
    bpy.context.collection.objects.link(holder)


def operators() -> list[str]:
    """The extension's operators that exist."""
    return [name for name in ("bake", "revert") if hasattr(bpy.types, f"RADIOSITY_OT_{name}")]


def page_of(image: bpy.types.Image) -> dict[str, object]:
    """Size and brightest texel of a lightmap page."""
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return {"name": image.name, "size": list(image.size), "brightest": float(pixels.reshape(-1, 4)[:, :3].max())}


def libraries() -> dict[str, str]:
    """Where the bundled packages were imported from; those that only the unwrapping child imports are left out."""
    return {name: str(sys.modules[name].__file__) for name in ("embreex", "OpenImageIO") if name in sys.modules}


if __name__ == "__main__":
    words = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    main(words[0], Path(words[1]))
