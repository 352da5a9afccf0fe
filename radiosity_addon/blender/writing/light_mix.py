# SPDX-License-Identifier: GPL-3.0-or-later
"""Light groups mixed anew after a bake: each dimmed and tinted, without tracing a ray.

Light adds up, so a page is the sum of the pages of its light groups, each times a colour. Node groups compute that sum;
drivers hand them the colours from `scene.radiosity_mix`, where sliders set them: the 3D view follows at once, in any
engine, and the colours can be animated.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import bpy

from ...pages.page_format import Recipe
from ...scene import RGB
from ..data.names import BAKE_KEY
from ..looks.node_arithmetic import BLACK, WHITE, Arithmetic, Color
from .page_images import light_of, load_page

MOST_GROUPS = 12
"""Light groups that can be mixed: each is a texture more, and graphics cards give a material 16 to 32."""

Sliders: TypeAlias = dict[str, tuple[float, RGB]]
"""By name of the light group, its strength and tint."""


class LightMix:
    """The node groups that mix the light groups of one bake."""

    def __init__(self, token: str, groups: Mapping[str, Sequence[bpy.types.Image]]) -> None:
        """Args:
        token: the bake's, which every node group gets
        groups: by name of the light group, its image of each page
        """
        self.token = token
        self.groups = groups
        self._pages: dict[int, bpy.types.NodeTree] = {}
        self._colors: bpy.types.NodeTree | None = None

    def light(self, tree: Arithmetic, page: int, where: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """The light that a page holds where a uv says, all groups mixed."""
        if page not in self._pages:
            self._pages[page] = self._page(page)
        node = tree.node("ShaderNodeGroup")
        node.node_tree = self._pages[page]
        tree.tree.links.new(where, node.inputs["Vector"])
        return node.outputs["Light"]

    def color(self, tree: Arithmetic, group: str) -> Color:
        """What the light of a group is multiplied with; that of one without any light can't be set."""
        if group not in self.groups:
            return WHITE
        if self._colors is None:
            self._colors = self._all_colors()
        node = tree.node("ShaderNodeGroup")
        node.node_tree = self._colors
        color: bpy.types.NodeSocket = node.outputs[list(self.groups).index(group)]
        return color

    @property
    def images(self) -> list[bpy.types.Image]:
        """Of all groups and pages."""
        return [image for own in self.groups.values() for image in own]

    def connect(self, scene: bpy.types.Scene, before: Sliders) -> None:
        """Let sliders of the scene set the colours; those of groups that had one before keep what was set."""
        scene.radiosity_mix.clear()
        for index, name in enumerate(self.groups):
            slider = scene.radiosity_mix.add()
            slider.name = name
            slider.strength, slider.color = before.get(name, (1.0, WHITE))
            if self._colors is not None:
                for channel, target in enumerate(self._colors.nodes[str(index)].inputs):
                    _drive(target, scene, f"radiosity_mix[{index}]", channel)

    def _new_tree(self, name: str) -> bpy.types.NodeTree:
        tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
        tree[BAKE_KEY] = self.token
        return tree

    def _all_colors(self) -> bpy.types.NodeTree:
        """A node group whose outputs are the colours of the light groups, white until they are connected."""
        tree = self._new_tree("Radiosity Light Groups")
        for name in self.groups:
            tree.interface.new_socket(name or "No Group", in_out="OUTPUT", socket_type="NodeSocketVector")
        end = tree.nodes.new("NodeGroupOutput")
        for index in range(len(self.groups)):
            node = Arithmetic(tree).node("ShaderNodeCombineXYZ")
            node.name = str(index)
            for channel in node.inputs:
                channel.default_value = 1.0
            tree.links.new(node.outputs[0], end.inputs[index])
        return tree

    def _page(self, page: int) -> bpy.types.NodeTree:
        """A node group that adds up the light groups of a page."""
        tree = self._new_tree(f"Radiosity Light {page + 1}")
        tree.interface.new_socket("Vector", in_out="INPUT", socket_type="NodeSocketVector")
        tree.interface.new_socket("Light", in_out="OUTPUT", socket_type="NodeSocketColor")
        start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
        sums = Arithmetic(tree)
        total: Color = BLACK
        for name, images in self.groups.items():
            texture = sums.node("ShaderNodeTexImage")
            texture.image, texture.extension = images[page], "EXTEND"
            tree.links.new(start.outputs["Vector"], texture.inputs["Vector"])
            light = light_of(tree, texture, self.token)
            total = sums.add(total, sums.multiply(light, self.color(sums, name)))
        sums.feed(total, end.inputs["Light"])
        return tree


def load_mix(
    apart: Mapping[str, tuple[Sequence[Path], Recipe]], token: str, *, pack: bool
) -> Generator[None, None, LightMix | None]:
    """Load the pages of light groups, in steps; None where there are more than can be mixed.

    Args:
        apart: by name of the light group, the file of each page and how to read them
        token, pack: as of load_page

    Raises:
        OutputError: a page can't be read
    """
    if len(apart) > MOST_GROUPS:
        return None
    groups: dict[str, list[bpy.types.Image]] = {}
    for name, (paths, recipe) in apart.items():
        groups[name] = []
        for page, path in enumerate(paths):
            groups[name].append(load_page(path, page, token, recipe, pack=pack, group=name))
            yield
    return LightMix(token, groups)


def sliders_of(scene: bpy.types.Scene) -> Sliders:
    """How the light groups of a scene are mixed."""
    return {each.name: (each.strength, tuple(each.color)) for each in scene.radiosity_mix}


def mixed_colors(scene: bpy.types.Scene) -> dict[str, RGB]:
    """What the light of each group is multiplied with, in the working space; empty where no slider was moved."""
    colors = {
        name: (strength * red, strength * green, strength * blue)
        for name, (strength, (red, green, blue)) in sliders_of(scene).items()
    }
    return colors if any(color != WHITE for color in colors.values()) else {}


def _drive(target: bpy.types.NodeSocket, scene: bpy.types.Scene, slider: str, channel: int) -> None:
    """One channel: strength times tint, in a form that Blender computes without running a script."""
    driver = target.driver_add("default_value").driver
    driver.type, driver.expression = "SCRIPTED", "strength * tint"
    for name, path in (("strength", f"{slider}.strength"), ("tint", f"{slider}.color[{channel}]")):
        variable = driver.variables.new()
        variable.name, variable.type = name, "SINGLE_PROP"
        variable.targets[0].id_type, variable.targets[0].id = "SCENE", scene
        variable.targets[0].data_path = path
