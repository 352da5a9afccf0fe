# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user chooses about a bake, validated once."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from typing import Literal, get_args

from .errors import SettingsError

QualityName = Literal["draft", "medium", "high"]
QUALITIES: tuple[str, ...] = get_args(QualityName)
SolverName = Literal[
    "progressive", "southwell", "overshooting", "gauss-seidel", "jacobi", "conjugate-gradient", "dense"
]
FormFactorName = Literal["nusselt", "hemicube", "area"]
FORM_FACTOR_NAMES: tuple[str, ...] = get_args(FormFactorName)
SOLVER_NAMES: tuple[str, ...] = get_args(SolverName)
MOST_SUBDIVISIONS = 4
MAX_PAGE_SIZE = 8192


@dataclass(frozen=True)
class Quality:
    """Numbers of samples behind one word, which means an error.

    Root mean square errors at probe points, as shares of the scene's mean, against Cycles with tens of thousands of
    samples and all bounces (`tests/accuracy`); in brackets of a room that is lit through a window:

    ========  ============  ================================================================================
    quality   aimed at      measured
    ========  ============  ================================================================================
    draft     3.5 % (7 %)   Cornell box 1.7, studio 1.5, office 1.6, court 1.7, pavilion 0.7 % (3.3 %)
    medium    2.5 % (5 %)   Cornell box 0.7, studio 1.0, office 1.1, court 1.3, pavilion 0.5 % (1.6 %)
    high      1.5 % (3 %)   Cornell box 0.5, studio 0.9, office 0.9, court 1.1, pavilion 0.4 % (1.1 %)
    ========  ============  ================================================================================

    A bake says in its report what it finds that it errs itself (`gather/own_error`).

    Attributes:
        patch_rays: transport rays of a patch of mean area
        patches: patches aimed at for a page of a million texels
        gather_rays: final-gather rays of a gather point at its first look; noisy ones look again
        gather_spacing: least distance of gather points, in texels, on open surfaces
        gather_points: gather points on open surfaces, at most; nooks get more
        gather_split: gather points get closer while they are farther apart than this share of the scale over
            distance that they see, or that light comes from
        shadow_probes: first shadow rays of a texel and lamp
        shadow_rays: shadow rays of a texel and lamp in a penumbra
        gather_passes: final gathers; from the second on rays read irradiance at texel resolution
        lamp_error: relative error that the weaker ones of many lamps may bring, which are known at nodes only, and as
            much again those that few rays serve; and that of the unshadowed light of meshes with many triangles
    """

    patch_rays: int
    patches: int
    gather_rays: int
    gather_spacing: float
    gather_points: int
    gather_split: float
    shadow_probes: int
    shadow_rays: int
    gather_passes: int
    lamp_error: float


QUALITY_STEPS: dict[str, Quality] = {
    "draft": Quality(48, 4000, 96, 8.0, 6000, 0.35, 1, 12, 1, 0.012),
    "medium": Quality(64, 12000, 192, 5.0, 6000, 0.15, 1, 36, 4, 0.006),
    "high": Quality(128, 24000, 384, 4.0, 12000, 0.12, 2, 72, 4, 0.003),
}


@dataclass(frozen=True)
class BakeSettings:
    """Settings of one bake.

    Attributes:
        density: texels per metre; None fills one page
        fine_folds: smooth surfaces that fold within few texels get finer ones
        page_size: texels along an edge of a page
        quality: draft, medium or high
        form_factors: name of the estimator of form factors
        solver: name of the way in which the equation is solved, as in solvers.py
        tolerance: unshot share of the emitted power at which the solver stops
        bounces: most reflections of light that a lightmap holds; None for all
        clamp_direct, clamp_indirect: largest radiance, mean of the channels, that lamps may bring onto a texel, and
            that reflected light may have, as Cycles clamps samples; 0 for no limit
        most_steps: steps after which the solver stops unfinished; None for its own limit
        ambient: guess what an unfinished solver has left unshot
        subdivisions: how often patches are split where radiosity changes across them, from ever coarser ones
        final_gather: rays bring the light of patches to texels; without, each texel shows its patch's
        show_patches: darken the texels at the edges of patches
        light_groups: each light group's light on pages of its own, beside those that hold all of it
        threads: worker threads; 0 takes all processors that the process may use
    """

    density: float | None = None
    fine_folds: bool = False
    page_size: int = 1024
    quality: QualityName = "medium"
    form_factors: FormFactorName = "nusselt"
    solver: SolverName = "conjugate-gradient"
    tolerance: float = 1e-4
    bounces: int | None = None
    clamp_direct: float = 0.0
    clamp_indirect: float = 0.0
    most_steps: int | None = None
    ambient: bool = False
    subdivisions: int = 0
    final_gather: bool = True
    show_patches: bool = False
    light_groups: bool = False
    threads: int = 0
    workers: int = field(init=False, default=1)

    def __post_init__(self) -> None:
        if self.density is not None and not (math.isfinite(self.density) and self.density > 0):
            raise SettingsError(
                "Density", f"{self.density} is not a positive number", "Give texels per metre, such as 64"
            )
        if not 16 <= self.page_size <= MAX_PAGE_SIZE:
            raise SettingsError(
                "Page size", f"{self.page_size} is out of range", f"Choose from 16 to {MAX_PAGE_SIZE} texels"
            )
        if self.quality not in QUALITIES:
            raise SettingsError("Quality", f"{self.quality!r} is unknown", "Choose from " + ", ".join(QUALITIES))
        if self.form_factors not in FORM_FACTOR_NAMES:
            raise SettingsError(
                "Form factors", f"{self.form_factors!r} is unknown", "Choose from " + ", ".join(FORM_FACTOR_NAMES)
            )
        if self.solver not in SOLVER_NAMES:
            raise SettingsError("Solver", f"{self.solver!r} is unknown", "Choose from " + ", ".join(SOLVER_NAMES))
        if not 1e-8 <= self.tolerance < 1:
            raise SettingsError("Tolerance", f"{self.tolerance} is out of range", "Choose from 1e-8 to below 1")
        if not 0 <= self.subdivisions <= MOST_SUBDIVISIONS:
            raise SettingsError(
                "Subdivisions", f"{self.subdivisions} is out of range", f"Choose from 0 to {MOST_SUBDIVISIONS}"
            )
        if self.bounces is not None and self.bounces < 0:
            raise SettingsError("Bounces", f"{self.bounces} is below zero", "Give 0 for direct light only, or more")
        for clamp in (self.clamp_direct, self.clamp_indirect):
            if not (math.isfinite(clamp) and clamp >= 0):
                raise SettingsError("Clamp", f"{clamp} is out of range", "Give 0 for none, or a positive number")
        if not 0 <= self.threads <= 1024:
            raise SettingsError("Threads", f"{self.threads} is out of range", "Choose from 0 (all) to 1024")
        object.__setattr__(self, "workers", self.threads or usable_processors())

    @property
    def steps(self) -> Quality:
        """The numbers of samples behind `quality`."""
        return QUALITY_STEPS[self.quality]


def usable_processors() -> int:
    """Processors this process may run on."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on macOS and Windows
        return os.cpu_count() or 1
