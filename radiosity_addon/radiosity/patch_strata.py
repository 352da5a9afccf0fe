# SPDX-License-Identifier: GPL-3.0-or-later
"""The strata that patches are made of, in runs of texels: a list of them all would be the largest thing in a bake."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Int32, Int64
from ..geometry.opacity import Opacity
from ..geometry.texels import BITS, STRATA, Texels

PLACES = 16
"""Of the strata one after the other, every so manieth knows its run; from there it is a few runs to any other."""

SCANNED = 1 << 16
"""Texels looked through in one go."""

_SLOTS = np.arange(STRATA, dtype=np.int32)
_NTH = np.argsort(~(((np.arange(1 << STRATA)[:, None] >> _SLOTS) & 1) > 0), axis=1, kind="stable").astype(np.int32)
"""(16, 4): the slots of each set of strata, those in it first."""


@dataclass(frozen=True, eq=False)
class PatchStrata:
    """Strata of N patches, one patch after the other, in R runs of texels that follow each other and send alike.

    Attributes:
        start, number: (N,) int32, where each patch's strata begin, and how many they are
    """

    start: Int32
    number: Int32
    _begin: Int32
    _texel: Int32
    _sent: NDArray[np.uint8]
    _run: Int32

    @staticmethod
    def of(parts: list[tuple[Int32, Int32]], sending: NDArray[np.uint8], count: int) -> PatchStrata:
        """Those of `count` patches.

        Args:
            parts: patches (K,) and the texels (K,) that are in them, ascending; a patch is in one of the parts only
            sending: (T,) uint8, strata that send light, as bits
        """
        runs = [_runs(*part, sending) for part in parts]
        patch, texel, length = (np.concatenate(each) for each in zip(*runs, strict=True))
        order = np.argsort(patch, kind="stable")
        patch, texel, length = patch[order], texel[order], length[order]
        sent = sending[texel]
        strata = length * BITS[sent]
        begin = np.concatenate([[0], np.cumsum(strata)])
        number = np.bincount(patch, weights=strata, minlength=count)
        run = np.searchsorted(begin, np.arange(0, int(begin[-1]), PLACES), side="right") - 1
        return PatchStrata(
            start=(np.cumsum(number) - number).astype(np.int32),
            number=number.astype(np.int32),
            _begin=begin.astype(np.int32),
            _texel=texel,
            _sent=sent,
            _run=run.astype(np.int32),
        )

    def at(self, place: Int32) -> Int32:
        """Strata, texel * 4 + slot, at places (R,) among those of all patches."""
        run = self._run[place // PLACES]
        behind = np.flatnonzero(self._begin[run + 1] <= place)
        while len(behind):
            run[behind] += 1
            behind = behind[self._begin[run[behind] + 1] <= place[behind]]
        sent = self._sent[run]
        texel, nth = np.divmod(place - self._begin[run], BITS[sent].astype(np.int32))
        texel += self._texel[run]
        texel *= STRATA
        texel += _NTH[sent, nth]
        return texel


def sending(texels: Texels, opacity: Opacity | None) -> NDArray[np.uint8]:
    """Strata that send light, as bits (T,); texels beside charts stand in one place."""
    covered = np.maximum(texels.covered, 1)
    if opacity is None:
        return covered
    some = covered & opacity.strata
    return np.where(some, some, covered)


def _runs(patch: Int32, texel: Int32, sending: NDArray[np.uint8]) -> tuple[Int32, Int32, Int64]:
    """Patch, first texel and length of runs of texels (K,) that follow each other in one patch and send alike."""
    begins = []
    for start in range(0, len(patch), SCANNED):
        part = slice(max(start - 1, 0), start + SCANNED)
        own, here = patch[part], texel[part]
        sent = sending[here]
        new = (own[1:] != own[:-1]) | (here[1:] != here[:-1] + 1) | (sent[1:] != sent[:-1])
        begins.append(np.flatnonzero(new) + (part.start + 1))
    begin = np.concatenate([np.zeros(min(1, len(patch)), np.int64), *begins])
    return patch[begin], texel[begin], np.diff(np.append(begin, len(patch)))
