# SPDX-License-Identifier: GPL-3.0-or-later
"""A terrace under sun and sky: leaves cut out of cards, a stained glass screen, a thin curtain, an acrylic case."""

from __future__ import annotations

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "sample_scenes"))
import bpy
import numpy as np
from building import Paint, box, box_shape, diffuse, empty_scene, mesh_object, sky, smooth, write_when_run
from furniture import sphere
from parts import finish, sheet, sun

WIDTH, LENGTH = 5.0, 4.0
SINK = 0.004
LEAVES = 48
GRAIN = 64
"""Pixels along the picture of a leaf."""


def shaded(name: str, shader: str) -> tuple[Paint, bpy.types.Node]:
    """A material of one shader node, and that node."""
    made = diffuse(name, (0.8, 0.8, 0.8))
    tree = made.node_tree
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    node = tree.nodes.new(shader)
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return made, node


def leaf() -> Paint:
    """A green of two tones whose outline is in the picture's alpha."""
    y, x = (np.mgrid[0:GRAIN, 0:GRAIN] + 0.5) / GRAIN * 2 - 1
    pixels = np.ones((GRAIN, GRAIN, 4), np.float32)
    pixels[..., :3] = np.where(np.abs(x)[..., None] < 0.06, (0.45, 0.6, 0.25), (0.2, 0.45, 0.1))
    pixels[..., 3] = np.abs(x) < 0.75 * (1 - y * y) * (0.8 + 0.2 * np.cos(12 * y))
    image = bpy.data.images.new("Leaf", GRAIN, GRAIN, alpha=True)
    image.alpha_mode = "CHANNEL_PACKED"
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    made, principled = shaded("Leaf", "ShaderNodeBsdfPrincipled")
    principled.inputs["Roughness"].default_value = 0.6
    picture = made.node_tree.nodes.new("ShaderNodeTexImage")
    picture.image = image
    made.node_tree.links.new(picture.outputs["Color"], principled.inputs["Base Color"])
    made.node_tree.links.new(picture.outputs["Alpha"], principled.inputs["Alpha"])
    return made


def stained_glass() -> Paint:
    """Cells of strong colours that light passes unbent."""
    made, clear = shaded("Stained Glass", "ShaderNodeBsdfTransparent")
    nodes, links = made.node_tree.nodes, made.node_tree.links
    cells, strong, place = (nodes.new(f"ShaderNode{kind}") for kind in ("TexVoronoi", "HueSaturation", "TexCoord"))
    cells.inputs["Scale"].default_value = 5.0
    strong.inputs["Saturation"].default_value = 1.6
    links.new(place.outputs["UV"], cells.inputs["Vector"])
    links.new(cells.outputs["Color"], strong.inputs["Color"])
    links.new(strong.outputs["Color"], clear.inputs["Color"])
    return made


def half_clear(name: str, color: tuple[float, float, float], alpha: float) -> Paint:
    """A diffuse surface of which a share is not there."""
    made, principled = shaded(name, "ShaderNodeBsdfPrincipled")
    principled.inputs["Base Color"].default_value = (*color, 1)
    principled.inputs["Alpha"].default_value = alpha
    principled.inputs["Specular IOR Level"].default_value = 0.0
    return made


def mapped(made: bpy.types.Object) -> bpy.types.Object:
    """Give each face, a quad, the whole of the uv square."""
    layer = made.data.uv_layers.new(name="UVMap")
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    layer.data.foreach_set("uv", np.tile(np.float32(square), (len(made.data.polygons), 1)).ravel())
    return made


def foliage() -> None:
    """Cards at heights of 1.9 to 2.5 m over one half of the terrace."""
    rng = np.random.default_rng(5)
    points = []
    for centre in rng.uniform((0.3, 0.4, 1.9), (2.7, 3.4, 2.5), (LEAVES, 3)):
        turn, pitch, roll = rng.uniform((0, -0.6, -0.6), (2 * math.pi, 0.6, 0.6))
        along = np.array([math.cos(turn), math.sin(turn), math.sin(pitch)])
        across = np.array([-math.sin(turn), math.cos(turn), math.sin(roll)])
        points += [centre + 0.22 * (x * along + y * across) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    faces = np.arange(4 * LEAVES).reshape(-1, 4).tolist()
    mapped(mesh_object("Leaves", [tuple(map(float, point)) for point in points], faces, leaf()))


def build() -> object:
    """Make the scene in Blender."""
    scene = empty_scene()
    sky(scene, (0.5, 0.7, 1.0), 1.0)
    sheet("Terrace", [(0, 0, 0), (WIDTH, 0, 0), (WIDTH, LENGTH, 0), (0, LENGTH, 0)], diffuse("Slabs", (0.5, 0.46, 0.4)))
    box("House", (WIDTH, 0.2, 2.6), diffuse("Render", (0.7, 0.66, 0.6)), (WIDTH / 2, LENGTH + 0.1, -SINK))
    oak = diffuse("Oak", (0.3, 0.19, 0.1))
    for number, (x, y) in enumerate(((0.2, 0.3), (2.8, 0.3), (0.2, 3.5), (2.8, 3.5)), 1):
        box(f"Post {number}", (0.12, 0.12, 2.6), oak, (x, y, -SINK))
    for number, y in enumerate((0.3, 1.37, 2.43, 3.5), 1):
        box(f"Beam {number}", (3.0, 0.1, 0.14), oak, (1.5, y, 2.594))
    foliage()
    glass = [(3.1, 1.0, 0.3), (4.7, 1.0, 0.3), (4.7, 1.0, 2.1), (3.1, 1.0, 2.1)]
    mapped(sheet("Stained Glass", glass, stained_glass()))
    cloth = [(3.0, 3.9, 0.1), (3.0, 2.2, 0.1), (3.0, 2.2, 2.2), (3.0, 3.9, 2.2)]
    sheet("Curtain", cloth, half_clear("Linen", (0.75, 0.7, 0.6), 0.45))
    case = box_shape((3.6, 2.4, -SINK), (4.4, 3.2, 0.7))
    mesh_object("Case", *case, half_clear("Acrylic", (0.8, 0.8, 0.8), 0.12))
    smooth(mesh_object("Ball", *sphere(0.2, 48, 24), diffuse("Ball", (0.6, 0.2, 0.1)), (4.0, 2.8, 0.19)))
    sun(scene, 4.0, 35, 20, (1.0, 0.94, 0.85))
    return finish(scene, (4.9, -2.2, 1.8), -8, 25, 20.0, -0.5)


if __name__ == "__main__":
    write_when_run(build, __file__)
