# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene as the core sees it: frozen records of arrays, SI units, world space.

RGB triples are linear, in the scene's working space. Whoever fills these records (Blender's extractor,
a test) resolves what a lamp or shader means into radiometric quantities; the core only transports light.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from .arrays import Float32, Float64, Int32
from .color.spaces import REC709, RGBSpace
from .shading import Quantity

RGB: TypeAlias = tuple[float, float, float]

MAX_REFLECTANCE = 0.999
"""Surfaces that reflect everything would never let a closed room's light settle."""


@dataclass(frozen=True)
class Gloss:
    """A layer of facets: the part of a reflectance that throws light of suns in one direction more than in others.

    Attributes:
        width: of GGX, the square of the roughness that artists set
        fresnel: share that a facet reflects at cosines evenly spaced from 0 to 1
        albedo: share of uniform light that facets reflect at once; a part of its material's reflectance
    """

    width: float
    fresnel: tuple[RGB, ...]
    albedo: RGB

    def __mul__(self, factor: RGB) -> Gloss:
        """The layer, dimmed by the channel."""

        def dimmed(color: RGB) -> RGB:
            return (color[0] * factor[0], color[1] * factor[1], color[2] * factor[2])

        return replace(self, fresnel=tuple(dimmed(color) for color in self.fresnel), albedo=dimmed(self.albedo))


@dataclass(frozen=True)
class Material:
    """A surface that reflects light as a diffuse one, but for that of suns on gloss.

    All its quantities are of the surface as a whole: a half clear one reflects half as much.

    Attributes:
        name: for messages
        reflectance: diffuse albedo plus glossy albedo, each channel in [0, 1)
        translucence: what of the reflectance leaves, scattered, from the side that was not lit, of two-sided meshes;
            one-sided ones throw it back
        emission: emitted radiance, W/(m2 sr)
        group: light group of the emission, index into Scene.groups
        transmittance: share of the light that goes straight on, each channel in [0, 1]
        indirect_transmittance: of light that does not come from lamps, if that passes otherwise; None: the same
        ior: index of refraction of clear glass: the transmittance is then a mean, and follows the angle; 1 for others
        glosses: layers of facets that are part of the reflectance; none where it varies over the surface how they look
        varies: which of these change over the surface; a Shader tells them, the values here are their means
        back: how it looks from behind, index into Scene.materials; None: as from the front. The same vary on both faces
    """

    name: str
    reflectance: RGB = (0.8, 0.8, 0.8)
    emission: RGB = (0.0, 0.0, 0.0)
    group: int = 0
    transmittance: RGB = (0.0, 0.0, 0.0)
    indirect_transmittance: RGB | None = None
    ior: float = 1.0
    glosses: tuple[Gloss, ...] = ()
    translucence: RGB = (0.0, 0.0, 0.0)
    varies: frozenset[Quantity] = frozenset()
    back: int | None = None


@dataclass(frozen=True, eq=False)
class Mesh:
    """One object's surface as rendered, in world space.

    Triangles wind counter-clockwise about the geometric front, also for mirrored objects.

    Attributes:
        name: the object's name
        vertices: (V, 3) float64, m
        triangles: (F, 3) int32, into vertices
        corner_normals: (F, 3, 3) float32, unit shading normals
        material: (F,) int32, into Scene.materials
        polygon: (F,) int32, the modeller's polygon that each triangle is part of
        corner: (F, 3) int32, the polygon corner (loop) behind each triangle corner
        lightmapped: gets a place on a page; otherwise it only shadows, bounces and emits
        density: multiplier of the texel density
        uv: (F, 3, 2) float32 in 0..1 to keep an existing map instead of unwrapping, or None
        chart: (F,) int32, chart of each triangle, where the surface was laid flat already: then uv are metres in a
            plane for each chart, and the charts are packed apart; -1: none
        flat: lays the surface flat by its own parameters: gives `uv` and `chart`, or None if it bends too much; asked
            where charts are made, by `laid_flat`
        shape: meshes of the same number, 0 and up, share one unwrap, which each scales and shifts as a whole: their
            polygons, corners and existing maps are the same and their vertices differ by little more than a
            similarity; None: an unwrap of its own
        met: light that surfaces and the world send out meets it; otherwise that light passes, and it sends out none
        casts: stops the light of lamps on its way to others
        two_sided: its backs get a place on a page too
        front: of a record of backs: index of the mesh whose backs they are
        terminator: cosine of light with the surface below which shadow rays of smooth-shaded triangles start on the
            rounder surface that their normals tell of; 0: they pass the triangle that they start on instead; None: no
            light comes from below a triangle
        bend: light at an angle t from the shading normal counts by cos(bend t), or not at all; 1 for Lambert's law
        page_group: meshes of one group share pages that no others are on; those of one `shape` are of one group
    """

    name: str
    vertices: Float64
    triangles: Int32
    corner_normals: Float32
    material: Int32
    polygon: Int32
    corner: Int32
    lightmapped: bool = True
    density: float = 1.0
    uv: Float32 | None = None
    chart: Int32 | None = None
    flat: Callable[[], tuple[Float32, Int32] | None] | None = None
    shape: int | None = None
    met: bool = True
    casts: bool = True
    two_sided: bool = False
    front: int | None = None
    terminator: float | None = None
    bend: float = 1.0
    page_group: str = ""

    def laid_flat(self) -> Mesh:
        """The mesh with the charts that it can make of itself, if it can."""
        if self.flat is None:
            return self
        uv, chart = self.flat() or (None, None)
        return replace(self, uv=uv, chart=chart, flat=None)


@dataclass(frozen=True, eq=False)
class Distribution:
    """How the light of a point or spot light varies with the direction in which it leaves, and over the distance.

    Attributes:
        directions: (N, N, C) float32, factors of the intensity, of one colour or three, on an octahedron laid flat
            (Cigolla et al. 2014): texel centres, row 0 at y = -reach; its middle is the axes' z
        axes: three rows: unit x, y and z of the octahedron
        reach: what |x| and |y| go up to on the flat octahedron: 1 for all of it, up to 0.5 for its middle
        falloff: (K, 2) float64, rising distances, m, and what the inverse square law is multiplied with there; in
            between both are powers of each other. None: 1 everywhere
        on_sphere: on a lamp that is a sphere, the direction is that of the surface's normal, not that of the light
    """

    directions: Float32
    axes: tuple[RGB, RGB, RGB]
    reach: float = 1.0
    falloff: Float64 | None = None
    on_sphere: bool = False


@dataclass(frozen=True)
class PointLight:
    """A sphere that radiates alike in all directions, unless it has a distribution.

    Attributes:
        intensity: W/sr
        position: m
        radius: m; 0 is a point
        soft_falloff: Cycles' soft falloff: a disc of that radius that faces each receiver, in place of a sphere
        shadow: casts shadows
        group: light group, index into Scene.groups
        distribution: factors of the intensity; None: 1 everywhere
    """

    name: str
    intensity: RGB
    position: RGB
    radius: float = 0.0
    soft_falloff: bool = True
    shadow: bool = True
    group: int = 0
    distribution: Distribution | None = None


@dataclass(frozen=True)
class SpotLight:
    """A point light behind a cone.

    Attributes:
        intensity: W/sr on the axis
        axes: three rows: unit local x, y and the direction it shines in, each divided by the object's scale along it
        angle: full cone angle, radians
        blend: share of the cone that fades, 0..1
        Others as for PointLight.
    """

    name: str
    intensity: RGB
    position: RGB
    axes: tuple[RGB, RGB, RGB]
    angle: float
    blend: float
    radius: float = 0.0
    soft_falloff: bool = True
    shadow: bool = True
    group: int = 0
    distribution: Distribution | None = None


@dataclass(frozen=True)
class SunLight:
    """Light from a disc infinitely far away.

    Attributes:
        irradiance: W/m2 on a plane that faces it
        direction: unit, the way the light travels
        angle: angular diameter, radians
    """

    name: str
    irradiance: RGB
    direction: RGB
    angle: float = 0.0
    shadow: bool = True
    group: int = 0


@dataclass(frozen=True)
class AreaLight:
    """A flat lamp that shines to one side.

    Attributes:
        radiance: W/(m2 sr), on the axis where spread is narrowed
        position: centre, m
        edge_u, edge_v: full edge vectors, m (full axes of an ellipse)
        direction: unit, the way it shines
        ellipse: an ellipse inscribed in the rectangle
        spread: full opening angle, radians; pi is Lambertian
    """

    name: str
    radiance: RGB
    position: RGB
    edge_u: RGB
    edge_v: RGB
    direction: RGB
    ellipse: bool = False
    spread: float = np.pi
    shadow: bool = True
    group: int = 0


Light: TypeAlias = PointLight | SpotLight | SunLight | AreaLight


@dataclass(frozen=True, eq=False)
class SkyTile:
    """A picture of a part of the sky, a rectangle in longitude atan2(y, x) and latitude asin(z) of the way one looks.

    Attributes:
        radiance: (H, W, 3) float32, W/(m2 sr), means over pixels; row 0 is the southernmost, columns go east
        west, east: radians, of the outer edges of the columns, east - west at most 2 pi
        south, north: radians, of the outer edges of the rows, within -pi/2 .. pi/2
    """

    radiance: Float32
    west: float = -np.pi
    east: float = np.pi
    south: float = -np.pi / 2
    north: float = np.pi / 2


@dataclass(frozen=True)
class World:
    """Light from everywhere outside.

    Attributes:
        radiance: the same from everywhere, W/(m2 sr)
        group: light group, index into Scene.groups
        sky: what comes on top of it: none, or pictures of which the first shows the whole sky and each further one a
            part of it in more detail. They don't overlap, and each takes the place of whole pixels of the first
    """

    radiance: RGB = (0.0, 0.0, 0.0)
    group: int = 0
    sky: tuple[SkyTile, ...] = ()


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that a bake needs to know.

    Attributes:
        groups: names of the light groups; every light, emission and the world is in exactly one
        receivers: of lights that do not light everything, by index of the light: indices of the meshes that they light
        bounces: most bounces of a group's light, by index of the group; those not in it bounce until none is left
        working_space: the linear RGB space of all triples
        warnings: what the extractor had to say
    """

    meshes: tuple[Mesh, ...]
    materials: tuple[Material, ...]
    lights: tuple[Light, ...] = ()
    world: World = field(default_factory=World)
    groups: tuple[str, ...] = ("",)
    receivers: Mapping[int, frozenset[int]] = field(default_factory=dict)
    bounces: Mapping[int, int] = field(default_factory=dict)
    working_space: RGBSpace = REC709
    warnings: tuple[str, ...] = ()

    @cached_property
    def behind(self) -> Int32:
        """(M,) how each material looks from behind, index into the materials: itself where both faces are alike."""
        seen = [index if entry.back is None else entry.back for index, entry in enumerate(self.materials)]
        return np.array(seen or [0], np.int32)

    def moved(self, offset: Float64) -> Scene:
        """The same scene with `offset` (3,), m, added to every position."""

        def shifted(light: Light) -> Light:
            if isinstance(light, SunLight):
                return light
            x, y, z = (float(p + o) for p, o in zip(light.position, offset, strict=True))
            return replace(light, position=(x, y, z))

        meshes = tuple(replace(mesh, vertices=mesh.vertices + offset) for mesh in self.meshes)
        return replace(self, meshes=meshes, lights=tuple(shifted(light) for light in self.lights))
