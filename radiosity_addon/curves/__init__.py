# SPDX-License-Identifier: GPL-3.0-or-later
"""Splines and what is made of them: NURBS, tubes, and their nets unrolled."""
