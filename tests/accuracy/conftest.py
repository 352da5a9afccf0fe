# SPDX-License-Identifier: GPL-3.0-or-later
"""The suite's table, at the end of pytest's output."""

from __future__ import annotations

import pytest

HEADER = f"{'scene':14} {'quality':7} {'probes':>6} out " + " ".join(
    f"{column:>7}" for column in ("RMS", "bias", "99 %", "noise", "> 20 %", "RMS all")
)
ROWS = pytest.StashKey[list[str]]()


@pytest.fixture(scope="session")
def table(request: pytest.FixtureRequest) -> list[str]:
    """Lines to be shown in the end."""
    return request.config.stash.setdefault(ROWS, [])


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    rows = terminalreporter.config.stash.get(ROWS, [])
    if rows:
        terminalreporter.section("bakes against Cycles, errors as shares of a scene's mean")
        for row in [HEADER, *rows]:
            terminalreporter.write_line(row)
