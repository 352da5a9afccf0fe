# SPDX-License-Identifier: GPL-3.0-or-later
"""Light between surfaces: patches, form factors, and the equation that joins them."""
