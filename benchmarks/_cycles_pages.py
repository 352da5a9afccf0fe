# SPDX-License-Identifier: GPL-3.0-or-later
"""Lightmap pages by Cycles, as fast as it can: all surfaces in one bake, on a uv map that is given; then denoised.

Blender bakes selected objects one by one and builds the whole scene's tree anew for each. That would be no fair match,
so all surfaces are laid over the scene as one white mesh that no ray of a bake sees: what Cycles bakes on it, in one
call for all pages, is irradiance / pi, whatever the materials below. The scene itself stays as it is.

The white mesh makes Cycles trace through more triangles, but no path of its ends early on a dark texel. Against the
same surfaces joined with materials of their own, one over (noise^2 x processor time) was 1.25 times as large in the
Cornell box and 0.94 times in the interior.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from radiosity_addon.scene import Mesh
from tests.accuracy.cycles_judge import BOUNCES, LIFT_SHARE, baked_material

MARGIN = 4
"""Texels by which charts are widened: a bilinear reading at their edges needs one, filters like more."""
FLAT = 1e-6
FILTERS = ("RTLightmap", "RT")
"""OIDN's filter for lightmaps, and the one for pictures."""


def receivers(
    meshes: Sequence[Mesh], uv: Sequence[np.ndarray], pages: Sequence[int], page_count: int, size: int
) -> Any:
    """Lay a white mesh over those surfaces that have a place on a page; the images, one a page, that it bakes into."""
    import bpy

    kept = [index for index, page in enumerate(pages) if 0 <= page < page_count and len(meshes[index].triangles)]
    corners = np.concatenate([meshes[index].vertices[meshes[index].triangles] for index in kept])
    normals = np.concatenate([meshes[index].corner_normals for index in kept]).astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-300)
    level = (np.abs(normals - normals[:, :1]) < FLAT).all((1, 2))
    normals[level] = flat[level, None]
    reach = np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0))
    points = corners + LIFT_SHARE * reach * flat[:, None]

    mesh = bpy.data.meshes.new("Receivers")
    count = len(corners)
    mesh.vertices.add(3 * count)
    mesh.vertices.foreach_set("co", points.astype(np.float32).ravel())
    mesh.loops.add(3 * count)
    mesh.loops.foreach_set("vertex_index", np.arange(3 * count, dtype=np.int32))
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    of_page = np.concatenate([np.full(len(meshes[index].triangles), pages[index], np.int32) for index in kept])
    mesh.polygons.foreach_set("material_index", of_page)
    mesh.update()
    layer = mesh.uv_layers.new(name="Receivers")
    layer.uv.foreach_set("vector", np.concatenate([uv[index] for index in kept]).astype(np.float32).ravel())
    if bpy.app.version >= (5, 0):
        attribute = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
        attribute.data.foreach_set("vector", normals.astype(np.float32).ravel())
    else:
        mesh.normals_split_custom_set(normals.reshape(-1, 3).astype(np.float32))
    images = []
    for page in range(page_count):
        image = bpy.data.images.new(f"Page {page}", size, size, alpha=False, float_buffer=True, is_data=True)
        mesh.materials.append(baked_material(image))
        images.append(image)

    made = bpy.data.objects.new("Receivers", mesh)
    for ray in ("diffuse", "glossy", "transmission", "shadow", "volume_scatter"):
        setattr(made, f"visible_{ray}", False)
    bpy.context.scene.collection.objects.link(made)
    bpy.context.view_layer.update()
    for each in bpy.context.view_layer.objects:
        each.select_set(each == made)
    bpy.context.view_layer.objects.active = made
    return images


def configure(samples: int, threads: int, bounces: int = BOUNCES, adaptive: bool = False) -> None:
    """Cycles at its fastest for all the light: on the processor, with its light tree, Russian roulette and no clamp."""
    import bpy

    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.threads_mode, scene.render.threads = "FIXED", threads
    scene.render.use_simplify = False
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples, cycles.seed = samples, 0
    cycles.use_light_tree = True
    cycles.use_adaptive_sampling, cycles.use_denoising, cycles.use_fast_gi = adaptive, False, False
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = bounces
    cycles.transparent_max_bounces = bounces
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.blur_glossy = 0.0


def bake_pages(images: Any) -> tuple[list[np.ndarray], float]:
    """The pages (S, S, 3), row 0 at v = 0, and the seconds that the operator took."""
    import bpy

    start = time.perf_counter()
    bpy.ops.object.bake(
        type="DIFFUSE",
        pass_filter={"DIRECT", "INDIRECT"},
        target="IMAGE_TEXTURES",
        margin=MARGIN,
        margin_type="EXTEND",
        use_clear=True,
    )
    seconds = time.perf_counter() - start
    pages = []
    for image in images:
        width, height = image.size
        flat = np.empty(4 * width * height, np.float32)
        image.pixels.foreach_get(flat)
        pages.append(np.ascontiguousarray(flat.reshape(height, width, 4)[:, :, :3]))
    return pages, seconds


def denoised(pages: Sequence[np.ndarray], name: str) -> tuple[list[np.ndarray], float]:
    """The pages after one of OIDN's filters, at its highest quality, and the seconds it took, its start included."""
    start = time.perf_counter()
    import pyoidn

    clean = [pyoidn.denoise(page, hdr=name == "RT", filter_type=name) for page in pages]
    return clean, time.perf_counter() - start
