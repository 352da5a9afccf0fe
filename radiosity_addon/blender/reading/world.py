# SPDX-License-Identifier: GPL-3.0-or-later
"""The world as Cycles shows it: one colour is read from its nodes, anything else is rendered all around.

The render is of a scene that holds nothing but a copy of the world and a panoramic camera. In the copy the Light Path
node says what a diffuse ray would hear. Where the picture is too coarse for what it shows, a sun's disc, it is rendered
again, part by part and finer.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import bpy
import numpy as np

from ...arrays import Float32
from ...errors import SceneError
from ...scene import SkyTile, World
from ..data.evaluation import RENDER_HANDLERS, quiet_handlers, without_render_result
from ..looks.closures import rgb
from ..looks.materials import Computed, read_constant
from ..looks.nodes import LIGHT_PATH, tree_of
from .subject import Subject

Warn = Callable[[str], None]
Window = tuple[float, float, float, float]
"""West, east, south, north: radians."""

WHOLE: Window = (-math.pi, math.pi, -math.pi / 2, math.pi / 2)

HEIGHT = 1024
"""Pixels of the whole sky from south to north: 0.18 degrees each."""

SAMPLES, IMAGE_SAMPLES = 1, 4
"""Of a pixel, the second where there are images: none of a 4k image's pixels is missed."""

BLOCK = 16
"""Edge, in pixels, of what is rendered again."""

FINER = 16
"""How much finer that is: pixels of 0.011 degrees, 48 across the sun."""

FINER_SAMPLES = 16

UNSURE = 2e-4
"""A block is rendered again when its flux may be off by this share of the sky's."""

MOST_BLOCKS = 32

RAY = {**LIGHT_PATH, "Ray Depth": 1.0, "Diffuse Depth": 1.0}
"""What a diffuse ray hears from the Light Path node; all other outputs are 0."""

FOUND_SUN = math.radians(0.5)
"""In the first picture the Sky Texture's suns are at least so large, that none is missed; the finer ones show them."""


def read_world(world: bpy.types.World, group: int, warn: Warn) -> World | None:
    """The record of a world that is one colour; None if it takes a render to tell.

    Raises:
        SceneError: it emits NaN or infinity
        LinkCycle: its node tree feeds back into itself
    """
    if not getattr(getattr(world, "cycles_visibility", None), "diffuse", True):
        return World()
    if not getattr(world.cycles, "use_shadows", True):  # from 5.0
        warn("is set to cast no shadows, which is not followed: its light is blocked")
    tree = tree_of(world)
    try:
        radiance = np.array(world.color, np.float64) if tree is None else read_constant(tree).emission
    except Computed:
        return None
    if not np.isfinite(radiance).all():
        raise SceneError(
            f"World {world.name!r}", "its light is not a finite number", "Give its shader finite colours and strengths"
        )
    return World(rgb(np.maximum(radiance, 0)), group)


Sky = tuple[tuple[SkyTile, ...], tuple[str, ...]]
"""The whole sky, and what of it has to be seen finer, () if it is black; and what there is to say of it."""


def render_sky(subject: Subject, height: int) -> Generator[None, None, Sky]:
    """A world's radiance as a diffuse ray sees it.

    Each step takes a picture. Until the end nothing else may change the file.

    Args:
        subject: "world" is the original, left as found
        height: pixels of the whole sky from south to north

    Raises:
        SceneError: Cycles is disabled
    """
    with _as_diffuse_rays_see(subject.datablocks["world"]) as seen, _panorama(subject, seen.world) as look:
        samples = IMAGE_SAMPLES if seen.has_images else SAMPLES
        for sun, size in seen.suns:
            sun.sun_size = max(size, FOUND_SUN)
        whole = look(WHOLE, (2 * height, height), samples)
        if not whole.any():
            return (), seen.said
        for sun, size in seen.suns:
            sun.sun_size = size
        edge = BLOCK * FINER
        finer = []
        for window in _unsure(whole, samples):
            yield
            finer.append(SkyTile(look(window, (edge, edge), FINER_SAMPLES), *window))
    return (SkyTile(whole, *WHOLE), *finer), seen.said


def _unsure(whole: Float32, samples: int) -> list[Window]:
    """Blocks of the sky whose flux a few samples a pixel can't tell, the worst first."""
    bright = whole.sum(2)
    height, width = bright.shape
    solid = np.diff(np.sin(np.linspace(-math.pi / 2, math.pi / 2, height + 1))) * (2 * math.pi / width)
    padded = np.pad(np.pad(bright, ((0, 0), (1, 1)), "wrap"), ((1, 1), (0, 0)), "edge")
    beside = [padded[1 + y : 1 + y + height, 1 + x : 1 + x + width] for y in (-1, 0, 1) for x in (-1, 0, 1)]
    # where light falls or rises evenly, a few samples see its mean
    uneven = bright - sum(beside) / np.float32(9)
    error = (uneven * (solid[:, None] / math.sqrt(samples))).astype(np.float64) ** 2
    blocks = np.sqrt(error.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).sum(axis=(1, 3)))
    step = math.pi * BLOCK / height
    order = np.argsort(-blocks, axis=None, kind="stable")[:MOST_BLOCKS]
    chosen = order[blocks.reshape(-1)[order] > UNSURE * float((bright * solid[:, None]).sum())]
    corners = [
        (column * step - math.pi, row * step - math.pi / 2)
        for row, column in zip(*np.divmod(chosen, width // BLOCK), strict=True)
    ]
    return [(float(west), float(west + step), float(south), float(south + step)) for west, south in corners]


Look = Callable[[Window, tuple[int, int], int], Float32]
"""A window, its size in pixels and samples of a pixel: its radiance, (height, width, 3) as a SkyTile has it."""


@contextmanager
def _panorama(subject: Subject, world: bpy.types.World) -> Iterator[Look]:
    """A scene of the world alone, and how to look at it; nothing of it stays."""
    with ExitStack() as stack:
        stack.enter_context(quiet_handlers(RENDER_HANDLERS))
        stack.enter_context(without_render_result())
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="radiosity-sky-")))
        scene = bpy.data.scenes.new("Radiosity")
        stack.callback(bpy.data.scenes.remove, scene)
        camera = bpy.data.cameras.new("Radiosity")
        stack.callback(bpy.data.cameras.remove, camera)  # takes its object along
        scene.camera = bpy.data.objects.new("Radiosity", camera)
        # looks along +x with z up, so that longitudes are those of the world, but for their sign
        scene.camera.rotation_euler = (math.pi / 2, 0, -math.pi / 2)
        scene.collection.objects.link(scene.camera)
        scene.world = world
        _set_up(scene, world)
        subject.pose(scene)
        scene.cycles.shading_system = subject.osl
        lens = camera if hasattr(camera, "panorama_type") else camera.cycles  # before 5.0
        camera.type, lens.panorama_type = "PANO", "EQUIRECTANGULAR"

        def look(window: Window, size: tuple[int, int], samples: int) -> Float32:
            west, east, lens.latitude_min, lens.latitude_max = window
            lens.longitude_min, lens.longitude_max = -east, -west
            scene.render.resolution_x, scene.render.resolution_y = size
            scene.cycles.samples = samples
            scene.render.filepath = str(folder / "sky.exr")
            bpy.ops.render.render("EXEC_DEFAULT", scene=scene.name, write_still=True)
            radiance = _pixels(folder / "sky.exr")[:, ::-1]  # from east to west as the camera sees it
            return np.ascontiguousarray(np.maximum(radiance, 0))

        yield look


def _set_up(scene: bpy.types.Scene, world: bpy.types.World) -> None:
    """Cycles on the processor, box-filtered pixels, nothing denoised; a file of plain floats in the working space."""
    render, image = scene.render, scene.render.image_settings
    try:
        render.engine = "CYCLES"
    except TypeError as error:
        raise SceneError(
            f"World {world.name!r}",
            "only Cycles can tell how its nodes light, and Cycles is disabled",
            "Enable the Cycles Render Engine add-on, or give the world one colour",
        ) from error
    render.resolution_percentage = 100
    render.use_compositing = render.use_sequencer = render.use_file_extension = False
    if hasattr(image, "media_type"):  # from 5.0; it decides which formats there are
        image.media_type = "IMAGE"
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGB", "32"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.pixel_filter_type = "BOX"
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.seed = 0


def _pixels(path: Path) -> Float32:
    """An EXR's pixels as they are, (H, W, 3) float32, row 0 at the bottom."""
    image = bpy.data.images.load(str(path), check_existing=False)
    try:
        image.colorspace_settings.is_data = True
        width, height = image.size
        pixels = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(pixels)
        return pixels.reshape(height, width, image.channels)[:, :, :3]
    finally:
        bpy.data.images.remove(image)


class _Seen:
    """A copy of a world that shows a camera what the world shows a diffuse ray.

    Attributes:
        world: the copy
        groups: copies of the node groups in it, by the name of what they are copies of
        suns: Sky Texture nodes that show a sun, and its size, radians
        has_images: of any kind
        said: what there is to say of it
    """

    def __init__(self, world: bpy.types.World) -> None:
        self.world = world.copy()
        self.groups: dict[str, bpy.types.NodeTree] = {}
        self.suns: list[tuple[bpy.types.ShaderNodeTexSky, float]] = []
        self.has_images = False
        self.said: tuple[str, ...] = ()
        self.world.cycles_visibility.camera = True
        self.world.cycles.sampling_method = "NONE"  # a map for it would take longer than the picture
        tree = tree_of(self.world)
        if tree is not None:
            self._change(tree)
            output = tree.get_output_node("CYCLES")
            for link in list(output.inputs["Volume"].links) if output is not None else ():
                self.said = ("has a volume, which is ignored",)
                tree.links.remove(link)

    def remove(self) -> None:
        bpy.data.worlds.remove(self.world)
        for group in self.groups.values():
            bpy.data.node_groups.remove(group)

    def _change(self, tree: bpy.types.NodeTree) -> None:
        """Put constants in the place of Light Path nodes, here and in copies of the groups inside."""
        for node in list(tree.nodes):
            if node.type == "GROUP" and node.node_tree is not None:
                name = node.node_tree.name_full
                if name not in self.groups:
                    self.groups[name] = node.node_tree.copy()
                    self._change(self.groups[name])
                node.node_tree = self.groups[name]
            elif node.type == "TEX_SKY":
                self.suns.append((node, node.sun_size))
            elif node.type == "LIGHT_PATH":
                for output in node.outputs:
                    for link in list(output.links):
                        constant = tree.nodes.new("ShaderNodeValue")
                        constant.outputs[0].default_value = RAY.get(output.name, 0.0)
                        tree.links.new(constant.outputs[0], link.to_socket)
            self.has_images |= node.type in ("TEX_ENVIRONMENT", "TEX_IMAGE")


@contextmanager
def _as_diffuse_rays_see(world: bpy.types.World) -> Iterator[_Seen]:
    seen = _Seen(world)
    try:
        yield seen
    finally:
        seen.remove()
