# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user chooses about the files of pages, and the recipe by which such a file is read again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..arrays import Float32
from ..color.gamut import INTENTS, Intent
from ..color.spaces import REC709, SPACES, RGBSpace
from ..color.transfer import srgb_decode
from ..errors import SettingsError
from .encodings import LOGLUV_STOPS, UV_MAX, decode_logluv, decode_rgb9e5, decode_rgbd, decode_rgbm

FormatName = Literal["exr", "hdr", "png8", "png16", "rgbm", "rgbd", "logluv", "rgb9e5"]
FORMATS: tuple[str, ...] = get_args(FormatName)
Depth = Literal["half", "float"]
DEPTHS: tuple[str, ...] = get_args(Depth)
Compression = Literal["none", "rle", "zips", "zip", "piz"]
COMPRESSIONS: tuple[str, ...] = get_args(Compression)
Transfer = Literal["srgb", "linear"]
TRANSFERS: tuple[str, ...] = get_args(Transfer)

PICTURES = ("png8", "png16")
"""Formats of low dynamic range: they show light from 0 to 1, after the exposure, and no more."""
MAX_EXPOSURE = 32.0
"""Stops up or down."""


@dataclass(frozen=True)
class PageFormat:
    """How pages are written.

    Attributes:
        format: exr; hdr (Radiance); png8, png16: pictures; rgbm, rgbd, logluv, rgb9e5: high dynamic range in PNG files
        depth: of EXR: half or float
        compression: of EXR, all of them lossless
        exposure: stops by which pictures are brightened
        transfer: of pictures: srgb or linear
        space: a word of SPACES; None is Rec.709 for pictures and the scene's working space for all else
        intent: what happens to colours that the format or the space can't hold
        dither: hide the steps of 8 bits in pictures
    """

    format: FormatName = "exr"
    depth: Depth = "half"
    compression: Compression = "zip"
    exposure: float = 0.0
    transfer: Transfer = "srgb"
    space: str | None = None
    intent: Intent = "relative"
    dither: bool = True

    def __post_init__(self) -> None:
        for subject, word, words in (
            ("Format", self.format, FORMATS),
            ("Depth", self.depth, DEPTHS),
            ("Compression", self.compression, COMPRESSIONS),
            ("Transfer function", self.transfer, TRANSFERS),
            ("Intent", self.intent, INTENTS),
            ("Space", self.space or next(iter(SPACES)), tuple(SPACES)),
        ):
            if word not in words:
                raise SettingsError(subject, f"{word!r} is unknown", "Choose from " + ", ".join(words))
        if not abs(self.exposure) <= MAX_EXPOSURE:
            raise SettingsError(
                "Exposure", f"{self.exposure} is out of range", f"Choose from -{MAX_EXPOSURE:g} to {MAX_EXPOSURE:g}"
            )
        if self.is_picture and self.transfer == "srgb" and self.space in ("rec2020", "acescg"):
            raise SettingsError(
                "Space", f"pictures with sRGB's transfer function are not made in {self.space}", "Choose rec709 or p3"
            )

    @property
    def is_picture(self) -> bool:
        """Whether the format has a low dynamic range."""
        return self.format in PICTURES

    @property
    def suffix(self) -> str:
        """How the files' names end."""
        return {"exr": ".exr", "hdr": ".hdr"}.get(self.format, ".png")

    def space_of(self, working: RGBSpace) -> RGBSpace:
        """The space that files are in."""
        return SPACES[self.space] if self.space else REC709 if self.is_picture else working


@dataclass(frozen=True, eq=False)
class Recipe:
    """How the numbers in a page file become light: H / pi in W/(m2 sr), linear RGB.

    Attributes:
        format: as in PageFormat
        space: of the decoded light
        transfer: of pictures
        scale: what decoded light is multiplied by: 2^-exposure
        brightest: light that RGBM's and RGBD's full scale stands for, the luminance of LogLuv's
        intent: what happened to colours outside
    """

    format: str
    space: RGBSpace
    transfer: str = "linear"
    scale: float = 1.0
    brightest: float = 1.0
    intent: str = "relative"

    def decode(self, stored: NDArray[Any]) -> Float32:
        """Light (H, W, 3) of a file's numbers (H, W, C), as they are stored."""
        if self.format == "rgbm":
            return decode_rgbm(stored, self.brightest)
        if self.format == "rgbd":
            return decode_rgbd(stored, self.brightest)
        if self.format == "logluv":
            return decode_logluv(stored, self.brightest, self.space)
        if self.format == "rgb9e5":
            return decode_rgb9e5(stored)
        light = stored[..., :3].astype(np.float32)
        if self.format in PICTURES:
            light /= np.float32(np.iinfo(stored.dtype).max)
            light = srgb_decode(light) if self.transfer == "srgb" else light
        return light * np.float32(self.scale)

    def as_dict(self) -> dict[str, Any]:
        """For a JSON file, formula included."""
        known: dict[str, Any] = {
            "format": self.format,
            "quantity": "irradiance / pi",
            "unit": "W/(m2 sr)",
            "decode": FORMULAS[self.format].format(transfer=TRANSFER_FORMULAS[self.transfer]),
            "scale": self.scale,
            "brightest": self.brightest,
            "transfer": self.transfer,
            "space": self.space.name,
            "rgb_to_xyz_d65": [[float(number) for number in row] for row in self.space.to_xyz],
            "intent": self.intent,
            "first_row": "top",
        }
        return known

    @staticmethod
    def from_dict(known: dict[str, Any]) -> Recipe:
        """The inverse of `as_dict`."""
        return Recipe(
            format=known["format"],
            space=RGBSpace(known["space"], np.array(known["rgb_to_xyz_d65"], np.float64)),
            transfer=known["transfer"],
            scale=float(known["scale"]),
            brightest=float(known["brightest"]),
            intent=known["intent"],
        )


TRANSFER_FORMULAS = {
    "srgb": "c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055)^2.4",
    "linear": "c",
}
PICTURE_FORMULA = "light = scale * f(rgb), f(c) = {transfer}"
FORMULAS = {
    "exr": "light = rgb",
    "hdr": "light = rgb",
    "png8": PICTURE_FORMULA,
    "png16": PICTURE_FORMULA,
    "rgbm": "light = brightest * (rgb * a)^2",
    "rgbd": "light = brightest * (rgb / (255 * a))^2",
    "logluv": (
        f"Y = r > 0 ? brightest * 2^({LOGLUV_STOPS:g} * (r - 1)) : 0; u = {UV_MAX} * g; v = {UV_MAX} * b; "
        "X = 9 * u / (4 * v) * Y; Z = (12 - 3 * u - 20 * v) / (4 * v) * Y; "
        "light = inverse(rgb_to_xyz_d65) * (X, Y, Z)"
    ),
    "rgb9e5": (
        "word = R + 2^8 * G + 2^16 * B + 2^24 * A, of bytes; e = word >> 27; "
        "light = ((word & 511), (word >> 9 & 511), (word >> 18 & 511)) * 2^(e - 24); this is GL_RGB9_E5; do not filter"
    ),
}
"""How to decode, with channels r, g, b, a from 0 to 1."""
