# SPDX-License-Identifier: GPL-3.0-or-later
"""Every property and operator says what it does, in the way that Blender's own do."""

from __future__ import annotations

import re

import bpy
import pytest

from radiosity_addon import blender

FEWEST_WORDS = 3


def ours(kind: type) -> list[type]:
    return [cls for part in blender._parts() for cls in getattr(part, "CLASSES", ()) if issubclass(cls, kind)]


OPERATORS, GROUPS, PANELS = ours(bpy.types.Operator), ours(bpy.types.PropertyGroup), ours(bpy.types.Panel)
PROPERTIES = [
    (cls, name)
    for cls in (*GROUPS, *OPERATORS)
    for name in cls.__annotations__
    if not name.startswith(("bl_", "preset_"))
]


def test_all_kinds_of_classes_are_looked_at() -> None:
    assert min(len(OPERATORS), len(GROUPS), len(PANELS)) >= 3
    assert len(PROPERTIES) > 30


@pytest.mark.parametrize(("cls", "name"), PROPERTIES, ids=lambda part: getattr(part, "__name__", part))
def test_a_property_has_a_title_and_a_tooltip(cls: type, name: str) -> None:
    prop = rna_of(cls).properties[name]
    assert is_title(prop.name)
    assert is_sentence(prop.description)
    if prop.type == "ENUM":
        for item in prop.enum_items:
            assert item.description, item.name
            assert not item.description.endswith(".")


@pytest.mark.parametrize("cls", OPERATORS, ids=lambda cls: cls.__name__)
def test_an_operator_has_a_title_and_a_tooltip(cls: type) -> None:
    assert is_title(rna_of(cls).name)
    assert is_sentence(rna_of(cls).description)
    assert cls.__name__ == f"RADIOSITY_OT_{cls.bl_idname.partition('.')[2]}"


@pytest.mark.parametrize("cls", PANELS, ids=lambda cls: cls.__name__)
def test_a_panel_has_a_title_and_is_in_its_place(cls: type) -> None:
    assert is_title(cls.bl_label)
    assert cls.__name__.startswith("RADIOSITY_PT_")


def rna_of(cls: type) -> bpy.types.Struct:
    """What Blender knows of a class; of operators it keeps what a user sees elsewhere."""
    if not issubclass(cls, bpy.types.Operator):
        return cls.bl_rna
    return getattr(bpy.ops.radiosity, cls.bl_idname.partition(".")[2]).get_rna_type()


def is_title(text: str) -> bool:
    as_they_are = {"a", "and", "as", "in", "of", "per", "the", "to", "glTF"}
    return (
        all(word in as_they_are or word[0].isupper() for word in re.findall(r"[A-Za-z]+", text)) and text[-1].isalnum()
    )


def is_sentence(text: str) -> bool:
    """Enough words to say something, begun with a capital, without Blender's unwanted full stop."""
    return len(text.split()) >= FEWEST_WORDS and text[0].isupper() and not text.endswith(".")
