# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of suns on glossy surfaces, as gather rays see it.

Surfaces exchange light as diffuse ones do, with all that they reflect. What a sun's beam does on a floor that shines is
far from that: it leaves towards the far wall. The direction of a gather ray is known where it meets the floor, and the
one of the beam too: the facets' reflectance stands in for its diffuse mean.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Float32, Int32, Int64
from ..geometry.texels import Texels
from ..lighting.beams import Beams
from ..microfacet import FRESNEL_STEPS, facets_towards

NARROWEST = 0.12
"""Width of GGX to which sharper gloss is blurred: what few rays find would be specks (Kaplanyan and Dachsbacher 2013).
"""


class Gleams:
    """Tells what rays see of suns in glossy texels, over what they see if these are taken as diffuse."""

    def __init__(self, beams: Beams, texels: Texels, groups: int) -> None:
        materials = beams.materials
        self._beams, self._texels = beams, texels
        self.columns = 3 * groups
        layers = max(len(material.glosses) for material in materials)
        self._width = np.ones((layers, len(materials)), np.float32)
        self._fresnel = np.zeros((layers, len(materials), FRESNEL_STEPS + 1, 3), np.float32)
        self._mean = np.zeros((layers, len(materials), 3), np.float32)
        for index, material in enumerate(materials):
            for layer, gloss in enumerate(material.glosses):
                self._width[layer, index] = max(gloss.width, NARROWEST)
                self._fresnel[layer, index] = gloss.fresnel
                self._mean[layer, index] = np.array(gloss.albedo) / np.pi

    def seen(self, element: Int32, directions: Float32) -> tuple[Int64, Float32]:
        """Which rays (Q,) see gleams, and these (Q, 3 G), W/(m2 sr).

        Args:
            element: (R,) what each ray meets
            directions: (R, 3) unit
        """
        beams, texels = self._beams, self._texels
        front = np.flatnonzero((element >= 0) & (element < texels.count))
        ray = front[beams.row[element[front]] >= 0]
        texel = element[ray]
        row, material = beams.row[texel], texels.surfaces.material[texels.triangle[texel]]
        normal, eye = texels.shading_normal[texel], -directions[ray]
        found = np.zeros((len(ray), self.columns), np.float32)
        for light, direction, group in zip(beams.light, beams.direction, beams.group, strict=True):
            for width, fresnel, mean in zip(self._width, self._fresnel, self._mean, strict=True):
                share, cosine = facets_towards(width[material], normal, direction[None], eye)
                step = cosine * np.float32(FRESNEL_STEPS)
                low = np.minimum(step.astype(np.intp), FRESNEL_STEPS - 1)
                step = (step - low)[:, None]
                facet = fresnel[material, low] * (1 - step) + fresnel[material, low + 1] * step
                facet *= share[:, None]
                facet -= mean[material]
                found[:, 3 * group : 3 * group + 3] += facet * light[row]
        return ray, found
