# SPDX-License-Identifier: GPL-3.0-or-later
"""The lamps, the world and the light groups of a scene as records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import bpy
import numpy as np

from ...arrays import Float64
from ...radiosity.bounces import ENDLESS
from ...scene import Light, World
from ..looks.closures import rgb
from ..looks.nodes import LinkCycle
from .cycles import Cycles
from .extraction import Notes
from .lamp_distributions import LampToMeasure, Measured, measure_lamp, placed
from .lamps import is_shaped, read_lamp
from .light_linking import Name, lit_by
from .subject import Subject, named
from .world import HEIGHT, read_world, render_sky


class LightRecords:
    """Light that was read so far.

    Attributes:
        groups: light groups: name, and most bounces of its light if they are limited
        lamps: as the core takes them
        linked: by the index of a lamp that is linked to a collection, whom it lights
        world: as the core takes it
    """

    def __init__(self, depsgraph: bpy.types.Depsgraph, notes: Notes) -> None:
        self._depsgraph = depsgraph
        self._layer = depsgraph.view_layer
        self._notes = notes
        self._to_render = ""
        self._to_measure: dict[int, tuple[str, LampToMeasure]] = {}
        self.groups: list[tuple[str, int | None]] = [("", None)]
        self.lamps: list[Light] = []
        self.linked: dict[int, Callable[[Name], bool]] = {}
        self.world = World()

    @property
    def dark(self) -> bool:
        """Whether there is no light at all."""
        return not (self.lamps or any(self.world.radiance) or self.world.sky)

    def read_lamp(self, lamp: bpy.types.Object, matrix: Float64) -> None:
        """Take in a lamp, unless it gives no light."""
        hears = self._notes.hears(f"Lamp {lamp.name!r}")
        try:
            light = read_lamp(lamp, matrix, self.group(lamp.lightgroup, lamp.data), hears)
        except LinkCycle:
            hears("has a node tree that feeds back into itself, and gives no light")
            return
        if light is not None:
            if is_shaped(lamp.data):
                self._to_measure[len(self.lamps)] = lamp.data.original.name_full, LampToMeasure.of(lamp.data, matrix)
            linked = lamp.original.light_linking.receiver_collection
            if linked is not None:
                self.linked[len(self.lamps)] = lit_by(linked)
            self.lamps.append(light)

    def read_world(self) -> None:
        """Take in the world, but for one that has to be rendered to be known."""
        world = getattr(self._layer, "world_override", None) or self._depsgraph.scene_eval.world
        if world is None:
            return
        hears, group = self._notes.hears(f"World {world.name!r}"), self.group(world.lightgroup, world)
        try:
            found = read_world(world, group, hears)
        except LinkCycle:
            hears("has a node tree that feeds back into itself, and gives no light")
            return
        if found is None:
            self.world, self._to_render = World(group=group), world.original.name_full
        else:
            self.world = found

    @property
    def unclear(self) -> bool:
        """Whether there is a world or a lamp that no reading of nodes could tell."""
        return bool(self._to_render or self._to_measure)

    def measure_lamps(self, scene_name: str, cycles: Cycles) -> None:
        """Look at lamps that no reading of nodes could tell; no render may be under way."""
        known: dict[tuple[object, ...], Measured] = {}
        for index, (name, lamp) in self._to_measure.items():

            def subject(name: str = name) -> Subject:
                light = named(bpy.data.lights, name, "Light")
                return Subject.of(named(bpy.data.scenes, scene_name, "Scene"), {"light": light})

            key = (name, *lamp.key)
            if key not in known:
                known[key] = cycles.ask(subject, measure_lamp, lamp)
            factor, distribution, said = known[key]
            light = self.lamps[index]
            for text in said:
                self._notes.warn(f"Lamp {light.name!r}: {text}")
            intensity = rgb(np.array(light.intensity) * factor)
            if distribution is not None:
                distribution = placed(distribution, lamp.frame)
            self.lamps[index] = replace(light, intensity=intensity, distribution=distribution)

    def render_world(self, scene_name: str, cycles: Cycles) -> None:
        """Look at a world that no reading of nodes could tell; no render may be under way."""
        if not self._to_render:
            return

        def subject() -> Subject:
            world = named(bpy.data.worlds, self._to_render, "World")
            return Subject.of(named(bpy.data.scenes, scene_name, "Scene"), {"world": world})

        sky, said = cycles.ask(subject, render_sky, HEIGHT)
        for text in said:
            self._notes.warn(f"World {self._to_render!r}: {text}")
        self.world = replace(self.world, sky=sky)

    def group(self, name: str, light: bpy.types.Light | bpy.types.World | None = None) -> int:
        """Index of a light group; names that the view layer does not know are none.

        A `light` whose bounces are limited is one of a group that bounces as often.
        """
        limit = getattr(getattr(light, "cycles", None), "max_bounces", ENDLESS)
        wanted = (name if name in self._layer.lightgroups else "", limit if limit < ENDLESS else None)
        if wanted not in self.groups:
            self.groups.append(wanted)
        return self.groups.index(wanted)
