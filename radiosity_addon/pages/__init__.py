# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages of light: whole, without seams, and as files."""
