# SPDX-License-Identifier: GPL-3.0-or-later
"""Brings a bake into the .blend: page images, uv maps, stand-ins, and materials that show the result.

Three steps, so that nothing is ever half-written: look for what could go wrong, make new datablocks beside the old
ones, then switch over. What fails in between takes the new datablocks out again.
"""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import bpy
import numpy as np

from ..arrays import Float32
from ..errors import SceneError
from ..page_format import Recipe
from .evaluation import at_render_settings
from .extract import Extraction, check_can_carry
from .names import BAKE_KEY, PAGE_KEY, SLOT_KEY, UV_KEY, UV_MAP, has_our_uv_map
from .page_images import load_page
from .preview_materials import PreviewMaterials
from .revert import take_out
from .stand_in import as_unbaked, instancers, make_stand_in, swap_in
from .working_space import working_space

if TYPE_CHECKING:
    from ..unwrap import Atlas


@dataclass
class _Place:
    """One baked object and where its light lies.

    Attributes:
        source: the object that was extracted
        target: the object that will carry the uv map: the source itself, or its stand-in once that is made
        index: of its mesh in the scene records and in the atlas
        uv: (L, 2) float32, by loop of the evaluated mesh, up to the last loop used
        instances: the source shows instances of other objects
    """

    source: bpy.types.Object
    target: bpy.types.Object | None
    index: int
    page: int
    uv: Float32
    instances: bool = False

    @property
    def own_mesh(self) -> bool:
        return self.target is self.source


def write_back(
    scene: bpy.types.Scene,
    extraction: Extraction,
    atlas: Atlas,
    files: Sequence[Path],
    *,
    recipe: Recipe | None = None,
    mode: Literal["preview", "uv"] = "preview",
    pack: bool = False,
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Put a bake into the .blend, in place of an earlier one of the same scene.

    Args:
        scene: the scene that was extracted
        extraction: what was read from it
        atlas: where each mesh lies
        files: the file of each page
        recipe: how to read them; by default they are EXR files in the working space
        mode: "preview" gives baked objects material copies that show the lightmap; "uv" leaves materials alone
        pack: keep the pages inside the .blend, for files that will not stay; an unsaved .blend always does

    Returns:
        For the report: a row for each baked object ("source", "object", "page", "density" in texels per metre) in the
        order of the atlas, and a row for each page ("image", "file" as an absolute path, "size").

    Raises:
        SceneError: an object can't take the result; the scene is as it was
        OutputError: a page can't be read; the scene is as it was
    """
    leave_edit_mode(scene)
    places = _find_places(extraction, atlas)
    token = uuid.uuid4().hex
    try:
        recipe = recipe or Recipe("exr", working_space())
        images = [load_page(path, page, token, recipe, pack=pack) for page, path in enumerate(files)]
        _make_stand_ins(scene, places, token)
        before = scene.get(BAKE_KEY)
        if before:
            images = _replace_images(images, before)
            take_out(before)
        scene[BAKE_KEY] = token
        _switch(places, images, mode, token)
    except BaseException:
        take_out(token)
        raise
    objects = [
        {
            "source": place.source.name,
            "object": place.target.name,
            "page": place.page,
            "density": float(atlas.density[place.index]),
        }
        for place in places
    ]
    pages = [
        {"image": image.name, "file": str(path.resolve()), "size": list(image.size)}
        for image, path in zip(images, files, strict=True)
    ]
    return objects, pages


def leave_edit_mode(scene: bpy.types.Scene) -> None:
    """Bring every object of the scene out of edit mode, which flushes what was edited into its mesh."""
    for thing in scene.objects:
        if thing.mode == "EDIT":
            with bpy.context.temp_override(active_object=thing, object=thing):
                bpy.ops.object.mode_set(mode="OBJECT")


def _find_places(extraction: Extraction, atlas: Atlas) -> list[_Place]:
    places = []
    for index, source in enumerate(extraction.sources):
        if not 0 <= atlas.page[index] < atlas.page_count:
            continue
        thing = bpy.data.objects.get(source.object_name)
        if thing is None:
            raise SceneError(source.object_name, "was renamed or deleted during the bake", "Bake again")
        check_can_carry(thing)
        own = source.own_mesh and thing.data.is_editable and thing.data.users - thing.data.use_fake_user == 1
        mesh = extraction.scene.meshes[index]
        corners = int(mesh.corner.max()) + 1 if len(mesh.corner) else 0
        uv = np.zeros((corners, 2), dtype=np.float32)
        uv[mesh.corner.ravel()] = atlas.uv[index].reshape(-1, 2)
        if own:
            _check_corners(thing, thing.data, uv)
        places.append(_Place(thing, thing if own else None, index, int(atlas.page[index]), uv))
    return places


def _check_corners(thing: bpy.types.Object, mesh: bpy.types.Mesh, uv: Float32) -> None:
    if len(uv) > len(mesh.loops):
        raise SceneError(thing.name, "its mesh was changed during the bake", "Bake again")


def _replace_images(images: list[bpy.types.Image], before: str) -> list[bpy.types.Image]:
    """Put new images where the earlier bake's are used, under their names."""
    old = {image[PAGE_KEY]: image for image in bpy.data.images if image.get(BAKE_KEY) == before}
    for image in images:
        earlier = old.get(image[PAGE_KEY])
        if earlier is not None:
            name = earlier.name
            earlier.user_remap(image)
            bpy.data.images.remove(earlier)
            image.name = name
    return images


def _make_stand_ins(scene: bpy.types.Scene, places: list[_Place], token: str) -> None:
    """Make the stand-in of every place that needs one, in no collection yet."""
    wanted = [place for place in places if not place.own_mesh]

    def make(depsgraph: bpy.types.Depsgraph) -> None:
        showing = instancers(depsgraph)
        for place in wanted:
            place.target = make_stand_in(place.source, depsgraph, token)
            place.instances = place.source.name in showing

    if not wanted:
        return
    with as_unbaked(scene):
        at_render_settings(scene, make)
    for place in wanted:
        _check_corners(place.source, place.target.data, place.uv)
        _write_uv(place.target.data, place.uv, token)


def _switch(places: list[_Place], images: list[bpy.types.Image], mode: str, token: str) -> None:
    """Show the bake: from here on nothing is expected to fail."""
    previews = PreviewMaterials(token, images)
    for place in places:
        if place.own_mesh:
            _write_uv(place.target.data, place.uv, token)
        if mode == "preview":
            _show_preview(place.target, place.page, previews)
    for place in places:
        if not place.own_mesh:
            swap_in(place.source, place.target, token, place.instances)


def _write_uv(mesh: bpy.types.Mesh, uv: Float32, token: str) -> None:
    """Add our uv map, the user's stay active."""
    mesh[BAKE_KEY] = token
    layers = mesh.uv_layers
    if not has_our_uv_map(mesh):
        active = layers.active.name if layers.active else ""
        rendered = next((layer.name for layer in layers if layer.active_render), "")
        mesh[UV_KEY] = {"active": active, "rendered": rendered}
    layer = layers.get(UV_MAP) or layers.new(name=UV_MAP, do_init=False)
    if layer is None:
        raise SceneError(mesh.name, "takes no further uv map", "Remove one of its uv maps")
    full = np.zeros((len(mesh.loops), 2), dtype=np.float32)
    full[: len(uv)] = uv
    layer.uv.foreach_set("vector", full.ravel())
    mesh.update()


def _show_preview(thing: bpy.types.Object, page: int, previews: PreviewMaterials) -> None:
    if not thing.material_slots:
        thing.data.materials.append(None)
        thing.data[SLOT_KEY] = True
    for slot in thing.material_slots:
        slot.material = previews.of(slot.material, page)
