# SPDX-License-Identifier: GPL-3.0-or-later
"""Run by a second Blender: does what the first one asks on the standard input, and answers on the standard output.

    blender --background --factory-startup --python second_blender_worker.py -- PACKAGE HOME FOLDER

PACKAGE is the name that our package has in the first Blender, HOME where it lies, FOLDER what to take away if the first
one dies: then the standard input ends.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import pickle
import shutil
import sys
import threading
import traceback
from pathlib import Path
from queue import SimpleQueue
from types import ModuleType
from typing import Any

READY = b"radiosity: ready"


def main(package: str, home: str, folder: str) -> None:
    """Answer until the other side has gone."""
    answers = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)  # what Blender itself prints is no answer
    os.close(nowhere)
    imported(package, Path(home))
    parts = [importlib.import_module(f"{package}.{name}") for name in ("chunks", "blender.reading.subject")]
    finish, take_over = parts[0].finish, parts[1].take_over
    asked: SimpleQueue[Any] = SimpleQueue()
    threading.Thread(target=listen, args=(asked, folder), daemon=True).start()
    answers.write(b"\n" + READY + b"\n")
    answers.flush()
    while True:
        work, handed, arguments = asked.get()
        try:
            answer = True, finish(work(take_over(handed), *arguments))
        except Exception:  # noqa: BLE001 the other side does the work itself, and sees what happens then
            answer = False, traceback.format_exc()
        pickle.dump(answer, answers, pickle.HIGHEST_PROTOCOL)
        answers.flush()


def imported(name: str, home: Path) -> ModuleType:
    """The package at a place, by any name: what is pickled there and here is of modules of the same names."""
    spec = importlib.util.spec_from_file_location(name, home / "__init__.py", submodule_search_locations=[str(home)])
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def listen(asked: SimpleQueue[Any], folder: str) -> None:
    """Take in what is asked; end, whatever is being done, when no one can ask any more."""
    try:
        while True:
            asked.put(pickle.load(sys.stdin.buffer))
    except (EOFError, OSError):
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(0)


if __name__ == "__main__":
    import bpy

    if bpy.app.module:  # has no render engines before
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    main(*sys.argv[sys.argv.index("--") + 1 :])
