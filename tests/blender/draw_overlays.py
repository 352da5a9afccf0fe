# SPDX-License-Identifier: GPL-3.0-or-later
"""Run by test_overlay_drawing in a process of its own: draws overlays on a graphics card, or what stands in for one.

Its last line is JSON: colours and opacity, from 0 to 1, at points of small pictures of a square of 2 m, and what is
left of overlays that are turned on and off. It ends with the code 77 where nothing can be drawn without a window.
"""

import json
import sys
import weakref
from pathlib import Path
from types import SimpleNamespace

import bpy
import gpu
import numpy as np
from mathutils import Matrix

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import radiosity_addon.blender
from radiosity_addon.blender.judging import overlays
from radiosity_addon.blender.judging.overlay_data import Placed, Shape
from radiosity_addon.blender.judging.overlay_drawing import Look, Painter
from radiosity_addon.reports.texel_maps import INVALID, PATCHED, UNUSED

CANNOT = 77
EDGE = 64
"""Pixels along an edge of a picture, which shows 2 m."""
CORNERS = np.float32([[[-1, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1, -1, 0], [1, 1, 0], [-1, 1, 0]]])
WHOLE = np.float32([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]])
SPLIT = WHOLE.copy()
SPLIT[1] += 2
"""The two triangles apart, so that the diagonal is a seam."""

UPPER_RIGHT, LOWER_LEFT, CENTRE, LOW_EDGE = (0.7, 0.3), (-0.7, -0.3), (0.0, 0.0), (0.0, -0.99)
FROM_ABOVE, FROM_BELOW = Matrix.Identity(4), Matrix.Rotation(np.pi, 4, "Y")


def square(uv=WHOLE, back_uv=None):
    return Shape(np.array([[0, 1, 2], [0, 2, 3]], np.int32), CORNERS, uv, back_uv)


def pages():
    """A page whose right half is brighter, one of a single value, and their texels: two patches, two invalid rows."""
    halves = np.full((8, 8, 3), 0.1, np.float32)
    halves[:, 4:] = 0.5
    texels = np.full((8, 8), PATCHED + 4, np.int32)
    texels[:, 4:] = PATCHED + 9
    texels[:2] = INVALID
    light = [halves, np.full((8, 8, 3), 0.2, np.float32), np.full((8, 8, 3), (4.0, 2.0, 0.0), np.float32)]
    return SimpleNamespace(light=lambda page: light[page], texels=[texels, np.full((8, 8), UNUSED, np.int32)])


class Pictures:
    """Takes small pictures from above or below."""

    def __init__(self):
        self.painter = Painter()
        self.screen = gpu.types.GPUOffScreen(EDGE, EDGE, format="RGBA32F")

    def take(self, look, *things, view=FROM_ABOVE):
        """Pixels (EDGE, EDGE, 4), row 0 below; things are (matrix, shape) and what Placed takes more."""
        placed = []
        for matrix, shape, more in things:
            thing = Placed("", None, "", (id(shape),), np.array(matrix, np.float64), **({"page": 0} | more))
            placed.append((thing, shape, 256.0))
        projection = Matrix.Diagonal((1, 1, -0.1, 1))
        with self.screen.bind(), gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
            buffer = gpu.state.active_framebuffer_get()
            buffer.clear(color=(0, 0, 0, 0), depth=1.0)
            gpu.matrix.load_matrix(view)
            gpu.matrix.load_projection_matrix(projection)
            self.painter.draw(placed, pages(), look)
            return np.array(buffer.read_color(0, 0, EDGE, EDGE, 4, 0, "FLOAT").to_list())

    def at(self, point, *taken, **options):
        picture = self.take(*taken, **options)
        column, row = (int((along + 1) / 2 * EDGE) for along in point)
        return [round(float(number), 5) for number in picture[row, column]]


def results():
    pictures, here, plain = Pictures(), Matrix.Identity(4), square()
    lighting, mirrored = Look("lighting"), Matrix.Diagonal((-1, 1, 1, 1))
    two_sided = square(back_uv=WHOLE)
    sides = {"back_page": 1}
    lower = Matrix.Translation((0, 0, -0.5))
    density = pictures.take(Look("density", target=128.0), (here, plain, {}))[..., :3]
    wide = Matrix.Diagonal((4, 1, 1, 1))
    return {
        "bright half": pictures.at(UPPER_RIGHT, lighting, (here, plain, {})),
        "dark half": pictures.at(LOWER_LEFT, lighting, (here, plain, {})),
        "between texels": pictures.at(CENTRE, lighting, (here, plain, {})),
        "texels as they are": pictures.at(CENTRE, Look("lighting", sharp=True), (here, plain, {})),
        "brighter": pictures.at(LOWER_LEFT, Look("lighting", gain=2.0), (here, plain, {})),
        "beyond white": pictures.at(CENTRE, lighting, (here, plain, {"page": 2})),
        "half opaque": pictures.at(UPPER_RIGHT, Look("lighting", opacity=0.5), (here, plain, {})),
        "own place": pictures.at(LOWER_LEFT, lighting, (here, plain, {"place": (0.5, 0.5, 0.0)})),
        "front": pictures.at(LOWER_LEFT, lighting, (here, two_sided, sides)),
        "back": pictures.at(UPPER_RIGHT, lighting, (here, two_sided, sides), view=FROM_BELOW),
        "front, mirrored": pictures.at(UPPER_RIGHT, lighting, (mirrored, two_sided, sides)),
        "back, mirrored": pictures.at(LOWER_LEFT, lighting, (mirrored, two_sided, sides), view=FROM_BELOW),
        "behind another": pictures.at(UPPER_RIGHT, lighting, (here, plain, {}), (lower, plain, {"page": 1})),
        "illuminance": pictures.at(UPPER_RIGHT, Look("illuminance", ends=(100.0, 10000.0)), (here, plain, {})),
        "density as wanted": density.mean(axis=(0, 1)).tolist(),
        "density, stretched": pictures.take(Look("density", target=128.0), (wide, plain, {}))[..., :3]
        .mean(axis=(0, 1))
        .tolist(),
        "squares": [float(density[: EDGE // 2, :2].mean()), float(density.std())],
        "chart": pictures.at(UPPER_RIGHT, Look("charts"), (here, square(SPLIT), {})),
        "other chart": pictures.at((-0.7, 0.3), Look("charts"), (here, square(SPLIT), {})),
        "seam": pictures.at(CENTRE, Look("charts"), (here, square(SPLIT), {})),
        "no seam": pictures.at(CENTRE, Look("charts"), (here, plain, {})),
        "patch": pictures.at(UPPER_RIGHT, Look("patches"), (here, plain, {})),
        "other patch": pictures.at((-0.7, 0.3), Look("patches"), (here, plain, {})),
        "edge of a patch": pictures.at((0.0, 0.3), Look("patches"), (here, plain, {})),
        "no patch": pictures.at(CENTRE, Look("patches"), (here, plain, {"page": 1})),
        "invalid": pictures.at((0.3, -0.8), Look("invalid"), (here, plain, {})),
        "valid": pictures.at(UPPER_RIGHT, Look("invalid"), (here, plain, {})),
    }


def session():
    """What is left of an overlay that is turned on and off, on while another file is opened, and on at the end."""
    handlers = bpy.app.handlers
    events = (handlers.depsgraph_update_post, handlers.undo_post, handlers.redo_post, handlers.load_pre)

    def ours():
        return sum("overlays" in function.__module__ for functions in events for function in functions)

    radiosity_addon.blender.register()
    before, found = ours(), {}
    overlays.show("charts")
    painter = weakref.ref(overlays.Shown.overlay.painter)
    overlays.show("patches")
    found["on"] = [overlays.Shown.name(), len(overlays.Shown.handlers), ours() - before]
    found["same painter"] = overlays.Shown.overlay.painter is painter()
    overlays.show(overlays.OFF)
    found["off"] = [overlays.Shown.name(), len(overlays.Shown.handlers), ours() - before]
    found["freed"] = painter() is None
    overlays.show("charts")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    found["other file"] = [overlays.Shown.name(), len(overlays.Shown.handlers), ours() - before]
    overlays.show("charts")
    radiosity_addon.blender.unregister()
    found["disabled"] = [overlays.Shown.name(), len(overlays.Shown.handlers), ours() - before]
    return found


def main():
    try:
        gpu.init()
    except (AttributeError, SystemError, RuntimeError):
        sys.exit(CANNOT)
    sys.stdout.write(json.dumps({"pictures": results(), "session": session()}) + "\n")


if __name__ == "__main__":
    main()
