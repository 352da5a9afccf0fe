# SPDX-License-Identifier: GPL-3.0-or-later
"""A painter's studio of textures: images on several uv maps, procedurals, vertex colours, a lit picture."""

from __future__ import annotations

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "sample_scenes"))
import bpy
import numpy as np
from building import box, diffuse, empty_scene, lathe, mesh_object, smooth, write_when_run
from interior import lamp
from parts import finish, placed_copy, plank, sheet

WIDTH, LENGTH, HEIGHT = 5.5, 4.5, 2.8
SINK = 0.004
Node = bpy.types.ShaderNode


def textured(
    name: str, kind: str, coordinates: str, shader: str = "ShaderNodeBsdfDiffuse", **inputs: object
) -> tuple[bpy.types.Material, Node]:
    """A material whose colour is a texture node's, and that node."""
    made = diffuse(name, (0.8, 0.8, 0.8)) if shader == "ShaderNodeBsdfDiffuse" else bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    if shader != "ShaderNodeBsdfDiffuse":
        tree.nodes.clear()
        own, output = tree.nodes.new(shader), tree.nodes.new("ShaderNodeOutputMaterial")
        tree.links.new(own.outputs[0], output.inputs["Surface"])
    end = next(node for node in tree.nodes if node.bl_idname == shader)
    texture, place = tree.nodes.new(kind), tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(place.outputs[coordinates], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], end.inputs["Color"])
    for key, value in inputs.items():
        texture.inputs[key].default_value = value
    return made, texture


def picture(name: str, values: np.ndarray) -> bpy.types.Image:
    """An image of (H, W, 3) values, sRGB-encoded, kept in the file."""
    height, width = values.shape[:2]
    image = bpy.data.images.new(name, width, height)
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = values
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()
    return image


def build_room() -> None:
    """Brick, marble-like noise, a tiled floor by an image whose uv map repeats, and a ceiling of one colour."""
    tile = np.tile([0.75, 0.7, 0.62], (64, 64, 1))
    tile[:32, :32] = tile[32:, 32:] = [0.25, 0.18, 0.16]
    tile[::32] = tile[:, ::32] = 0.45
    floor, texture = textured("Tiles", "ShaderNodeTexImage", "UV")
    texture.image = picture("Tiles", tile)
    brick, texture = textured("Brick", "ShaderNodeTexBrick", "Object", Scale=4.0)
    texture.inputs["Color1"].default_value, texture.inputs["Color2"].default_value = (
        (0.55, 0.2, 0.12, 1),
        (0.4, 0.13, 0.08, 1),
    )
    texture.inputs["Mortar"].default_value = (0.7, 0.68, 0.62, 1)
    turn = brick.node_tree.nodes.new("ShaderNodeMapping")
    turn.inputs["Rotation"].default_value = (math.radians(90), 0, 0)
    links = brick.node_tree.links
    links.new(texture.inputs["Vector"].links[0].from_socket, turn.inputs["Vector"])
    links.new(turn.outputs[0], texture.inputs["Vector"])
    noise, texture = textured("Marbled", "ShaderNodeTexNoise", "Object", Scale=1.3, Detail=4.0)
    ramp = noise.node_tree.nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (0.08, 0.2, 0.3, 1), (0.8, 0.78, 0.7, 1)
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = 0.35, 0.65
    end = next(node for node in noise.node_tree.nodes if node.type == "BSDF_DIFFUSE")
    noise.node_tree.links.new(texture.outputs[0], ramp.inputs["Fac"])
    noise.node_tree.links.new(ramp.outputs["Color"], end.inputs["Color"])
    white = diffuse("White", (0.8, 0.8, 0.78))
    room = mesh_object(
        "Room", *plank((WIDTH, LENGTH, HEIGHT), (WIDTH / 2, LENGTH / 2, 0)), (white, floor, brick, noise)
    )
    room.data.flip_normals()
    for index, paint in ((0, 1), (4, 2), (3, 3), (5, 3)):
        room.data.polygons[index].material_index = paint
    layer = room.data.uv_layers.new(name="Tiling")
    for loop in room.data.loops:
        x, y, _ = room.data.vertices[loop.vertex_index].co
        layer.data[loop.index].uv = (x / 1.0, y / 1.0)


def build_things() -> None:
    """Cubes by vertex colours, a ball by Voronoi cells, crates of one mesh told apart by random, a gradient canvas."""
    ground = diffuse("Painted", (1, 1, 1))
    tree = ground.node_tree
    painted = tree.nodes.new("ShaderNodeVertexColor")
    painted.layer_name = "Paint"
    tree.links.new(painted.outputs["Color"], next(n for n in tree.nodes if n.type == "BSDF_DIFFUSE").inputs["Color"])
    cube = box("Painted Plinth", (0.7, 0.7, 1.0), ground, (4.3, 3.3, -SINK))
    colors = cube.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    for index, item in enumerate(colors.data):
        item.color = [(0.8, 0.1, 0.1, 1), (0.1, 0.7, 0.2, 1), (0.1, 0.2, 0.8, 1), (0.8, 0.8, 0.2, 1)][index % 4]
    cells, _ = textured("Cells", "ShaderNodeTexVoronoi", "Object", Scale=5.0)
    angles = [math.pi * ring / 16 - math.pi / 2 for ring in range(1, 16)]
    ball = [(0, -0.32), *((0.32 * math.cos(a), 0.32 * math.sin(a)) for a in angles), (0, 0.32)]
    smooth(mesh_object("Ball", *lathe(ball, 32), cells, (4.3, 3.3, 1.31)), 180)
    lot = diffuse("Lot", (0.5, 0.5, 0.5))
    tree = lot.node_tree
    info, ramp = tree.nodes.new("ShaderNodeObjectInfo"), tree.nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (0.7, 0.25, 0.05, 1), (0.1, 0.35, 0.45, 1)
    tree.links.new(info.outputs["Random"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], next(n for n in tree.nodes if n.type == "BSDF_DIFFUSE").inputs["Color"])
    crate = box("Crate 1", (0.5, 0.5, 0.5), lot, (0.6, 3.6, -SINK))
    for number, place in enumerate(((1.3, 3.9, -SINK), (0.8, 3.7, 0.492), (0.6, 2.6, -SINK)), 2):
        placed_copy(crate, f"Crate {number}", place, 17.0 * number)
    glow, texture = textured("Glow", "ShaderNodeTexImage", "UV", "ShaderNodeEmission")
    rows, columns = np.mgrid[0:48, 0:64] / 48.0
    glowing = (
        np.stack([rows, 0.35 + 0 * rows, 0.9 - rows], axis=2)
        * ((rows * 6).astype(int) % 2)[..., None] ** (columns < 0.7)[..., None]
    )
    texture.image = picture("Glow", glowing)
    next(n for n in glow.node_tree.nodes if n.type == "EMISSION").inputs["Strength"].default_value = 9.0
    corners = [
        (1.6, LENGTH - 0.02, 0.9),
        (3.4, LENGTH - 0.02, 0.9),
        (3.4, LENGTH - 0.02, 2.1),
        (1.6, LENGTH - 0.02, 2.1),
    ]
    lit = sheet("Lit Picture", corners, glow)
    layer = lit.data.uv_layers.new(name="Picture")
    for loop, uv in zip(layer.data, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
        loop.uv = uv
    fade, _ = textured("Fade", "ShaderNodeTexGradient", "Generated")
    box("Canvas", (1.2, 0.04, 0.9), fade, (2.4, 0.024, 1.0))
    easel = diffuse("Easel", (0.4, 0.26, 0.14))
    box("Table", (1.3, 0.7, 0.72), easel, (2.5, 2.2, -SINK), 0.01)


def build() -> object:
    """Make the scene in Blender."""
    scene = empty_scene()
    build_room()
    build_things()
    lamp("Ceiling Lamp", "AREA", (2.6, 2.2, HEIGHT - 0.02), 90.0, (1.0, 0.92, 0.8), shape="DISK", size=0.7)
    return finish(scene, (0.4, 0.4, 1.6), -4, -42, 18.0, 0.6)


if __name__ == "__main__":
    write_when_run(build, __file__)
