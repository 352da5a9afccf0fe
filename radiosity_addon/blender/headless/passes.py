# SPDX-License-Identifier: GPL-3.0-or-later
"""The contact sheet: a scene after some passes of a solver, seen by its camera, side by side."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...arrays import Float32
from ...errors import OutputError
from ...files import Transaction
from ...settings import BakeSettings
from ..data.blend_files import silence
from ..job import Job, bake_scene
from .commands import bake_settings, watched
from .render_picture import is_whole, render_picture

if TYPE_CHECKING:
    from ...arguments import Verb
    from ...progress import Meter

EDGE = 640
"""Pixels along the longer edge of each picture."""
GAP = 8
"""Pixels between pictures."""
JACOBI, PROGRESSIVE = (1, 2, 3, 6), (1, 10, 100, 1000)
"""Passes that are shown unless others are asked for."""


def contact_sheet(verb: Verb, meter: Meter) -> None:
    """Bake and render the open scene once for each picture, and join the pictures.

    Raises:
        BakeError: with the object or file, the cause and the remedy
    """
    scene = bpy.context.scene
    # The sheet compares solvers: what the scene says about solver and bounces has no part in it.
    plain = replace(bake_settings(scene, verb), solver="progressive", bounces=None)
    rows = _jacobi(plain, verb.passes or JACOBI)
    if verb.splits:
        rows = _subdivided(plain, verb.splits)
    elif verb.solver == "progressive":
        rows = _progressive(plain, verb.passes or PROGRESSIVE)
    with Transaction() as files, tempfile.TemporaryDirectory(prefix="radiosity-") as folder:
        files.make_folder(verb.picture.parent)
        pictures = []
        for row in rows:
            pictures.append([])
            for caption, settings in row:
                path = Path(folder) / f"{len(pictures)}-{len(pictures[-1])}.png"
                job = Job(settings=settings, write_back="preview", folder=None, stem="pass")
                report = watched(bake_scene(scene, job, files), meter)
                shown = [bpy.data.objects[baked.object] for baked in report.objects]
                with silence():
                    render_picture(scene, path, shown, files, caption, EDGE)
                pictures[-1].append(_pixels(path))
        _save(_joined(pictures), verb.picture, files)
        files.commit()


Row = list[tuple[str, BakeSettings]]


def _jacobi(settings: BakeSettings, passes: tuple[int, ...]) -> list[Row]:
    """Pass k holds direct light and k - 1 bounces."""
    names = {1: "direct light", 2: "1 bounce"}
    return [
        [
            (f"Pass {number}: {names.get(number, f'{number - 1} bounces')}", replace(settings, bounces=number - 1))
            for number in passes
        ]
    ]


def _progressive(settings: BakeSettings, shots: tuple[int, ...]) -> list[Row]:
    """The patches as they are after so many shots of single patches, without and with the ambient term."""
    return [
        [
            (
                f"{number:,} shot{'s' * (number > 1)}{' and ambient light' * ambient}",
                replace(settings, solver="southwell", most_steps=number, ambient=ambient, final_gather=False),
            )
            for number in shots
        ]
        for ambient in (False, True)
    ]


def _subdivided(settings: BakeSettings, numbers: tuple[int, ...]) -> list[Row]:
    """Patches that were split so often, with their edges, and their light alone."""
    names = {0: "Patches", 1: "Split once", 2: "Split twice"}
    return [
        [
            (
                names.get(number, f"Split {number} times") if edges else "",
                replace(settings, subdivisions=number, final_gather=False, show_patches=edges),
            )
            for number in numbers
        ]
        for edges in (True, False)
    ]


def _pixels(path: Path) -> Float32:
    """(H, W, 4) as stored, row 0 at the bottom."""
    image = bpy.data.images.load(str(path))
    try:
        width, height = image.size
        pixels = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(pixels)
    finally:
        bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)


def _joined(rows: list[list[Float32]]) -> Float32:
    height, width, _ = rows[0][0].shape
    across, down = max(len(row) for row in rows), len(rows)
    sheet = np.ones((down * (height + GAP) - GAP, across * (width + GAP) - GAP, 4), np.float32)
    for y, row in enumerate(reversed(rows)):
        for x, picture in enumerate(row):
            sheet[y * (height + GAP) :, x * (width + GAP) :][:height, :width] = picture
    return sheet


def _save(sheet: Float32, path: Path, files: Transaction) -> None:
    temporary = files.begin(path)
    image = bpy.data.images.new("Contact Sheet", sheet.shape[1], sheet.shape[0])
    try:
        image.pixels.foreach_set(sheet.ravel())
        image.file_format = "PNG"
        image.filepath_raw = str(temporary)
        image.save()
    finally:
        bpy.data.images.remove(image)
    if not is_whole(temporary):
        raise OutputError(str(path), "the contact sheet was not written", "Free some space or choose another folder")
    files.place(path)
