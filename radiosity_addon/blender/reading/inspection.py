# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene looked over before it is baked: what is lit, and what will be skipped or looks wrong."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import bpy

from ...checks import Finding, check, lit_areas, shining_faces
from ...errors import SceneError
from ...settings import BakeSettings
from .extract import LEFT_OUT, extract_scene
from .extraction import Extraction

SEVERITIES = ("error", "warning", "info")


@dataclass(frozen=True)
class Inspection:
    """What is known of a scene before its bake.

    Attributes:
        findings: the gravest first
        area: m2 of all that gets a lightmap, times density multipliers squared; None: the scene can't be read
        objects: how many get a lightmap, instances counted
        page_groups: how many page groups they are in
        shining: how many triangles emit light
    """

    findings: tuple[Finding, ...]
    area: float | None = None
    objects: int = 0
    page_groups: int = 1
    shining: int = 0

    def without(self, subject: str) -> Inspection:
        """The same, less what was found to be inside out and has been turned."""
        kept = (each for each in self.findings if not (each.inside_out and each.subject == subject))
        return replace(self, findings=tuple(kept))


def inspect(scene: bpy.types.Scene, settings: BakeSettings) -> Inspection:
    """Look a scene over as a bake would read it; the scene is left as found."""
    unsaved = [] if bpy.data.is_saved else [UNSAVED]
    try:
        extraction = extract_scene(scene)
    except SceneError as error:
        return Inspection((*(_stopping(each, scene) for each in (error, *error.more)), *unsaved))
    meshes = extraction.scene.meshes
    areas = lit_areas(meshes)
    return Inspection(
        findings=(*findings(scene, extraction, settings), *unsaved),
        area=sum(area for _, area in areas),
        objects=len(areas),
        page_groups=len({mesh.page_group for mesh in meshes if mesh.lightmapped and len(mesh.triangles)}),
        shining=shining_faces(extraction.scene),
    )


def _stopping(error: SceneError, scene: bpy.types.Scene) -> Finding:
    subject = error.subject if error.subject in scene.objects else ""
    return Finding("error", f"{error.subject}: {error.cause}. {error.remedy}", subject)


UNSAVED = Finding("info", "The file is not saved yet: lightmaps will be packed into it")


def findings(scene: bpy.types.Scene, extraction: Extraction, settings: BakeSettings) -> list[Finding]:
    """What there is to say about a scene that was read, the gravest first."""
    names = {thing.name for thing in scene.objects}
    said = set(extraction.warnings)
    found = [*(Finding("warning", text, subject_of(text, names)) for text in extraction.warnings)]
    found += check(extraction.scene, settings)
    found += [
        Finding("info", f"{name} gets no lightmap: {reason}", name if name in names else "")
        for name, reason in extraction.skipped
        if LEFT_OUT.format(name, reason) not in said
    ]
    return sorted(found, key=lambda finding: SEVERITIES.index(finding.severity))


def subject_of(text: str, names: Collection[str]) -> str:
    """The object that a warning names: at its beginning, or behind the word of what it is, in quotes; "" for none."""
    quoted = text.split("'")[1:2] if text.split(" ", 1)[0] in ("Lamp",) else []
    begins = [name for name in names if text.startswith(name) and not text[len(name) : len(name) + 1].isalnum()]
    return max([name for name in quoted if name in names] or begins, key=len, default="")
