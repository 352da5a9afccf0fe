# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's data as they are: names, evaluated objects, splines, instances, stand-ins."""
