# SPDX-License-Identifier: GPL-3.0-or-later
"""The pages of a bake as light again, wherever the .blend has them by now: in files or packed."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path

import bpy
import numpy as np

from ...arrays import Float32
from ...errors import OutputError, SceneError
from ...pages.page_files import read_page
from ...pages.page_format import Recipe
from ...scene import RGB
from ..data.names import BAKE_KEY, PAGE_KEY, RECIPE_KEY, group_images, is_baked, page_images
from ..data.working_space import working_space
from .light_mix import mixed_colors


def baked_pages(scene: bpy.types.Scene) -> tuple[list[Float32], Recipe]:
    """Every page of the scene's bake, (H, W, 3) float32, W/(m2 sr), row 0 at v = 0, and the recipe of their files.

    The light is in the recipe's space, its light groups as the scene's sliders mix them.

    Raises:
        SceneError: the scene is not baked, or a page's image was deleted
        OutputError: a page's file is gone or can't be read
    """
    if not is_baked(scene):
        raise SceneError(scene.name, "it is not baked", "Bake it first")
    images = page_images(scene[BAKE_KEY])
    if [image[PAGE_KEY] for image in images] != list(range(len(images))) or not images:
        raise SceneError(scene.name, "the image of one of its lightmaps was deleted", "Bake again")
    colors = mixed_colors(scene)
    return [mixed_light(image, colors) for image in images], recipe_of(images[0])


def recipe_of(image: bpy.types.Image) -> Recipe:
    """How the file of a page's image is read."""
    return Recipe.from_dict(json.loads(image[RECIPE_KEY]))


def mixed_light(image: bpy.types.Image, colors: Mapping[str, RGB]) -> Float32:
    """The light (H, W, 3) of one page, in the space of its recipe, each light group times a colour.

    Args:
        image: of the page
        colors: by name of the light group, in the working space; none of them leaves the page as it was baked

    Raises:
        OutputError: a light group's image was deleted, or a file is gone or can't be read
    """
    if not colors:
        return page_light(image)
    groups = group_images(image[BAKE_KEY], image[PAGE_KEY])
    space, working = recipe_of(image).space, working_space()
    light = np.zeros((image.size[1], image.size[0], 3), np.float32)
    for name, color in colors.items():
        if name not in groups:
            raise OutputError(image.name, f"the image of its light group {name!r} was deleted", "Bake again")
        matrix = working.to(space) @ np.diag(color) @ space.to(working)
        light += page_light(groups[name]) @ matrix.T.astype(np.float32)
    return light


def page_light(image: bpy.types.Image) -> Float32:
    """The light (H, W, 3) that the file of an image holds, in the space of its recipe.

    Raises:
        OutputError: its file is gone or can't be read
    """
    recipe = recipe_of(image)
    path = Path(bpy.path.abspath(image.filepath, library=image.library))
    if image.packed_file is None:
        if not path.is_file():
            remedy = "Put it back, choose File > External Data > Find Missing Files, or bake again"
            raise OutputError(str(path), f"the file of {image.name!r} is missing", remedy)
        return read_page(path, recipe)
    with tempfile.TemporaryDirectory(prefix="radiosity-") as folder:
        unpacked = Path(folder) / f"page{path.suffix}"
        unpacked.write_bytes(image.packed_file.data)
        return read_page(unpacked, recipe)
