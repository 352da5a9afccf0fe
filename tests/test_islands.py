# SPDX-License-Identifier: GPL-3.0-or-later
"""Charts of a uv map, and where they end."""

import numpy as np

from radiosity_addon.atlas.islands import borders, uv_charts

STRIP = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
"""Two quads side by side, in four triangles."""
FLAT = np.float32([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]])[STRIP]


def cut():
    """The map of the strip with its right quad moved away."""
    uv = FLAT.copy()
    uv[2:] += 1
    return uv


def test_a_map_in_one_piece_is_one_chart_with_the_outline_as_its_border():
    chart, corner = uv_charts(STRIP, FLAT)
    assert chart.tolist() == [0, 0, 0, 0]
    assert borders(corner).tolist() == [0, 4, 5, 6, 7, 10]


def test_a_cut_makes_two_charts_and_a_seam_on_both_sides():
    chart, corner = uv_charts(STRIP, cut())
    assert chart.tolist() == [0, 0, 1, 1]
    seam = set(borders(corner).tolist()) - {0, 4, 5, 6, 7, 10}
    assert seam == {1, 11}  # from vertex 1 to 4, and back


def test_what_touches_in_the_map_alone_is_not_connected():
    vertex = STRIP.copy()
    vertex[2:] += 6
    assert uv_charts(vertex, FLAT)[0].tolist() == [0, 0, 1, 1]


def test_nothing_has_no_border():
    assert len(borders(np.zeros((0, 3), np.int64))) == 0
