# SPDX-License-Identifier: GPL-3.0-or-later
"""One bake, mixed anew: `python benchmarks/light_mix_pictures.py`.

Sun and sky of the interior are put into one light group, its lamps into another, and it is baked once by the command
line. Then only sliders of *Light Mix* are set, as an artist would in the sidebar, and the scene rendered for each mix.
The sky beyond the window is no lightmap: the script dims it like the light that comes from it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.side_by_side import GAP, bake, pixels, write
from radiosity_addon import blender
from tests.accuracy.cycles_judge import judge

ROOT = Path(__file__).resolve().parents[1]
BLEND = ROOT / "sample_scenes" / "interior.blend"
DAY, LAMPS = "Day", "Lamps"


@dataclass(frozen=True)
class Mix:
    """Strength and tint of daylight and of the lamps' light."""

    day: float
    day_tint: tuple[float, float, float]
    lamps: float
    lamps_tint: tuple[float, float, float] = (1, 1, 1)


MIXES = (
    Mix(1.0, (1, 1, 1), 1.0),
    Mix(0.35, (1.0, 0.62, 0.36), 1.0),
    Mix(0.03, (0.35, 0.55, 1.0), 1.5, (1.0, 0.9, 0.8)),
)


def grouped(target: Path) -> None:
    """Save a copy of the interior whose lights are in two groups."""
    bpy.ops.wm.open_mainfile(filepath=str(BLEND))
    scene = bpy.context.scene
    for name in (DAY, LAMPS):
        bpy.context.view_layer.lightgroups.add(name=name)
    scene.world.lightgroup = DAY
    for thing in scene.objects:
        thing.lightgroup = DAY if thing.type == "LIGHT" and thing.data.type == "SUN" else LAMPS
    bpy.ops.wm.save_as_mainfile(filepath=str(target), copy=True)


def shown(scene: bpy.types.Scene, mix: Mix, sky: bpy.types.NodeTree, picture: Path) -> float:
    """Set the sliders and render; returns seconds of the sliders."""
    start = time.perf_counter()
    for slider in scene.radiosity_mix:
        day = slider.name == DAY
        slider.strength, slider.color = (mix.day, mix.day_tint) if day else (mix.lamps, mix.lamps_tint)
    bpy.context.view_layer.update()
    seconds = time.perf_counter() - start
    background = next(node for node in sky.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (*(mix.day * part for part in mix.day_tint), 1)
    scene.render.filepath = str(picture)
    bpy.ops.render.render(write_still=True)
    return seconds


def main() -> None:
    """Bake once, mix, render, join."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=48, help="for smooth edges; default: 48")
    parser.add_argument("--page-size", type=int, default=2048, help="default: 2048")
    parser.add_argument("--quality", default="high", help="of the bake; default: high")
    parser.add_argument("--percent", type=int, default=50, help="of the scene's resolution; default: 50")
    parser.add_argument("-o", dest="output", type=Path, default=ROOT / "docs" / "pictures" / "light_mix.jpg")
    options = parser.parse_args()
    blender.register()
    with tempfile.TemporaryDirectory() as folder:
        two, lit = Path(folder) / "groups.blend", Path(folder) / "lit.blend"
        grouped(two)
        bake(two, options.page_size, options.quality, lit, "--light-groups")
        bpy.ops.wm.open_mainfile(filepath=str(lit))
        scene = bpy.context.scene
        judge(scene, options.samples, seed=0, threads=0)
        scene.cycles.use_denoising = True
        scene.render.resolution_percentage = options.percent
        scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGB"
        parts: list[np.ndarray] = []
        for index, mix in enumerate(MIXES):
            picture = Path(folder) / f"{index}.png"
            seconds = shown(scene, mix, scene.world.node_tree, picture)
            print(f"Mix {index + 1}: sliders took {1000 * seconds:.0f} ms", flush=True)
            parts += [pixels(picture), np.ones((pixels(picture).shape[0], GAP, 4), np.float32)]
        write(options.output, np.concatenate(parts[:-1], axis=1))
    print(options.output)


if __name__ == "__main__":
    main()
