# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles as the judge: it measures the light at points of the open scene.

Each point is a tiny white triangle just above the surface, facing as the surface does and invisible to every ray that
a bake traces; on smooth-shaded surfaces it is a piece of a copy of their triangle, see `smooth_probes`. All points are
one mesh whose uv map gives each a texel of its own; Cycles bakes diffuse light without colour into it, many samples,
all bounces, nothing clamped. That is irradiance / pi, what a page holds, with no unwrap of ours in between.
"""

from __future__ import annotations

import math
import time
from collections.abc import Collection
from typing import Any

import numpy as np

from radiosity_addon.bake import Baked
from radiosity_addon.scene import Scene
from tests.accuracy.probes import Probes, tangents
from tests.accuracy.smooth_probes import Hosts, host_mesh, strip

EDGE_SHARE = 4e-5
"""Edge of a point's triangle, as a share of the scene's diagonal."""
LIFT_SHARE = 2e-5
"""Height of a point above its surface, as a share of the scene's diagonal: too small to change what it sees."""
BOUNCES = 128
WHITE, BLACK = (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 1.0)


def dark_scene() -> Any:
    """An empty file's scene, without light."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 0):
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    return scene


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

    mesh.materials.append(baked_material(image))
    mesh.materials.append(baked_material(image, "ShaderNodeEmission", BLACK))
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


def baked_material(image: Any, shader: str = "ShaderNodeBsdfDiffuse", color: tuple[float, ...] = WHITE) -> Any:
    """A material of one shader node, a white diffuse one as a rule, that bakes into an image."""
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


def by_cycles(baked: Baked, found: Scene, names: Collection[str], passes: set[str], samples: int) -> np.ndarray:
    """Cycles' own bake of some objects onto the first page of a bake: (S, S), H / pi in red, -1 where it has no texel.

    Args:
        found: the scene as it was baked; each mesh of `names` is one of an object that has its own
        passes: DIRECT, INDIRECT or both
    """
    import bpy

    size = len(baked.pages[0])
    image = bpy.data.images.new("Page", size, size, alpha=False, float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.full(4 * size * size, -1, np.float32))
    white = baked_material(image)
    things = []
    for mesh, uv in zip(found.meshes, baked.atlas.uv[: len(found.meshes)], strict=True):
        if mesh.name not in names:
            continue
        thing = bpy.data.objects[mesh.name]
        corner_uv = np.zeros((len(thing.data.loops), 2), np.float32)
        corner_uv[mesh.corner] = uv
        thing.data.uv_layers.active = thing.data.uv_layers.new(name="Page")
        thing.data.uv_layers.active.data.foreach_set("uv", corner_uv.ravel())
        if not thing.data.materials:
            thing.data.materials.append(white)
        for material in set(thing.data.materials) - {white}:
            nodes = material.node_tree.nodes
            nodes.active = nodes.new("ShaderNodeTexImage")
            nodes.active.image = image
        things.append(thing)
    judge(bpy.context.scene, samples, 1, 1)
    for thing in bpy.context.scene.objects:
        thing.select_set(thing in things)
    bpy.context.view_layer.objects.active = things[0]
    bpy.ops.object.bake(type="DIFFUSE", pass_filter=passes, target="IMAGE_TEXTURES", margin=0, use_clear=False)
    pixels = np.empty(4 * size * size, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(size, size, 4)[:, :, 0]
