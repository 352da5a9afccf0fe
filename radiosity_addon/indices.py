# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers of elements in as few bytes as hold them: of a large page each list of all texels counts."""

from __future__ import annotations

import numpy as np

from .arrays import Bools, Int32

BLOCK = 1 << 17
"""Elements looked through in one go."""


def numbers_of(chosen: Bools) -> Int32:
    """Where `chosen` (N,) is true, ascending; N is below 2^31."""
    found = np.empty(int(np.count_nonzero(chosen)), np.int32)
    done = 0
    for start in range(0, len(chosen), BLOCK):
        some = np.flatnonzero(chosen[start : start + BLOCK])
        found[done : done + len(some)] = some + start
        done += len(some)
    return found
