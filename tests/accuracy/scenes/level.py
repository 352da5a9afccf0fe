# SPDX-License-Identifier: GPL-3.0-or-later
"""A game's level: nine rooms and two corridors with pillars, crates, pipes, lamps of all kinds and skylights."""

from __future__ import annotations

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "sample_scenes"))
import bpy
from building import (
    RGB,
    box,
    diffuse,
    empty_scene,
    lathe,
    lattice,
    material,
    mesh_object,
    put,
    sky,
    smooth,
    write_when_run,
)
from parts import finish, placed_copy, sheet, sun

ROOM, CORRIDOR, WALL, HEIGHT = 6.0, 2.4, 0.3, 3.2
DOOR, DOOR_HEIGHT, SKYLIGHT = 1.6, 2.3, 2.0
COLUMNS = 3
BANDS = (ROOM, CORRIDOR, ROOM, CORRIDOR, ROOM)
"""Depths of rows of rooms and of the corridors between them, m."""
SINK = 0.004
WIDTH = COLUMNS * (ROOM + WALL) - WALL


def band_start(band: int) -> float:
    """y at which a band begins, m."""
    return sum(BANDS[:band]) + band * WALL


def room_middle(column: int) -> float:
    """x of the middle of a column of rooms, m."""
    return column * (ROOM + WALL) + ROOM / 2


DEPTH = band_start(len(BANDS)) - WALL


def wall(name: str, lines: list[float], gaps: set[int], paint: bpy.types.Material, place: tuple, turn: int) -> None:
    """A wall from `lines` in x, with doors between those lines whose number is in `gaps`."""
    shape = lattice(
        lines, [-SINK, DOOR_HEIGHT, HEIGHT + SINK], WALL, lambda column, row: row == 1 or column not in gaps
    )
    mesh_object(name, *shape, paint, place, rotation_euler=(0, 0, math.radians(turn)))


def walls(paints: list[bpy.types.Material]) -> None:
    """Long walls between the bands, their ends at the outside, and short ones across each band."""
    doors = [side for column in range(COLUMNS) for side in (-DOOR / 2, DOOR / 2)]
    middles = [room_middle(column) for column in range(COLUMNS) for _ in range(2)]
    lines = [-WALL, *(middle + side for middle, side in zip(middles, doors, strict=True)), WIDTH + WALL]
    for number in range(len(BANDS) + 1):
        inner = 0 < number < len(BANDS)
        gaps = set(range(1, 2 * COLUMNS, 2)) if inner else set()
        wall(f"Long Wall {number}", lines, gaps, paints[number % 3], (0, band_start(number) - WALL, 0), 0)
    for band, depth in enumerate(BANDS):
        for number in range(COLUMNS + 1) if depth == ROOM else (0, COLUMNS):
            door = {1} if 0 < number < COLUMNS and (band + number) % 2 else set()
            across = [-SINK, depth / 2 - DOOR / 2, depth / 2 + DOOR / 2, depth + SINK]
            place = (number * (ROOM + WALL), band_start(band), 0)
            wall(f"Cross Wall {band} {number}", across, door, paints[(band + number) % 3], place, 90)


def floors_and_ceilings(stone: bpy.types.Material, plaster: bpy.types.Material) -> None:
    """A sheet and a slab for each band; some rooms and both corridors have skylights."""
    for band, depth in enumerate(BANDS):
        low, high = band_start(band) - WALL / 2, band_start(band) + depth + WALL / 2
        sheet(
            f"Floor {band}", [(-WALL, low, 0), (WIDTH + WALL, low, 0), (WIDTH + WALL, high, 0), (-WALL, high, 0)], stone
        )
        lit = [column for column in range(COLUMNS) if (column + band) % 2 == 0]
        middles = [room_middle(column) for column in lit]
        xs = [-WALL, *(middle + side for middle in middles for side in (-SKYLIGHT / 2, SKYLIGHT / 2)), WIDTH + WALL]
        opening = min(SKYLIGHT, depth / 2) / 2
        ys = [low, band_start(band) + depth / 2 - opening, band_start(band) + depth / 2 + opening, high]
        shape = lattice(xs, ys, 0.25, lambda column, row: row != 1 or column % 2 == 0)
        mesh_object(f"Ceiling {band}", *shape, plaster, (0, 0, HEIGHT + 0.25), rotation_euler=(-math.pi / 2, 0, 0))


def furniture(stone: bpy.types.Material, wood: bpy.types.Material, iron: bpy.types.Material) -> None:
    """Pillars, crates, urns and pipes, all copies of few meshes."""
    shaft = [(0.3 - 0.08 * math.sin(math.pi * k / 24), HEIGHT * k / 24) for k in range(1, 24)]
    profile = [(0, -SINK), (0.3, -SINK), *shaft, (0.3, HEIGHT + SINK), (0, HEIGHT + SINK)]
    belly = [(0.15 + 0.25 * math.sin(math.pi * k / 20), 0.9 * k / 20) for k in range(1, 20)]
    urn = [(0, -SINK), (0.15, -SINK), *belly, (0.15, 0.9), (0, 0.9)]
    pillar = smooth(mesh_object("Pillar", *lathe(profile, 40), stone, (1.3, 1.3, 0)))
    pot = smooth(mesh_object("Urn", *lathe(urn, 40), wood, (3.0, 5.2, 0)))
    crate = box("Crate", (0.8, 0.8, 0.8), wood, (5.5, 0.5, -SINK))
    pillars = urns = crates = 0
    for band in (0, 2, 4):
        for column in range(COLUMNS):
            x, y = column * (ROOM + WALL), band_start(band)
            corners = [(1.3, 1.3), (4.7, 1.3), (1.3, 4.7), (4.7, 4.7)] if (column + band // 2) % 2 == 0 else []
            for u, v in corners[1 if band == column == 0 else 0 :]:
                pillars += 1
                placed_copy(pillar, f"Pillar {pillars}", (x + u, y + v, 0))
            if band or column:
                urns += 1
                placed_copy(pot, f"Urn {urns}", (x + 3.0, y + 5.2 - 4.4 * ((column + band) % 3 == 1), 0))
            for k in range(2 + column % 3):
                crates += 1
                turn = 17.0 * crates % 90
                placed_copy(crate, f"Crate {crates}", (x + 5.25 - 0.95 * (k % 3), y + 2.2 + 0.2 * k, -SINK), turn)
    tube = [(0, 0), (0.1, 0), *((0.1, WIDTH * k / 24) for k in range(1, 24)), (0.1, WIDTH), (0, WIDTH)]
    for band in (1, 3):
        for k in range(3):
            place = (0, band_start(band) + 0.5 + 0.35 * k, 2.75)
            pipe = mesh_object(f"Pipe {band} {k}", *lathe(tube, 16), iron, place, rotation_euler=(0, math.pi / 2, 0))
            smooth(pipe)


def lamps() -> None:
    """A panel in each dark room, spots in the corridors, bulbs, and signs that glow."""
    colors: list[RGB] = [(1.0, 0.82, 0.6), (0.75, 0.87, 1.0), (1.0, 0.93, 0.82)]
    for band in (0, 2, 4):
        for column in range(COLUMNS):
            middle = room_middle(column), band_start(band) + ROOM / 2
            if (column + band) % 2:
                panel = bpy.data.lights.new(f"Panel {band} {column}", "AREA")
                panel.shape, panel.size, panel.size_y, panel.energy = "RECTANGLE", 1.4, 0.5, 110.0
                panel.color = colors[(column + band) % 3]
                put(panel.name, panel, (*middle, HEIGHT - 0.02))
            else:
                bulb = bpy.data.lights.new(f"Bulb {band} {column}", "POINT")
                bulb.energy, bulb.shadow_soft_size, bulb.color = 40.0, 0.2, colors[column % 3]
                put(bulb.name, bulb, (middle[0] - 2.2, middle[1] + 0.4, 2.2))
    for band in (1, 3):
        for column in range(COLUMNS + 1):
            spot = bpy.data.lights.new(f"Spot {band} {column}", "SPOT")
            spot.energy, spot.spot_size, spot.spot_blend = 120.0, math.radians(85), 0.4
            spot.shadow_soft_size, spot.color = 0.15, colors[(band + column) % 3]
            x = min(max(column * (ROOM + WALL), 0.4), WIDTH - 0.4)
            put(spot.name, spot, (x, band_start(band) + CORRIDOR / 2, HEIGHT - 0.2))
        glow = material(f"Sign {band}", "ShaderNodeEmission", Color=(0.2, 1.0, 0.5), Strength=6.0)
        y = band_start(band)
        corners = [(WIDTH - 0.02, y + x, z) for x, z in ((1.7, 2.2), (0.7, 2.2), (0.7, 2.5), (1.7, 2.5))]
        sheet(f"Sign {band}", corners, glow)


def build() -> object:
    """Make the scene in Blender."""
    scene = empty_scene()
    sky(scene, (0.55, 0.7, 1.0), 1.6)
    sun(scene, 1.0, 32, 25, (1.0, 0.93, 0.82), 4.0)
    paints = [
        diffuse("Brick", (0.46, 0.3, 0.23)),
        diffuse("Lime", (0.72, 0.69, 0.62)),
        diffuse("Teal", (0.3, 0.43, 0.42)),
    ]
    stone = diffuse("Stone", (0.5, 0.48, 0.45))
    walls(paints)
    floors_and_ceilings(stone, diffuse("Plaster", (0.78, 0.77, 0.74)))
    furniture(
        diffuse("Marble", (0.7, 0.68, 0.66)), diffuse("Wood", (0.42, 0.27, 0.15)), diffuse("Iron", (0.3, 0.3, 0.32))
    )
    lamps()
    return finish(scene, (0.8, band_start(1) + CORRIDOR / 2, 1.6), 0, -90, 18.0, 1.0)


if __name__ == "__main__":
    write_when_run(build, __file__)
