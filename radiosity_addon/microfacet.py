# SPDX-License-Identifier: GPL-3.0-or-later
"""Albedo of rough mirrors: how much of uniform light a glossy layer sends back.

GGX facets with Smith's height-correlated masking (Heitz 2014, eq. 99), integrated over visible normals
(Heitz 2018), and the light that bounces between facets given back after Kulla and Conty (2017).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from .arrays import Float32, Float64, Floats
from .scene import RGB, Gloss

MIN_ROUGHNESS = 0.02
"""Below it a facet model is a mirror to three digits, and its quadrature would need more points."""

FRESNEL_STEPS = 32
"""Intervals of the cosine in which a facet's reflectance is tabulated, then taken as straight: within 1 %."""

Fresnel = Callable[[Float64], Float64]
"""Cosine at the facet (...,) to reflected share (..., 3)."""


def dielectric_fresnel(ior: float, tint: Float64, scale: float = 1.0) -> Fresnel:
    """Unpolarised Fresnel reflectance, its value at normal incidence scaled and tinted.

    Args:
        ior: index of refraction, at least 1
        tint: (3,) colour of the reflection at normal incidence; grazing reflection stays white
        scale: factor of the reflectance at normal incidence, as Principled's specular level has it (level / 0.5)
    """
    f0 = min(((ior - 1) / (ior + 1)) ** 2 * scale, 0.99)
    eta = (1 + f0**0.5) / (1 - f0**0.5)
    at_normal = np.clip(f0 * tint, 0, 1)

    def fresnel(cosine: Float64) -> Float64:
        g = np.sqrt(np.maximum(eta**2 - 1 + cosine**2, 0))
        a = (g - cosine) / np.maximum(g + cosine, 1e-12)
        b = (cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1)
        share = 0.5 * a**2 * (1 + b**2)
        toward_white = np.clip((share - f0) / (1 - f0), 0, 1)[..., None]
        blended: Float64 = at_normal + (1 - at_normal) * toward_white
        return blended

    return fresnel


def metal_fresnel(color: Float64, edge_tint: Float64) -> Fresnel:
    """Schlick's curve bent to meet `edge_tint` at 82 degrees (Kutz, Hasan and Edmondson 2021, "F82-tint")."""
    cos_82 = 1 / 7
    color = np.clip(color, 0, 1)
    schlick_82 = color + (1 - color) * (1 - cos_82) ** 5
    bend = schlick_82 * (1 - np.clip(edge_tint, 0, 1)) / (cos_82 * (1 - cos_82) ** 6)

    def fresnel(cosine: Float64) -> Float64:
        c = cosine[..., None]
        curve: Float64 = np.clip(color + (1 - color) * (1 - c) ** 5 - bend * c * (1 - c) ** 6, 0, 1)
        return curve

    return fresnel


def pane_transmittance(cosine: Floats, ior: Floats | float) -> Floats:
    """Share of light that one of the two surfaces of a clear pane lets pass, what is reflected between them included.

    Surfaces that reflect F each pass (1 - F) / (1 + F) together, and its root each.

    Args:
        cosine: (...,) of the angle to the normal
        ior: index of refraction, at least 1
    """
    g = np.sqrt(ior * ior - 1 + cosine * cosine)
    a = (g - cosine) / np.maximum(g + cosine, 1e-12)
    b = (cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1)
    reflected = 0.5 * a * a * (1 + b * b)
    passed: Floats = np.sqrt((1 - reflected) / (1 + reflected))
    return passed


@lru_cache(maxsize=4096)
def mean_pane_transmittance(ior: float) -> float:
    """`pane_transmittance` of uniform hemispherical light."""
    cosine, weight = _directions()
    return float(weight @ pane_transmittance(cosine, ior))


SHEEN = (0.0, 0.0019, 0.0127, 0.0348, 0.0701, 0.1182, 0.177, 0.2433, 0.313, 0.382, 0.447)
"""Share of uniform light that Cycles' white sheen of microfibres (Zeltner et al. 2022) sends back, by its roughness:
measured on a sphere under a white sky in 4.5 and 5.2."""


def sheen_albedo(roughness: float) -> float:
    """Share of uniform hemispherical light that a white sheen sends back."""
    return float(np.interp(roughness, np.linspace(0, 1, len(SHEEN)), SHEEN))


def rough_diffuse_albedo(color: Float64, roughness: float) -> Float64:
    """Share (3,) of uniform hemispherical light that a rough diffuse surface of a colour (3,) sends back.

    Oren and Nayar's (1994) in Fujii's form, with what bounces between its facets given back (Portsmouth et al. 2025),
    which Cycles colours once more than they do.
    """
    single = (1 + (2 / 3 - 28 / (15 * np.pi)) * roughness) / (1 + (1 / 2 - 2 / (3 * np.pi)) * roughness)
    between = (1 - single) * color**2 * single / (1 - np.minimum(color, 1) * (1 - single))
    return np.asarray(color * (single + between))


def coat_tint(tint: Float64, ior: float) -> Float64:
    """What a tinted coat (3,) lets through of uniform light, next to a clear one: the more the steeper it goes."""
    cosine, weight = _directions()
    inside = np.sqrt(1 - (1 - cosine**2) / ior**2)
    passing = weight * (pane_transmittance(cosine, ior) if ior > 1 else 1)
    return np.asarray(passing @ np.clip(tint, 1e-6, 1) ** (1 / inside[:, None]) / passing.sum())


def mean_fresnel(ior: float) -> float:
    """Share of uniform hemispherical light that a smooth dielectric reflects.

    Args:
        ior: index of refraction; below 1 the light comes from the denser side, and of what passes outward, reciprocity
            lets ior^2 times the share pass that passes inward
    """
    if ior < 1:
        return 1 - (1 - mean_fresnel(1 / ior)) * ior**2
    cosine, weight = _directions()
    return float(weight @ dielectric_fresnel(ior, np.ones(3))(cosine)[:, 0])


def glossy_albedo(roughness: float, fresnel: Fresnel, multiscatter: bool = True) -> Float64:
    """Share of uniform hemispherical light that the layer reflects, (3,) in 0..1.

    Args:
        roughness: as artists see it; the width of GGX is its square
        fresnel: reflectance of a facet
        multiscatter: gives back what bounces between facets
    """
    cosine, weight = _directions()
    at_facet, passed = _visible_facets(max(roughness, MIN_ROUGHNESS))
    single = (fresnel(at_facet) * passed[..., None]).mean(axis=1)
    if multiscatter:
        white = passed.mean(axis=1)
        white_mean = weight @ white
        facet_mean = weight @ fresnel(cosine)
        again = facet_mean * white_mean / (1 - facet_mean * (1 - white_mean))
        single = single * (1 + again * ((1 - white) / white)[:, None])
    albedo: Float64 = np.clip(weight @ single, 0, 1)
    return albedo


@lru_cache(maxsize=4096)
def dielectric_albedo(
    roughness: float, ior: float, tint: RGB = (1.0, 1.0, 1.0), scale: float = 1.0, multiscatter: bool = True
) -> Float64:
    """`glossy_albedo` of a layer with `dielectric_fresnel`, read only: scenes ask for the same ones again and again."""
    return _kept(glossy_albedo(roughness, dielectric_fresnel(ior, np.array(tint), scale), multiscatter))


@lru_cache(maxsize=4096)
def metal_albedo(roughness: float, color: RGB, edge_tint: RGB = (1.0, 1.0, 1.0), multiscatter: bool = True) -> Float64:
    """`glossy_albedo` of a layer with `metal_fresnel`, read only."""
    return _kept(glossy_albedo(roughness, metal_fresnel(np.array(color), np.array(edge_tint)), multiscatter))


@lru_cache(maxsize=4096)
def dielectric_gloss(roughness: float, ior: float, tint: RGB = (1.0, 1.0, 1.0), scale: float = 1.0) -> Gloss:
    """The facets of a layer with `dielectric_fresnel`."""
    return glossy_facets(roughness, dielectric_fresnel(ior, np.array(tint), scale))


@lru_cache(maxsize=4096)
def metal_gloss(roughness: float, color: RGB, edge_tint: RGB = (1.0, 1.0, 1.0)) -> Gloss:
    """The facets of a layer with `metal_fresnel`."""
    return glossy_facets(roughness, metal_fresnel(np.array(color), np.array(edge_tint)))


def glossy_facets(roughness: float, fresnel: Fresnel) -> Gloss:
    """What facets reflect at once; what bounces between them leaves as from a diffuse surface."""
    rough = max(roughness, MIN_ROUGHNESS)
    steps = fresnel(np.linspace(0, 1, FRESNEL_STEPS + 1)).tolist()
    albedo = glossy_albedo(rough, fresnel, multiscatter=False)
    return Gloss(rough**2, tuple((red, green, blue) for red, green, blue in steps), tuple(albedo.tolist()))


def facets_towards(width: Float32, normal: Float32, light: Float32, eye: Float32) -> tuple[Float32, Float32]:
    """Reflectance distribution of facets that reflect all, 1/sr, and the cosine at those that do; both (R,).

    Args:
        width: (R,) of GGX
        normal, light, eye: (R, 3) unit: of the surface, towards what shines, and towards what looks on
    """
    half = light + eye
    half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), np.float32(1e-6))
    across, seen, facet = (
        np.maximum(np.einsum("ij,ij->i", one, other), np.float32(1e-4))
        for one, other in ((normal, light), (normal, eye), (normal, half))
    )
    squared = width * width
    spread = facet * facet * (squared - 1) + 1
    masked = across * np.sqrt(squared + (1 - squared) * seen**2) + seen * np.sqrt(squared + (1 - squared) * across**2)
    share: Float32 = squared / (np.float32(np.pi) * spread * spread) * np.float32(0.5) / masked
    return share, np.minimum(np.einsum("ij,ij->i", half, eye), 1)


def _kept(values: Float64) -> Float64:
    values.flags.writeable = False
    return values


@lru_cache(maxsize=1)
def _directions() -> tuple[Float64, Float64]:
    """Cosines (16,) of a Gauss-Legendre rule and weights that sum to 1 over the projected hemisphere."""
    node, weight = np.polynomial.legendre.leggauss(16)
    cosine = (node + 1) / 2
    return cosine, weight * cosine


@lru_cache(maxsize=64)
def _visible_facets(roughness: float, side: int = 32) -> tuple[Float64, Float64]:
    """Cosine at the facet and share that leaves unmasked, each (16, side * side), by seen direction and facet."""
    alpha = roughness**2
    cosine = _directions()[0][:, None]
    u, v = (grid.reshape(1, -1) for grid in np.meshgrid(*2 * [(np.arange(side) + 0.5) / side]))
    view = np.stack([np.sqrt(1 - cosine**2), 0 * cosine, cosine], axis=-1)
    stretched = view * [alpha, alpha, 1]
    stretched /= np.linalg.norm(stretched, axis=-1, keepdims=True)
    # a visible normal of the stretched hemisphere: half vector to a point on a spherical cap (Dupuy and Benyoub 2023)
    z = (1 - u) * (1 + stretched[..., 2]) - stretched[..., 2]
    radius = np.sqrt(np.clip(1 - z**2, 0, 1))
    cap = np.stack([radius * np.cos(2 * np.pi * v), radius * np.sin(2 * np.pi * v), z], axis=-1)
    facet = (cap + stretched) * [alpha, alpha, 1]
    facet /= np.linalg.norm(facet, axis=-1, keepdims=True)
    at_facet = np.clip((facet * view).sum(-1), 0, 1)
    leaving = 2 * at_facet * facet[..., 2] - cosine

    def masking(cos: Float64) -> Float64:
        tangent2 = (1 - cos**2) / np.maximum(cos**2, 1e-12)
        shadowed: Float64 = (np.sqrt(1 + alpha**2 * tangent2) - 1) / 2
        return shadowed

    seen = masking(cosine)
    passed = np.where(leaving > 0, (1 + seen) / (1 + seen + masking(np.clip(leaving, 1e-6, 1))), 0)
    return at_facet, passed
