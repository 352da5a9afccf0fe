# SPDX-License-Identifier: GPL-3.0-or-later
"""A dining hall of instances: tables with chairs as a collection, plates on points by geometry nodes."""

from __future__ import annotations

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "sample_scenes"))
import bpy
from building import box, diffuse, empty_scene, joined, lathe, mesh_object, put, smooth, write_when_run
from interior import lamp
from parts import finish, placed_copy, plank

WIDTH, LENGTH, HEIGHT = 8.0, 6.5, 3.2
SINK = 0.004


def collected(name: str, things: list[bpy.types.Object]) -> bpy.types.Collection:
    """Objects moved into a collection that is not in the scene."""
    collection = bpy.data.collections.new(name)
    for thing in things:
        for owner in list(thing.users_collection):
            owner.objects.unlink(thing)
        collection.objects.link(thing)
    return collection


def table_for_four() -> bpy.types.Collection:
    """A table and four chairs of one mesh."""
    oak, red = diffuse("Oak", (0.45, 0.3, 0.17)), diffuse("Red Seat", (0.5, 0.12, 0.08))
    top = box("Table Top", (1.2, 0.9, 0.04), oak, (0, 0, 0.71))
    feet = [plank((0.07, 0.07, 0.716), (x, y, -SINK)) for x in (-0.5, 0.5) for y in (-0.36, 0.36)]
    legs = mesh_object("Table Legs", *joined(feet), oak)
    frame = [plank((0.42, 0.42, 0.04), (0, 0, 0.43)), plank((0.42, 0.04, 0.5), (0, 0.19, 0.46))]
    frame += [plank((0.04, 0.04, 0.44), (x, y, -SINK)) for x in (-0.18, 0.18) for y in (-0.18, 0.18)]
    chair = mesh_object("Chair 1", *joined(frame), red, (0, 0.62, 0))
    chairs = [chair, placed_copy(chair, "Chair 2", (0, -0.62, 0), 180)]
    chairs += [placed_copy(chair, "Chair 3", (0.8, 0, 0), -90), placed_copy(chair, "Chair 4", (-0.8, 0, 0), 80)]
    return collected("Table for Four", [top, legs, *chairs])


def scattered(name: str, spots: list[tuple[float, float, float]], what: bpy.types.Object) -> bpy.types.Object:
    """An object whose points carry instances of another, by geometry nodes."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(spots, [], [])
    holder = put(name, mesh)
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    place, info = tree.nodes.new("GeometryNodeInstanceOnPoints"), tree.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = what
    info.inputs["As Instance"].default_value = True
    tree.links.new(start.outputs[0], place.inputs["Points"])
    tree.links.new(info.outputs["Geometry"], place.inputs["Instance"])
    tree.links.new(place.outputs[0], end.inputs[0])
    holder.modifiers.new("Scatter", "NODES").node_group = tree
    return holder


def build() -> object:
    """Make the scene in Blender."""
    scene = empty_scene()
    paints = [
        diffuse("Wall", (0.72, 0.68, 0.6)),
        diffuse("Floor", (0.35, 0.27, 0.2)),
        diffuse("Green", (0.12, 0.3, 0.2)),
    ]
    room = mesh_object("Room", *plank((WIDTH, LENGTH, HEIGHT), (WIDTH / 2, LENGTH / 2, 0)), paints)
    room.data.flip_normals()
    room.data.polygons[0].material_index, room.data.polygons[5].material_index = 1, 2
    group = table_for_four()
    tables = [(x, y) for y in (1.6, 4.7) for x in (1.6, 4.0, 6.4)]
    for number, (x, y) in enumerate(tables, 1):
        holder = put(f"Table {number}", None, (x, y, 0), rotation_euler=(0, 0, math.radians(9 * number - 20)))
        holder.instance_type, holder.instance_collection = "COLLECTION", group
    profile = [(0, 0), (0.07, 0), (0.13, 0.02), (0.125, 0.022), (0.065, 0.006), (0, 0.006)]
    plate = smooth(mesh_object("Plate", *lathe(profile, 28), diffuse("China", (0.8, 0.8, 0.76))), 60)
    spots = [(x + dx, y + dy, 0.7495) for x, y in tables for dx, dy in ((0.0, 0.25), (0.0, -0.25), (0.35, 0.02))]
    scattered("Plates", spots, plate)
    plate.hide_render = plate.hide_viewport = False
    plate.location = (0.6, 6.1, 0.9)
    box("Sideboard", (1.6, 0.5, 0.9), paints[2], (0.9, 6.1, -SINK))
    for number, (x, y) in enumerate(((2.6, 3.2), (5.6, 3.2)), 1):
        lamp(f"Ceiling {number}", "AREA", (x, y, HEIGHT - 0.02), 120.0, (1, 0.88, 0.72), shape="DISK", size=0.8)
    lamp("Bulb", "POINT", (4.0, 5.9, 2.4), 30.0, (1, 0.7, 0.45), shadow_soft_size=0.12)
    return finish(scene, (7.7, 0.3, 1.9), -8, 48, 18.0, 0.4)


if __name__ == "__main__":
    write_when_run(build, __file__)
