# SPDX-License-Identifier: GPL-3.0-or-later
"""Cancel a bake in each of its stages, in a real window of a desktop Blender, and print how long that takes.

    python3 dev.py bench cancel_times -- SCRIPT

SCRIPT runs that Blender; tests/desktop/conftest.py says what it must understand. A scene is baked to its end once,
which tells how long its stages take; then, for each stage, it is baked again and Esc is pressed halfway through it. By
default bakes are drafts, which take the same steps as better ones, and fewer of them.
Seconds count from before the key is pressed until no bake runs any more, and whatever differs from before the bake,
datablocks or files, is printed.
"""

from __future__ import annotations

import argparse
import itertools
import shutil
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.desktop.blender import Desktop  # noqa: E402
from tests.desktop.window import Window  # noqa: E402

SCENES = ("interior", "curves", "garden")
"""Furnished and textured; all kinds of curves; sky, cut-outs and procedural materials."""


def main(script: Path, scenes: list[str], quality: str, stages: list[str]) -> None:
    """A table for each scene, of some stages or of all."""
    with tempfile.TemporaryDirectory() as name:
        desktop = Desktop(script, Path(name))
        desktop.install()
        for scene in scenes:
            folder = Path(name) / scene
            folder.mkdir()
            window = Window(desktop, folder, ROOT / "out" / "cancel")
            try:
                window.open(shutil.copy(ROOT / f"sample_scenes/{scene}.blend", folder))
                window.ask("look", "SOLID", False)
                window.ask("choose", {"quality": quality})
                cancel_all(window, scene, folder, stages)
            finally:
                window.close()


def cancel_all(window: Window, scene: str, folder: Path, stages: list[str]) -> None:
    """Cancel a scene's bake in these stages; without any in each."""
    window.ask("remember")
    before = sorted(path.name for path in folder.iterdir())
    window.ask("watch")
    window.click_button("bpy.ops.radiosity.bake(")
    seen = ended(window)
    revert(window, folder / f"{scene}_textures")
    order = sorted(seen, key=lambda stage: seen[stage])
    print(f"{scene}: {seen['ended'] - seen[order[0]]:.1f} s to its end", flush=True)
    for stage, after in itertools.pairwise(order):
        if stages and stage not in stages:
            continue
        if not cancel(window, stage, (seen[after] - seen[stage]) / 2):
            print("  was over before", flush=True)
            revert(window, folder / f"{scene}_textures")
            continue
        found = window.ask("changed") + sorted({path.name for path in folder.iterdir()} - {*before, *AIDE})
        print("  " + (f"DIFFERS: {found}" if found else "as before"), flush=True)


AIDE = ("question.json", "answer.json", "shot.bmp", "question.part", "answer.part")
"""What the window and who drives it write to each other."""


def revert(window: Window, textures: Path) -> None:
    """Take a bake out, and its files."""
    window.click_button("bpy.ops.radiosity.revert(")
    window.until(lambda: not window.ask("state")["baked"], "the bake is taken out")
    shutil.rmtree(textures)


def cancel(window: Window, stage: str, into: float) -> bool:
    """Press Esc so many seconds into a stage; whether that cancelled the bake."""
    window.ask("watch")
    window.click_button("bpy.ops.radiosity.bake(")
    window.until(lambda: stage in window.ask("seen") or "ended" in window.ask("seen"), f"stage {stage} is seen")
    time.sleep(max(0.0, window.ask("seen").get(stage, 0.0) + into - time.monotonic()))
    pressed = time.monotonic()
    window.press("Escape")
    seen = ended(window)
    last = max((name for name in seen if name != "ended" and seen[name] <= pressed), key=lambda name: seen[name])
    print(f"  {stage:<14}{seen['ended'] - pressed:6.2f} s  (in {last})", end="", flush=True)
    return not window.ask("state")["baked"]


def ended(window: Window) -> dict[str, float]:
    """What was seen of a bake that is over."""
    window.until(lambda: "ended" in window.ask("seen"), "the bake has ended")
    return dict(window.ask("seen"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("script", type=Path, help="runs a desktop Blender, as tests/desktop/conftest.py says")
    parser.add_argument("scenes", nargs="*", default=list(SCENES), help="default: all")
    parser.add_argument("--quality", default="draft")
    parser.add_argument("--stage", action="append", default=[], help="one to cancel in; may be repeated; default: all")
    arguments = parser.parse_args()
    main(arguments.script.resolve(), arguments.scenes, arguments.quality, arguments.stage)
