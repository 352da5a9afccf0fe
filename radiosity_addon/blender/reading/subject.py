# SPDX-License-Identifier: GPL-3.0-or-later
"""What Cycles is to look at: a few datablocks, which can be handed over to another Blender in a file."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import bpy
import numpy as np

from ...arrays import Float32
from ...errors import SceneError
from ..data.blend_files import silence
from ..looks.nodes import tree_of
from ..looks.surface_inputs import trees_within

D = TypeVar("D", bound=bpy.types.ID)

CARRIER_KEY = "radiosity_subject"
"""On the object by which the datablocks of a file are found, whatever their names have become."""


@dataclass(frozen=True)
class Subject:
    """What Cycles is to look at, and when.

    Attributes:
        datablocks: by any names; None where there is none
        frame, subframe: the moment
        osl: worlds are to be shown by Open Shading Language
    """

    datablocks: Mapping[str, bpy.types.ID | None]
    frame: int
    subframe: float
    osl: bool = False

    @classmethod
    def of(cls, scene: bpy.types.Scene, datablocks: Mapping[str, bpy.types.ID | None]) -> Subject:
        """Datablocks as a scene shows them."""
        osl = bool(getattr(getattr(scene, "cycles", None), "shading_system", False))  # Cycles may be disabled
        return cls(datablocks, scene.frame_current, scene.frame_subframe, osl)

    def pose(self, scene: bpy.types.Scene) -> None:
        """Bring a scene to the moment."""
        scene.frame_current, scene.frame_subframe = self.frame, self.subframe


@dataclass(frozen=True)
class Handed:
    """A subject in a file, and what the file does not hold.

    Attributes:
        path: of the .blend
        seen: the subject without its datablocks
        painted: by full name, (P,) pixels of images that are nowhere but in memory
    """

    path: Path
    seen: Subject
    painted: Mapping[str, Float32]


def hand_over(subject: Subject, path: Path) -> Generator[None, None, Handed | None]:
    """Write a subject into a file; None if it might look otherwise in another Blender. The open file stays as it is.

    What the datablocks refer to comes along; images and linked files are referred to where they lie.
    """
    trees = [tree for each in subject.datablocks.values() for tree in _trees(each)]
    images = {image for tree in trees for node in tree.nodes if (image := getattr(node, "image", None)) is not None}
    if any(map(_needs_this_process, [*trees, *_owners(subject)])) or any(map(_only_shown_here, images)):
        return None
    carrier = bpy.data.objects.new("Radiosity", None)  # no scene: Blender 5.2 fails to write one
    try:
        carrier[CARRIER_KEY] = True
        for name, each in subject.datablocks.items():
            if each is not None:
                carrier[name] = each
        bpy.data.libraries.write(str(path), {carrier}, path_remap="ABSOLUTE")
    finally:
        bpy.data.objects.remove(carrier)
    painted: dict[str, Float32] = {}
    for image in filter(_is_painted, images):
        yield
        painted[image.name_full] = _pixels(image)
    return Handed(path, replace(subject, datablocks={}), painted)


def take_over(handed: Handed) -> Subject:
    """Open a file that was handed over, in place of the current one."""
    with silence():
        bpy.ops.wm.open_mainfile(filepath=str(handed.path), load_ui=False, use_scripts=False)
    images = {image.name_full: image for image in bpy.data.images}
    for name, pixels in handed.painted.items():
        images[name].pixels.foreach_set(pixels)
    carrier = next(thing for thing in bpy.data.objects if CARRIER_KEY in thing)
    return replace(handed.seen, datablocks={name: each for name, each in carrier.items() if name != CARRIER_KEY})


def named(datablocks: bpy.types.bpy_prop_collection[D], name: str, kind: str) -> D:
    """A datablock by its full name.

    Raises:
        SceneError: it is gone
    """
    found = next((each for each in datablocks if each.name_full == name), None)
    if found is None:
        raise SceneError(f"{kind} {name!r}", "was renamed or deleted during the bake", "Bake again")
    return found


def _trees(datablock: bpy.types.ID | None) -> Iterator[bpy.types.NodeTree]:
    if isinstance(datablock, (bpy.types.Material, bpy.types.World, bpy.types.Light)):
        tree = tree_of(datablock)
        if tree is not None:
            yield from trees_within(tree)


def _owners(subject: Subject) -> Iterator[bpy.types.ID]:
    """The datablocks themselves, and what an object hangs on."""
    for each in subject.datablocks.values():
        while each is not None:
            yield each
            if isinstance(each, bpy.types.Object) and each.data is not None:
                yield each.data
            each = getattr(each, "parent", None)


def _needs_this_process(datablock: bpy.types.ID) -> bool:
    """It is driven by Python, or has nodes that scripts have defined."""
    animation = datablock.animation_data
    drivers = [curve.driver for curve in animation.drivers] if animation is not None else []
    if any(driver.type == "SCRIPTED" and not driver.is_simple_expression for driver in drivers):
        return True
    return isinstance(datablock, bpy.types.NodeTree) and any(node.type.startswith("CUSTOM") for node in datablock.nodes)


def _only_shown_here(image: bpy.types.Image) -> bool:
    """It shows what this Blender has rendered, or was painted in tiles or frames, of which one is told."""
    return image.source == "VIEWER" or (image.is_dirty and not _is_painted(image))


def _is_painted(image: bpy.types.Image) -> bool:
    """Its pixels are not those that its file or its settings tell."""
    return image.is_dirty and image.source in ("GENERATED", "FILE")


def _pixels(image: bpy.types.Image) -> Float32:
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return pixels
