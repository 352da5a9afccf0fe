# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes without a window: the command line's part of Blender, and rendered pictures."""
