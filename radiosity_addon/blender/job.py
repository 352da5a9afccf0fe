# SPDX-License-Identifier: GPL-3.0-or-later
"""The whole way of a bake, from the open scene to lit materials: the one generator that operators and commands run."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeAlias, TypeVar

import bpy

from ..bake import Baked, bake
from ..color.spaces import RGBSpace
from ..errors import SceneError
from ..files import Transaction
from ..geometry.sides import backs_of
from ..pages.page_files import PageFiles, group_stems, page_paths, sidecar_path, write_pages, write_sidecar
from ..pages.page_format import PageFormat, Recipe
from ..reports.overview import Overview, overview
from ..reports.report import BakedObject, Page, Report
from ..reports.texel_maps import packed, texel_map
from ..settings import BakeSettings
from ..stages import NO_RAYS, Progress
from ..viewing import Viewer
from .background import MainThread, in_thread
from .data.names import TEXELS_KEY
from .last_bake import keep_report, stage_shares
from .reading.cycles import Cycles
from .reading.cycles_shader import CyclesShader
from .reading.extract import read_scene
from .reading.extraction import Extraction
from .reading.second_blender import SecondBlender
from .writing.light_mix import MOST_GROUPS
from .writing.page_images import free_stem
from .writing.write_back import write_back

READING_SHARE = 0.02
"""Share of the progress bar for reading the scene, before the core's part of it."""
BAKING_SHARE = 0.94
"""Share for the core; writing files and materials takes the rest."""
LEAST_TOLD = 0.001
"""Share of texels outside of what files can hold from which on the user hears of it."""


Apart: TypeAlias = dict[str, tuple[Sequence[Path], Recipe]]
"""By name of the light group, files with its light alone and how to read them."""

T = TypeVar("T")


@dataclass(frozen=True)
class Seat:
    """A place in a window for who looks on at a bake.

    Attributes:
        taken: once the scene was read; what it gives tells the viewer by the records, in the bake's own thread
        main: runs what only the main thread can
        second_blender: takes the work of Cycles off this one, which stands still meanwhile
    """

    taken: Callable[[bpy.types.Scene], Callable[[Extraction], Viewer]]
    main: MainThread = field(default_factory=MainThread)
    second_blender: bool = False


@dataclass(frozen=True)
class Job:
    """What to bake, how, and where to.

    Attributes:
        settings: the core's
        write_back: show the light in material copies, or add uv maps and images only
        folder: where the pages go, absolute; None packs them into the .blend
        stem: what the pages' names begin with, unless another scene of the file has pages of these names there
        objects: names of those to bake, while all others only shadow and bounce; empty bakes all
        page_format: how the pages are written
        looked_at: the report gets figures and maps of the light
    """

    settings: BakeSettings
    write_back: Literal["preview", "uv"]
    folder: Path | None
    stem: str
    objects: Sequence[str] = ()
    page_format: PageFormat = field(default_factory=PageFormat)
    looked_at: bool = False


def bake_scene(
    scene: bpy.types.Scene, job: Job, files: Transaction, seat: Seat | None = None
) -> Generator[Progress, None, Report]:
    """Bake a scene and show the light in it.

    Closing the generator, or an error, leaves the scene as it was found. The pages are put in place; whether they
    stay is decided by `files`.

    Args:
        seat: for who looks on in a window: all that needs no Blender then runs in threads, and steps are short

    Raises:
        BakeError: with the object or file, the cause and the remedy
    """
    start = time.perf_counter()
    scene_name, shares = scene.name, stage_shares(scene)
    with ExitStack() as stack:
        folder = job.folder or Path(stack.enter_context(_folder_to_pack()))
        job = replace(job, stem=free_stem(job.stem, scene, folder))
        files.make_folder(folder)
        files.lock(folder)
        reading = Progress("Read scene", 0.0)
        yield reading
        reader = yield from _as_part_of(reading, read_scene(scene, job.objects or None))
        cycles = _asked(seat, stack)
        if reader.ask_cycles:
            cycles.prepare()
        viewer_of = seat.taken(scene) if seat is not None else None

        def steps() -> Generator[Progress, None, tuple[Extraction, float, Baked]]:
            extraction = yield from _as_part_of(reading, reader.extraction(cycles))
            read = time.perf_counter()
            shade = CyclesShader(scene_name, extraction, cycles)
            viewer = viewer_of and viewer_of(extraction)
            baking = bake(extraction.scene, job.settings, shade, viewer, shares)
            baked = yield from _scaled(_while_asked(cycles, baking))
            return extraction, read, baked

        extraction, read, baked = yield from steps() if seat is None else in_thread(steps(), reading, seat.main)
        last = Progress("Write files", READING_SHARE + BAKING_SHARE, baked.residual, baked.rays)
        begin = time.perf_counter()
        paths = page_paths(folder, job.stem, len(baked.pages), job.page_format.suffix)
        writing = _written(last, job, folder, paths, baked, extraction.scene.working_space, files)
        written, apart, seen, maps = yield from writing if seat is None else in_thread(writing, last)
        on_disk = time.perf_counter()
        last = replace(last, stage="Write back")
        yield last
        writing_back = write_back(
            _still_there(scene_name),
            extraction,
            baked.atlas,
            paths,
            recipe=written.recipe,
            mode=job.write_back,
            pack=job.folder is None,
            apart={name: apart[name] for name in apart if any(page.any() for page in baked.apart[name])},
        )
        rows, images = yield from _as_part_of(last, writing_back)
        for row, kept in zip(images, maps, strict=True):
            bpy.data.images[row["image"]][TEXELS_KEY] = kept
    end = time.perf_counter()
    own = range(len(extraction.sources))
    lit = [index for index in own if 0 <= baked.atlas.page[index] < baked.atlas.page_count]
    texels = baked.mesh_texels.copy()
    for front, back in backs_of(extraction.scene.meshes).items():
        texels[front] += texels[back]
    report = Report(
        pages=[
            Page(row["image"], job.folder and Path(row["file"]), tuple(row["size"]), seen.maps[page] if seen else {})
            for page, row in enumerate(images)
        ],
        objects=[BakedObject(**row, texels=int(texels[index])) for row, index in zip(rows, lit, strict=True)],
        skipped=extraction.skipped,
        stages=[
            ("Read scene", read - start, 0),
            *((stage.name, stage.seconds, stage.rays) for stage in baked.stages),
            ("Write files", on_disk - begin, 0),
            ("Write back", end - on_disk, 0),
        ],
        seconds=end - start,
        texels=baked.texels,
        patches=baked.patches,
        rays=baked.rays,
        tracing=sum((stage.tally for stage in baked.stages), NO_RAYS),
        residual=baked.residual,
        name=job.stem,
        working_space=extraction.scene.working_space,
        settings=job.settings,
        residuals=baked.residuals,
        error=baked.error,
        balance=baked.balance,
        overview=seen,
        files=written,
        warnings=[
            *baked.warnings,
            *_clamped_warnings(paths, written.clamped, job.page_format),
            *_mapped_warning(written),
            *_unmixed_warning(apart),
        ],
        ended_in=baked.ended_in,
        light_groups={name: own for name, (own, _) in apart.items()} if job.folder else {},
    )
    keep_report(_still_there(scene_name), report)
    return report


def _asked(seat: Seat | None, stack: ExitStack) -> Cycles:
    """Who asks Cycles, until the stack is left."""
    if seat is None:
        return Cycles()
    return Cycles(seat.main.runs, stack.enter_context(SecondBlender()) if seat.second_blender else None)


def _while_asked(cycles: Cycles, steps: Generator[Progress, None, T]) -> Generator[Progress, None, T]:
    """The same steps of a bake. From direct light on they ask Cycles nothing more."""
    try:
        while True:
            try:
                progress = next(steps)
            except StopIteration as stop:
                result: T = stop.value
                return result
            if progress.stage == "Direct light":
                cycles.end()
            yield progress
    finally:
        steps.close()


def _written(
    last: Progress,
    job: Job,
    folder: Path,
    paths: Sequence[Path],
    baked: Baked,
    working: RGBSpace,
    files: Transaction,
) -> Generator[Progress, None, tuple[PageFiles, Apart, Overview | None, list[bytes]]]:
    """Write the pages, look at them if that is wanted, and pack what each texel was for the overlays."""
    yield last
    wanted, workers = job.page_format, job.settings.workers
    written = write_pages(baked.pages, paths, wanted, working, files, workers)
    if job.folder is not None:
        _describe(folder, job.stem, paths, written, wanted, files)
    apart: Apart = {}
    for name, stem in group_stems(job.stem, list(baked.apart)).items():
        yield last
        own = page_paths(folder, stem, len(baked.pages), wanted.suffix)
        of_group = write_pages(baked.apart[name], own, wanted, working, files, workers)
        _describe(folder, stem, own, of_group, wanted, files)
        apart[name] = own, of_group.recipe
    yield last
    maps = [packed(texel_map(baked.elements, baked.patch, page)) for page in range(len(baked.pages))]
    yield last
    if not job.looked_at:
        return written, apart, None, maps
    return written, apart, overview(baked.pages, baked.elements, paths, written, wanted, working, workers), maps


def _folder_to_pack() -> tempfile.TemporaryDirectory[str]:
    """For pages that go into the .blend; of a bake that is cancelled a thread may still be writing there."""
    return tempfile.TemporaryDirectory(prefix="radiosity-", ignore_cleanup_errors=True)


def _as_part_of(progress: Progress, steps: Generator[object, None, T]) -> Generator[Progress, None, T]:
    """Steps of a stage that can't tell how far it is."""
    try:
        while True:
            next(steps)
            yield replace(progress)
    except StopIteration as stop:
        result: T = stop.value
        return result
    finally:
        steps.close()


def _describe(
    folder: Path, stem: str, paths: Sequence[Path], written: PageFiles, wanted: PageFormat, files: Transaction
) -> None:
    """Say beside the pages how to read them; an EXR says by itself what it holds."""
    if wanted.format != "exr":
        write_sidecar(sidecar_path(folder, stem), paths, written.recipe, files)


def _unmixed_warning(apart: Apart) -> list[str]:
    if len(apart) <= MOST_GROUPS:
        return []
    return [f"There are {len(apart)} light groups, but only {MOST_GROUPS} can be mixed in a material; use fewer"]


def _scaled(steps: Generator[Progress, None, Baked]) -> Generator[Progress, None, Baked]:
    """The core's progress as part of the whole."""
    try:
        while True:
            progress = next(steps)
            left = None if progress.left is None else progress.left / BAKING_SHARE
            yield replace(progress, fraction=READING_SHARE + BAKING_SHARE * progress.fraction, left=left)
    except StopIteration as stop:
        baked: Baked = stop.value
        return baked
    finally:
        steps.close()


def _still_there(name: str) -> bpy.types.Scene:
    """The scene by name: a reference kept while a person goes on working may point nowhere."""
    scene = bpy.data.scenes.get(name)
    if scene is None:
        raise SceneError(name, "the scene was renamed or deleted during the bake", "Bake again")
    return scene


def _clamped_warnings(paths: Sequence[Path], clamped: Sequence[int], wanted: PageFormat) -> list[str]:
    numbers = f"{wanted.depth} floats" if wanted.format == "exr" else wanted.format
    return [
        f"{path.name}: {count} values that {numbers} can't hold were clamped"
        for path, count in zip(paths, clamped, strict=True)
        if count
    ]


def _mapped_warning(written: PageFiles) -> list[str]:
    if written.outside < LEAST_TOLD:
        return []
    recipe = written.recipe
    holds = f"{recipe.format} in {recipe.space.name}"
    return [
        f"{written.outside:.1%} of the texels lay outside of what {holds} holds; intent {recipe.intent} fitted them"
    ]
