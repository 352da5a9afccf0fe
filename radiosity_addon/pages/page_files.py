# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages as files in the format that the user wants, and beside them, in words and numbers, how to read them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Float32
from ..chunks import finish, in_chunks
from ..color.gamut import GamutMap
from ..color.spaces import RGBSpace
from ..color.transfer import srgb_encode
from ..files import Transaction, safe_stem, write_bytes, write_text
from .encodings import encode_logluv, encode_rgb9e5, encode_rgbd, encode_rgbm, quantize
from .image import HALF_MAX, read_image, write_exr, write_hdr
from .page_format import PageFormat, Recipe
from .png import P3_CHROMATICITIES, REC709_CHROMATICITIES, Chunk, gamma_chunks, png_bytes, srgb_chunks, text_chunk

ROWS = 32
"""Rows encoded in one go: a page of 4096 texels has 1.5 MB of light in them."""
DIMMEST_SCALE = 1e-6
"""What stands for the brightest light of a bake that is all black."""


@dataclass(frozen=True, eq=False)
class PageFiles:
    """What was written.

    Attributes:
        recipe: how to read the files
        outside: share of texels that were outside of what the files can hold
        left_outside: share that still were when colours had been mapped
        clamped: for each page, values that were no number or too large for the format
    """

    recipe: Recipe
    outside: float
    left_outside: float
    clamped: tuple[int, ...]


def page_paths(folder: Path, stem: str, count: int, suffix: str = ".exr") -> list[Path]:
    """Where the pages of the .blend called `stem` are written."""
    return [folder / f"{safe_stem(stem)}_radiosity_{page + 1}{suffix}" for page in range(count)]


def group_stems(stem: str, groups: Sequence[str]) -> dict[str, str]:
    """What the names of each light group's pages begin with, all different and different from `stem`."""
    stems: dict[str, str] = {}
    for name in groups:
        wanted = safe_stem(f"{stem}_{name or 'no_group'}")
        taken = {each.casefold() for each in stems.values()}
        numbered = (f"{wanted}_{number}" for number in range(2, len(groups) + 2))
        stems[name] = next(each for each in (wanted, *numbered) if each.casefold() not in taken)
    return stems


def sidecar_path(folder: Path, stem: str) -> Path:
    """Where the recipe of these pages is written."""
    return folder / f"{safe_stem(stem)}_radiosity.json"


def write_pages(
    pages: Sequence[Float32],
    paths: Sequence[Path],
    wanted: PageFormat,
    working: RGBSpace,
    files: Transaction,
    workers: int = 1,
) -> PageFiles:
    """Write the pages of a bake, all by one recipe.

    Args:
        pages: (H, W, 3) float32 each, W/(m2 sr), row 0 at v = 0, in the working space
        paths: where each goes

    Raises:
        OutputError: a file can't be written, or came back different
    """
    mapping = gamut_map(wanted, working)
    space = mapping.target
    if holds_all(wanted, working):
        recipe = Recipe("exr", space, intent=wanted.intent)
        return PageFiles(recipe, 0.0, 0.0, tuple(_write_each(pages, paths, wanted, recipe, files, workers)))
    sound, clamped = zip(*(finite(page) for page in pages), strict=True)
    extent = mapping.survey(sound, workers)
    fitted = [mapping.apply(page, extent, workers) for page in sound]
    check = GamutMap(space, space, "relative", mapping.peak)
    recipe = Recipe(
        format=wanted.format,
        space=space,
        transfer=wanted.transfer if wanted.is_picture else "linear",
        scale=2.0**-wanted.exposure if wanted.is_picture else 1.0,
        brightest=_brightest(fitted, wanted, space),
        intent=wanted.intent,
    )
    left = check.survey(fitted, workers).outside
    lost = _write_each(fitted, paths, wanted, recipe, files, workers)
    return PageFiles(recipe, extent.outside, left, tuple(map(sum, zip(clamped, lost, strict=True))))


def holds_all(wanted: PageFormat, working: RGBSpace) -> bool:
    """Whether files hold any number of the working space as it is, negative ones too."""
    return wanted.format == "exr" and np.array_equal(wanted.space_of(working).to_xyz, working.to_xyz)


def gamut_map(wanted: PageFormat, working: RGBSpace) -> GamutMap:
    """The way of light from the working space into what the files can hold."""
    return GamutMap(
        source=working,
        target=wanted.space_of(working),
        intent=wanted.intent,
        peak=1.0 if wanted.is_picture else None,
        gain=2.0**wanted.exposure if wanted.is_picture else 1.0,
    )


def read_page(path: Path, recipe: Recipe) -> Float32:
    """The light (H, W, 3) of a page's file, W/(m2 sr), row 0 at v = 0, in the recipe's space.

    Raises:
        OutputError: it can't be read
    """
    return recipe.decode(read_image(path))


def write_sidecar(
    path: Path, pages: Sequence[Path], recipe: Recipe, files: Transaction, more: Mapping[str, Any] | None = None
) -> None:
    """Write how to read the pages, and what `more` there is to know, as JSON beside them."""
    known = {"pages": [page.name for page in pages], **recipe.as_dict(), **(more or {})}
    write_text(path, json.dumps(known, indent=2, ensure_ascii=False, allow_nan=False) + "\n", files)


def finite(page: Float32) -> tuple[Float32, int]:
    """A page of finite numbers, and how many were not: not a number becomes 0, infinity the largest half float."""
    lost = sum(int(np.count_nonzero(~np.isfinite(page[start : start + ROWS]))) for start in range(0, len(page), ROWS))
    return (np.nan_to_num(page, nan=0.0, posinf=HALF_MAX, neginf=-HALF_MAX) if lost else page), lost


def _brightest(pages: Sequence[Float32], wanted: PageFormat, space: RGBSpace) -> float:
    if wanted.format in ("rgbm", "rgbd"):
        found = max(float(page.max(initial=0)) for page in pages)
    elif wanted.format == "logluv":
        weights = space.luminance_weights.astype(np.float32)
        found = max(float((page @ weights).max(initial=0)) for page in pages)
    else:
        return 1.0
    return max(found, DIMMEST_SCALE)


def _write_each(
    pages: Sequence[Float32],
    paths: Sequence[Path],
    wanted: PageFormat,
    recipe: Recipe,
    files: Transaction,
    workers: int,
) -> list[int]:
    clamped = []
    for path, page in zip(paths, pages, strict=True):
        if wanted.format == "exr":
            depth, compression = wanted.depth, wanted.compression
            count = write_exr(path, page, files, depth=depth, compression=compression, space=recipe.space)
        elif wanted.format == "hdr":
            count = write_hdr(path, page, files, workers)
        else:
            count = 0
            coded = encode(page[::-1], recipe, workers, dithered=wanted.dither)
            write_bytes(path, png_bytes(coded, _color_chunks(wanted, recipe), workers), files)
        clamped.append(count)
    return clamped


def encode(page: Float32, recipe: Recipe, workers: int = 1, *, dithered: bool = False) -> NDArray[Any]:
    """The numbers (H, W, C) of a PNG file for light (H, W, 3) inside the gamut, by blocks of rows."""

    def block(start: int, stop: int) -> NDArray[Any]:
        light = page[start:stop]
        if recipe.format == "rgbm":
            return encode_rgbm(light, recipe.brightest)
        if recipe.format == "rgbd":
            return encode_rgbd(light, recipe.brightest)
        if recipe.format == "logluv":
            return encode_logluv(light, recipe.brightest, recipe.space)
        if recipe.format == "rgb9e5":
            return encode_rgb9e5(light)
        bits = 8 if recipe.format == "png8" else 16
        coded = srgb_encode(light) if recipe.transfer == "srgb" else light
        return quantize(coded, bits, dithered and bits == 8, first_row=start)

    return np.concatenate(finish(in_chunks(block, len(page), ROWS, workers)))


def _color_chunks(wanted: PageFormat, recipe: Recipe) -> list[Chunk]:
    """What a PNG says of its colours; numbers that are no colours only carry a remark."""
    if not wanted.is_picture:
        return [text_chunk("Comment", f"{recipe.format} data, not colours: {recipe.as_dict()['decode']}")]
    p3 = wanted.space == "p3"
    if recipe.transfer == "srgb":
        return srgb_chunks(display_p3=p3)
    return gamma_chunks(1.0, P3_CHROMATICITIES if p3 else REC709_CHROMATICITIES)
