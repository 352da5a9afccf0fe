# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws overlays onto the surfaces in a 3D view, by a shader of our own; nothing in the file is touched."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

from ..arrays import Float32, Float64
from ..atlas.density import cofactors
from ..color.spaces import REC709
from ..pages.encodings import UInt8
from ..reports.pictures import LUMENS_PER_WATT, color_scale, density_scale, distinct_colors
from ..reports.texel_maps import INVALID, PATCHED
from .overlay_data import NEEDS, SURFACES, TEXELS, Pages, Placed, Shape

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
    "charts": lambda: distinct_colors(256),
    "patches": lambda: distinct_colors(256),
    "invalid": lambda: WHITE,
}
"""The 256 colours of each overlay."""

SETTINGS = """
struct Settings {
  vec4 scale;    /* log of the low end, 1 / span of logs, lux of light 1, gain of the picture */
  vec4 look;     /* which overlay, opacity, texels as they are, target density */
  vec4 fixed_;   /* octaves, texels of a square, width of seams, unused */
};
"""

VERTEX = """
void main() {
  uv_front = uv * place.x + place.yz;
  uv_behind = back_uv;
  border_distance = border;
  chart_number = chart;
  vec3 n = normalize(ratio + vec3(1e-30));
  shade = 0.82 + 0.18 * dot(n, vec3(0.36, 0.48, 0.8));
  float squares = gram_a.x * ratio.x * ratio.x + gram_a.y * ratio.y * ratio.y + gram_a.z * ratio.z * ratio.z
      + 2.0 * (gram_b.x * ratio.x * ratio.y + gram_b.y * ratio.y * ratio.z + gram_b.z * ratio.z * ratio.x);
  density = gram_a.w * pow(max(squares, 1e-30), -0.25);
  gl_Position = ModelViewProjectionMatrix * vec4(position, 1.0);
}
"""

FRAGMENT = """
bool behind;

vec4 texel(ivec2 at) {
  if (behind) {
    ivec2 last = textureSize(back_page, 0) - 1;
    return texelFetch(back_page, clamp(at, ivec2(0), last), 0);
  }
  ivec2 last = textureSize(page, 0) - 1;
  return texelFetch(page, clamp(at, ivec2(0), last), 0);
}

vec3 light_at(vec2 at) {
  if (settings.look.z > 0.5) { return texel(ivec2(floor(at))).rgb; }
  vec2 corner = floor(at - 0.5);
  vec2 share = at - 0.5 - corner;
  ivec2 low = ivec2(corner);
  vec3 below = mix(texel(low).rgb, texel(low + ivec2(1, 0)).rgb, share.x);
  vec3 above = mix(texel(low + ivec2(0, 1)).rgb, texel(low + ivec2(1, 1)).rgb, share.x);
  return mix(below, above, share.y);
}

vec3 ramp_at(float share) {
  return texelFetch(ramp, ivec2(int(clamp(share, 0.0, 1.0) * 255.0 + 0.5), 0), 0).rgb;
}

vec3 srgb(vec3 light) {
  vec3 c = clamp(light, 0.0, 1.0);
  return mix(c * 12.92, 1.055 * pow(max(c, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055, step(vec3(0.0031308), c));
}

/* A checker seen through a pixel of this width, from 0 to 1 (Quilez 2017). */
float checker(vec2 at, vec2 width) {
  vec2 w = max(width, vec2(1e-5));
  vec2 i = 2.0 * (abs(fract((at - 0.5 * w) * 0.5) - 0.5) - abs(fract((at + 0.5 * w) * 0.5) - 0.5)) / w;
  return 0.5 - 0.5 * i.x * i.y;
}

float hashed(float number) { return fract(sin(number * 12.9898) * 43758.5453); }

void main() {
  behind = place.w > 1.5 && ((place.w < 2.5) != gl_FrontFacing);
  vec2 size = vec2(textureSize(page, 0));
  vec2 at = (behind ? uv_behind : uv_front) * size;
  float which = settings.look.x;
  vec3 color = vec3(0.0);
  if (which < 0.5) {
    vec3 light = max(light_at(at) * settings.scale.w, 0.0);
    float most = max(light.r, max(light.g, light.b));
    color = srgb(most > 1.0 ? mix(vec3(1.0), light / most, 1.0 / most) : light);  /* towards white, its hue kept */
  }
  else if (which < 1.5) {
    float lux = dot(light_at(at), LUMINANCE) * settings.scale.z;
    color = ramp_at((log(max(lux, 1e-20)) - settings.scale.x) * settings.scale.y);
  }
  else if (which < 2.5) {
    vec2 place_on_grid = uv_front * gram_b.w;
    vec2 width = fwidth(place_on_grid);
    float small = checker(place_on_grid, width) - 0.5;
    float large = checker(place_on_grid / settings.fixed_.y, width / settings.fixed_.y) - 0.5;
    float share = 0.5 + 0.5 * log2(max(density, 1e-20) / settings.look.w) / settings.fixed_.x;
    color = ramp_at(share) * shade * (0.86 + 0.30 * large + 0.10 * small);
  }
  else if (which < 3.5) {
    vec3 pixels = border_distance / max(fwidth(border_distance), vec3(1e-9));
    float away = min(pixels.x, min(pixels.y, pixels.z));
    color = ramp_at(hashed(chart_number + gram_b.w)) * shade;
    color = mix(vec3(0.04), color, clamp(away - settings.fixed_.z + 0.5, 0.0, 1.0));
  }
  else {
    ivec2 own = ivec2(floor(at));
    float kind = texel(own).r;
    vec2 width = max(fwidth(at), vec2(1e-6));
    if (which < 4.5) {
      color = kind < PATCHED ? vec3(0.16) : ramp_at(hashed(kind)) * shade;
      vec2 inside = fract(at);
      float away = 1e3;
      if (texel(own + ivec2(1, 0)).r != kind) { away = min(away, (1.0 - inside.x) / width.x); }
      if (texel(own - ivec2(1, 0)).r != kind) { away = min(away, inside.x / width.x); }
      if (texel(own + ivec2(0, 1)).r != kind) { away = min(away, (1.0 - inside.y) / width.y); }
      if (texel(own - ivec2(0, 1)).r != kind) { away = min(away, inside.y / width.y); }
      float line = clamp(0.5 * settings.fixed_.z - away + 0.5, 0.0, 1.0);
      float fine = clamp(1.5 - 0.25 * max(width.x, width.y), 0.0, 1.0);
      color = mix(color, vec3(0.04), 0.85 * line * fine);
    }
    else {
      color = vec3(0.62) * shade;
      if (kind == INVALID) {
        float stripe = checker(vec2((at.x + at.y) * 0.5, 0.5), vec2(0.5 * (width.x + width.y), 1e-4));
        color = mix(vec3(0.85, 0.0, 0.5), vec3(1.0, 0.25, 0.72), stripe);
      }
    }
  }
  out_color = vec4(color, settings.look.y);
  if (srgbTarget) {
    vec3 c = clamp(color, 0.0, 1.0);
    out_color.rgb = mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(vec3(0.04045), c));
  }
}
"""


def make_shader() -> gpu.types.GPUShader:
    """The shader of all overlays."""
    between = gpu.types.GPUStageInterfaceInfo("radiosity_overlay")
    between.smooth("VEC2", "uv_front")
    between.smooth("VEC2", "uv_behind")
    between.smooth("VEC3", "border_distance")
    between.flat("FLOAT", "chart_number")
    between.flat("FLOAT", "shade")
    between.flat("FLOAT", "density")
    info = gpu.types.GPUShaderCreateInfo()
    info.typedef_source(SETTINGS)
    weights = ", ".join(f"{weight:.7f}" for weight in REC709.luminance_weights)
    info.define("LUMINANCE", f"vec3({weights})")
    info.define("PATCHED", f"{PATCHED:.1f}")
    info.define("INVALID", f"{INVALID:.1f}")
    info.push_constant("MAT4", "ModelViewProjectionMatrix")
    for name in ("place", "gram_a", "gram_b"):
        info.push_constant("VEC4", name)
    info.push_constant("BOOL", "srgbTarget")  # Blender sets it
    info.uniform_buf(0, "Settings", "settings")
    for slot, name in enumerate(("page", "back_page", "ramp")):
        info.sampler(slot, "FLOAT_2D", name)
    inputs = ("VEC3 position", "VEC2 uv", "VEC2 back_uv", "VEC3 ratio", "VEC3 border", "FLOAT chart")
    for slot, (kind, name) in enumerate(text.split() for text in inputs):
        info.vertex_in(slot, kind, name)
    info.vertex_out(between)
    info.fragment_out(0, "VEC4", "out_color")
    info.vertex_source(VERTEX)
    info.fragment_source(FRAGMENT)
    return gpu.shader.create_from_info(info)


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
                for seed, (thing, shape, edge) in enumerate(things):
                    self._draw_one(thing, shape, edge, seed, pages, look.overlay)
        finally:
            gpu.state.depth_mask_set(False)
            gpu.state.depth_test_set("NONE")
            gpu.state.blend_set("NONE")

    def _draw_one(self, thing: Placed, shape: Shape, edge: float, seed: int, pages: Pages, overlay: str) -> None:
        shader = self.shader
        linear = thing.matrix[:3, :3]
        mirrored = np.linalg.det(linear) < 0
        has_back = thing.back_page is not None
        moved = cofactors(linear)
        gram = moved.T @ moved
        needs_page = NEEDS[overlay] != SURFACES
        front = self._page(overlay, thing.page, pages) if needs_page else self._ramp("lighting")
        back = self._page(overlay, thing.back_page, pages) if needs_page and has_back else front
        with gpu.matrix.push_pop():
            gpu.matrix.multiply_matrix(Matrix(thing.matrix.tolist()))
            shader.uniform_float("place", (*thing.place, (3.0 if mirrored else 2.0) if has_back else 0.0))
            shader.uniform_float("gram_a", (*np.diag(gram), edge))
            last = edge if overlay == "density" else 17.0 * seed
            shader.uniform_float("gram_b", (gram[0, 1], gram[1, 2], gram[2, 0], last))
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
