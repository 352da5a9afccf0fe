# SPDX-License-Identifier: GPL-3.0-or-later
"""The arguments of the command line, and what they ask for."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from .color.gamut import INTENTS
from .color.spaces import SPACES
from .errors import OutputError, SceneError
from .pages.page_format import COMPRESSIONS, DEPTHS, FORMATS, TRANSFERS, PageFormat
from .settings import FORM_FACTOR_NAMES, QUALITIES, SOLVER_NAMES, BakeSettings

PASS_SOLVERS = ("jacobi", "progressive")
"""Solvers whose passes can be shown."""


@dataclass(frozen=True)
class Verb:
    """What a verb such as `bake` was asked for. None is: as saved in the scene, or not at all."""

    name: str
    scene: Path
    output: Path | None = None
    textures: Path | None = None
    report: Path | None = None
    render: Path | None = None
    render_before: Path | None = None
    density: float | None = None
    fine_folds: bool | None = None
    page_size: int | None = None
    quality: str | None = None
    form_factors: str | None = None
    solver: str | None = None
    tolerance: float | None = None
    bounces: str | int | None = None
    threads: int | None = None
    light_groups: bool | None = None
    write_back: str | None = None
    format: str | None = None
    depth: str | None = None
    compression: str | None = None
    exposure: float | None = None
    transfer: str | None = None
    space: str | None = None
    intent: str | None = None
    object: tuple[str, ...] = ()
    passes: tuple[int, ...] | None = None
    splits: tuple[int, ...] | None = None
    subdivisions: int | None = None
    picture: Path | None = None
    gltf: bool | None = None
    quiet: bool = False


def parser(opened: str | None) -> argparse.ArgumentParser:
    """The words that the command line knows.

    Args:
        opened: under `blender --command`, the path of the .blend that is open, "" if there is none
    """
    words = argparse.ArgumentParser(
        prog="radiosity" if opened is None else "blender --command radiosity",
        description="Bake the light of a Blender scene, all bounces included, into lightmaps.",
    )
    verbs = words.add_subparsers(dest="verb", required=True, metavar="VERB")

    bake = verbs.add_parser("bake", help="bake a scene and save it lit", description="Bake a scene and save it lit.")
    _add_scene(bake, "the scene to bake; never written to unless -o names it", opened)
    bake.add_argument("-o", dest="output", type=_blend, required=True, metavar="BAKED.blend", help="the lit scene")
    bake.add_argument("--textures", type=Path, metavar="DIR", help="folder of the pages; default: BAKED_textures")
    _add_density(bake)
    bake.add_argument("--quality", choices=QUALITIES, help=f"numbers of rays; default: {BakeSettings.quality}")
    bake.add_argument(
        "--form-factors",
        choices=FORM_FACTOR_NAMES,
        help="how they are estimated: by cosine-distributed rays, through hemicubes, or by the double-area integral; "
        f"default: {BakeSettings.form_factors}",
    )
    bake.add_argument(
        "--solver",
        choices=SOLVER_NAMES,
        help=f"how the equation is solved; all end alike; default: {BakeSettings.solver}",
    )
    bake.add_argument(
        "--subdivisions",
        type=int,
        metavar="N",
        help="how often patches are split where radiosity changes across them; default: 0",
    )
    bake.add_argument(
        "--tolerance",
        type=float,
        metavar="F",
        help=f"share of the light left to bounce at the end; default: {BakeSettings.tolerance:g}",
    )
    bake.add_argument(
        "--bounces",
        type=_bounces,
        metavar="all|scene|N",
        help="how often light is reflected: until none is left, as often as Cycles may, or N times; default: all",
    )
    bake.add_argument(
        "--light-groups",
        action="store_true",
        default=None,
        help="write the light of each light group to pages of its own, too",
    )
    bake.add_argument(
        "--write-back",
        choices=("preview", "uv"),
        help="preview: materials show the light; uv: uv maps and images only; default: preview",
    )
    _add_format(bake)
    bake.add_argument("--report", type=Path, metavar="FILE.json", help="write figures of the bake")
    bake.add_argument("--render", type=_png, metavar="PICTURE.png", help="render the lit scene")
    bake.add_argument(
        "--render-before",
        type=_png,
        metavar="PICTURE.png",
        help="render the scene as lit by its lamps",
    )
    bake.add_argument(
        "--object", nargs="+", action="extend", default=[], metavar="NAME", help="bake these objects only"
    )
    bake.add_argument("--threads", type=int, metavar="N", help="worker threads; default: 0, one a processor")
    bake.add_argument("--quiet", action="store_true", help="print errors only")

    revert = verbs.add_parser(
        "revert", help="take a bake out of a scene again", description="Take a bake out of a scene again."
    )
    _add_scene(revert, "a baked scene", opened)
    revert.add_argument(
        "-o", dest="output", type=_blend, required=True, metavar="OUT.blend", help="the scene as before"
    )

    export = verbs.add_parser(
        "export",
        help="write a bake's lightmaps and a glTF file for game engines and the web",
        description="Write a baked scene's lightmaps, how to read and place them, and a glTF file that shows them.",
    )
    _add_scene(export, "a baked scene", opened)
    export.add_argument("-o", dest="output", type=Path, required=True, metavar="FOLDER", help="where the files go")
    _add_format(export)
    export.add_argument("--no-gltf", dest="gltf", action="store_false", default=None, help="write no .glb file")
    export.add_argument("--quiet", action="store_true", help="print errors only")

    passes = verbs.add_parser(
        "passes",
        help="a contact sheet of a scene after so many passes of a solver",
        description="Render a scene after each of some passes of a solver, side by side.",
    )
    _add_scene(passes, "the scene to look at", opened)
    passes.add_argument(
        "--solver",
        choices=PASS_SOLVERS,
        default=PASS_SOLVERS[0],
        help="jacobi: light after so many bounces less one; progressive: after so many shots, as the patches have it, "
        "above without and below with a guess at what is still to come; default: %(default)s",
    )
    passes.add_argument(
        "--passes", type=_numbers, metavar="N,N,...", help="default: 1,2,3,6 for jacobi, 1,10,100,1000 for progressive"
    )
    passes.add_argument(
        "--subdivisions",
        dest="splits",
        type=_splits,
        metavar="N,N,...",
        help="in place of passes: the patches after so many adaptive subdivisions, with and without their edges",
    )
    passes.add_argument("--picture", type=_png, required=True, metavar="SHEET.png", help="the contact sheet")
    passes.add_argument("--quality", choices=QUALITIES, help=f"numbers of rays; default: {BakeSettings.quality}")
    _add_density(passes)
    passes.add_argument("--quiet", action="store_true", help="print errors only")

    report = verbs.add_parser(
        "report",
        help="make a page to look at of what `bake --report` has written",
        description="Make one HTML page, pictures inside, of a bake's report.",
    )
    report.add_argument("scene", type=Path, metavar="REPORT.json", help="what `bake --report` has written")
    report.add_argument("-o", dest="output", type=_html, required=True, metavar="PAGE.html", help="the page")

    info = verbs.add_parser(
        "info", help="list what would be baked, and what not and why", description="List what would be baked."
    )
    _add_scene(info, "the scene to look at", opened)
    _add_density(info)
    return words


def _add_scene(verb: argparse.ArgumentParser, text: str, opened: str | None) -> None:
    nargs = None if opened is None else "?"
    verb.add_argument("scene", type=Path, nargs=nargs, metavar="SCENE.blend", help=text)


def _add_density(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--density", type=float, metavar="F", help="texels per metre; default: fill one page")
    verb.add_argument(
        "--fine-folds",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="give curtains and the like, that fold within few texels, finer ones than others; default: as the scene",
    )
    verb.add_argument(
        "--page-size", type=int, metavar="N", help=f"texels along a page's edge; default: {BakeSettings.page_size}"
    )


def _add_format(verb: argparse.ArgumentParser) -> None:
    plain = PageFormat()
    verb.add_argument("--format", choices=FORMATS, help=f"of the pages; default: {plain.format}")
    verb.add_argument("--depth", choices=DEPTHS, help=f"of exr: bits a channel, 16 or 32; default: {plain.depth}")
    verb.add_argument("--compression", choices=COMPRESSIONS, help=f"of exr, lossless; default: {plain.compression}")
    verb.add_argument("--exposure", type=float, metavar="STOPS", help="of png8 and png16: brightens them; default: 0")
    verb.add_argument("--transfer", choices=TRANSFERS, help=f"of png8 and png16; default: {plain.transfer}")
    verb.add_argument(
        "--target-space",
        dest="space",
        choices=SPACES,
        help="primaries of the pages; default: rec709 for png8 and png16, the scene's working space otherwise",
    )
    verb.add_argument(
        "--intent",
        choices=INTENTS,
        help=f"what happens to colours that the pages can't hold; default: {plain.intent}",
    )


def _blend(text: str) -> Path:
    return _path_with(text, ".blend")


def _png(text: str) -> Path:
    return _path_with(text, ".png")


def _bounces(text: str) -> str | int:
    if text in ("all", "scene"):
        return text
    try:
        return int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is neither all, scene nor a number") from error


def _numbers(text: str, least: int = 1) -> tuple[int, ...]:
    try:
        numbers = tuple(int(part) for part in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} are no numbers parted by commas") from error
    if min(numbers) < least:
        raise argparse.ArgumentTypeError(f"{text!r}: the first is {least}")
    return numbers


def _splits(text: str) -> tuple[int, ...]:
    return _numbers(text, 0)


def _html(text: str) -> Path:
    return _path_with(text, ".html")


def _path_with(text: str, suffix: str) -> Path:
    if Path(text).suffix.lower() != suffix:
        raise argparse.ArgumentTypeError(f"{text!r} does not end in {suffix}")
    return Path(text).absolute()


def verb_of(options: argparse.Namespace, opened: str | None) -> Verb:
    """What was asked for, once it is clear that it can be done.

    Raises:
        SceneError: there is no such scene
        OutputError: two files would have one name
    """
    given = dict(vars(options))
    scene = given.pop("scene") or (Path(opened) if opened else None)
    if scene is None:
        raise SceneError("Scene", "no .blend file is open", "Give the path of one that exists")
    if not scene.is_file():
        cause = "it is a folder" if scene.is_dir() else "there is no such file"
        wanted = "report that `bake` has written" if given["verb"] == "report" else ".blend file"
        raise SceneError(str(scene), cause, f"Give the path of a {wanted}")
    for name in ("textures", "report", "output"):
        if given.get(name) is not None:
            given[name] = given[name].absolute()
    given["object"] = tuple(given.get("object", ()))
    verb = Verb(name=given.pop("verb"), scene=scene.absolute(), **given)
    _check_apart(verb)
    return verb


def _check_apart(verb: Verb) -> None:
    """Whether no file would replace another one of the same bake, or the scene by something that is none.

    Raises:
        OutputError: two names are one file
    """
    taken = {path.resolve() for path in (verb.scene, verb.output) if path}
    for path in filter(None, (verb.report, verb.render, verb.render_before, verb.picture)):
        if path.resolve() in taken:
            raise OutputError(str(path), "another file of this bake has this name", "Choose another file name")
        taken.add(path.resolve())
