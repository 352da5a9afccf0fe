# SPDX-License-Identifier: GPL-3.0-or-later
"""What node trees make of lamps' light: how it varies with the direction in which it leaves, and over the distance.

A copy of the lamp, a bare point, hangs in the middle of a white octahedron, of which Cycles bakes the light: any node
tree is told by it, IES files included. Small triangles along the brightest direction tell what becomes of the light on
its way.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from ...arrays import Float32, Float64
from ...errors import SceneError
from ...lighting.distributions import flat_octahedron, on_octahedron
from ...scene import Distribution
from ..looks.closures import rgb
from ..looks.nodes import tree_of
from ..looks.surface_inputs import trees_within
from .cycles_shader import AROUND, bake_mesh
from .subject import Subject

SIZE, IMAGE_SIZE = 512, 1024
"""Texels along the picture of all directions, the second where there are images: the first has 0.2 degrees each. A
downlight's edge of 600 candela within 10 degrees errs by 0.15 % of its brightest direction, by 0.004 % on average."""

COARSE = 64
"""The same of a second picture, from afar, that tells whether the first holds at all distances."""

AFAR = 10.0
"""Times the distance of the first."""

UNLIKE = 0.02
"""Share of the brightest direction by which the two may differ."""

DISTANCES = np.geomspace(1e-3, 1e4, 449)
"""m; 64 a decade: between them the sharpest bend of a smoothed falloff errs by 0.02 %."""

EVEN = 2e-4
"""Relative differences below this are none: a bake's own are 4e-5."""

CANDELA = 4 * math.pi
"""Energy, W, of a point light of 1 W/sr."""

WORLDLY = ("NEW_GEOMETRY", "TEX_COORD", "VECT_TRANSFORM", "OBJECT_INFO", "ATTRIBUTE", "CAMERA", "SCRIPT", "LIGHT_PATH")
"""Types of nodes that may tell how a lamp is turned in the world."""


@dataclass(frozen=True, eq=False)
class LampToMeasure:
    """How a lamp hangs, and what of its light is wanted.

    Attributes:
        frame: (3, 3) columns: unit x, y, z, the way it shines; right-handed
        linear: (3, 3), of its world matrix
        reach: of the picture, as a Distribution has it
        on_sphere: as a Distribution has it
        key: lamps of one node tree and key have the same distribution, each in its own frame
    """

    frame: Float64
    linear: Float64
    reach: float
    on_sphere: bool
    key: tuple[object, ...]

    @classmethod
    def of(cls, light: bpy.types.Light, matrix: Float64) -> LampToMeasure:
        """A point or spot light with a world matrix (4, 4)."""
        linear = matrix[:3, :3]
        frame = _frame(linear)
        nodes = _nodes(light)
        on_sphere = any(_asks_normal(node) for node in nodes)
        is_sphere = not light.use_soft_falloff and light.shadow_soft_size > 0
        narrow = light.type == "SPOT" and not (is_sphere and on_sphere)
        reach = _reach(frame.T @ linear, light.spot_size / 2) if narrow else 1.0
        seen = linear if any(node.type in WORLDLY for node in nodes) else frame.T @ linear
        return cls(frame, linear, reach, on_sphere, (reach, on_sphere, *np.round(seen, 6).ravel().tolist()))


def _asks_normal(node: bpy.types.Node) -> bool:
    """Whether it gives the normal of a lamp that is a sphere; an IES profile by itself goes by the light's way."""
    names = {"NEW_GEOMETRY": ("Normal", "True Normal"), "TEX_COORD": ("Normal",)}.get(node.type, ())
    return any(node.outputs[name].is_linked for name in names)


def _nodes(light: bpy.types.Light) -> list[bpy.types.Node]:
    return [node for tree in trees_within(tree_of(light)) for node in tree.nodes]


def _frame(linear: Float64) -> Float64:
    """Axes (3, 3), in columns, of a lamp's own space without its scale and shear; z is the way it shines."""
    z = -linear[:, 2] / max(float(np.linalg.norm(linear[:, 2])), 1e-30)
    if not z.any():
        return np.diag([1.0, -1.0, -1.0])
    x = linear[:, 0] - z * (z @ linear[:, 0])
    if np.linalg.norm(x) < 1e-9:
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _reach(own: Float64, half_angle: float) -> float:
    """How far a spot's cone goes on the flat octahedron; 1 if that is more than its middle."""
    turn = np.linspace(0, 2 * math.pi, 257)
    sine, cosine = math.sin(half_angle), math.cos(half_angle)
    edge = np.stack([sine * np.cos(turn), sine * np.sin(turn), np.full_like(turn, -cosine)], axis=1) @ own.T
    if edge[:, 2].min() <= 0:
        return 1.0
    widest = 1.03 * float(np.abs(flat_octahedron(edge)).max()) + 1e-3
    return widest if widest < 0.5 else 1.0


Measured = tuple[tuple[float, float, float], Distribution | None, tuple[str, ...]]
"""Intensity in the brightest direction, W/sr of a lamp of 1 W/sr; the distribution; what there is to say of it."""


def measure_lamp(subject: Subject, lamp: LampToMeasure) -> Generator[None, None, Measured]:
    """How a lamp's light is distributed. Until the end nothing else may change the file.

    Args:
        subject: "light" is the original, left as found

    Raises:
        SceneError: Cycles is disabled
    """
    light = subject.datablocks["light"]
    said = tuple(_missing_files(light))
    images = any(
        node.type in ("TEX_IMAGE", "TEX_ENVIRONMENT") for tree in trees_within(tree_of(light)) for node in tree.nodes
    )
    size = IMAGE_SIZE if images else SIZE
    with ExitStack() as stack:
        studio = stack.enter_context(_Studio(subject, lamp))
        shown = studio.directions(lamp.reach, size, 1.0)
        yield
        level = np.abs(shown).max(2) * (1 + 0.01 * _directions(lamp.reach, size)[:, :, 2])  # of a lit half its middle
        brightest = np.unravel_index(int(np.argmax(level)), level.shape)
        if not level[brightest]:
            return (0.0, 0.0, 0.0), None, said
        falloff = studio.along(_directions(lamp.reach, size)[brightest])
        yield
        if falloff is not None:
            shown /= _at(falloff, _distances(lamp.reach, size))[:, :, None]
            afar = studio.directions(lamp.reach, COARSE, AFAR)
            afar /= _at(falloff, AFAR * _distances(lamp.reach, COARSE))[:, :, None]
            near = studio.directions(lamp.reach, COARSE, 1.0)
            near /= _at(falloff, _distances(lamp.reach, COARSE))[:, :, None]
            if np.abs(afar - near).max() > UNLIKE * np.abs(near).max():
                said += ("has nodes that make other pictures near than far, which are taken as from 1 m",)
    peak = shown.reshape(-1, 3)[np.argmax(np.abs(shown).reshape(-1, 3), axis=0), range(3)].astype(np.float64)
    directions = shown / np.where(peak, peak, 1).astype(np.float32)
    lit = directions[:, :, peak != 0]
    if np.ptp(lit, axis=(0, 1)).max() < EVEN:
        directions = np.ones((1, 1, 1), np.float32)
    elif np.ptp(lit, axis=2).max() < EVEN:
        directions = np.ascontiguousarray(lit[:, :, :1])
    if falloff is None and directions.size == 1:
        return rgb(peak), None, said
    x, y, z = (rgb(axis) for axis in np.eye(3))
    return rgb(peak), Distribution(directions, (x, y, z), lamp.reach, falloff, lamp.on_sphere), said


def placed(distribution: Distribution, frame: Float64) -> Distribution:
    """A distribution measured in a lamp's own frame (3, 3), in the world's."""
    x, y, z = (rgb(axis) for axis in frame.T)
    return replace(distribution, axes=(x, y, z))


def _missing_files(light: bpy.types.Light) -> Generator[str, None, None]:
    for node in (node for node in _nodes(light) if node.type == "TEX_IES"):
        if node.mode == "INTERNAL":
            if node.ies is None:
                yield f"{node.name} has no text to read an IES profile from: it gives 100, as in Cycles"
        elif not Path(bpy.path.abspath(node.filepath, library=light.library)).is_file():
            yield f"{node.name} lacks its IES file {node.filepath!r}: it gives 100, as in Cycles"


def _grid(reach: float, size: int) -> Float64:
    """Points (size, size, 3) of the unit octahedron at a picture's texel centres."""
    along = ((np.arange(size) + 0.5) / size * 2 - 1) * reach
    return on_octahedron(np.stack(np.meshgrid(along, along), axis=-1))


def _distances(reach: float, size: int) -> Float64:
    return np.asarray(np.linalg.norm(_grid(reach, size), axis=-1))


def _directions(reach: float, size: int) -> Float64:
    grid = _grid(reach, size)
    return np.asarray(grid / np.linalg.norm(grid, axis=-1, keepdims=True))


def _at(falloff: Float64, distance: Float64) -> Float64:
    logarithms = np.log(falloff)
    return np.exp(np.interp(np.log(distance), *logarithms.T))


class _Studio:
    """A scene for the moment in which the lamp lights white triangles."""

    def __init__(self, subject: Subject, lamp: LampToMeasure) -> None:
        self.subject = subject
        self.lamp = lamp
        self.stack = ExitStack()

    def __enter__(self) -> _Studio:
        with ExitStack() as stack:
            self.scene = bpy.data.scenes.new("Radiosity")
            stack.callback(bpy.data.scenes.remove, self.scene)
            _set_up(self.scene)
            self.subject.pose(self.scene)
            self.scene.cycles.shading_system = self.subject.osl
            light = self.subject.datablocks["light"].copy()
            stack.callback(bpy.data.lights.remove, light)  # takes its object along
            _make_bare(light)
            thing = bpy.data.objects.new("Radiosity", light)
            matrix = np.eye(4)
            matrix[:3, :3] = self.lamp.linear
            thing.matrix_world = matrix.T
            self.scene.collection.objects.link(thing)
            self.material = bpy.data.materials.new("Radiosity")
            stack.callback(bpy.data.materials.remove, self.material)
            _make_white(self.material)
            self.stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self.stack.close()

    def directions(self, reach: float, size: int, scale: float) -> Float32:
        """Intensity, W/sr, in directions (size, size, 3); the octahedron's corners lie `scale` away, m."""
        corners = np.array([[(0, 0), (x, 0), (0, y)] for x in (1, -1) for y in (1, -1)], np.float64)
        outer = corners[:, [1, 2, 0]]
        outer[:, 2] = corners[:, 1] + corners[:, 2]
        flat = np.concatenate([corners, outer]) * reach
        octahedron = on_octahedron(flat)
        shown = self._bake(octahedron * scale, (flat / reach + 1) / 2, size)
        square = (_grid(reach, size) ** 2).sum(-1)
        return np.asarray(shown * (scale**2 * math.sqrt(3) * square**1.5)[:, :, None], np.float32)

    def along(self, direction: Float64) -> Float64 | None:
        """What becomes of the light over the distance, as a Distribution has it, one at 1 m; None if nothing does."""
        size = math.ceil(math.sqrt(len(DISTANCES)))
        side = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
        side /= np.linalg.norm(side)
        plane = np.stack([side, np.cross(direction, side)])
        corners = DISTANCES[:, None, None] * (direction + 1e-4 * AROUND @ plane)
        index = np.arange(len(DISTANCES))
        cell = np.stack([index % size, index // size], axis=1)
        uv = (cell[:, None] + 0.5 + AROUND) / size
        shown = np.abs(self._bake(corners, uv, size).reshape(-1, 3)[index].astype(np.float64)).sum(1) * DISTANCES**2
        shown /= max(float(np.interp(0, np.log(DISTANCES), shown)), 1e-300)
        if np.abs(shown - 1).max() < EVEN:
            return None
        return np.stack([DISTANCES, np.maximum(shown, 1e-30)], axis=1)

    def _bake(self, corners: Float64, uv: Float64, size: int) -> Float32:
        """Irradiance (size, size, 3), W/m2, of triangles (F, 3, 3), in the lamp's frame, that face the lamp."""
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        away = (normal * corners.mean(1)).sum(1) > 0
        corners, uv = (np.where(away[:, None, None], part[:, ::-1], part) for part in (corners, uv))
        image = bpy.data.images.new("Radiosity", size, size, alpha=True, float_buffer=True, is_data=True)
        mesh = bpy.data.meshes.new("Radiosity")
        try:
            points = corners.reshape(-1, 3) @ self.lamp.frame.T
            mesh.from_pydata(points.tolist(), [], np.arange(len(points)).reshape(-1, 3).tolist())
            layer = mesh.uv_layers.new(name="Radiosity", do_init=False)
            layer.uv.foreach_set("vector", uv.astype(np.float32).ravel())
            mesh.materials.append(self.material)
            self.material.node_tree.nodes.active.image = image
            bake_mesh(self.scene, mesh, np.eye(4), type="DIFFUSE", pass_filter={"DIRECT"})
            pixels = np.empty(4 * size * size, np.float32)
            image.pixels.foreach_get(pixels)
            return pixels.reshape(size, size, 4)[:, :, :3] * np.float32(math.pi)
        finally:
            bpy.data.meshes.remove(mesh)  # takes its object along
            bpy.data.images.remove(image)


def _make_bare(light: bpy.types.Light) -> None:
    """A white point of 1 W/sr that shines all around, or to one side, and through everything."""
    light.animation_data_clear()
    light.energy, light.color = CANDELA, (1, 1, 1)
    light.shadow_soft_size, light.use_soft_falloff, light.use_shadow = 0, True, False
    if light.type == "SPOT":
        light.spot_size, light.spot_blend = math.pi, 0
    for name, value in (("exposure", 0), ("use_temperature", False), ("normalize", True)):
        if hasattr(light, name):
            setattr(light, name, value)


def _make_white(material: bpy.types.Material) -> None:
    if material.node_tree is None:  # before Blender 5
        material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    white, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    white.inputs["Color"].default_value = (1, 1, 1, 1)
    material.node_tree.links.new(white.outputs[0], output.inputs["Surface"])
    nodes.active = nodes.new("ShaderNodeTexImage")


def _set_up(scene: bpy.types.Scene) -> None:
    """One sample at the centre of each texel, of light that has come straight from the lamp."""
    try:
        scene.render.engine = "CYCLES"
    except TypeError as error:
        raise SceneError(
            "Cycles",
            "it is disabled, and no one else can tell how lamps with nodes shine",
            "Enable it in the preferences",
        ) from error
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples, cycles.max_bounces = 1, 0
    cycles.light_sampling_threshold = cycles.sample_clamp_direct = 0
    cycles.use_adaptive_sampling = cycles.use_denoising = cycles.use_auto_tile = False
