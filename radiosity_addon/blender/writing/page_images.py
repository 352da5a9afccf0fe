# SPDX-License-Identifier: GPL-3.0-or-later
"""Page files as images of the .blend, in the colour space that their numbers are in, and the way back to light.

What a colour space says, a picture's transfer function and primaries, Blender undoes where it knows the space by name.
The rest, such as RGBM, is data to Blender, and a node group decodes it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import chain, count
from pathlib import Path

import bpy
import numpy as np

from ...errors import OutputError, SettingsError
from ...files import safe_stem
from ...pages.page_format import PICTURES, Recipe
from ..data.names import BAKE_KEY, GROUP_KEY, PAGE_KEY, RECIPE_KEY, is_full_copy
from ..data.working_space import SAME, working_space
from .decode_nodes import DecodeNodes

ENCODED = {"Linear Rec.709": ("sRGB",), "Linear Display P3": ("Display P3", "sRGB Encoded P3-D65")}
"""Blender's names for a space under sRGB's transfer function, by our name of the linear one."""
LINEAR = {"Linear Display P3": "Linear DCI-P3 D65"}
"""Blender's name for a linear space, where it is not ours."""
PACKED = ("rgbm", "rgbd", "rgb9e5")
"""Formats whose alpha is a number like the others."""
UNFILTERED = ("rgb9e5",)
"""Formats that mean nothing between texels."""


def free_stem(stem: str, scene: bpy.types.Scene, folder: Path) -> str:
    """What the names of a scene's pages begin with: `stem`, unless pages of another scene of this file are called so.

    Args:
        folder: where the pages go
    """
    own = None if is_full_copy(scene) else scene.get(BAKE_KEY)
    others = [image for image in bpy.data.images if image.get(BAKE_KEY, own) != own]
    paths = [Path(bpy.path.abspath(each.filepath, library=each.library)) for each in others if not each.packed_file]
    taken = [path.name.casefold() for path in paths if path.parent.resolve() == folder.resolve()]
    named = f"{stem}_{scene.name}"
    return next(
        wanted
        for wanted in chain((stem, named), (f"{named}_{number}" for number in count(2)))
        if not any(name.startswith(f"{safe_stem(wanted)}_radiosity_".casefold()) for name in taken)
    )


def load_page(
    path: Path, page: int, token: str, recipe: Recipe, *, pack: bool, group: str | None = None
) -> bpy.types.Image:
    """Load a page file.

    Args:
        page: its index
        token: the bake's
        pack: keep it inside the .blend; one that is not saved does so anyhow
        group: of a page that holds the light of one light group alone, its name

    Raises:
        OutputError: it can't be read
        SettingsError: Blender's configuration does not know the colour space
    """
    try:
        image = bpy.data.images.load(str(path.resolve()))
    except RuntimeError as failure:
        raise OutputError(str(path), "this page can't be read", "Bake again") from failure
    image[BAKE_KEY] = token
    image[PAGE_KEY] = page
    image.name = page_name(page, group)
    if group is not None:
        image[GROUP_KEY] = group
    if 0 in image.size:
        raise OutputError(str(path), "this page is no readable picture", "Bake again")
    image.use_half_precision = recipe.format not in ("logluv", "png16")
    if recipe.format in PACKED:
        image.alpha_mode = "CHANNEL_PACKED"
    name = colorspace_of(recipe, _names(image))
    if name is None:
        image.colorspace_settings.is_data = True  # numbers to be used as they are
    else:
        image.colorspace_settings.name = name
    image[RECIPE_KEY] = json.dumps({**recipe.as_dict(), "colorspace": name})
    image.use_fake_user = True
    if pack or not bpy.data.is_saved:
        image.pack()
        image.filepath = f"//{path.name}"
        return image
    try:
        image.filepath = bpy.path.relpath(str(path.resolve()))
    except ValueError:  # on another drive than the .blend
        image.filepath = str(path.resolve())
    return image


def page_name(page: int, group: str | None) -> str:
    """What the image of a page is called, or of one light group's share of it."""
    return f"Radiosity {page + 1}" + (f" {group or 'No Group'}" if group is not None else "")


def colorspace_of(recipe: Recipe, names: Sequence[str]) -> str | None:
    """Blender's name of the space that a page's numbers are in, or None where they are data.

    Raises:
        SettingsError: it has none for pictures in this space
    """
    if recipe.format in PICTURES and recipe.transfer == "srgb":
        known = [name for name in ENCODED[recipe.space.name] if name in names]
        if not known:
            raise SettingsError(
                "Format", f"Blender's colour configuration has no {ENCODED[recipe.space.name][0]}", "Choose exr"
            )
        return known[0]
    if recipe.format in (*PICTURES, "exr", "hdr") and not _is_working(recipe):
        name = LINEAR.get(recipe.space.name, recipe.space.name)
        return name if name in names else None
    return None


def light_of(tree: bpy.types.NodeTree, texture: bpy.types.Node, token: str) -> bpy.types.NodeSocket:
    """The output that carries the light of a page, in the working space; a node group is added where it takes one.

    Args:
        tree: of the material
        texture: an image texture that shows a page
    """
    if RECIPE_KEY not in texture.image:
        return texture.outputs["Color"]
    known = json.loads(texture.image[RECIPE_KEY])
    recipe = Recipe.from_dict(known)
    if recipe.format in UNFILTERED:
        texture.interpolation = "Closest"
    converted = known["colorspace"] is not None
    if recipe.format not in (*PACKED, "logluv") and recipe.scale == 1 and (converted or _is_working(recipe)):
        return texture.outputs["Color"]
    group = tree.nodes.new("ShaderNodeGroup")
    group.node_tree = _group(recipe, token, converted)
    group.location, group.hide = texture.location, True
    tree.links.new(texture.outputs["Color"], group.inputs["Color"])
    tree.links.new(texture.outputs["Alpha"], group.inputs["Alpha"])
    return group.outputs["Light"]


def _group(recipe: Recipe, token: str, converted: bool) -> bpy.types.NodeTree:
    """The node group that decodes pages of a bake which were written alike, made once."""
    wanted = json.dumps(recipe.as_dict())
    for group in bpy.data.node_groups:
        if group.get(BAKE_KEY) == token and group.get(RECIPE_KEY) == wanted:
            return group
    group = bpy.data.node_groups.new(f"Radiosity Decode {recipe.format}", "ShaderNodeTree")
    group[BAKE_KEY], group[RECIPE_KEY] = token, wanted
    matrix = np.eye(3) if converted or _is_working(recipe) else recipe.space.to(working_space())
    DecodeNodes(group).build(recipe, matrix)
    return group


def _is_working(recipe: Recipe) -> bool:
    return bool(np.abs(recipe.space.to_xyz - working_space().to_xyz).max() < SAME)


def _names(image: bpy.types.Image) -> list[str]:
    return [item.identifier for item in type(image.colorspace_settings).bl_rna.properties["name"].enum_items]
