# SPDX-License-Identifier: GPL-3.0-or-later
"""What each page format loses, takes and costs: `python benchmarks/encodings.py [--size N] [--threads N]`.

Errors: of a colour's largest channel, over colours of every saturation in Rec.709 whose largest channels span 16 stops,
from 16 W/(m2 sr) down; of pictures, which do not span as many, as a share of white. Bytes and seconds: of a page like a
bake's, smooth with a little noise, for pictures with colours in Rec.2020 and some texels brighter than white, mapped
into what the format holds, written and read back; the best of three. Processor seconds are those of all threads.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from radiosity_addon.color.spaces import REC709, REC2020, RGBSpace  # noqa: E402
from radiosity_addon.files import Transaction  # noqa: E402
from radiosity_addon.pages.image import read_image  # noqa: E402
from radiosity_addon.pages.page_files import write_pages  # noqa: E402
from radiosity_addon.pages.page_format import PageFormat, Recipe  # noqa: E402

STOPS = 16
BRIGHTEST = 16.0
CASES = {
    "OpenEXR, half": PageFormat("exr"),
    "OpenEXR, float": PageFormat("exr", depth="float"),
    "Radiance HDR": PageFormat("hdr"),
    "RGBM, 8 bit": PageFormat("rgbm"),
    "RGBD, 8 bit": PageFormat("rgbd"),
    "LogLuv, 16 bit": PageFormat("logluv"),
    "RGB9E5": PageFormat("rgb9e5"),
    "PNG, 16 bit sRGB": PageFormat("png16"),
    "PNG, 8 bit sRGB, dithered": PageFormat("png8"),
}


def sixteen_stops(size: int = 1024) -> np.ndarray:
    """Colours whose largest channels lie evenly over 16 stops below BRIGHTEST."""
    random = np.random.default_rng(7)
    shares = random.random((size, size, 3)) ** 2
    shares /= shares.max(axis=-1, keepdims=True)
    return (BRIGHTEST * shares * 2.0 ** -(random.random((size, size, 1)) * STOPS)).astype(np.float32)


def like_a_bake(size: int) -> np.ndarray:
    """Two pools of light on walls, with 0.2 % of noise; one in fifty texels is brighter than white."""
    y, x = np.mgrid[0:size, 0:size].astype(np.float32) / size
    warm = 1.25 * np.exp(-((x - 0.3) ** 2 + (y - 0.5) ** 2) * 25)
    cool = 0.6 * np.exp(-((x - 0.75) ** 2 + (y - 0.4) ** 2) * 15)
    light = np.stack([0.05 + warm + 0.5 * cool, 0.05 + 0.75 * warm + 0.7 * cool, 0.06 + 0.45 * warm + cool], axis=-1)
    noise = np.random.default_rng(1).standard_normal((size, size), np.float32)
    return (0.9 * light * (1 + 0.002 * noise[..., None])).astype(np.float32)


def write(page: np.ndarray, wanted: PageFormat, working: RGBSpace, folder: Path, threads: int) -> tuple[Recipe, Path]:
    """Write a page as a bake would."""
    path = folder / f"page{wanted.suffix}"
    with Transaction() as files:
        done = write_pages([page], [path], wanted, working, files, threads)
        files.commit()
    return done.recipe, path


def loss(wanted: PageFormat, folder: Path, threads: int) -> tuple[float, float]:
    """Largest and RMS error."""
    colors = sixteen_stops()
    exposed = replace(wanted, exposure=-math.log2(BRIGHTEST)) if wanted.is_picture else wanted
    recipe, path = write(colors, exposed, REC709, folder, threads)
    error = recipe.decode(read_image(path)) - colors
    error /= BRIGHTEST if wanted.is_picture else colors.max(axis=-1, keepdims=True)
    return float(np.abs(error).max()), float(np.sqrt((error**2).mean()))


def main() -> None:
    """Print the README's table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--size", type=int, default=4096, help="texels along the edge of the timed page")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    page = like_a_bake(options.size)
    print("| format | largest error | RMS error | bytes a texel | seconds | processor seconds |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name, wanted in CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            largest, rms = loss(wanted, Path(folder), options.threads)
            seconds = processor = np.inf
            for _ in range(3):
                start = time.perf_counter(), time.process_time()
                _, path = write(page, wanted, REC2020 if wanted.is_picture else REC709, Path(folder), options.threads)
                seconds = min(seconds, time.perf_counter() - start[0])
                processor = min(processor, time.process_time() - start[1])
            size = path.stat().st_size / page[..., 0].size
        of = " of white" if wanted.is_picture else ""
        figures = f"{largest:.2%}{of} | {rms:.3%}{of} | {size:.1f} | {seconds:.1f} | {processor:.1f}"
        print(f"| {name} | {figures} |", flush=True)


if __name__ == "__main__":
    main()
