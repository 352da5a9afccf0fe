# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes, and a bake of them whose pages hold one known value."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np

from radiosity_addon.blender.data.stand_in import as_rendered_unbaked
from radiosity_addon.blender.writing.write_back import write_back
from radiosity_addon.chunks import finish
from radiosity_addon.scene import Mesh, Scene


@dataclass
class Source:
    object_name: str
    own_mesh: bool
    library: str | None = None
    instancer: str = ""
    index: tuple[int, ...] = ()
    matrix: np.ndarray | None = None


@dataclass
class Extraction:
    scene: Scene
    sources: list[Source]
    instancers: dict[str, set[str]] = field(default_factory=dict)
    surfaces: dict[int, object] = field(default_factory=dict)


@dataclass
class Atlas:
    page: np.ndarray
    uv: list[np.ndarray]
    density: np.ndarray
    page_count: int
    layouts: dict[int, np.ndarray] = field(default_factory=dict)
    places: dict[int, tuple[float, float, float]] = field(default_factory=dict)


def quad(name: str, material: bpy.types.Material | None = None, uv_maps: int = 1) -> bpy.types.Object:
    """A square of 2 m in the xy plane, in the scene."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    for index in range(uv_maps):
        layer = mesh.uv_layers.new(name=f"Map {index}")
        layer.uv.foreach_set("vector", np.linspace(0, 1, 8, dtype=np.float32) * (index + 1))
    if material is not None:
        mesh.materials.append(material)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def page_file(path: Path, value: float, size: int = 8) -> Path:
    """A page of one value in every texel, written as data."""
    image = bpy.data.images.new("page", size, size, float_buffer=True, is_data=True)
    pixels = np.ones((size, size, 4), np.float32)
    pixels[..., :3] = value
    image.pixels.foreach_set(pixels.ravel())
    image.file_format = "OPEN_EXR"
    image.filepath_raw = str(path)
    image.save()
    bpy.data.images.remove(image)
    return path


def extract(things: list[bpy.types.Object], own: dict[str, bool] | None = None) -> Extraction:
    """Each object's evaluated triangles; its own mesh is shown unless it has modifiers or is no mesh."""
    own = own or {}

    def read(depsgraph: bpy.types.Depsgraph) -> list[Mesh]:
        meshes = []
        for thing in things:
            evaluated = thing.evaluated_get(depsgraph)
            mesh = evaluated.to_mesh()
            mesh.calc_loop_triangles()
            count = len(mesh.loop_triangles)
            corner, polygon = np.empty(count * 3, np.int32), np.empty(count, np.int32)
            mesh.loop_triangles.foreach_get("loops", corner)
            mesh.loop_triangles.foreach_get("polygon_index", polygon)
            vertices, triangles = np.empty(len(mesh.vertices) * 3, np.float32), np.empty(count * 3, np.int32)
            mesh.vertices.foreach_get("co", vertices)
            mesh.loop_triangles.foreach_get("vertices", triangles)
            normals = np.tile(np.float32([0, 0, 1]), (count, 3, 1))
            meshes.append(
                Mesh(thing.name, vertices.reshape(-1, 3).astype(np.float64), triangles.reshape(-1, 3), normals,
                     np.zeros(count, np.int32), polygon, corner.reshape(-1, 3))
            )  # fmt: skip
            evaluated.to_mesh_clear()
        return meshes

    with as_rendered_unbaked(bpy.context.scene) as depsgraph:
        meshes = read(depsgraph)
    sources = [
        Source(x.name, own.get(x.name, x.type == "MESH" and not x.modifiers), x.library and x.library.filepath)
        for x in things
    ]
    return Extraction(Scene(tuple(meshes), ()), sources)


def atlas_for(extraction: Extraction, pages: dict[str, int] | None = None) -> Atlas:
    """Every loop at a place of its own, known by its index; page -1 leaves an object out."""
    pages = pages or {}
    page = np.array([pages.get(source.object_name, 0) for source in extraction.sources], np.int32)
    uv = []
    for mesh in extraction.scene.meshes:
        share = mesh.corner.astype(np.float32) / (mesh.corner.max() + 1)
        uv.append(np.stack([share, 1 - share], axis=-1))
    return Atlas(page, uv, np.full(len(page), 64.0), int(page.max()) + 1)


def bake(
    things: list[bpy.types.Object],
    folder: Path,
    value: float = 0.5,
    mode: str = "preview",
    pages: dict[str, int] | None = None,
    own: dict[str, bool] | None = None,
    pack: bool = False,
) -> tuple[list[dict], list[dict]]:
    """Write a bake of one value back."""
    extraction = extract(things, own)
    atlas = atlas_for(extraction, pages)
    files = [page_file(folder / f"radiosity_{page + 1}.exr", value) for page in range(atlas.page_count)]
    return finish(write_back(bpy.context.scene, extraction, atlas, files, mode=mode, pack=pack))
