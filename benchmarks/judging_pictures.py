# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the pictures of docs/judging.md: overlays over two sample scenes, as a 3D view shows them from their cameras.

    python benchmarks/judging_pictures.py

Needs a Blender module that can draw without a window (5.2), and takes about two minutes.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import bpy
import gpu
import numpy as np
from mathutils import Matrix

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from radiosity_addon.arrays import Float32  # noqa: E402
from radiosity_addon.blender import registered  # noqa: E402
from radiosity_addon.blender.judging.overlay_drawing import Painter  # noqa: E402
from radiosity_addon.blender.judging.overlay_legend import MARGIN, draw_legend  # noqa: E402
from radiosity_addon.blender.judging.overlays import Overlay  # noqa: E402
from radiosity_addon.pages.png import png_bytes  # noqa: E402
from radiosity_addon.reports.pictures import shrunk  # noqa: E402

SIZES = {"interior": (720, 450), "cornell_box": (600, 600)}
"""Pixels of a picture of each scene."""
FINE = 2
"""How many times finer it is drawn."""
EXPOSURE = 1.5
"""Stops; the room is dark beside its patches of sun."""
GROUND = (0.24, 0.24, 0.24, 1.0)


def main() -> None:
    """Bake and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", dest="output", type=Path, default=ROOT / "docs" / "pictures")
    folder: Path = parser.parse_args().output
    gpu.init()
    with tempfile.TemporaryDirectory() as made, registered():
        bpy.ops.wm.open_mainfile(filepath=str(baked(Path(made), "interior", "1024", lambda: None)))
        bpy.context.window_manager.radiosity_overlay.exposure = EXPOSURE
        for name in ("lighting", "illuminance", "charts"):
            save(folder / f"judging_{name}.png", picture(name, *SIZES["interior"]))
        bpy.ops.wm.open_mainfile(filepath=str(baked(Path(made), "cornell_box", "512", unlike_densities)))
        for name in ("density", "patches", "invalid"):
            if name == "invalid":  # they lie below the blocks
                for thing in ("Short Block", "Tall Block"):
                    bpy.data.objects[thing].hide_set(True)
            save(folder / f"judging_{name}.png", picture(name, *SIZES["cornell_box"]))


def unlike_densities() -> None:
    """Give some objects more texels than others."""
    for name, density in (("Short Block", 2.5), ("Tall Block", 0.5), ("Left Wall", 0.35)):
        bpy.data.objects[name].radiosity.density = density


def baked(folder: Path, name: str, size: str, change: Callable[[], None]) -> Path:
    """A sample scene, changed and baked."""
    source, result = folder / f"{name}_source.blend", folder / f"{name}.blend"
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "sample_scenes" / f"{name}.blend"))
    change()
    bpy.ops.wm.save_as_mainfile(filepath=str(source))
    command = [sys.executable, "-m", "radiosity_addon", "bake", source, "-o", result, "--page-size", size]
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return result


def picture(name: str, wide: int, high: int) -> Float32:
    """An overlay with its legend, as the scene's camera sees it: (high, wide, 3), the first row below."""
    scene, layer = bpy.context.scene, bpy.context.view_layer
    layer.update()
    width, height = wide * FINE, high * FINE
    depsgraph = bpy.context.evaluated_depsgraph_get()
    camera = scene.camera.evaluated_get(depsgraph)
    overlay = Overlay(name, Painter())
    screen = gpu.types.GPUOffScreen(width, height, format="RGBA16F")
    with screen.bind(), gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
        buffer = gpu.state.active_framebuffer_get()
        buffer.clear(color=GROUND, depth=1.0)
        gpu.matrix.load_matrix(camera.matrix_world.inverted())
        gpu.matrix.load_projection_matrix(camera.calc_matrix_camera(depsgraph, x=width, y=height))
        overlay.draw(scene, depsgraph, bpy.context.window_manager.radiosity_overlay)
        if overlay.legend is None:
            raise RuntimeError(f"{name}: {overlay.failure}")
        gpu.matrix.load_identity()
        gpu.matrix.load_projection_matrix(
            Matrix(((2 / width, 0, 0, -1), (0, 2 / height, 0, -1), (0, 0, -1, 0), (0, 0, 0, 1)))
        )
        draw_legend(overlay.legend, width - MARGIN * FINE, MARGIN * FINE, FINE)
        pixels = np.array(buffer.read_color(0, 0, width, height, 4, 0, "FLOAT").to_list(), np.float32)
    return shrunk(pixels[..., :3], high)


def save(path: Path, pixels: Float32) -> None:
    """Write a picture, its first row on top."""
    steps = np.round(np.clip(pixels[::-1], 0, 1) * 255).astype(np.uint8)
    path.write_bytes(b"".join(png_bytes(np.ascontiguousarray(steps))))


if __name__ == "__main__":
    main()
