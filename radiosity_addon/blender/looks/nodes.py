# SPDX-License-Identifier: GPL-3.0-or-later
"""Node trees, and constants out of them: where a socket's link really comes from, and what value stands behind it."""

from __future__ import annotations

import operator
import warnings
from collections.abc import Callable, Mapping
from typing import TypeAlias

import bpy
import numpy as np

from ...arrays import Float64
from ...color.spaces import REC709
from ...microfacet import mean_fresnel
from ..data.working_space import blackbody_color, working_space

Groups: TypeAlias = tuple[bpy.types.ShaderNodeGroup, ...]
"""The group nodes that a socket is inside of, outermost first."""

MAX_STEPS = 1000
"""Links followed through reroutes and groups before it must be a cycle."""

MAX_IMAGE_TEXELS = 1 << 24
"""Larger images are not read for a mean."""

LIGHT_PATH = {"Is Diffuse Ray": 1.0, "Is Reflection Ray": 1.0}
"""What the rays of a bake are, by output of the Light Path node; all others are 0."""

SHADOW_PATH = {"Is Shadow Ray": 1.0}
"""The same of rays that ask how much light a surface lets through."""

ANY_PATH: dict[str, float] = {}
"""Stands for rays of which nothing is known: what depends on them or their direction is computed."""

BEHIND = {"Backfacing": 1.0}
"""Besides, of rays that meet a surface from behind: an output of the Geometry node."""

LEAST_IOR = 1e-5


SEE_ANGLES = ("FRESNEL", "LAYER_WEIGHT")
"""Types of nodes whose outputs depend on the direction from which a surface is seen."""

VOLUMES = (
    "PRINCIPLED_VOLUME", "VOLUME_SCATTER", "VOLUME_ABSORPTION", "VOLUME_COEFFICIENTS", "EMISSION", "MIX_SHADER",
    "ADD_SHADER",
)  # fmt: skip
"""Types of nodes that fill what a surface encloses, or mix what does."""


class LinkCycle(Exception):
    """A node tree feeds back into itself."""


def tree_of(owner: bpy.types.Material | bpy.types.World | bpy.types.Light) -> bpy.types.NodeTree | None:
    """The node tree in use."""
    with warnings.catch_warnings():
        # `use_nodes` goes away in Blender 6, where trees are always on
        warnings.simplefilter("ignore", DeprecationWarning)
        return owner.node_tree if getattr(owner, "use_nodes", True) else None


def follow(socket: bpy.types.NodeSocket, groups: Groups) -> tuple[bpy.types.NodeSocket, Groups]:
    """The output behind an input, through reroutes, groups and muted nodes; or the input that ends the way unlinked."""
    for _ in range(MAX_STEPS):
        link = next((link for link in socket.links if not link.is_muted), None)
        if link is None:
            return socket, groups
        output, node = link.from_socket, link.from_node
        if node.type == "REROUTE":
            onward = node.inputs[0]
        elif node.mute:
            passed = next((inner.from_socket for inner in node.internal_links if inner.to_socket == output), None)
            if passed is None:
                return socket, groups
            onward = passed
        elif node.type == "GROUP" and node.node_tree is not None:
            end = _group_output(node.node_tree)
            if end is None:
                return socket, groups
            onward, groups = _by_identifier(end.inputs, output), (*groups, node)
        elif node.type == "GROUP_INPUT" and groups:
            onward, groups = _by_identifier(groups[-1].inputs, output), groups[:-1]
        else:
            return output, groups
        if node.type == "REROUTE" and not onward.links:
            return socket, groups
        socket = onward
    raise LinkCycle


def is_only_volume(output: bpy.types.Node) -> bool:
    """Whether an output shows a volume and no surface: light then passes the faces as if they were not there."""
    if "Volume" not in output.inputs or follow(output.inputs["Surface"], ())[0].is_output:
        return False
    volume, _ = follow(output.inputs["Volume"], ())
    return volume.is_output and volume.node.type in VOLUMES


def _group_output(tree: bpy.types.NodeTree) -> bpy.types.Node | None:
    ends = [node for node in tree.nodes if node.type == "GROUP_OUTPUT"]
    return next((node for node in ends if node.is_active_output), ends[0] if ends else None)


def _by_identifier(sockets: bpy.types.bpy_prop_collection, like: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    return next(socket for socket in sockets if socket.identifier == like.identifier)


def known(socket: bpy.types.NodeSocket, groups: Groups, path: Mapping[str, float] = LIGHT_PATH) -> Float64 | None:
    """The constant that an input receives, (3,), numbers repeated; None where it is computed.

    Args:
        path: what the rays are, by output of the Light Path node and of the Geometry node
    """
    end, groups = follow(socket, groups)
    if not end.is_output or end.node.type in ("RGB", "VALUE"):
        return _default(end)
    if end.node.type == "LIGHT_FALLOFF":
        return _falloff(end, groups)
    if end.node.type == "BLACKBODY":
        kelvin = known(end.node.inputs["Temperature"], groups)
        return None if kelvin is None else blackbody_color(float(kelvin[0]))
    if path is ANY_PATH and end.node.type in (*SEE_ANGLES, "LIGHT_PATH", "NEW_GEOMETRY"):
        return None
    if end.node.type in SEE_ANGLES:
        return from_all_around(end, groups, "Backfacing" in path)
    if end.node.type == "MATH":
        return _computed(end.node, groups, path)
    asks_ray = end.node.type == "LIGHT_PATH" or (end.node.type, end.name) == ("NEW_GEOMETRY", "Backfacing")
    return np.full(3, path.get(end.name, 0.0)) if asks_ray else None


ARITHMETIC: dict[str, Callable[[float, float], float]] = {
    "ADD": operator.add,
    "SUBTRACT": operator.sub,
    "MULTIPLY": operator.mul,
    "MAXIMUM": max,
    "MINIMUM": min,
    "LESS_THAN": operator.lt,
    "GREATER_THAN": operator.gt,
}
"""What Math nodes make of two numbers, by operation."""


def _computed(node: bpy.types.Node, groups: Groups, path: Mapping[str, float]) -> Float64 | None:
    """What a Math node makes of constants, (3,)."""
    one, other = (known(socket, groups, path) for socket in list(node.inputs)[:2])
    if one is None or other is None or node.operation not in ARITHMETIC or np.ptp(one) or np.ptp(other):
        return None  # a colour would count by its luminance
    result = float(ARITHMETIC[node.operation](float(one[0]), float(other[0])))
    return np.full(3, min(max(result, 0.0), 1.0) if node.use_clamp else result)


def from_all_around(output: bpy.types.NodeSocket, groups: Groups = (), behind: bool = False) -> Float64 | None:
    """What a node that gives more or less by the angle at which it is seen gives to uniform light, on average.

    So much counts of it in light that falls on a surface, or leaves it, in all directions. From `behind` the surface
    seems to be that of the outside, seen from within.
    """
    asked = known(output.node.inputs["IOR" if output.node.type == "FRESNEL" else "Blend"], groups)
    if asked is None:
        return None
    value = float(asked[0])
    if output.node.type == "FRESNEL":
        ior = max(value, LEAST_IOR)
        return np.full(3, mean_fresnel(1 / ior if behind else ior))
    blend = min(max(value, 0.0), 1 - LEAST_IOR)
    if output.name == "Fresnel":
        return np.full(3, mean_fresnel(1 - blend if behind else 1 / (1 - blend)))
    exponent = 2 * blend if blend < 0.5 else 0.5 / (1 - blend)  # as in Cycles, svm/fresnel.h: 1 - cosine^exponent
    return np.full(3, exponent / (2 + exponent))


def _falloff(output: bpy.types.NodeSocket, groups: Groups) -> Float64 | None:
    """The strength of light that falls off by itself; other ways to fall off vary with the distance."""
    smooth = known(output.node.inputs["Smooth"], groups)
    if output.name != "Quadratic" or smooth is None or smooth.any():
        return None
    return known(output.node.inputs["Strength"], groups)


def likely(socket: bpy.types.NodeSocket, groups: Groups) -> Float64:
    """What an input receives about, (3,): of an image its mean, of what else is computed the input's own value."""
    constant = known(socket, groups)
    if constant is not None:
        return constant
    end, _ = follow(socket, groups)
    mean = image_mean(end.node.image) if end.node.type == "TEX_IMAGE" and end.name == "Color" else None
    return _default(socket) if mean is None else mean


def approximate(node: bpy.types.Node, name: str, groups: Groups, warn: Callable[[str], None]) -> Float64:
    """As `likely`, and says so."""
    taken = likely(node.inputs[name], groups)
    source = follow(node.inputs[name], groups)[0].node
    warn(f"{name} of {node.name} is driven by {source.bl_label}, which is not read; {_text(taken)} is taken")
    return taken


def image_mean(image: bpy.types.Image | None) -> Float64 | None:
    """Mean colour of an image, (3,) linear; None if it has no pixels or too many."""
    if image is None or not 0 < image.size[0] * image.size[1] <= MAX_IMAGE_TEXELS or not image.channels:
        return None
    pixels = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    rgb = pixels.reshape(-1, image.channels)[:, : min(image.channels, 3)]
    if not image.is_float and image.colorspace_settings.name == "sRGB":  # bytes are kept as encoded
        rgb = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        mean = rgb.mean(axis=0, dtype=np.float64)
        return REC709.to(working_space()) @ mean if len(mean) == 3 else np.full(3, mean[0])
    mean = rgb.mean(axis=0, dtype=np.float64)
    return mean if len(mean) == 3 else np.full(3, mean[0])


def _default(socket: bpy.types.NodeSocket) -> Float64:
    held = getattr(socket, "default_value", 0.0)
    return np.array(held[:3], np.float64) if hasattr(held, "__len__") else np.full(3, float(held))


def _text(rgb: Float64) -> str:
    return f"{rgb[0]:g}" if rgb[0] == rgb[1] == rgb[2] else "({:g}, {:g}, {:g})".format(*rgb)
