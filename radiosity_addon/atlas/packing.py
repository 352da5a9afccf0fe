# SPDX-License-Identifier: GPL-3.0-or-later
"""Packs charts on square pages.

Charts are placed one after the other, largest first, on a skyline of one height per texel column, each turned by the
quarter turn and at the column where its top ends lowest. Contours count, not bounding boxes, as in Levy et al. 2002,
"Least Squares Conformal Maps for Automatic Texture Atlas Generation", section 4. Swarms of tiny charts are first
joined to strips.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..arrays import Bools, Float32, Float64, Int64

COLUMN_STEPS = 512
"""A skyline is tried at this many columns at most, so that large pages stay fast."""

SINGLES = 300
"""The largest charts are placed one by one, the small ones among the others in strips."""

TINY, STRIP = 1 / 32, 1 / 8
"""Size of a small chart and length of a strip, as shares of the page."""

SAME = 0.25
"""Contours that differ by less than this, texels, are taken for the same."""

SCALE_STEP = 1.005
"""The search for the largest scale that fits stops at this ratio."""

WASTE = 1.0
"""How much the mean empty height under a chart counts against the height of its top; fills 2 % more than 0 does."""

ITEMS_A_YIELD = 16


Words: TypeAlias = NDArray[np.uint64]


@dataclass(frozen=True, eq=False)
class Items:
    """Things to be packed, each a rigid set of triangles.

    Attributes:
        points: (N, 3, 2) float64, triangles; the triangles of an item are neighbours
        first: (I + 1,) int64, where each item's triangles begin
        upright: (I,) bool, items that must not be turned; by default none
        low, extent: (I, 2) float64, lower corner and size of the box around each
        area: (I,) float64
        rim: (R,) int64, edges that can touch the contour, 3 triangle + corner
    """

    points: Float64
    first: Int64
    upright: Bools = field(default_factory=lambda: np.zeros(0, bool))
    low: Float64 = field(init=False)
    extent: Float64 = field(init=False)
    area: Float64 = field(init=False)
    rim: Int64 = field(init=False)

    def __post_init__(self) -> None:
        low = np.minimum.reduceat(self.points.min(axis=1), self.first[:-1])
        high = np.maximum.reduceat(self.points.max(axis=1), self.first[:-1])
        a, b = self.points[:, 1] - self.points[:, 0], self.points[:, 2] - self.points[:, 0]
        area = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
        if not len(self.upright):
            object.__setattr__(self, "upright", np.zeros(self.count, bool))
        object.__setattr__(self, "rim", _rim(self.points, self.index))
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "extent", high - low)
        object.__setattr__(self, "area", np.add.reduceat(area, self.first[:-1]))

    @property
    def count(self) -> int:
        return len(self.first) - 1

    @property
    def index(self) -> Int64:
        """(N,) item of each triangle."""
        return np.repeat(np.arange(self.count), np.diff(self.first))


def _rim(points: Float64, item: Int64) -> Int64:
    """Edges, 3 triangle + corner, that no two triangles of an item share bit by bit: no others touch a contour."""
    bits = (points + 0.0).view(np.uint64)  # + 0.0 makes -0.0 the same as 0.0
    corner = _mixed(_mixed(bits[..., 0]) + bits[..., 1])
    edge = _mixed((corner + np.roll(corner, -1, axis=1)).reshape(-1) + np.repeat(item, 3).astype(np.uint64))
    _, index, count = np.unique(edge, return_inverse=True, return_counts=True)
    return np.flatnonzero(count[index.reshape(-1)] == 1)


def _mixed(key: Words) -> Words:
    """Scrambles 64-bit words one to one (Steele et al. 2014, SplitMix64)."""
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(key ^ (key >> np.uint64(31)))


@dataclass(frozen=True, eq=False)
class Placement:
    """Where items lie on a page.

    Attributes:
        scale: texels per unit of the items' points
        turn: (I,) int64, quarter turns counter-clockwise
        offset: (I, 2) float64, texels, added after turning about the page's origin
    """

    scale: float
    turn: Int64
    offset: Float64

    def applied(self, items: Items) -> Float64:
        """(N, 3, 2) float64, texels, the points of the items on the page."""
        index = items.index
        return turned(items.points * self.scale, self.turn[index][:, None]) + self.offset[index][:, None, :]


def turned(points: Float64, turn: Int64) -> Float64:
    """Points (..., 2) after quarter turns about the origin."""
    x, y = points[..., 0], points[..., 1]
    cosine, sine = np.array([1, 0, -1, 0])[turn], np.array([0, 1, 0, -1])[turn]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def fill_page(items: Items, size: int, padding: int) -> Generator[None, None, Placement | None]:
    """The placement of all items on one page at the largest scale that is found to fit, None if none is.

    Args:
        size: texels along the page
        padding: even; texels between items, half of it to the page's border
    """
    upper = min((size - padding) / float(items.extent.max()), scale_of_area(items.area, size, padding))
    if upper <= 0:
        return None
    scale, best, smallest = upper, None, upper * 1e-4
    step = 0.9
    while best is None:
        best = yield from place(items, scale, size, padding)
        if best is None:
            if scale < smallest:
                return None
            upper, scale, step = scale, scale * step, step * 0.97
    if best.scale == upper:
        return best
    while upper / best.scale > SCALE_STEP:
        middle = float(np.sqrt(upper * best.scale))
        tried = yield from place(items, middle, size, padding)
        upper, best = (middle, best) if tried is None else (upper, tried)
    return best


def scale_of_area(area: Float64, size: int, padding: int) -> float:
    """Texels per unit at which padded items of these areas (I,) cover a page; 0 where the padding alone does.

    A shape of area A padded on all sides has at least (sqrt(A) + padding)^2 (Brunn and Minkowski).
    """
    edge, spare = float(np.sqrt(area).sum()), size**2 - len(area) * padding**2
    root = np.sqrt((padding * edge) ** 2 + float(area.sum()) * max(spare, 0))
    return float((root - padding * edge) / area.sum())


def place(
    items: Items, scale: float, size: int, padding: int, height: float | None = None
) -> Generator[None, None, Placement | None]:
    """The items on one page at a scale in texels per unit, None if they don't fit.

    Args:
        size: texels along the page
        padding: even; texels between items, half of it to the page's border
        height: of the page where it is not square; may be infinite
    """
    half = padding // 2
    texels = items.extent * scale
    height = size if height is None else height
    if (texels.max() > max(size, height) - padding + 1e-6) or items.area.sum() * scale**2 > size * height:
        return None
    outlines = _outlines(items, scale, half)
    if outlines.covered() > size * height:
        return None
    small = np.argsort(-texels.max(axis=1), kind="stable")[SINGLES:]
    strips = _strips(small[(texels[small] <= TINY * size).all(axis=1)], texels, padding, STRIP * size)
    shapes: list[tuple[_Shape, ...]] = []
    members: list[Int64] = []
    in_strip = np.zeros(items.count, bool)
    for strip in strips:
        in_strip[strip] = True
        shapes.append(_block(texels[strip], padding))
        members.append(strip)
    for item in np.flatnonzero(~in_strip):
        shapes.append(outlines.turns(int(item)))
        members.append(np.array([item]))
    lengths = np.array([sorted((len(turns[0].floor), turns[0].height), reverse=True) for turns in shapes])
    orders = (np.lexsort((-lengths[:, 0], -lengths[:, 1])), np.lexsort((-lengths[:, 1], -lengths[:, 0])))
    corner = items.low * scale
    for order in orders:
        spots = yield from _stack(shapes, order, size, height)
        if spots is None:
            continue
        turn, offset = np.zeros(items.count, np.int64), np.zeros((items.count, 2))
        for (way, x, y), inside, turns in zip(spots, members, shapes, strict=True):
            if len(inside) > 1:
                run = np.append(0, np.cumsum(np.ceil(texels[inside, 0]) + padding))[:-1]
                offset[inside] = np.stack([run, np.zeros(len(run))], axis=1) + half + [x, y] - corner[inside]
                continue
            shape = turns[way]
            turn[inside] = shape.turn
            wide, high = (float(edge) for edge in outlines.box[inside[0]])
            home = ((0.0, 0.0), (high, 0.0), (wide, high), (0.0, wide))[shape.turn]
            spot = np.array([x + half + home[0], y + shape.lift + home[1]])
            offset[inside] = spot - turned(corner[inside[0]], np.array(shape.turn))
        return Placement(scale, turn, offset)
    return None


@dataclass(frozen=True, eq=False)
class _Shape:
    """An item's padded contour after a quarter turn: floor and ceiling (n,) of its texel columns, texels.

    Attributes:
        mean: of the floor; 0 where it is flat
    """

    floor: Float32
    ceiling: Float32
    height: float
    lift: float
    turn: int
    mean: float


@dataclass(frozen=True, eq=False)
class _Outlines:
    """Contours of all items seen along y (by column) and along x (by row), ragged; `fixed` ones may not be turned."""

    first: tuple[Int64, Int64]
    low: tuple[Float64, Float64]
    high: tuple[Float64, Float64]
    box: Int64
    fixed: Bools

    def turns(self, item: int) -> tuple[_Shape, ...]:
        width, height = (float(edge) for edge in self.box[item])
        (low_x, high_x), (low_y, high_y) = (
            (self.low[axis][span], self.high[axis][span])
            for axis in (0, 1)
            for span in [slice(int(self.first[axis][item]), int(self.first[axis][item + 1]))]
        )
        upright = _shape(low_x, high_x, 0)
        if self.fixed[item]:
            return (upright,)
        lying = _shape(low_y[::-1], high_y[::-1], 1)
        if upright.mean == 0 and upright.ceiling.min() == upright.height:
            return upright, lying  # a box
        over = _shape(height - high_x[::-1], height - low_x[::-1], 2)
        if np.abs(over.floor - upright.floor).max() < SAME and np.abs(over.ceiling - upright.ceiling).max() < SAME:
            return upright, lying
        return upright, lying, over, _shape(width - high_y, width - low_y, 3)

    def covered(self) -> float:
        """Texels that the contours enclose."""
        return float((self.high[0] - self.low[0]).sum())


def _shape(floor: Float64, ceiling: Float64, turn: int) -> _Shape:
    base = float(floor.min())
    low, high = (floor - base).astype(np.float32), (ceiling - base).astype(np.float32)
    return _Shape(low, high, float(high.max()), -base, turn, float(np.add.reduce(low) / len(low)))


def _outlines(items: Items, scale: float, half: int) -> _Outlines:
    """Contours padded by half the padding on every side; boxes are whole texels."""
    index = items.index
    points = (items.points - items.low[index][:, None, :]) * scale
    box = np.maximum(np.ceil(items.extent * scale - 1e-9), 1).astype(np.int64)
    a, b = points.reshape(-1, 2)[items.rim], np.roll(points, -1, axis=1).reshape(-1, 2)[items.rim]
    owner = np.repeat(index, 3)[items.rim]
    firsts, lows, highs = [], [], []
    for axis in (0, 1):
        padded = box[:, axis] + 4 * half  # room for the sliding minimum on both sides
        start = np.cumsum(padded) - padded
        forward = (a[:, axis] <= b[:, axis])[:, None]
        p, q = np.where(forward, a, b), np.where(forward, b, a)
        last = box[owner, axis] - 1
        from_column = np.clip(np.floor(p[:, axis]).astype(np.int64), 0, last)
        to_column = np.clip(np.ceil(q[:, axis]).astype(np.int64) - 1, from_column, last)
        count = to_column - from_column + 1
        edge = np.repeat(np.arange(len(p)), count)
        column = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + from_column[edge]
        run, rise = (q - p)[:, axis], (q - p)[:, 1 - axis]
        slope = np.where(run > 0, rise / np.where(run > 0, run, 1), 0)[edge]
        origin, base = p[edge, axis], p[edge, 1 - axis]
        left = base + slope * (np.maximum(column, origin) - origin)
        right = base + slope * (np.minimum(column + 1, q[edge, axis]) - origin)
        upright = (run <= 0)[edge]
        right = np.where(upright, q[edge, 1 - axis], right)
        slot = start[owner[edge]] + 2 * half + column
        low, high = np.full(int(padded.sum()), np.inf), np.full(int(padded.sum()), -np.inf)
        np.minimum.at(low, slot, np.minimum(left, right))
        np.maximum.at(high, slot, np.maximum(left, right))
        window = 2 * half + 1
        length = len(low) - window + 1
        low = np.minimum.reduce([low[shift : shift + length] for shift in range(window)]) - half
        high = np.maximum.reduce([high[shift : shift + length] for shift in range(window)]) + half
        keep = np.repeat(start, box[:, axis] + 2 * half)
        first = np.append(0, np.cumsum(box[:, axis] + 2 * half))
        keep += np.arange(len(keep)) - np.repeat(first[:-1], box[:, axis] + 2 * half)
        firsts.append(first)
        low, high = low[keep], high[keep]
        empty = low > high  # between the charts of a rigid map
        low[empty], high[empty] = 0, 0
        lows.append(low)
        highs.append(high)
    return _Outlines((firsts[0], firsts[1]), (lows[0], lows[1]), (highs[0], highs[1]), box, items.upright)


def _strips(small: Int64, texels: Float64, padding: int, length: float) -> list[Int64]:
    """Small items in rows of like height and about that length."""
    order = small[np.lexsort((-texels[small, 0], -np.ceil(texels[small, 1])))]
    reach = np.cumsum(np.ceil(texels[order, 0]) + padding)
    cuts = np.flatnonzero(np.diff((reach - 1) // length)) + 1
    return [strip for strip in np.split(order, cuts) if len(strip) > 1]


def _block(texels: Float64, padding: int) -> tuple[_Shape, ...]:
    """The strip of these items as one shape."""
    columns = int((np.ceil(texels[:, 0]) + padding).sum())
    height = float(texels[:, 1].max()) + padding
    return (_Shape(np.zeros(columns, np.float32), np.full(columns, height, np.float32), height, 0.0, 0, 0.0),)


def _stack(
    shapes: list[tuple[_Shape, ...]], order: Int64, size: int, room: float
) -> Generator[None, None, list[tuple[int, float, float]] | None]:
    """Drops the shapes onto the skyline in this order: turn, column, height of each; None if `room` is too low."""
    skyline = np.zeros(size, np.float32)
    step = -(-size // COLUMN_STEPS)
    spots: list[tuple[int, float, float]] = [(0, 0.0, 0.0)] * len(shapes)
    for done, which in enumerate(order.tolist()):
        if done % ITEMS_A_YIELD == ITEMS_A_YIELD - 1:
            yield
        best: tuple[float, int, int, float] | None = None
        filled = np.append(0.0, np.cumsum(skyline))
        for way, shape in enumerate(shapes[which]):
            width = len(shape.floor)
            if width > size or shape.height > room + 1e-6:
                continue
            spots_across = (size - width) // step + 1
            if shape.mean == 0:
                heights = _highest(skyline, width)[::step]
            else:
                windows = np.ndarray((width, spots_across), skyline.dtype, skyline, strides=(4, 4 * step))
                heights = (windows - shape.floor[:, None]).max(axis=0)
            below = (filled[width:] - filled[: size - width + 1])[::step] / width
            score = heights * (1 + WASTE) - WASTE * below + (shape.height + WASTE * shape.mean)
            score[heights + shape.height > room + 1e-6] = np.inf
            column = int(np.argmin(score))
            if score[column] < (np.inf if best is None else best[0] - 1e-9):
                best = (float(score[column]), way, column * step, float(heights[column]))
        if best is None:
            return None
        _, way, x, y = best
        shape = shapes[which][way]
        part = skyline[x : x + len(shape.floor)]
        np.maximum(part, y + shape.ceiling, out=part)
        spots[which] = (way, float(x), y)
    return spots


def _highest(skyline: Float32, width: int) -> Float32:
    """The highest of every so many columns next to each other, by ever wider windows."""
    reach = 1
    while 2 * reach <= width:
        skyline = np.maximum(skyline[:-reach], skyline[reach:])
        reach *= 2
    rest = width - reach
    return np.maximum(skyline[: len(skyline) - rest], skyline[rest:])
