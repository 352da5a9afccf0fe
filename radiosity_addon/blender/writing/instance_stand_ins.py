# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain objects in the place of instances, each with a place of its own on a page.

An instance has no properties, so it can't know where its light lies. What makes instances is therefore hidden, and
all that it shows is shown by objects: those of one mesh share one copy of it as rendered, and differ by their matrix,
their materials and their place on a page. They follow the instancer as a whole, through an empty.
"""

from __future__ import annotations

from collections.abc import Collection, Generator, Mapping
from dataclasses import dataclass, field

import bpy
import numpy as np
from mathutils import Matrix

from ..data.instances import RAYS, Key, is_instance, key_of
from ..data.names import BAKE_KEY, HIDDEN_KEY, STAND_IN_KEY
from ..data.preflight import is_flat
from ..data.spline_meshes import is_bare_tube
from ..data.stand_in import (
    LOOKS,
    VISIBILITY,
    Common,
    MeshPool,
    carried_properties,
    collections_of,
    dress,
    hide,
    make_stand_in,
    materials_of,
    name_after,
    swap_in,
)

WITHOUT_SURFACE = ("LIGHT", "LIGHT_PROBE", "VOLUME", "CURVES", "POINTCLOUD", "GREASEPENCIL", "GPENCIL")
"""Types of instanced objects that have no mesh, and still must stay in sight."""


@dataclass(eq=False)
class Replacement:
    """What is shown in place of an instancer.

    Attributes:
        instancer: the object of the scene
        anchor: an empty that goes where the instancer goes, the stand-ins with it
        base: inverse of the instancer's matrix, if it has one and the anchor follows
        stand_ins: objects for all its instances, by key
        surface: stands in for its own surface where that has no place on a page
    """

    instancer: bpy.types.Object
    anchor: bpy.types.Object
    base: Matrix
    stand_ins: list[tuple[Key, bpy.types.Object]] = field(default_factory=list)
    surface: bpy.types.Object | None = None

    @classmethod
    def of(cls, instancer: bpy.types.Object, matrix: Matrix, token: str) -> Replacement:
        """With an anchor, and no stand-ins yet."""
        anchor = bpy.data.objects.new(instancer.name, None)
        anchor[BAKE_KEY] = token
        anchor[STAND_IN_KEY] = instancer
        anchor.empty_display_size = 0.0001
        base = Matrix()
        if not is_flat(np.array(matrix)):
            anchor.matrix_world = matrix
            anchor.constraints.new("COPY_TRANSFORMS").target = instancer
            base = matrix.inverted()
        return cls(instancer, anchor, base)

    def add(
        self, item: bpy.types.DepsgraphObjectInstance, pool: MeshPool, common: Common | None
    ) -> Generator[None, None, None]:
        """Show an instance by a new object."""
        stand_in = yield from _stand_in(item, pool, common)
        stand_in.parent = self.anchor
        stand_in.matrix_basis = Matrix()
        stand_in.matrix_parent_inverse = self.base @ item.matrix_world  # it alone can hold a shear
        self.stand_ins.append((key_of(item), stand_in))

    def show(self, token: str) -> None:
        """Bring the stand-ins into a collection that is seen wherever the instancer is seen."""
        instancer = self.instancer
        group = bpy.data.collections.new(f"{instancer.name} (Radiosity)")
        group[BAKE_KEY] = token
        self.anchor.name = f"{instancer.name} Instances (Radiosity)"
        group.objects.link(self.anchor)
        for _, stand_in in self.stand_ins:
            name_after(stand_in[STAND_IN_KEY], stand_in)
            stand_in.hide_viewport = instancer.hide_viewport
            group.objects.link(stand_in)
        for collection in collections_of(instancer):
            collection.children.link(group)
        for scene in instancer.users_scene:
            for layer in scene.view_layers:
                if instancer.name in layer.objects and instancer.hide_get(view_layer=layer):
                    for _, stand_in in self.stand_ins:
                        stand_in.hide_set(True, view_layer=layer)

    def hide(self, token: str) -> None:
        """Hide the instancer, unless a stand-in of its own surface has done so."""
        if self.surface is not None:
            swap_in(self.instancer, self.surface, token, instances=False)
        elif HIDDEN_KEY not in self.instancer:
            hide(self.instancer, token, instances=False)


def replace_instancers(
    depsgraph: bpy.types.Depsgraph,
    names: Collection[str],
    baked: Collection[bpy.types.Object],
    commons: Mapping[Key, Common],
    pool: MeshPool,
) -> Generator[None, None, list[Replacement]]:
    """What will be shown in place of these objects of the scene, in no collection yet; in steps.

    Args:
        depsgraph: at render settings
        names: of the instancers; those that are linked are left alone
        baked: objects whose own surface has a place on a page
        commons: what instances that have a place on a page share their meshes by
        pool: where meshes come from
    """
    found: dict[str, Replacement] = {}
    surfaces = {}
    for item in depsgraph.object_instances:
        thing = item.object
        maker = item.parent if is_instance(item) else thing
        if maker.original.name not in names or not item.show_self or not maker.original.is_editable:
            continue
        has_faces = is_bare_tube(thing.original, depsgraph) or (thing.type == "MESH" and len(thing.data.polygons) > 0)
        if not is_instance(item):
            if has_faces and thing.original not in baked:
                surfaces[maker.original.name] = yield from make_stand_in(thing.original, pool, None)
        elif has_faces or thing.type in WITHOUT_SURFACE:
            if maker.original.name not in found:
                found[maker.original.name] = Replacement.of(maker.original, maker.matrix_world.copy(), pool.token)
            yield from found[maker.original.name].add(item, pool, commons.get(key_of(item)))
            yield
    for name, replacement in found.items():
        replacement.surface = surfaces.get(name)
    return list(found.values())


def _stand_in(
    item: bpy.types.DepsgraphObjectInstance, pool: MeshPool, common: Common | None
) -> Generator[None, None, bpy.types.Object]:
    thing, original, instancer = item.object, item.object.original, item.parent
    if thing.type in ("MESH", "CURVE"):
        stand_in = bpy.data.objects.new(original.name, (yield from pool.of(thing, common)))
        dress(stand_in, materials_of(thing))
        for key, value in (carried_properties(instancer.original) | carried_properties(original)).items():
            stand_in[key] = value
    else:
        stand_in = original.copy()
        stand_in.constraints.clear()
        stand_in.animation_data_clear()
        stand_in.hide_render = False
    stand_in[BAKE_KEY] = pool.token
    stand_in[STAND_IN_KEY] = original
    for name in LOOKS:
        if name not in VISIBILITY:
            setattr(stand_in, name, getattr(thing, name))
    for name in (*RAYS, "visible_transmission", "visible_volume_scatter"):  # as Cycles decides it
        setattr(stand_in, name, getattr(thing, name) and getattr(instancer, name))
    stand_in.is_holdout = thing.is_holdout or instancer.is_holdout
    stand_in.lightgroup = thing.lightgroup or instancer.lightgroup
    stand_in.hide_select = instancer.hide_select
    return stand_in
