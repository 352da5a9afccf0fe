# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors that a user can act on; anything else that is raised is a defect of ours."""

from __future__ import annotations

from collections.abc import Sequence


class BakeError(Exception):
    """A bake that can't go on: says which object, why, and what to do about it.

    Attributes:
        subject: the object, file or setting it is about
        cause: what is wrong with it
        remedy: what the user can do
    """

    def __init__(self, subject: str, cause: str, remedy: str) -> None:
        super().__init__(f"{subject}: {cause}. {remedy}.")
        self.subject = subject
        self.cause = cause
        self.remedy = remedy


class SceneError(BakeError):
    """Something in the scene can't be baked.

    Attributes:
        more: what else can't be
    """

    more: Sequence[SceneError] = ()


def raise_together(errors: Sequence[SceneError]) -> None:
    """Raise the first of some errors, if there are any, with the others as its `more`."""
    if errors:
        first, *first.more = {str(error): error for error in errors}.values()
        raise first


class SettingsError(BakeError):
    """A setting is out of range, or asks for what the machine can't hold."""


class OutputError(BakeError):
    """A file or datablock can't be written."""


def explained(error: Exception) -> str:
    """One line for the user on any error: a defect of ours must not look like one of the scene's."""
    if isinstance(error, SceneError) and error.more:
        return f"{error} {len(error.more)} more stop the bake: Check Scene lists them"
    if isinstance(error, BakeError):
        return str(error)
    if isinstance(error, MemoryError):
        return "Memory: this bake needs more than there is. Lower the page size or the density."
    return f"Internal error: {type(error).__name__}: {error}".splitlines()[0] + ". Please report it"
