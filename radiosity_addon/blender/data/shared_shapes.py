# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of the surfaces that share a mesh can share an unwrap."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from ...arrays import Float64

STRETCH = 1.5
"""Surfaces share an unwrap if none is longer than this against another: its texels would be as uneven."""


class SharedShapes:
    """Numbers for Mesh.shape: one mesh stretched in different ways is several shapes."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, str, str], list[tuple[Float64, int]]] = defaultdict(list)
        self._count = 0

    def number(self, mesh: int, uv_map: str, matrix: Float64, page_group: str = "") -> int:
        """The shape of a mesh under a matrix.

        Args:
            mesh: what identifies it
            uv_map: of its that is kept, "" for none
            matrix: (4, 4) world matrix, invertible
            page_group: what is on other pages has a layout of its own
        """
        linear = matrix[:3, :3]
        known = self._known[mesh, uv_map, page_group]
        for inverse, number in known:
            sizes = np.linalg.svd(inverse @ linear, compute_uv=False)
            if sizes[0] <= STRETCH * sizes[2]:
                return number
        known.append((np.linalg.inv(linear), self._count))
        self._count += 1
        return self._count - 1
