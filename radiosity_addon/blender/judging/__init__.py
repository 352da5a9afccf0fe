# SPDX-License-Identifier: GPL-3.0-or-later
"""Tools in the 3D view that judge a bake: overlays and a light meter."""
