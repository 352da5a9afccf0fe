# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors that a user can act on; anything else that is raised is a defect of ours."""


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
    """Something in the scene can't be baked."""


class SettingsError(BakeError):
    """A setting is out of range, or asks for what the machine can't hold."""


class OutputError(BakeError):
    """A file or datablock can't be written."""
