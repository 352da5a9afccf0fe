# SPDX-License-Identifier: GPL-3.0-or-later
"""The verbs of the command line at work on the open .blend: bake it, export or take out a bake, tell of one to come."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...atlas.unwrap import Atlas, build_atlas
from ...chunks import finish
from ...errors import SceneError
from ...estimate import memory_of
from ...files import Transaction, check_is_no_folder
from ...pages.page_format import PageFormat
from ...reports.report import Report, count_of, write_report
from ...settings import BakeSettings
from ..data.blend_files import said_of_open, save_blend, silence
from ..data.names import is_baked
from ..data.stand_in import as_unbaked
from ..handover.export import Exported, Handover, export_lightmaps
from ..interface.properties import cycles_limits
from ..job import Job, bake_scene
from ..reading.extract import SURFACES, extract_scene
from ..reading.inspection import findings
from ..writing.revert import revert as take_out_of
from .render_picture import render_picture

if TYPE_CHECKING:
    from ...arguments import Verb
    from ...progress import Meter
    from ...stages import Progress
    from ..interface.format_properties import RadiosityFileSettings


def bake(verb: Verb, meter: Meter) -> Report:
    """Bake the open scene and write all files of it, or none.

    Raises:
        BakeError: with the object or file, the cause and the remedy
    """
    output = verb.output
    textures = verb.textures or output.with_name(f"{output.stem}_textures")
    scene, said = bpy.context.scene, said_of_open()
    job = Job(
        settings=bake_settings(scene, verb),
        write_back=verb.write_back or scene.radiosity.write_back,
        folder=textures,
        stem=output.stem,
        objects=verb.object,
        page_format=page_format(scene.radiosity.files, verb),
        looked_at=verb.report is not None,
    )
    with Transaction() as files:
        for target in filter(None, (output, verb.report, verb.render, verb.render_before)):
            files.make_folder(target.parent)
            check_is_no_folder(target)
        if verb.render_before:
            with silence(), as_unbaked(scene):
                render_picture(scene, verb.render_before, _rendered(scene), files)
        report = watched(bake_scene(scene, job, files), meter)
        report = replace(report, warnings=[*said, *report.warnings])
        save_blend(output, files)
        if verb.render:
            shown = [bpy.data.objects[baked.object] for baked in report.objects]
            with silence():
                render_picture(bpy.context.scene, verb.render, shown, files)
        files.place(output)
        if verb.report:
            seen = replace(report, before=verb.render_before, after=verb.render)
            write_report(verb.report, seen, output.parent, files)
        files.commit()
    return report


def _rendered(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Objects with a surface that are rendered, for a camera to be fitted to."""
    return [thing for thing in scene.objects if thing.type in SURFACES and not thing.hide_render]


def revert(verb: Verb) -> None:
    """Take the bake out of the open scene and save it.

    Raises:
        SceneError: there is none in it
        OutputError: the result can't be saved
    """
    scene = bpy.context.scene
    if not is_baked(scene):
        raise SceneError(scene.name, "there is no bake in this scene", "Give a .blend that `bake` has written")
    with Transaction() as files:
        files.make_folder(verb.output.parent)
        take_out_of(scene)
        save_blend(verb.output, files)
        files.place(verb.output)
        files.commit()


def export(verb: Verb) -> Exported:
    """Write the files that hand the open scene's bake over.

    Raises:
        BakeError: with the object or file, the cause and the remedy
    """
    scene = bpy.context.scene
    settings = scene.radiosity_export
    wanted = Handover(
        folder=verb.output,
        stem=verb.scene.stem,
        page_format=page_format(settings.files, verb),
        gltf=settings.gltf if verb.gltf is None else verb.gltf,
        workers=scene.radiosity.bake_settings().workers,
    )
    with Transaction() as files:
        with silence():
            exported = export_lightmaps(scene, wanted, files)
        files.commit()
    return exported


def info(verb: Verb) -> str:
    """What a bake of the open scene would do: objects baked and not and why, texels, pages, memory."""
    scene = bpy.context.scene
    settings = bake_settings(scene, verb)
    with silence():
        extraction = extract_scene(scene)
        atlas = finish(build_atlas(extraction.scene, settings))
    lines = ["Baked:"]
    total = 0
    for index, mesh in enumerate(extraction.scene.meshes):
        if 0 <= atlas.page[index] < atlas.page_count:
            texels = _texels(atlas, index)
            total += texels
            place = f"page {atlas.page[index] + 1}, about {texels:,} texels, {atlas.density[index]:.4g} a metre"
            lines.append(f"  {mesh.name}: {place}")
    if extraction.skipped:
        lines.append("Not baked:")
        lines += [f"  {name}: {reason}" for name, reason in extraction.skipped]
    found = findings(scene, extraction, settings)
    warnings = [*(each.text for each in found if each.severity != "info"), *atlas.warnings]
    hints = [each.text for each in found if each.severity == "info" and each.subject not in dict(extraction.skipped)]
    for heading, texts in (("Warnings:", warnings), ("Hints:", hints)):
        if texts:
            lines += [heading, *(f"  {text}" for text in texts)]
    pages = f"{count_of(atlas.page_count, 'page')} of {atlas.size} x {atlas.size}"
    memory = memory_of(total) / 1e9
    lines.append(f"In all: {pages}, about {total:,} texels, at most {memory:.1f} GB of memory beside Blender itself")
    return "\n".join(lines)


def _texels(atlas: Atlas, mesh: int) -> int:
    """Texels that a mesh covers, by the area of its uv map."""
    uv = atlas.uv[mesh].astype(np.float64)
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return round(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2 * atlas.size**2)


def bake_settings(scene: bpy.types.Scene, verb: Verb) -> BakeSettings:
    """The scene's settings, and what the command line says in their place."""
    names = (
        "density", "fine_folds", "page_size", "quality", "form_factors", "subdivisions", "solver", "tolerance",
        "threads", "light_groups",
    )  # fmt: skip
    given: dict[str, Any] = {name: getattr(verb, name) for name in names if getattr(verb, name) is not None}
    if verb.bounces is not None:
        given |= {"bounces": None, "clamp_direct": 0.0, "clamp_indirect": 0.0}
        given |= cycles_limits(scene) if verb.bounces == "scene" else {}
        given |= {"bounces": verb.bounces} if isinstance(verb.bounces, int) else {}
    return replace(scene.radiosity.bake_settings(), **given)


def page_format(files: RadiosityFileSettings, verb: Verb) -> PageFormat:
    """A format of page files as set in the scene, and what the command line says in its place."""
    names = ("format", "depth", "compression", "exposure", "transfer", "space", "intent")
    given: dict[str, Any] = {name: getattr(verb, name) for name in names if getattr(verb, name) is not None}
    return replace(files.page_format(), **given)


def watched(steps: Generator[Progress, None, Report], meter: Meter) -> Report:
    """Run a bake to its end and show how far it is, without what Blender prints in between."""
    try:
        while True:
            with silence():
                progress = next(steps)
            meter.show(progress)
    except StopIteration as stop:
        report: Report = stop.value
        return report
    finally:
        steps.close()
