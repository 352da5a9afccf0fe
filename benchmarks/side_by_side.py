# SPDX-License-Identifier: GPL-3.0-or-later
"""One picture of a sample scene path traced and baked, side by side: `python benchmarks/side_by_side.py [SCENE]`.

Both halves are rendered by Cycles from the scene's camera: the left one traces all the scene's light, many samples and
all bounces, denoised; the right one shows the baked scene, in which every surface gives off the light on its lightmap.
With --diffuse-only both halves take away gloss and metal, which a lightmap can't hold: then they should be the same.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.accuracy.cycles_judge import judge

ROOT = Path(__file__).resolve().parents[1]
JPEG_QUALITY = 90
GAP = 8
"""White pixels between the halves."""


def render(blend: Path, samples: int, threads: int, percent: int, picture: Path) -> None:
    """Render a scene as it is, to the end of the light."""
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    scene = bpy.context.scene
    judge(scene, samples, seed=0, threads=threads)
    scene.render.resolution_percentage = percent
    scene.cycles.use_denoising = True
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.filepath = str(picture)
    bpy.ops.render.render(write_still=True)


def without_gloss(blend: Path, target: Path) -> None:
    """Save a copy of a scene whose Principled shaders are dull."""
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    for material in bpy.data.materials:
        for node in material.node_tree.nodes if material.node_tree is not None else ():
            if node.type == "BSDF_PRINCIPLED":
                for name in ("Metallic", "Specular IOR Level", "Coat Weight"):
                    node.inputs[name].default_value = 0.0
    bpy.ops.wm.save_as_mainfile(filepath=str(target), copy=True)


def bake(blend: Path, page_size: int, quality: str, output: Path, *more: str) -> None:
    """Bake a scene by the command line."""
    command = [sys.executable, "-m", "radiosity_addon", "bake", blend, "-o", output]
    options = ["--page-size", page_size, "--quality", quality]
    subprocess.run([str(part) for part in (*command, *options, *more)], check=True, cwd=ROOT)


def pixels(picture: Path) -> np.ndarray:
    """(H, W, 4) of a PNG, as stored in it, first row below."""
    image = bpy.data.images.load(str(picture))
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    flat = np.empty(4 * width * height, np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(height, width, 4)


def write(picture: Path, values: np.ndarray) -> None:
    """Write (H, W, 4) as a PNG or JPEG, as they are."""
    height, width = values.shape[:2]
    image = bpy.data.images.new("Side by side", width, height, alpha=False)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(np.ascontiguousarray(values, np.float32).ravel())
    image.file_format, image.filepath_raw = "PNG" if picture.suffix == ".png" else "JPEG", str(picture)
    image.save(quality=JPEG_QUALITY)


def main() -> None:
    """Render both halves and join them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default="cornell_box", help="a sample scene; default: cornell_box")
    parser.add_argument("--samples", type=int, default=384, help="of both halves; default: 384")
    parser.add_argument("--threads", type=int, default=0, help="of the renderer; default: 0, all")
    parser.add_argument("--page-size", type=int, default=1024, help="default: 1024")
    parser.add_argument("--quality", default="high", help="of the bake; default: high")
    parser.add_argument("--percent", type=int, default=100, help="of the scene's resolution; default: 100")
    parser.add_argument("--diffuse-only", action="store_true", help="without gloss and metal")
    parser.add_argument("--difference", type=Path, help="a picture of where the halves differ, five times as much")
    parser.add_argument("--left", type=Path, help="a picture to take as the path traced half")
    parser.add_argument("-o", dest="output", type=Path, help="default: docs/pictures/SCENE_side_by_side.png")
    options = parser.parse_args()
    blend = ROOT / "sample_scenes" / f"{options.scene}.blend"
    output = options.output or ROOT / "docs" / "pictures" / f"{options.scene.removesuffix('_box')}_side_by_side.png"
    with tempfile.TemporaryDirectory() as folder:
        if options.diffuse_only:
            without_gloss(blend, Path(folder) / "dull.blend")
            blend = Path(folder) / "dull.blend"
        left, right = options.left or Path(folder) / "traced.png", Path(folder) / "baked.png"
        if not options.left:
            render(blend, options.samples, options.threads, options.percent, left)
        lit = Path(folder) / "baked.blend"
        bake(blend, options.page_size, options.quality, lit)
        render(lit, options.samples, options.threads, options.percent, right)
        halves = pixels(left), pixels(right)
        difference = np.abs(halves[0] - halves[1])[..., :3]
        gap = np.ones((len(halves[0]), GAP, 4), np.float32)
        if options.difference:
            shown = np.concatenate([np.minimum(5 * difference, 1), np.ones_like(difference[..., :1])], axis=2)
            write(options.difference, shown)
        output.parent.mkdir(parents=True, exist_ok=True)
        write(output, np.concatenate([halves[0], gap, halves[1]], axis=1))
    print(f"{output}: mean difference {255 * difference.mean():.2f} of 255, largest {255 * difference.max():.0f}")


if __name__ == "__main__":
    main()
