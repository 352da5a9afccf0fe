# SPDX-License-Identifier: GPL-3.0-or-later
"""The final gather: from patches to smooth indirect light at every texel."""
