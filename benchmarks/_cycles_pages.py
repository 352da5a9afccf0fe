# SPDX-License-Identifier: GPL-3.0-or-later
"""Lightmap pages by Cycles, as fast as it can: all surfaces in one bake, on a uv map that is given; then denoised.

Blender bakes selected objects one by one and builds the whole scene's tree anew for each. That would be no fair match,
so all surfaces are joined in one mesh, which has copies of their materials and takes the objects' place. Objects that
can't be joined or baked so, lamps of emission alone and metals, stay as they are and get no light on a page.

Textures would lose their coordinates. A scene of which much is textured stays as it is instead, and the joined mesh is
white, lies over it and is seen by no ray: baked on it is irradiance / pi, whatever the materials below. That makes
Cycles trace through two trees' worth of triangles, and costs it a tenth to a quarter of its speed.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from radiosity_addon.atlas.unwrap import Atlas
from radiosity_addon.scene import Mesh
from tests.accuracy.probes import BOUNCES, LIFT_SHARE

MARGIN = 4
"""Texels by which charts are widened: a bilinear reading at their edges needs one, filters like more."""
FLAT = 1e-6
FILTERS = ("RTLightmap", "RT")
"""OIDN's filter for lightmaps, and the one for pictures."""


def is_diffuse(material: Any) -> bool:
    """Whether a material is the same all over, dull or of a plastic, so that its diffuse light can be baked."""
    if material is None or material.node_tree is None:
        return False
    for node in material.node_tree.nodes:
        if node.type not in ("BSDF_DIFFUSE", "BSDF_PRINCIPLED", "OUTPUT_MATERIAL"):
            return False
        if node.type == "BSDF_PRINCIPLED":
            values = {name: node.inputs[name].default_value for name in ("Metallic", "Transmission Weight", "Alpha")}
            if values != {"Metallic": 0.0, "Transmission Weight": 0.0, "Alpha": 1.0}:
                return False
    return True


def joinable(extraction: Any) -> list[bool]:
    """Which meshes of an extracted scene, open in this process, can be baked with materials of their own."""
    import bpy

    diffuse = [is_diffuse(bpy.data.materials.get(name)) for name in extraction.materials]
    return [
        not source.instancer and mesh.met and mesh.casts and all(diffuse[index] for index in set(mesh.material))
        for mesh, source in zip(extraction.scene.meshes, extraction.sources, strict=True)
    ]


def join(
    meshes: Sequence[Mesh], kept: Sequence[int], atlas: Atlas, materials: Sequence[str] | None, objects: Sequence[str]
) -> list[Any]:
    """Join surfaces in one mesh, selected for a bake; the images, one a page, that it bakes into.

    Args:
        kept: which of the meshes
        materials: names of the materials that meshes refer to; None: the joined mesh is white and no ray sees it
        objects: names of those whose place it takes
    """
    import bpy

    corners = np.concatenate([meshes[index].vertices[meshes[index].triangles] for index in kept])
    normals = np.concatenate([meshes[index].corner_normals for index in kept]).astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-300)
    level = (np.abs(normals - normals[:, :1]) < FLAT).all((1, 2))
    normals[level] = flat[level, None]
    if materials is None:
        corners = corners + LIFT_SHARE * np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)) * flat[:, None]

    mesh = bpy.data.meshes.new("Joined")
    count = len(corners)
    mesh.vertices.add(3 * count)
    mesh.vertices.foreach_set("co", corners.astype(np.float32).ravel())
    mesh.loops.add(3 * count)
    mesh.loops.foreach_set("vertex_index", np.arange(3 * count, dtype=np.int32))
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    images = []
    for page in range(atlas.page_count):
        edge = atlas.size
        images.append(bpy.data.images.new(f"Page {page}", edge, edge, alpha=False, float_buffer=True, is_data=True))
    paints = np.concatenate([meshes[index].material * (materials is not None) for index in kept])
    pages = np.concatenate([np.full(len(meshes[index].triangles), atlas.page[index]) for index in kept])
    slots, slot = np.unique(np.stack([paints, pages], axis=1), axis=0, return_inverse=True)
    for paint, page in slots:
        mesh.materials.append(_baked_into(bpy.data.materials[materials[paint]] if materials else None, images[page]))
    mesh.polygons.foreach_set("material_index", slot.reshape(-1).astype(np.int32))
    mesh.update()
    layer = mesh.uv_layers.new(name="Pages")
    layer.uv.foreach_set("vector", np.concatenate([atlas.uv[index] for index in kept]).astype(np.float32).ravel())
    if bpy.app.version >= (5, 0):
        attribute = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
        attribute.data.foreach_set("vector", normals.astype(np.float32).ravel())
    else:
        mesh.normals_split_custom_set(normals.reshape(-1, 3).astype(np.float32))

    for name in objects:
        bpy.data.objects[name].hide_render = True
    made = bpy.data.objects.new("Joined", mesh)
    for ray in ("diffuse", "glossy", "transmission", "shadow", "volume_scatter"):
        setattr(made, f"visible_{ray}", materials is not None)
    bpy.context.scene.collection.objects.link(made)
    bpy.context.view_layer.update()
    for each in bpy.context.view_layer.objects:
        each.select_set(each == made)
    bpy.context.view_layer.objects.active = made
    return images


def _baked_into(original: Any, image: Any) -> Any:
    """A copy of a material, or a white one, that bakes into an image."""
    import bpy

    if original is not None:
        material = original.copy()
    else:
        material = bpy.data.materials.new("White")
        if bpy.app.version < (5, 0):
            material.use_nodes = True
        nodes = material.node_tree.nodes
        nodes.clear()
        white, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
        white.inputs["Color"].default_value = (1, 1, 1, 1)
        material.node_tree.links.new(white.outputs[0], output.inputs["Surface"])
    target = material.node_tree.nodes.new("ShaderNodeTexImage")
    target.image = image
    material.node_tree.nodes.active = target
    return material


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
