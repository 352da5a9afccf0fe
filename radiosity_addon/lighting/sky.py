# SPDX-License-Identifier: GPL-3.0-or-later
"""The sky: its small bright pieces become lamps, the rest a map of cells that rays read where they leave the scene.

Light is split by brightness, not by place: what exceeds a threshold goes to the lamps, what lies below it to the
cells, so that nothing counts twice and the two always add up to the picture.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..arrays import Float32, Float64, Int32, Int64
from ..scene import SkyTile, SunLight, World

EDGE = 96
"""Cells along an edge of each hemisphere's map: 18,432 in all, 1.5 degrees wide."""

CELLS = 2 * EDGE * EDGE

BRIGHT = 4.0
"""What shines brighter than the mean of the rest by this factor is for lamps."""

SETTLING = 12
"""Rounds in which that mean settles."""

CONTRAST = 8.0
"""Brightness is sliced by this factor: a sun stays apart from the glow around it."""

SLICES = 12
"""Slices at most: the last one takes all that is left."""

MOST_LAMPS = 24

COMPACT = math.sin(math.radians(3) / 2) ** 2
"""A piece is not split further whose light spreads by less, as 1 - |V| / flux: a disc of 3 degrees radius."""

WIDEST = math.sin(math.radians(20) / 2) ** 2
"""No lamp is wider: such pieces go back to the map."""

FAINTEST = 5e-3
"""Nor fainter than this share of the flux of the rest: such a piece is no brighter there than a few cells."""

SPLIT_SHARE = 1e-3
"""Nor is one whose spread matters less than this share of the flux of the rest: outdoors, lamps take most time."""

SAME_SIZE, SAME_PLACE = 1.6, 0.5
"""Pieces are one light if their radii are alike within this factor and their middles within this share of one."""

PLACES = 256
"""Steps along its longest axis at which a piece may be cut."""

FINENESS = math.radians(0.3)
"""Pixels wider than this are cut up before they are told to cells."""

BLOCK = 1 << 16
"""Parts of pixels told to cells at once."""


def cells(directions: Float32) -> Int32:
    """The cell (R,) that directions (R, 3), of any length, point to.

    Each hemisphere of the octahedron |x| + |y| + |z| = 1, seen along z, is a square cut into EDGE x EDGE cells
    (Cigolle et al. 2014, "A Survey of Efficient Representations for Independent Unit Vectors"). The horizon is its
    border, so no cell mixes sky and ground.
    """
    x, y, z = np.ascontiguousarray(directions.T)
    scale = np.abs(x)
    scale += np.abs(y)
    scale += np.abs(z)
    np.divide(np.float32(EDGE / 2), scale, out=scale)
    row, column = ((along * scale + np.float32(EDGE / 2)).astype(np.int32) for along in (x + y, x - y))
    np.clip(row, 0, EDGE - 1, out=row)
    np.clip(column, 0, EDGE - 1, out=column)
    row *= EDGE
    row += column
    row[z < 0] += EDGE * EDGE
    cell: Int32 = row
    return cell


@dataclass(frozen=True, eq=False)
class Sky:
    """The sky as a bake needs it.

    Attributes:
        suns: its bright pieces
        radiance: (CELLS, 3) float32, W/(m2 sr), mean of the rest over each cell
    """

    suns: tuple[SunLight, ...]
    radiance: Float32


def sky_of(world: World) -> Sky | None:
    """The world's sky; None if it is alike everywhere."""
    if not world.sky:
        return None
    tiles = [_Tile(tile, world.sky[1:] if index == 0 else ()) for index, tile in enumerate(world.sky)]
    threshold, rest = _threshold(tiles)
    pieces = _merged(_split(_merged(_slices(_Bright(tiles, threshold), threshold)), rest))
    pieces = [piece for piece in pieces if piece.flux > FAINTEST * rest and piece.spread < WIDEST]
    for piece in pieces:
        piece.take_from(tiles)
    return Sky(tuple(piece.sun(world.group) for piece in pieces), _cell_means(tiles))


class _Tile:
    """A tile's pixels: what light they hold, and how much of it is still there.

    Attributes:
        brightness: (H, W) float32, sum of the channels
        solid: (H, W) float64, sr, 0 where a finer tile lies
        left: (H, W) float64, share of the light that no lamp has taken
    """

    def __init__(self, tile: SkyTile, finer: tuple[SkyTile, ...]) -> None:
        height, width = tile.radiance.shape[:2]
        self.radiance = tile.radiance
        self.brightness: Float32 = tile.radiance.sum(2)
        self.latitude = np.linspace(tile.south, tile.north, height + 1)
        self.longitude = np.linspace(tile.west, tile.east, width + 1)
        self.solid: Float64 = np.diff(np.sin(self.latitude))[:, None] * np.diff(self.longitude)
        self.left = np.ones((height, width))
        middle_latitude, middle_longitude = (_middles(edges) for edges in (self.latitude, self.longitude))
        for other in finer:
            rows = (middle_latitude > other.south) & (middle_latitude < other.north)
            columns = (middle_longitude > other.west) & (middle_longitude < other.east)
            self.solid[np.ix_(rows, columns)] = 0

    def ways(self, row: Int64, column: Int64) -> Float64:
        """The integral (B, 3) of the unit vector over each pixel's solid angle, in closed form."""
        low, high, west, east = (
            edges[index + step] for edges, index in ((self.latitude, row), (self.longitude, column)) for step in (0, 1)
        )
        flat = (high - low) / 2 + (np.sin(2 * high) - np.sin(2 * low)) / 4
        up = (np.sin(high) ** 2 - np.sin(low) ** 2) / 2
        return np.stack(
            [flat * (np.sin(east) - np.sin(west)), flat * (np.cos(west) - np.cos(east)), up * (east - west)], axis=1
        )


def _middles(edges: Float64) -> Float64:
    middles: Float64 = (edges[1:] + edges[:-1]) / 2
    return middles


def _threshold(tiles: list[_Tile]) -> tuple[float, float]:
    """The brightness from which on light is for lamps, and the flux of what lies below it, W/m2."""
    threshold = math.inf
    for _ in range(SETTLING):
        rest = sum(float((np.minimum(tile.brightness, threshold) * tile.solid).sum()) for tile in tiles)
        threshold = BRIGHT * rest / (4 * math.pi)
    return threshold, rest


class _Bright:
    """The B pixels above a brightness.

    Attributes:
        tile, row, column: (B,) where each stands
        brightness: (B,) float64, sum of the channels
        flux: (B, 3) float64, radiance times solid angle, W/m2
        way: (B, 3) float64, brightness times the integral of the unit vector over the pixel
    """

    def __init__(self, tiles: list[_Tile], threshold: float) -> None:
        found = [np.nonzero((tile.brightness > threshold) & (tile.solid > 0)) for tile in tiles]
        self.tile = np.repeat(np.arange(len(tiles)), [len(row) for row, _ in found])
        self.row, self.column = (np.concatenate(parts) for parts in zip(*found, strict=True))
        pairs = list(zip(tiles, found, strict=True))
        self.brightness = np.concatenate([tile.brightness[at].astype(np.float64) for tile, at in pairs])
        self.flux = np.concatenate([tile.radiance[at] * tile.solid[at][:, None] for tile, at in pairs])
        self.way = np.concatenate([tile.ways(*at) for tile, at in pairs]) * self.brightness[:, None]


class _Piece:
    """Part of the light of some bright pixels, which becomes a lamp.

    Attributes:
        flux: of all channels, W/m2
        spread: 1 - |V| / flux, V the vector irradiance: the mean over the light of 1 - cos of the angle to its middle
    """

    def __init__(self, bright: _Bright, pixels: Int64, share: Float64) -> None:
        self.bright, self.pixels, self.share = bright, pixels, share
        self.colour: Float64 = share @ bright.flux[pixels]
        self.flux = float(self.colour.sum())
        self.vector: Float64 = share @ bright.way[pixels]
        self.spread = max(0.0, 1 - float(np.linalg.norm(self.vector)) / max(self.flux, 1e-300))

    @property
    def direction(self) -> Float64:
        """Towards its middle, unit."""
        direction: Float64 = self.vector / np.linalg.norm(self.vector)
        return direction

    @property
    def radius(self) -> float:
        """Half angle, radians, of the disc that has the piece's flux and its vector irradiance.

        A disc's are 2 pi (1 - cos) and pi sin^2 times its radiance, so |V| / flux = (1 + cos) / 2.
        """
        return 2 * math.asin(math.sqrt(min(self.spread, 0.5)))

    def halves(self) -> tuple[_Piece, _Piece] | None:
        """Cut across its longest axis where the halves are most compact; None if it is one pixel."""
        if len(self.pixels) < 2:
            return None
        ways = self.bright.way[self.pixels]
        weight = self.share * np.linalg.norm(ways, axis=1)
        places = ways / np.linalg.norm(ways, axis=1)[:, None] - self.direction
        axis = np.linalg.eigh(np.einsum("p,pi,pj->ij", weight, places, places))[1][:, 2]
        along = places @ axis
        low, high = along.min(), along.max()
        if high - low < 1e-12:
            return None
        step = np.minimum(((along - low) * (PLACES / (high - low))).astype(np.int64), PLACES - 1)
        light = np.cumsum(np.bincount(step, weights=weight, minlength=PLACES))[:-1]
        moment = np.cumsum(np.bincount(step, weights=weight * along, minlength=PLACES))[:-1]
        total, whole = weight.sum(), weight @ along
        # Otsu 1979, equation 18: the cut with the most variance between the classes
        between = (whole * light - total * moment) ** 2 / np.maximum(light * (total - light), 1e-300)
        first = step <= int(between.argmax())
        return tuple(_Piece(self.bright, self.pixels[part], self.share[part]) for part in (first, ~first))  # type: ignore[return-value]

    def with_piece(self, other: _Piece) -> _Piece:
        """Both as one."""
        return _Piece(
            self.bright,
            np.concatenate([self.pixels, other.pixels]),
            np.concatenate([self.share, other.share]),
        )

    def take_from(self, tiles: list[_Tile]) -> None:
        """Take the piece's light out of the pixels."""
        for index, tile in enumerate(tiles):
            own = self.bright.tile[self.pixels] == index
            pixels = self.pixels[own]
            np.subtract.at(tile.left, (self.bright.row[pixels], self.bright.column[pixels]), self.share[own])

    def sun(self, group: int) -> SunLight:
        """The lamp: a disc with the piece's direction, flux, colour and vector irradiance."""
        x, y, z = (float(-part) for part in self.direction)
        red, green, blue = (float(part) * (1 - self.spread) for part in self.colour)
        return SunLight("World", (red, green, blue), (x, y, z), 2 * self.radius, group=group)


def _slices(bright: _Bright, threshold: float) -> list[_Piece]:
    """The light above the threshold, cut by brightness from the top down."""
    pieces = []
    high = float(bright.brightness.max(initial=0))
    for number in range(SLICES):
        if high <= threshold:
            break
        low = max(high / CONTRAST, threshold) if number < SLICES - 1 else threshold
        pixels = np.flatnonzero(bright.brightness > low)
        own = bright.brightness[pixels]
        pieces.append(_Piece(bright, pixels, (np.minimum(own, high) - low) / own))
        high = low
    return pieces


def _split(pieces: list[_Piece], rest: float) -> list[_Piece]:
    """Cut the pieces up, the one first that misses most light by its spread, as far as there are lamps for it."""
    done: list[_Piece] = []
    queue = list(pieces)
    while queue and len(done) + len(queue) < MOST_LAMPS:
        worst = max(range(len(queue)), key=lambda index: queue[index].flux * queue[index].spread)
        piece = queue.pop(worst)
        compact = piece.spread < COMPACT or piece.flux * piece.spread < SPLIT_SHARE * rest
        halves = None if compact else piece.halves()
        if halves is None:
            done.append(piece)
        else:
            queue.extend(halves)
    return done + queue


def _merged(pieces: list[_Piece]) -> list[_Piece]:
    """Pieces of one place and size, slices of one light, as one; the strongest first."""
    merged: list[_Piece] = []
    for piece in sorted(pieces, key=lambda piece: -piece.flux):
        for index, other in enumerate(merged):
            small, large = sorted((piece.radius, other.radius))
            gap = float(np.linalg.norm(piece.direction - other.direction))
            if large < SAME_SIZE * small and gap < SAME_PLACE * small:
                merged[index] = other.with_piece(piece)
                break
        else:
            merged.append(piece)
    return sorted(merged, key=lambda piece: -piece.flux)


def _cell_means(tiles: list[_Tile]) -> Float32:
    """Mean radiance (CELLS, 3) float32 of what is left in the pixels."""
    light = np.zeros((CELLS, 3))
    solid = np.zeros(CELLS)
    for tile in tiles:
        for cell, share, radiance in _parts(tile):
            solid += np.bincount(cell, weights=share, minlength=CELLS)
            for channel in range(3):
                light[:, channel] += np.bincount(cell, weights=radiance[:, channel] * share, minlength=CELLS)
    return (light / np.maximum(solid, 1e-30)[:, None]).astype(np.float32)


def _parts(tile: _Tile) -> Iterator[tuple[Int32, Float64, Float64]]:
    """Cell (P,), solid angle (P,) and radiance (P, 3) of the tile's pixels, wide ones in parts, some rows at a time."""
    height, width = tile.solid.shape
    cut = [max(1, math.ceil(float(edges[1] - edges[0]) / FINENESS)) for edges in (tile.latitude, tile.longitude)]
    sine = np.sin(np.linspace(tile.latitude[0], tile.latitude[-1], height * cut[0] + 1))
    share = np.diff(sine) / np.repeat(np.diff(sine[:: cut[0]]), cut[0]) / cut[1]
    longitude = _middles(np.linspace(tile.longitude[0], tile.longitude[-1], width * cut[1] + 1))
    east, north = np.cos(longitude), np.sin(longitude)
    column = np.repeat(np.arange(width), cut[1])
    rows = max(1, BLOCK // len(column))
    for start in range(0, height * cut[0], rows):
        part = np.arange(start, min(start + rows, height * cut[0]))
        z = _middles(sine)[part]
        flat = np.sqrt(np.maximum(1 - z * z, 0))
        way = np.stack(np.broadcast_arrays(flat[:, None] * east, flat[:, None] * north, z[:, None]), axis=2)
        at = (part // cut[0])[:, None], column[None]
        solid = (tile.solid[at] * share[part, None]).reshape(-1)
        radiance = (tile.radiance[at] * tile.left[at][:, :, None]).reshape(-1, 3)
        yield cells(way.reshape(-1, 3).astype(np.float32)), solid, radiance
