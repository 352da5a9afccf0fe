# SPDX-License-Identifier: GPL-3.0-or-later
"""The child process that runs xatlas: what it fails at, and that nothing of it is left."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from radiosity_addon.atlas import xatlas_process
from radiosity_addon.atlas.overlap import overlapping
from radiosity_addon.atlas.unwrap import build_atlas
from radiosity_addon.errors import BakeError
from radiosity_addon.scene import Material, Scene
from radiosity_addon.settings import BakeSettings
from tests.unwrapped import (
    assert_sound,
    atlas_of,
    flat_area,
    make_bevelled_box,
    make_box,
    make_grid,
    make_sphere,
    make_tube,
)


def test_a_noisy_surface_is_unwrapped_in_seconds():
    mesh = make_grid("noise", 80, height=1.0)  # 12,800 triangles: unlimited charts take xatlas about 15 s
    atlas = atlas_of([mesh], page_size=512)
    flat = flat_area(atlas.uv[0])
    assert (flat > 0).all()
    assert not atlas.warnings
    assert len(overlapping(atlas.uv[0].astype(np.float64), np.zeros(len(flat), np.int64))) == 0


def test_a_surface_too_rough_for_xatlas_is_unwrapped_plainly_with_a_warning(monkeypatch):
    monkeypatch.setattr("radiosity_addon.atlas.parametrize.ROUGH_COUNT", 4000)
    mesh = make_grid("noise", 50, height=1.5)
    atlas = atlas_of([mesh], page_size=256)
    assert "noise: 5000 rough faces" in atlas.warnings[0]
    assert_sound(atlas, [mesh], gap=2)


WORKER_THAT = {
    "crashes": "import os; os.abort()",
    "hangs": "import time; time.sleep(60)",
}


@pytest.mark.parametrize("what", WORKER_THAT)
def test_a_child_that_fails_leaves_a_plain_unwrap_and_a_warning(what, monkeypatch, tmp_path):
    worker = tmp_path / "worker.py"
    worker.write_text(WORKER_THAT[what])
    monkeypatch.setattr(xatlas_process, "WORKER", worker)
    monkeypatch.setattr(xatlas_process, "DEADLINE_SECONDS", 0.3)
    meshes = [make_box("a"), make_tube("b")]
    atlas = atlas_of(meshes, page_size=256)
    assert [warning.split(":")[0] for warning in atlas.warnings] == ["a", "b"]
    assert_sound(atlas, meshes, gap=2)


def test_a_mesh_that_crashes_xatlas_does_not_take_the_others_with_it(monkeypatch, tmp_path):
    worker = tmp_path / "worker.py"
    text = xatlas_process.WORKER.read_text(encoding="utf-8")
    worker.write_text(
        text.replace(
            "            atlas = xatlas.Atlas()", "            1 / (job != 1)\n            atlas = xatlas.Atlas()"
        )
    )
    monkeypatch.setattr(xatlas_process, "WORKER", worker)
    meshes = [make_box("a"), make_bevelled_box("b"), make_sphere("c")]
    atlas = atlas_of(meshes, page_size=256)
    assert [warning.split(":")[0] for warning in atlas.warnings] == ["b"]
    assert_sound(atlas, meshes, gap=2)


def test_a_child_stuck_between_two_meshes_costs_neither_its_charts(monkeypatch, tmp_path):
    """xatlas may wait for ever when an atlas is destroyed."""
    meshes = [make_box("a"), make_bevelled_box("b"), make_sphere("c")]
    undisturbed = atlas_of(meshes, page_size=256)
    worker = tmp_path / "worker.py"
    text = xatlas_process.WORKER.read_text(encoding="utf-8")
    stuck = (
        "            del atlas\n            if job == 0:\n                import time\n                time.sleep(60)\n"
    )
    worker.write_text(text.replace("            del atlas\n", stuck))
    monkeypatch.setattr(xatlas_process, "WORKER", worker)
    monkeypatch.setattr(xatlas_process, "PAUSE_SECONDS", 0.2)
    atlas = atlas_of(meshes, page_size=256)
    assert not atlas.warnings
    for found, wanted in zip(atlas.uv, undisturbed.uv, strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_a_missing_xatlas_is_a_clear_error(monkeypatch, tmp_path):
    worker = tmp_path / "worker.py"
    worker.write_text("import sys; sys.stderr.write('No module named xatlas'); sys.exit(3)")
    monkeypatch.setattr(xatlas_process, "WORKER", worker)
    with pytest.raises(BakeError, match=r"xatlas: it can't be started \(No module named xatlas\)"):
        atlas_of([make_box()])


def test_closing_the_generator_ends_the_child_and_leaves_no_files(monkeypatch, tmp_path):
    worker = tmp_path / "worker.py"
    worker.write_text(WORKER_THAT["hangs"])
    monkeypatch.setattr(xatlas_process, "WORKER", worker)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    started = []
    popen = subprocess.Popen

    def start(*arguments, **more):
        started.append(popen(*arguments, **more))
        return started[-1]

    monkeypatch.setattr(subprocess, "Popen", start)
    steps = build_atlas(Scene((make_box(),), (Material("grey"),)), BakeSettings())
    while not started:
        next(steps)
    next(steps)
    assert started[0].poll() is None
    assert len(list(tmp_path.iterdir())) == 2
    steps.close()
    assert started[0].poll() is not None
    assert [path.name for path in tmp_path.iterdir()] == ["worker.py"]


def test_the_worker_runs_alone():
    text = xatlas_process.WORKER.read_text(encoding="utf-8")
    assert "from ." not in text
    assert "radiosity_addon" not in text
    assert (
        subprocess.run([sys.executable, "-I", "-S", xatlas_process.WORKER, "a", "b", "0"], check=False).returncode == 3
    )
