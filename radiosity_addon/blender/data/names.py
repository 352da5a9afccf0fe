# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bake leaves in a .blend, and how to know it again.

Everything that a bake makes or changes carries the bake's token under BAKE_KEY, so that what belongs to one scene's
bake is found after datablocks were renamed, copied, deleted, or saved and read again.
"""

from __future__ import annotations

import bpy

UV_MAP = "Radiosity"
"""Name of the uv map that places a mesh on its page."""

BACK_UV_MAP = "Radiosity Back"
"""Name of the uv map that places the backs of a two-sided mesh on theirs."""

BAKE_KEY = "radiosity_bake"
"""The bake's token: on the scene, and on every datablock that the bake made or changed."""

PAGE_KEY = "radiosity_page"
"""On an image: index of the page that it holds. On a baked object: of the page that it lies on."""

GROUP_KEY = "radiosity_group"
"""On an image of a page that holds the light of one light group alone: its name."""

BACK_PAGE_KEY = "radiosity_back_page"
"""On a baked object of two sides: index of the page that its backs lie on."""

TEXELS_KEY = "radiosity_texels"
"""On an image: what each texel of its page was to the bake, packed."""

RECIPE_KEY = "radiosity_recipe"
"""On an image: how its file's numbers become light, JSON."""

STAND_IN_KEY = "radiosity_source"
"""On a stand-in: the object that it shows. On its mesh: True."""

HIDDEN_KEY = "radiosity_hidden"
"""On an object behind a stand-in: its visibility and selection before the bake."""

UV_KEY = "radiosity_uv"
"""On a mesh that carries our uv map: names of the uv maps that were active before."""

SLOT_KEY = "radiosity_slot"
"""On a mesh: the bake gave it its only material slot."""

PREVIEW_KEY = "radiosity_preview"
"""On a preview material: True."""

ORIGINAL_MATERIAL_KEY = "radiosity_original"
"""On a preview material: the material that it shows, absent where the slot was empty."""

ORIGINAL_WORLD_KEY = "radiosity_world"
"""On a world that is mixed with its light group: the user's, that it shows."""

PLACE_KEY = "radiosity_place"
"""On an object that shares its uv map: its uv are scale * uv + (u, v), as (scale, u, v). Preview materials read it."""

SLOTS_KEY = "radiosity_slots"
"""On an object that shares its mesh: what its material slots were linked to."""

REPORT_KEY = "radiosity_report"
"""On the scene: what its bake had to say."""

ORIGINALS_KEY = "radiosity_originals"
"""On the scene: True while it is shown as it was before the bake. On an object behind a stand-in, then: whether only
the instances that it makes stay in sight when the bake is shown again."""

SHOWN_KEY = "radiosity_shown"
"""While the originals are shown: on a stand-in its visibility, on other objects and meshes the preview material of
each slot, by its index, on the scene its mixed world."""

KEYS = (
    BAKE_KEY, PAGE_KEY, BACK_PAGE_KEY, STAND_IN_KEY, HIDDEN_KEY, UV_KEY, SLOT_KEY, PREVIEW_KEY, ORIGINAL_MATERIAL_KEY,
    PLACE_KEY, SLOTS_KEY, TEXELS_KEY, REPORT_KEY, ORIGINALS_KEY, SHOWN_KEY,
)  # fmt: skip


def is_baked(scene: bpy.types.Scene) -> bool:
    """Whether the scene carries a bake that `revert` can take out."""
    return BAKE_KEY in scene


def orphaned_bakes(scene: bpy.types.Scene) -> set[str]:
    """Tokens of bakes that objects of the scene brought along from other files: no scene of this one carries them."""
    found = {thing[BAKE_KEY] for thing in scene.objects if BAKE_KEY in thing}
    return found - {each.get(BAKE_KEY) for each in bpy.data.scenes}


def is_full_copy(scene: bpy.types.Scene) -> bool:
    """Whether the scene was copied with its bake, which another scene still shows on objects of its own."""
    token = scene.get(BAKE_KEY)
    others = [each for each in bpy.data.scenes if each != scene and token is not None and each.get(BAKE_KEY) == token]
    baked = {thing for thing in scene.objects if thing.get(BAKE_KEY) == token}
    return bool(others) and not any(thing in baked for each in others for thing in each.objects)


def page_images(token: str) -> list[bpy.types.Image]:
    """The images of a bake's pages, as far as they are still there, in order; those of light groups are others."""
    own = [image for image in bpy.data.images if image.get(BAKE_KEY) == token and PAGE_KEY in image]
    return sorted((image for image in own if GROUP_KEY not in image), key=lambda image: image[PAGE_KEY])


def group_images(token: str, page: int) -> dict[str, bpy.types.Image]:
    """By name of the light group, the images that hold its share of one page's light."""
    own = [image for image in bpy.data.images if image.get(BAKE_KEY) == token and GROUP_KEY in image]
    return {image[GROUP_KEY]: image for image in own if image[PAGE_KEY] == page}


def is_stand_in(thing: bpy.types.Object) -> bool:
    """Whether the object only shows another one, and is no input of a bake."""
    return STAND_IN_KEY in thing


def is_behind_stand_in(thing: bpy.types.Object) -> bool:
    """Whether a stand-in shows the object, which is hidden for that reason alone."""
    return HIDDEN_KEY in thing


def is_preview(material: bpy.types.Material | None) -> bool:
    """Whether the material is a copy that shows a lightmap."""
    return material is not None and PREVIEW_KEY in material


def original_material(material: bpy.types.Material | None) -> bpy.types.Material | None:
    """The user's material behind a preview material; any other material is its own original."""
    if material is not None and is_preview(material):
        return material.get(ORIGINAL_MATERIAL_KEY)
    return material


def original_world(world: bpy.types.World | None) -> bpy.types.World | None:
    """The user's world behind one that is mixed with its light group; any other world is its own original."""
    return world and (world.get(ORIGINAL_WORLD_KEY) or world)


def has_our_uv_map(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh's uv map of our name was made by a bake, of this mesh or of one that was joined to it."""
    return UV_MAP in mesh.uv_layers and (UV_KEY in mesh or any(is_preview(each) for each in mesh.materials))
