# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: `python -m radiosity_addon`, `radiosity`, and `blender --command radiosity`.

Blender is imported by a verb at work, so that help and usage errors need none.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import signal
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

from .arguments import Verb, parser, verb_of
from .errors import BakeError, explained
from .progress import Meter, short_count
from .reports.report_page import write_report_page

if TYPE_CHECKING:
    from .reports.report import Report

DONE, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130
"""Exit codes: done, an error, wrong arguments, stopped by Ctrl-C."""
TRACEBACK_VARIABLE = "RADIOSITY_TRACEBACK"
"""Environment variable that, when set, shows where an internal error came from."""


def main(argv: Sequence[str] | None = None, opened: str | None = None) -> int:
    """Run one command.

    Args:
        argv: arguments after the program's name; the process's own by default
        opened: under `blender --command`, the path of the .blend that is open, "" if there is none

    Returns:
        0 done, 1 an error that was printed, 2 wrong arguments, 130 interrupted
    """
    try:
        options = parser(opened).parse_args(argv)
    except SystemExit as stop:
        return DONE if not stop.code else USAGE
    meter = Meter(sys.stdout, getattr(options, "quiet", False))
    try:
        with _interruptible():
            _run(verb_of(options, opened), options.scene is None, meter)
    except KeyboardInterrupt:
        _fail(meter, "interrupted; all files are as they were")
        return INTERRUPTED
    except Exception as error:  # noqa: BLE001 whatever it is, the user gets one line
        if not isinstance(error, BakeError) and os.environ.get(TRACEBACK_VARIABLE):
            traceback.print_exc()
        return _fail(meter, f"error: {explained(error)}")
    return DONE


def program() -> NoReturn:
    """`main` as a process of its own."""
    code = main()
    bpy = sys.modules.get("bpy")
    if bpy is None or bpy.app.version >= (5, 0):
        sys.exit(code)
    # The module bpy 4 ends its threads when it is freed. Where anything still refers to it when Python ends, as after
    # Ctrl-C, it never is, and the destructors of its library then wait for ever for a thread that nobody ends.
    shutil.rmtree(bpy.app.tempdir, ignore_errors=True)  # which Blender would have removed
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _run(verb: Verb, is_open: bool, meter: Meter) -> None:
    if verb.name == "report" and verb.output:
        write_report_page(verb.scene, verb.output)
        meter.say(f"Saved {verb.output}")
        return
    if importlib.util.find_spec("bpy") is None:
        raise BakeError(
            "Blender", "its Python module bpy is not installed", "Run `pip install .` on Python 3.11 or 3.13"
        )
    from .blender import registered
    from .blender.data import blend_files
    from .blender.headless import commands
    from .blender.headless.passes import contact_sheet

    with registered():
        if not is_open:
            blend_files.open_blend(verb.scene)
        if verb.name == "bake":
            _say_result(commands.bake(verb, meter), verb, meter)
        elif verb.name == "export":
            exported = commands.export(verb)
            _say_warnings(exported.warnings, verb, meter)
            meter.say(exported.summary())
        elif verb.name == "passes":
            contact_sheet(verb, meter)
            meter.say(f"Saved {verb.picture}")
        elif verb.name == "revert":
            commands.revert(verb)
            meter.say(f"Saved {verb.output}")
        else:
            meter.say(commands.info(verb))


def _say_warnings(warnings: Sequence[str], verb: Verb, meter: Meter) -> None:
    if not verb.quiet:
        for warning in warnings:
            meter.clear()
            print(f"radiosity: warning: {warning}", file=sys.stderr)


def _say_result(report: Report, verb: Verb, meter: Meter) -> None:
    _say_warnings(report.warnings, verb, meter)
    figures = f"{report.texels:,} texels, {report.patches:,} patches, {short_count(report.rays)} rays"
    error = f", estimated error {report.error.rms:.1%}" if report.error else ""
    meter.say(f"{report.summary()}: {figures}, residual {report.residual:.2g}{error}")
    meter.say(f"Saved {verb.output}")


def _fail(meter: Meter, line: str) -> int:
    meter.clear()
    print(f"radiosity: {line}", file=sys.stderr)
    return FAILED


@contextmanager
def _interruptible() -> Iterator[None]:
    """Turn the first Ctrl-C, or a request to terminate, into KeyboardInterrupt; Blender by itself would not."""
    stopping = False

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal stopping
        if not stopping:  # a second one must not break the cleaning up
            stopping = True
            raise KeyboardInterrupt

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)  # None: it was not Python's
