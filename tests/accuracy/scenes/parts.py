# SPDX-License-Identifier: GPL-3.0-or-later
"""What the suite's scenes share beyond what the sample scenes do: sheets, planks, copies, a sun, a camera."""

from __future__ import annotations

import math
from collections.abc import Sequence

import bpy
from building import RGB, Paint, Point, Shape, box_shape, mesh_object, put


def sheet(name: str, corners: Sequence[Point], paint: Paint, **attributes: object) -> bpy.types.Object:
    """One face without thickness; its front is where the corners run anticlockwise."""
    return mesh_object(name, list(corners), [tuple(range(len(corners)))], paint, **attributes)


def plank(size: Point, place: Point) -> Shape:
    """A box of a given size about a place, its lowest face's centre."""
    (width, depth, height), (x, y, z) = size, place
    return box_shape((x - width / 2, y - depth / 2, z), (x + width / 2, y + depth / 2, z + height))


def placed_copy(original: bpy.types.Object, name: str, place: Point, turn: float = 0.0) -> bpy.types.Object:
    """Another object of the same mesh, turned about z by so many degrees, with copies of its modifiers."""
    made = original.copy()
    made.name, made.location = name, place
    made.rotation_euler = (*original.rotation_euler[:2], original.rotation_euler[2] + math.radians(turn))
    bpy.context.scene.collection.objects.link(made)
    return made


def sun(
    scene: bpy.types.Scene, power: float, tilt: float, turn: float, color: RGB = (1, 1, 1), angle: float = 0.53
) -> None:
    """A sun `tilt` degrees off the zenith, its light going towards +y turned by `turn` degrees about z."""
    data = bpy.data.lights.new("Sun", "SUN")
    data.energy, data.color, data.angle = power, color, math.radians(angle)
    put("Sun", data, (0, 0, 8), rotation_euler=(math.radians(tilt), 0, math.radians(turn)))


def finish(
    scene: bpy.types.Scene, eye: Point, pitch: float, turn: float, lens: float = 18.0, exposure: float = 0.0
) -> bpy.types.Scene:
    """Camera and render settings; the camera looks along +y, pitched up from level and turned about z, in degrees."""
    camera = bpy.data.cameras.new("Camera")
    camera.lens = lens
    scene.camera = put("Camera", camera, eye, rotation_euler=(math.radians(90 + pitch), 0, math.radians(turn)))
    scene.render.resolution_x, scene.render.resolution_y = 640, 400
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.exposure = exposure
    scene.cycles.samples = 64
    return scene
