# SPDX-License-Identifier: GPL-3.0-or-later
"""From the open scene to the core's records, with Cycles asked where nobody else can tell."""
