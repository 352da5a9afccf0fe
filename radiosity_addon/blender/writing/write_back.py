# SPDX-License-Identifier: GPL-3.0-or-later
"""Brings a bake into the .blend: page images, uv maps, stand-ins, and materials that show the result.

Three steps, so that nothing is ever half-written: look for what could go wrong, make new datablocks beside the old
ones, then switch over. What fails in between takes the new datablocks out again.
"""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Generator, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import bpy
import numpy as np

from ...arrays import Float32, Int32
from ...errors import SceneError
from ...geometry.sides import TURNED, backs_of
from ...pages.page_format import Recipe
from ...scene import Mesh, Scene
from ..data.instances import Key
from ..data.names import (
    BACK_PAGE_KEY,
    BACK_UV_MAP,
    BAKE_KEY,
    GROUP_KEY,
    PAGE_KEY,
    PLACE_KEY,
    SLOT_KEY,
    SLOTS_KEY,
    UV_KEY,
    UV_MAP,
    is_full_copy,
    orphaned_bakes,
)
from ..data.preflight import check_can_carry
from ..data.stand_in import Common, MeshPool, as_rendered_unbaked, make_stand_in, swap_in
from ..data.working_space import working_space
from ..looks.surface_inputs import OF_STAND_INS, property_of
from ..reading.extraction import Extraction, Source
from .instance_stand_ins import Replacement, replace_instancers
from .light_mix import load_mix, sliders_of
from .mixed_world import mix_world
from .page_images import load_page
from .preview_materials import PreviewMaterials
from .revert import revert, take_out

if TYPE_CHECKING:
    from ...atlas.unwrap import Atlas


@dataclass
class _Place:
    """One baked object or instance and where its light lies.

    Attributes:
        source: the object that was extracted; of an instance, the object that it shows
        record: what is known of it
        index: of its mesh in the scene records and in the atlas
        common: what all have in common that can share a mesh of one uv map
        uv: (L, 2) float32, by loop of the evaluated mesh, up to the last loop used
        place: where the object lies that shares its uv map, as (scale, u, v); None where the map says it all
        back: page and uv (L, 2), as `uv`, of the backs of a two-sided object
        group: light group of what it emits
        target: the object that will carry the uv map: the source itself, or its stand-in once that is made
        instances: the source shows instances of other objects that stay
    """

    source: bpy.types.Object
    record: Source
    index: int
    page: int
    common: Common
    uv: Float32
    place: tuple[float, float, float] | None
    back: tuple[int, Float32] | None = None
    group: str = ""
    target: bpy.types.Object | None = None
    instances: bool = False

    @property
    def own_mesh(self) -> bool:
        return self.target is self.source

    @property
    def key(self) -> Key:
        return self.record.instancer, self.record.index, self.record.object_name

    def row(self, density: float) -> dict[str, Any]:
        """What the report says of it."""
        row = {"source": self.source.name, "object": self.target.name, "page": self.page, "density": density}
        if self.place is not None:
            scale, *shift = self.place
            row |= {"uv_scale": (scale, scale), "uv_offset": tuple(shift)}
        if self.back is not None:
            row |= {"back_page": self.back[0]}
        if self.record.instancer:
            row |= {"instancer": self.record.instancer, "index": self.record.index, "matrix": self.record.matrix}
        return row


def write_back(
    scene: bpy.types.Scene,
    extraction: Extraction,
    atlas: Atlas,
    files: Sequence[Path],
    *,
    recipe: Recipe | None = None,
    mode: Literal["preview", "uv"] = "preview",
    pack: bool = False,
    apart: Mapping[str, tuple[Sequence[Path], Recipe]] | None = None,
) -> Generator[None, None, tuple[list[dict[str, Any]], list[dict[str, Any]]]]:
    """Put a bake into the .blend, in place of an earlier one of the same scene, in steps.

    What objects brought along of bakes of other files is taken out too. Until the end nothing else may change the file.
    Closing the generator leaves the scene as it was.

    Args:
        scene: the scene that was extracted
        extraction: what was read from it
        atlas: where each mesh lies
        files: the file of each page
        recipe: how to read them; by default they are EXR files in the working space
        mode: "preview" gives baked objects material copies that show the lightmap; "uv" leaves materials alone
        pack: keep the pages inside the .blend, for files that will not stay; an unsaved .blend always does
        apart: by name of the light group, files of its light alone and how to read them: they are shown in place of
            the pages, and can be mixed anew; groups without any light may be left out

    Returns:
        For the report: a row for each baked object ("source", "object", "page", "density" in texels per metre; where
        it shares its uv map "uv_scale" and "uv_offset", of instances "instancer", "index" and "matrix") in the order
        of the atlas, and a row for each page ("image", "file" as an absolute path, "size").

    Raises:
        SceneError: an object can't take the result; the scene is as it was
        OutputError: a page can't be read; the scene is as it was
    """
    leave_edit_mode(scene)
    before, sliders = scene.get(BAKE_KEY), sliders_of(scene)
    foreign = orphaned_bakes(scene)
    replaced = foreign | ({before} if before else set())
    places = yield from _find_places(extraction, atlas, replaced)
    token = uuid.uuid4().hex
    try:
        recipe = recipe or Recipe("exr", working_space())
        images = []
        for page, path in enumerate(files):
            images.append(load_page(path, page, token, recipe, pack=pack))
            yield
        mix = (yield from load_mix(apart, token, pack=pack)) if apart and mode == "preview" else None
        replacements = yield from _make_stand_ins(scene, places, extraction, token)
        previews = PreviewMaterials(token, images, mix)
        if mode == "preview" and not replaced:  # what is made while an earlier bake is there has to take other names
            for place in places:
                _make_previews(place, previews)
                yield
        if before and not is_full_copy(scene):
            _replace_images([*images, *(mix.images if mix else ())], before)
        revert(scene)
        for each in foreign:
            take_out(each)
        scene[BAKE_KEY] = token
        _switch(places, replacements, previews, mode, token)
        if mix is not None:
            mix_world(scene, extraction.scene.groups[extraction.scene.world.group], mix)
            mix.connect(scene, sliders)
    except BaseException:
        take_out(token)
        raise
    objects = [place.row(float(atlas.density[place.index])) for place in places]
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


def _find_places(extraction: Extraction, atlas: Atlas, replaced: Set[str]) -> Generator[None, None, list[_Place]]:
    places = []
    may_own: dict[bpy.types.Mesh, list[_Place]] = {}
    backs = backs_of(extraction.scene.meshes)
    for index, source in enumerate(extraction.sources):
        if not 0 <= atlas.page[index] < atlas.page_count:
            continue
        thing = bpy.data.objects.get((source.object_name, source.library))
        if thing is None:
            raise SceneError(source.object_name, "was renamed or deleted during the bake", "Bake again")
        mesh, place = extraction.scene.meshes[index], atlas.places.get(index)
        uv = _by_corner(mesh.corner, atlas.uv[index]) if place is None else atlas.layouts[mesh.shape]
        other = backs.get(index)
        back = (int(atlas.page[other]), _by_corner(mesh.corner[:, TURNED], atlas.uv[other])) if other else None
        common = ("mesh", index) if place is None else ("shape", mesh.shape)
        group = _group_of(mesh, extraction.scene)
        places.append(_Place(thing, source, index, int(atlas.page[index]), common, uv, place, back, group))
        yield
        if source.instancer:
            continue
        check_can_carry(thing, back is not None)
        if source.own_mesh and thing.data.is_editable and thing.data.get(BAKE_KEY) in (None, *replaced):
            _check_corners(thing, thing.data, uv)
            may_own.setdefault(thing.data, []).append(places[-1])
    for users in may_own.values():  # a mesh has one map of ours: that of most of its objects
        most, _ = Counter(place.common for place in users).most_common(1)[0]
        for place in users:
            place.target = place.source if place.common == most else None
    return places


def _group_of(mesh: Mesh, scene: Scene) -> str:
    """The light group of what a mesh emits: an object is in one, with all its materials."""
    materials = mesh.material[:1].tolist()
    return scene.groups[scene.materials[materials[0]].group] if materials and scene.materials else ""


def _by_corner(corner: Int32, uv: Float32) -> Float32:
    """The uv (F, 3, 2) of triangles by polygon corner, (L, 2)."""
    result: Float32 = np.zeros((int(corner.max(initial=-1)) + 1, 2), np.float32)
    result[corner.ravel()] = uv.reshape(-1, 2)
    return result


def _check_corners(thing: bpy.types.Object, mesh: bpy.types.Mesh, uv: Float32) -> None:
    if len(uv) > len(mesh.loops):
        raise SceneError(thing.name, "its mesh was changed during the bake", "Bake again")


def _replace_images(images: list[bpy.types.Image], before: str) -> None:
    """Put new images where the earlier bake's are used, under their names."""
    old = {_what(image): image for image in bpy.data.images if image.get(BAKE_KEY) == before and PAGE_KEY in image}
    for image in images:
        earlier = old.get(_what(image))
        if earlier is not None:
            name = earlier.name
            earlier.user_remap(image)
            bpy.data.images.remove(earlier)
            image.name = name


def _what(image: bpy.types.Image) -> tuple[int, str | None]:
    """What an image holds: the page, and the light group if it is one's alone."""
    return image[PAGE_KEY], image.get(GROUP_KEY)


def _make_stand_ins(
    scene: bpy.types.Scene, places: list[_Place], extraction: Extraction, token: str
) -> Generator[None, None, list[Replacement]]:
    """Make the stand-in of every place that needs one, in no collection yet, and what takes the place of instancers.

    An instancer is replaced if some of its instances have places, or show an object that will show its own place.
    """
    real = {place.source: place for place in places if not place.record.instancer}
    wanted: dict[Key, list[_Place]] = {}  # some instancers number several alike
    for place in places:
        if place.record.instancer:
            wanted.setdefault(place.key, []).append(place)
    names = {thing.name for thing in real}
    makers = {maker for maker, _, _ in wanted}
    replaced = makers | {maker for maker, shown in extraction.instancers.items() if not names.isdisjoint(shown)}
    for thing, place in real.items():
        place.instances = thing.name in extraction.instancers
        if thing.name in replaced:
            place.target, place.instances = None, False
    if not replaced and all(place.own_mesh for place in places):
        return []

    with as_rendered_unbaked(scene) as depsgraph:
        pool = MeshPool(depsgraph, token)
        for place in real.values():
            if not place.own_mesh:
                place.target = yield from make_stand_in(place.source, pool, place.common)
                yield
        commons = {key: same[0].common for key, same in wanted.items()}
        replacements = yield from replace_instancers(depsgraph, replaced, real, commons, pool)
    for replacement in replacements:
        for key, stand_in in replacement.stand_ins:
            if wanted.get(key):
                wanted[key].pop(0).target = stand_in
    written = set()
    for place in places:
        if place.target is None:
            raise SceneError(place.source.name, "its instances were changed during the bake", "Bake again")
        if not place.own_mesh and place.index in extraction.surfaces:
            for asked, values in extraction.surfaces[place.index].values.items():
                if asked.kind in OF_STAND_INS:
                    place.target[property_of(asked)] = values[0].tolist() if values.size > 1 else values.item()
        if not place.own_mesh and place.target.data not in written:
            _check_corners(place.source, place.target.data, place.uv)
            _write_uvs(place, token)
            written.add(place.target.data)
            yield
    return replacements


def _switch(
    places: list[_Place], replacements: list[Replacement], previews: PreviewMaterials, mode: str, token: str
) -> None:
    """Show the bake: from here on nothing is expected to fail."""
    written = set()
    for place in places:
        if place.own_mesh and place.target.data not in written:
            _write_uvs(place, token)
            written.add(place.target.data)
        place.target[BAKE_KEY], place.target[PAGE_KEY] = token, place.page
        if place.place is not None:
            place.target[PLACE_KEY] = place.place
        if place.back is not None:
            place.target[BACK_PAGE_KEY] = place.back[0]
    for place in places:
        if mode == "preview":
            _show_preview(place, previews, token)
    for replacement in replacements:
        replacement.show(token)
    for place in places:
        if not (place.own_mesh or place.record.instancer):
            swap_in(place.source, place.target, token, place.instances)
    for replacement in replacements:
        replacement.hide(token)


def _write_uvs(place: _Place, token: str) -> None:
    mesh = place.target.data
    _write_uv(mesh, UV_MAP, place.uv, token)
    if place.back is not None:
        _write_uv(mesh, BACK_UV_MAP, place.back[1], token)


def _write_uv(mesh: bpy.types.Mesh, name: str, uv: Float32, token: str) -> None:
    """Add our uv map, the user's stay active."""
    mesh[BAKE_KEY] = token
    layers = mesh.uv_layers
    if UV_KEY not in mesh:
        active = layers.active.name if layers.active else ""
        rendered = next((layer.name for layer in layers if layer.active_render), "")
        mesh[UV_KEY] = {"active": active, "rendered": rendered}
    if name in layers:  # a copied mesh may share the array with the one that it was copied from
        layers.remove(layers[name])
    layer = layers.new(name=name, do_init=False)
    if layer is None:
        raise SceneError(mesh.name, "takes no further uv map", "Remove one of its uv maps")
    full = np.zeros((len(mesh.loops), 2), dtype=np.float32)
    full[: len(uv)] = uv
    layer.uv.foreach_set("vector", full.ravel())
    mesh.update()


def _make_previews(place: _Place, previews: PreviewMaterials) -> None:
    """Make the materials that `_show_preview` will show."""
    slots = place.target.material_slots
    for material in [slot.material for slot in slots] if slots else [None]:
        back = place.back and place.back[0]
        previews.of(material, place.page, place.place is not None, back, not place.own_mesh, place.group)


def _show_preview(place: _Place, previews: PreviewMaterials, token: str) -> None:
    """Give every slot its preview material; on the object itself where others share the mesh."""
    thing, mesh = place.target, place.target.data
    if not thing.material_slots:
        mesh.materials.append(None)
        mesh[SLOT_KEY] = True
    shared = mesh.users - mesh.use_fake_user > 1
    before = {}
    for index, slot in enumerate(thing.material_slots):
        material, link = slot.material, slot.link
        if shared:
            slot.link = "OBJECT"
            before[str(index)] = {"link": link} | ({"material": slot.material} if slot.material else {})
        back = place.back and place.back[0]
        slot.material = previews.of(
            material, place.page, place.place is not None, back, not place.own_mesh, place.group
        )
    if shared and place.own_mesh:
        thing[BAKE_KEY], thing[SLOTS_KEY] = token, before
