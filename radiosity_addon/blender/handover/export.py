# SPDX-License-Identifier: GPL-3.0-or-later
"""A bake handed over to game engines and the web: lightmaps, what belongs where on them, and a glTF file."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...arrays import Float32
from ...color.spaces import RGBSpace
from ...files import Transaction, safe_stem
from ...pages.page_files import page_paths, sidecar_path, write_pages, write_sidecar
from ...pages.page_format import MAX_EXPOSURE, PageFormat, Transfer
from ..data.working_space import working_space
from ..writing.baked_pages import baked_pages
from ..writing.originals import as_baked
from .gltf import Pictures, write_glb
from .lit_set import Part, lit_set
from .painted_pages import paint

CLIPPED_SHARE = 0.001
"""Share of texels that may be brighter than the white of a glTF's pictures: 8 bits can't span the glow at lamps too."""
DIMMEST = 1e-6
"""White of the pictures of a bake that is all black, W/(m2 sr)."""


@dataclass(frozen=True)
class Handover:
    """What to hand over.

    Attributes:
        folder: where to, absolute
        stem: what the files' names begin with
        page_format: of the lightmap files
        gltf: write a .glb file beside them
        workers: threads
    """

    folder: Path
    stem: str
    page_format: PageFormat = field(default_factory=PageFormat)
    gltf: bool = True
    workers: int = 1


@dataclass(frozen=True)
class Exported:
    """What was written: lightmaps, a JSON file that tells how to read and place them, a .glb file, and warnings."""

    pages: list[Path]
    sidecar: Path
    gltf: Path | None
    warnings: list[str]

    def summary(self) -> str:
        """One line for the user."""
        lightmaps = f"{len(self.pages)} lightmap{'s' if len(self.pages) > 1 else ''}"
        return f"Exported {lightmaps}{' and a glTF file' if self.gltf else ''} to {self.sidecar.parent}"


def export_lightmaps(scene: bpy.types.Scene, wanted: Handover, files: Transaction) -> Exported:
    """Write a baked scene's files. Whether they stay is decided by `files`; the scene is left as found.

    Raises:
        BakeError: with the object or file, the cause and the remedy
    """
    pages, recipe = baked_pages(scene)
    files.make_folder(wanted.folder)
    files.lock(wanted.folder)
    paths = page_paths(wanted.folder, wanted.stem, len(pages), wanted.page_format.suffix)
    written = write_pages(pages, paths, wanted.page_format, recipe.space, files, wanted.workers)
    sidecar = sidecar_path(wanted.folder, wanted.stem)
    glb = wanted.folder / f"{safe_stem(wanted.stem)}.glb" if wanted.gltf else None
    with as_baked(scene), lit_set(scene) as lit:
        if glb is not None:
            light = light_pictures(pages, recipe.space, wanted.workers)
            colors = paint(scene, lit, len(pages), len(pages[0])).items()
            painted = {quantity: _painted_pictures(shown, wanted.workers) for quantity, shown in colors}
            write_glb(glb, lit, light, painted, files)
        more = {"objects": [_row(part, paths) for part in lit.parts if part.lit_by is not None]}
        warnings = list(lit.materials.warnings)
    write_sidecar(sidecar, paths, written.recipe, files, more)
    return Exported(paths, sidecar, glb, warnings if glb else [])


def light_pictures(pages: Sequence[Float32], space: RGBSpace, workers: int = 1) -> Pictures:
    """Lightmaps as glTF has them: 8 bits, linear Rec.709, dithered.

    All share one white, which `CLIPPED_SHARE` of the texels may exceed; it keeps the steps of 8 bits small.

    Args:
        pages: (H, W, 3) float32 each, H / pi in W/(m2 sr)
        space: of the pages
    """
    high = np.concatenate([np.maximum(np.maximum(page[..., 0], page[..., 1]), page[..., 2]).ravel() for page in pages])
    white = max(float(np.quantile(high, 1 - CLIPPED_SHARE, method="lower")), DIMMEST)
    return _pictures(pages, space, "linear", white, workers)


def _painted_pictures(pages: Sequence[Float32], workers: int) -> Pictures:
    """Colours as glTF has them: 8 bits, sRGB, white where they are brightest, or 1."""
    white = max(1.0, *(float(page.max(initial=0)) for page in pages))
    return _pictures([np.maximum(page, 0) for page in pages], working_space(), "srgb", white, workers)


def _pictures(pages: Sequence[Float32], space: RGBSpace, transfer: Transfer, white: float, workers: int) -> Pictures:
    exposure = max(-math.log2(white), -MAX_EXPOSURE)
    wanted = PageFormat("png8", exposure=exposure, transfer=transfer)
    with tempfile.TemporaryDirectory(prefix="radiosity-") as folder, Transaction() as files:
        paths = page_paths(Path(folder), "page", len(pages), wanted.suffix)
        written = write_pages(pages, paths, wanted, space, files, workers)
        return Pictures([path.read_bytes() for path in paths], written.recipe.scale)


def _row(part: Part, pages: Sequence[Path]) -> dict[str, Any]:
    """Where an object's light lies, as Blender counts: v = 0 at the lowest row of texels."""
    scale, *shift = part.lit_by.place or (1.0, 0.0, 0.0)
    return {
        "object": part.name,
        "page": pages[part.lit_by.page].name,
        "uv_map": part.uv_map,
        "uv_scale": [scale, scale],
        "uv_offset": shift,
    }
