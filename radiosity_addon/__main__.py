# SPDX-License-Identifier: GPL-3.0-or-later
"""`python -m radiosity_addon`."""

from .cli import program

if __name__ == "__main__":
    program()
