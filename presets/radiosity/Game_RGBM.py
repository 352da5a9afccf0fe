# SPDX-License-Identifier: GPL-3.0-or-later
import bpy

settings = bpy.context.scene.radiosity

settings.density_enabled = True
settings.density = 16.0
settings.fine_folds = False
settings.page_size = 2048
settings.quality = "medium"
settings.tolerance = 0.0001
settings.bounces = "all"
settings.most_bounces = 4
settings.solver = "conjugate-gradient"
settings.form_factors = "nusselt"
settings.subdivisions = 0
settings.light_groups = False
settings.write_back = "preview"
settings.files.format = "rgbm"
settings.files.depth = "half"
settings.files.compression = "zip"
settings.files.exposure = 0.0
settings.files.transfer = "srgb"
settings.files.space = "rec709"
settings.files.intent = "relative"
