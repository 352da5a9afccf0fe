# SPDX-License-Identifier: GPL-3.0-or-later
"""What it costs to ask Cycles how materials look: `python benchmarks/materials.py [--count N] [--size N]`.

A wall of tiles fills one page, each tile with a procedural material of its own: noise, Voronoi cells, waves or bricks
mixed with noise drive a Principled BSDF, by generated or object coordinates in turn. Seconds and processor seconds of
each quantity that a bake asks for, for a million texels; the best of three.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from radiosity_addon.blender.reading.cycles_shader import CyclesShader  # noqa: E402
from radiosity_addon.blender.reading.extract import extract_scene  # noqa: E402
from radiosity_addon.shading import Layout  # noqa: E402

TEXTURES = ("ShaderNodeTexNoise", "ShaderNodeTexVoronoi", "ShaderNodeTexWave", "ShaderNodeTexBrick")
PLACES = ("Generated", "Object")


def procedural(number: int) -> bpy.types.Material:
    """A texture over noise, which drives colour and glow."""
    material = bpy.data.materials.new(f"Procedural {number}")
    if material.node_tree is None:  # before Blender 5.0
        material.use_nodes = True
    tree = material.node_tree
    place = tree.nodes.new("ShaderNodeTexCoord").outputs[PLACES[number % 2]]
    noise = tree.nodes.new("ShaderNodeTexNoise")
    texture = tree.nodes.new(TEXTURES[number % len(TEXTURES)])
    mix, ramp = tree.nodes.new("ShaderNodeMixRGB"), tree.nodes.new("ShaderNodeValToRGB")
    noise.inputs["Scale"].default_value, texture.inputs["Scale"].default_value = 3 + number % 7, 2 + number % 5
    ramp.color_ramp.elements[0].color = (0.1 + 0.015 * number, 0.4, 0.2, 1)
    tree.links.new(place, noise.inputs["Vector"])
    tree.links.new(place, texture.inputs["Vector"])
    tree.links.new(noise.outputs[0], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], mix.inputs["Color1"])
    tree.links.new(texture.outputs["Color"], mix.inputs["Color2"])
    shader = tree.nodes["Principled BSDF"]
    tree.links.new(mix.outputs["Color"], shader.inputs["Base Color"])
    tree.links.new(noise.outputs[0], shader.inputs["Emission Color"])
    shader.inputs["Emission Strength"].default_value = 1
    return material


def wall(count: int) -> int:
    """A square of tiles, as many a side as `count` of them need; returns how many that are."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    side = math.ceil(math.sqrt(count))
    for number in range(count):
        bpy.ops.mesh.primitive_grid_add(
            x_subdivisions=8, y_subdivisions=8, size=1, location=(number % side, number // side, 0)
        )
        bpy.context.object.data.materials.append(procedural(number))
    return side


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--count", type=int, default=50, help="tiles and materials")
    parser.add_argument("--size", type=int, default=1024, help="texels along the edge of the page")
    options = parser.parse_args()
    side = wall(options.count)
    extraction = extract_scene(bpy.context.scene)
    # The wall's plan is its layout: each tile lies on the page as it does in the scene, and its neighbours touch it.
    uv = tuple((mesh.vertices[mesh.triangles][..., :2] + 0.5) / side for mesh in extraction.scene.meshes)
    layout = Layout(options.size, 1, np.zeros(options.count, np.int32), uv)
    shader, every = CyclesShader(bpy.context.scene.name, extraction), np.ones(options.count, bool)
    texels = options.size**2 * options.count / side**2 / 1e6
    print(f"{options.count} materials, {texels:.2f} million texels")
    print("| quantity | seconds a million texels | processor seconds |\n| --- | --- | --- |")
    for quantity in ("reflectance", "emission"):
        seconds = processor = np.inf
        for _ in range(3):
            start = time.perf_counter(), time.process_time()
            page = shader(layout, every, quantity)
            seconds = min(seconds, (time.perf_counter() - start[0]) / texels)
            processor = min(processor, (time.process_time() - start[1]) / texels)
        if not page.any():
            raise SystemExit(f"{quantity}: the page is black")
        print(f"| {quantity} | {seconds:.2f} | {processor:.2f} |", flush=True)


if __name__ == "__main__":
    main()
