# SPDX-License-Identifier: GPL-3.0-or-later
"""Light between the two sides of sheets, patch by patch: the part of scattering that does not stay on its side.

What a patch sends on is the product of its reflectance and the mixed irradiance H_i = E_i + sum_j w_ij (E_j - E_i),
with w_ij the share of its area that patch j lies behind, times the share of light that comes through. Even light stays
as it is, and no patch has more than the brighter side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Float64, Int32
from ..geometry.sheets import Sheets
from ..geometry.texels import STRATA
from .patches import Patches


@dataclass(frozen=True, eq=False)
class Crossing:
    """The weights w of N patches, sparse.

    Attributes:
        row, column: (Q,) int32, patches and those behind them
        weight: (3, Q) float64, of each channel
    """

    row: Int32
    column: Int32
    weight: Float64

    def mixed(self, irradiance: Float64, channel: int | None = None) -> Float64:
        """The mixed irradiance (N, C), W/m2, of the irradiance (N, C) on each patch.

        Args:
            channel: of all columns; None: they are red, green and blue in turn
        """
        result = irradiance.copy()
        for number, light in enumerate(irradiance.T):
            if light.any():
                weight = self.weight[number % 3 if channel is None else channel]
                crossed = weight * (light[self.column] - light[self.row])
                result[:, number] += np.bincount(self.row, crossed, len(light))
        return result


def crossing_of(patches: Patches, sheets: Sheets | None) -> Crossing | None:
    """Which patches lie behind which through sheets; None where there are none."""
    if sheets is None:
        return None
    own = np.repeat(patches.of_element[sheets.texel], STRATA)
    other = patches.of_element[sheets.behind.reshape(-1)]
    joined = np.flatnonzero((own >= 0) & (other >= 0))
    own, other = own[joined], other[joined]
    texel = joined // STRATA
    area = patches.stopping[sheets.texel[texel]] / (STRATA * patches.area[own])
    pairs, place = np.unique(own * np.int64(patches.count) + other, return_inverse=True)
    weight = np.stack([np.bincount(place.ravel(), area * share[texel], len(pairs)) for share in sheets.share.T])
    row, column = (side.astype(np.int32) for side in np.divmod(pairs, patches.count))
    return Crossing(row, column, weight)
