# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour: tristimulus values, RGB spaces, colour models, differences, and gamut mapping. NumPy alone."""
