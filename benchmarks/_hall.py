# SPDX-License-Identifier: GPL-3.0-or-later
"""A hall with sixteen balls, any number of triangles and lamps, as records of the core, without Blender."""

from __future__ import annotations

import math

import numpy as np

from radiosity_addon.bake import Baked
from radiosity_addon.geometry.surfaces import flatten
from radiosity_addon.geometry.visibility import Visibility
from radiosity_addon.scene import AreaLight, Light, Material, Mesh, PointLight, Scene
from tests.shapes import mesh_of, quad

WIDTH, HEIGHT = 12.0, 4.0
BALLS, RADIUS = 16, 0.9
POWER = 600.0
"""Of all lamps together, W."""
POLE = 0.02
"""Polar angle at which balls are cut off, so that no triangle is without area."""
FLOOR = 1
"""Its index among the meshes."""
PROBES, SUBS = 300, 4
"""Texels of the floor that are looked at, and points along the edge of each."""
LIFT = 1e-4
"""Of those points above the floor, m."""


def ball(name: str, centre: np.ndarray, radius: float, count: int, flat_known: bool = True) -> Mesh:
    """A smooth ball of some `count` triangles, laid flat by longitude and latitude unless that is left to the bake."""
    rings = max(4, round(math.sqrt(count / 4)))
    turns = 2 * rings
    tilt = np.linspace(POLE, np.pi - POLE, rings + 1)[:, None]
    turn = np.linspace(0, 2 * np.pi, turns + 1)[None]
    normals = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt) + 0 * turn], axis=2)
    down, along = (part.ravel() for part in np.meshgrid(np.arange(rings), np.arange(turns), indexing="ij"))

    def corner(row: np.ndarray, column: np.ndarray) -> np.ndarray:
        return row * turns + column % turns

    quads = np.stack(
        [corner(down, along), corner(down + 1, along), corner(down + 1, along + 1), corner(down, along + 1)], axis=1
    )
    u, v = along[:, None] + np.array([0, 0, 1, 1]), down[:, None] + np.array([0, 1, 1, 0])
    flat = np.stack([1 - u / turns, v / rings], axis=2)
    halves = [[0, 1, 2], [0, 2, 3]]
    triangles = quads[:, halves].reshape(-1, 3).astype(np.int32)
    unit = normals[:, :-1].reshape(-1, 3)
    return Mesh(
        name,
        centre + radius * unit,
        triangles,
        unit[triangles].astype(np.float32),
        np.ones(len(triangles), np.int32),
        np.repeat(np.arange(len(quads), dtype=np.int32), 2),
        (4 * np.arange(len(quads))[:, None, None] + np.array(halves)).reshape(-1, 3).astype(np.int32),
        uv=flat[:, halves].reshape(-1, 3, 2).astype(np.float32) if flat_known else None,
    )


def hall(triangles: int, lamps: int, balls: int = BALLS) -> Scene:
    """Walls, a floor, balls above it that share the triangles, and so many points as lamps, or four panels for 0.

    More balls than usual, a square number, are smaller, and xatlas has to lay them flat, as the things of a level.
    """
    x, y, z = (WIDTH, 0, 0), (0, WIDTH, 0), (0, 0, HEIGHT)
    walls = [
        quad((0, 0, HEIGHT), y, x),
        quad((0, 0, 0), y, z),
        quad((WIDTH, 0, 0), z, y),
        quad((0, 0, 0), z, x),
        quad((0, WIDTH, 0), x, z),
    ]
    meshes = [mesh_of("Walls", walls, [0] * 5), mesh_of("Floor", [quad((0, 0, 0), x, y)], [0])]
    across = math.isqrt(balls)
    radius = RADIUS * math.sqrt(BALLS / balls)
    for number in range(balls):
        row, column = divmod(number, across)
        place = ((column + 0.5) * WIDTH / across, (row + 0.5) * WIDTH / across, 1.1 + 0.2 * (number % 3))
        meshes.append(ball(f"Ball {number}", np.array(place), radius, triangles // balls, balls == BALLS))
    materials = (Material("Lime", (0.7, 0.66, 0.6)), Material("Blue", (0.2, 0.35, 0.6)))
    return Scene(tuple(meshes), materials, points_of_light(lamps) if lamps else panels())


def panels() -> tuple[Light, ...]:
    """Four square lamps."""
    edge = 1.0
    radiance = POWER / 4 / (math.pi * edge**2)
    return tuple(
        AreaLight(f"Panel {x} {y}", (radiance,) * 3, (x, y, HEIGHT - 0.02), (edge, 0, 0), (0, edge, 0), (0, 0, -1))
        for x in (WIDTH / 4, 3 * WIDTH / 4)
        for y in (WIDTH / 4, 3 * WIDTH / 4)
    )


def points_of_light(count: int) -> tuple[Light, ...]:
    """Points spread evenly (R2 sequence, Roberts 2018) between balls and ceiling, of one power together."""
    index = np.arange(count)
    x, y = (WIDTH * ((0.5 + index * step) % 1) for step in (0.7548776662466927, 0.5698402909980532))
    z = 2.8 + 1.1 * ((0.5 + index * 0.6180339887498949) % 1)
    intensity = POWER / count / (4 * math.pi)
    return tuple(
        PointLight(f"Point {k}", (intensity,) * 3, (float(x[k]), float(y[k]), float(z[k]))) for k in range(count)
    )


def direct_error(scene: Scene, baked: Baked) -> float:
    """Root mean square error of direct light on the floor, as a share of its mean; lamps are points."""
    size = baked.atlas.size
    uv = baked.atlas.uv[FLOOR].astype(np.float64)
    corners = scene.meshes[FLOOR].vertices[scene.meshes[FLOOR].triangles]
    rows = np.concatenate([uv[0], np.ones((3, 1))], axis=1)
    to_space = np.linalg.solve(rows, corners[0])  # the floor's map is affine
    low, high = uv.reshape(-1, 2).min(axis=0) * size, uv.reshape(-1, 2).max(axis=0) * size
    index = np.arange(PROBES)
    shares = np.stack([(0.5 + index * step) % 1 for step in (0.7548776662466927, 0.5698402909980532)], axis=1)
    texel = np.floor(np.ceil(low) + shares * (np.floor(high) - np.ceil(low) - 1)).astype(int)
    steps = (np.arange(SUBS) + 0.5) / SUBS
    grid = np.stack(np.meshgrid(steps, steps), axis=2).reshape(-1, 2)
    inside = ((texel[:, None] + grid) / size).reshape(-1, 2)
    points = np.concatenate([inside, np.ones((len(inside), 1))], axis=1) @ to_space
    points[:, 2] = LIFT
    visibility = Visibility(flatten(scene).corners + flatten(scene).origin.astype(np.float32))
    exact = np.zeros(len(points))
    for light in scene.lights:
        assert isinstance(light, PointLight)
        way = np.array(light.position) - points
        squared = (way**2).sum(axis=1)
        clear = ~visibility.occluded(points.astype(np.float32), way.astype(np.float32))
        exact += clear * light.intensity[0] * way[:, 2] / squared**1.5 / math.pi
    exact = exact.reshape(PROBES, -1).mean(axis=1)
    found = baked.pages[int(baked.atlas.page[FLOOR])][texel[:, 1], texel[:, 0], 0]
    return float(np.sqrt(np.mean((found - exact) ** 2)) / exact.mean())
