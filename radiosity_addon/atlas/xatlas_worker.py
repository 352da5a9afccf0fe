# SPDX-License-Identifier: GPL-3.0-or-later
"""The child process that runs xatlas, which holds the GIL, may hang and may crash.

Started by path (`python xatlas_worker.py JOBS.npz OUTPUT FIRST SITE...`), so it knows nothing of the package; the
folders of NumPy and xatlas are handed over. JOBS holds the meshes one after the other. OUTPUT grows by records of
RECORD_BYTES: an empty one when a job begins, then its charts as F of six float32 uv and one int32 chart (-1: xatlas
dropped the triangle). So the file's length tells how far the child is, and what is written survives when it is killed.

Between two jobs an atlas is destroyed, which once in some hundred thousand times waits for ever: xatlas tells its
threads to end without holding their locks, and one that is just about to sleep misses that. Whoever watches sees a job
finished and none begun.
"""

import sys

RECORD_BYTES = 28
CANNOT_LOAD = 3
"""Exit code: NumPy or xatlas can't be imported."""

TEXELS_PER_UNIT = 0.1
"""xatlas packs what it cuts, which isn't used; few texels make that fast. Meshes arrive with a radius of 1000."""


def main(arguments: list[str]) -> int:
    """Run the jobs from the given one on; returns the exit code."""
    jobs_path, output_path, first, *sites = arguments
    sys.path.extend(sites)
    try:
        import numpy as np
        import xatlas
    except (ImportError, OSError) as error:
        sys.stderr.write(str(error))
        return CANNOT_LOAD
    with np.load(jobs_path) as jobs:
        positions, triangles, max_area = jobs["positions"], jobs["triangles"], jobs["max_area"]
        vertex_first, triangle_first = jobs["vertex_first"], jobs["triangle_first"]
    with open(output_path, "ab") as output:
        for job in range(int(first), len(max_area)):
            points = positions[vertex_first[job] : vertex_first[job + 1]]
            corners = triangles[triangle_first[job] : triangle_first[job + 1]]
            output.write(bytes(RECORD_BYTES))
            output.flush()
            atlas = xatlas.Atlas()
            atlas.add_mesh(points, corners)
            cutting = xatlas.ChartOptions()
            cutting.max_chart_area = float(max_area[job])
            packing = xatlas.PackOptions()
            packing.padding = 0
            packing.texels_per_unit = TEXELS_PER_UNIT
            atlas.generate(cutting, packing)
            source, indices, uv = atlas[0]
            _, chart = atlas.get_mesh_vertex_assignment(0)
            records = np.zeros(len(corners), dtype=[("uv", "<f4", (3, 2)), ("chart", "<i4")])
            indices = indices.reshape(-1, 3)
            records["chart"] = -1
            if len(indices) == len(corners) and np.array_equal(source[indices], corners):
                records["uv"] = uv[indices] * np.array([atlas.width, atlas.height], np.float32)
                whole = (chart[indices] == chart[indices][:, :1]).all(axis=1)
                records["chart"] = np.where(whole, chart[indices][:, 0].astype(np.int32), -1)
            output.write(records.tobytes())
            output.flush()
            del atlas
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
