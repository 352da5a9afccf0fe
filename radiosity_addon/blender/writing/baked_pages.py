# SPDX-License-Identifier: GPL-3.0-or-later
"""The pages of a bake as light again, wherever the .blend has them by now: in files or packed."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import bpy

from ...arrays import Float32
from ...errors import OutputError, SceneError
from ...pages.page_files import read_page
from ...pages.page_format import Recipe
from ..data.names import BAKE_KEY, PAGE_KEY, RECIPE_KEY, is_baked


def baked_pages(scene: bpy.types.Scene) -> tuple[list[Float32], Recipe]:
    """Every page of the scene's bake, (H, W, 3) float32, W/(m2 sr), row 0 at v = 0, and the recipe of their files.

    The light is in the recipe's space.

    Raises:
        SceneError: the scene is not baked, or a page's image was deleted
        OutputError: a page's file is gone or can't be read
    """
    if not is_baked(scene):
        raise SceneError(scene.name, "it is not baked", "Bake it first")
    images = {image[PAGE_KEY]: image for image in bpy.data.images if image.get(BAKE_KEY) == scene[BAKE_KEY]}
    if sorted(images) != list(range(len(images))) or not images:
        raise SceneError(scene.name, "the image of one of its lightmaps was deleted", "Bake again")
    recipe = Recipe.from_dict(json.loads(images[0][RECIPE_KEY]))
    return [page_light(images[page], recipe) for page in range(len(images))], recipe


def page_light(image: bpy.types.Image, recipe: Recipe) -> Float32:
    """The light (H, W, 3) of one page, in the recipe's space.

    Raises:
        OutputError: its file is gone or can't be read
    """
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
