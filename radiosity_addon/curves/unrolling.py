# SPDX-License-Identifier: GPL-3.0-or-later
"""Lays nets flat by arc length, as one unrolls a cone.

A piece of a net whose rows grow evenly longer, such as a part of a vase, is close to a cone, and a cone unrolls to a
sector of a ring without any distortion: rows become arcs as long as they are, columns become radii. Cylinders unroll
to rectangles, the caps of a sphere to discs. What bends too much for one piece is cut, until every piece is true to
length within a bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Float64, Int64
from .patchwork import Cap, Net, faces_of

STRETCH = 1.5
"""Most that lengths in a chart may differ from those on the surface, as a factor either way."""

MOST_PIECES = 32
"""A net that needs more pieces is no net to lay flat by rows and columns."""

FEW = 6
"""Bands with which one is content."""

LONG = 2.0
"""Longest piece, as a multiple of the square root of the object's area: strips pack worse the longer they are."""

FULL_CIRCLE = 0.97 * 2 * np.pi
"""Widest sector: its two ends must not meet."""

STRAIGHT = 1e-3
"""Sectors of a smaller angle are rectangles."""

FOLDED = 1e3
"""Stretch of what is folded over."""

LOOKED_AT = 48
"""Rows and columns of a piece, at most, whose distortion is measured."""


@dataclass(frozen=True)
class _Piece:
    """Rows first_row..last_row and columns first_column..last_column of a net, both ends included."""

    first_row: int
    last_row: int
    first_column: int
    last_column: int

    def part(self, points: Float64) -> Float64:
        return points[self.first_row : self.last_row + 1, self.first_column : self.last_column + 1]

    def along(self, axis: int) -> tuple[int, int]:
        """First and last row (axis 0) or column (axis 1)."""
        return (self.first_row, self.last_row) if axis == 0 else (self.first_column, self.last_column)

    def between(self, axis: int, first: int, last: int) -> _Piece:
        """The part from one row or column to another."""
        if axis == 0:
            return replace(self, first_row=first, last_row=last)
        return replace(self, first_column=first, last_column=last)

    def halves(self, points: Float64, axis: int) -> tuple[_Piece, _Piece] | None:
        """Cut where half of the length across the rows (axis 0) or columns is reached; None for a single strip."""
        steps = np.linalg.norm(np.diff(self.part(points), axis=axis), axis=2).mean(axis=1 - axis)
        if len(steps) < 2:
            return None
        length = np.cumsum(steps)
        first, last = self.along(axis)
        middle = first + int(np.argmin(np.abs(length[:-1] - length[-1] / 2))) + 1
        return self.between(axis, first, middle), self.between(axis, middle, last)


def unroll(nets: Sequence[Net], caps: Sequence[Cap], linear: Float64) -> tuple[Float64, Int64] | None:
    """Places in the plane of the corners of a patchwork of these nets and caps, in its numbering.

    Args:
        linear: (3, 3) float64, the matrix that takes points to the world's scale

    Returns:
        (K, 2) float64, m, each chart in a plane of its own, and (K,) int64, the chart; None if a net bends too much
    """
    scaled = [net.around(net.points) @ linear.T for net in nets]
    area = sum(float(_face_areas(points).sum()) for points in scaled)
    places, charts, count = [np.zeros((0, 2))], [np.zeros(0, np.int64)], 0
    for points in scaled:
        pieces = _pieces(points, LONG * np.sqrt(area))
        if pieces is None:
            return None
        rows, columns = points.shape[:2]
        place, chart = np.zeros((rows - 1, columns - 1, 4, 2)), np.zeros((rows - 1, columns - 1, 4), np.int64)
        for piece in pieces:
            faces = slice(piece.first_row, piece.last_row), slice(piece.first_column, piece.last_column)
            place[faces] = faces_of(_flattened(piece.part(points))[0])
            chart[faces] = count
            count += 1
        places.append(place.reshape(-1, 2))
        charts.append(chart.reshape(-1))
    for cap in caps:
        places.append(_in_its_plane(cap.points @ linear.T))
        charts.append(np.full(len(cap.points), count))
        count += 1
    return np.concatenate(places), np.concatenate(charts)


def _pieces(points: Float64, longest: float) -> list[_Piece] | None:
    """Pieces of a net that can be laid flat, none longer in the plane than that; None if they are too many."""
    pieces = _divided(points, _Piece(0, points.shape[0] - 1, 0, points.shape[1] - 1), MOST_PIECES)
    if pieces is None:
        return None
    done = []
    while pieces:
        piece = pieces.pop(0)
        part = piece.part(points)
        lengths = [float(np.linalg.norm(np.diff(part, axis=axis), axis=2).sum(axis=axis).max()) for axis in (0, 1)]
        halves = piece.halves(points, int(lengths[1] > lengths[0]))
        if halves and np.ptp(_flattened(part)[0].reshape(-1, 2), axis=0).max() > longest:
            pieces[:0] = halves
        else:
            done.append(piece)
    return done


def _divided(points: Float64, piece: _Piece, most: int) -> list[_Piece] | None:
    """The fewest of: bands of rows, bands of columns, or both halves of the piece, each divided in turn."""
    best = None
    for axis in (0, 1):
        bands = _bands(points, piece, axis, most if best is None else len(best) - 1)
        best = bands or best
    if best is not None and len(best) <= FEW:
        return best
    limit = most if best is None else len(best) - 1
    part = piece.part(points)
    lengths = [float(np.linalg.norm(np.diff(part, axis=axis), axis=2).sum(axis=axis).mean()) for axis in (0, 1)]
    halves = piece.halves(points, int(lengths[1] > lengths[0])) or piece.halves(points, int(lengths[1] <= lengths[0]))
    if halves is None:
        return best or [piece]  # a single face: its polygon is repaired when charts are tidied
    first = _divided(points, halves[0], limit - 1)
    second = _divided(points, halves[1], limit - len(first)) if first and len(first) < limit else None
    return first + second if first and second else best


def _bands(points: Float64, piece: _Piece, axis: int, most: int) -> list[_Piece] | None:
    """A piece as bands of rows (axis 0) or columns, each as wide as its stretch allows; None if they are too many."""
    first, last = piece.along(axis)
    bands: list[_Piece] = []
    while first < last:
        fits, fails = first, last + 1
        while fails - fits > 1:
            stop = fails - 1 if fails > last else (fits + fails) // 2
            if _flattened(piece.between(axis, first, stop).part(points))[1] <= STRETCH:
                fits = stop
            else:
                fails = stop
        if fits == first or len(bands) == most:
            return None
        bands.append(piece.between(axis, first, fits))
        first = fits
    return bands


def _flattened(points: Float64) -> tuple[Float64, float]:
    """Places (R, C, 2) of a piece (R, C, 3), and how much lengths are stretched at worst.

    It is unrolled as a cone whose top lies beyond the first or last row, or beyond the first or last column.
    """
    by_rows = _as_cone(points)
    by_columns = np.swapaxes(_as_cone(np.swapaxes(points, 0, 1)), 0, 1)[..., ::-1]
    chosen = np.ix_(*(_evenly(size) for size in points.shape[:2]))
    stretches = [_stretch(points[chosen], flat[chosen]) for flat in (by_rows, by_columns)]
    return (by_rows, stretches[0]) if stretches[0] <= stretches[1] else (by_columns, stretches[1])


def _evenly(size: int) -> Int64:
    return np.unique(np.linspace(0, size - 1, min(size, LOOKED_AT)).round().astype(np.int64))


def _as_cone(points: Float64) -> Float64:
    """Places (R, C, 2): rows as arcs about one centre, as long as they are, as far as that goes."""
    along = np.linalg.norm(np.diff(points, axis=1), axis=2)
    length = along.sum(axis=1)
    share = np.append(0.0, np.cumsum(along.sum(axis=0)))
    share /= max(share[-1], 1e-300)
    down = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=2).mean(axis=1)))
    weight = np.convolve(np.diff(down), [0.5, 0.5]) + 1e-300
    middle, mean = np.average(down, weights=weight), np.average(length, weights=weight)
    spread = np.average((down - middle) ** 2, weights=weight)
    angle = float(np.average((down - middle) * (length - mean), weights=weight) / max(spread, 1e-300))
    angle = float(np.clip(angle, -FULL_CIRCLE, FULL_CIRCLE))
    if abs(angle) * (down[-1] - down[0]) < STRAIGHT * mean:
        return np.stack(np.broadcast_arrays((share - 0.5) * mean, down[:, None]), axis=2)
    radius = np.maximum((mean + angle * (down - middle)) / abs(angle), 0.0)
    turn = (share - 0.5) * abs(angle)
    around = np.stack([np.sin(turn), np.cos(turn) * np.sign(angle)], axis=1)
    return np.asarray(radius[:, None, None] * around)


def _stretch(points: Float64, flat: Float64) -> float:
    """The largest factor by which a length in the plane is too long or too short, areas being equal in sum.

    From the singular values of the map of each face's two triangles (Sander et al. 2001, "Texture mapping progressive
    meshes"). Triangles that are folded over count as `FOLDED`.
    """
    corners, places = (faces_of(array).reshape(-1, 4, array.shape[2]) for array in (points, flat))
    e1, e2 = (np.concatenate([corners[:, k] - corners[:, 0] for k in pair]) for pair in ((1, 2), (2, 3)))
    d1, d2 = (np.concatenate([places[:, k] - places[:, 0] for k in pair]) for pair in ((1, 2), (2, 3)))
    g11, g12, g22 = (e1 * e1).sum(1), (e1 * e2).sum(1), (e2 * e2).sum(1)
    determinant = g11 * g22 - g12**2
    real = determinant > 1e-12 * float(np.maximum(g11, g22).max(initial=0.0)) ** 2
    signed = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0])[real]
    if not real.any() or not signed.sum():
        return FOLDED
    area = np.sqrt(determinant[real])
    scale = float(area.sum() / abs(signed.sum()))
    f11, f12, f22 = (d1 * d1).sum(1)[real], (d1 * d2).sum(1)[real], (d2 * d2).sum(1)[real]
    trace = (g22[real] * f11 - 2 * g12[real] * f12 + g11[real] * f22) / determinant[real] * scale
    product = signed * np.sign(signed.sum()) / area * scale
    longest = np.sqrt(trace / 2 + np.sqrt(np.maximum(trace**2 / 4 - product**2, 0.0)))
    each = np.where(product > 0, np.maximum(longest, longest / np.maximum(product, 1e-300)), FOLDED)
    return float(each.max())


def _face_areas(points: Float64) -> Float64:
    corners = faces_of(points).reshape(-1, 4, 3)
    diagonals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    return np.asarray(np.linalg.norm(diagonals, axis=1) / 2)


def _in_its_plane(points: Float64) -> Float64:
    """A flat polygon (K, 3) in plane coordinates (K, 2)."""
    following = np.roll(points, -1, axis=0)
    normal = np.cross(points - points[0], following - points[0]).sum(axis=0)
    length = float(np.linalg.norm(normal))
    edges = following - points
    longest = edges[int(np.argmax((edges**2).sum(axis=1)))]
    across = longest / max(float(np.linalg.norm(longest)), 1e-300)
    up = np.cross(normal / length, across) if length > 0 else np.zeros(3)
    return np.stack([points @ across, points @ up], axis=1)
