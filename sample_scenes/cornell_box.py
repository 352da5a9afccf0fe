# SPDX-License-Identifier: GPL-3.0-or-later
"""The Cornell box as measured: geometry, reflectances and lamp of the real box at Cornell University.

Run it with a Python that has bpy, or in Blender: `python cornell_box.py [OUT.blend]`.

Measurements: Cornell University Program of Computer Graphics, "Cornell Box Data" (1998); the box was first described
by Goral, Torrance, Greenberg and Battaile, "Modeling the Interaction of Light Between Diffuse Surfaces" (1984).
The data's millimetres are centimetres here (the room is 5.53 m wide): Blender's tools and lamps are made for rooms.
The data's x (to the left), y (up), z (into the box) become Blender's -x, z, y, with the camera at x = 0.

Two departures. The lamp, an area lamp of the published rectangle and spectrum, hangs 1 mm under the ceiling. The blocks
have the bottom face that the data leaves out, so that they are closed solids on the floor.

Spectra become linear Rec.709 by Wyman, Sloan and Shirley's fit of the colour matching functions (2013), seen by an eye
adapted to equal-energy white, which is (1, 1, 1).
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from building import BOX_FACES, diffuse, empty_scene, mesh_object, put, sky, write_when_run

WAVELENGTHS = np.arange(400.0, 701.0, 4.0)
"""nm"""

WHITE = """
    .343 .445 .551 .624 .665 .687 .708 .723 .715 .710 .745 .758 .739 .767 .777 .765 .751 .745 .748 .729
    .745 .757 .753 .750 .746 .747 .735 .732 .739 .734 .725 .721 .733 .725 .732 .743 .744 .748 .728 .716
    .733 .726 .713 .740 .754 .764 .752 .736 .734 .741 .740 .732 .745 .755 .751 .744 .731 .733 .744 .731
    .712 .708 .729 .730 .727 .707 .703 .729 .750 .760 .751 .739 .724 .730 .740 .737"""
GREEN = """
    .092 .096 .098 .097 .098 .095 .095 .097 .095 .094 .097 .098 .096 .101 .103 .104 .107 .109 .112 .115
    .125 .140 .160 .187 .229 .285 .343 .390 .435 .464 .472 .476 .481 .462 .447 .441 .426 .406 .373 .347
    .337 .314 .285 .277 .266 .250 .230 .207 .186 .171 .160 .148 .141 .136 .130 .126 .123 .121 .122 .119
    .114 .115 .117 .117 .118 .120 .122 .128 .132 .139 .144 .146 .150 .152 .157 .159"""
RED = """
    .040 .046 .048 .053 .049 .050 .053 .055 .057 .056 .059 .057 .061 .061 .060 .062 .062 .062 .061 .062
    .060 .059 .057 .058 .058 .058 .056 .055 .056 .059 .057 .055 .059 .059 .058 .059 .061 .061 .063 .063
    .067 .068 .072 .080 .090 .099 .124 .154 .192 .255 .287 .349 .402 .443 .487 .513 .558 .584 .620 .606
    .609 .651 .612 .610 .650 .638 .627 .620 .630 .628 .642 .639 .657 .639 .635 .642"""

LAMP = ((400.0, 500.0, 600.0, 700.0), (0.0, 8.0, 15.6, 18.4))
"""nm; emission in the data's own unit, taken as W/(m2 sr)"""

XYZ_TO_REC709 = np.linalg.inv(
    [[0.4123908, 0.3575843, 0.1804808], [0.2126390, 0.7151687, 0.0721923], [0.0193308, 0.1191948, 0.9505322]]
)

FLOOR = [(552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)]
CEILING = [(556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2), (0, 548.8, 0)]
BACK_WALL = [(549.6, 0, 559.2), (0, 0, 559.2), (0, 548.8, 559.2), (556, 548.8, 559.2)]
RIGHT_WALL = [(0, 0, 559.2), (0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2)]
LEFT_WALL = [(552.8, 0, 0), (549.6, 0, 559.2), (556, 548.8, 559.2), (556, 548.8, 0)]
SHORT_BLOCK = (165, [(130, 65), (82, 225), (240, 272), (290, 114)])
TALL_BLOCK = (330, [(423, 247), (265, 296), (314, 456), (472, 406)])
LIGHT = ((213, 343), (227, 332))
"""x and z, at the ceiling"""
EYE = (278, 273, -800)
FOCAL_LENGTH, FILM = 0.035, 0.025

CENTIMETRE = 0.01
LAMP_GAP = 0.001
"""m"""


def rec709(spectrum: np.ndarray) -> tuple[float, float, float]:
    """Linear Rec.709 of a spectrum (76,) at WAVELENGTHS; one that is 1 throughout gives (1, 1, 1)."""

    def lobe(centre: float, below: float, above: float) -> np.ndarray:
        distance = WAVELENGTHS - centre
        return np.exp(-0.5 * (distance * np.where(distance < 0, below, above)) ** 2)

    x = 0.362 * lobe(442.0, 0.0624, 0.0374) + 1.056 * lobe(599.8, 0.0264, 0.0323) - 0.065 * lobe(501.1, 0.049, 0.0382)
    y = 0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322)
    z = 1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725)
    sensitivity = XYZ_TO_REC709 @ [x, y, z]
    red, green, blue = sensitivity @ spectrum / sensitivity.sum(axis=1)
    return float(red), float(green), float(blue)


def reflectance(table: str) -> tuple[float, float, float]:
    """Linear Rec.709 reflectance of a published table."""
    return rec709(np.array(table.split(), float))


def placed(x: float, y: float, z: float) -> tuple[float, float, float]:
    """The data's coordinates in Blender's axes, m."""
    return (EYE[0] - x) * CENTIMETRE, z * CENTIMETRE, y * CENTIMETRE


def block(height: float, outline: list[tuple[float, float]]) -> list[tuple[float, float, float]]:
    """The eight corners of a block on the floor, m: bottom ones first."""
    return [placed(x, y, z) for y in (0, height) for x, z in outline]


def build() -> bpy.types.Scene:
    """Make the scene in Blender."""
    scene = empty_scene()
    sky(scene, (0.0, 0.0, 0.0))
    white = diffuse("White", reflectance(WHITE))
    green = diffuse("Green", reflectance(GREEN))
    red = diffuse("Red", reflectance(RED))
    for name, corners, paint in (
        ("Floor", FLOOR, white),
        ("Ceiling", CEILING, white),
        ("Back Wall", BACK_WALL, white),
        ("Right Wall", RIGHT_WALL, green),
        ("Left Wall", LEFT_WALL, red),
    ):
        mesh_object(name, [placed(*corner) for corner in corners], [(0, 1, 2, 3)], paint)
    for name, shape in (("Short Block", SHORT_BLOCK), ("Tall Block", TALL_BLOCK)):
        mesh_object(name, block(*shape), BOX_FACES, white)

    (left, right), (front, back) = LIGHT
    lamp = bpy.data.lights.new("Lamp", "AREA")
    lamp.shape = "RECTANGLE"
    lamp.size, lamp.size_y = (right - left) * CENTIMETRE, (back - front) * CENTIMETRE
    radiance = rec709(np.interp(WAVELENGTHS, *LAMP))
    lamp.color = [channel / max(radiance) for channel in radiance]
    lamp.energy = max(radiance) * math.pi * lamp.size * lamp.size_y
    x, y, z = placed((left + right) / 2, CEILING[0][1], (front + back) / 2)
    put("Lamp", lamp, (x, y, z - LAMP_GAP), visible_camera=True)

    camera = bpy.data.cameras.new("Camera")
    camera.lens, camera.sensor_width = FOCAL_LENGTH * 1000, FILM * 1000
    scene.camera = put("Camera", camera, placed(*EYE), rotation_euler=(math.pi / 2, 0, 0))
    scene.render.resolution_x = scene.render.resolution_y = 512
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.exposure = 0.8
    scene.cycles.samples = 256
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = 64
    scene.cycles.sample_clamp_indirect = 0.0
    return scene


if __name__ == "__main__":
    write_when_run(build, __file__)
