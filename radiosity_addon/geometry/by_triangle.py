# SPDX-License-Identifier: GPL-3.0-or-later
"""What texels have from their triangles: kept once for each triangle, and read like an array over the texels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ..arrays import Int32
from ..columns import vectors_at
from .footprints import Footprints


@dataclass(frozen=True, eq=False)
class ByTriangle:
    """Values of triangles, read at texels.

    Attributes:
        values: (F, ...)
        footprints: of T texels; each has the value of its first stratum's triangle
    """

    values: Any
    footprints: Footprints

    def __len__(self) -> int:
        return len(self.footprints.seat)

    def __getitem__(self, which: Any) -> Any:
        """As of an array (T, ...): texels, then perhaps columns or new axes."""
        texels, *columns = which if isinstance(which, tuple) else (which,)
        found = self.values.take(self.footprints.first(texels), axis=0)
        over_texels = (slice(None),) * (found.ndim - self.values.ndim + 1)
        return found[(*over_texels, *columns)] if columns else found

    def take(self, texels: Any, axis: int = 0) -> Any:
        """As of an array, along its first axis. In memory the coordinates of vectors lie apart."""
        triangle = self.footprints.first(texels)
        if self.values.ndim == 2 and triangle.ndim == 1:
            return vectors_at(self.values, triangle)
        return self.values.take(triangle, axis=axis)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        return self[:].astype(dtype, copy=False)

    def __rmul__(self, factor: float) -> ByTriangle:
        return replace(self, values=factor * self.values)


@dataclass(frozen=True, eq=False)
class FirstTriangle:
    """Triangle (T,) of the first stratum of each texel."""

    footprints: Footprints

    def __len__(self) -> int:
        return len(self.footprints.seat)

    def __getitem__(self, texels: Any) -> Int32:
        """As of an array."""
        return self.footprints.first(texels)
