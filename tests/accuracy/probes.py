# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles as the judge: the light at a few hundred points of a scene, and how far a bake is from it.

A probe is the mean over the footprint of a texel: a square of 16 points on the surface, clipped to it. Each point is a
tiny white triangle just above the surface, facing as the surface does and invisible to every ray that a bake traces; on
smooth-shaded surfaces it is a piece of a copy of their triangle, see `smooth_probes`.
All points are one mesh whose uv map gives each a texel of its own; Cycles bakes diffuse light without colour into it,
many samples, all bounces, nothing clamped. That is irradiance / pi, what a page holds, with no unwrap of ours in
between.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Collection
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from tests.accuracy.smooth_probes import Hosts, host_mesh, strip

POINTS = 16
"""Points of a footprint: a rank-1 lattice, so that an edge of any direction cuts it evenly."""
LATTICE_STEP = 7
EDGE_SHARE = 4e-5
"""Edge of a point's triangle, as a share of the scene's diagonal."""
INSET = 1e-3
"""Least barycentric weight of a probe: one on an edge would reach behind the next wall."""
LIFT_SHARE = 2e-5
"""Height of a point above its surface, as a share of the scene's diagonal: too small to change what it sees."""
BOUNCES = 128
DARK_SHARE = 5e-3
"""Points below this share of the mean lie under something that stands on the surface, and are left out."""
SAME_SIDE = 0.7
"""Least cosine between the normals of a probe and of the triangles that its footprint lies on."""
NEAR_SURFACE = 0.5
"""Those triangles lie this share of the footprint's edge off its plane, at most."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Rec.709"""


@dataclass(frozen=True)
class Surface:
    """The triangles of one object as rendered.

    Attributes:
        corners: (F, 3, 3), m, world space, anticlockwise about the front
        normals: (F, 3, 3) unit shading normals at the corners; None where they are the triangles' own
    """

    name: str
    corners: np.ndarray
    normals: np.ndarray | None = None

    @property
    def flat_normals(self) -> np.ndarray:
        """(F, 3) unit"""
        cross = np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])
        unit: np.ndarray = cross / np.linalg.norm(cross, axis=1, keepdims=True)
        return unit

    @property
    def corner_normals(self) -> np.ndarray:
        """(F, 3, 3) unit"""
        return np.repeat(self.flat_normals[:, None], 3, axis=1) if self.normals is None else self.normals


@dataclass(frozen=True)
class Probes:
    """N points: object (N,) str, position on the surface (N, 3), m, unit normal (N, 3)."""

    object: np.ndarray
    position: np.ndarray
    normal: np.ndarray


@dataclass(frozen=True)
class Footprints:
    """The points of N probes.

    Attributes:
        points: (N, POINTS, 3) on the surface, m
        normals, shading: (N, POINTS, 3) unit, the surface's own normals there and its shading normals
        corners, corner_normals: (N, POINTS, 3, 3) of the triangles that they lie on, m and unit
        there: (N, POINTS) bool, points that the surface has
    """

    points: np.ndarray
    normals: np.ndarray
    shading: np.ndarray
    corners: np.ndarray
    corner_normals: np.ndarray
    there: np.ndarray

    @property
    def hosts(self) -> Hosts:
        """The triangles of the points that are there."""
        return Hosts(self.corners[self.there], self.corner_normals[self.there])


@dataclass(frozen=True)
class References:
    """What Cycles says.

    Attributes:
        object: (N,) name of the object under each probe
        position: (N, 3) point on the surface, m: the middle of the footprint
        normal: (N, 3) unit
        value: (N, 3) irradiance / pi, W/(m2 sr)
        noise: (N, 3) standard error of value, from the seeds' spread
        footprint: edge of the square that each value is the mean over, m
        scene: SHA-256 of the .blend file
        samples: of each seed and point
        seeds: (K,)
        seconds: (K,) rendering time of each
        left_out: dark points that were dropped
        blender: version that rendered
    """

    object: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    value: np.ndarray
    noise: np.ndarray
    footprint: float
    scene: str
    samples: int
    seeds: np.ndarray
    seconds: np.ndarray
    left_out: int
    blender: str

    @property
    def relative_noise(self) -> float:
        """Root mean square of the luminance's standard error, over the mean luminance."""
        return float(np.sqrt(np.mean((self.noise @ LUMINANCE) ** 2)) / np.mean(self.value @ LUMINANCE))

    def save(self, path: Path) -> None:
        np.savez_compressed(path, **asdict(self))

    @classmethod
    def load(cls, path: Path) -> References:
        with np.load(path) as stored:
            values = {field.name: stored[field.name] for field in fields(cls)}
        for name in ("footprint", "scene", "samples", "left_out", "blender"):
            values[name] = values[name].item()
        return cls(**values)


def fingerprint(blend: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(blend.read_bytes()).hexdigest()


def rendered_surfaces() -> list[Surface]:
    """The open scene's surfaces, one for each object and instance, sorted by name and place."""
    import bpy

    depsgraph = bpy.context.evaluated_depsgraph_get()
    surfaces = []
    for item in depsgraph.object_instances:
        thing = item.object
        # the faces of curves, text and the like come as instances of type MESH
        if thing.type != "MESH" or not item.show_self or thing.original.hide_render:
            continue
        matrix = np.array(item.matrix_world)
        mesh = thing.to_mesh()
        mesh.calc_loop_triangles()
        points = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", points)
        corner, loop = (np.empty(3 * len(mesh.loop_triangles), np.int32) for _ in range(2))
        mesh.loop_triangles.foreach_get("vertices", corner)
        mesh.loop_triangles.foreach_get("loops", loop)
        normals = np.empty(3 * len(mesh.loops), np.float32)
        mesh.corner_normals.foreach_get("vector", normals)
        thing.to_mesh_clear()
        world = points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
        order = [2, 1, 0] if np.linalg.det(matrix[:3, :3]) < 0 else [0, 1, 2]
        normals = (normals.reshape(-1, 3) @ np.linalg.inv(matrix[:3, :3]))[loop.reshape(-1, 3)[:, order]]
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        surfaces.append(Surface(thing.name, world[corner.reshape(-1, 3)[:, order]], normals))
    found = [surface for surface in surfaces if len(surface.corners)]
    return sorted(found, key=lambda surface: (surface.name, *surface.corners.mean(axis=(0, 1)).round(4).tolist()))


def place(
    surfaces: list[Surface], count: int, inside: np.ndarray | None = None, without: Collection[str] = ()
) -> Probes:
    """Spread `count` probes evenly over the surfaces' area, the same ones each time.

    Args:
        inside: (2, 3) lowest and highest corner, m: triangles whose centre lies outside get none
        without: names of objects that get none
    """
    corners = np.concatenate([surface.corners for surface in surfaces])
    name = np.repeat([surface.name for surface in surfaces], [len(surface.corners) for surface in surfaces])
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    if inside is not None:
        centre = corners.mean(axis=1)
        area = area * ((centre >= inside[0]) & (centre <= inside[1])).all(axis=1)
    area = area * ~np.isin(name, list(without))
    share = np.cumsum(area) / area.sum()
    index = np.arange(count)
    triangle = np.searchsorted(share, (index + 0.5) / count)
    # The R2 sequence, Roberts (2018): even in the triangles that get many probes.
    u, v = (0.5 + index * 0.7548776662466927) % 1, (0.5 + index * 0.5698402909980532) % 1
    u, v = np.where(u + v > 1, [1 - u, 1 - v], [u, v])
    weights = np.clip(np.stack([1 - u - v, u, v], axis=1), INSET, None)
    weights /= weights.sum(axis=1, keepdims=True)
    position = np.einsum("nc,ncx->nx", weights, corners[triangle])
    return Probes(name[triangle], position, cross[triangle] / np.linalg.norm(cross[triangle], axis=1, keepdims=True))


def tangents(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (N, 3) square to unit normals (N, 3) and to each other; along the axes on level surfaces."""
    helper = np.where(np.abs(normal[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    across = np.cross(normal, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return across, np.cross(normal, across)


def footprints(surfaces: list[Surface], probes: Probes, edge: float) -> Footprints:
    """The points of squares, `edge` metres wide, about probes, as far as the surface reaches."""
    across, along = tangents(probes.normal)
    step = (np.arange(POINTS)[:, None] * [1, LATTICE_STEP] % POINTS + 0.5) / POINTS - 0.5
    flat = probes.position[:, None] + edge * (step[:, :1] * across[:, None] + step[:, 1:] * along[:, None])
    found = [
        dropped(points, normal, whole(surfaces, name), NEAR_SURFACE * edge)
        for points, normal, name in zip(flat, probes.normal, probes.object, strict=True)
    ]
    return Footprints(*(np.array(part) for part in zip(*found, strict=True)))


def middles(surfaces: list[Surface], probes: Probes, squares: Footprints, lit: np.ndarray, edge: float) -> np.ndarray:
    """Points (N, 3) of the surface in the middle of the points `lit` (N, POINTS), m; probes that have none stay."""
    middle = probes.position.copy()
    for index in np.flatnonzero(lit.any(axis=1)):
        mean = squares.points[index, lit[index]].mean(axis=0, keepdims=True)
        surface = whole(surfaces, probes.object[index])
        place, *_, found = dropped(mean, probes.normal[index], surface, NEAR_SURFACE * edge)
        if found[0]:
            middle[index] = place[0]
    return middle


def whole(surfaces: list[Surface], name: str) -> Surface:
    """All surfaces of an object as one."""
    own = [surface for surface in surfaces if surface.name == name]
    corners = np.concatenate([surface.corners for surface in own])
    return Surface(name, corners, np.concatenate([surface.corner_normals for surface in own]))


def dropped(points: np.ndarray, normal: np.ndarray, surface: Surface, reach: float) -> tuple[np.ndarray, ...]:
    """Points (P, 3) moved along a normal (3,) onto the nearest triangle of a surface within `reach`, m.

    Returns:
        points (P, 3), unit normals and unit shading normals there (P, 3), corners and corner normals (P, 3, 3) of the
        triangles there, and which met one (P,)
    """
    alike = np.flatnonzero(surface.flat_normals @ normal > SAME_SIDE)
    if not len(alike):
        none = np.zeros_like(points)
        return points, none, none, *np.zeros((2, len(points), 3, 3)), np.zeros(len(points), bool)
    corners, normals = surface.corners[alike], surface.corner_normals[alike]
    start, edge_u, edge_v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = np.cross(edge_u, edge_v)
    facing = cross @ normal
    # Moeller and Trumbore 1997, all points with all triangles
    gap = points[:, None] - start
    u = np.cross(gap, edge_v) @ normal / facing
    v = np.cross(edge_u, gap) @ normal / facing
    height = np.abs(np.einsum("pfk,fk->pf", gap, cross) / facing)
    height[(u < 0) | (v < 0) | (u + v > 1) | (height > reach)] = np.inf
    best = height.argmin(axis=1)
    row = np.arange(len(points))
    u, v = u[row, best, None], v[row, best, None]
    there = np.isfinite(height[row, best])
    moved = start[best] + u * edge_u[best] + v * edge_v[best]
    shading = (1 - u - v) * normals[best, 0] + u * normals[best, 1] + v * normals[best, 2]
    shading /= np.maximum(np.linalg.norm(shading, axis=1, keepdims=True), 1e-9)
    place = np.where(there[:, None], moved, points)
    return place, surface.flat_normals[alike[best]], shading, corners[best], normals[best], there


def probe_mesh(probes: Probes, size: float, shading: np.ndarray | None = None) -> Any:
    """Points as one object in the open scene, and the image that it bakes into.

    Args:
        size: the scene's, m
        shading: (N, 3) unit shading normals where they are not the points' own
    """
    import bpy

    count = len(probes.position)
    width = math.ceil(math.sqrt(count))
    across, along = tangents(probes.normal)
    angle = 2 * math.pi / 3 * np.arange(3)
    radius = size * EDGE_SHARE / math.sqrt(3)
    centre = probes.position + size * LIFT_SHARE * probes.normal
    offset = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * along[:, None]
    points = (centre[:, None] + radius * offset).reshape(-1, 3)

    mesh = bpy.data.meshes.new("Probes")
    mesh.from_pydata(points.tolist(), [], np.arange(3 * count).reshape(-1, 3).tolist())
    texel = np.stack([np.arange(count) % width, np.arange(count) // width], axis=1)
    cover = np.array([[0.02, 0.02], [0.98, 0.02], [0.5, 0.98]])
    layer = mesh.uv_layers.new(name="Probes")
    layer.data.foreach_set("uv", ((texel[:, None] + cover) / width).astype(np.float32).ravel())

    if shading is not None:
        mesh.normals_split_custom_set(np.repeat(shading, 3, axis=0).tolist())

    image = bpy.data.images.new("Probes", width, width, alpha=False, float_buffer=True, is_data=True)
    return white_object(mesh, image), image


def white_object(mesh: Any, image: Any) -> Any:
    """A mesh in the open scene, selected, that no light meets, to be baked into an image.

    The faces of its first material are white; those of the second, if it has any, black.
    """
    import bpy

    for shader, color in (("ShaderNodeBsdfDiffuse", (1, 1, 1, 1)), ("ShaderNodeEmission", (0, 0, 0, 1))):
        mesh.materials.append(baked_material(shader, color, image))
    made = bpy.data.objects.new(mesh.name, mesh)
    # Camera rays, which a bake has none of, may see it: what no ray sees does not reach Cycles at all.
    for ray in ("diffuse", "glossy", "transmission", "shadow", "volume_scatter"):
        setattr(made, f"visible_{ray}", False)
    bpy.context.scene.collection.objects.link(made)
    bpy.context.view_layer.update()
    for each in bpy.context.view_layer.objects:
        each.select_set(each == made)
    bpy.context.view_layer.objects.active = made
    return made


def baked_material(shader: str, color: tuple[float, float, float, float], image: Any) -> Any:
    """A material of one shader node that bakes into an image."""
    import bpy

    material = bpy.data.materials.new("Probes")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    node = nodes.new(shader)
    node.inputs["Color"].default_value = color
    target = nodes.new("ShaderNodeTexImage")
    target.image = image
    nodes.active = target
    output = nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(node.outputs[0], output.inputs["Surface"])
    return material


def judge(scene: Any, samples: int, seed: int, threads: int) -> None:
    """Set the scene's Cycles to `samples` unbiased samples: all bounces, nothing clamped or left out."""
    scene.render.engine = "CYCLES"
    scene.render.threads_mode, scene.render.threads = "FIXED", threads
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples, cycles.seed = samples, seed
    cycles.use_adaptive_sampling = cycles.use_denoising = cycles.use_fast_gi = False
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = BOUNCES
    cycles.transparent_max_bounces = BOUNCES
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.light_sampling_threshold = 0.0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.blur_glossy = 0.0
    scene.render.use_simplify = False


def measure(
    probes: Probes,
    size: float,
    samples: int,
    seeds: list[int],
    threads: int = 1,
    shading: np.ndarray | None = None,
    hosts: Hosts | None = None,
    edge: float = 0.0,
) -> tuple[Any, list[float]]:
    """Irradiance / pi at each point in the open scene: (K, N, 3) for K seeds, and the seconds each took.

    Args:
        size, shading: as for `probe_mesh`
        hosts: the triangles that the points lie on; at those that are round, they are measured on copies of them
        edge: of the piece of such a triangle that stands for a point, m
    """
    import bpy

    scene = bpy.context.scene
    curved = np.zeros(len(probes.position), bool) if hosts is None else hosts.round(edge)
    flat = Probes(probes.object[~curved], probes.position[~curved], probes.normal[~curved])
    targets = []
    if len(flat.position):
        own = np.flatnonzero(~curved)
        targets.append((*probe_mesh(flat, size, None if shading is None else shading[own]), own, np.arange(len(own))))
    if hosts is not None and curved.any():
        own = np.flatnonzero(curved)
        laid = strip(hosts.only(own), probes.position[own], edge)
        mesh, image = host_mesh(hosts.only(own), laid, size * LIFT_SHARE)
        targets.append((white_object(mesh, image), image, own, laid.row))
    for made, *_ in targets:
        made.select_set(True)
    values, seconds = [], []
    for seed in seeds:
        judge(scene, samples, seed, threads)
        start = time.perf_counter()
        bpy.ops.object.bake(
            type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, target="IMAGE_TEXTURES", margin=0, use_clear=True
        )
        seconds.append(time.perf_counter() - start)
        value = np.empty((len(probes.position), 3))
        for _, image, own, pixel in targets:
            pixels = np.empty(4 * image.size[0] * image.size[1], np.float32)
            image.pixels.foreach_get(pixels)
            value[own] = pixels.reshape(-1, 4)[pixel, :3]
        values.append(value)
    for made, *_ in targets:
        bpy.data.objects.remove(made)
    return np.array(values), seconds


def extent(surfaces: list[Surface]) -> float:
    """Diagonal of all surfaces' bounding box, m."""
    points = np.concatenate([surface.corners.reshape(-1, 3) for surface in surfaces])
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def make_references(
    blend: Path,
    count: int,
    footprint: float,
    samples: int,
    seeds: list[int],
    inside: np.ndarray | None = None,
    without: Collection[str] = (),
) -> References:
    """Open a .blend and let Cycles measure the light at `count` places of it.

    Args:
        footprint: edge of the square that each is the mean over, m
        samples: of a seed and point; there are POINTS points to a place
        inside, without: as for `place`
    """
    import bpy

    bpy.ops.wm.open_mainfile(filepath=str(blend))
    surfaces = rendered_surfaces()
    probes = place(surfaces, count, inside, without)
    squares = footprints(surfaces, probes, footprint)
    there = squares.there
    name = np.repeat(probes.object[:, None], POINTS, axis=1)
    flat = Probes(name[there], squares.points[there], squares.normals[there])
    shading, edge = squares.shading[there], footprint / math.sqrt(POINTS)
    measured, seconds = measure(flat, extent(surfaces), samples, seeds, 1, shading, squares.hosts, edge)
    values = np.zeros((len(seeds), *squares.points.shape))
    values[:, there] = measured
    luminance = values.mean(axis=0) @ LUMINANCE
    lit = there & (luminance > DARK_SHARE * luminance[there].mean())
    kept = lit.any(axis=1)
    means = (values * lit[:, :, None]).sum(axis=2)[:, kept] / lit.sum(axis=1)[kept, None]
    return References(
        object=probes.object[kept],
        position=middles(surfaces, probes, squares, lit, footprint)[kept],
        normal=probes.normal[kept],
        value=means.mean(axis=0),
        noise=means.std(axis=0, ddof=1) / math.sqrt(len(seeds)),
        footprint=footprint,
        scene=fingerprint(blend),
        samples=samples,
        seeds=np.array(seeds),
        seconds=np.array(seconds),
        left_out=int((~kept).sum()),
        blender=bpy.app.version_string,
    )
