# SPDX-License-Identifier: GPL-3.0-or-later
"""Direct light: lamps, emissive surfaces, the sky, and their shadows."""
