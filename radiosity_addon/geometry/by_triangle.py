# SPDX-License-Identifier: GPL-3.0-or-later
"""What texels have from their triangles: kept once for each triangle, and read like an array over the texels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ..arrays import Int32


@dataclass(frozen=True, eq=False)
class ByTriangle:
    """Values (F, ...) of triangles, read as (T, ...) at texels.

    Attributes:
        values: (F, ...)
        triangle: (T,) int32, of each texel
    """

    values: Any
    triangle: Int32

    def __len__(self) -> int:
        return len(self.triangle)

    def __getitem__(self, which: Any) -> Any:
        """As of an array: texels, then perhaps columns."""
        texels, *columns = which if isinstance(which, tuple) else (which,)
        found = self.values[self.triangle[texels]]
        return found[(..., *columns)] if columns else found

    def take(self, texels: Any, axis: int = 0) -> Any:
        """The same of some texels; faster."""
        return self.values.take(self.triangle.take(texels), axis=axis)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        return self[:].astype(dtype, copy=False)

    def __rmul__(self, factor: float) -> ByTriangle:
        return replace(self, values=factor * self.values)
