# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials and their nodes: what they say of a surface, and copies that are shown in their place."""
