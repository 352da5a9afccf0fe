# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user sets in Blender about the files of pages: `scene.radiosity.files`, `scene.radiosity_export.files`."""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty, FloatProperty

from ...pages.page_format import MAX_EXPOSURE, PICTURES, PageFormat


class RadiosityFileSettings(bpy.types.PropertyGroup):
    """Format of the page files and what happens to colours that it can't hold."""

    format: EnumProperty(
        name="Format",
        description="How the lightmaps are stored",
        items=(
            ("exr", "OpenEXR", "All light, exactly, in the scene's working space"),
            ("hdr", "Radiance HDR", "8 bits a channel with a common exponent"),
            ("png8", "PNG, 8 bit", "A picture of low dynamic range, dithered"),
            ("png16", "PNG, 16 bit", "A picture of low dynamic range"),
            ("rgbm", "RGBM", "High dynamic range in 8 bit PNG files, with a common multiplier"),
            ("rgbd", "RGBD", "High dynamic range in 8 bit PNG files, with a common divisor"),
            ("logluv", "LogLuv", "Logarithm of luminance and chromaticity in 16 bit PNG files"),
            ("rgb9e5", "RGB9E5", "The shared exponent format of graphics cards, in PNG files"),
        ),
        default=PageFormat.format,
    )
    depth: EnumProperty(
        name="Depth",
        description="Precision of OpenEXR files",
        items=(("half", "Half", "16 bits a channel"), ("float", "Float", "32 bits a channel")),
        default=PageFormat.depth,
    )
    compression: EnumProperty(
        name="Compression",
        description="Of OpenEXR files; none of these loses anything",
        items=(
            ("none", "None", "Largest and fastest"),
            ("rle", "RLE", "Runs of equal values"),
            ("zips", "ZIPS", "Single lines, deflated"),
            ("zip", "ZIP", "Blocks of 16 lines, deflated"),
            ("piz", "PIZ", "Wavelets, good on noisy pages"),
        ),
        default=PageFormat.compression,
    )
    exposure: FloatProperty(
        name="Exposure",
        description="Stops by which pictures of low dynamic range are brightened",
        default=PageFormat.exposure,
        min=-MAX_EXPOSURE,
        max=MAX_EXPOSURE,
        soft_min=-8.0,
        soft_max=8.0,
    )
    transfer: EnumProperty(
        name="Transfer",
        description="Transfer function of pictures of low dynamic range",
        items=(("srgb", "sRGB", "As displays want it"), ("linear", "Linear", "Numbers in proportion to the light")),
        default=PageFormat.transfer,
    )
    space: EnumProperty(
        name="Color Space",
        description="Primaries of the files",
        items=(
            ("auto", "Automatic", "Rec.709 for pictures of low dynamic range, the scene's working space for all else"),
            ("rec709", "Rec.709", "The primaries of sRGB"),
            ("p3", "Display P3", "The primaries of wide displays"),
            ("rec2020", "Rec.2020", "The primaries of BT.2020"),
            ("acescg", "ACEScg", "The primaries AP1"),
        ),
        default="auto",
    )
    intent: EnumProperty(
        name="Intent",
        description="What happens to colours that the format or the color space can't hold",
        items=(
            ("relative", "Relative", "What is outside is desaturated until it is inside"),
            ("absolute", "Absolute", "What is outside goes to the nearest color inside"),
            ("perceptual", "Perceptual", "Saturations and brightness of the whole bake are bent to fit"),
            ("saturation", "Saturation", "Saturations of the whole bake are scaled to fit"),
        ),
        default=PageFormat.intent,
    )

    def draw(self, layout: bpy.types.UILayout) -> None:
        """What matters of the settings for the format that is chosen."""
        layout.prop(self, "format")
        if self.format == "exr":
            layout.prop(self, "depth", expand=True)
            layout.prop(self, "compression")
        elif self.format in PICTURES:
            layout.prop(self, "exposure")
            layout.prop(self, "transfer", expand=True)
        layout.prop(self, "space")
        fitting = layout.column()
        fitting.active = self.format != "exr" or self.space != "auto"
        fitting.prop(self, "intent")

    def page_format(self) -> PageFormat:
        """The core's settings."""
        return PageFormat(
            format=self.format,
            depth=self.depth,
            compression=self.compression,
            exposure=self.exposure,
            transfer=self.transfer,
            space=None if self.space == "auto" else self.space,
            intent=self.intent,
        )
