# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws overlays onto the surfaces in a 3D view; nothing in the file is touched."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

from ...arrays import Float32, Float64
from ...atlas.density import cofactors
from ...pages.encodings import UInt8
from ...reports.pictures import LUMENS_PER_WATT, color_scale, density_scale, distinct_colors
from .overlay_data import NEEDS, SURFACES, TEXELS, Pages, Placed, Shape
from .overlay_shader import make_shader

NEARER = 1e-6
"""Overlays are drawn this much nearer than the surfaces, in units of depth, so that these don't shine through."""
OCTAVES = 2.0
"""Ends of the scale of densities: the target divided and multiplied by 2 to this power."""
SQUARE = 8
"""Texels along an edge of the checker's large squares."""
SEAM_PIXELS = 1.2
"""Width of the seams of charts and of the edges of patches."""
WHITE = np.full((256, 3), 255, np.uint8)

RAMPS = {
    "lighting": lambda: WHITE,
    "illuminance": color_scale,
    "density": density_scale,
    "charts": lambda: distinct_colors(len(WHITE)),
    "patches": lambda: distinct_colors(len(WHITE)),
    "invalid": lambda: WHITE,
}
"""The 256 colours of each overlay."""


@dataclass(frozen=True)
class Look:
    """How an overlay is to be drawn.

    Attributes:
        overlay: its name, of NEEDS
        ends: of the scale of illuminance, lux
        gain: of the picture of the light
        target: density in the middle of the scale
        opacity: 0..1
        sharp: texels as they are, in place of what lies between them
    """

    overlay: str
    ends: tuple[float, float] = (1.0, 10.0)
    gain: float = 1.0
    target: float = 1.0
    opacity: float = 1.0
    sharp: bool = False


@dataclass(eq=False)
class Painter:
    """What is on the graphics card while an overlay is on; all of it goes when this goes."""

    shader: gpu.types.GPUShader = field(default_factory=make_shader)
    _batches: dict[tuple[Hashable, bool], gpu.types.GPUBatch] = field(default_factory=dict)
    _textures: dict[tuple[str, int], gpu.types.GPUTexture] = field(default_factory=dict)
    _ramps: dict[str, gpu.types.GPUTexture] = field(default_factory=dict)

    def forget_pages(self) -> None:
        """Read the pages anew."""
        self._textures.clear()

    def forget_shapes(self, keys: Sequence[Hashable]) -> None:
        """These meshes have changed."""
        for key in keys:
            for with_charts in (False, True):
                self._batches.pop((key, with_charts), None)

    def draw(self, things: Sequence[tuple[Placed, Shape, float]], pages: Pages, look: Look) -> None:
        """Draw an overlay over things, each with its shape and the texels along an edge of its uv square."""
        shader = self.shader
        gpu.state.blend_set("ALPHA" if look.opacity < 1 else "NONE")
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.depth_mask_set(True)
        projection = gpu.matrix.get_projection_matrix()
        settings = _settings(look)  # held until all is drawn: a shader holds no reference
        nearer = Matrix.Identity(4)
        nearer[2][3] = -NEARER
        try:
            with gpu.matrix.push_pop_projection():
                gpu.matrix.load_projection_matrix(nearer @ projection)
                shader.bind()
                shader.uniform_block("settings", settings)
                shader.uniform_sampler("ramp", self._ramp(look.overlay))
                linear = np.stack([thing.matrix[:3, :3] for thing, _, _ in things])
                moved = cofactors(linear)
                grams, mirrored = (moved.swapaxes(1, 2) @ moved).tolist(), np.linalg.det(linear) < 0
                for seed, (thing, shape, edge) in enumerate(things):
                    gram, turned = grams[seed], bool(mirrored[seed])
                    shader.uniform_float("gram_a", (gram[0][0], gram[1][1], gram[2][2], edge))
                    last = edge if look.overlay == "density" else 17.0 * seed
                    shader.uniform_float("gram_b", (gram[0][1], gram[1][2], gram[2][0], last))
                    self._draw_one(thing, shape, turned, pages, look.overlay)
        finally:
            gpu.state.depth_mask_set(False)
            gpu.state.depth_test_set("NONE")
            gpu.state.blend_set("NONE")

    def _draw_one(self, thing: Placed, shape: Shape, mirrored: bool, pages: Pages, overlay: str) -> None:
        shader = self.shader
        has_back = thing.back_page is not None
        needs_page = NEEDS[overlay] != SURFACES
        front = self._page(overlay, thing.page, pages) if needs_page else self._ramp("lighting")
        back = self._page(overlay, thing.back_page, pages) if needs_page and has_back else front
        with gpu.matrix.push_pop():
            gpu.matrix.multiply_matrix(Matrix(thing.matrix.tolist()))
            shader.uniform_float("place", (*thing.place, (3.0 if mirrored else 2.0) if has_back else 0.0))
            shader.uniform_sampler("page", front)
            shader.uniform_sampler("back_page", back)
            self._batch(thing.key, shape, overlay == "charts").draw(shader)

    def _batch(self, key: Hashable, shape: Shape, with_charts: bool) -> gpu.types.GPUBatch:
        """The triangles of a mesh; charts take seconds to find where there are a million, and are left out else."""
        if (key, with_charts) not in self._batches:
            count = len(shape.corners)
            chart, seams = (shape.chart, shape.seams) if with_charts else (np.zeros(count), np.zeros(0, np.int64))
            back = shape.uv if shape.back_uv is None else shape.back_uv
            columns = {
                "position": shape.corners.reshape(-1, 3),
                "uv": shape.uv.reshape(-1, 2),
                "back_uv": back.reshape(-1, 2),
                "ratio": np.repeat(shape.ratio, 3, axis=0),
                "border": border_distances(count, seams).reshape(-1, 3),
                "chart": np.repeat(chart, 3).astype(np.float32),
            }
            columns = {name: np.ascontiguousarray(values, np.float32) for name, values in columns.items()}
            self._batches[key, with_charts] = batch_for_shader(self.shader, "TRIS", columns)
        return self._batches[key, with_charts]

    def _page(self, overlay: str, page: int, pages: Pages) -> gpu.types.GPUTexture:
        need = NEEDS[overlay]
        if (need, page) not in self._textures:
            if need == TEXELS:
                self._textures[need, page] = _texture(pages.texels[page][..., None].astype(np.float32), "R32F")
            else:
                light = pages.light(page)
                filled = np.ones((*light.shape[:2], 4), np.float32)
                np.minimum(light, np.float32(65504), out=filled[..., :3])
                self._textures[need, page] = _texture(filled, "RGBA16F")
        return self._textures[need, page]

    def _ramp(self, overlay: str) -> gpu.types.GPUTexture:
        if overlay not in self._ramps:
            colors: UInt8 = RAMPS[overlay]()
            filled = np.ones((1, 256, 4), np.float32)
            filled[0, :, :3] = colors / np.float32(255)
            self._ramps[overlay] = _texture(filled, "RGBA16F")
        return self._ramps[overlay]


def border_distances(count: int, seams: Float64) -> Float32:
    """Of each triangle's corners (F, 3, 3): shares of its heights over its three edges, much where an edge is no seam.

    Between the corners they fall to 0 at seams and nowhere else.

    Args:
        seams: (K,) int, 3 * triangle + k for the edge from its corner k to the next
    """
    far = np.ones((count, 3), bool)
    triangle, start = np.divmod(seams, 3)
    far[triangle, (start + 2) % 3] = False  # the corner across the edge stands for it
    distances: Float32 = np.eye(3, dtype=np.float32) + np.float32(1e3) * far[:, None, :]
    return distances


def _texture(pixels: Float32, kind: str) -> gpu.types.GPUTexture:
    height, width = pixels.shape[:2]
    flat = np.ascontiguousarray(pixels).ravel()
    return gpu.types.GPUTexture((width, height), format=kind, data=gpu.types.Buffer("FLOAT", len(flat), flat))


def _settings(look: Look) -> gpu.types.GPUUniformBuf:
    low, high = np.log(look.ends[0]), np.log(look.ends[1])
    values = np.array(
        [
            low, 1 / (high - low), np.pi * LUMENS_PER_WATT, look.gain,
            list(NEEDS).index(look.overlay), look.opacity, look.sharp, look.target,
            OCTAVES, SQUARE, SEAM_PIXELS, 0,
        ],
        np.float32,
    )  # fmt: skip
    return gpu.types.GPUUniformBuf(gpu.types.Buffer("FLOAT", len(values), values))
