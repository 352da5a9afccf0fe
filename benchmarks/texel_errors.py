# SPDX-License-Identifier: GPL-3.0-or-later
"""What the errors of a scene of the accuracy suite are made of: `python benchmarks/texel_errors.py SCENE`.

A probe is read from the four texels around it. Each of these is computed anew by brute force: its lamps' light from
many points of its footprint, bounced light by many rays that read the finished lightmap. So the error at a probe falls
in three: what its texels err in direct and in bounced light, and the rest, which is what four exact texels would err:
how wide a reading is, light that the whole room has too much or too little, and the noise of the reference.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from radiosity_addon import bake as baking  # noqa: E402
from radiosity_addon.bake import Baked  # noqa: E402
from radiosity_addon.chunks import finish  # noqa: E402
from radiosity_addon.gather.gleams import Gleams  # noqa: E402
from radiosity_addon.gather.own_error import Shown, bounced_light, lamp_light, own_error  # noqa: E402
from radiosity_addon.geometry.texels import Texels  # noqa: E402
from radiosity_addon.geometry.visibility import Visibility  # noqa: E402
from radiosity_addon.lighting.lights import Lamps  # noqa: E402
from radiosity_addon.radiosity.illumination import Illumination  # noqa: E402
from radiosity_addon.radiosity.patches import Patches  # noqa: E402
from radiosity_addon.scene import Scene  # noqa: E402
from radiosity_addon.settings import QUALITIES, BakeSettings  # noqa: E402
from tests.accuracy.comparison import READING, beside_others, bilinear_weights, places_of  # noqa: E402
from tests.accuracy.make_references import PLANS  # noqa: E402
from tests.accuracy.probes import Probes, References  # noqa: E402
from tests.accuracy.test_against_cycles import SCENES  # noqa: E402

RAYS = 1 << 14
"""Rays of each of two estimates of a texel's bounced light."""

POINTS = 64
"""Points of a footprint that each of two estimates of its lamps' light is asked from."""

TEXELS = 8
"""Texels computed at once."""


@dataclass(frozen=True, eq=False)
class Inside:
    """What a bake has when its check begins; light as irradiance (T, G, 3), W/m2."""

    texels: Texels
    patches: Patches
    light: Illumination
    lamps: Lamps
    direct: np.ndarray
    indirect: np.ndarray
    counted: bool
    visibility: Visibility

    def own(self, ids: np.ndarray) -> np.ndarray:
        """Irradiance over pi (2, P), W/(m2 sr), of texels, direct and bounced, the mean of channels."""
        return np.stack([part[ids].sum(axis=(1, 2)) / (3 * np.pi) for part in (self.direct, self.indirect)])

    def anew(self, ids: np.ndarray) -> np.ndarray:
        """The same (2, P) by brute force."""
        groups = self.direct.shape[1]
        shown = Shown(self.light, self.patches, None if self.counted else self.indirect)
        gleams = None if self.light.beams is None else Gleams(self.light.beams, self.texels, groups)
        found = np.zeros((2, len(ids)))
        for start in range(0, len(ids), TEXELS):
            part = slice(start, start + TEXELS)
            for half in np.repeat([[0], [1]], len(ids[part]), axis=1):
                found[0, part] += lamp_light(self.texels, ids[part], half, POINTS, self.lamps, self.visibility, groups)
                found[1, part] += bounced_light(
                    self.texels, self.patches, ids[part], half, RAYS, self.light, shown, gleams, self.visibility
                )[0]
        return found / (2 * np.pi)


def baked_inside(name: str, quality: str) -> tuple[Baked, Scene, Inside]:
    """Bake a scene of the suite and keep what its check is told: all that a texel's light is computed from."""
    import bpy

    from radiosity_addon.blender.reading.cycles_shader import CyclesShader
    from radiosity_addon.blender.reading.extract import extract_scene

    bpy.ops.wm.open_mainfile(filepath=str(PLANS[name].folder / f"{name}.blend"))
    extraction = extract_scene(bpy.context.scene)
    kept: list[Inside] = []

    def listen(*told: Any) -> Any:
        texels, patches, light, lamps, direct, indirect, counted, _, visibility, _ = told
        light = replace(light, direct=light.direct.copy())  # the bake adds bounced light to it in place
        kept.append(Inside(texels, patches, light, lamps, direct.copy(), indirect, counted, visibility))
        return own_error(*told)

    settings = BakeSettings(page_size=SCENES[name], quality=quality)
    with mock.patch.object(baking, "own_error", listen):
        baked = finish(baking.bake(extraction.scene, settings, CyclesShader(bpy.context.scene.name, extraction)))
    return baked, extraction.scene, kept[0]


def errors(baked: Baked, scene: Scene, inside: Inside, references: References) -> np.ndarray:
    """(4, N) at each probe, as shares of the mean: the whole error, its direct and its bounced part, and the rest."""
    places = places_of(baked, scene, Probes(references.object, references.position, references.normal))
    size = baked.atlas.size
    pixel, weight = bilinear_weights(size, places.uv)
    texel = inside.texels.texel_at[places.page[:, None] * size**2 + pixel]
    held = np.stack([page.reshape(-1, 3).mean(axis=1) for page in baked.pages])
    read = (weight * held[places.page[:, None], pixel]).sum(axis=1)
    ids, row = np.unique(texel[texel >= 0], return_inverse=True)
    off = np.zeros((2, *texel.shape))  # what fills gaps beside charts is taken as it is
    off[:, texel >= 0] = (inside.own(ids) - inside.anew(ids.astype(np.int64)))[:, row]
    parts = (weight * off).sum(axis=2)
    value = references.value.mean(axis=1)
    whole = read - value
    return np.stack([whole, *parts, whole - parts.sum(axis=0)]) / value.mean()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", choices=list(SCENES))
    parser.add_argument("--quality", choices=QUALITIES, default="medium")
    parser.add_argument("--probes", type=int, default=25, help="how many of the worst are listed")
    chosen = parser.parse_args()
    references = References.load(ROOT / "tests" / "accuracy" / "references" / f"{chosen.scene}.npz")
    baked, scene, inside = baked_inside(chosen.scene, chosen.quality)
    found = errors(baked, scene, inside, references)
    clear = np.flatnonzero(~beside_others(scene, references, READING * references.footprint))
    report(found[:, clear], references.object[clear], references.position[clear], chosen.probes)


def report(found: np.ndarray, names: np.ndarray, position: np.ndarray, most: int) -> None:
    """Print errors (4, N) of probes: all together, by object, and the worst ones."""
    share = found[0] ** 2 / max(float((found[0] ** 2).sum()), 1e-30)
    print(f"{len(names)} probes; mean of channels, as shares of the scene's mean")
    for name, part in zip(("whole", "direct", "bounced", "rest"), found, strict=True):
        print(
            f"{name:8} RMS {np.sqrt(np.mean(part**2)):6.2%}  bias {part.mean():+6.2%}  most {np.abs(part).max():6.1%}"
        )
    by_object: dict[str, float] = defaultdict(float)
    for name, part in zip(names, share, strict=True):
        by_object[name] += part
    print("\nshare of the squared error, by object")
    for name in sorted(by_object, key=lambda name: -by_object[name])[:10]:
        print(f"{by_object[name]:6.1%}  {name}")
    print("\nshare    whole  direct bounced    rest  probe")
    for probe in np.argsort(-share)[:most]:
        parts = " ".join(f"{part:+7.1%}" for part in found[:, probe])
        print(f"{share[probe]:5.1%}  {parts}  {names[probe]} at {position[probe].round(3).tolist()}")


if __name__ == "__main__":
    main()
