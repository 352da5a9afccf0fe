# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps in radiometric units, as Cycles has them (measured in 4.5 and 5.2).

P is the lamp's power: energy x colour x 2^exposure, times the temperature's colour, times its node tree's emission.
Where that depends on the direction or the distance of the light, `lamp_distributions` measures it afterwards.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi, sin, tan

import bpy
import numpy as np

from ...arrays import Float64
from ...errors import SceneError
from ...scene import AreaLight, Light, PointLight, SpotLight, SunLight
from ..looks.closures import rgb
from ..looks.materials import Computed, read_constant, read_tree
from ..looks.nodes import ANY_PATH, tree_of

Warn = Callable[[str], None]


def read_lamp(lamp: bpy.types.Object, matrix: Float64, group: int, warn: Warn) -> Light | None:
    """A lamp's record, or None if no light of it reaches a diffuse surface.

    Args:
        lamp: the evaluated object
        matrix: (4, 4), its world matrix
        group: its light group
        warn: hears what had to be approximated

    Raises:
        SceneError: its power, size or angle is not finite
        LinkCycle: its node tree feeds back into itself
    """
    light = lamp.data
    power = _power(light) * _emission(light, warn)
    if not np.isfinite(power).all():
        raise SceneError(f"Lamp {lamp.name!r}", "its power is not a finite number", "Give it a finite power and colour")
    if getattr(getattr(light, "cycles", None), "is_portal", False) or not power.any():
        return None
    if not lamp.visible_diffuse:
        warn("is hidden from diffuse surfaces and gives no light")
        return None
    if lamp.light_linking.blocker_collection:
        warn("its shadow linking is not followed, everything casts shadows")
    if power.min() < 0:
        warn("has negative power and takes light away")
    found = READERS[light.type](lamp, light, power, matrix, group, warn)
    if found is not None and not _is_finite(found):
        raise SceneError(
            f"Lamp {lamp.name!r}", "its size or an angle is not a finite number", "Give it a finite size and shape"
        )
    return found


def _is_finite(light: Light) -> bool:
    return all(np.isfinite(value).all() for value in vars(light).values() if isinstance(value, (int, float, tuple)))


def is_shaped(light: bpy.types.Light) -> bool:
    """Whether nodes give the light of a point or spot light a shape, so that its record tells only its power.

    Raises:
        LinkCycle: its node tree feeds back into itself
    """
    tree = tree_of(light)
    if tree is None or light.type not in ("POINT", "SPOT"):
        return False
    try:
        read_constant(tree, ANY_PATH)
    except Computed:
        return True
    return False


def _emission(light: bpy.types.Light, warn: Warn) -> Float64:
    """What the node tree multiplies the power with, (3,); 1 where that is to be measured."""
    tree = tree_of(light)
    return np.ones(3) if tree is None or is_shaped(light) else read_tree(tree, warn).emission


def _power(light: bpy.types.Light) -> Float64:
    power = light.energy * np.array(light.color, np.float64) * 2.0 ** getattr(light, "exposure", 0.0)
    if getattr(light, "use_temperature", False):
        power = power * np.array(light.temperature_color)
    return power


def _sphere_intensity(light: bpy.types.Light, power: Float64) -> Float64:
    """W/sr. Not normalised, the radiance is P / pi whatever the radius; a point then has 4 times its normal power."""
    if getattr(light, "normalize", True):
        return power / (4 * pi)
    return power * light.shadow_soft_size**2 if light.shadow_soft_size > 0 else power / pi


def _point(
    lamp: bpy.types.Object, light: bpy.types.Light, power: Float64, matrix: Float64, group: int, warn: Warn
) -> Light:
    return PointLight(
        name=lamp.name,
        intensity=rgb(_sphere_intensity(light, power)),
        position=rgb(matrix[:3, 3]),
        radius=light.shadow_soft_size,
        soft_falloff=light.use_soft_falloff,
        shadow=light.use_shadow,
        group=group,
    )


def _spot(
    lamp: bpy.types.Object, light: bpy.types.Light, power: Float64, matrix: Float64, group: int, warn: Warn
) -> Light | None:
    axes = matrix[:3, :3].T * [[1], [1], [-1]]
    squared = (axes**2).sum(axis=1, keepdims=True)
    if not squared.all():
        warn("has a scale of zero and gives no light")
        return None
    x, y, z = (rgb(axis) for axis in axes / squared)
    return SpotLight(
        name=lamp.name,
        intensity=rgb(_sphere_intensity(light, power)),
        position=rgb(matrix[:3, 3]),
        axes=(x, y, z),
        angle=light.spot_size,
        blend=light.spot_blend,
        radius=light.shadow_soft_size,
        soft_falloff=light.use_soft_falloff,
        shadow=light.use_shadow,
        group=group,
    )


def _sun(
    lamp: bpy.types.Object, light: bpy.types.Light, power: Float64, matrix: Float64, group: int, warn: Warn
) -> Light | None:
    """Not normalised, the radiance is `power`, so the irradiance grows with the disc's projected solid angle."""
    direction = -matrix[:3, 2]
    length = np.linalg.norm(direction)
    if not length:
        warn("has a scale of zero and gives no light")
        return None
    if not getattr(light, "normalize", True) and light.angle > 0:
        power = power * pi * sin(light.angle / 2) ** 2
    return SunLight(
        name=lamp.name,
        irradiance=rgb(power),
        direction=rgb(direction / length),
        angle=light.angle,
        shadow=light.use_shadow,
        group=group,
    )


def _area(
    lamp: bpy.types.Object, light: bpy.types.Light, power: Float64, matrix: Float64, group: int, warn: Warn
) -> Light | None:
    """Radiance P / (pi A), A the lamp's area with its object's scale; P / pi when not normalised."""
    ellipse = light.shape in ("DISK", "ELLIPSE")
    height = light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
    edge_u, edge_v = matrix[:3, 0] * light.size, matrix[:3, 1] * height
    direction = -matrix[:3, 2]
    length = np.linalg.norm(direction)
    area = float(np.linalg.norm(edge_u) * np.linalg.norm(edge_v)) * (pi / 4 if ellipse else 1)
    if not area or not length:
        warn("has no area and gives no light")
        return None
    normalize = getattr(light, "normalize", True)
    return AreaLight(
        name=lamp.name,
        radiance=rgb(power / pi / (area if normalize else 1) * spread_gain(light.spread)),
        position=rgb(matrix[:3, 3]),
        edge_u=rgb(edge_u),
        edge_v=rgb(edge_v),
        direction=rgb(direction / length),
        ellipse=ellipse,
        spread=light.spread,
        shadow=light.use_shadow,
        group=group,
    )


def spread_gain(spread: float) -> float:
    """How much brighter on its axis a lamp gets by a narrower spread (radians), as Cycles keeps its power."""
    half = max(spread / 2, 1e-3)
    if half > 1.57:  # the tangent of a right angle
        return 1.0
    if half < 0.05:  # tan(x) - x by its series, where it cancels
        return 3 * tan(half) / half**3
    return tan(half) / (tan(half) - half)


READERS: dict[str, Callable[..., Light | None]] = {"POINT": _point, "SPOT": _spot, "SUN": _sun, "AREA": _area}
