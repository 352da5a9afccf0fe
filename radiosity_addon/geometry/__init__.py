# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces, the texels on them, and what rays meet."""
