# SPDX-License-Identifier: GPL-3.0-or-later
"""The shader that colours surfaces by an overlay. What it needs stands in the corners of triangles and in textures."""

from __future__ import annotations

import gpu

from ...color.spaces import REC709
from ...reports.texel_maps import INVALID, PATCHED

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
