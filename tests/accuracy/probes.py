# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles as the judge: the light at a few hundred points of a scene, and how far a bake is from it.

A probe is a tiny white triangle just above a surface, facing as the surface does and invisible to every ray that a
bake traces. All probes are one mesh whose uv map gives each a texel of its own; Cycles bakes diffuse light without
colour into it, many samples, all bounces, nothing clamped. That is irradiance / pi, what a page holds, at a point, with
no unwrap of ours in between.
"""

from __future__ import annotations

import hashlib
import math
import time
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

EDGE_SHARE = 1e-4
"""Edge of a probe triangle, as a share of the scene's diagonal."""
INSET = 1e-3
"""Least barycentric weight of a probe: one on an edge would reach behind the next wall."""
LIFT_SHARE = 2e-5
"""Height of a probe above its surface, as a share of the scene's diagonal: too small to change what it sees."""
BOUNCES = 128
DARK_SHARE = 1e-3
"""Probes below this share of the mean lie under something that stands on the surface, and are left out."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Rec.709"""


@dataclass(frozen=True)
class Surface:
    """The triangles of one object as rendered: corners (F, 3, 3), m, world space, anticlockwise about the front."""

    name: str
    corners: np.ndarray


@dataclass(frozen=True)
class Probes:
    """N points: object (N,) str, position on the surface (N, 3), m, unit normal (N, 3)."""

    object: np.ndarray
    position: np.ndarray
    normal: np.ndarray


@dataclass(frozen=True)
class References:
    """What Cycles says.

    Attributes:
        object: (N,) name of the object under each probe
        position: (N, 3) point on the surface, m
        normal: (N, 3) unit
        value: (N, 3) irradiance / pi, W/(m2 sr)
        noise: (N, 3) standard error of value, from the seeds' spread
        scene: SHA-256 of the .blend file
        samples: of each seed
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
        for name in ("scene", "samples", "left_out", "blender"):
            values[name] = values[name].item()
        return cls(**values)


def fingerprint(blend: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(blend.read_bytes()).hexdigest()


def rendered_surfaces() -> list[Surface]:
    """The open scene's surfaces, by object, sorted by name."""
    import bpy

    depsgraph = bpy.context.evaluated_depsgraph_get()
    surfaces = []
    for each in sorted(bpy.context.scene.objects, key=lambda each: each.name):
        if each.hide_render or each.type not in {"MESH", "CURVE", "SURFACE", "FONT", "META"}:
            continue
        evaluated = each.evaluated_get(depsgraph)
        mesh = evaluated.to_mesh()
        mesh.calc_loop_triangles()
        points = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", points)
        corner = np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("vertices", corner)
        matrix = np.array(evaluated.matrix_world)
        world = points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
        corners = world[corner.reshape(-1, 3)]
        surfaces.append(Surface(each.name, corners[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else corners))
        evaluated.to_mesh_clear()
    return [surface for surface in surfaces if len(surface.corners)]


def place(surfaces: list[Surface], count: int, inside: np.ndarray | None = None) -> Probes:
    """Spread `count` probes evenly over the surfaces' area, the same ones each time.

    Args:
        inside: (2, 3) lowest and highest corner, m: triangles whose centre lies outside get none
    """
    corners = np.concatenate([surface.corners for surface in surfaces])
    name = np.repeat([surface.name for surface in surfaces], [len(surface.corners) for surface in surfaces])
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    if inside is not None:
        centre = corners.mean(axis=1)
        area *= ((centre >= inside[0]) & (centre <= inside[1])).all(axis=1)
    share = np.cumsum(area) / area.sum()
    index = np.arange(count)
    triangle = np.searchsorted(share, (index + 0.5) / count)
    # The R2 sequence, Roberts (2018): even in the triangles that get many probes.
    u, v = (0.5 + index * 0.7548776662466927) % 1, (0.5 + index * 0.5698402909980532) % 1
    u, v = np.where(u + v > 1, [1 - u, 1 - v], [u, v])
    weights = np.clip(np.stack([1 - u - v, u, v], axis=1), INSET, None)
    weights /= weights.sum(axis=1, keepdims=True)
    position = np.einsum("nc,ncx->nx", weights, corners[triangle])
    return Probes(name[triangle], position, cross[triangle] / (2 * area[triangle, None]))


def probe_mesh(probes: Probes, size: float) -> Any:
    """The probes as one object in the open scene, and the image that it bakes into; `size` is the scene's, m."""
    import bpy

    count = len(probes.position)
    width = math.ceil(math.sqrt(count))
    helper = np.where(np.abs(probes.normal[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    across = np.cross(probes.normal, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(probes.normal, across)
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

    image = bpy.data.images.new("Probes", width, width, alpha=False, float_buffer=True, is_data=True)
    material = bpy.data.materials.new("Probes")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    white = nodes.new("ShaderNodeBsdfDiffuse")
    white.inputs["Color"].default_value = (1, 1, 1, 1)
    target = nodes.new("ShaderNodeTexImage")
    target.image = image
    nodes.active = target
    output = nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(white.outputs[0], output.inputs["Surface"])
    mesh.materials.append(material)

    made = bpy.data.objects.new("Probes", mesh)
    # Camera rays, which a bake has none of, may see it: what no ray sees does not reach Cycles at all.
    for ray in ("diffuse", "glossy", "transmission", "shadow", "volume_scatter"):
        setattr(made, f"visible_{ray}", False)
    bpy.context.scene.collection.objects.link(made)
    bpy.context.view_layer.update()
    for each in bpy.context.view_layer.objects:
        each.select_set(each == made)
    bpy.context.view_layer.objects.active = made
    return made, image


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


def measure(probes: Probes, size: float, samples: int, seeds: list[int], threads: int = 1) -> tuple[Any, list[float]]:
    """Irradiance / pi at each probe in the open scene: (K, N, 3) for K seeds, and the seconds each took."""
    import bpy

    scene = bpy.context.scene
    made, image = probe_mesh(probes, size)
    values, seconds = [], []
    for seed in seeds:
        judge(scene, samples, seed, threads)
        start = time.perf_counter()
        bpy.ops.object.bake(
            type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, target="IMAGE_TEXTURES", margin=0, use_clear=True
        )
        seconds.append(time.perf_counter() - start)
        pixels = np.empty(4 * image.size[0] * image.size[1], np.float32)
        image.pixels.foreach_get(pixels)
        values.append(pixels.reshape(-1, 4)[: len(probes.position), :3].astype(np.float64))
    bpy.data.objects.remove(made)
    return np.array(values), seconds


def extent(surfaces: list[Surface]) -> float:
    """Diagonal of all surfaces' bounding box, m."""
    points = np.concatenate([surface.corners.reshape(-1, 3) for surface in surfaces])
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def make_references(
    blend: Path, count: int, samples: int, seeds: list[int], inside: np.ndarray | None = None
) -> References:
    """Open a .blend and let Cycles measure the light at `count` points of it; `inside` as for `place`."""
    import bpy

    bpy.ops.wm.open_mainfile(filepath=str(blend))
    surfaces = rendered_surfaces()
    probes = place(surfaces, count, inside)
    values, seconds = measure(probes, extent(surfaces), samples, seeds)
    value = values.mean(axis=0)
    luminance = value @ LUMINANCE
    kept = luminance > DARK_SHARE * luminance.mean()
    return References(
        object=probes.object[kept],
        position=probes.position[kept],
        normal=probes.normal[kept],
        value=value[kept],
        noise=(values.std(axis=0, ddof=1) / math.sqrt(len(seeds)))[kept],
        scene=fingerprint(blend),
        samples=samples,
        seeds=np.array(seeds),
        seconds=np.array(seconds),
        left_out=int((~kept).sum()),
        blender=bpy.app.version_string,
    )
