# SPDX-License-Identifier: GPL-3.0-or-later
"""Connected parts of surfaces."""

from __future__ import annotations

import numpy as np

from ..arrays import Float64, Floats, Int32, Int64


def islands(vertex: Int64) -> Int64:
    """Connected part (F,) of triangles (F, 3) that share vertices, numbered from 0 in order of appearance."""
    _, index = np.unique(vertex, return_inverse=True)
    triangles = index.reshape(-1, 3)
    label = np.arange(int(triangles.max(initial=-1)) + 1)
    while True:  # smallest vertex of the part, by pointer jumping; rounds grow with the logarithm of its size
        low = label[triangles].min(axis=1)
        new = label.copy()
        np.minimum.at(new, label[triangles].reshape(-1), np.repeat(low, 3))
        np.minimum.at(new, triangles.reshape(-1), np.repeat(low, 3))
        new = new[new]
        if np.array_equal(new, label):
            break
        label = new
    _, first, part = np.unique(label[triangles[:, 0]], return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return np.asarray(rank[part.reshape(-1)])


def welded(position: Float64) -> Int64:
    """(V,) the same number for vertices at the same place (V, 3)."""
    order = np.lexsort(position.T)
    changes = np.append(False, (np.diff(position[order], axis=0) != 0).any(axis=1))
    number = np.empty(len(position), np.int64)
    number[order] = np.cumsum(changes)
    return number


def uv_charts(vertex: Int64 | Int32, uv: Floats) -> tuple[Int64, Int64]:
    """Charts of a uv map: parts whose triangles share vertices of the mesh and lie together in the map too.

    Args:
        vertex: (F, 3) vertices of the mesh
        uv: (F, 3, 2)

    Returns:
        (F,) the chart of each triangle, and (F, 3) the number of each corner, the same where neighbours share it
    """
    corner = np.concatenate([vertex[..., None].astype(np.float64), uv], axis=2).reshape(-1, 3)
    number = welded(corner).reshape(-1, 3)
    return islands(number), number


def borders(vertex: Int64) -> Int64:
    """Edges (K,) of triangles (F, 3) that no second one has: 3 * triangle + k goes from its corner k to the next."""
    ends = np.sort(np.stack([vertex, np.roll(vertex, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    order = np.lexsort(ends.T)
    same = (np.diff(ends[order], axis=0) == 0).all(axis=1)
    alone = ~(np.append(False, same) | np.append(same, False)) if len(order) else np.zeros(0, bool)
    return np.sort(order[alone])


def rough_share(vertex: Int64, normal: Float64, cosine: float) -> float:
    """Share of the inner edges of triangles (F, 3) at which unit normals (F, 3) differ by more than an angle."""
    edges = np.sort(vertex[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    same = (np.diff(edges[order], axis=0) == 0).all(axis=1)
    a, b = order[:-1][same] // 3, order[1:][same] // 3
    return float(((normal[a] * normal[b]).sum(axis=1) < cosine).mean()) if len(a) else 0.0
