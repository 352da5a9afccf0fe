# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of a running bake, drawn over the scene in every 3D view, whatever its shading.

Nothing of the file is touched: what is drawn is the scene as it was read, lit as far as is known. Views come from the
bake's thread, already in the form that the graphics card takes; drawing is the main thread's.
"""

from __future__ import annotations

import time
from typing import Any

import bpy
import gpu
import numpy as np
from mathutils import Matrix

from ...arrays import Bools, Float32
from ...viewing import LitPages, LitVertices, View
from .display_table import BRIGHTEST, DARKEST, EDGE, SHOW_MATERIALS, is_exposed

NEARER = 1e-3
"""Share of its distance by which what is drawn lies before the surfaces that it covers."""

NEARER_FLAT = 1e-5
"""The same without perspective, in depths of the view."""

VERTEX = """
void main() {
    gl_Position = projection * vec4(position, 1.0);
    passed = given;
}
"""

FRAGMENT = """
void main() {
    vec3 radiance = %s;
    vec3 level = (log2(max(gain * radiance, vec3(1e-9))) - darkest) / (brightest - darkest);
    vec3 entry = (clamp(level, 0.0, 1.0) * (edge - 1.0) + 0.5) / edge;
    vec3 color = texture(display, entry).rgb;
    if (srgbTarget) {  // it encodes what is written
        color = mix(color / 12.92, pow((color + 0.055) / 1.055, vec3(2.4)), step(vec3(0.04045), color));
    }
    shown = vec4(color, 1.0);
}
"""

Attributes = dict[str, Float32]
"""Of the corners of triangles that are drawn in one go."""

Pieces = list[tuple[Attributes, Float32 | None]]
"""What is drawn, and the page that it lies on, if on one."""


class LiveView:
    """Draws what a bake shows; a viewing.Viewer.

    Attributes:
        visible: (M,) of the meshes, those of backs included, which to draw
        table: how light is shown, as of display_table; nothing is drawn without
        satisfied: set to True to have the bake end with the light as it was shown last
        fresh: there is more to see than was drawn
        lit: there is something to see
        first_at: when the first picture was drawn, by time.perf_counter; None before
        drawing: seconds that the longest drawing has taken
    """

    def __init__(self) -> None:
        self.visible: Bools = np.zeros(0, bool)
        self.table: Float32 | None = None
        self.satisfied = False
        self.first_at: float | None = None
        self.drawing = 0.0
        self.fresh = False
        self.lit = False
        self._next: Pieces | None = None
        self._laid: tuple[Float32 | None, list[Attributes]] = None, []  # of which corners they are
        self._batches: list[tuple[Attributes, gpu.types.GPUBatch, gpu.types.GPUTexture | None]] = []
        self._shaders: dict[bool, gpu.types.GPUShader] = {}
        self._display: gpu.types.GPUTexture | None = None
        self._handle = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_VIEW")

    def show(self, view: View) -> None:
        """Called in the bake's thread."""
        if isinstance(view, LitVertices):
            self._next = _of_vertices(view, self.visible)
        else:
            if self._laid[0] is not view.corners:  # where surfaces lie is the same in all that follow
                self._laid = view.corners, _on_pages(view, self.visible)
            self._next = list(zip(self._laid[1], map(_opaque, view.images), strict=True))
        self.fresh = self.lit = True

    def remove(self) -> None:
        """Draw no more."""
        bpy.types.SpaceView3D.draw_handler_remove(self._handle, "WINDOW")
        self._batches.clear()

    def _draw(self) -> None:
        begin = time.perf_counter()
        if self.table is None or bpy.context.space_data.local_view is not None:
            return  # in local view it would cover what is looked at with all the rest
        pieces, self._next = self._next, None
        if pieces is not None:
            self._batches = [self._uploaded(*piece) for piece in pieces]
        if not self._batches:
            return
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.depth_mask_set(True)
        gpu.state.face_culling_set("BACK")
        try:
            projection, gain = _projection(bpy.context.region_data), _gain(bpy.context)
            for _, batch, texture in self._batches:
                shader = self._shaders[texture is not None]
                shader.bind()
                shader.uniform_float("projection", projection)
                shader.uniform_float("gain", gain)
                shader.uniform_sampler("display", self._display)
                if texture is not None:
                    shader.uniform_sampler("page", texture)
                batch.draw(shader)
        finally:
            gpu.state.depth_test_set("NONE")
            gpu.state.depth_mask_set(False)
            gpu.state.face_culling_set("NONE")
        now = time.perf_counter()
        self.drawing = max(self.drawing, now - begin)
        if self.first_at is None:
            self.first_at = now

    def _uploaded(
        self, attributes: Attributes, image: Float32 | None
    ) -> tuple[Attributes, gpu.types.GPUBatch, gpu.types.GPUTexture | None]:
        paged = image is not None
        if self._display is None:
            whole = np.ones((*self.table.shape[:3], 4), np.float32)
            whole[..., :3] = self.table
            self._display = _texture((EDGE, EDGE, EDGE), whole)
        if paged not in self._shaders:
            self._shaders[paged] = _shader(paged)
        texture = None if image is None else _texture((image.shape[1], image.shape[0]), image)
        there = next((batch for known, batch, _ in self._batches if known is attributes), None)
        return attributes, there or _batch(attributes), texture


def _batch(attributes: Attributes) -> gpu.types.GPUBatch:
    form = gpu.types.GPUVertFormat()
    for name, values in attributes.items():
        form.attr_add(id=name, comp_type="F32", len=values.shape[1], fetch_mode="FLOAT")
    buffer = gpu.types.GPUVertBuf(form, len(attributes["position"]))
    for name, values in attributes.items():
        buffer.attr_fill(name, values)
    return gpu.types.GPUBatch(type="TRIS", buf=buffer)


def _projection(region: bpy.types.RegionView3D) -> Matrix:
    """The view's, which brings all a little nearer."""
    window = region.window_matrix.copy()
    window[2][3] -= NEARER * abs(window[2][3]) if region.is_perspective else NEARER_FLAT
    return window @ region.view_matrix


def _gain(context: bpy.types.Context) -> float:
    """The exposure with which the baked light will be seen, in the view or once it shows materials."""
    shading = context.space_data.shading
    seen = is_exposed(shading) or shading.type not in SHOW_MATERIALS
    return 2.0**context.scene.view_settings.exposure if seen else 1.0


def _of_vertices(view: LitVertices, visible: Bools) -> Pieces:
    corners = view.pieces[visible[view.mesh]].reshape(-1)
    return [({"position": view.position[corners], "given": view.radiance[corners]}, None)]


def _on_pages(view: LitPages, visible: Bools) -> list[Attributes]:
    """Of each page."""
    chosen = [(view.page == page) & visible[view.mesh] for page in range(len(view.images))]
    return [{"position": view.corners[some].reshape(-1, 3), "given": view.uv[some].reshape(-1, 2)} for some in chosen]


def _opaque(image: Float32) -> Float32:
    whole = np.ones((*image.shape[:2], 4), np.float32)
    whole[:, :, :3] = image
    return whole


def _texture(size: tuple[int, ...], values: Float32) -> gpu.types.GPUTexture:
    return gpu.types.GPUTexture(size, format="RGBA16F", data=gpu.types.Buffer("FLOAT", values.size, values.ravel()))


def _shader(paged: bool) -> gpu.types.GPUShader:
    kind = "VEC2" if paged else "VEC3"
    between = gpu.types.GPUStageInterfaceInfo("radiosity_" + kind.lower())
    between.smooth(kind, "passed")
    info: Any = gpu.types.GPUShaderCreateInfo()
    info.push_constant("MAT4", "projection")
    info.push_constant("FLOAT", "gain")
    info.push_constant("BOOL", "srgbTarget")  # Blender sets it
    info.define("darkest", str(DARKEST))
    info.define("brightest", str(BRIGHTEST))
    info.define("edge", str(float(EDGE)))
    info.sampler(0, "FLOAT_3D", "display")
    if paged:
        info.sampler(1, "FLOAT_2D", "page")
    info.vertex_in(0, "VEC3", "position")
    info.vertex_in(1, kind, "given")
    info.vertex_out(between)
    info.fragment_out(0, "VEC4", "shown")
    info.vertex_source(VERTEX)
    info.fragment_source(FRAGMENT % ("texture(page, passed).rgb" if paged else "passed"))
    return gpu.shader.create_from_info(info)
