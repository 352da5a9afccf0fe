# SPDX-License-Identifier: GPL-3.0-or-later
"""Emissive meshes as lamps."""

from __future__ import annotations

import numpy as np

from .arrays import Bools
from .lamps import Lamp
from .scene import Scene
from .surfaces import Surfaces


def emissive_lamps(scene: Scene, surfaces: Surfaces) -> tuple[list[Lamp], Bools]:
    """Lamps that stand for emissive triangles, and (F,) which triangles; the gather finds the others."""
    return [], np.zeros(surfaces.count, bool)
