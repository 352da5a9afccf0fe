# SPDX-License-Identifier: GPL-3.0-or-later
"""An attic under a gabled roof, closed but for one window in the gable: low sun and sky."""

from __future__ import annotations

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "sample_scenes"))
from building import Point, Shape, box, diffuse, empty_scene, joined, lathe, mesh_object, sky, smooth, write_when_run
from parts import finish, plank, sun

WIDTH, LENGTH, KNEE, RIDGE = 5.0, 6.0, 1.1, 3.3
WALL = 0.25
SINK = 0.004


def pentagon(low: float, half: float, knee: float, ridge: float, y: float) -> list[Point]:
    """The outline of a gabled house about x = WIDTH / 2, clockwise seen from y below."""
    middle = WIDTH / 2
    return [
        (middle - half, y, low),
        (middle + half, y, low),
        (middle + half, y, knee),
        (middle, y, ridge),
        (middle - half, y, knee),
    ]


def shell() -> Shape:
    """The attic as one closed solid: a tube of pentagons that turns inside out at the window."""
    inside, window = (0.0, WIDTH / 2, KNEE, RIDGE), (0.8, 0.65, 1.7, 2.25)
    outside = (-WALL, WIDTH / 2 + WALL, KNEE + 0.1, RIDGE + 0.35)
    rings = [(inside, 0.0), (inside, LENGTH), (window, LENGTH), (window, LENGTH + WALL)]
    rings += [(outside, LENGTH + WALL), (outside, -WALL)]
    points = [point for outline, y in rings for point in pentagon(*outline, y)]
    faces: list[tuple[int, ...]] = [(25, 26, 27, 28, 29), (4, 3, 2, 1, 0)]
    for first in range(0, 25, 5):
        for side in range(5):
            after = (side + 1) % 5
            faces.append((first + side, first + after, first + 5 + after, first + 5 + side))
    return points, faces


def build() -> object:
    """Make the scene in Blender."""
    scene = empty_scene()
    sky(scene, (0.6, 0.78, 1.0), 3.0)
    plaster, boards = diffuse("Plaster", (0.8, 0.77, 0.7)), diffuse("Boards", (0.45, 0.3, 0.17))
    walls = mesh_object("Attic", *shell(), (plaster, boards))
    walls.data.polygons[2].material_index = 1
    oak = diffuse("Oak Beams", (0.28, 0.17, 0.09))
    for number, y in enumerate((1.0, 2.6, 4.2), 1):
        box(f"Tie Beam {number}", (2.7, 0.16, 0.18), oak, (WIDTH / 2, y, 2.2))
        box(f"Post {number}", (0.14, 0.14, 2.2 + SINK), oak, (3.6, y, -SINK))
    box("Bed Frame", (1.1, 2.1, 0.3), oak, (0.75, 1.4, -SINK))
    box("Mattress", (1.0, 2.0, 0.2), diffuse("Ticking", (0.7, 0.68, 0.62)), (0.75, 1.4, 0.28), 0.05, 2)
    box("Pillow", (0.7, 0.4, 0.14), diffuse("Pillow", (0.75, 0.72, 0.7)), (0.75, 0.65, 0.465), 0.05, 2)
    box("Blanket", (1.06, 1.2, 0.03), diffuse("Blanket", (0.45, 0.09, 0.07)), (0.75, 1.75, 0.475), 0.012)
    box("Trunk", (0.9, 0.5, 0.5), diffuse("Trunk Green", (0.12, 0.2, 0.13)), (1.0, 4.6, -SINK), 0.02).rotation_euler = (
        0,
        0,
        math.radians(17),
    )
    crates = [plank((0.5, 0.4, 0.35), (4.4, 4.9, -SINK)), plank((0.45, 0.36, 0.3), (4.38, 4.9, 0.34))]
    mesh_object("Crates", *joined(crates), diffuse("Crates", (0.5, 0.38, 0.22)))
    rug = lathe([(0, 0.0), (0.9, 0.0), (0.9, 0.015), (0, 0.015)], 48)
    smooth(mesh_object("Rug", *rug, diffuse("Rug", (0.2, 0.28, 0.42)), (2.4, 2.9, -0.003)))
    jar = [(0, 0), (0.09, 0), (0.14, 0.12), (0.12, 0.26), (0.06, 0.3), (0.06, 0.34), (0, 0.34)]
    smooth(mesh_object("Jar", *lathe(jar, 32), diffuse("Jar", (0.6, 0.33, 0.17)), (1.0, 4.6, 0.492)))
    sun(scene, 20.0, -58, 14, (1.0, 0.88, 0.7))
    return finish(scene, (4.4, 0.25, 1.25), -3, 30, 17.0, 1.6)


if __name__ == "__main__":
    write_when_run(build, __file__)
