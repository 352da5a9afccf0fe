# SPDX-License-Identifier: GPL-3.0-or-later
"""What the scene scripts share: an empty file, plain materials, solids from a few numbers, saving."""

from __future__ import annotations

import math
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import bpy

Point = tuple[float, float, float]
RGB = tuple[float, float, float]
Span = tuple[float, float]
Paint = bpy.types.Material
Shape = tuple[list[Point], list[tuple[int, ...]]]
"""Points, m, and faces, anticlockwise from outside."""

BOX_FACES = [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
"""Of two rings of four corners, the lower one first."""


def empty_scene() -> bpy.types.Scene:
    """A factory-fresh scene without objects, rendered by Cycles on the processor."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.unit_settings.system = "METRIC"
    return scene


def sky(scene: bpy.types.Scene, color: RGB, strength: float = 1.0) -> None:
    """Give the scene a world of one colour (linear), radiance color * strength, W/(m2 sr)."""
    world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (*color, 1.0)
    background.inputs["Strength"].default_value = strength
    world.color = color
    scene.world = world


def material(name: str, shader: str, **inputs: float | RGB) -> bpy.types.Material:
    """A material of one shader node: `shader` as in bpy ("ShaderNodeBsdfDiffuse"), inputs by name with _ for space."""
    made = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    node = tree.nodes.new(shader)
    for key, value in inputs.items():
        socket = node.inputs[key.replace("_", " ")]
        socket.default_value = (*value, 1.0) if isinstance(value, tuple) else value
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.location = (300, 0)
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    color = inputs.get("Color", inputs.get("Base_Color", (0.8, 0.8, 0.8)))
    made.diffuse_color = (*color, 1.0)
    return made


def diffuse(name: str, color: RGB) -> bpy.types.Material:
    """A Diffuse BSDF of one linear colour."""
    return material(name, "ShaderNodeBsdfDiffuse", Color=color, Roughness=0.0)


def put(name: str, data: bpy.types.ID | None, location: Point = (0, 0, 0), **attributes: object) -> bpy.types.Object:
    """A new object in the scene's collection, with further object attributes by name."""
    made = bpy.data.objects.new(name, data)
    made.location = location
    for key, value in attributes.items():
        setattr(made, key, value)
    bpy.context.scene.collection.objects.link(made)
    return made


def mesh_object(
    name: str,
    points: Sequence[Point],
    faces: Sequence[Sequence[int]],
    materials: bpy.types.Material | Sequence[bpy.types.Material],
    location: Point = (0, 0, 0),
    **attributes: object,
) -> bpy.types.Object:
    """A mesh object of the given points, m, and faces."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    for each in [materials] if isinstance(materials, bpy.types.Material) else materials:
        mesh.materials.append(each)
    mesh.update()
    return put(name, mesh, location, **attributes)


def smooth(made: bpy.types.Object, degrees: float = 40.0) -> bpy.types.Object:
    """Shade smooth, but for edges sharper than the angle."""
    made.data.shade_smooth()
    made.data.set_sharp_from_angle(angle=math.radians(degrees))
    return made


def box_shape(low: Point, high: Point) -> Shape:
    """A box by two opposite corners."""
    ring = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    return [(x, y, z) for z in (low[2], high[2]) for x, y in ring], list(BOX_FACES)


def joined(shapes: Sequence[Shape]) -> Shape:
    """Several shapes as one; they stay parted."""
    points: list[Point] = []
    faces: list[tuple[int, ...]] = []
    for more, sides in shapes:
        faces += [tuple(len(points) + corner for corner in side) for side in sides]
        points += more
    return points, faces


def box(
    name: str,
    size: Point,
    paint: bpy.types.Material,
    location: Point = (0, 0, 0),
    bevel: float = 0.0,
    subdivision: int = 0,
    **attributes: object,
) -> bpy.types.Object:
    """A box centred in x and y on its location, standing on it; edges rounded and smoothed by modifiers."""
    half_x, half_y = size[0] / 2, size[1] / 2
    made = mesh_object(
        name, *box_shape((-half_x, -half_y, 0.0), (half_x, half_y, size[2])), paint, location, **attributes
    )
    if bevel:
        rounded = made.modifiers.new("Bevel", "BEVEL")
        rounded.width, rounded.segments = bevel, 2
        made.data.shade_smooth()
    if subdivision:
        finer = made.modifiers.new("Subdivision", "SUBSURF")
        finer.levels = finer.render_levels = subdivision
    return made


def lathe(profile: Sequence[Span], segments: int, ring: bool = False) -> Shape:
    """A solid turned about z from (radius, z), m, bottom to top on the outside.

    The profile starts and ends on the axis (radius 0), or is a closed loop that never meets it (`ring`).
    """
    points: list[Point] = []
    rows: list[list[int]] = []
    for radius, z in profile:
        count = segments if radius > 0 else 1
        angles = [2 * math.pi * step / segments for step in range(count)]
        rows.append([len(points) + (step if count > 1 else 0) for step in range(segments)])
        points += [(radius * math.cos(angle), radius * math.sin(angle), z) for angle in angles]
    faces = []
    for lower, upper in zip(rows, rows[1:] + rows[:1] if ring else rows[1:], strict=False):
        for step in range(segments):
            after = (step + 1) % segments
            corners = (lower[step], lower[after], upper[after], upper[step])
            faces.append(tuple(dict.fromkeys(corners)))  # a quad at the axis is a triangle
    return points, faces


def lattice(xs: Sequence[float], zs: Sequence[float], depth: float, filled: Callable[[int, int], bool]) -> Shape:
    """A closed solid of the filled cells of a grid in x and z, from y = 0 to y = depth: frames, shelves."""
    numbers: dict[tuple[int, int, int], int] = {}
    faces: list[tuple[int, ...]] = []

    def corner(column: int, row: int, layer: int) -> int:
        return numbers.setdefault((column, row, layer), len(numbers))

    def solid(column: int, row: int) -> bool:
        return 0 <= column < len(xs) - 1 and 0 <= row < len(zs) - 1 and filled(column, row)

    for column in range(len(xs) - 1):
        for row in range(len(zs) - 1):
            if not solid(column, row):
                continue
            ring = [(column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1)]
            faces.append(tuple(corner(*place, 0) for place in ring))
            faces.append(tuple(corner(*place, 1) for place in reversed(ring)))
            neighbours = [(column, row - 1), (column + 1, row), (column, row + 1), (column - 1, row)]
            for side, neighbour in enumerate(neighbours):
                if not solid(*neighbour):
                    here, there = ring[side], ring[(side + 1) % 4]
                    faces.append((corner(*here, 0), corner(*here, 1), corner(*there, 1), corner(*there, 0)))
    return [(xs[column], layer * depth, zs[row]) for column, row, layer in numbers], faces


def room(size: Point, wall: float, window: tuple[Span, Span]) -> Shape:
    """A room with one window as a closed solid, m: inside from 0 to `size`, walls all round.

    The window, given in x and z, goes through the wall at y = size[1]. The first six faces are the outer end, the inner
    end at y = 0, and the inner floor, right wall (x = size[0]), ceiling and left wall.
    """

    def rectangle(x: Span, z: Span, y: float) -> list[Point]:
        return [(x[0], y, z[0]), (x[1], y, z[0]), (x[1], y, z[1]), (x[0], y, z[1])]

    inside = (0.0, size[0]), (0.0, size[2])
    outside = (-wall, size[0] + wall), (-wall, size[2] + wall)
    corners = [
        *rectangle(*inside, 0.0),
        *rectangle(*inside, size[1]),
        *rectangle(*window, size[1]),
        *rectangle(*window, size[1] + wall),
        *rectangle(*outside, size[1] + wall),
        *rectangle(*outside, -wall),
    ]
    faces: list[tuple[int, ...]] = [(20, 21, 22, 23), (3, 2, 1, 0)]
    for first in range(0, 20, 4):  # from each rectangle to the next: a tube that turns inside out at the window
        for side in range(4):
            after = (side + 1) % 4
            faces.append((first + side, first + after, first + 4 + after, first + 4 + side))
    return corners, faces


def write_when_run(build: Callable[[], object], script: str) -> None:
    """Build a scene and save it beside its script, or where the last argument says; compressed, and atomically."""
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    blend = [Path(argument) for argument in arguments if argument.endswith(".blend")]
    target = blend[-1] if blend else Path(script).with_suffix(".blend")
    build()
    with tempfile.TemporaryDirectory() as folder:  # a .blend remembers where it was saved: nowhere in particular
        saved = os.path.join(folder, target.name)
        bpy.context.preferences.filepaths.save_version = 0
        bpy.ops.wm.save_as_mainfile(filepath=saved, compress=True, copy=True)
        shutil.copyfile(saved, target.with_suffix(".blend.new"))
    os.replace(target.with_suffix(".blend.new"), target)
