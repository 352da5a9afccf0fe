# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene that was read: the core's records, and what has to be known to bring light back."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

from ...arrays import Float64, Int32
from ...scene import Scene
from ..looks.surface_answers import SurfaceAnswers


class Skip(Exception):
    """An object can't take part; the message is the reason."""


class Notes:
    """What there is to say of a scene, each thing once: every instance of an object would say the same."""

    def __init__(self) -> None:
        self.warnings: dict[str, None] = {}

    def warn(self, text: str) -> None:
        """Say something."""
        self.warnings[text] = None

    def hears(self, subject: str) -> Callable[[str], None]:
        """Who says things of one subject."""
        return lambda text: self.warn(f"{subject}: {text}")


@dataclass(frozen=True, eq=False)
class Source:
    """Where an entry of Scene.meshes comes from: what has to be known to write its lightmap back.

    Attributes:
        object_name: the object; of an instance, the object that is instanced
        library: file that the object is linked from, None for one of this file
        mesh: index into Scene.meshes
        own_mesh: the rendered mesh has the loops of the object's own mesh, so a uv map can be written onto that
        materials: name of the material in each slot as rendered, "" for an empty slot
        slot: (F,) int32, slot of each triangle, as stored (may lie beyond the slots)
        matrix: (4, 4) world matrix of an instance, or None where the object stands itself
        instancer: of an instance, the object of the scene that makes it, "" where the object stands itself
        index: of an instance, which of the instancer's it is, a number for each level of instancing
    """

    object_name: str
    mesh: int
    own_mesh: bool
    materials: tuple[str, ...]
    slot: Int32
    matrix: Float64 | None = None
    instancer: str = ""
    index: tuple[int, ...] = ()
    library: str | None = None


@dataclass(frozen=True, eq=False)
class Extraction:
    """A scene that was read.

    Attributes:
        scene: the core's records
        sources: one for each of Scene.meshes
        skipped: objects that get no lightmap, with the reason
        materials: full name of each of Scene.materials, "" for the default surface
        surfaces: by index of the mesh, what surfaces whose materials vary answer to those
        instancers: names of the objects that make instances, and of the objects that these show
    """

    scene: Scene
    sources: tuple[Source, ...]
    skipped: tuple[tuple[str, str], ...]
    materials: tuple[str, ...] = ()
    surfaces: Mapping[int, SurfaceAnswers] = field(default_factory=dict)
    instancers: Mapping[str, Collection[str]] = field(default_factory=dict)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What had to be approximated."""
        return self.scene.warnings
