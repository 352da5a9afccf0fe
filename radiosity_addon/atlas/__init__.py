# SPDX-License-Identifier: GPL-3.0-or-later
"""Places for surfaces: charts, and the pages that they are packed on."""
