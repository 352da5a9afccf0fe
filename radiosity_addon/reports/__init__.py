# SPDX-License-Identifier: GPL-3.0-or-later
"""The certificate of a bake, in figures and pictures."""
