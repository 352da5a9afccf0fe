# SPDX-License-Identifier: GPL-3.0-or-later
"""Lightmaps back onto the scene, and out of it again."""
