# SPDX-License-Identifier: GPL-3.0-or-later
"""Curves against Cycles: a NURBS torus under a neon tube, and the floor below both."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

pytest.importorskip("bpy", reason="Cycles is part of bpy, which is not installed")
import bpy

from radiosity_addon.blender.reading.extract import extract_scene
from tests.accuracy.cycles_judge import measure
from tests.accuracy.probes import Probes
from tests.bakes import lit

SAMPLES = 4096
RING, TUBE, HEIGHT = 1.0, 0.25, 0.9
"""Of Blender's own torus, and where it floats, m."""
AROUND = 9
"""Texels about a probe whose light is fitted there, so that it matters little where they happen to lie."""


def painted(name: str, kind: str, value: float) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    shader, output = tree.nodes.new(kind), tree.nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = (1, 1, 1, 1) if "Emission" in kind else (value, value, value, 1)
    if "Emission" in kind:
        shader.inputs["Strength"].default_value = value
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material


@pytest.fixture
def gallery() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    white = painted("White", "ShaderNodeBsdfDiffuse", 0.7)
    bpy.ops.mesh.primitive_plane_add(size=5)
    bpy.context.object.data.materials.append(white)
    bpy.ops.surface.primitive_nurbs_surface_torus_add(location=(0, 0, HEIGHT))
    torus = bpy.context.object
    torus.data.materials.append(white)
    torus.data.splines[0].resolution_u = torus.data.splines[0].resolution_v = 16
    bpy.ops.curve.primitive_bezier_curve_add(location=(0, 0, 2))
    neon = bpy.context.object
    neon.data.bevel_depth, neon.data.use_fill_caps, neon.data.resolution_u = 0.03, True, 32
    neon.data.splines[0].resolution_u, neon.data.bevel_resolution = 32, 8
    neon.data.materials.append(painted("Neon", "ShaderNodeEmission", 30.0))


def probes() -> Probes:
    """Over the floor and all around the torus, by its evaluated shape."""
    x, y = np.meshgrid(np.linspace(-2.2, 2.2, 6), np.linspace(-2.2, 2.2, 6))
    floor = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    torus = bpy.data.objects["SurfTorus"].evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    faces = torus.polygons
    chosen = [faces[int(k)] for k in (np.arange(96) * (np.sqrt(5) - 1) / 2 % 1) * len(faces)]  # on all rings of it
    normal = np.array([face.normal for face in chosen])
    place = np.array([face.center for face in chosen]) + [0, 0, HEIGHT] + 1e-3 * normal
    names = np.array(["Plane"] * len(floor) + ["SurfTorus"] * len(place))
    up = np.repeat([[0.0, 0.0, 1.0]], len(floor), axis=0)
    return Probes(names, np.concatenate([floor, place]), np.concatenate([up, normal]))


def test_light_on_curves_and_from_them_is_that_of_cycles(gallery: None) -> None:
    found = probes()
    reference, _ = measure(found, size=5.0, samples=SAMPLES, seeds=[1], threads=2)
    scene = extract_scene(bpy.context.scene).scene
    bake = lit(scene, page_size=512, quality="medium")
    names = np.array([mesh.name for mesh in scene.meshes])[bake.mesh]
    ours = []
    for name, position, normal in zip(found.object, found.position, found.normal, strict=True):
        near = np.flatnonzero((names == name) & (bake.normal @ normal > 0.7))
        about = near[np.argsort(((bake.position[near] - position) ** 2).sum(axis=1))[:AROUND]]
        plane = np.column_stack([np.ones(AROUND), bake.position[about] - position])
        ours.append(np.linalg.lstsq(plane, bake.light[about, 0], rcond=1e-3)[0][0])
    theirs = reference[0, :, 0]
    error = (np.array(ours) - theirs) / theirs.mean()
    assert abs(error.mean()) < 0.005
    assert np.sqrt((error**2).mean()) < 0.025  # Cycles' own noise is 0.012
    on_floor = found.object == "Plane"
    assert abs(error[on_floor].mean()) < 0.005
